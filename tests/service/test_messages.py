"""Framing and headers: the document's bytes, round trips, and whatever else may arrive."""

from __future__ import annotations

import math
import re
from pathlib import Path

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from torchrender.kernels.warp.depth_codec import encode_planes
from torchrender.wire.errors import ProtocolError
from torchrender.wire.messages import (
    Ack,
    Bye,
    CameraHeader,
    ColorBlob,
    DepthBlob,
    Hello,
    Keyframe,
    Look,
    Pick,
    Picked,
    Pose,
    Problem,
    Resync,
    Settings,
    Status,
    Type,
    Welcome,
    decode,
    encode,
    padded,
    split_blobs,
)
from torchrender_service.streams.stream import FROM_CLIENT

DOCUMENT = (Path(__file__).resolve().parents[2] / "service" / "torchrender_service" / "PROTOCOL.md").read_text()
IDENTITY = tuple(float(i % 5 == 0) for i in range(16))
CAMERA = CameraHeader(world_from_camera=IDENTITY, fx=100.0, fy=100.0, cx=32.0, cy=24.0, width=64, height=48, near=0.1)
MESSAGES = (
    Hello(versions=(1, 1), color=("jpeg", "webp"), max_pixels=10**6, layers=2),
    Welcome(version=1, session="s", resume="r", credits=2, limits={"a": 1}, scene={"id": "x"}, camera=CAMERA),
    Pose(seq=3, time_ms=1.5, camera=CAMERA, velocity=(1.0, 0.0, -2.0), moving=False),
    Ack(id=7, decode_ms=3.5, shown_ms=1250.25, holes=0.125),
    Resync(last=None),
    Problem(type="urn:x", title="t", status=422, detail="d"),
    Bye(reason="done", retry_after_s=2.0),
    Settings(budget_ms=100.0, max_error=None, layers=1),
    Settings(density=2.5, asymmetry=-0.3),
    Settings(seq=4, exposure=-1.5, tone_map="aces", off=("lights", "media")),
    Settings(exposure="auto"),
    Status(doing="still", since_ms=900.0, ahead=2),
    Look(camera=CAMERA),
    Pick(seq=1, camera=CAMERA, x=10.5, y=3.0),
    Picked(seq=1, triangle=7, object=2, face=3, name="lamp", point=(1.0, 2.0, 3.0), depth=4.0),
)


def example(name: str) -> bytes:
    found = re.search(rf"```hex {name}\n(.*?)```", DOCUMENT, re.DOTALL)
    assert found is not None
    return bytes.fromhex(found[1])


def keyframe(blobs: list[bytes]) -> bytes:
    header = Keyframe(
        id=1,
        pose=2,
        camera=CAMERA,
        layer=0,
        layers=1,
        still=True,
        depth=DepthBlob(codec="pz1", bits=16, near=1.0, length=len(blobs[0]), error=1e-5),
        color=ColorBlob(codec="jpeg", length=len(blobs[1])),
        crc32=0,
        render_ms=1.0,
        encode_ms=1.0,
    )
    return encode(header, blobs)


def test_the_document_shows_these_bytes():
    data = example("ack")
    assert encode(Ack(id=7, decode_ms=3.5, shown_ms=1250.25, holes=0.125)) == data
    assert decode(data).message == Ack(id=7, decode_ms=3.5, shown_ms=1250.25, holes=0.125)
    depth = np.array([[2, 4, 4, np.inf], [2, 4, 8, np.inf]], np.float32)
    planes = np.zeros((2, 2, 4), np.uint8)
    assert not encode_planes(depth, 2.0, 65535.0, planes)
    assert planes.tobytes() == example("planes")


def test_the_document_names_every_type():
    for kind in Type:
        assert f"| {int(kind)} | {kind.name} |" in DOCUMENT


@pytest.mark.parametrize("message", MESSAGES, ids=lambda m: type(m).__name__)
def test_round_trip(message):
    data = encode(message)
    assert len(data) % 8 == 0
    assert decode(data).message == message


def test_blobs_are_aligned_and_come_back():
    blobs = [b"12345", b"abcdefgh"]
    data = keyframe(blobs)
    received = decode(data)
    assert [bytes(b) for b in split_blobs(received)] == blobs
    assert bytes(received.blobs) == padded(blobs) == b"12345\0\0\0abcdefgh"
    two = decode(data + data, (Type.KEYFRAME,), whole=False)
    assert two.size == len(data)
    with pytest.raises(ProtocolError, match="header and blobs need"):
        decode(data + data)


@pytest.mark.parametrize("cut", [0, 1, 11, 12, 40, -1, -8])
def test_cut_off(cut):
    data = keyframe([b"12345", b"abcdefgh"])
    with pytest.raises(ProtocolError) as caught:
        decode(data[:cut])
    assert caught.value.fatal


@pytest.mark.parametrize(
    ("place", "value", "reason"),
    [
        (0, 0, "TRDI"),
        (4, 2, "major version must be 1"),
        (5, 99, "message type"),
        (6, 1, "flags"),
        (11, 255, "header len"),
    ],
)
def test_a_wrong_frame_names_what_is_wrong(place, value, reason):
    data = bytearray(encode(MESSAGES[3]))
    data[place] = value
    with pytest.raises(ProtocolError, match=reason) as caught:
        decode(bytes(data))
    assert caught.value.fatal


@pytest.mark.parametrize(
    ("message", "change", "reason"),
    [
        (2, {"seq": -1}, "seq"),
        (2, {"velocity": [0.0, math.nan, 0.0]}, "velocity"),
        (2, {"velocity": [0.0, 1.0]}, "velocity"),
        (2, {"time_ms": math.inf}, "time_ms"),
        (2, {"camera": {**msgspec.to_builtins(CAMERA), "width": 0}}, "width"),
        (2, {"camera": {**msgspec.to_builtins(CAMERA), "near": math.nan}}, "near"),
        (2, {"camera": None}, "camera"),
        (3, {"holes": 1.5}, "holes"),
        (3, {"id": "x"}, "id"),
        (7, {"budget_ms": 0.0}, "budget_ms"),
        (7, {"layers": 99}, "layers"),
        (0, {"versions": [1]}, "versions"),
    ],
)
def test_a_value_out_of_range_is_named_and_not_fatal(message, change, reason):
    header = msgspec.msgpack.encode({**msgspec.to_builtins(MESSAGES[message]), **change})
    data = encode(MESSAGES[message])[:8] + len(header).to_bytes(4, "little") + header
    data += bytes(-len(data) % 8)
    with pytest.raises(ProtocolError, match=reason) as caught:
        decode(data)
    assert not caught.value.fatal


@settings(max_examples=300, deadline=None)
@given(st.binary(max_size=200))
def test_random_bytes_never_get_through(data):
    with pytest.raises(ProtocolError):
        decode(data, FROM_CLIENT)


@settings(max_examples=300, deadline=None)
@given(st.sampled_from(MESSAGES), st.lists(st.tuples(st.integers(0, 10**6), st.integers(0, 255)), max_size=8))
def test_changed_bytes_are_read_or_refused(message, changes):
    data = bytearray(encode(message))
    for place, value in changes:
        data[place % len(data)] = value
    try:
        decode(bytes(data))
    except ProtocolError as error:
        assert str(error).isprintable()


@settings(max_examples=200, deadline=None)
@given(
    st.sampled_from(FROM_CLIENT),
    st.recursive(
        st.none() | st.booleans() | st.integers(-(2**63), 2**64 - 1) | st.floats() | st.text(max_size=5),
        lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.sampled_from(("id", "seq", "camera")), inner),
        max_leaves=12,
    ),
)
def test_any_header_is_read_or_refused(kind, value):
    header = msgspec.msgpack.encode(value)
    data = b"TRDI" + bytes([1, kind, 0, 0]) + len(header).to_bytes(4, "little") + header
    data += bytes(-len(data) % 8)
    try:
        decode(data, FROM_CLIENT)
    except ProtocolError as error:
        assert kind.name in str(error)
