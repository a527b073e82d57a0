"""The rasteriser: scene + cameras -> G-buffers, on the CPU and without OpenGL.

Coverage is exact: vertices are snapped to 1/32768 pixel, edges are integers, and a pixel centre on a shared edge or
vertex belongs to exactly one triangle, so closed meshes have neither cracks nor double hits. Depth and barycentrics
come from the unsnapped planes in float64. Equal depths go to the lower triangle id. Triangles that cross the near plane
are clipped; degenerate ones are ignored, and so are those that show what lies behind (:attr:`Geometry.panes`). Cost
follows what is in view: clusters of triangles outside the frustum, and their vertices, are never touched. Memory is one
index per triangle and tile it touches; there are no fragment lists.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import fields
from typing import Any, overload

import numpy as np
import torch
from torch import Tensor

from torchrender.arrays import Recycler, empty_aligned
from torchrender.buffers import GBuffer, VisibilityBuffer
from torchrender.checks import check_choice, check_class
from torchrender.errors import OptionError
from torchrender.fragment_tests import FragmentTests as FragmentTests
from torchrender.fragment_tests import earlier_arrays, limit_arrays, views_of
from torchrender.kernels.compile import thread_count
from torchrender.kernels.raster import draw_view
from torchrender.kernels.raster.chosen import NO_ATTRIBUTES, Wanted
from torchrender.kernels.raster.draw_view import TriangleArrays
from torchrender.kernels.raster.records import (
    NO_IDS,
    Limits,
    Nearer,
    Stored,
    Visible,
)
from torchrender.scene.camera import Cameras
from torchrender.scene.mesh import Geometry
from torchrender.scene.model import Scene
from torchrender.scene.triangles import Shape, check_fixed, check_scene, geometry_of
from torchrender.shading.attributes import DIRECT, SHAPES, SeenSurface, attribute_arrays_of, write_attributes

Array = np.ndarray[Any, Any]
NONE = np.zeros(0, np.bool_)
ONE_EACH = np.zeros(0, np.int32)
CULLING = ("none", "back", "front", "sides")
OUTPUTS = tuple(field.name for field in fields(GBuffer) if field.name != "cameras")
CHUNK = 1 << 20
"""Pixels that are drawn at a time where only some attributes are kept."""
SEEN = Visible._fields
_SHAPES: Mapping[str, tuple[tuple[int, ...], type]] = {
    "depth": ((), np.float32),
    "triangle": ((), np.int64),
    "object_id": ((), np.int64),
    "barycentric": ((2,), np.float32),
    **SHAPES,
}
"""Images that are written where they stay: what a pixel holds, and as what."""
_memory = Recycler(1 << 26)
_scratch = Recycler(1 << 26)
"""Of second looks at a few pixels, for which fresh pages would take longer than the looks."""


@overload
def rasterize(
    scene: Scene, cameras: Cameras, *, cull: str = "none", tests: FragmentTests | None = None, outputs: None = None
) -> GBuffer: ...
@overload
def rasterize(
    scene: Scene, cameras: Cameras, *, cull: str = "none", tests: FragmentTests | None = None, outputs: Sequence[str]
) -> dict[str, Tensor]: ...
def rasterize(
    scene: Scene,
    cameras: Cameras,
    *,
    cull: str = "none",
    tests: FragmentTests | None = None,
    outputs: Sequence[str] | None = None,
) -> GBuffer | dict[str, Tensor]:
    """The nearest surface in every pixel of B cameras, with all that shading needs.

    Args:
        scene: what to draw; an empty scene gives empty images.
        cameras: B perspective or orthographic cameras.
        cull: "back" drops triangles whose right-hand normal points away from the camera, "front" the others, "sides"
            the backs of single-sided materials.
        tests: fragments to refuse.
        outputs: names of attributes of :class:`~torchrender.buffers.GBuffer`, such as ``("depth", "normal",
            "object_id")``: only these are made and kept, a few cameras at a time, so that hundreds of views fit into
            memory. Returns them by name, (B,H,W) or (B,H,W,C), float32 or int64.

    Raises:
        OptionError: unknown ``cull`` or output. InputError: ``tests`` that do not fit the cameras.
        GradientError: meshes that ask for gradients, which there are none of.
    """
    check_class("cameras", cameras, Cameras)
    check_fixed("rasterize", check_scene("scene", scene))
    if outputs is None:
        return surface_attributes(scene, rasterize_visibility(scene.geometry, cameras, cull=cull, tests=tests))
    if isinstance(outputs, str):
        outputs = (outputs,)
    for name in outputs:
        check_choice("outputs", name, OUTPUTS)
    return _chosen(scene, cameras, (cull, tests), outputs)


def _chosen(
    scene: Scene, cameras: Cameras, how: tuple[str, FragmentTests | None], outputs: Sequence[str]
) -> dict[str, Tensor]:
    """Only these outputs, written where they stay; what else drawing needs is there for a few cameras at a time."""
    cull, tests = how
    check_choice("cull", cull, CULLING)
    shape = (len(cameras), cameras.height, cameras.width)
    kept: dict[str, Array] = {
        name: empty_aligned((*shape, *tail), kind)  # every pixel is written
        for name, (tail, kind) in _SHAPES.items()
        if name in outputs
    }
    direct = {name for name in DIRECT if name in outputs}
    further: dict[str, Tensor] = {}
    if set(outputs) == {"depth"} and tests is None:
        _draw(scene.geometry, cameras, cull, None, Visible(kept["depth"], *NO_IDS))
        return {"depth": torch.from_numpy(kept["depth"])}
    if tests is None and set(outputs) <= set(kept) and _whole_views(_triangle_arrays(scene.geometry), cameras):
        # What is not kept has room for one picture a thread.
        own = _room((thread_count(), *shape[1:]), {name: kept[name] for name in SEEN if name in kept})
        wanted = attribute_arrays_of(scene.geometry, cameras, {name: kept[name] for name in direct})
        _draw(scene.geometry, cameras, cull, None, Visible(**own), wanted)
        return {name: torch.from_numpy(kept[name]) for name in outputs}
    step = max(1, CHUNK // (cameras.width * cameras.height))
    for first in range(0, max(len(cameras), 1), step):
        part = slice(first, first + step)
        few = None if tests is None else tests.of(part)
        own = {name: kept[name][part] for name in SEEN if name in kept}
        seen = _visible(scene.geometry, cameras[part], (cull, few), own)
        write_attributes(scene.geometry, seen, {name: kept[name][part] for name in direct})
        made = surface_attributes(scene, seen)
        for name in set(outputs) - set(kept):
            if (values := getattr(made, name)) is None:
                raise OptionError(f"outputs: no mesh of the scene has {name}")
            further.setdefault(name, torch.zeros(len(cameras), *values.shape[1:], dtype=values.dtype))[part] = values
    return {name: torch.from_numpy(kept[name]) if name in kept else further[name] for name in outputs}


def surface_attributes(scene: Scene, seen: VisibilityBuffer) -> GBuffer:
    """The G-buffer of a visibility buffer of the same scene; its attributes are made when they are asked for."""
    return SeenSurface.of(scene.geometry, seen)


def rasterize_visibility(
    geometry: Shape, cameras: Cameras, *, cull: str = "none", tests: FragmentTests | None = None
) -> VisibilityBuffer:
    """Depth, triangle id, object id and barycentrics of the nearest surface in every pixel; see :func:`rasterize`."""
    return _visible(geometry_of("geometry", geometry), cameras, (cull, tests), {})


def rasterize_into(room: VisibilityBuffer, geometry: Geometry, *, cull: str = "none") -> None:
    """:func:`rasterize_visibility` of the cameras of ``room``, into its tensors."""
    _visible(geometry, room.cameras, (cull, None), {name: getattr(room, name).numpy() for name in SEEN})


def _room(shape: tuple[int, ...], known: Mapping[str, Array] | None = None) -> dict[str, Array]:
    known = known or {}
    return {n: known[n] if n in known else _memory.empty((*shape, *_SHAPES[n][0]), _SHAPES[n][1]) for n in SEEN}


def _visible(
    geometry: Geometry, cameras: Cameras, how: tuple[str, FragmentTests | None], room: Mapping[str, Array]
) -> VisibilityBuffer:
    """A visibility buffer in ``room``, images by name; those that are not there are new."""
    cull, tests = how
    check_choice("cull", cull, CULLING)
    shape = (len(cameras), cameras.height, cameras.width)
    images = _room(shape, room)  # every pixel is written
    _draw(geometry, cameras, cull, tests, Visible(**images))
    return VisibilityBuffer(cameras=cameras, **{name: torch.from_numpy(image) for name, image in images.items()})


class CameraPasses:
    """Several passes over what one camera sees; see :func:`camera_passes`."""

    def __init__(self, camera: Cameras, prepared: draw_view.PreparedView) -> None:
        self._camera = camera
        self._prepared = prepared

    def rasterize(self, tests: FragmentTests, room: VisibilityBuffer | None = None) -> VisibilityBuffer:
        """As :func:`rasterize_visibility`; ``room``: in its tensors."""
        camera, prepared = self._camera, self._prepared
        shape = (1, camera.height, camera.width)
        known = {} if room is None else {name: getattr(room, name).numpy() for name in SEEN}
        images = _room(shape, known)
        limits, earlier = limit_arrays(camera, 0, tests), earlier_arrays(camera, 0, tests, prepared.view)
        prepared.draw(limits, earlier, Visible(**{name: image[0] for name, image in images.items()}))
        return VisibilityBuffer(cameras=camera, **{name: torch.from_numpy(image) for name, image in images.items()})

    def rasterize_behind(
        self, tests: FragmentTests, seen: VisibilityBuffer, beyond: Tensor, pixels: tuple[Tensor, ...]
    ) -> None:
        """Replace what ``seen`` holds in ``pixels`` (N,): by fragments behind ``beyond`` (N,) that pass the tests.

        They are also of other triangles than those seen.
        """
        camera, prepared = self._camera, self._prepared
        rows, columns = (axis.numpy() for axis in pixels)
        shape = (camera.height, camera.width)
        keys = _scratch.empty(shape, np.float64)
        keys.fill(0.0)
        keys[rows, columns] = 1.0 / beyond.numpy()
        found = Visible(**{n: _scratch.empty((*shape, *_SHAPES[n][0]), _SHAPES[n][1]) for n in SEEN})
        earlier = earlier_arrays(camera, 0, tests, prepared.view)
        prepared.draw(Limits(keys, seen.triangle[0].numpy()), earlier, found, (rows, columns))
        for name, image in zip(SEEN, found, strict=True):
            getattr(seen, name).numpy()[0, rows, columns] = image[rows, columns]

    def count_nearer(
        self,
        seen: VisibilityBuffer,
        eps: tuple[float, float],
        pixels: tuple[Tensor, ...] | None = None,
        worth: Array = ONE_EACH,
        room: Tensor | None = None,
    ) -> tuple[Tensor, Tensor]:
        """How many surfaces lie before those of a visibility buffer.

        Args:
            seen: of the one camera, a perspective one, and of the same geometry. Depth 0 asks for nothing there.
            eps: relative and absolute distance (scene units) within which two surfaces are called touching.
            pixels: (N,) rows and columns: there alone.
            worth: (F,) int32 what each triangle counts, modulo 2^32; default: one.
            room: (H,W) int32, all zero: the count is written there, and a view of it returned.

        Returns:
            count (1,H,W) int32 of nearer surfaces, of all surfaces where empty; touching (1,H,W) bool: the nearest of
            them towards the stored one touches it. With ``pixels``, (N,) each.
        """
        depth, where = seen.depth[0].numpy(), None if pixels is None else (pixels[0].numpy(), pixels[1].numpy())
        touching = _scratch.empty(depth.shape, np.bool_)
        if where is None:
            number = np.zeros(depth.shape, np.int32) if room is None else room.numpy()
            touching.fill(False)
        else:
            every, depth, number = depth, _scratch.empty(depth.shape, np.float32), _scratch.empty(depth.shape, np.int32)
            depth.fill(0.0)
            depth[where] = every[where]
            number[where], touching[where] = 0, False  # whatever is counted elsewhere
        found = Nearer(number, touching, worth)
        self._prepared.count(Stored(depth, seen.triangle[0].numpy()), np.array(eps), found, where)
        count, touches = torch.from_numpy(number), torch.from_numpy(touching)
        return (count[None], touches[None]) if pixels is None else (count[pixels], touches[pixels])


@contextmanager
def camera_passes(geometry: Geometry, camera: Cameras, cull: str) -> Iterator[CameraPasses]:
    """Passes over one camera's triangles, which are projected and sorted into tiles once for all of them."""
    view, checks = next(views_of(geometry, camera, None))
    with draw_view.prepared_view(_triangle_arrays(geometry), view, cull, checks.holes) as prepared:
        yield CameraPasses(camera, prepared)


def rasterize_depth(geometry: Shape, cameras: Cameras, *, cull: str = "none") -> Tensor:
    """Camera depth (B,H,W) float32 of the nearest surface, +inf where empty: what a shadow map needs, and no more."""
    check_class("cameras", cameras, Cameras)
    check_choice("cull", cull, CULLING)
    depth = _memory.empty((len(cameras), cameras.height, cameras.width), np.float32)
    geometry = geometry_of("geometry", geometry)
    _draw(geometry, cameras, cull, None, Visible(depth, *NO_IDS))
    return torch.from_numpy(depth)


def _draw(
    geometry: Geometry,
    cameras: Cameras,
    cull: str,
    tests: FragmentTests | None,
    outputs: Visible,
    wanted: Wanted = NO_ATTRIBUTES,
) -> None:
    """Fill the images of all cameras: many small ones by whole cameras, others together by all threads.

    ``wanted``: attributes that are written, too, which small ones alone may ask for.
    """
    triangles = _triangle_arrays(geometry)
    views = views_of(geometry, cameras, tests)
    if tests is None and _whole_views(triangles, cameras):
        every = list(views)
        draw_view.draw_views(triangles, [view for view, _ in every], (cull, every[0][1].holes), outputs, wanted)
        return
    wants_ids = outputs.triangle.size > 0
    for k, (view, checks) in enumerate(views):
        one = Visible(*(image[k] for image in outputs)) if wants_ids else Visible(outputs.depth[k], *NO_IDS)
        draw_view.draw_view(triangles, view, cull, checks, one)


def _whole_views(triangles: TriangleArrays, cameras: Cameras) -> bool:
    return draw_view.suits_whole_views(triangles, len(cameras), cameras.width * cameras.height)


def _triangle_arrays(geometry: Geometry) -> TriangleArrays:
    geometry = geometry.solid
    _, faces, listed = geometry.numbering
    return TriangleArrays(
        vertices=geometry.numbered_vertices.numpy(),
        faces=faces.numpy(),
        listed=listed.numpy(),
        objects=geometry.object_id.numpy(),
        clusters=geometry.clusters.numpy(),
        cluster_bounds=geometry.cluster_bounds.numpy(),
        order=geometry.order.numpy(),
        block_starts=geometry.cluster_blocks[0].numpy(),
        blocks=geometry.cluster_blocks[1].numpy(),
        single_sided=NONE if geometry.single_sided is None else geometry.single_sided.numpy(),
    )
