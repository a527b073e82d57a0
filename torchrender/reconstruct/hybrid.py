"""Meshes rebuilt from depth images: hybrid (one quad per sample), grid and splat.

Source: specification 02, sections 3 and 10.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import torch
from torch import Tensor

from torchrender.arrays import view
from torchrender.buffers import DepthImages, check_fixed_buffers
from torchrender.checks import check_class
from torchrender.kernels.warp import corner_mesh
from torchrender.kernels.warp.corners import DIAGONAL, FIRST, SECOND
from torchrender.reconstruct.corners import ReconstructOptions, SampleQuads, fit_corners
from torchrender.reconstruct.grid_mesh import fit_grid
from torchrender.scene.mesh import Geometry, Mesh


@dataclass(frozen=True, eq=False, kw_only=True)
class Reconstruction:
    """The meshes of B depth images in one set of arrays, image after image.

    Faces ``face_start[b]`` to ``face_start[b + 1] - 1`` belong to image b, likewise vertices. Within one image the mesh
    is closed wherever samples agree; meshes of different images share no vertices.
    """

    images: DepthImages
    vertices: Tensor  # (V,3) float64 world space
    faces: Tensor  # (F,3) int32, counter-clockwise seen from the camera
    colors: Tensor | None  # (V,3) linear
    approx: Tensor  # (V,) bool: guessed from a tangent plane
    corner: Tensor  # (V,) int64 j * (W + 1) + i of the vertex's image corner (hybrid) or j * W + i of its pixel
    face_pixel: Tensor  # (F,) int64 row of the sample in the flattened images (B*H*W,)
    vertex_start: Tensor  # (B+1,) int64
    face_start: Tensor  # (B+1,) int64
    true_corners: Tensor  # (5,) int64 hybrid quads with 0 to 4 corners from the offset image; zero for others

    @property
    def face_triangle(self) -> Tensor:
        """(F,) int64 id of the scene's triangle that each face stands for."""
        return self.images.triangle.reshape(-1)[self.face_pixel]

    @property
    def face_image(self) -> Tensor:
        """(F,) int64 image of each face."""
        sizes = self.face_start.diff()
        return torch.repeat_interleave(torch.arange(len(sizes)), sizes)

    def mesh(self, image: int, *, material: int = 0) -> Mesh:
        """The mesh of one image as a scene's mesh."""
        v0, v1 = (int(v) for v in self.vertex_start[image : image + 2])
        f0, f1 = (int(f) for f in self.face_start[image : image + 2])
        return Mesh(
            vertices=self.vertices[v0:v1],
            faces=self.faces[f0:f1].long() - v0,
            colors=None if self.colors is None else self.colors[v0:v1],
            name=f"image {image}",
            material=material,
            object_id=image,
        )

    @cached_property
    def geometry(self) -> Geometry:
        """All meshes as the rasteriser and the ray caster take them; the object id is the number of the image."""
        return Geometry(
            vertices=self.vertices,
            faces=self.faces,
            object_id=self.face_image,
            material=torch.zeros(len(self.faces), dtype=torch.int64),
            normals=None,
            uv=None,
            colors=self.colors,
            runs=self.face_start.long(),
            coherent=True,
        )


def reconstruct_hybrid(
    images: DepthImages,
    offset_images: DepthImages | None = None,
    options: ReconstructOptions | None = None,
    *,
    colors: bool = True,
) -> Reconstruction:
    """One quad for each filled pixel of B images, joined where samples lie on one surface (algorithm 4).

    Corners come from the offset images, which show the same views shifted by half a pixel; a corner that they do not
    confirm is guessed from the tangent plane. Without offset images all corners are guessed, and neighbours that agree
    share their mean. Faces 2q and 2q + 1 are quad q. A vertex has the mean colour of the samples that share it.

    Raises:
        InputError: orthographic cameras, or offset images of other views.
    """
    check_class("images", images, DepthImages)
    for name, given in (("images", images), ("offset_images", offset_images)):
        if given is not None:
            check_fixed_buffers("reconstruct_hybrid", name, given, but=("color",))
    return mesh_of_quads(fit_corners(images, offset_images, options), colors=colors)


def reconstruct_grid(
    images: DepthImages, options: ReconstructOptions | None = None, *, colors: bool = True
) -> Reconstruction:
    """Two triangles between four neighbouring pixel centres, where all samples lie on one surface.

    Simple and smooth, but isolated samples vanish and every depth edge loses half a pixel.
    """
    check_fixed_buffers("reconstruct_grid", "images", images, but=("color",))
    return mesh_of_quads(fit_grid(images, options), colors=colors)


def mesh_of_quads(quads: SampleQuads, *, colors: bool = True) -> Reconstruction:
    """The mesh of fitted quads, with or without vertex colours."""
    return _grid_mesh(quads, colors) if quads.centred else _hybrid_mesh(quads, colors)


def world_from_pixels(images: DepthImages) -> Tensor:
    """(B,3,4) float64: world point = z M[:, :3] (u, v, 1) + M[:, 3]."""
    inverse = images.cameras.world_from_camera
    rays = inverse[:, :3, :3] @ torch.linalg.inv(images.cameras.intrinsics)
    return torch.cat([rays, inverse[:, :3, 3:]], dim=2)


def _hybrid_mesh(quads: SampleQuads, colors: bool) -> Reconstruction:
    images = quads.images
    count, height, width = images.depth.shape
    joined, shape = quads.joined.numpy(), quads.shape.numpy()
    per_corner_row, per_row = np.zeros(count * (height + 1), np.int64), np.zeros(count * height, np.int64)
    corner_mesh.count_rows(joined, shape, per_corner_row, per_row)
    first_vertex = np.concatenate([[0], np.cumsum(per_corner_row)]).astype(np.int64)
    first_quad = np.concatenate([[0], np.cumsum(per_row)]).astype(np.int64)
    total, quad_total = int(first_vertex[-1]), int(first_quad[-1])
    texels = view(images.color, np.float32) if colors else np.zeros((0, 0, 0, 3), np.float32)
    # Every element below is written by the kernel.
    tint = np.empty((total if colors else 0, 3), np.float32)
    vertex = corner_mesh.Vertices(np.empty((total, 3)), np.empty(total, np.int64), np.empty(total, np.bool_), tint)
    source = np.empty(quad_total, np.int64)
    counts = np.zeros((count * height, 5), np.int64)
    face = corner_mesh.Faces(np.empty((2 * quad_total, 3), np.int32), source, counts)
    poses = np.ascontiguousarray(world_from_pixels(images).numpy())
    held = corner_mesh.Joined(quads.depth.numpy(), joined, shape)
    corner_mesh.write_mesh(held, poses, texels, first_vertex, first_quad, vertex, face)
    starts = torch.from_numpy(first_quad[:: max(height, 1)].copy())
    pixel = torch.from_numpy(source) + torch.repeat_interleave(torch.arange(count) * (height * width), starts.diff())
    return Reconstruction(
        images=images,
        vertices=torch.from_numpy(vertex.position),
        faces=torch.from_numpy(face.corners),
        colors=torch.from_numpy(tint) if colors else None,
        approx=torch.from_numpy(vertex.guessed),
        corner=torch.from_numpy(vertex.corner),
        face_pixel=pixel.repeat_interleave(2),
        vertex_start=torch.from_numpy(first_vertex[:: height + 1].copy()),
        face_start=2 * starts,
        true_corners=torch.from_numpy(counts.sum(axis=0)),
    )


def _grid_mesh(quads: SampleQuads, colors: bool) -> Reconstruction:
    """Vertices are the filled pixel centres that some face uses."""
    images = quads.images
    count, height, width = images.depth.shape
    shape = quads.shape
    b, j, i = shape.nonzero().unbind(1)
    bits = shape[b, j, i]
    base = (b * height + j) * width + i
    block = torch.stack([base, base + width, base + width + 1, base + 1], dim=1)
    turned = torch.where((bits & DIAGONAL > 0)[:, None], block.roll(-1, 1), block)
    faces = torch.stack([turned[:, [0, 1, 2]], turned[:, [2, 3, 0]]], dim=1).reshape(-1, 3)
    present = torch.stack([bits & FIRST > 0, bits & SECOND > 0], dim=1).reshape(-1)
    faces, image = faces[present], b.repeat_interleave(2)[present]
    used = torch.zeros(count * height * width, dtype=torch.bool)
    used[faces.reshape(-1)] = True
    pixels = used.nonzero().reshape(-1)
    number = torch.cumsum(used, 0) - 1
    position = images.cameras.unproject(
        images.cameras.pixel_centres().expand(count, -1, -1, -1), torch.where(images.covered, images.depth, 1.0)
    )
    per_image = torch.bincount(pixels // max(height * width, 1), minlength=count)
    zero = torch.zeros(1, dtype=torch.int64)
    return Reconstruction(
        images=images,
        vertices=position.reshape(-1, 3)[pixels].contiguous(),
        faces=number[faces].int().contiguous(),
        colors=images.color.reshape(-1, 3)[pixels].contiguous() if colors else None,
        approx=torch.zeros(len(pixels), dtype=torch.bool),
        corner=pixels % max(height * width, 1),
        face_pixel=faces[:, 0],
        vertex_start=torch.cat([zero, per_image.cumsum(0)]),
        face_start=torch.cat([zero, torch.bincount(image, minlength=count).cumsum(0)]),
        true_corners=torch.zeros(5, dtype=torch.int64),
    )
