"""What shading needs of the surfaces that pixels see or rays hit, each made when it is first asked for.

Most pictures ask for a few of them: shadows for position and triangle normal, the shading kernel for none, as it
interpolates what it needs while it is at a pixel.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from functools import cached_property
from typing import Any

import numpy as np
import torch
from torch import Tensor
from torch.utils.weak import WeakIdKeyDictionary

from torchrender.arrays import view
from torchrender.buffers import GBuffer, RayHits, RaySurface, VisibilityBuffer
from torchrender.kernels.compile import thread_count
from torchrender.kernels.raster.attributes import (
    MIN_COSINE,
    Eye,
    Hits,
    Mesh,
    Rays,
    Surface,
    interpolate,
    interpolate_hits,
    place,
)
from torchrender.kernels.raster.chosen import Eyes, Wanted, interpolate_views
from torchrender.scene.camera import Cameras
from torchrender.scene.mesh import Geometry

Array = np.ndarray[Any, Any]
_EYES: WeakIdKeyDictionary = WeakIdKeyDictionary()
Made = Mapping[str, Tensor]


class SeenSurface(GBuffer):
    """A G-buffer that makes its attributes when they are first asked for.

    A copy with other values, made by :func:`dataclasses.replace`, holds all of them and has no source.
    """

    source: Geometry | None = None  # what is seen, while every attribute is that of the geometry

    @classmethod
    def of(cls, geometry: Geometry, seen: VisibilityBuffer) -> SeenSurface:
        """The G-buffer of a visibility buffer of this geometry."""
        made = cls.__new__(cls)
        own = {field.name: getattr(seen, field.name) for field in fields(VisibilityBuffer)}
        made.__dict__.update(own, source=geometry)
        return made

    def __reduce__(self) -> tuple[Any, ...]:
        return (GBuffer, tuple(getattr(self, field.name) for field in fields(GBuffer)))

    @cached_property
    def _placed(self) -> Made:
        return _placed(self._geometry, self)

    @cached_property
    def _blended(self) -> Made:
        return _interpolated(self._geometry, self)

    @cached_property
    def _further(self) -> dict[str, Tensor | None]:
        depth = torch.where(self.covered, self.depth, 0.0).double()
        forward, rays = self.cameras.forward[:, None, None], self.position - self.cameras.eye[:, None, None]
        rays = forward.expand_as(rays) if self.cameras.orthographic else rays
        toward = torch.nn.functional.normalize(rays, dim=-1, eps=1e-300)
        size = self.cameras.footprint(depth)
        return further(self._geometry, self.triangle, self.barycentric, self.geometric_normal, (toward, size))

    @property
    def _geometry(self) -> Geometry:
        assert self.source is not None
        return self.source

    @cached_property
    def position(self) -> Tensor:
        return self._placed["position"]

    @cached_property
    def geometric_normal(self) -> Tensor:
        return self._placed["geometric_normal"]

    @cached_property
    def material(self) -> Tensor:
        return self._placed["material"]

    @cached_property
    def normal(self) -> Tensor:
        return self._blended["normal"]

    @cached_property
    def uv(self) -> Tensor:
        return self._blended["uv"]

    @cached_property
    def uv_footprint(self) -> Tensor:
        return self._blended["uv_footprint"]

    @cached_property
    def color(self) -> Tensor:
        return self._blended["color"]

    @cached_property
    def uv1(self) -> Tensor | None:
        return self._further["uv1"]

    @cached_property
    def uv1_footprint(self) -> Tensor | None:
        return self._further["uv1_footprint"]

    @cached_property
    def tangent(self) -> Tensor | None:
        return self._further["tangent"]

    @cached_property
    def alpha(self) -> Tensor | None:
        return self._further["alpha"]


@dataclass(frozen=True, eq=False)
class CastRays:
    """Rays and what they hit: where the attributes of a :class:`HitSurface` come from."""

    origins: Tensor  # (N,3)
    directions: Tensor  # (N,3)
    hits: RayHits
    width: Tensor  # (N,) float64 of each ray at its hit


def hit_surface(geometry: Geometry, rays: CastRays) -> RaySurface:
    """All attributes of what rays hit."""
    hits = rays.hits
    made = empty_attributes((len(hits.triangle),))
    cast = Rays(view(rays.origins, np.float64), view(rays.directions, np.float64), view(rays.width, np.float64))
    found = Hits(view(hits.t, np.float64), view(hits.triangle, np.int64), view(hits.barycentric, np.float32))
    interpolate_hits(attribute_arrays(geometry), cast, found, Surface(*made.values()))
    toward = torch.nn.functional.normalize(rays.directions.double(), dim=-1, eps=1e-30)
    tensors = {name: torch.from_numpy(value) for name, value in made.items()}
    more = further(geometry, hits.triangle, hits.barycentric, tensors["geometric_normal"], (toward, rays.width))
    return RaySurface(
        to_eye=-toward.float(),
        triangle=hits.triangle,
        barycentric=hits.barycentric,
        width=rays.width,
        source=geometry,
        **tensors,
        **more,  # type: ignore[arg-type]
    )


def further(
    geometry: Geometry, triangle: Tensor, weights: Tensor, face: Tensor, ray: tuple[Tensor, Tensor]
) -> dict[str, Tensor | None]:
    """Second texture coordinates, tangents and opacity at points (...); None where no mesh has them.

    Args:
        triangle: (...) int64, -1 for none.
        weights: (...,2) barycentric ones.
        face: (...,3) normal of the triangle that faces the ray.
        ray: its direction (...,3), unit, and its width (...) there.
    """
    made: dict[str, Tensor | None] = dict.fromkeys(("uv1", "uv1_footprint", "tangent", "alpha"))
    table = geometry.tangent_table
    if geometry.uv1 is None and geometry.alpha is None and table is None:
        return made
    lead = triangle.shape
    rows = (triangle.reshape(-1) >= 0).nonzero().reshape(-1)
    hit = triangle.reshape(-1)[rows]
    corner = geometry.faces[hit].long()
    second = weights.reshape(-1, 2)[rows].double()
    shares = torch.cat([1.0 - second.sum(-1, keepdim=True), second], dim=-1)[..., None]

    def image(value: Tensor, empty: float = 0.0) -> Tensor:
        flat = torch.full((triangle.numel(), *value.shape[1:]), empty)
        flat[rows] = value.float()
        return flat.reshape(*lead, *value.shape[1:])

    if geometry.alpha is not None:
        made["alpha"] = image((geometry.alpha[corner][..., None] * shares).sum(1)[:, 0], 1.0)
    facing = face.reshape(-1, 3)[rows].double()
    if geometry.uv1 is not None:
        uv = geometry.uv1.double()[corner]
        made["uv1"] = image((uv * shares).sum(1))
        cosine = (facing * ray[0].reshape(-1, 3)[rows]).sum(-1).abs().clamp_min(MIN_COSINE)
        made["uv1_footprint"] = image(
            _density(geometry.vertices[corner], uv) * ray[1].reshape(-1)[rows] / cosine.sqrt()
        )
    if table is not None:
        row = table.row[hit].long()
        value = (table.corners[row.clamp_min(0)].double() * shares).sum(1)
        value[:, 3] = value[:, 3].sign()
        flips = (_blended_normal(geometry, hit, corner, shares) * facing).sum(-1) < 0
        made["tangent"] = image(torch.where((row >= 0)[:, None], torch.where(flips[:, None], -value, value), 0.0))
    return made


def _density(vertices: Tensor, uv: Tensor) -> Tensor:
    """Length (N,) in texture coordinates per scene unit of triangles."""
    cross = torch.linalg.cross(vertices[:, 1] - vertices[:, 0], vertices[:, 2] - vertices[:, 0])
    p, q = uv[:, 1] - uv[:, 0], uv[:, 2] - uv[:, 0]
    area, texture = cross.norm(dim=-1), (p[:, 0] * q[:, 1] - p[:, 1] * q[:, 0]).abs()
    return torch.where(area > 0, texture / area.clamp_min(1e-300), 0.0).sqrt()


def _blended_normal(geometry: Geometry, triangle: Tensor, corner: Tensor, shares: Tensor) -> Tensor:
    """Normals (N,3) float64 as interpolated, whichever way they look; the triangle's where it has none."""
    flat = geometry.face_normals[triangle].double()
    if geometry.normals is None:
        return flat
    normal = (geometry.normals[corner].double() * shares).sum(1)
    return torch.where(normal.square().sum(-1, keepdim=True) > 0, normal, flat)


def attribute_arrays(geometry: Geometry) -> Mesh:
    """A mesh as the attribute kernels read it."""
    optional = (
        np.zeros((0, width), np.float32) if value is None else value.numpy()
        for value, width in ((geometry.normals, 3), (geometry.uv, 2), (geometry.colors, 3))
    )
    return Mesh(geometry.vertices.numpy(), geometry.faces.numpy(), geometry.material.numpy(), *optional)


def empty_attributes(shape: tuple[int, ...]) -> dict[str, Array]:
    """Room for what the attribute kernels write, in their order."""
    widths = {"normal": 3, "geometric_normal": 3, "uv": 2, "uv_footprint": 0, "color": 3}
    made: dict[str, Array] = {"position": np.zeros((*shape, 3))}
    made |= {name: np.zeros((*shape, n) if n else shape, np.float32) for name, n in widths.items()}
    return made | {"material": np.full(shape, -1, np.int64)}


def eye_of(cameras: Cameras, k: int) -> Eye:
    """Camera ``k`` as the attribute and shading kernels read it."""
    return _eyes(cameras)[k]


def _eyes(cameras: Cameras) -> list[Eye]:
    """All cameras as the kernels read them."""
    known: list[Eye] | None = _EYES.get(cameras)
    if known is None:
        known = _EYES[cameras] = _made_eyes(cameras)
    return known


def _made_eyes(cameras: Cameras) -> list[Eye]:
    all_rays = np.linalg.inv(cameras.intrinsics.detach().numpy())
    if cameras.orthographic:
        all_rays[:, 2] = 0.0  # across the image plane; the depth goes along ``forward``
    world_from_camera = cameras.world_from_camera.detach().numpy()
    sizes = cameras.footprint(torch.ones(len(cameras), 1, dtype=torch.float64)).detach().numpy()
    made = []
    for rays, matrix, size in zip(all_rays, world_from_camera, sizes, strict=True):
        rotation = matrix[:3, :3]
        axes = np.ascontiguousarray(rotation @ rays), matrix[:3, 3].copy(), rotation[:, 2].copy()
        made.append(Eye(*axes, float(size[0]), cameras.orthographic))
    return made


SHAPES: Mapping[str, tuple[tuple[int, ...], type]] = {
    **dict.fromkeys(("position", "normal", "geometric_normal"), ((3,), np.float32)),
    "uv": ((2,), np.float32),
    "uv_footprint": ((), np.float32),
    "color": ((3,), np.float32),
    "material": ((), np.int64),
}
"""What :func:`write_attributes` writes, in the order of :class:`~torchrender.kernels.raster.attributes.Surface`."""
DIRECT = tuple(SHAPES)


def attribute_arrays_of(geometry: Geometry, cameras: Cameras, room: Mapping[str, Array]) -> Wanted:
    """What writing attributes of B images into arrays (B,H,W) or (B,H,W,C) of :data:`SHAPES` takes, flat."""
    flat = [
        room[name].reshape(-1, *tail) if name in room else np.empty((0, *tail), kind)
        for name, (tail, kind) in SHAPES.items()
    ]
    eyes = _eyes(cameras)
    rows = [np.stack([np.asarray(eye[k]) for eye in eyes]) for k in range(4)]
    views = Eyes(rows[0], rows[1], rows[2], rows[3], cameras.orthographic)
    return Wanted(attribute_arrays(geometry), views, Surface(*flat))


def write_attributes(geometry: Geometry, seen: VisibilityBuffer, room: Mapping[str, Array]) -> None:
    """Attributes of B images straight into arrays (B,H,W) or (B,H,W,C) of :data:`SHAPES`.

    The values are those of :class:`SeenSurface`, positions rounded to float32.
    """
    if not len(seen.cameras) or not room:
        return
    mesh, eyes, surface = attribute_arrays_of(geometry, seen.cameras, room)
    visible = Hits(seen.depth.numpy(), seen.triangle.numpy(), seen.barycentric.numpy())
    interpolate_views(mesh, eyes, visible, surface, PARTS * thread_count())


PARTS = 16
"""Per thread, in which rows of pictures are handed out."""


def _placed(geometry: Geometry, seen: VisibilityBuffer) -> Made:
    """Where each pixel's surface lies, its triangle's normal, its material."""
    made = {name: a for name, a in empty_attributes(tuple(seen.depth.shape)).items() if name in PLACED}
    _fill(geometry, seen, made, place)
    return {name: torch.from_numpy(value) for name, value in made.items()}


PLACED = ("position", "geometric_normal", "material")


def _interpolated(geometry: Geometry, seen: VisibilityBuffer) -> Made:
    """Everything."""
    made = empty_attributes(tuple(seen.depth.shape))
    _fill(geometry, seen, made, lambda mesh, eye, visible, *out: interpolate(mesh, eye, visible, Surface(*out)))
    return {name: torch.from_numpy(value) for name, value in made.items()}


def _fill(geometry: Geometry, seen: VisibilityBuffer, made: dict[str, Array], write: Any) -> None:
    mesh = attribute_arrays(geometry)
    pixels = seen.cameras.width * seen.cameras.height
    for k, eye in enumerate(_eyes(seen.cameras)):
        visible = Hits(seen.depth[k].numpy(), seen.triangle[k].numpy(), seen.barycentric[k].numpy())
        write(mesh, eye, visible, *(a[k].reshape(pixels, *a.shape[3:]) for a in made.values()))
