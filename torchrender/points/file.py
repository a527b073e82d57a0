"""Compressed point models in files that are read piece by piece, so that they need not fit into memory.

Layout, little endian: a preamble (magic, version, flags, patches, levels, nodes, checksums of header and preamble), the
headers of all patches with a CRC-32 of every level of each, then at multiples of 4096 bytes the codes of all nodes and
their colours. A level is checked when it is read for the first time.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
import torch

from torchrender.checks import check_class
from torchrender.errors import PointFileError
from torchrender.images.files import write_atomically
from torchrender.points.codec import NORMALS, PALETTE, NodeAccess, PackedNodes, compress
from torchrender.points.tree import PatchHeaders, PatchSet, level_starts

SUFFIX = ".trp"
VERSION = 1
_MAGIC = b"TRPOINTS"
_PREAMBLE = struct.Struct("<8sIIQQQI")
_PAGE = 4096
Array = np.ndarray[Any, Any]

_COLOR, _TWO_SIDED, _OCTAHEDRON = 1, 2, 4


def write_points(path: str | Path, patches: PatchSet, *, normals: str = "angles") -> int:
    """Compress a point model into a ``.trp`` file, whole or not at all; returns its size in bytes.

    Raises:
        PointFileError: another suffix.
        ImageFileError: the folder does not exist, or the file cannot be written.
    """
    check_class("path", path, str, Path)
    path = Path(path)
    if path.suffix.lower() != SUFFIX:
        raise PointFileError(path, f"compressed points are written to {SUFFIX}")
    packed = compress(patches, normals=normals)
    nodes = packed.nodes
    assert isinstance(nodes, PackedNodes)
    parts = [(nodes.access.codes, nodes.access.colors)]
    return write_nodes(
        path,
        packed.headers,
        nodes.palette,
        parts,
        has_color=nodes.has_color,
        two_sided=packed.two_sided,
        normals=normals,
    )


def write_nodes(
    path: Path,
    headers: PatchHeaders,
    palette: torch.Tensor,
    parts: Iterable[tuple[Array, Array | None]],
    *,
    has_color: bool,
    two_sided: bool,
    normals: str,
) -> int:
    """Write codes (T,8) and colours (T,3) that come in parts of whole patches; returns the size of the file.

    Raises:
        ImageFileError: the folder does not exist, or the file cannot be written.
    """
    flags = _COLOR * has_color + _TWO_SIDED * two_sided + _OCTAHEDRON * (normals == "octahedron")
    arrays: dict[str, Array] = {n: getattr(headers, n).numpy() for n in ("box", "cone", "sigma", "radius", "count")}
    sums = np.zeros((len(headers), headers.levels), np.uint32)
    arrays |= {"palette": palette.numpy(), "sums": sums}
    total = int(headers.start[-1, -1])
    fields = _fields(len(headers), headers.levels)
    size = _PREAMBLE.size + 4 + sum(np.dtype(dtype).itemsize * int(np.prod(shape)) for dtype, shape in fields.values())
    codes_at = _aligned(size)
    colors_at = _aligned(codes_at + 8 * total)

    def write(temporary: Path) -> None:
        with temporary.open("wb") as file:
            node = 0
            for codes, colors in parts:
                file.seek(codes_at + 8 * node)
                file.write(np.ascontiguousarray(codes).data)
                if colors is not None:
                    file.seek(colors_at + 3 * node)
                    file.write(np.ascontiguousarray(colors).data)
                _sum_up(sums, headers, NodeAccess(codes, colors), node)
                node += len(codes)
            body = b"".join(np.ascontiguousarray(arrays[n], dtype).tobytes() for n, (dtype, _) in fields.items())
            head = _PREAMBLE.pack(_MAGIC, VERSION, flags, len(headers), headers.levels, total, zlib.crc32(body))
            file.seek(0)
            file.write(head + struct.pack("<I", zlib.crc32(head)) + body)

    write_atomically(path, write)
    return path.stat().st_size


def _sum_up(sums: Array, headers: PatchHeaders, access: NodeAccess, first: int) -> None:
    """Checksums of the patches whose nodes, from number ``first`` on, are given."""
    start = headers.start.numpy()
    rows = np.flatnonzero((start[:, 0] >= first) & (start[:, 0] < first + len(access.codes)))
    for patch in rows.tolist():
        for level in range(headers.levels):
            low, high = (start[patch, level : level + 2] - first).tolist()
            sums[patch, level] = _checksum_of(access, low, high)


def open_points(path: str | Path) -> PatchSet:
    """A point model from a ``.trp`` file. Only the headers are read now; nodes are, when they are drawn.

    Raises:
        PointFileError: missing, no such file of points, another version, damaged, or cut off. Damage to nodes shows
            when they are first drawn.
    """
    check_class("path", path, str, Path)
    path = Path(path)
    try:
        size = path.stat().st_size
        with path.open("rb") as file:
            head = file.read(_PREAMBLE.size + 4)
            flags, count, levels, nodes, crc = _preamble(path, head)
            fields = _fields(count, levels)
            body_bytes = sum(np.dtype(dtype).itemsize * int(np.prod(shape)) for dtype, shape in fields.values())
            codes_at = _aligned(len(head) + body_bytes)
            colors_at = _aligned(codes_at + 8 * nodes) if flags & _COLOR else codes_at + 8 * nodes
            whole = colors_at + (3 * nodes if flags & _COLOR else 0)
            # Before memory is taken for what the preamble promises.
            if size != whole:
                raise PointFileError(path, f"cut off or damaged: should have {whole} bytes, has {size}")
            body = file.read(body_bytes)
    except FileNotFoundError as error:
        raise PointFileError(path, "no such file") from error
    except OSError as error:
        raise PointFileError(path, error.strerror or str(error)) from error
    if zlib.crc32(body) != crc:
        raise PointFileError(path, "damaged: the checksum of the headers is wrong")
    arrays, at = {}, 0
    for name, (dtype, shape) in fields.items():
        value = np.frombuffer(body, dtype, int(np.prod(shape)), at).reshape(shape)
        arrays[name] = np.array(value, dtype=value.dtype.newbyteorder("="))
        at += value.nbytes
    palette, sums = torch.from_numpy(arrays.pop("palette")), arrays.pop("sums")
    headers = _headers(path, arrays, nodes)
    codes = np.memmap(path, np.uint8, "r", codes_at, (nodes, 8))
    colors = np.memmap(path, np.uint8, "r", colors_at, (nodes, 3)) if flags & _COLOR else None
    access = MappedAccess(path, codes, colors, headers, sums)
    packed = PackedNodes(access, palette, NORMALS[bool(flags & _OCTAHEDRON)])
    return PatchSet(headers, packed, bool(flags & _TWO_SIDED), path.stem)


class MappedAccess(NodeAccess):
    """Nodes in a file; a level of a patch is checked when it is read for the first time."""

    def __init__(
        self,
        path: Path,
        codes: np.ndarray[Any, Any],
        colors: np.ndarray[Any, Any] | None,
        headers: PatchHeaders,
        sums: np.ndarray[Any, Any],
    ) -> None:
        super().__init__(np.asarray(codes), None if colors is None else np.asarray(colors))
        self._path, self._headers, self._sums = path, headers, sums
        self._checked = np.zeros(sums.shape, bool)

    @property
    def nodes_read(self) -> int:
        """Nodes read from the file so far, each counted once."""
        start = self._headers.start.numpy()
        return int((start[:, 1:] - start[:, :-1])[self._checked].sum())

    def touch(self, chosen: np.ndarray[Any, Any], level: np.ndarray[Any, Any]) -> None:
        """Check what was not read before.

        Raises:
            PointFileError: a checksum is wrong.
        """
        fresh = ~self._checked[chosen, level]
        for patch, depth in zip(chosen[fresh].tolist(), level[fresh].tolist(), strict=True):
            if _checksum(self, self._headers, patch, depth) != self._sums[patch, depth]:
                raise PointFileError(self._path, f"damaged: the checksum of patch {patch}, level {depth}, is wrong")
            self._checked[patch, depth] = True


def _checksum(access: NodeAccess, headers: PatchHeaders, patch: int, level: int) -> int:
    return _checksum_of(access, int(headers.start[patch, level]), int(headers.start[patch, level + 1]))


def _checksum_of(access: NodeAccess, low: int, high: int) -> int:
    found = zlib.crc32(np.ascontiguousarray(access.codes[low:high]).data)
    if access.colors is not None:
        found = zlib.crc32(np.ascontiguousarray(access.colors[low:high]).data, found)
    return found


def _preamble(path: Path, head: bytes) -> tuple[int, int, int, int, int]:
    """Flags, patches, levels, nodes and the checksum of the headers."""
    if len(head) < _PREAMBLE.size + 4 or not head.startswith(_MAGIC):
        raise PointFileError(path, "is no file of compressed points, or cut off")
    _, version, flags, count, levels, nodes, crc = _PREAMBLE.unpack(head[: _PREAMBLE.size])
    if version != VERSION:
        raise PointFileError(path, f"has version {version}, only version {VERSION} can be read")
    if struct.unpack("<I", head[_PREAMBLE.size :])[0] != zlib.crc32(head[: _PREAMBLE.size]):
        raise PointFileError(path, "damaged: the checksum of the preamble is wrong")
    if not (1 <= count <= nodes and 1 <= levels <= 64):
        raise PointFileError(path, f"damaged: {count} patches of {levels} levels with {nodes} nodes")
    return flags, count, levels, nodes, crc


def _fields(count: int, levels: int) -> dict[str, tuple[str, tuple[int, ...]]]:
    """Arrays of the headers in their order in the file: type and shape."""
    return {
        "box": ("<f8", (count, 2, 3)),
        "cone": ("<f8", (count, 4)),
        "sigma": ("<f8", (count,)),
        "radius": ("<f4", (count, levels, 3)),
        "count": ("<i8", (count,)),
        "palette": ("<f4", (PALETTE,)),
        "sums": ("<u4", (count, levels)),
    }


def _headers(path: Path, arrays: dict[str, np.ndarray[Any, Any]], nodes: int) -> PatchHeaders:
    """The headers, after what a right checksum does not say: that no index leaves the file."""
    count, radius = arrays["count"], arrays["radius"]
    if not ((count >= 1) & (count <= nodes)).all():
        raise PointFileError(path, "damaged: patches without points, or with too many")
    start = level_starts(count)
    if start[-1, -1] != nodes or start.shape[1] != radius.shape[1] + 1:
        raise PointFileError(path, "damaged: the levels do not add up")
    if not all(np.isfinite(arrays[name]).all() for name in ("box", "cone", "sigma", "radius")):
        raise PointFileError(path, "damaged: headers that are not finite")
    tensors = {name: torch.from_numpy(value) for name, value in (arrays | {"start": start}).items()}
    return PatchHeaders(**{**tensors, "radius": tensors["radius"].double()})


def _aligned(place: int) -> int:
    return place + (-place % _PAGE)
