"""Quads that stand for the samples of depth images: one per filled pixel, joined where samples lie on one surface.

Source: specification 02, sections 3.1 to 3.3 and 10. Loops run in :mod:`torchrender.kernels.warp.corners`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from torch import Tensor
from torch.utils.weak import WeakIdKeyDictionary

from torchrender.arrays import Recycler, view
from torchrender.buffers import DepthImages
from torchrender.checks import check_range, check_tensor, checked_fields, options_of
from torchrender.errors import InputError
from torchrender.kernels.compile import thread_count
from torchrender.kernels.warp import corners as kernels
from torchrender.kernels.warp.quads import flat_blocks

SAME_VIEW = 1e-6  # pixels that an offset camera may be off
_KEPT: WeakIdKeyDictionary = WeakIdKeyDictionary()
_memory = Recycler(1 << 27)


@dataclass(frozen=True, kw_only=True)
@checked_fields
class ReconstructOptions:
    """How samples become quads.

    A corner of the offset image belongs to a sample if it lies within ``footprint_tolerance`` (tau_a) footprints plus
    ``slope_tolerance`` (tau_b) times the tangent plane's own change of depth of that tangent plane.

    Raises:
        OptionError: a value outside its range; names it.
    """

    footprint_tolerance: float = 2.0  # footprints
    slope_tolerance: float = 0.5
    guess_ratio: float = 1.1  # a guessed corner lies within [z / rho, z * rho] of its sample's depth z: rho
    match_id: bool = False  # a corner must also show the sample's object
    merge_guesses: bool = True  # neighbours whose guesses agree share one corner: closes cracks between them
    adaptive_split: bool = True  # split quads along the diagonal with the smaller depth difference

    def __post_init__(self) -> None:
        check_range("footprint_tolerance", self.footprint_tolerance, 0.5, 8.0)
        check_range("slope_tolerance", self.slope_tolerance, 0.0, 1.0)
        check_range("guess_ratio", self.guess_ratio, 1.01, 2.0)


@dataclass(frozen=True, eq=False)
class SampleQuads:
    """The quads of B depth images, before they become a mesh: four corner depths for each pixel.

    Corners 0 to 3 are top left, bottom left, bottom right and top right. ``centred`` quads (grid reconstruction) have
    the centres of 2 x 2 pixels as corners, and one quad less in each direction. ``joined`` and ``shape`` are bit
    fields, see :mod:`torchrender.kernels.warp.corners`.
    """

    images: DepthImages
    depth: Tensor  # (B,h,4,w) float32 camera z; +inf where there is none
    shape: Tensor  # (B,h,w) uint8 triangles of each quad and its diagonal; 0 where there is none
    joined: Tensor  # (B,H+1,W+1) int32 which of the four pixels around each image corner share a surface
    planes: Tensor  # (B,.,.,4) float64 of blocks of quads, see :mod:`torchrender.kernels.warp.quads.flat_blocks`
    centred: bool

    @property
    def quad_count(self) -> int:
        return int((self.shape != 0).sum())


def fit_corners(
    images: DepthImages, offset_images: DepthImages | None = None, options: ReconstructOptions | None = None
) -> SampleQuads:
    """Corner depths of the quad of every sample of B images (B,H,W): hybrid reconstruction without its mesh.

    A corner that the offset image confirms is taken from there; any other is guessed from the sample's tangent plane.
    Without offset images every corner is guessed, and neighbours whose guesses agree share the mean of them.

    Args:
        images: perspective depth images with unit normals (a zero normal stands for a plane that faces the camera).
        offset_images: the same views through ``images.cameras.sub_camera(-0.5, -0.5, W + 1, H + 1)``.
        options: tolerances.

    Raises:
        InputError: orthographic cameras, or offset images of other views.
    """
    options = options_of(options, ReconstructOptions)
    cameras = images.cameras
    if cameras.orthographic:
        raise InputError("images must come from perspective cameras")
    count, height, width = images.depth.shape
    corner = _memory.empty((count, height, 4, width), np.float32)  # every element is written
    joined = _memory.empty((count, height + 1, width + 1), np.int32)
    shape = _memory.empty((count, height, width), np.uint8)
    none = np.zeros((count, 0, 0), np.int64)
    match = options.match_id
    normal = view(check_tensor("images.normal", images.normal, (count, height, width, 3)), np.float32)
    offset = (np.zeros((count, 0, 0), np.float32), none)
    if offset_images is not None:
        _check_offset(images, offset_images)
        ids = view(offset_images.object_id, np.int64) if match else none
        offset = (view(offset_images.depth, np.float32), ids)
    merge = options.merge_guesses or offset_images is None
    source = kernels.Images(
        view(images.depth, np.float32),
        normal,
        view(images.object_id, np.int64) if match else none,
        *offset,
        pixel_normals(images),
        corner_limits(images, options),
    )
    kernels.fit(source, merge, thread_count(), corner, joined)
    kernels.split(corner, options.adaptive_split, shape)
    planes = block_planes(corner, shape, 0.0)
    depth, bits, words = (torch.from_numpy(a) for a in (corner, shape, joined))
    return SampleQuads(images, depth, bits, words, planes, centred=False)


def block_planes(corner: np.ndarray, shape: np.ndarray, start: float) -> Tensor:
    """``planes`` of :class:`SampleQuads`; ``start``: column and row of the first quad's first corner."""
    count, rows, columns = shape.shape
    planes = np.empty((count, -(-rows // flat_blocks.ROWS), -(-columns // flat_blocks.COLUMNS), 4))
    flat_blocks.find_planes(corner, shape, start, planes)
    return torch.from_numpy(planes)


def kept_corners(images: DepthImages, options: ReconstructOptions | None = None) -> SampleQuads:
    """:func:`fit_corners` without offset images, once for images that stay as they are: the quads are kept with them.

    They take 21 bytes a pixel. Images whose tensors were changed in place since are fitted again.
    """
    options = options_of(options, ReconstructOptions)
    state = (options, *(tensor._version for tensor in (images.depth, images.normal, images.object_id)))
    known: tuple[Any, tuple[Tensor, Tensor, Tensor, Tensor]] | None = _KEPT.get(images)
    if known is None or known[0] != state:
        made = fit_corners(images, None, options)
        known = (
            state,
            (made.depth, made.shape, made.joined, made.planes),
        )  # without the images, which would keep themselves
        _KEPT[images] = known
    return SampleQuads(images, *known[1], centred=False)


def pixel_normals(images: DepthImages) -> np.ndarray:
    """(B,3,3) from a world normal to the row m with n.d(u,v) = m.(u,v,1), where d is the ray with camera z = 1."""
    cameras = images.cameras
    return np.ascontiguousarray((torch.linalg.inv(cameras.intrinsics).transpose(1, 2) @ cameras.rotation).numpy())


def corner_limits(images: DepthImages, options: ReconstructOptions) -> np.ndarray:
    """(B,4): footprint tolerance at unit depth, slope tolerance, guess ratio, near."""
    cameras = images.cameras
    size = cameras.footprint(torch.ones(len(cameras), dtype=torch.float64))
    same = (torch.full_like(size, value) for value in (options.slope_tolerance, options.guess_ratio))
    rows = [size * options.footprint_tolerance, *same, cameras.near]
    return np.ascontiguousarray(torch.stack(rows, dim=1).numpy())


def _check_offset(images: DepthImages, offset: DepthImages) -> None:
    count, height, width = images.depth.shape
    check_tensor("offset_images.depth", offset.depth, (count, height + 1, width + 1))
    wanted, given = images.cameras.sub_camera(-0.5, -0.5, width + 1, height + 1), offset.cameras
    shift = (wanted.intrinsics - given.intrinsics).abs().amax() if count else 0.0
    turn = (wanted.camera_from_world - given.camera_from_world).abs() if count else torch.zeros(1)
    scale = wanted.camera_from_world.abs().amax() if count else 1.0
    if float(shift) > SAME_VIEW or float(turn.amax()) > 1e-9 * float(scale):
        raise InputError("offset_images must show the views of images shifted by half a pixel: see sub_camera")
