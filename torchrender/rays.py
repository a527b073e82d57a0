"""The ray caster: first hits, next hits and occlusion of a scene's triangles.

Visibility is decided in float64 by a watertight test (:mod:`torchrender.kernels.rays.watertight`), so no ray slips
through a shared edge or vertex. With Embree, float32 only chooses the boxes that are opened: Embree's tree holds padded
boxes, and the test runs in its callback (:mod:`torchrender.kernels.rays.embree`). Without it, rays walk a tree of ours.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import torch
from torch import Tensor

from torchrender.arrays import view
from torchrender.buffers import RayHits
from torchrender.checks import as_array, check_choice, check_finite, check_no_gradient, check_tensor
from torchrender.errors import InputError, OptionError
from torchrender.kernels.raster.records import NO_HOLES, Holes
from torchrender.kernels.rays.bvh import trace
from torchrender.kernels.rays.bvh_build import Bvh, build_bvh
from torchrender.kernels.rays.embree_library import embree
from torchrender.kernels.rays.embree_scene import QUICK, USUAL, EmbreeScene
from torchrender.kernels.rays.watertight import TIE, Rays
from torchrender.scene.mesh import Geometry
from torchrender.scene.triangles import Shape, geometry_of

BACKENDS = ("auto", "embree", "bvh")

_COARSE = 0.25  # share of boxes that float32 cannot tell apart from which on Embree cannot help


class RayCaster:
    """Casts rays against the triangles of a geometry.

    A hit lies strictly between ``t_min`` and ``t_max``, where ``t`` counts lengths of the direction vector. Hits whose
    ``t`` differ by less than 1e-12, relatively, are one surface: the lowest triangle id wins. Triangles without area
    are never hit, nor are those that show what lies behind (:attr:`Geometry.panes`), nor what a cut-out
    leaves out of a triangle. Rays have shape (N,3), or (...,3), then results have
    the leading shape. Several threads may cast at once. A copy through ``pickle`` builds its tree anew.

    Args:
        geometry: a scene, a mesh, or triangles: vertices (V,3) float64, faces (F,3) int32; the row of a face is its id.
        backend: "embree", "bvh" (no Embree needed), or "auto": Embree where it is installed and of a known version. A
            scene whose triangles are mostly too small for float32, beside its whole extent, is always left to the tree.

    Attributes:
        backend: "embree" or "bvh", as asked for or found.

    Raises:
        OptionError: an unknown backend, or "embree" where embreex is not installed or not usable.
    """

    def __init__(self, geometry: Shape, backend: str = "auto") -> None:
        self._set_up(geometry_of("geometry", geometry), backend, USUAL)

    def _set_up(self, geometry: Geometry, backend: str, quality: int) -> None:
        check_choice("backend", backend, BACKENDS)
        usable = backend != "bvh" and embree() is not None
        if backend == "embree" and not usable:
            raise OptionError('backend "embree" needs the embreex package, which is not installed or not usable')
        self.geometry = geometry
        self.backend = "embree" if usable else "bvh"
        vertices, self._faces = view(geometry.vertices, np.float64), view(geometry.solid.faces, np.int32)
        self._holes = holes_of(geometry)
        self._tree: Bvh | None = None
        self._boxes: EmbreeScene | None = None
        if usable:
            boxes = EmbreeScene(vertices, self._faces, quality)
            if boxes.coarseness < _COARSE:
                self._boxes = boxes
                return
        self._tree = build_bvh(vertices, self._faces)

    def __reduce__(self) -> tuple[Any, ...]:
        return RayCaster, (self.geometry, self.backend)

    def rebuilt(self, vertices: Tensor) -> RayCaster:
        """The same faces with other vertices (V,3), in scene units."""
        return self._with(vertices, USUAL)

    def moved(self, vertices: Tensor) -> RayCaster:
        """As :meth:`rebuilt`, with a tree that is built two to four times quicker and traced up to two times slower.

        For what changes with every picture and sees few rays.
        """
        return self._with(vertices, QUICK)

    def following(self, geometry: Geometry) -> RayCaster | None:
        """As :meth:`moved`, for a geometry of the same faces; None where it has others, or other holes."""
        own = self.geometry
        if geometry.faces is not own.faces or geometry.uv is not own.uv or geometry.cutout is not own.cutout:
            return None
        other = self.moved(geometry.vertices)
        other.geometry = geometry
        return other

    def _with(self, vertices: Tensor, quality: int) -> RayCaster:
        check_tensor("vertices", vertices, tuple(self.geometry.vertices.shape))
        check_finite("vertices", vertices)
        other = RayCaster.__new__(RayCaster)
        geometry = replace(self.geometry, vertices=vertices.detach().double().contiguous())
        other._set_up(geometry, self.backend, quality)
        return other

    def first_hit(
        self,
        origins: Tensor,
        directions: Tensor,
        *,
        t_min: Tensor | float = 0.0,
        t_max: Tensor | float = math.inf,
        cull_backfaces: bool = False,
    ) -> RayHits:
        """Nearest hit of each ray.

        Args:
            origins: (N,3) world space.
            directions: (N,3), any length but zero.
            t_min: number or (N,); hits at or before it do not count.
            t_max: number or (N,); hits at or after it do not count.
            cull_backfaces: ignore triangles whose right-hand normal points away from the ray's origin.

        Raises:
            InputError: wrong shapes, NaN or infinite rays, zero directions, NaN limits; names the argument.
            GradientError: rays that ask for gradients, which hits do not give.
        """
        rays, shape = _rays(origins, directions, t_min, t_max, None, cull_backfaces)
        return _hits(self._cast(rays), shape)

    def next_hit(
        self,
        origins: Tensor,
        directions: Tensor,
        hits_t: Tensor,
        ignore_triangle: Tensor,
        *,
        t_max: Tensor | float = math.inf,
        cull_backfaces: bool = False,
    ) -> RayHits:
        """Nearest hit of each ray beyond ``hits_t`` on another triangle.

        Args:
            origins, directions, t_max, cull_backfaces: as in :meth:`first_hit`.
            hits_t: (N,) hits at or before it, or less than 1e-12 after it, relatively, do not count; +inf: a miss.
            ignore_triangle: (N,) int64 triangle that does not count, -1 for none.

        Raises:
            InputError: as in :meth:`first_hit`.
        """
        origins = as_array("origins", origins)
        beyond = torch.from_numpy(_limit("hits_t", hits_t, origins.shape[:-1])).reshape(origins.shape[:-1])
        beyond = torch.where(torch.isinf(beyond), beyond, beyond + TIE * beyond.abs())
        rays, shape = _rays(origins, directions, beyond, t_max, ignore_triangle, cull_backfaces)
        return _hits(self._cast(rays), shape)

    def occluded(
        self,
        origins: Tensor,
        directions: Tensor,
        *,
        t_min: Tensor | float = 0.0,
        t_max: Tensor | float = math.inf,
        cull_backfaces: bool = False,
    ) -> Tensor:
        """(N,) bool: something is hit between ``t_min`` and ``t_max``. Arguments and errors as in :meth:`first_hit`."""
        rays, shape = _rays(origins, directions, t_min, t_max, None, cull_backfaces, any_hit=True)
        return torch.from_numpy(self._cast(rays)[1] >= 0).reshape(shape)

    def _cast(self, rays: Rays) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Ray parameter, triangle and weights of each ray."""
        if self._boxes is not None:
            return self._boxes.cast(rays, self._holes)
        found: tuple[np.ndarray, np.ndarray, np.ndarray] = trace(self._tree, rays, self._faces, self._holes)
        return found


def holes_of(geometry: Geometry) -> Holes:
    """The missing texels of its triangles, as kernels read them."""
    cutout = geometry.cutout
    if cutout is None:
        return NO_HOLES
    return Holes(
        view(cutout.mask, np.int32),
        view(cutout.table, np.int64),
        view(cutout.texels, np.uint8),
        view(cutout.vertices, np.float32),
    )


def _hits(found: tuple[np.ndarray, np.ndarray, np.ndarray], shape: torch.Size) -> RayHits:
    t, triangle, weights = (torch.from_numpy(a) for a in found)
    return RayHits(t.reshape(shape), triangle.reshape(shape), weights.reshape(*shape, 2))


def _rays(
    origins: Tensor,
    directions: Tensor,
    t_min: Tensor | float,
    t_max: Tensor | float,
    ignore: Tensor | None,
    cull: bool,
    any_hit: bool = False,
) -> tuple[Rays, torch.Size]:
    """Checked rays as flat arrays, and their leading shape."""
    origins, directions = as_array("origins", origins), as_array("directions", directions)
    check_no_gradient("casting rays", origins=origins, directions=directions)
    for name, value in (("origins", origins), ("directions", directions)):
        if not isinstance(value, Tensor) or not value.is_floating_point() or value.shape[-1:] != (3,):
            raise InputError(f"{name} must be a float tensor (..., 3), got {_describe(value)}")
        check_finite(name, value)
    if origins.shape != directions.shape:
        raise InputError(f"directions must have shape {tuple(origins.shape)}, got {tuple(directions.shape)}")
    zero = (directions == 0).all(dim=-1)
    if bool(zero.any()):
        raise InputError(f"directions must not be zero: {int(zero.sum())} of {zero.numel()} are")
    shape = origins.shape[:-1]
    n = shape.numel()
    span = np.stack([_limit("t_min", t_min, shape), _limit("t_max", t_max, shape)], axis=1)
    skip = np.full(n, -1, np.int32)
    if ignore is not None:
        if not isinstance(ignore, Tensor) or ignore.is_floating_point() or ignore.shape != shape:
            raise InputError(f"ignore_triangle must be an integer tensor {tuple(shape)}, got {_describe(ignore)}")
        skip = view(ignore.reshape(n), np.int32)
    o, d = view(origins.reshape(n, 3), np.float64), view(directions.reshape(n, 3), np.float64)
    return Rays(o, d, span, skip, bool(cull), any_hit), shape


def _limit(name: str, value: Tensor | float, shape: torch.Size) -> np.ndarray:
    limit = torch.as_tensor(value, dtype=torch.float64)
    if limit.dim() and limit.shape != shape:
        raise InputError(f"{name} must be a number or have shape {tuple(shape)}, got {tuple(limit.shape)}")
    if bool(torch.isnan(limit).any()):
        raise InputError(f"{name} must not be NaN")
    return view(limit.expand(shape).reshape(-1), np.float64)


def _describe(value: object) -> str:
    return f"{value.dtype} {tuple(value.shape)}" if isinstance(value, Tensor) else type(value).__name__
