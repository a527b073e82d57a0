"""The frozen records that passes hand on. Images are (B,H,W) or (B,H,W,C), float32, linear light; ids are int64.

Empty pixel: depth +inf, id -1, normal 0, everything else 0.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from enum import IntEnum
from functools import cached_property
from typing import Any

import torch
from torch import Tensor

from torchrender.brief import brief, brief_html
from torchrender.checks import check_no_gradient, is_whole
from torchrender.scene.camera import Cameras

SEEN = 2.0**-22
"""What a point that an eye saw may be off, as a share of its distance: float32 depth, four times over."""

HELD = 2.0**-48
"""What float64 arithmetic on coordinates may be off, as a share of them."""

WIDE = 2.0**-12
"""What a ray's hit may be off, as a share of the ray's width there: nothing of a picture shows so little."""


@dataclass(frozen=True, eq=False)
class VisibilityBuffer:
    """What each pixel of B cameras sees: the nearest surface at its centre."""

    cameras: Cameras
    depth: Tensor  # (B,H,W) camera z
    triangle: Tensor  # (B,H,W) int64 row of Geometry.faces
    object_id: Tensor  # (B,H,W) int64
    barycentric: Tensor  # (B,H,W,2) weights of the triangle's second and third vertex

    __repr__ = brief
    _repr_html_ = brief_html

    @property
    def covered(self) -> Tensor:
        """(B,H,W) bool: a surface is there."""
        return self.triangle >= 0


def check_fixed_buffers(function: str, name: str, buffers: object, *, but: Sequence[str] = ()) -> None:
    """Refuse images whose fields ask for a gradient that ``function`` does not give.

    Raises:
        GradientError: names the function and the field.
    """
    # Of its dictionary: fields that are made when they are looked at stay as they are.
    values = {f"{name}.{field}": value for field, value in vars(buffers).items() if field not in but}
    check_no_gradient(function, **values)


@dataclass(frozen=True, eq=False)
class GBuffer(VisibilityBuffer):
    """A visibility buffer with what shading needs."""

    position: Tensor  # (B,H,W,3) float64 world space: visibility is decided from it
    normal: Tensor  # (B,H,W,3) unit shading normal that faces the camera
    geometric_normal: Tensor  # (B,H,W,3) unit normal of the triangle that faces the camera
    uv: Tensor  # (B,H,W,2)
    uv_footprint: Tensor  # (B,H,W) width of one pixel in uv, for texture filtering
    color: Tensor  # (B,H,W,3) interpolated vertex colour, one where the mesh has none
    material: Tensor  # (B,H,W) int64, -1 where empty
    uv1: Tensor | None = None  # (B,H,W,2) second set; None: no mesh has one
    uv1_footprint: Tensor | None = None  # (B,H,W) width of one pixel in the second set
    tangent: Tensor | None = None  # (B,H,W,4) along u, interpolated, and the bitangent's sign; 0: none; None: no one
    alpha: Tensor | None = None  # (B,H,W) interpolated opacity of the vertices; None: one everywhere

    __repr__ = brief
    _repr_html_ = brief_html

    def of_cameras(self, chosen: Tensor) -> GBuffer:
        """What the chosen of the cameras, by numbers (K,), see."""
        images = {f.name: getattr(self, f.name) for f in fields(self) if f.name != "cameras"}
        own: dict[str, Any] = {n: None if image is None else image[chosen] for n, image in images.items()}
        return replace(self, cameras=self.cameras[chosen], **own)


@dataclass(frozen=True, eq=False)
class DepthImages(VisibilityBuffer):
    """A set of B depth images that together sample a scene; image i may leave out what images 0..i-1 hold.

    ``parameters`` are the options that made the set, as plain values: ``SamplingOptions(**images.parameters)``.
    """

    position: Tensor  # (B,H,W,3) float64 world space: visibility is decided from it
    normal: Tensor  # (B,H,W,3) unit normal of the sample's triangle, world space, facing its camera
    color: Tensor  # (B,H,W,3) linear; zero unless shading was asked for
    layer: Tensor  # (B,H,W) int32 surfaces skipped before the stored one; where empty: surfaces skipped in all
    truncated: Tensor  # (B,H,W) bool: empty because the search gave up, not because nothing is left
    parameters: Mapping[str, Any]

    __repr__ = brief
    _repr_html_ = brief_html

    def __len__(self) -> int:
        return int(self.depth.shape[0])

    def __getitem__(self, index: int | slice) -> DepthImages:
        """The chosen images; an integer gives a set of one."""
        chosen = slice(index, index + 1 or None) if is_whole(index) else index
        names = ("depth", "triangle", "object_id", "barycentric", "position", "normal", "color", "layer", "truncated")
        parts = {name: getattr(self, name)[chosen] for name in names}
        return replace(self, cameras=self.cameras[chosen], **parts)


@dataclass(frozen=True, eq=False)
class RayHits:
    """First hits of N rays."""

    t: Tensor  # (N,) float64 ray parameter in units of the direction's length; +inf for a miss
    triangle: Tensor  # (N,) int64; -1 for a miss
    barycentric: Tensor  # (N,2) float32 weights of the second and third vertex

    __repr__ = brief
    _repr_html_ = brief_html

    @property
    def hit(self) -> Tensor:
        """(N,) bool."""
        return self.triangle >= 0

    @classmethod
    def misses(cls, count: int) -> RayHits:
        """``count`` rays that hit nothing."""
        t = torch.full((count,), torch.inf, dtype=torch.float64)
        return cls(t, torch.full((count,), -1, dtype=torch.int64), torch.zeros(count, 2))


@dataclass(frozen=True, eq=False)
class ShadowMap:
    """Depth of the nearest surfaces seen by a light; a point light has six faces."""

    cameras: Cameras  # N views of the light
    depth: Tensor  # (N,S,S) or (N,H,W) camera z of the light's view; +inf where empty
    starts: tuple[int, ...] | None = None  # views starts[b] to starts[b + 1] were fitted to picture b; None: all to all
    fitted_to: tuple[Any, ...] | None = None  # what the pictures saw then: where it is the same, the views still fit

    __repr__ = brief
    _repr_html_ = brief_html

    @cached_property
    def nearest(self) -> float:
        """Least depth of all views; +inf where they are empty."""
        return float(self.depth.min()) if self.depth.numel() else math.inf


@dataclass(frozen=True, eq=False)
class RaySurface:
    """The surfaces that rays hit, with what shading needs; rows of rays that hit nothing hold zeros, material -1.

    Fields have the rays' shape, (N,...); as :attr:`image` they are samples (1,1,N,...) that passes take in place of a
    G-buffer's.
    """

    position: Tensor  # (N,3) float64 world space
    normal: Tensor  # (N,3) unit shading normal that faces the ray's origin
    geometric_normal: Tensor  # (N,3) unit normal of the triangle that faces the ray's origin
    uv: Tensor  # (N,2)
    uv_footprint: Tensor  # (N,) width of the ray in uv
    color: Tensor  # (N,3) interpolated vertex colour
    material: Tensor  # (N,) int64
    to_eye: Tensor  # (N,3) float32 unit, back along the ray
    uv1: Tensor | None = None  # (N,2) second set; None: no mesh has one
    uv1_footprint: Tensor | None = None  # (N,)
    tangent: Tensor | None = None  # (N,4) as in a G-buffer
    alpha: Tensor | None = None  # (N,)
    triangle: Tensor | None = None  # (N,) int64 row of Geometry.faces, -1 for a miss; None: made up by hand
    barycentric: Tensor | None = None  # (N,2)
    width: Tensor | None = None  # (N,) float64 of each ray at its hit, scene units
    source: Any = None  # the geometry that all attributes are those of

    __repr__ = brief
    _repr_html_ = brief_html

    @property
    def image(self) -> RaySurface:
        """The same as an image of one row."""
        values = {field.name: getattr(self, field.name) for field in fields(self)}
        images = {n: v[None, None] if isinstance(v, Tensor) else v for n, v in values.items()}
        return RaySurface(**images)

    @property
    def covered(self) -> Tensor:
        """(N,) bool: a surface was hit."""
        return self.material >= 0


def position_error(samples: GBuffer | RaySurface, rows: Tensor) -> Tensor:
    """(N,) float64 scene units that the positions of pixels, or hits of rays, may be off.

    Rays that leave a surface start so far above it, or its own triangle hides what they look for.

    ``rows`` (N,) are numbers of covered ones. Hits are found in float64.
    """
    position = samples.position.reshape(-1, 3).index_select(0, rows).double()
    if isinstance(samples, RaySurface):
        wide = torch.zeros(len(rows)) if samples.width is None else samples.width.reshape(-1)[rows]
        return WIDE * wide.double() + 8.0 * HELD * position.abs().amax(dim=-1)
    cameras = samples.cameras
    if cameras.orthographic:
        distance = samples.depth.reshape(-1)[rows].double().abs()
    else:
        distance = (position - cameras.eye[rows // (cameras.width * cameras.height)]).norm(dim=-1)
    return SEEN * distance + HELD * position.abs().amax(dim=-1)


class ReflectionState(IntEnum):
    """Where the colour of a reflective pixel comes from."""

    NONE = 0  # not reflective, or not asked for
    TRACED = 1  # the ray caster
    DEPTH_IMAGE = 2  # a cluster's depth image
    ENVIRONMENT = 3  # the ray left the scene, or its hit is not known
    REUSED = 4  # a key frame of an earlier view


@dataclass(frozen=True, eq=False)
class MirrorShare:
    """What the light that surfaces send has to do with mirrors.

    Where a mirrored picture is known, the light is ``radiance - replaced + mirrored * picture``: highlights of lights,
    emission and what a coat mirrors stay.
    """

    replaced: Tensor  # (B,H,W,3): mirrored environment; of Phong materials the share of diffuse light that mirrors take
    mirrored: Tensor  # (B,H,W,3) tint and share of what is mirrored, by Schlick's term or by the lobe's albedo

    __repr__ = brief
    _repr_html_ = brief_html


@dataclass(frozen=True, eq=False)
class ReflectionLayer:
    """What the reflective pixels of B pictures mirror, before it is blended with their own colour.

    The reflected point of a mirror pixel is ``position + distance * direction``.
    """

    color: Tensor  # (B,H,W,3) radiance that arrives along the reflected ray, mean over the lobe; 0 where state is NONE
    distance: Tensor  # (B,H,W) float32 ray length from reflector to reflected point; +inf environment, 0 state NONE
    direction: Tensor  # (B,H,W,3) float32 unit reflected direction, 0 where state is NONE
    state: Tensor  # (B,H,W) uint8 ReflectionState
    cluster: Tensor  # (B,H,W) int64 group of pixels that shared a depth image, -1 for none
    share: MirrorShare | None = None  # how it is blended in; None: by the specular degree of whole materials

    __repr__ = brief
    _repr_html_ = brief_html
