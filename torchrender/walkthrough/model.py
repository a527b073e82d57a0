"""A walkthrough: textured planes and points, trees of boxes around the points, and what is known of how it was made."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache, cached_property
from typing import Any

import numpy as np
import torch
from torch import Tensor

from torchrender.brief import brief
from torchrender.kernels.walkthrough.plane_pixels import FINENESS, Atlas
from torchrender.numerics.color import linear_from_srgb, srgb_table
from torchrender.numerics.texels.coded import CodedTexture
from torchrender.points.cloud import PointCloud
from torchrender.scene.camera import Cameras
from torchrender.scene.material import Material
from torchrender.scene.mesh import Mesh
from torchrender.scene.model import Scene
from torchrender.walkthrough.view_colors import ViewColors

Array = np.ndarray[Any, Any]

SEEN_ALPHA, FILLED = 255, 254
"""Alpha of texels that photos saw, and of those that were made up; holes have 0."""

POINT_BYTES, TEXEL_BYTES, PIXEL_BYTES = 15, 4, 7
"""As the source counts: raw, a point with position and colour, a texel with alpha, a pixel of colour and depth."""


@dataclass(frozen=True, eq=False, kw_only=True)
class PlanePatch:
    """A textured piece of a plane. Texel (row, column) has its centre at origin + step ((column + 0.5) across + (row +
    0.5) down)."""

    normal: Array  # (3,) float64 unit, towards the cameras
    origin: Array  # (3,) float64
    across: Array  # (3,) unit
    down: Array  # (3,) unit
    step: float  # scene units per texel
    plane: int  # patches of one plane share it
    texture: Array  # (Ht,Wt,4) uint8 sRGB codes and alpha
    corners: Array  # (V,2) float64 of its outline, texels
    triangles: Array  # (F,3) int64
    raw_corners: int  # of the outline before it was simplified
    solid: Array  # (4,) rectangle of opaque texels: first column, row, end column, row

    def world(self, texels: Array) -> Array:
        """(K,3) world points of texel coordinates (K,2)."""
        return self.origin + self.step * (texels[:, :1] * self.across + texels[:, 1:] * self.down)

    @cached_property
    def mesh(self) -> Mesh:
        """Its outline in triangles; (0,0) of the texture coordinates is the lower left corner."""
        vertices = self.world(self.corners)
        faces = self.triangles.copy()
        a, b, c = (vertices[faces[:, k]] for k in range(3))
        turned = (np.cross(b - a, c - a) * self.normal).sum(1) < 0
        faces[turned] = faces[turned][:, ::-1]
        height, width = self.texture.shape[:2]
        uv = np.stack([self.corners[:, 0] / width, 1.0 - self.corners[:, 1] / height], axis=1)
        return Mesh(
            vertices=torch.from_numpy(vertices),
            faces=torch.from_numpy(np.ascontiguousarray(faces)),
            uv=torch.from_numpy(uv.astype(np.float32)),
            name=f"plane {self.plane}",
        )


@dataclass(frozen=True, eq=False, kw_only=True)
class PointModel:
    """M points in the order of the leaves of their trees."""

    position: Array  # (M,3) float64
    normal: Array  # (M,3) float32 unit
    color: Array  # (M,3) uint8 sRGB codes
    log_density: Array  # (M,) float32 of the pixels per unit of area that photographed it
    object_id: Array  # (M,) int32
    nodes: Array  # (K,15) float64: centre, three axes by rows, half sides
    links: Array  # (K,4) int64: first point, one past the last, first child, one past the last child (0, 0: a leaf)
    roots: Array  # (R,) int64 nodes, one for each object

    def __len__(self) -> int:
        return len(self.position)

    @property
    def footprint(self) -> Array:
        """(M,) usual size of the pixel that each point was, scene units: 1 / sqrt(density)."""
        return np.exp(-0.5 * self.log_density.astype(np.float64))


def no_points() -> PointModel:
    """A model without points."""
    return PointModel(
        position=np.zeros((0, 3)),
        normal=np.zeros((0, 3), np.float32),
        color=np.zeros((0, 3), np.uint8),
        log_density=np.zeros(0, np.float32),
        object_id=np.zeros(0, np.int32),
        nodes=np.zeros((0, 15)),
        links=np.zeros((0, 4), np.int64),
        roots=np.zeros(0, np.int64),
    )


@dataclass(frozen=True, eq=False, kw_only=True)
class Walkthrough:
    """Planes and points that stand for a place. ``report`` holds plain values: sizes, counts, times, held-out error."""

    planes: tuple[PlanePatch, ...]
    points: PointModel
    cameras: Cameras | None = None  # those of the photos
    view_colors: ViewColors | None = None  # what each photo saw differently
    world_from_input: Tensor = field(default_factory=lambda: torch.eye(4, dtype=torch.float64))
    report: Mapping[str, Any] = field(default_factory=dict)
    name: str = "walkthrough"

    __repr__ = brief

    @property
    def texel_count(self) -> int:
        """Of all textures."""
        return sum(p.texture.shape[0] * p.texture.shape[1] for p in self.planes)

    @property
    def size_bytes(self) -> int:
        """As the source counts: 4 bytes a texel, 15 a point; and 5 a sample of the colours that depend on the view."""
        more = 0 if self.view_colors is None else self.view_colors.size_bytes
        return TEXEL_BYTES * self.texel_count + POINT_BYTES * len(self.points) + more

    @cached_property
    def bounds(self) -> Tensor:
        """(2,3) float64 bounding box."""
        parts = [p.world(p.corners) for p in self.planes] + [self.points.position]
        cloud = np.concatenate(parts) if parts else np.zeros((0, 3))
        if not len(cloud):
            return torch.zeros(2, 3, dtype=torch.float64)
        return torch.from_numpy(np.stack([cloud.min(0), cloud.max(0)]))

    @property
    def diagonal(self) -> float:
        """Length of the bounding box's diagonal."""
        return float((self.bounds[1] - self.bounds[0]).norm())

    def camera(self, name: str | None = None, *, width: int, height: int) -> Cameras:
        """As :meth:`Scene.camera`: ``frame0`` and so on are the photos' cameras, the first is the default."""
        return self._cameras_only.camera(name, width=width, height=height)

    @cached_property
    def _cameras_only(self) -> Scene:
        box = Mesh(vertices=self.bounds.clone(), faces=torch.tensor([[0, 1, 1]]))
        return Scene(meshes=(box,), cameras=self._named_cameras(), name=self.name)

    def _named_cameras(self) -> dict[str, Cameras]:
        if self.cameras is None:
            return {}
        return {f"frame{n}": self.cameras[n] for n in range(min(len(self.cameras), 64))}

    @cached_property
    def plane_scene(self) -> Scene:
        """The planes alone, as :meth:`scene` has them."""
        return self.scene(points=False)

    def scene(self, *, points: bool = True) -> Scene:
        """A scene of this project: planes as textured meshes, points as squares with vertex colours.

        The colours of photos hold their light already: ambient light is 1, nothing hides it a second time, and there
        are no lights, so that a picture shows them as they are. Lights that are added shade and shadow them like any
        other mesh.
        """
        meshes, materials = [], []
        for patch in self.planes:
            rgba = patch.texture.copy()
            rgba[..., 3] = np.where(patch.texture[..., 3] > 127, 255, 0)
            opaque = bool((rgba[..., 3] > 127).all())
            materials.append(
                Material(
                    name=f"plane {patch.plane}",
                    diffuse=torch.ones(3),
                    diffuse_texture=CodedTexture(rgba, 3),
                    alpha_cutoff=None if opaque else 0.5,
                )
            )
            mesh = patch.mesh
            meshes.append(
                Mesh(vertices=mesh.vertices, faces=mesh.faces, uv=mesh.uv, name=mesh.name, material=len(materials) - 1)
            )
        if points and len(self.points):
            materials.append(Material(name="points", diffuse=torch.ones(3)))
            meshes.append(self.point_mesh(len(materials) - 1))
        return Scene(
            meshes=tuple(meshes),
            materials=tuple(materials) or (Material(name="default"),),
            ambient=torch.ones(3),
            photo_light=True,
            cameras=self._named_cameras(),
            name=self.name,
        )

    def point_mesh(self, material: int = 0, scale: float = 1.5) -> Mesh:
        """Every point as a square on its tangent plane, ``scale`` footprints wide."""
        p = self.points
        n = p.normal.astype(np.float64)
        helper = np.eye(3)[np.abs(n).argmin(1)]
        a = np.cross(n, helper)
        a /= np.maximum(np.linalg.norm(a, axis=1, keepdims=True), 1e-12)
        b = np.cross(n, a)
        half = 0.5 * scale * p.footprint[:, None]
        corners = [p.position + half * (u * a + v * b) for u, v in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
        vertices = np.stack(corners, axis=1).reshape(-1, 3)
        first = 4 * np.arange(len(p))[:, None]
        faces = (first + np.array([0, 1, 2, 0, 2, 3])).reshape(-1, 3)
        colors = np.repeat(srgb_table(8).numpy()[p.color], 4, axis=0)
        return Mesh(
            vertices=torch.from_numpy(vertices),
            faces=torch.from_numpy(faces),
            colors=torch.from_numpy(colors.astype(np.float32)),
            name="points",
            material=material,
        )

    def cloud(self) -> PointCloud:
        """The points for :mod:`torchrender.points`.

        Raises:
            InputError: there are none.
        """
        p = self.points
        return PointCloud(
            position=torch.from_numpy(p.position),
            normal=torch.from_numpy(p.normal),
            radius=torch.from_numpy((0.75 * p.footprint).astype(np.float32)),
            color=torch.from_numpy(srgb_table(8).numpy()[p.color].astype(np.float32)),
            two_sided=True,
            name=self.name,
        )

    @cached_property
    def atlas(self) -> Atlas:
        """All textures with their mip levels."""
        return build_atlas([p.texture for p in self.planes])


@cache
def _fine_table() -> Array:
    """Linear light of fractions of a code."""
    fractions = torch.arange(255 * FINENESS + 1, dtype=torch.float64) / (255 * FINENESS)
    return np.asarray(linear_from_srgb(fractions).float().numpy())


def build_atlas(textures: list[Array]) -> Atlas:
    """Mip levels: means of two by two texels, colours weighted by alpha."""
    import cv2

    chains: list[list[Array]] = []
    for texture in textures:
        chain = [texture]
        level = texture.astype(np.float32)
        while max(level.shape[:2]) > 4:
            size = (max(level.shape[1] // 2, 1), max(level.shape[0] // 2, 1))
            level = cv2.resize(level, size, interpolation=cv2.INTER_AREA).reshape(size[1], size[0], 4)
            chain.append(np.rint(level).astype(np.uint8))
        chains.append(chain)
    most = max((len(c) for c in chains), default=1)
    offset, height, width = (np.zeros((len(chains), most), np.int64) for _ in range(3))
    place = 0
    for row, chain in enumerate(chains):
        for column, level in enumerate(chain):
            offset[row, column], (height[row, column], width[row, column]) = place, level.shape[:2]
            place += level.shape[0] * level.shape[1]
    flat = [level.reshape(-1, 4) for chain in chains for level in chain]
    texels = np.ascontiguousarray(np.concatenate(flat)) if flat else np.zeros((1, 4), np.uint8)
    levels = np.array([len(c) for c in chains], np.int64)
    codes = texels.view("<u4").reshape(-1).astype(np.uint32, copy=False)
    return Atlas(codes, offset, height, width, levels, _fine_table())
