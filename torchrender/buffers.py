"""The frozen records that passes hand on. Images are (B,H,W) or (B,H,W,C), float32, linear light; ids are int64.

Empty pixel: depth +inf, id -1, normal 0, everything else 0.
"""

from __future__ import annotations

from dataclasses import dataclass

from torch import Tensor

from torchrender.scene.camera import Cameras


@dataclass(frozen=True, eq=False)
class VisibilityBuffer:
    """What each pixel of B cameras sees: the nearest surface at its centre."""

    cameras: Cameras
    depth: Tensor  # (B,H,W) camera z
    triangle: Tensor  # (B,H,W) int64 row of Geometry.faces
    object_id: Tensor  # (B,H,W) int64
    barycentric: Tensor  # (B,H,W,2) weights of the triangle's second and third vertex

    @property
    def covered(self) -> Tensor:
        """(B,H,W) bool: a surface is there."""
        return self.triangle >= 0


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


@dataclass(frozen=True, eq=False)
class RayHits:
    """First hits of N rays."""

    t: Tensor  # (N,) float64 ray parameter in units of the direction's length; +inf for a miss
    triangle: Tensor  # (N,) int64; -1 for a miss
    barycentric: Tensor  # (N,2) float32 weights of the second and third vertex

    @property
    def hit(self) -> Tensor:
        """(N,) bool."""
        return self.triangle >= 0


@dataclass(frozen=True, eq=False)
class ShadowMap:
    """Depth of the nearest surfaces seen by a light; a point light has six faces."""

    cameras: Cameras  # N views of the light
    depth: Tensor  # (N,S,S) or (N,H,W) camera z of the light's view; +inf where empty
