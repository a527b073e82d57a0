"""Point models that do not fit into memory: cut into blocks on disk, each made into patches, all in one file.

A file is read twice. The first time gives a sample, out of which a tree of median splits is made whose leaves hold a
bounded number of points; the second time deals the points out to the leaves, on disk. Each leaf then becomes patches as
a whole model would, and is compressed; at last all are put together under one palette of radii. As a point model is a
list of patches, the only differences from a model that was made at once are where patches end, and normals and radii
that were estimated at the rim of a block from neighbours on its own side alone.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import torch

from torchrender.checks import check_choice, check_class, check_range, checked_fields, options_of
from torchrender.errors import PointFileError
from torchrender.points.cloud import PointCloud
from torchrender.points.codec import NORMALS, PackedNodes, compress, fit_palette
from torchrender.points.file import SUFFIX, write_nodes
from torchrender.points.pieces import RECORD, PointPieces, Survey
from torchrender.points.tree import PatchHeaders, PatchOptions, build_patches, level_starts
from torchrender.scene.files.report import UNKNOWN_NORMALS, Notes

Array = np.ndarray[Any, Any]

POINT_BYTES = 1200
"""Memory that a point takes while its block is made into patches, estimates of normals included (measured: 700)."""
BASE_BYTES = 100_000_000
"""Beside the points of a block: a piece of the file, a sample of it, and the headers."""
SAMPLE = 1 << 19
_RADII = 1 << 21  # radii that the palette is fitted to, about

Progress = Callable[[str, float], None]
"""Called with a step and the share of it that is done."""


@dataclass(frozen=True, kw_only=True)
@checked_fields
class PackOptions:
    """How a large model is packed.

    Raises:
        OptionError: a value outside its range; names it.
    """

    memory_mb: float = 1024.0  # beside what the process needs anyway; 128 to 1e6
    normals: str = "angles"  # how normals are stored: see :func:`torchrender.points.codec.compress`
    patches: PatchOptions = field(default_factory=PatchOptions)
    drop_invalid: bool = False  # leave points that are NaN or infinite out, in place of an error

    def __post_init__(self) -> None:
        check_range("memory_mb", self.memory_mb, 128.0, 1e6)
        check_choice("normals", self.normals, NORMALS)

    @property
    def block_points(self) -> int:
        """Points that a block holds at most."""
        return max(int((self.memory_mb * 1e6 - BASE_BYTES) / POINT_BYTES), 10_000)


def pack_points(
    source: str | Path, target: str | Path, options: PackOptions | None = None, *, progress: Progress | None = None
) -> int:
    """Make a ``.trp`` file of the points of a PLY file of any size; returns its size in bytes.

    Needs ``memory_mb`` of memory, and beside the target's folder about as much room on disk for a while as source and
    target take together. Points are opaque discs; missing normals and radii are estimated.

    Args:
        source: a PLY file, text or binary, of points without faces.
        progress: called with the step and the share of it that is done.

    Raises:
        SceneFileError: the source is missing, damaged, or has positions that are not finite.
        PointFileError: the source holds surfaces, 3D Gaussians or points that are not opaque; another target suffix.
        ImageFileError: the target's folder does not exist, or the file cannot be written.
    """
    check_class("source", source, str, Path)
    check_class("target", target, str, Path)
    options, target = options_of(options, PackOptions), Path(target)
    say = progress or _silent
    if target.suffix.lower() != SUFFIX:
        raise PointFileError(target, f"compressed points are written to {SUFFIX}")
    pieces = PointPieces(Path(source))
    survey = pieces.survey(SAMPLE)
    say("reading", 0.5)
    if survey.invalid and not options.drop_invalid:
        total = survey.count + survey.invalid
        raise PointFileError(pieces.path, f"{survey.invalid} of {total} points are NaN or infinite")
    if not survey.count:
        raise PointFileError(pieces.path, "holds no points that are finite")
    notes = Notes(pieces.path)
    pieces.say_unused(notes)
    notes.repaired("points that are NaN or infinite: dropped", survey.invalid)
    notes.repaired(UNKNOWN_NORMALS, survey.unknown)
    notes.close()
    splits = Splits(survey.sample, survey.count, options.block_points)
    folder = target.parent if target.parent.is_dir() else None
    with tempfile.TemporaryDirectory(prefix=f".{target.stem}-", dir=folder, ignore_cleanup_errors=True) as place:
        blocks = _deal(pieces, survey, splits, Path(place), say)
        built = []
        for number, block in enumerate(blocks):
            built.append(_build(block, pieces, options))
            block.unlink()
            say("building", (number + 1) / len(blocks))
        return _join(target, pieces, built, options, say)


def _silent(step: str, share: float) -> None:
    """Nobody asked."""
    del step, share


class Splits:
    """A tree of median splits across the longest side of what is in it."""

    def __init__(self, sample: Array, count: int, most: int) -> None:
        self.leaves = 0
        # A sample is not exact: half as many again still keep the bound.
        share = max(most * len(sample) / (1.5 * count), 1.0)
        self._root = self._split(sample, share)

    def _split(self, sample: Array, share: float) -> Any:
        if len(sample) > share:
            axis = int((sample.max(0) - sample.min(0)).argmax())
            value = float(np.median(sample[:, axis]))
            below = sample[:, axis] < value
            if below.any() and not below.all():
                return axis, value, self._split(sample[below], share), self._split(sample[~below], share)
        self.leaves += 1
        return self.leaves - 1

    def parts(self, position: Array) -> Iterator[tuple[int, Array]]:
        """Leaf and rows of those of positions (N,3) that are in it."""
        waiting: list[tuple[Any, Array]] = [(self._root, np.arange(len(position)))]
        while waiting:
            node, rows = waiting.pop()
            if isinstance(node, int):
                if len(rows):
                    yield node, rows
                continue
            axis, value, low, high = node
            below = position[rows, axis] < value
            waiting += [(low, rows[below]), (high, rows[~below])]


def _deal(pieces: PointPieces, survey: Survey, splits: Splits, folder: Path, say: Progress) -> list[Path]:
    """The points of each leaf in a file of its own."""
    files = [folder / f"{leaf}.points" for leaf in range(splits.leaves)]
    done = 0
    for records in pieces.records(survey):
        for leaf, rows in splits.parts(records["position"]):
            with files[leaf].open("ab") as file:
                file.write(records[rows].data)
        done += len(records)
        say("reading", 0.5 + 0.5 * done / survey.count)
    return [file for file in files if file.exists()]


@dataclass(frozen=True, eq=False)
class _Block:
    """A block that is made into patches: its codes are on disk, with a palette of its own."""

    headers: PatchHeaders
    codes: Path
    colors: Path | None
    palette: torch.Tensor
    radii: torch.Tensor  # of some nodes, the least and the greatest among them
    nodes: int
    two_sided: bool


def _build(file: Path, pieces: PointPieces, options: PackOptions) -> _Block:
    records = np.fromfile(file, RECORD)
    cloud = PointCloud(
        position=torch.from_numpy(records["position"].copy()),
        normal=torch.from_numpy(records["normal"].copy()) if pieces.has_normals else None,
        radius=torch.from_numpy(records["radius"].copy()),
        color=torch.from_numpy(records["color"].copy()) if pieces.has_color else None,
    )
    del records
    patches = build_patches(cloud, options.patches)
    radius = patches.nodes.radius  # type: ignore[attr-defined]
    radii = torch.cat([radius[:: max(1, len(radius) // 4096)], radius.amin()[None], radius.amax()[None]])
    packed = compress(patches, normals=options.normals)
    assert isinstance(packed.nodes, PackedNodes)
    access = packed.nodes.access
    codes = file.with_suffix(".codes")
    access.codes.tofile(codes)
    colors = file.with_suffix(".colors") if access.colors is not None else None
    if access.colors is not None and colors is not None:
        access.colors.tofile(colors)
    return _Block(packed.headers, codes, colors, packed.nodes.palette, radii, len(packed.nodes), packed.two_sided)


def _join(target: Path, pieces: PointPieces, blocks: list[_Block], options: PackOptions, say: Progress) -> int:
    palette = blocks[0].palette
    if len(blocks) > 1:
        palette = fit_palette(torch.cat([b.radii for b in blocks]))

    def parts() -> Iterator[tuple[Array, Array | None]]:
        for number, block in enumerate(blocks):
            codes = np.fromfile(block.codes, np.uint8).reshape(-1, 8)
            if len(blocks) > 1:
                codes[:, 7] = _nearest(palette, block.palette)[codes[:, 7]]
            yield codes, None if block.colors is None else np.fromfile(block.colors, np.uint8).reshape(-1, 3)
            say("writing", (number + 1) / len(blocks))

    # Each block that had to guess the side of its normals did so alone.
    two_sided = any(b.two_sided for b in blocks) or (len(blocks) > 1 and not pieces.has_normals)
    headers = _joined([b.headers for b in blocks])
    return write_nodes(
        target, headers, palette, parts(), has_color=pieces.has_color, two_sided=two_sided, normals=options.normals
    )


def _nearest(palette: torch.Tensor, values: torch.Tensor) -> Array:
    """(256,) uint8 the entry of a palette that is nearest to each of another."""
    rows = torch.bucketize(values.double(), 0.5 * (palette[1:] + palette[:-1]).double())
    return rows.to(torch.uint8).numpy()


def _joined(parts: list[PatchHeaders]) -> PatchHeaders:
    """The headers of all parts; those of less levels repeat their deepest one."""
    levels = max(p.levels for p in parts)
    radius = [torch.cat([p.radius, p.radius[:, -1:].expand(-1, levels - p.levels, -1)], dim=1) for p in parts]
    count = torch.cat([p.count for p in parts])
    return PatchHeaders(
        box=torch.cat([p.box for p in parts]),
        cone=torch.cat([p.cone for p in parts]),
        sigma=torch.cat([p.sigma for p in parts]),
        start=torch.from_numpy(level_starts(count.numpy())),
        radius=torch.cat(radius),
        count=count,
    )
