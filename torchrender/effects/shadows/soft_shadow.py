"""Soft shadows of rectangular lights: which of a light's samples every visible point sees. No noise, no randomness.

The occluders are any triangles: the scene itself, or meshes rebuilt from a few depth images of it. Two questions can be
asked for a point o and a light sample s, with the same bias:

- ``ray``: does a triangle meet the segment between them?
- ``shadow_map``: is o deeper than what the shadow map of s stores in the texel that o falls into?

Both are answered by packets of rays that start at the light sample; a map's answer is found without drawing the map,
because only the texels that somebody looks up are traced. ``engine="maps"`` draws them whole, as published; it is there
to compare with. Points that nothing can shadow are found before any ray is traced, groups of points in umbra after a
few: the cost follows the penumbra.

Sources: Crow, Shadow algorithms, 1977; Williams, 1978; algorithm 5 of non-redundant depth-image sampling.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from torch import Tensor

from torchrender.arrays import view as numpy_view
from torchrender.buffers import GBuffer
from torchrender.checks import check_choice, check_range
from torchrender.effects.shadows.light_samples import LightGrid, light_grid
from torchrender.errors import InputError, OptionError
from torchrender.kernels.compile import thread_count
from torchrender.kernels.rays.bvh_build import Bvh, build_bvh
from torchrender.kernels.shadows.soft_shadow import LightViews, light_bits, look_up
from torchrender.raster import rasterize_depth
from torchrender.scene.light import RectLight
from torchrender.scene.mesh import Geometry

VISIBILITIES = ("ray", "shadow_map")
ENGINES = ("packets", "maps")

TILE = 4
"""Light samples along each edge of a part of the light that is searched for at once."""

_CELLS = (1 << 16) - 1  # of the curve along which receivers are sorted
_ONES = np.array([bin(value).count("1") for value in range(256)], np.int32)


@dataclass(frozen=True, kw_only=True)
class SoftShadowOptions:
    """How light visibility is found.

    ``bias = constant_bias z + slope_bias g(z) min(tan theta, largest_slope)`` with z the depth of the point seen from
    the light sample, g(z) the width of a texel there and theta the angle between normal and light.

    Raises:
        OptionError: a value outside its range, or drawn maps with ray visibility; names the option.
    """

    light_samples: int = 16  # along each edge of the light
    visibility: str = "ray"  # "ray", or "shadow_map" with its aliasing
    engine: str = "packets"  # "packets" traces what is asked for, "maps" draws every shadow map
    map_size: int = 1024  # texels of a shadow map's side; sets the slope bias of "ray" too
    constant_bias: float = 1e-3  # share of the depth
    slope_bias: float = 1.5  # texels
    largest_slope: float = 10.0
    skip_lit: bool = True  # find groups that nothing shadows before tracing; never changes the result
    umbra_probes: int = 8  # samples along each edge that must all be dark for a whole group to count as umbra; 0: exact

    def __post_init__(self) -> None:
        check_range("light_samples", self.light_samples, 1, 64)
        check_choice("visibility", self.visibility, VISIBILITIES)
        check_choice("engine", self.engine, ENGINES)
        check_range("map_size", self.map_size, 16, 8192)
        check_range("constant_bias", self.constant_bias, 0.0, 0.5)
        check_range("slope_bias", self.slope_bias, 0.0, 100.0)
        check_range("largest_slope", self.largest_slope, 0.0, 1e6)
        check_range("umbra_probes", self.umbra_probes, 0, 64)
        if self.engine == "maps" and self.visibility == "ray":
            raise OptionError('engine "maps" needs visibility "shadow_map"')


@dataclass(frozen=True, eq=False)
class Occluders:
    """Triangles that cast shadows, ready to be searched; build once for as many lights and pictures as they serve."""

    geometry: Geometry
    tree: Bvh


@dataclass(frozen=True, eq=False)
class LightVisibility:
    """What every pixel of B pictures sees of L lights. Pixels without a surface see all of them."""

    lit: Tensor  # (B,L,H,W) int32 visible samples
    visibility: Tensor  # (B,L,H,W) float32 share of visible samples in [0,1]
    bits: Tensor  # (B,L,H,W,words) int64: sample s of a light is bit s % 64 of word s // 64
    sample_count: tuple[int, ...]  # samples of each light: n^2, n for a line, 1 for a point
    outside: tuple[int, ...]  # for each light, pairs outside the sample's pictures, taken as lit; skipped groups apart
    notes: tuple[str, ...]  # what was done about lights without area


def occluders(geometry: Geometry | Sequence[Geometry]) -> Occluders:
    """Sort the triangles of one or several geometries for :func:`soft_shadow`; zero-area triangles cast no shadow."""
    joined = geometry if isinstance(geometry, Geometry) else join(geometry)
    return Occluders(joined, build_bvh(joined.vertices.numpy(), joined.faces.numpy()))


def join(geometries: Sequence[Geometry]) -> Geometry:
    """The triangles of several geometries in one, without what only shading needs."""
    parts = [g for g in geometries if g.triangle_count]
    if not parts:
        empty = torch.zeros(0, 3)
        ids = torch.zeros(0, dtype=torch.int64)
        return Geometry(
            vertices=empty.double(), faces=empty.to(torch.int32), object_id=ids, material=ids, normals=None, uv=None,
            colors=None, runs=torch.zeros(1, dtype=torch.int64),
        )  # fmt: skip
    vertices = np.cumsum([0] + [len(g.vertices) for g in parts])
    triangles = np.cumsum([0] + [g.triangle_count for g in parts])
    return replace(
        parts[0],
        vertices=torch.cat([g.vertices for g in parts]),
        faces=torch.cat([g.faces + int(o) for g, o in zip(parts, vertices, strict=False)]),
        object_id=torch.cat([g.object_id for g in parts]),
        material=torch.cat([g.material for g in parts]),
        normals=None,
        uv=None,
        colors=None,
        runs=torch.cat([g.runs[bool(i) :] + int(o) for i, (g, o) in enumerate(zip(parts, triangles, strict=False))]),
        cutout=None,
        coherent=all(g.coherent for g in parts),
    )


def soft_shadow(
    casters: Occluders | Geometry | Sequence[Geometry],
    lights: RectLight | Sequence[RectLight],
    gbuffer: GBuffer,
    options: SoftShadowOptions | None = None,
    *,
    bounds: Tensor | None = None,
) -> LightVisibility:
    """How much of each light the surface in every pixel sees.

    A surface that faces away from a sample does not see it. Whether the light emits to that side is not asked here:
    that is shading. Zero-area lights are lines or points; the result's ``notes`` say so. Holes cut by textures cast
    shadows as if they were closed.

    Args:
        casters: triangles that cast shadows; hand in :func:`occluders` if they serve several times.
        lights: one or several.
        gbuffer: B pictures.
        options: default: rays to 16 x 16 samples.
        bounds: (2,3) box that the cameras at the light look at and that sets the size of a texel; default: the box
            around casters and visible points. Give the scene's box where results are to be compared.

    Raises:
        InputError: no light, or ``bounds`` not finite.
    """
    options = options or SoftShadowOptions()
    lights = [lights] if isinstance(lights, RectLight) else list(lights)
    if not lights:
        raise InputError("lights must not be empty")
    ready = casters if isinstance(casters, Occluders) else occluders(casters)
    covered = gbuffer.covered
    points, normals = gbuffer.position[covered].double(), gbuffer.geometric_normal[covered].double()
    if bounds is None:
        bounds = _bounds(ready.geometry, points)
    order = _neighbours_first(points)
    receivers = (numpy_view(points[order], np.float64), numpy_view(normals[order], np.float64))
    grids = [light_grid(light, bounds, per_side=options.light_samples, size=options.map_size) for light in lights]
    shape = (*covered.shape, len(lights))
    words = (max(len(g.samples) for g in grids) + 63) // 64
    bits = torch.full((*shape, words), -1, dtype=torch.int64)
    lit = torch.zeros(shape, dtype=torch.int32)
    outside = []
    for index, grid in enumerate(grids):
        found, missed = _light_bits(ready, receivers, grid, options)
        outside.append(missed)
        flat = torch.zeros(len(points), words, dtype=torch.int64)
        flat[order, : found.shape[1]] = torch.from_numpy(found)
        bits[..., index, :][covered] = flat
        seen = torch.full(covered.shape, len(grid.samples), dtype=torch.int32)
        seen[covered] = count_bits(flat)
        lit[..., index] = seen
    counts = tuple(len(g.samples) for g in grids)
    lit = lit.movedim(-1, 1).contiguous()
    share = lit.float() / torch.tensor(counts, dtype=torch.float32)[:, None, None]
    notes = tuple(g.note for g in grids if g.note)
    return LightVisibility(lit, share, bits.movedim(-2, 1).contiguous(), counts, tuple(outside), notes)


def count_bits(bits: Tensor) -> Tensor:
    """(...) int32 number of set bits of (..., words) int64."""
    flat = numpy_view(bits, np.int64)
    counts = _ONES[flat.view(np.uint8)].sum(axis=-1, dtype=np.int32)
    return torch.from_numpy(np.ascontiguousarray(counts))


def _light_bits(
    ready: Occluders, receivers: tuple[np.ndarray, np.ndarray], grid: LightGrid, options: SoftShadowOptions
) -> tuple[np.ndarray, int]:
    """Bits (P,words) of one light and the number of pairs outside its pictures."""
    samples = len(grid.samples)
    probe = _probes(grid, options)
    tile, tiles = grid.tiles(options.light_samples, TILE)
    first = (tile + len(tiles) * ~probe).argsort(stable=True)
    bounds = torch.arange(len(tiles) + 1)
    runs = torch.stack([torch.searchsorted(tile[probe].sort().values, bounds),
                        int(probe.sum()) + torch.searchsorted(tile[~probe].sort().values, bounds)])  # fmt: skip
    views = LightViews(
        samples=numpy_view(grid.samples[first], np.float64),
        rotations=numpy_view(grid.rotations[first], np.float64),
        focal=numpy_view(grid.focal[first], np.float64),
        names=numpy_view(first, np.int64),
        size=grid.size,
        near=grid.near,
        constant_bias=float(options.constant_bias),
        slope_bias=float(options.slope_bias),
        largest_slope=float(options.largest_slope),
        texels=options.visibility == "shadow_map",
        outline=numpy_view(grid.outline, np.float64),
        tiles=numpy_view(tiles, np.float64),
        runs=numpy_view(runs, np.int64),
    )
    points, normals = receivers
    threads = thread_count()
    bits, outside = np.zeros((len(points), (samples + 63) // 64), np.int64), np.zeros(threads, np.int64)
    if options.engine == "maps":
        for s, name in enumerate(first.tolist()):
            maps = rasterize_depth(ready.geometry, grid.cameras(name))
            look_up(numpy_view(maps, np.float32), points, normals, views, s, bits, outside)
        return bits, int(outside.sum())
    light_bits(ready.tree, points, normals, views, options.skip_lit, threads, bits, outside)
    return bits, int(outside.sum())


def _probes(grid: LightGrid, options: SoftShadowOptions) -> Tensor:
    """(S,) bool samples traced first: an even subset that includes the light's rim; none if all are to be traced."""
    n = options.light_samples
    chosen = torch.zeros(len(grid.samples), dtype=torch.bool)
    if 0 < options.umbra_probes < n and len(chosen) == n * n:
        rows = torch.linspace(0, n - 1, options.umbra_probes).round().long()
        chosen[(rows[:, None] * n + rows).reshape(-1)] = True
    return chosen


def _bounds(geometry: Geometry, points: Tensor) -> Tensor:
    """(2,3) box around the triangles and the points."""
    boxes = [geometry.bounds] if geometry.triangle_count else []
    if len(points):
        boxes.append(torch.stack([points.amin(0), points.amax(0)]))
    if not boxes:
        return torch.zeros(2, 3, dtype=torch.float64)
    both = torch.stack(boxes)
    return torch.stack([both[:, 0].amin(0), both[:, 1].amax(0)])


def _neighbours_first(points: Tensor) -> Tensor:
    """(P,) order along a Morton curve, so that consecutive points are close to each other in space."""
    if not len(points):
        return torch.zeros(0, dtype=torch.int64)
    low = points.amin(0)
    extent = float((points.amax(0) - low).amax())
    if not (extent > 0 and math.isfinite(extent)):
        return torch.arange(len(points))
    cell = ((points - low) * (_CELLS / extent)).long().clamp(0, _CELLS)
    code = torch.zeros(len(points), dtype=torch.int64)
    for axis in range(3):
        code |= _spread(cell[:, axis]) << axis
    return code.argsort(stable=True)


def _spread(value: Tensor) -> Tensor:
    """16 bits with two zeros between each."""
    value = (value | (value << 16)) & 0xFF0000FF
    value = (value | (value << 8)) & 0xF00F00F00F
    value = (value | (value << 4)) & 0xC30C30C30C3
    return (value | (value << 2)) & 0x249249249249
