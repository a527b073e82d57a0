"""Compressed streams: against a slow decoder written from the specification's text, and against another encoder."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from torchrender.kernels.files.meshopt import decode_indices, decode_triangles, decode_vertices
from torchrender.scene.files.gltf.meshopt import decode_view, filtered

# Made by the reference encoder, meshoptimizer 0.2x, version 0 of vertices and 1 of indices.
VERTICES = bytes.fromhex(
    "a0000007000000ffff807fff7fff00ff807fc0bfff00000080ffffff053fc000007f7ffefd67000000fd0000053fc3fc3fc0bf7fbf807fc0"
    "201f7fffff000000c03f7f80010000200400000000000000000000000000000000000000000000000000000040000040c0"
)
POSITIONS = [
    [2, -3], [0, -5], [-2, -3], [1, -2], [-2, -5], [-3, -5], [-2, -5], [-4, -7], [-3, -5], [-6, -8],
    [-6, -9], [-3, -9], [-4, -9], [-3, -8], [-5, -6], [-3, -3], [-1, -5], [-2, -4], [-1, -3], [2, -4],
]  # fmt: skip
GRID = bytes.fromhex("e1fe1e001e001e9e0e041e031ef008007687566778a9866589689801690000")
GRID_FACES = [
    0, 4, 1, 1, 4, 5, 1, 5, 2, 2, 5, 6, 2, 6, 3, 3, 6, 7, 4, 8, 5, 5, 8, 9, 5, 9, 6, 6, 9, 10, 6, 10, 7, 7, 10, 11
]  # fmt: skip
FAR = bytes.fromhex("e1ff1ff01fff0afe0d810e9cbf099eaf64007687566778a9866589689801690000")
FAR_FACES = [5, 900, 3, 3, 900, 77777, 0, 1, 2, 2, 1, 900000]


def slow_vertices(data: bytes, count: int, stride: int) -> np.ndarray:
    """Appendix A, mode 0, step by step."""
    assert data[0] == 0xA0
    last = list(data[-stride:])
    out = np.zeros((count, stride), np.uint8)
    block = min(8192 // stride // 16 * 16, 256)
    at = 1
    for first in range(0, count, block):
        rows = min(block, count - first)
        for k in range(stride):
            groups = -(-rows // 16)
            header = "".join(f"{b >> 2 * j & 3}" for b in data[at : at + -(-groups // 4)] for j in range(4))
            at += -(-groups // 4)
            deltas: list[int] = []
            for g in range(groups):
                bits = {"0": 0, "1": 2, "2": 4, "3": 8}[header[g]]
                packed = "".join(f"{b:08b}" for b in data[at : at + 2 * bits])
                at += 2 * bits
                for i in range(16):
                    code = int(packed[i * bits : (i + 1) * bits] or "0", 2)
                    if bits in (2, 4) and code == 2**bits - 1:
                        code, at = data[at], at + 1
                    deltas.append(code)
            for i in range(rows):
                step = deltas[i] >> 1 if deltas[i] % 2 == 0 else -(deltas[i] >> 1) - 1
                last[k] = (last[k] + step) % 256
                out[first + i, k] = last[k]
    return out


def encoded_vertices(values: np.ndarray) -> bytes:
    """The smallest width for each group of sixteen: an encoder of mode 0."""
    count, stride = values.shape
    last = values[0].astype(int)
    body, block = bytearray([0xA0]), min(8192 // stride // 16 * 16, 256)
    for first in range(0, count, block):
        part = values[first : first + block].astype(int)
        for k in range(stride):
            steps = [(v - p + 128) % 256 - 128 for v, p in zip(part[:, k], [last[k], *part[:-1, k]], strict=True)]
            codes = [2 * s if s >= 0 else -2 * s - 1 for s in steps] + [0] * (-len(part) % 16)
            headers, data = [], bytearray()
            for g in range(0, len(codes), 16):
                group, choices = codes[g : g + 16], []
                for width, bits in enumerate((0, 2, 4, 8)):
                    most = 2**bits - 1
                    text = "".join(f"{min(c, most):0{bits}b}" for c in group) if bits else ""
                    extra = [c for c in group if c >= most] if bits in (2, 4) else []
                    if bits or not any(group):
                        choices.append((len(text) // 8 + len(extra), width, text, extra))
                _, width, text, extra = min(choices)
                headers.append(width)
                data += bytes(int(text[i : i + 8], 2) for i in range(0, len(text), 8)) + bytes(extra)
            headers += [0] * (-len(headers) % 4)
            body += bytes(sum(h << 2 * j for j, h in enumerate(headers[i : i + 4])) for i in range(0, len(headers), 4))
            body += data
        last = part[-1]
    return bytes(body) + bytes(max(32 - stride, 0)) + values[0].tobytes()


@settings(deadline=None, max_examples=20)
@given(st.integers(1, 300), st.sampled_from([4, 8, 12, 64]), st.integers(0, 255), st.integers(0, 2**32 - 1))
def test_vertices_come_back(count: int, stride: int, spread: int, seed: int) -> None:
    steps = np.random.default_rng(seed).integers(-spread - 1, spread + 2, (count, stride))
    values = np.cumsum(steps, axis=0).astype(np.uint8)
    data = encoded_vertices(values)
    out = np.zeros_like(values)
    assert decode_vertices(np.frombuffer(data, np.uint8), out)
    np.testing.assert_array_equal(out, values)
    if count < 100 and stride < 12:
        np.testing.assert_array_equal(slow_vertices(data, count, stride), values)


def test_streams_of_the_reference_encoder() -> None:
    expected = np.array(POSITIONS, "<f4")
    out = np.zeros((20, 8), np.uint8)
    assert decode_vertices(np.frombuffer(VERTICES, np.uint8), out)
    np.testing.assert_array_equal(out.view("<f4"), expected)
    np.testing.assert_array_equal(slow_vertices(VERTICES, 20, 8), out)
    for data, faces in ((GRID, GRID_FACES), (FAR, FAR_FACES)):
        indices = np.zeros(len(faces), np.uint32)
        assert decode_triangles(np.frombuffer(data, np.uint8), indices)
        # The encoder may start a triangle at another corner.
        for found, meant in zip(indices.reshape(-1, 3).tolist(), np.reshape(faces, (-1, 3)).tolist(), strict=True):
            assert found in [meant[k:] + meant[:k] for k in range(3)]


def encoded_indices(indices: list[int]) -> bytes:
    """Mode 2 with the first baseline alone or both in turn."""
    body, last = bytearray([0xD1]), [0, 0]
    for place, index in enumerate(indices):
        which = place % 2
        delta, last[which] = index - last[which], index
        code = (2 * delta if delta >= 0 else -2 * delta - 1) << 1 | which
        while code >= 128:
            body.append(code & 127 | 128)
            code >>= 7
        body.append(code)
    return bytes(body) + bytes(4)


@settings(deadline=None)
@given(st.lists(st.integers(0, 2**30), max_size=50))
def test_plain_indices_come_back(indices: list[int]) -> None:
    out = np.zeros(len(indices), np.uint32)
    assert decode_indices(np.frombuffer(encoded_indices(indices), np.uint8), out)
    assert out.tolist() == indices


@pytest.mark.parametrize("data", [VERTICES, GRID, FAR], ids=["vertices", "grid", "far"])
def test_cut_and_changed_streams_are_refused_or_read_within_bounds(data: bytes) -> None:
    decode, kind = (decode_vertices, np.uint8) if data is VERTICES else (decode_triangles, np.uint32)
    shape: tuple[int, ...] = (20, 8) if data is VERTICES else (len(GRID_FACES if data is GRID else FAR_FACES),)
    for end in range(len(data) // 2):
        assert not decode(np.frombuffer(data[:end], np.uint8).copy(), np.zeros(shape, kind))
    rng = np.random.default_rng(0)
    for _ in range(300):
        changed = np.frombuffer(data, np.uint8).copy()
        changed[rng.integers(0, len(data), 3)] = rng.integers(0, 256, 3)
        decode(changed, np.zeros(shape, kind))


def test_octahedral_filter() -> None:
    """Unit vectors of twelve bits, to a thousandth."""
    rng = np.random.default_rng(1)
    normals = rng.normal(size=(200, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    one = 2047
    flat = normals / np.abs(normals).sum(axis=1, keepdims=True)
    fold = (1 - np.abs(flat[:, [1, 0]])) * np.where(flat[:, :2] >= 0, 1, -1)
    codes = np.where(flat[:, 2:] >= 0, flat[:, :2], fold) * one
    packed = np.concatenate([np.rint(codes), np.full((200, 1), one), np.zeros((200, 1))], axis=1).astype("<i2")
    out = filtered(packed.view(np.uint8), "OCTAHEDRAL").view("<i2")[:, :3] / 32767
    assert np.abs(out - normals).max() < 1e-3


def test_quaternion_filter() -> None:
    rng = np.random.default_rng(2)
    turns = rng.normal(size=(200, 4))
    turns /= np.linalg.norm(turns, axis=1, keepdims=True)
    biggest = np.abs(turns).argmax(axis=1)
    turns *= np.sign(turns[np.arange(200), biggest])[:, None]
    scale = 2047
    codes = np.stack([turns[np.arange(200), (biggest + 1 + k) % 4] for k in range(3)], axis=1) * np.sqrt(2) * scale
    packed = np.concatenate([np.rint(codes), ((scale & ~3) | biggest)[:, None]], axis=1).astype("<i2")
    out = filtered(packed.view(np.uint8), "QUATERNION").view("<i2") / 32767
    assert np.abs(out - turns).max() < 1e-3


def test_exponential_filter() -> None:
    packed = np.array([[(3 & 255) << 24 | 5], [(-2 & 255) << 24 | (-7 & 0xFFFFFF)], [0]], "<u4")
    assert filtered(packed.view(np.uint8), "EXPONENTIAL").view("<f4").reshape(-1).tolist() == [40.0, -1.75, 0.0]


@pytest.mark.parametrize(
    ("entry", "count", "stride", "message"),
    [
        ({"mode": "OTHER"}, 20, 8, "unknown mode 'OTHER'"),
        ({"mode": "ATTRIBUTES", "filter": "X"}, 20, 8, "unknown filter 'X'"),
        ({"mode": "ATTRIBUTES"}, 20, 7, "byteStride must be a multiple of 4"),
        ({"mode": "ATTRIBUTES"}, 2**40, 8, "declares 1099511627776 elements in"),
        ({"mode": "INDICES"}, 2**40, 4, "declares 1099511627776 indices in"),
        ({"mode": "TRIANGLES"}, 12, 4, "damaged stream of indices"),
    ],
)
def test_wrong_entries(entry: dict[str, str], count: int, stride: int, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        decode_view(VERTICES, entry, count, stride)
