"""Fragments that must not enter the depth buffer, and how kernels read that and the cameras."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from torch import Tensor

from torchrender.arrays import view as numpy_view
from torchrender.buffers import VisibilityBuffer
from torchrender.checks import check_choice, check_tensor
from torchrender.errors import InputError
from torchrender.kernels.raster.draw_view import View
from torchrender.kernels.raster.records import (
    NO_EARLIER,
    NO_HOLES,
    NO_LIMITS,
    Earlier,
    Frame,
    Holes,
    Limits,
    Refusals,
)
from torchrender.scene.camera import Cameras
from torchrender.scene.mesh import Geometry

Array = np.ndarray[Any, Any]
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


def limit_arrays(cameras: Cameras, k: int, tests: FragmentTests) -> Limits:
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


def views_of(geometry: Geometry, cameras: Cameras, tests: FragmentTests | None) -> Iterator[tuple[View, Refusals]]:
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
            limits = limit_arrays(cameras, k, tests)
            earlier = earlier_arrays(cameras, k, tests, view)
        yield view, Refusals(limits, earlier, holes)


def view_arrays(cameras: Cameras, k: int, world_from_camera: Array, planes: Array) -> View:
    """Camera ``k`` as the kernels read it."""
    intrinsics = cameras.intrinsics.numpy()[k].copy()
    intrinsics[0, 2] -= cameras.width >> 1
    intrinsics[1, 2] -= cameras.height >> 1
    rotation = cameras.camera_from_world.numpy()[k, :3, :3]
    near, far = float(cameras.near.numpy()[k]), float(cameras.far.numpy()[k])
    frame = Frame(cameras.width, cameras.height, near, far, cameras.orthographic)
    if not cameras.orthographic:
        return View(np.ascontiguousarray(intrinsics @ rotation), world_from_camera[:3, 3].copy(), planes, frame)
    # Counting from the world point under the image centre leaves no constant term.
    centre = np.linalg.solve(intrinsics[:2, :2], -intrinsics[:2, 2])
    reference = (world_from_camera @ np.array([centre[0], centre[1], 0.0, 1.0]))[:3]
    matrix = np.eye(3)
    matrix[:2, :2] = intrinsics[:2, :2]
    return View(np.ascontiguousarray(matrix @ rotation), reference, planes, frame)
