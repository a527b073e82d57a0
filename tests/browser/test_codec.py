"""The client's codec against the server's."""

from __future__ import annotations

import base64
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
import torch

import torchrender_service as service_package
from browser_stage import JPEG_READY, Visit, run_script
from torchrender.wire.codec import decode_depth, encode_depth, encode_mask
from torchrender.wire.messages import Ack, Pose, Type, decode


def images() -> dict[str, torch.Tensor]:
    """Depth images (H,W), among them such that need every bit, wrap around, or hold nothing."""
    random = torch.Generator().manual_seed(4)
    noise = torch.rand(37, 53, generator=random)
    v, u = torch.meshgrid(torch.arange(37.0), torch.arange(53.0), indexing="ij")
    plane = 1.0 / (0.05 + 0.002 * u + 0.004 * v)
    holes = torch.where(noise > 0.5, plane, torch.inf)
    checker = torch.where((u + v) % 2 > 0, 1.0, torch.inf)
    return {
        "noise": 0.5 + 100.0 * noise**4,
        "plane": plane,
        "plane with sky": holes,
        "nearest beside sky": checker,
        "extreme range": torch.exp(40.0 * (noise - 0.5)),
        "sky": torch.full((5, 7), torch.inf),
        "one pixel": torch.tensor([[3.0]]),
        "one row": 1.0 + noise[:1],
        "one column": 1.0 + noise[:, :1],
    }


@pytest.fixture(scope="module")
def tools(browser: Any, service: Any) -> Any:
    """A page at the server's address that holds no client, with the client's modules at hand."""
    context = browser.new_context()
    page = context.new_page()
    page.goto(service.url + "vendor/README.md")
    yield page
    context.close()


def run(page: Any, script: str, **values: Any) -> Any:
    """A script with the client's modules at hand."""
    modules = """
        const { ZSTDDecoder } = await import("/vendor/zstddec/zstddec.mjs");
        const { undoPrediction, unpackBits } = await import("/js/depth-codec.js");
        const { TYPE, crc32, decodeMessage, encodeMessage } = await import("/js/wire.js");
        const zstd = new ZSTDDecoder();
        await zstd.init();
    """
    return run_script(page, modules + script, **values)


@pytest.mark.parametrize("bits", [12, 14, 16])
@pytest.mark.parametrize("name", images())
def test_depths_are_the_same(tools: Any, name: str, bits: int) -> None:
    depth = images()[name]
    height, width = depth.shape
    encoded = encode_depth(depth, bits=bits)
    script = """
        const planes = zstd.decode(bytes(given.data), 2 * given.width * given.height);
        return text(new Uint8Array(undoPrediction(planes, given.width, given.height).buffer));
    """
    codes = np.frombuffer(base64.b64decode(run(tools, script, data=encoded.data, width=width, height=height)), "<u2")
    expected = decode_depth(encoded.data, width=width, height=height, bits=bits, near=encoded.near)
    share = codes.reshape(height, width).astype(np.float64) / (2**bits - 1)
    assert np.abs(share - encoded.near / expected.double().numpy()).max() < 1e-6
    assert np.abs(share - encoded.near / depth.double().numpy()).max() <= encoded.error


@pytest.mark.parametrize("width", [1, 7, 8, 9, 64])
def test_masks_are_the_same(tools: Any, width: int) -> None:
    mask = torch.rand(11, width, generator=torch.Generator().manual_seed(width)) > 0.4
    script = """
        const packed = zstd.decode(bytes(given.data), ((given.width + 7) >> 3) * given.height);
        return Array.from(unpackBits(packed, given.width, given.height));
    """
    assert run(tools, script, data=encode_mask(mask), width=width, height=11) == mask.int().reshape(-1).tolist()


def test_the_example_of_the_protocol_byte_for_byte(tools: Any) -> None:
    document = (Path(service_package.__file__).parent / "PROTOCOL.md").read_text()
    found = re.search(r"```hex ack\n(.*?)```", document, re.DOTALL)
    assert found
    ack = "{ id: 7, decode_ms: 3.5, shown_ms: 1250.25, holes: 0.125 }"
    assert base64.b64decode(run(tools, f"return text(encodeMessage(TYPE.ACK, {ack}));")) == bytes.fromhex(found[1])


def test_the_server_reads_what_the_page_sends(visit: Callable[..., Visit]) -> None:
    page = visit()
    page.wait(JPEG_READY)
    page.wait_for_message(Type.ACK, lambda ack: isinstance(ack, Ack) and ack.decode_ms > 0)
    hello = decode(page.sent[0], [Type.HELLO]).message
    assert hello.layers == 1
    seen = tuple(page.state("camera")["world_from_camera"])
    page.wait_for_message(
        Type.POSE,
        lambda pose: isinstance(pose, Pose) and msgspec.to_builtins(pose.camera)["world_from_camera"] == seen,
    )


@pytest.mark.parametrize(
    ("damage", "complaint"),
    [
        ("data[data.length - 9] ^= 1", "checksum"),
        ("data[0] = 0", "TRDI"),
        ("data[4] = 2", "version"),
        ("buffer = buffer.slice(0, buffer.byteLength - 64)", "does not fit"),
        ("buffer = buffer.slice(0, 7)", "too short"),
        ("new DataView(buffer).setUint32(8, 2 ** 31, true)", "header"),
        ("maxPixels = 100", "keyframe of"),
    ],
)
def test_damaged_keyframes_are_refused(tools: Any, room: Visit, damage: str, complaint: str) -> None:
    message = room.layers(room.state("keyframes")[-1]["id"])[0]
    script = f"""
        const {{ Decoder }} = await import("/js/decoder.js");
        let buffer = bytes(given.data).buffer, maxPixels = 1e6;
        const data = new Uint8Array(buffer);
        const decoder = new Decoder();
        const whole = await decoder.decode(buffer.slice(0), maxPixels);
        {damage};
        const answer = await decoder.decode(buffer, maxPixels).then(() => "taken", (error) => error.message);
        decoder.worker.terminate();
        return [whole.codes.length, answer];
    """
    pixels, answer = run(tools, script, data=message)
    assert pixels > 0
    assert complaint in answer
