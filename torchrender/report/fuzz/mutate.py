"""Ways to damage a file."""

from __future__ import annotations

import re
import struct

import numpy as np

NUMBERS = (b"0", b"-1", b"1e400", b"NaN", b"4294967295", b"9007199254740993", b"1e-320", b"null", b'"x"', b"[]", b"{}")
_NUMBER = re.compile(rb"-?\d+(?:\.\d+)?(?:[eE][-+]?\d+)?")


def mutated(data: bytes, seed: int) -> bytes:
    """The file with one to four damages; the same for the same seed."""
    rng = np.random.default_rng(seed)
    if data[:4] == b"glTF" and rng.random() < 0.8:
        return _parts(data, rng)
    return _damaged(data, rng)


def _parts(data: bytes, rng: np.random.Generator) -> bytes:
    """A GLB file one of whose chunks is damaged, with lengths that fit: what lies behind the container's own checks."""
    size = struct.unpack_from("<I", data, 12)[0]
    text, binary = data[20 : 20 + size], data[28 + size :]
    if rng.random() < 0.6:
        text = _number(text, rng) if rng.random() < 0.7 else _damaged(text, rng)
    else:
        binary = _damaged(binary, rng)
    text, binary = text + b" " * (-len(text) % 4), binary + b"\0" * (-len(binary) % 4)
    chunks = struct.pack("<II", len(text), 0x4E4F534A) + text + struct.pack("<II", len(binary), 0x004E4942) + binary
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks


def _damaged(data: bytes, rng: np.random.Generator) -> bytes:
    for _ in range(1 if rng.random() < 0.5 else int(rng.integers(2, 5))):
        data = _WAYS[int(rng.integers(len(_WAYS)))](data, rng)
        if not data:
            return b"\0"
    return data


def _flip(data: bytes, rng: np.random.Generator) -> bytes:
    out = bytearray(data)
    for place in rng.integers(0, len(out), int(rng.integers(1, 5))):
        out[place] = int(rng.integers(256))
    return bytes(out)


def _bit(data: bytes, rng: np.random.Generator) -> bytes:
    out = bytearray(data)
    out[int(rng.integers(len(out)))] ^= 1 << int(rng.integers(8))
    return bytes(out)


def _cut(data: bytes, rng: np.random.Generator) -> bytes:
    return data[: int(rng.integers(1, len(data) + 1))]


def _drop(data: bytes, rng: np.random.Generator) -> bytes:
    start = int(rng.integers(len(data)))
    return data[:start] + data[start + int(rng.integers(1, 20)) :]


def _double(data: bytes, rng: np.random.Generator) -> bytes:
    start = int(rng.integers(len(data)))
    piece = data[start : start + int(rng.integers(1, 40))]
    return data[:start] + piece * int(rng.integers(2, 4)) + data[start:]


def _word(data: bytes, rng: np.random.Generator) -> bytes:
    """A whole number of four bytes is something extreme."""
    start = int(rng.integers(max(len(data) - 4, 1)))
    value = int(rng.choice([0, 1, 0x7FFFFFFF, 0x80000000, 0xFFFFFFFF, 0x7F800000, 0x7FC00000]))
    return data[:start] + value.to_bytes(4, "little") + data[start + 4 :]


def _number(data: bytes, rng: np.random.Generator) -> bytes:
    """A number in text is another, or none."""
    found = list(_NUMBER.finditer(data))
    if not found:
        return _flip(data, rng)
    hit = found[int(rng.integers(len(found)))]
    return data[: hit.start()] + NUMBERS[int(rng.integers(len(NUMBERS)))] + data[hit.end() :]


_WAYS = (_flip, _bit, _cut, _drop, _double, _word, _number, _number)
