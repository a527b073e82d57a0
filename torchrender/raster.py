"""The rasteriser: scene + cameras -> G-buffers, on the CPU and without OpenGL.

Coverage is exact: vertices are snapped to 1/32768 pixel, edges are integers, and a pixel centre on a shared edge or
vertex belongs to exactly one triangle, so closed meshes have neither cracks nor double hits. Depth and barycentrics
come from the unsnapped planes in float64. Equal depths go to the lower triangle id. Triangles that cross the near plane
are clipped; degenerate ones are ignored, and so are those that show what lies behind (:attr:`Geometry.panes`). Cost
follows what is in view: clusters of triangles outside the frustum, and their vertices, are never touched. Memory is one
index per triangle and tile it touches; there are no fragment lists.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any, overload

import numpy as np
import torch
from torch import Tensor

from torchrender.arrays import Recycler
from torchrender.arrays import view as numpy_view
from torchrender.buffers import GBuffer, VisibilityBuffer
from torchrender.checks import check_choice, check_tensor
from torchrender.errors import InputError, OptionError
from torchrender.kernels.raster import draw_view
from torchrender.kernels.raster.draw_view import TriangleArrays, View
from torchrender.kernels.raster.records import (
    NO_EARLIER,
    NO_HOLES,
    NO_IDS,
    NO_LIMITS,
    Earlier,
    Frame,
    Holes,
    Limits,
    Nearer,
    Refusals,
    Stored,
    Visible,
)
from torchrender.scene.camera import Cameras
from torchrender.scene.mesh import Geometry
from torchrender.scene.model import Scene
from torchrender.scene.triangles import Shape, check_fixed, geometry_of
from torchrender.shading.attributes import SeenSurface

Array = np.ndarray[Any, Any]
NONE = np.zeros(0, np.bool_)
CULLING = ("none", "back", "front", "sides")
OUTPUTS = tuple(field.name for field in fields(GBuffer) if field.name != "cameras")
CHUNK = 1 << 20
"""Pixels that are drawn at a time where only some attributes are kept."""
_memory = Recycler(1 << 26)
PIXEL_TESTS = ("identity", "depth_identity", "captured")  # in the order of kernels.fragments


@dataclass(frozen=True, eq=False, kw_only=True)
class FragmentTests:
    """Fragments that must not enter the depth buffer; both tests may be combined.

    Peeling: only fragments with camera depth greater than ``beyond`` and of another triangle than ``skip`` count.
    Redundancy: a fragment is refused if an image in ``earlier`` stores the same triangle in the pixel into which the
    fragment projects (specification 01, section 5, algorithm 3); perspective cameras only. Beyond the thesis (section
    13), test "depth_identity" refuses it where the depth stored there agrees within two pixel footprints, or one of the
    nearest 2 x 2 pixels stores the triangle; test "captured" wherever the pixel stores nothing nearer, because then
    that camera saw the fragment even if no pixel centre hit it. A copy whose footprint on the surface is more than
    ``quality_ratio`` times larger does not count.
    """

    beyond: Tensor | None = None  # (B,H,W) float32 or float64 camera depth; +inf lets nothing through
    skip: Tensor | None = None  # (B,H,W) int64 triangle ids, -1 for none
    earlier: VisibilityBuffer | None = None  # J images of the same geometry
    test: str = "identity"  # one of PIXEL_TESTS
    quality_ratio: float = math.inf

    def __post_init__(self) -> None:
        check_choice("tests.test", self.test, PIXEL_TESTS)

    def of(self, part: slice) -> FragmentTests:
        """Those of some of the cameras."""
        beyond, skip = (None if one is None else one[part] for one in (self.beyond, self.skip))
        return replace(self, beyond=beyond, skip=skip)


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
    check_fixed("rasterize", scene)
    if outputs is None:
        return surface_attributes(scene, rasterize_visibility(scene.geometry, cameras, cull=cull, tests=tests))
    if isinstance(outputs, str):
        outputs = (outputs,)
    for name in outputs:
        check_choice("outputs", name, OUTPUTS)
    if set(outputs) == {"depth"} and tests is None:
        return {"depth": rasterize_depth(scene.geometry, cameras, cull=cull)}
    kept: dict[str, Tensor] = {}
    step = max(1, CHUNK // (cameras.width * cameras.height))
    for first in range(0, max(len(cameras), 1), step):
        part = slice(first, first + step)
        few = None if tests is None else tests.of(part)
        made = surface_attributes(scene, rasterize_visibility(scene.geometry, cameras[part], cull=cull, tests=few))
        for name in outputs:
            values = _kept(name, getattr(made, name))
            if name not in kept:
                kept[name] = torch.zeros(len(cameras), *values.shape[1:], dtype=values.dtype)
            kept[name][part] = values
    return kept


def _kept(name: str, values: Tensor | None) -> Tensor:
    if values is None:
        raise OptionError(f"outputs: no mesh of the scene has {name}")
    return values.float() if values.is_floating_point() else values


def surface_attributes(scene: Scene, seen: VisibilityBuffer) -> GBuffer:
    """The G-buffer of a visibility buffer of the same scene; its attributes are made when they are asked for."""
    return SeenSurface.of(scene.geometry, seen)


def rasterize_visibility(
    geometry: Shape, cameras: Cameras, *, cull: str = "none", tests: FragmentTests | None = None
) -> VisibilityBuffer:
    """Depth, triangle id, object id and barycentrics of the nearest surface in every pixel; see :func:`rasterize`."""
    shape = (len(cameras), cameras.height, cameras.width)
    # Every pixel is written.
    depth = _memory.empty(shape, np.float32)
    triangle, objects = _memory.empty(shape, np.int64), _memory.empty(shape, np.int64)
    barycentric = _memory.empty((*shape, 2), np.float32)
    check_choice("cull", cull, CULLING)
    geometry = geometry_of("geometry", geometry)
    _draw(geometry, cameras, cull, tests, Visible(depth, triangle, objects, barycentric))
    return VisibilityBuffer(
        cameras=cameras,
        depth=torch.from_numpy(depth),
        triangle=torch.from_numpy(triangle),
        object_id=torch.from_numpy(objects),
        barycentric=torch.from_numpy(barycentric),
    )


def count_nearer(
    geometry: Geometry, seen: VisibilityBuffer, *, cull: str = "none", eps: tuple[float, float] = (0.0, 0.0)
) -> tuple[Tensor, Tensor]:
    """How many surfaces lie before those of a visibility buffer.

    Args:
        seen: B images, of the same geometry, with perspective cameras. Depth 0 asks for nothing there.
        eps: relative and absolute distance (scene units) within which two surfaces are called touching.

    Returns:
        count (B,H,W) int32 of nearer surfaces, of all surfaces where empty; touching (B,H,W) bool: the nearest of them
        towards the stored one touches it.
    """
    check_choice("cull", cull, CULLING)
    shape = tuple(seen.triangle.shape)
    count, touching = np.zeros(shape, np.int32), np.zeros(shape, np.bool_)
    stored = seen.depth.numpy(), seen.triangle.numpy()
    triangles = _triangle_arrays(geometry)
    for k, (view, checks) in enumerate(_views(geometry, seen.cameras, None)):
        draw_view.count_view(
            triangles,
            view,
            cull,
            checks.holes,
            Stored(stored[0][k], stored[1][k]),
            np.array(eps),
            Nearer(count[k], touching[k]),
        )
    return torch.from_numpy(count), torch.from_numpy(touching)


def rasterize_depth(geometry: Shape, cameras: Cameras, *, cull: str = "none") -> Tensor:
    """Camera depth (B,H,W) float32 of the nearest surface, +inf where empty: what a shadow map needs, and no more."""
    check_choice("cull", cull, CULLING)
    depth = _memory.empty((len(cameras), cameras.height, cameras.width), np.float32)
    geometry = geometry_of("geometry", geometry)
    _draw(geometry, cameras, cull, None, Visible(depth, *NO_IDS))
    return torch.from_numpy(depth)


def _draw(geometry: Geometry, cameras: Cameras, cull: str, tests: FragmentTests | None, outputs: Visible) -> None:
    """Fill the images of all cameras: many small ones by whole cameras, others together by all threads."""
    triangles = _triangle_arrays(geometry)
    views = _views(geometry, cameras, tests)
    if tests is None and draw_view.suits_whole_views(triangles, len(cameras), cameras.width * cameras.height):
        every = list(views)
        draw_view.draw_views(triangles, [view for view, _ in every], cull, every[0][1].holes, outputs)
        return
    wants_ids = outputs.triangle.size > 0
    for k, (view, checks) in enumerate(views):
        one = Visible(*(image[k] for image in outputs)) if wants_ids else Visible(outputs.depth[k], *NO_IDS)
        draw_view.draw_view(triangles, view, cull, checks, one)


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


def _views(geometry: Geometry, cameras: Cameras, tests: FragmentTests | None) -> Iterator[tuple[View, Refusals]]:
    """Each camera as the kernels read it, with its fragment tests."""
    planes = cameras.frustum_planes().numpy()
    world_from_camera = cameras.world_from_camera.numpy()
    holes = NO_HOLES
    if geometry.cutout is not None:
        cutout = geometry.cutout
        corners = geometry.solid.numbered_holes
        holes = Holes(cutout.mask.numpy(), cutout.table.numpy(), cutout.texels.numpy(), corners.numpy())
    for k in range(len(cameras)):
        view = view_arrays(cameras, k, world_from_camera[k], planes[k])
        limits = NO_LIMITS
        earlier = NO_EARLIER
        if tests is not None:
            limits = _limits(cameras, k, tests)
            earlier = earlier_arrays(cameras, k, tests, view)
        yield view, Refusals(limits, earlier, holes)


def view_arrays(cameras: Cameras, k: int, world_from_camera: Array, planes: Array) -> View:
    """Camera ``k`` as the kernels read it."""
    intrinsics = cameras.intrinsics[k].numpy().copy()
    intrinsics[0, 2] -= cameras.width >> 1
    intrinsics[1, 2] -= cameras.height >> 1
    rotation = cameras.rotation[k].numpy()
    near, far = float(cameras.near[k]), float(cameras.far[k])
    frame = Frame(cameras.width, cameras.height, near, far, cameras.orthographic)
    if not cameras.orthographic:
        return View(np.ascontiguousarray(intrinsics @ rotation), world_from_camera[:3, 3].copy(), planes, frame)
    # Counting from the world point under the image centre leaves no constant term.
    centre = np.linalg.solve(intrinsics[:2, :2], -intrinsics[:2, 2])
    reference = (world_from_camera @ np.array([centre[0], centre[1], 0.0, 1.0]))[:3]
    matrix = np.eye(3)
    matrix[:2, :2] = intrinsics[:2, :2]
    return View(np.ascontiguousarray(matrix @ rotation), reference, planes, frame)


def _limits(cameras: Cameras, k: int, tests: FragmentTests) -> Limits:
    """Peeling limits of one camera, as keys that grow towards the camera."""
    if tests.beyond is None and tests.skip is None:
        return NO_LIMITS
    shape = (len(cameras), cameras.height, cameras.width)
    key = np.full(shape[1:], np.inf)
    skip = np.full(shape[1:], -2, np.int64)
    if tests.beyond is not None:
        depth = numpy_view(check_tensor("tests.beyond", tests.beyond, shape)[k], np.float64)
        with np.errstate(divide="ignore"):
            key = -depth if cameras.orthographic else np.where(depth > 0, 1.0 / depth, np.inf)
    if tests.skip is not None:
        skip = numpy_view(check_tensor("tests.skip", tests.skip, shape)[k], np.int64)
    return Limits(key, skip)


def earlier_arrays(cameras: Cameras, k: int, tests: FragmentTests, view: View) -> Earlier:
    """Earlier images, and how the pixels of camera ``k`` map into them."""
    earlier = tests.earlier
    if earlier is None or len(earlier.cameras) == 0:
        return NO_EARLIER
    if cameras.orthographic or earlier.cameras.orthographic:
        raise InputError("tests.earlier needs perspective cameras")
    other = earlier.cameras
    world_from_pixel = np.linalg.inv(view.matrix)
    intrinsics = other.intrinsics.numpy()
    project = intrinsics @ other.rotation.numpy()
    shift = intrinsics @ other.camera_from_world[:, :3, 3:].numpy()
    offset = project @ view.reference[:, None] + shift
    pixels = np.concatenate([project @ world_from_pixel, offset], axis=2)
    lens = np.zeros((len(other), 9))
    lens[:, :5] = intrinsics[:, (0, 1, 0, 1, 0), (0, 1, 2, 2, 1)]
    lens[:, 5] = (1.0 / intrinsics[:, (0, 1), (0, 1)]).max(axis=1)
    lens[:, 6:] = (other.eye.numpy() - view.reference) @ view.matrix.T
    size = float((1.0 / cameras.intrinsics[k, (0, 1), (0, 1)]).max())
    return Earlier(
        ids=numpy_view(earlier.triangle, np.int64),
        pixels=np.ascontiguousarray(pixels),
        near=other.near.numpy(),
        depth=numpy_view(earlier.depth, np.float32),
        lenses=lens,
        matrix=view.matrix,
        inverse=world_from_pixel,
        test=PIXEL_TESTS.index(tests.test),
        ratio=float(tests.quality_ratio),
        footprint=size,
    )
