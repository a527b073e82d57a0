"""Triangle meshes in world space, and the one concatenated geometry that rasteriser and ray caster share."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise

import numpy as np
import torch
from torch import Tensor

from torchrender.brief import brief
from torchrender.checks import ArrayLike, as_array, as_vector
from torchrender.errors import MeshError
from torchrender.kernels.meshes.culling_clusters import cluster_boxes, first_use, spatial_order, vertex_blocks
from torchrender.numerics.tangents import TangentTable
from torchrender.scene.cutout import Cutout
from torchrender.scene.parts.columns import finite_rows, joined, optional
from torchrender.scene.parts.mesh_fields import checked_fields, describe
from torchrender.scene.parts.normals import followed_normals, shared_corners
from torchrender.scene.primitives import arrays

CLUSTER = 128
"""Triangles per culling cluster at most: neighbours of one mesh."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Mesh:
    """Triangles of one material in world space. Lists and arrays of NumPy are taken as tensors.

    Raises:
        MeshError: wrong shapes, NaN or infinite vertices, colours, opacities or tangents, negative ones, vertices
            farther than 1e15 from the origin, or faces that name missing vertices; names the mesh.
    """

    vertices: Tensor  # (V,3) float32 or float64, scene units
    faces: Tensor  # (F,3) int64, counter-clockwise seen from outside
    name: str = "mesh"
    normals: Tensor | None = None  # (V,3) shading normals; None: the face's own normal
    uv: Tensor | None = None  # (V,2); (0,0) is the lower left corner of a texture
    uv1: Tensor | None = None  # (V,2) second set, for textures whose sampler asks for it
    tangents: Tensor | None = None  # (V,4) along u, and the sign of the bitangent; None: derived where needed
    colors: Tensor | None = None  # (V,3) linear RGB that multiplies the diffuse colour
    alpha: Tensor | None = None  # (V,) opacity that multiplies the material's
    material: int = 0  # index into Scene.materials
    object_id: int | None = None  # None: the mesh's place in the scene; several meshes may form one object

    __repr__ = brief

    @classmethod
    def box(cls, size: ArrayLike = 1.0, centre: ArrayLike = 0.0, *, name: str = "box", material: int = 0) -> Mesh:
        """A closed box along the axes: edge lengths (3,) or one number, scene units, about ``centre`` (3,).

        Raises:
            InputError: a length that is not positive.
        """
        return _placed(cls(**arrays.box(size)._asdict(), name=name, material=material), centre)

    @classmethod
    def sphere(
        cls,
        radius: float = 1.0,
        centre: ArrayLike = 0.0,
        *,
        segments: int = 64,
        name: str = "sphere",
        material: int = 0,
    ) -> Mesh:
        """A closed sphere of ``segments`` meridians and half as many parallels, about ``centre`` (3,).

        Raises:
            OptionError: a radius that is not positive, fewer than 4 or more than 2048 segments.
        """
        return _placed(cls(**arrays.sphere(radius, segments)._asdict(), name=name, material=material), centre)

    @classmethod
    def plane(cls, size: ArrayLike = 1.0, centre: ArrayLike = 0.0, *, name: str = "plane", material: int = 0) -> Mesh:
        """A horizontal rectangle that faces up (+y): sides along x and z (2,) or one number, about ``centre`` (3,).

        Raises:
            InputError: a side that is not positive.
        """
        return _placed(cls(**arrays.plane(size)._asdict(), name=name, material=material), centre)

    def __post_init__(self) -> None:
        for field, value in checked_fields(vars(self)).items():
            object.__setattr__(self, field, value)

    def with_vertices(self, vertices: ArrayLike) -> Mesh:
        """The mesh with its vertices at other places (V,3); its shading normals and tangents follow.

        Normals become the mean of the faces around each vertex, weighted by area; vertices that had one place and one
        normal, as along the seam of a texture, still have one. A mesh without normals has none. Where the move is one
        matrix, :meth:`transformed` is exact.

        Raises:
            MeshError: another number of vertices, or such that are not finite.
        """
        placed = as_array(f"mesh {self.name!r}: vertices", vertices, self.vertices.dtype, MeshError)
        if placed.shape != self.vertices.shape:
            wanted = tuple(self.vertices.shape)
            raise MeshError(f"mesh {self.name!r}: vertices must have shape {wanted}, got {tuple(placed.shape)}")
        moved = replace(self, vertices=placed, tangents=None)
        if self.normals is None:
            return moved
        shared = self._shared
        normals = followed_normals(moved.vertices, self.faces, shared, self.normals)
        moved = replace(moved, normals=normals)
        moved.__dict__["_shared"] = shared  # corners that meet on the way do not become one
        return moved

    @cached_property
    def _shared(self) -> Tensor:
        assert self.normals is not None
        return shared_corners(self.vertices, self.normals)

    def transformed(self, matrix: Tensor | Sequence[Sequence[float]]) -> Mesh:
        """Turned, moved, scaled or sheared by a (4,4) matrix; faces are turned round where it mirrors.

        Raises:
            MeshError: another shape, not finite, not affine, or singular.
        """
        told = f"mesh {self.name!r}: matrix"
        m = as_array(told, matrix, torch.float64, MeshError).double()
        if m.shape != (4, 4) or not bool(torch.isfinite(m).all()):
            raise MeshError(f"{told} must be finite with shape (4, 4), got {describe(m)}")
        linear, size = m[:3, :3], torch.linalg.det(m[:3, :3])
        if bool((m[3] != torch.tensor([0.0, 0.0, 0.0, 1.0], dtype=torch.float64)).any()):
            raise MeshError(f"{told} must have the last row 0 0 0 1, got {m[3].tolist()}")
        if not abs(float(size)) > 1e-12 * float(linear.abs().max()) ** 3:
            raise MeshError(f"{told} must be invertible, its determinant is {float(size):.3g}")
        vertices = (self.vertices.double() @ linear.T + m[:3, 3]).to(self.vertices.dtype)
        faces = self.faces if size > 0 else self.faces.flip(1)
        normals, tangents = self.normals, self.tangents
        if normals is not None:
            turned = torch.nn.functional.normalize(normals.double() @ torch.linalg.inv(linear), dim=1)
            normals = turned.to(normals.dtype)
        if tangents is not None:
            along = torch.nn.functional.normalize(tangents[:, :3].double() @ linear.T, dim=1)
            tangents = torch.cat([along, tangents[:, 3:].double() * size.sign()], dim=1).to(tangents.dtype)
        return replace(self, vertices=vertices, faces=faces, normals=normals, tangents=tangents)


@dataclass(frozen=True, eq=False)
class Geometry:
    """All triangles of a scene in one set of arrays; the row of ``faces`` is the triangle id everywhere."""

    vertices: Tensor  # (V,3) float64
    faces: Tensor  # (F,3) int32
    object_id: Tensor  # (F,) int64
    material: Tensor  # (F,) int64
    normals: Tensor | None  # (V,3) float32; a zero row means: use the face's own normal; None: no vertex has one
    uv: Tensor | None  # (V,2) float32; zero where a mesh has none
    colors: Tensor | None  # (V,3) float32; one where a mesh has none
    runs: Tensor  # (R+1,) int64: triangles runs[r] to runs[r+1] belong together, a mesh each
    cutout: Cutout | None = None  # triangles with holes
    uv1: Tensor | None = None  # (V,2) float32; zero where a mesh has none
    tangents: Tensor | None = None  # (V,4) float32; a zero row means: derive it from the texture coordinates
    tangent_table: TangentTable | None = None  # of triangles with normal maps
    alpha: Tensor | None = None  # (V,) float32; one where a mesh has none
    see_through: Tensor | None = None  # (F,) bool what lies behind shows, too: neither drawn nor hit as a solid
    single_sided: Tensor | None = None  # (F,) bool triangles that their front alone shows; None: all have two sides
    coherent: bool = False  # triangles already follow one another in space: sorting them would only cost time

    __repr__ = brief

    @property
    def triangle_count(self) -> int:
        return int(self.faces.shape[0])

    @cached_property
    def bounds(self) -> Tensor:
        """(2,3) float64 smallest and largest corner of all vertices that a face uses; zeros if there are none."""
        if not self.triangle_count:
            return torch.zeros(2, 3, dtype=torch.float64)
        low, high = self.cluster_bounds.unbind(1)
        return torch.stack([low.amin(0), high.amax(0)])

    @cached_property
    def order(self) -> Tensor:
        """(F,) int32 triangle ids; those of a cluster stand together and lie close together in space."""
        if self.coherent:
            return torch.arange(self.triangle_count, dtype=torch.int32)
        vertices, faces = self.vertices.numpy(), self.faces.numpy()
        return torch.from_numpy(spatial_order(vertices, faces, self.runs.numpy()))

    @property
    def solid(self) -> Geometry:
        """The triangles that hide what lies behind: the others have no area, so that ids stay."""
        return self if self.see_through is None else self._solid  # kept, it would keep itself alive

    @cached_property
    def _solid(self) -> Geometry:
        return replace(self if self.see_through is None else self.without(self.see_through), see_through=None)

    @cached_property
    def panes(self) -> Geometry:
        """The triangles that show what lies behind: the others have no area, so that ids stay."""
        hidden = torch.zeros(self.triangle_count, dtype=torch.bool) if self.see_through is None else self.see_through
        return replace(self.without(~hidden), see_through=None)

    def without(self, left_out: Tensor) -> Geometry:
        """The same, with no area of the triangles where ``left_out`` (F,) bool is set: they keep their ids."""
        return replace(self, faces=torch.where(left_out[:, None], self.faces[:, :1], self.faces))

    def part(self, chosen: Tensor) -> Geometry:
        """The triangles where ``chosen`` (F,) bool is set, renumbered so that neighbours in space follow one another.

        Vertices stay as they are; the runs become one.
        """
        order = self.order.long()
        rows = order[chosen[order]]
        return replace(
            self,
            faces=self.faces[rows],
            object_id=self.object_id[rows],
            material=self.material[rows],
            runs=torch.tensor([0, len(rows)]),
            cutout=None if self.cutout is None else replace(self.cutout, mask=self.cutout.mask[rows]),
            see_through=None if self.see_through is None else self.see_through[rows],
            single_sided=None if self.single_sided is None else self.single_sided[rows],
            tangent_table=None if (t := self.tangent_table) is None else replace(t, row=t.row[rows]),
            coherent=True,
        )

    @cached_property
    def clusters(self) -> Tensor:
        """(C,2) int64 first and one-past-last place in ``order`` of each culling cluster; clusters never mix runs."""
        runs = self.runs.tolist()
        pairs = [
            (first, min(first + CLUSTER, end)) for begin, end in pairwise(runs) for first in range(begin, end, CLUSTER)
        ]
        return torch.tensor(pairs, dtype=torch.int64).reshape(-1, 2)

    @cached_property
    def cluster_bounds(self) -> Tensor:
        """(C,2,3) float64 bounding box of each cluster."""
        boxes = torch.zeros(len(self.clusters), 2, 3, dtype=torch.float64)
        cluster_boxes(*(a.numpy() for a in (self.vertices, self.faces, self.order, self.clusters, boxes)))
        return boxes

    @cached_property
    def numbering(self) -> tuple[Tensor, Tensor, Tensor]:
        """Vertices as clusters first use them: what is drawn together lies together in memory.

        Returns:
            rows (N,) int32 of ``vertices``; faces (F,3) int32 in these numbers; the same faces in ``order``.
        """
        if self.coherent:
            return torch.arange(len(self.vertices), dtype=torch.int32), self.faces, self.faces
        made = first_use(self.faces.numpy(), self.order.numpy(), len(self.vertices))
        used, faces, listed = (torch.from_numpy(a) for a in made)
        return used, faces, listed

    @cached_property
    def numbered_vertices(self) -> Tensor:
        """(N,3) float64 vertices by :attr:`numbering`."""
        return self.vertices if self.coherent else self.vertices.index_select(0, self.numbering[0])

    @cached_property
    def numbered_holes(self) -> Tensor:
        """(N,3) float32 what :attr:`cutout` holds of its vertices, by :attr:`numbering`; it must be there."""
        assert self.cutout is not None
        return self.cutout.vertices if self.coherent else self.cutout.vertices.index_select(0, self.numbering[0])

    @cached_property
    def cluster_blocks(self) -> tuple[Tensor, Tensor]:
        """Blocks of numbered vertices that cluster c uses: ``blocks[starts[c]:starts[c + 1]]``; (C+1,) and (N,)."""
        used, faces, _ = self.numbering
        starts, blocks = vertex_blocks(faces.numpy(), self.order.numpy(), self.clusters.numpy(), len(used))
        return torch.from_numpy(starts), torch.from_numpy(blocks)

    @cached_property
    def face_normals(self) -> Tensor:
        """(F,3) float32 unit normals by the right-hand rule; zero for degenerate triangles."""
        a, b, c = (self.vertices[self.faces[:, k].long()] for k in range(3))
        cross = torch.linalg.cross(b - a, c - a)
        # Scaling first keeps the length from under- or overflowing for very small or very large triangles.
        scale = cross.abs().amax(dim=1, keepdim=True)
        cross = torch.where(scale > 0, cross / scale.clamp_min(1e-300), cross)
        return torch.nn.functional.normalize(cross, dim=1, eps=1e-30).float()


def concatenate(meshes: Sequence[Mesh]) -> Geometry:
    """One :class:`Geometry` from the meshes, in order."""
    counts = [len(m.vertices) for m in meshes]
    offsets = np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)
    sizes = [len(m.faces) for m in meshes]
    starts = np.concatenate([[0], np.cumsum(sizes)]).astype(np.int64)
    ids = [k if m.object_id is None else m.object_id for k, m in enumerate(meshes)]
    faces = [m.faces.to(torch.int64) + int(o) for m, o in zip(meshes, offsets, strict=False)]
    alpha = optional([None if m.alpha is None else m.alpha[:, None] for m in meshes], counts, 1, 1.0)
    return Geometry(
        vertices=joined([m.vertices.detach().double() for m in meshes], 3, torch.float64),
        faces=joined(faces, 3, torch.int64).to(torch.int32).contiguous(),
        object_id=torch.repeat_interleave(torch.tensor(ids, dtype=torch.int64), torch.tensor(sizes, dtype=torch.int64)),
        material=torch.repeat_interleave(
            torch.tensor([m.material for m in meshes], dtype=torch.int64), torch.tensor(sizes, dtype=torch.int64)
        ),
        normals=optional([finite_rows(m.normals) for m in meshes], counts, 3, 0.0),
        uv=optional([finite_rows(m.uv) for m in meshes], counts, 2, 0.0),
        colors=optional([m.colors for m in meshes], counts, 3, 1.0),
        runs=torch.from_numpy(starts),
        uv1=optional([finite_rows(m.uv1) for m in meshes], counts, 2, 0.0),
        tangents=optional([m.tangents for m in meshes], counts, 4, 0.0),
        alpha=None if alpha is None else alpha[:, 0].contiguous(),
    )


def _placed(mesh: Mesh, centre: ArrayLike) -> Mesh:
    place = as_vector("centre", centre, dtype=torch.float64)
    return replace(mesh, vertices=mesh.vertices + place) if bool(place.any()) else mesh
