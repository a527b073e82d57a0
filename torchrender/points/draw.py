"""Large point models drawn by elliptical weighted averaging (EWA), with the cheapest filter that is good enough.

Source: specification 06, sections 4 to 7. Meshes of discs from depth images: :mod:`torchrender.reconstruct.discs`.
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass
from weakref import WeakKeyDictionary

import numpy as np
import torch
from torch import Tensor

from torchrender.arrays import in_single_precision
from torchrender.checks import check_class, options_of
from torchrender.errors import CameraError
from torchrender.kernels.compile import thread_count
from torchrender.kernels.points import ewa
from torchrender.kernels.points.ewa_draw import (
    STEPS,
    TILE,
    Binned,
    Picture,
    Weights,
    draw_tiles,
    scan_tiles,
    sort_points,
)
from torchrender.kernels.points.records import Coloring, Filters, Lens, Projected, Slices
from torchrender.numerics.ewa import kernel_polynomial, low_pass_stamps
from torchrender.points.cloud import PointCloud
from torchrender.points.gaussians import is_blended, render_gaussians
from torchrender.points.options import PointImage, SplatOptions, SplatStatistics
from torchrender.points.select import Selection, select_patches
from torchrender.points.tree import NodeBatch, PatchSet, build_patches, node_arrays
from torchrender.scene.camera import Cameras

CHUNKS = 64
"""Pieces that the points of a picture are projected and sorted in, whatever the number of threads."""

MIXED = 4.0
"""Greatest over least radius of a patch from which on its points are filtered each in its own way."""

_MODES = {"full": ewa.FULL, "reconstruction": ewa.RECONSTRUCTION, "low_pass": ewa.LOW_PASS, "squares": ewa.SQUARE}
_PLAIN = 0.8  # grey of points without colours


@in_single_precision
def render_points(points: PatchSet | PointCloud, cameras: Cameras, options: SplatOptions | None = None) -> PointImage:
    """Draw a point model from B perspective cameras.

    Only patches in view that do not show their back are read, each at the coarsest level that is fine enough. A first
    pass finds the nearest surface of each pixel, a second one blends what lies within a tolerance behind it:
    ``image = sum w c / sum w``. The same points and camera give the same picture bit by bit, whatever the batch and the
    number of threads.

    Args:
        points: a patch set, or a cloud, cut into one first in about a microsecond a point; those of 3D Gaussians or
            with opacity are drawn by :func:`~torchrender.points.gaussians.render_gaussians`.

    Raises:
        CameraError: orthographic cameras. PointFileError: a compressed file is damaged where it is read.
    """
    check_class("cameras", cameras, Cameras)
    options = options_of(options, SplatOptions)
    if cameras.orthographic:
        raise CameraError("points are drawn by perspective cameras only")
    if isinstance(points, PointCloud) and is_blended(points):
        return render_gaussians(points, cameras, options)
    patches = points if isinstance(points, PatchSet) else build_patches(points)
    shape = (len(cameras), cameras.height, cameras.width)
    image, depth, weight = torch.zeros(*shape, 3), torch.zeros(shape), torch.zeros(shape)
    parts = zip(image, depth, weight, strict=True)
    statistics = tuple(_draw(patches, cameras[k], options, one) for k, one in enumerate(parts))
    return PointImage(image, depth, weight, statistics)


@dataclass(frozen=True, eq=False)
class _Work:
    """What one camera draws: nodes and how each run of them is filtered."""

    selection: Selection
    nodes: NodeBatch
    slices: np.ndarray  # (S,2) int64 rows of the nodes
    modes: np.ndarray  # (S,) int64
    chunks: np.ndarray  # (N,2) int64 runs of slices
    first: np.ndarray  # (S + 1,) int64 first record of each slice


class _Scratch:
    """Arrays that grow and are used again: fresh pages cost a quarter of a picture's time."""

    def __init__(self) -> None:
        self._arrays: dict[str, np.ndarray] = {}

    def take(self, name: str, count: int, width: int, dtype: type) -> np.ndarray:
        """(count,width) of whatever was there before."""
        held = self._arrays.get(name)
        if held is None or len(held) < count:
            held = self._arrays[name] = np.empty((count, width), dtype)
        return held[:count]


_SCRATCH: WeakKeyDictionary[PatchSet, _Scratch] = WeakKeyDictionary()
"""Of each model; whoever draws takes it out, so that no two threads write to one."""


def _draw(
    patches: PatchSet, camera: Cameras, options: SplatOptions, out: tuple[Tensor, Tensor, Tensor]
) -> SplatStatistics:
    two_sided = patches.two_sided if options.two_sided is None else options.two_sided
    ticks = [time.perf_counter()]

    def tick() -> None:
        ticks.append(time.perf_counter())

    margin = options.low_pass_radius
    selection = select_patches(patches.headers, camera, options.selection, two_sided=two_sided, margin=margin)
    tick()
    nodes, rows = patches.nodes.gather(patches, selection.chosen, selection.level)
    work = _work(patches, camera, options, selection, nodes, rows)
    scratch = _SCRATCH.pop(patches, None) or _Scratch()
    tick()
    lit = options.shading == "point"
    projected = _project(patches, camera, options, work, scratch, two_sided=two_sided, lit=lit)
    tick()
    start, entries = _sort(projected, work, camera, scratch)
    tick()
    evaluations = _tiles(projected, start, entries, options, options.background, out)
    if options.shading == "pixel":
        normal = torch.zeros_like(out[0])
        # The same boxes and tiles: only the colours of the records change.
        again = _project(patches, camera, options, work, scratch, two_sided=two_sided, lit=False, normals=True)
        _tiles(again, start, entries, options, (0.0, 0.0, 0.0), (normal, out[1], out[2]))
        _shade_pixels(camera, options, normal, out)
    tick()
    _SCRATCH[patches] = scratch
    names = ("select", "read", "project", "sort", "draw")
    ms = {name: 1e3 * (b - a) for name, a, b in zip(names, ticks, ticks[1:])}
    return _statistics(patches, work, projected.counts.sum(axis=0).tolist(), int(evaluations.sum()), ms)


def _work(
    patches: PatchSet, camera: Cameras, options: SplatOptions, selection: Selection, nodes: NodeBatch, rows: Tensor
) -> _Work:
    slices = rows.numpy().astype(np.int64)
    first = np.concatenate([[0], (slices[:, 1] - slices[:, 0]).cumsum()])
    # Chunk borders lie where the running count of points passes equal shares.
    borders = np.searchsorted(first, np.linspace(0, first[-1], CHUNKS + 1)[1:-1])
    borders = np.unique(np.concatenate([[0], borders, [len(slices)]]))
    chunks = np.stack([borders[:-1], borders[1:]], axis=1)
    modes = patch_modes(patches, camera, options, selection).numpy()
    return _Work(selection, nodes, np.ascontiguousarray(slices), modes, np.ascontiguousarray(chunks), first)


def patch_modes(patches: PatchSet, camera: Cameras, options: SplatOptions, selection: Selection) -> Tensor:
    """(S,) int64 filter of each selected patch, from its mean radius and its distance."""
    count = len(selection.chosen)
    if options.filter != "adaptive":
        return torch.full((count,), _MODES[options.filter])
    if options.choice == "point":
        each = torch.full((count,), ewa.EACH_POINT)
        return torch.where(selection.silhouette, ewa.FULL, each)
    headers, chosen = patches.headers, selection.chosen
    centre = camera.transform(headers.centre[chosen])[0]
    z = centre[:, 2].clamp_min(float(camera.near[0]))
    axis = headers.cone[chosen, :3] @ camera.rotation[0].T
    cosine = ((axis * centre).sum(1) / centre.norm(dim=1).clamp_min(1e-300)).abs()
    radius = headers.radius[chosen, selection.level, 1]
    scale = float(camera.intrinsics[0, 0, 0] * camera.intrinsics[0, 1, 1])
    area = radius**2 * scale * cosine / z**2 / options.low_pass_radius**2
    if options.test == "eigen":
        # The axes of a disc at the middle of the view: r f / z, and that times the cosine.
        wide = area / cosine.clamp_min(1e-300)
        reconstruct, smooth = area * cosine > options.reconstruction_above, wide < options.low_pass_below
    else:
        reconstruct, smooth = area > options.reconstruction_above, widest(camera) * area < options.low_pass_below
    modes = torch.full((count,), ewa.FULL)
    modes[reconstruct] = ewa.RECONSTRUCTION
    modes[smooth] = ewa.LOW_PASS
    # One answer for all would be wrong for a patch of very different radii.
    least, _, most = headers.radius[chosen, selection.level].unbind(1)
    modes[most > MIXED * least] = ewa.EACH_POINT
    modes[selection.silhouette] = ewa.FULL
    return modes


def widest(camera: Cameras) -> float:
    """C_eta = sqrt(1 + tan_x^2 + tan_y^2) with the greatest |x/z| and |y/z| in view."""
    k = camera.intrinsics[0]
    corners = torch.tensor([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]], dtype=torch.float64)
    corners = corners * torch.tensor([camera.width, camera.height], dtype=torch.float64)
    y = (corners[:, 1] - k[1, 2]) / k[1, 1]
    x = (corners[:, 0] - k[0, 2] - k[0, 1] * y) / k[0, 0]
    return math.sqrt(1.0 + float(x.abs().max()) ** 2 + float(y.abs().max()) ** 2)


def _project(
    patches: PatchSet,
    camera: Cameras,
    options: SplatOptions,
    work: _Work,
    scratch: _Scratch,
    *,
    two_sided: bool,
    lit: bool,
    normals: bool = False,
) -> Projected:
    across, down = -(-camera.width // TILE), -(-camera.height // TILE)
    total = int(work.first[-1])
    made = Projected(
        records=scratch.take("records", total, ewa.RECORD, np.float32),
        boxes=scratch.take("boxes", total, ewa.BOX, np.int16),
        tiles=np.zeros((len(work.chunks), across * down), np.int64),
        counts=np.zeros((len(work.chunks), ewa.COUNTS), np.int64),
    )
    origin = camera.transform(patches.headers.centre[work.selection.chosen])[0]
    light = torch.zeros(3, dtype=torch.float64)
    if options.light is not None:
        light = camera.rotation[0] @ torch.nn.functional.normalize(torch.tensor(options.light).double(), dim=0)
    nodes = work.nodes
    usual = float(patches.headers.radius[:, -1, 1].mean())
    peak = 1.0 / (2 * math.pi * options.gaussian_width**2)
    ewa.project_points(
        node_arrays(nodes.position, nodes.normal, nodes.radius, nodes.color),
        Slices(work.slices, work.modes, work.first, origin.contiguous().numpy(), work.chunks),
        Lens(
            turn=camera.rotation[0].contiguous().numpy(),
            k=camera.intrinsics[0].contiguous().numpy(),
            near=float(camera.near[0]),
            far=float(camera.far[0]),
            width=camera.width,
            height=camera.height,
        ),
        Filters(
            r_h=float(options.low_pass_radius),
            peak=peak,
            eps_scale=float(options.depth_tolerance),
            unit=usual * usual,
            one_sided=not two_sided,
            c_min=float(options.low_pass_below),
            c_max=float(options.reconstruction_above),
            c_eta=widest(camera),
            by_axes=options.test == "eigen",
        ),
        Coloring(float(light[0]), float(light[1]), float(light[2]), float(options.ambient), lit, _PLAIN, normals),
        TILE,
        thread_count(),
        made,
    )
    return made


def _sort(made: Projected, work: _Work, camera: Cameras, scratch: _Scratch) -> tuple[np.ndarray, np.ndarray]:
    """First entry of each tile (T+1,) and the points of all tiles."""
    start = np.zeros(made.tiles.shape[1] + 1, np.int64)
    scan_tiles(made.tiles, start)
    entries = scratch.take("entries", max(int(start[-1]), 1), 1, np.int32).reshape(-1)
    runs = np.ascontiguousarray(work.first[work.chunks])
    sort_points(made.boxes, runs, made.tiles, -(-camera.width // TILE), thread_count(), entries)
    return start, entries


def _tiles(
    made: Projected,
    start: np.ndarray,
    entries: np.ndarray,
    options: SplatOptions,
    background: tuple[float, float, float],
    out: tuple[Tensor, Tensor, Tensor],
) -> np.ndarray:
    image, depth, weight = (t.numpy() for t in out)
    evaluations = np.zeros(len(start) - 1, np.int64)
    stamps, polynomial = (
        low_pass_stamps(options.low_pass_radius, options.gaussian_width, STEPS),
        kernel_polynomial(options.gaussian_width),
    )
    draw_tiles(
        Binned(made.records, made.boxes, entries, start),
        Weights(np.float32(options.low_pass_radius), stamps.numpy(), polynomial.numpy()),
        -(-image.shape[1] // TILE),
        np.array(background, np.float32),
        thread_count(),
        Picture(image, depth, weight, evaluations),
    )
    return evaluations


def _shade_pixels(camera: Cameras, options: SplatOptions, normal: Tensor, out: tuple[Tensor, Tensor, Tensor]) -> None:
    """Lambert's law with the blended normals (H,W,3), camera space."""
    image, depth, _ = out
    normal = torch.nn.functional.normalize(normal, dim=-1)
    if options.light is None:
        _, rays = camera.rays()
        toward = -torch.nn.functional.normalize(rays[0] @ camera.rotation[0].T, dim=-1).float()
    else:
        world = torch.nn.functional.normalize(torch.tensor(options.light).double(), dim=0)
        toward = (camera.rotation[0] @ world).float().expand_as(normal)
    shade = options.ambient + (1 - options.ambient) * (normal * toward).sum(-1).clamp_min(0)
    image.mul_(torch.where(torch.isfinite(depth), shade, 1.0)[..., None])


def _statistics(
    patches: PatchSet, work: _Work, counts: list[int], evaluations: int, ms: dict[str, float]
) -> SplatStatistics:
    modes = counts[ewa.MODES :]
    nodes = int(work.first[-1])
    return SplatStatistics(
        patches=len(patches.headers),
        patches_outside=work.selection.outside,
        patches_back=work.selection.back,
        points=patches.point_count,
        nodes=nodes,
        drawn=sum(modes),
        full=modes[ewa.FULL],
        reconstruction=modes[ewa.RECONSTRUCTION],
        low_pass=modes[ewa.LOW_PASS],
        squares=modes[ewa.SQUARE],
        behind=counts[ewa.BEHIND],
        back=counts[ewa.BACK],
        degenerate=counts[ewa.DEGENERATE],
        large=counts[ewa.LARGE],
        capped=counts[ewa.CAPPED],
        evaluations=evaluations,
        bytes_read=nodes * patches.nodes.node_bytes,
        ms=ms,
    )
