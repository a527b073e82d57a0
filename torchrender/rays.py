"""The ray caster: first hits, next hits and occlusion of a scene's triangles.

Visibility is decided in float64 by a watertight test (:mod:`torchrender.kernels.rays.bvh`), so no ray slips through a
shared edge or vertex. With Embree, float32 only narrows down where that test has to look: Embree traces slightly grown
triangles and so bounds the nearest hit from below; the float64 tree searches a short piece of the ray from there on.
"""

from __future__ import annotations

import math
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import torch
from torch import Tensor

from torchrender.arrays import view
from torchrender.buffers import RayHits
from torchrender.checks import check_choice, check_finite, check_tensor
from torchrender.errors import InputError, OptionError
from torchrender.kernels.raster.records import Holes
from torchrender.kernels.rays.bvh import TIE, Rays, build_bvh, trace
from torchrender.kernels.rays.embree import SLACK, aim, grown_triangles
from torchrender.kernels.rays.ray_holes import hits_in_holes
from torchrender.scene.mesh import Geometry

BACKENDS = ("auto", "embree", "bvh")

_BATCH = 1 << 18  # rays resolved together: bounds the memory of the float32 copies
_CHUNK = 1 << 13  # rays of one Embree call
_THIN = 0.25  # share of triangles too thin for float32 from which on Embree cannot help: rays along spikes get lost
_ROUNDS = 3  # Embree bounds asked for before the tree searches the rest of a ray on its own


class RayCaster:
    """Casts rays against the triangles of a geometry.

    A hit lies strictly between ``t_min`` and ``t_max``, where ``t`` counts lengths of the direction vector. Hits whose
    ``t`` differ by less than 1e-12, relatively, are one surface: the lowest triangle id wins. Triangles without area
    are never hit. Rays have shape (N,3), or (...,3), then results have the leading shape.

    Args:
        geometry: vertices (V,3) float64, faces (F,3) int32; the row of a face is its triangle id.
        backend: "embree", "bvh" (no Embree needed, faster to build), or "auto": Embree where installed. A scene
            with very many triangles too thin for float32 is always left to the tree.

    Raises:
        OptionError: an unknown backend, or "embree" where embreex is not installed.
    """

    def __init__(self, geometry: Geometry, backend: str = "auto") -> None:
        check_choice("backend", backend, BACKENDS)
        embree = None if backend == "bvh" else _import_embree()
        if backend == "embree" and embree is None:
            raise OptionError('backend "embree" needs the embreex package, which is not installed')
        self.geometry = geometry
        self.backend = "bvh" if embree is None else "embree"
        self._bvh = build_bvh(view(geometry.vertices, np.float64), view(geometry.faces, np.int32))
        self._bound: _EmbreeBound | None = None
        if embree is not None and len(self._bvh.order):
            grown, thin = grown_triangles(self._bvh.corners, self._bvh.frame)
            if thin.mean() < _THIN:
                self._bound = _EmbreeBound(self._bvh.frame, grown, embree)

    @property
    def _holes(self) -> Holes | None:
        cutout, uv = self.geometry.cutout, self.geometry.uv
        if cutout is None or uv is None:
            return None
        return Holes(cutout.mask.numpy(), cutout.table.numpy(), cutout.texels.numpy(), uv.numpy())

    def rebuilt(self, vertices: Tensor) -> RayCaster:
        """The same faces with moved vertices (V,3), in scene units."""
        check_tensor("vertices", vertices, tuple(self.geometry.vertices.shape))
        check_finite("vertices", vertices)
        return RayCaster(replace(self.geometry, vertices=vertices.detach().double().contiguous()), self.backend)

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
        """Ray parameter, triangle and weights of each ray; rays that meet a hole in a triangle go on behind it."""
        if self._holes is None:
            return self._cast_solid(rays)
        rays = rays._replace(any_hit=False)  # any hit would not say what lies before it
        found = self._cast_solid(rays)
        index = np.arange(len(rays.origins))
        passed = np.zeros(len(index), np.bool_)
        while len(index):
            part = tuple(a[index] for a in found)
            hits_in_holes(part[1], part[2], self.geometry.faces.numpy(), self._holes, passed[: len(index)])
            chosen = np.flatnonzero(passed[: len(index)])
            index = index[chosen]
            rays = _pick(rays, chosen)
            span = np.stack([part[0][chosen], rays.span[:, 1]], axis=1)
            rays = rays._replace(span=span, window=span, ignore=part[1][chosen].astype(np.int32))
            for whole, more in zip(found, self._cast_solid(rays), strict=True):
                whole[index] = more
        return found

    def _cast_solid(self, rays: Rays) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        if self._bound is None:
            result: tuple[np.ndarray, np.ndarray, np.ndarray] = trace(self._bvh, rays)
            return result
        n = len(rays.origins)
        out = np.full(n, np.inf), np.full(n, -1, np.int64), np.zeros((n, 2), np.float32)
        for begin in range(0, n, _BATCH):
            batch = slice(begin, begin + _BATCH)
            self._resolve(_pick(rays, batch), tuple(o[batch] for o in out))
        return out

    def _resolve(self, rays: Rays, out: tuple[np.ndarray, ...]) -> None:
        """Embree's lower bound, then the tree from there on; what that leaves open goes round again."""
        assert self._bound is not None
        index: Any = slice(None)
        for _ in range(_ROUNDS):
            bounded, open_end = self._bound.narrow(rays)
            found = trace(self._bvh, bounded)
            for whole, part in zip(out, found, strict=True):
                whole[index] = part
            rest = np.flatnonzero(open_end & (found[1] < 0))
            if not len(rest):
                return
            index = rest if isinstance(index, slice) else index[rest]
            rays = _pick(rays, rest)
            rays.span[:, 0] = bounded.window[rest, 1]
        for whole, part in zip(out, trace(self._bvh, rays._replace(window=rays.span)), strict=True):
            whole[index] = part


class _EmbreeBound:
    """Embree over grown triangles: where the nearest hit of a ray can be at the earliest."""

    def __init__(self, frame: np.ndarray, triangles: np.ndarray, modules: tuple[Any, Any]) -> None:
        scenes, meshes = modules
        self._frame = frame
        self._scene = scenes.EmbreeScene()
        self._mesh = meshes.TriangleMesh(self._scene, triangles)
        # The first query builds Embree's tree; later ones may come from several threads.
        self._scene.run(np.zeros((1, 3), np.float32), np.ones((1, 3), np.float32))

    def narrow(self, rays: Rays) -> tuple[Rays, np.ndarray]:
        """The rays with window and seed from Embree, and (N,) whether anything can lie beyond the window."""
        start, toward, reach, unit = aim(self._frame, rays.origins, rays.directions, rays.span)
        slot, length = self._run(start, toward, reach)
        at = unit[:, 0] + length * unit[:, 1]
        slack = SLACK * unit[:, 1]
        hit = slot >= 0
        window = np.stack([np.where(hit, np.maximum(at - slack, rays.span[:, 0]), np.inf), at + slack], axis=1)
        np.minimum(window[:, 1], rays.span[:, 1], out=window[:, 1])
        return rays._replace(window=window, seed=slot), hit & (window[:, 1] < rays.span[:, 1])

    def _run(self, start: np.ndarray, toward: np.ndarray, reach: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        slot, length = np.full(len(start), -1, np.int32), np.zeros(len(start))

        def chunk(begin: int) -> None:
            part = slice(begin, begin + _CHUNK)
            found = self._scene.run(start[part], toward[part], dists=reach[part].copy(), output=True)
            slot[part], length[part] = found["primID"], found["tfar"]

        begins = range(0, len(start), _CHUNK)
        threads = min(torch.get_num_threads(), len(begins))
        if threads > 1:
            list(_pool(threads).map(chunk, begins))
        else:
            for begin in begins:
                chunk(begin)
        return slot, length


@cache
def _pool(threads: int) -> ThreadPoolExecutor:
    return ThreadPoolExecutor(threads, thread_name_prefix="torchrender-rays")


@cache
def _import_embree() -> tuple[Any, Any] | None:
    try:
        from embreex import mesh_construction, rtcore_scene
    except ImportError:
        return None
    return rtcore_scene, mesh_construction


def _pick(rays: Rays, index: Any) -> Rays:
    """Some of the rays."""
    return rays._replace(
        origins=rays.origins[index],
        directions=rays.directions[index],
        span=rays.span[index],
        window=rays.window[index],
        ignore=rays.ignore[index],
        seed=rays.seed[index],
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
    none = np.full(n, -1, np.int32)
    skip = none
    if ignore is not None:
        if not isinstance(ignore, Tensor) or ignore.is_floating_point() or ignore.shape != shape:
            raise InputError(f"ignore_triangle must be an integer tensor {tuple(shape)}, got {_describe(ignore)}")
        skip = view(ignore.reshape(n), np.int32)
    o, d = view(origins.reshape(n, 3), np.float64), view(directions.reshape(n, 3), np.float64)
    return Rays(o, d, span, span, skip, none, bool(cull), any_hit), shape


def _limit(name: str, value: Tensor | float, shape: torch.Size) -> np.ndarray:
    limit = torch.as_tensor(value, dtype=torch.float64)
    if limit.dim() and limit.shape != shape:
        raise InputError(f"{name} must be a number or have shape {tuple(shape)}, got {tuple(limit.shape)}")
    if bool(torch.isnan(limit).any()):
        raise InputError(f"{name} must not be NaN")
    return view(limit.expand(shape).reshape(-1), np.float64)


def _describe(value: object) -> str:
    return f"{value.dtype} {tuple(value.shape)}" if isinstance(value, Tensor) else type(value).__name__
