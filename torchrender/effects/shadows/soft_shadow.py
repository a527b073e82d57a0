"""Soft shadows of rectangular lights: which of a light's samples every visible point sees. No noise, no randomness.

The occluders are any triangles: the scene itself, or meshes rebuilt from a few depth images of it. Two questions can be
asked for a point o and a light sample s, with the same bias:

- ``ray``: does a triangle meet the segment between them?
- ``shadow_map``: is o deeper than what the shadow map of s stores in the texel that o falls into?

Rays go through Embree where it is fine enough, from the receivers: a few first, and where neighbours on the surface and
on the light agree about those no others, so the cost follows the penumbra. Else, and for maps, packets of rays start at
the light sample; a map's answer is found without drawing the map, because only the texels that somebody looks up are
traced. ``engine="maps"`` draws them whole, as published; it is there to compare with.

What lies below a surface's own plane sends it no light, shadows or not (:mod:`torchrender.numerics.polygon_light` clips
it): visibility is the visible share of the samples above that plane.

Sources: Crow, Shadow algorithms, 1977; Williams, 1978; algorithm 5 of non-redundant depth-image sampling.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from torchrender.arrays import view as numpy_view
from torchrender.brief import brief
from torchrender.buffers import GBuffer, RaySurface, check_fixed_buffers, position_error
from torchrender.checks import check_choice, check_class, check_no_gradient, check_range, checked_fields, options_of
from torchrender.effects.shadows.light_packets import Packets, packet_bits
from torchrender.effects.shadows.light_rays import LightRays, samples_above, usable
from torchrender.effects.shadows.light_samples import LightGrid, check_lights, light_grid
from torchrender.effects.shadows.receivers import shadow_receivers
from torchrender.errors import InputError, OptionError
from torchrender.kernels.rays.bvh_build import Bvh, build_bvh
from torchrender.kernels.rays.embree_library import embree
from torchrender.scene.light import RectLight
from torchrender.scene.mesh import Geometry
from torchrender.scene.parts.kinds import several
from torchrender.scene.triangles import Shape, geometry_of

VISIBILITIES = ("ray", "shadow_map")
OCCLUDERS = ("scene", "images", "rebuilt")
ENGINES = ("auto", "rays", "packets", "maps")

_CELLS = (1 << 16) - 1  # of the curve along which receivers are sorted
_ONES = np.array([bin(value).count("1") for value in range(256)], np.int32)


@dataclass(frozen=True, kw_only=True)
@checked_fields
class SoftShadowOptions:
    """How light visibility is found.

    Rays start off the surface by what its position may be off, and need no bias. Surfaces that were rebuilt, maps, and
    engine "packets" where it is asked for take
    ``bias = constant_bias z + slope_bias g(z) min(tan theta, largest_slope)`` with z the depth of the point seen from
    the light sample, g(z) the width of a texel there and theta the angle between normal and light. The former ask
    staggered samples, the latter cell centres, as published.

    Raises:
        OptionError: a value outside its range, or an engine that cannot answer what is asked; names the option.
    """

    light_samples: int = 16  # along each edge of the light
    visibility: str = "ray"  # "ray", or "shadow_map" with its aliasing
    occluders: str = "scene"  # what casts: all the "scene", or what four "images" from the light's corners show of
    # it, or surfaces "rebuilt" from these, which need a bias. Who calls :func:`soft_shadow` hands them in
    engine: str = "auto"  # "rays": Embree; "packets": our own tree, exact at any scale; "maps": draws every shadow map
    refine: int = 2  # "rays": step of the light samples traced before those between; 1: all are traced
    map_size: int = 1024  # texels of a shadow map's side; sets the slope bias of packets, too
    constant_bias: float = 1e-3  # share of the depth
    slope_bias: float = 1.5  # texels
    largest_slope: float = 10.0
    skip_lit: bool = True  # find groups that nothing shadows before tracing; never changes the result
    umbra_probes: int = 8  # samples along each edge that must all be dark for a whole group to count as umbra; 0: exact

    def __post_init__(self) -> None:
        check_range("light_samples", self.light_samples, 1, 64)
        check_choice("visibility", self.visibility, VISIBILITIES)
        check_choice("occluders", self.occluders, OCCLUDERS)
        check_choice("engine", self.engine, ENGINES)
        check_range("map_size", self.map_size, 16, 8192)
        check_range("constant_bias", self.constant_bias, 0.0, 0.5)
        check_range("slope_bias", self.slope_bias, 0.0, 100.0)
        check_range("largest_slope", self.largest_slope, 0.0, 1e6)
        check_range("umbra_probes", self.umbra_probes, 0, 64)
        check_range("refine", self.refine, 1, 8)
        fit = {"maps": "shadow_map", "rays": "ray"}
        if fit.get(self.engine, self.visibility) != self.visibility:
            raise OptionError(f'engine "{self.engine}" needs visibility "{fit[self.engine]}"')
        if self.engine == "rays" and embree() is None:
            raise OptionError('engine "rays" needs the embreex package, which is not installed or not usable')


@dataclass(frozen=True, eq=False)
class Occluders:
    """Triangles that cast shadows, ready to be searched; build once for as many lights and pictures as they serve."""

    geometry: Geometry

    def prepared(self, options: SoftShadowOptions) -> Occluders:
        """Itself, with what is likely to be searched already sorted."""
        if _by_rays(options):
            assert self.rays is not None
        else:
            assert self.tree is not None
        return self

    @cached_property
    def tree(self) -> Bvh:
        """For packets."""
        return build_bvh(self.geometry.vertices.numpy(), self.geometry.faces.numpy())

    @cached_property
    def rays(self) -> LightRays:
        """For Embree."""
        return LightRays(self.geometry)


@dataclass(frozen=True, eq=False)
class LightVisibility:
    """What every pixel of B pictures sees of L lights. Pixels without a surface see all of them."""

    lit: Tensor  # (B,L,H,W) int32 visible samples
    visibility: Tensor  # (B,L,H,W) float32 in [0,1]: lit / above; 0 where the whole light lies below the surface
    above: Tensor  # (B,L,H,W) int32 samples above the surface's own plane; all of them where there is no surface
    bits: Tensor  # (B,L,H,W,words) int64: sample s of a light is bit s % 64 of word s // 64
    sample_count: tuple[int, ...]  # samples of each light: n^2, n for a line, 1 for a point
    outside: tuple[int, ...]  # for each light, pairs outside the sample's pictures, taken as lit; skipped groups apart
    notes: tuple[str, ...]  # what was done about lights without area

    __repr__ = brief


def occluders(geometry: Shape | Sequence[Shape]) -> Occluders:
    """Triangles of one or several geometries for :func:`soft_shadow`, sorted when first used.

    Zero-area triangles cast no shadow.
    """
    if isinstance(geometry, Sequence):
        return Occluders(join([geometry_of("casters", one) for one in geometry]))
    return Occluders(geometry_of("casters", geometry))


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
    casters: Occluders | Shape | Sequence[Shape],
    lights: RectLight | Sequence[RectLight],
    gbuffer: GBuffer | RaySurface,
    options: SoftShadowOptions | None = None,
    *,
    bounds: Tensor | None = None,
) -> LightVisibility:
    """How much of each light the surface in every pixel sees.

    A surface that faces away from a sample does not see it. Whether the light emits to that side is not asked here:
    that is shading. Zero-area lights are lines or points; the result's ``notes`` say so. Holes cut by textures let
    light through with engine "rays"; packets and maps take them as closed.

    Args:
        casters: triangles that cast shadows; hand in :func:`occluders` if they serve several times.
        lights: one or several.
        gbuffer: B pictures; or hits of rays, as an image.
        options: default: rays to 16 x 16 samples.
        bounds: (2,3) box that the cameras at the light look at and that sets the size of a texel; default: the box
            around casters and visible points. Give the scene's box where results are to be compared.

    Raises:
        InputError: no light, or ``bounds`` not finite. GradientError: a light's place asks for a gradient.
    """
    check_class("gbuffer", gbuffer, GBuffer, RaySurface)
    check_fixed_buffers("soft_shadow", "gbuffer", gbuffer)
    options = options_of(options, SoftShadowOptions)
    lights = several("lights", lights, (RectLight,))
    if not lights:
        raise InputError("lights must not be empty")
    check_lights("soft_shadow", lights)
    check_no_gradient("soft_shadow", bounds=bounds)
    ready = casters if isinstance(casters, Occluders) else occluders(casters)
    covered = gbuffer.covered
    if bounds is None:
        bounds = _bounds(ready.geometry, gbuffer.position[covered].double())
    per_side, size, staggered = options.light_samples, options.map_size, _unbiased(options)
    grids = [light_grid(one, bounds, per_side=per_side, size=size, staggered=staggered) for one in lights]
    words = (max(len(g.samples) for g in grids) + 63) // 64
    shape = (*covered.shape, len(lights))
    bits = torch.full((*shape, words), -1, dtype=torch.int64)
    counts = tuple(len(g.samples) for g in grids)
    lit = torch.tensor(counts, dtype=torch.int32).repeat(*covered.shape, 1)
    above = lit.clone()
    outside = [0] * len(lights)
    for b in range(len(covered)):
        receivers, order = _receivers(gbuffer, b)
        for index, grid in enumerate(grids):
            found, over, missed = _light_bits(ready, receivers, grid, options)
            outside[index] += missed
            flat = torch.zeros(len(order), words, dtype=torch.int64)
            flat[order, : found.shape[1]] = torch.from_numpy(found)
            bits[b, ..., index, :][covered[b]] = flat
            lit[b, ..., index][covered[b]] = count_bits(flat)
            above[b, ..., index][covered[b]] = torch.zeros_like(over).index_copy(0, order, over)
    lit, above = (v.movedim(-1, 1).contiguous() for v in (lit, above))
    share = lit.float() / above.clamp_min(1)
    notes = tuple(g.note for g in grids if g.note)
    return LightVisibility(lit, share, above, bits.movedim(-2, 1).contiguous(), counts, tuple(outside), notes)


def count_bits(bits: Tensor) -> Tensor:
    """(...) int32 number of set bits of (..., words) int64."""
    flat = numpy_view(bits, np.int64)
    counts = _ONES[flat.view(np.uint8)].sum(axis=-1, dtype=np.int32)
    return torch.from_numpy(np.ascontiguousarray(counts))


class _Receivers(NamedTuple):
    """Surfaces of one picture, neighbours next to each other."""

    points: Tensor  # (P,3) float64
    normals: Tensor  # (P,3) float64
    gaps: Tensor  # (P,) float64 scene units that points may be off


def _receivers(gbuffer: GBuffer | RaySurface, b: int) -> tuple[_Receivers, Tensor]:
    """The covered pixels of picture ``b``, and their order (P,)."""
    covered = gbuffer.covered[b]
    points, normals = (image[b][covered].double() for image in shadow_receivers(gbuffer))
    order = _neighbours_first(points)
    rows = covered.reshape(-1).nonzero().reshape(-1)[order] + b * covered.numel()
    return _Receivers(points[order], normals[order], position_error(gbuffer, rows)), order


def _unbiased(options: SoftShadowOptions) -> bool:
    """Nothing but rounding need be cleared: surfaces that were rebuilt lie beside those that are seen."""
    return options.engine in ("auto", "rays") and options.visibility == "ray" and options.occluders != "rebuilt"


def _by_rays(options: SoftShadowOptions) -> bool:
    """Embree can answer."""
    return options.engine == "rays" or (_unbiased(options) and embree() is not None)


def _light_bits(
    ready: Occluders, receivers: _Receivers, grid: LightGrid, options: SoftShadowOptions
) -> tuple[np.ndarray, Tensor, int]:
    """Bits (P,words) of one light, samples (P,) above each surface, and the number of pairs outside its pictures."""
    points, normals, gaps = receivers
    if options.engine == "rays" or (_by_rays(options) and usable(ready.geometry, points, grid)):
        found, above = ready.rays.bits(points, normals, gaps, grid, options.light_samples, options.refine)
        return found, torch.from_numpy(above), 0
    bias = (float(options.constant_bias), float(options.slope_bias), float(options.largest_slope))
    starts = points
    if _unbiased(options):
        starts, bias, grid = points + normals * gaps[:, None], (0.0, 0.0, 0.0), replace(grid, near=0.0)
    how = Packets(
        visibility=options.visibility,
        drawn=options.engine == "maps",
        per_side=options.light_samples,
        bias=bias,
        skip=options.skip_lit,
        probes=options.umbra_probes,
    )
    found, missed = packet_bits(ready.geometry, ready.tree, (starts, normals), grid, how)
    return found, samples_above(points, normals, grid), missed


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
