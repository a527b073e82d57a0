"""The picture from a new viewpoint, out of depth images alone.

Every sample becomes a quad (hybrid reconstruction, the default), neighbouring samples become triangles (grid), or every
sample becomes a disc (splat); what is nearest in the new camera is kept. Source: specification 02, sections 3 and 10.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass, field

import numpy as np
import torch
from torch import Tensor
from torch.utils.weak import WeakIdKeyDictionary

from torchrender.arrays import Recycler, in_single_precision, view
from torchrender.brief import brief
from torchrender.buffers import DepthImages, check_fixed_buffers
from torchrender.checks import (
    check_choice,
    check_class,
    check_finite,
    check_range,
    check_tensor,
    checked_fields,
    options_of,
)
from torchrender.errors import ColorWarning, InputError
from torchrender.kernels.compile import thread_count
from torchrender.kernels.warp.resolve import resolve
from torchrender.kernels.warp.splat import Samples, Target, draw_splats
from torchrender.kernels.warp.warp import Canvas, Poses, Quads, draw_quads
from torchrender.reconstruct.color_gradient import Drawn, followed_colors
from torchrender.reconstruct.corners import ReconstructOptions, SampleQuads, fit_corners, kept_corners
from torchrender.reconstruct.discs import facing_normals
from torchrender.reconstruct.grid_mesh import fit_grid
from torchrender.reconstruct.pinholes import close_pinholes, closed_pinholes
from torchrender.scene.camera import Cameras

LEAD = 5e-4
"""Of surfaces that agree within this share of their depth, the one recorded nearest to the new camera is kept."""

_memory = Recycler(1 << 26)
_LOOKED_AT: WeakIdKeyDictionary = WeakIdKeyDictionary()
METHODS = ("hybrid", "grid", "splat")
FILTERS = ("bilinear", "nearest")


@dataclass(frozen=True, kw_only=True)
@checked_fields
class ReprojectOptions:
    """How depth images are drawn from a new viewpoint.

    Raises:
        OptionError: a value outside its range; names it.
    """

    method: str = "hybrid"
    color_filter: str = "bilinear"  # among samples of one surface; "nearest": each sample keeps its own colour
    close_pinholes: bool = True  # of hybrid: pixels that samples missed within a surface take its own
    splat_scale: float = 1.0  # disc radius; below 1 leaves holes, above overdraws
    reconstruct: ReconstructOptions = field(default_factory=ReconstructOptions)

    def __post_init__(self) -> None:
        check_choice("method", self.method, METHODS)
        check_choice("color_filter", self.color_filter, FILTERS)
        check_range("splat_scale", self.splat_scale, 0.7, 2.0)


@dataclass(frozen=True, eq=False)
class Reprojection:
    """B pictures from new viewpoints."""

    cameras: Cameras
    color: Tensor  # (B,H,W,3) linear; 0 where no sample reaches
    depth: Tensor  # (B,H,W) camera z; +inf where no sample reaches
    valid: Tensor  # (B,H,W) bool: some sample reaches the pixel
    source: Tensor  # (B,H,W) int64 depth image that the pixel comes from, -1 where there is none

    __repr__ = brief


OUTPUTS: tuple[tuple[tuple[int, ...], type], ...] = (
    ((3,), np.float32),
    ((), np.float32),
    ((), np.bool_),
    ((), np.int64),
)
"""Colour, depth, validity and source of a pixel."""


@in_single_precision
def reproject(
    images: DepthImages | SampleQuads,
    cameras: Cameras,
    *,
    offset_images: DepthImages | None = None,
    colors: Tensor | None = None,
    options: ReprojectOptions | None = None,
    method: str | None = None,
) -> Reprojection:
    """Pictures of B cameras from N depth images (N,H,W), with the pixels that the depth images know marked valid.

    Views near those of the images have no pinholes in surfaces: a pixel that all samples missed, or only one behind
    reached that another image has, between neighbours that lie on one surface, takes theirs. Where such neighbours lie
    on two surfaces that meet there, the pixel is not valid: what it would show is hidden. Surfaces seen from
    behind are not drawn. Where images agree on a surface, the one whose camera is nearest to the new one goes first
    (its colours and resolution fit best), then the earlier one; so they do not mingle pixel by pixel. Quads that
    are fitted without offset images are kept with the images, so that further views take half as long. The result
    does not depend on the number of threads.

    Args:
        images: perspective depth images; or quads that were fitted before, to draw many views of the same images.
        cameras: B perspective cameras of any size.
        offset_images: the images' views shifted by half a pixel (see :func:`fit_corners`); without them the hybrid
            quads' corners are guessed from the samples' tangent planes and agreed on between neighbours.
        colors: (N,H,W,3) colours to use instead of those of the images, which without ``shade`` have none: said. Their
            gradients are exact: which samples pixels show does not depend on them.
        options: method and tolerances; ``method`` overrides the one in ``options``.

    Raises:
        InputError: orthographic cameras, colours of another shape, that are no floats or not finite, or more than
            2^32 - 2 samples.
        OptionError: an unknown method. GradientError: depths that ask for gradients.
    """
    options = options_of(options, ReprojectOptions)
    method = check_choice("method", method or options.method, METHODS)
    source = images.images if isinstance(images, SampleQuads) else images
    colors = _checked(source, cameras, colors)
    quads = _quads(images, offset_images, options, method)
    shape = (len(cameras), cameras.height, cameras.width)
    outputs = tuple(_memory.empty((*shape, *tail), kind) for tail, kind in OUTPUTS)  # every pixel is written
    texels = view(colors.detach(), np.float32)
    follows = colors.requires_grad and torch.is_grad_enabled()
    followed: list[Tensor] = []
    smooth = options.color_filter == "bilinear" and quads is not None
    pixel_arrays = _pixel_arrays(source, quads)
    for k in range(len(cameras)):
        camera = cameras[k]
        bias = _bias(source.cameras, camera)
        keys = _draw(source, quads, camera, bias, options)
        limits = (float(camera.near[0]) * (1.0 - 1e-6), float(camera.far[0]))
        back = _pixel_matrices_back(camera, source.cameras)
        resolve(keys, pixel_arrays, back, bias, limits, texels, smooth, tuple(a[k] for a in outputs))
        closed = None
        if options.close_pinholes and method == "hybrid":
            closed = close_pinholes(*(a[k] for a in outputs))
        if follows:
            drawn = _drawn(keys, outputs[1][k], outputs[2][k], closed, (bias, back))
            followed.append(followed_colors(colors, drawn, pixel_arrays, smooth=smooth))
    color, *rest = (torch.from_numpy(a) for a in outputs)
    return Reprojection(cameras, torch.stack(followed).float() if followed else color, *rest)


def _drawn(
    keys: np.ndarray,
    depth: np.ndarray,
    valid: np.ndarray,
    closed: tuple[np.ndarray, np.ndarray] | None,
    ways: tuple[np.ndarray, np.ndarray],
) -> Drawn:
    """What colours follow: the samples that are shown, and pinholes from what is beside them."""
    if closed is None:
        return Drawn(keys, valid, None, *ways)
    return Drawn(keys, valid & ~closed[0], closed_pinholes(depth, *closed), *ways)


def _checked(source: DepthImages, cameras: Cameras, colors: Tensor | None) -> Tensor:
    """The colours (N,H,W,3) to draw, if all can be drawn."""
    check_class("images", source, DepthImages)
    check_class("cameras", cameras, Cameras)
    if colors is None and source.parameters.get("shade") is False and _looked_at(source.color):
        told = "the images hold no colours, so all is black: sample them with shade=True, or give colors"
        warnings.warn(told, ColorWarning, stacklevel=3)
    colors = check_tensor("colors", source.color if colors is None else colors, (*source.depth.shape, 3))
    check_fixed_buffers("reproject", "images", source, but=("color",))
    if not colors.is_floating_point():
        raise InputError(f"colors must hold floats in linear light, got {colors.dtype}")
    _looked_at(colors)
    if cameras.orthographic or source.cameras.orthographic:
        raise InputError("images and cameras must be perspective")
    if source.depth.numel() >= 2**32 - 1:
        raise InputError(f"images must hold fewer than 2^32 - 1 samples, got {source.depth.numel()}")
    return colors


def _looked_at(colors: Tensor) -> bool:
    """Whether colours, which must be finite, are all black: once for those that stay as they are."""
    state = None if colors.is_inference() else colors._version
    known: tuple[int | None, bool] | None = _LOOKED_AT.get(colors)
    if known is None or state is None or known[0] != state:
        check_finite("colors", colors)
        known = _LOOKED_AT[colors] = (state, not bool(colors.any()))
    return known[1]


def _draw(
    source: DepthImages, quads: SampleQuads | None, camera: Cameras, bias: np.ndarray, options: ReprojectOptions
) -> np.ndarray:
    """(H*W,) uint64 keys of the nearest quads, or discs where there are no quads; see the kernels."""
    keys = _memory.empty((camera.height * camera.width,), np.uint64)
    keys.fill(0)
    canvas = Canvas(keys, camera.width, camera.height)
    near = float(camera.near[0])
    if quads is None:
        target = Target(
            np.ascontiguousarray(camera.rotation[0].numpy()), np.ascontiguousarray(camera.intrinsics[0].numpy()), near
        )
        draw_splats(_splats(source, camera, bias), target, options.splat_scale, thread_count(), canvas)
        return keys
    start = 0.5 if quads.centred else 0.0
    arrays = Quads(quads.depth.numpy(), quads.shape.numpy(), start, quads.planes.numpy())
    draw_quads(arrays, Poses(pixel_matrices(source.cameras, camera), near, bias), thread_count(), canvas)
    return keys


def _quads(
    images: DepthImages | SampleQuads, offset_images: DepthImages | None, options: ReprojectOptions, method: str
) -> SampleQuads | None:
    if isinstance(images, SampleQuads):
        if method == "splat" or images.centred != (method == "grid"):
            raise InputError(f"images are quads of another method than {method}")
        return images
    if method == "hybrid":
        if offset_images is None:
            return kept_corners(images, options.reconstruct)
        return fit_corners(images, offset_images, options.reconstruct)
    return fit_grid(images, options.reconstruct) if method == "grid" else None


def _pixel_arrays(images: DepthImages, quads: SampleQuads | None) -> tuple[int, int, np.ndarray, bool]:
    """What :func:`resolve` needs to know about the quads; discs have no neighbours."""
    if quads is not None:
        return int(quads.shape.shape[1]), int(quads.shape.shape[2]), quads.joined.numpy(), quads.centred
    return int(images.depth.shape[1]), int(images.depth.shape[2]), np.zeros((len(images), 0, 0), np.int32), False


def _bias(source: Cameras, target: Cameras) -> np.ndarray:
    """(N,) factors of 1/depth: one for the camera nearest to the target, less by LEAD or a little for each further one.

    All together they stay within four times LEAD, about the tolerance of the reconstruction.
    """
    distance = (source.eye - target.eye).norm(dim=1)
    rank = torch.argsort(torch.argsort(distance, stable=True), stable=True)
    return (1.0 - rank * min(LEAD, 4 * LEAD / max(len(source), 1))).numpy()


def pixel_matrices(source: Cameras, target: Cameras) -> np.ndarray:
    """(N,3,4): homogeneous pixel of the one target camera = z M[:, :3] (u, v, 1) + M[:, 3], for N source cameras."""
    project = target.intrinsics @ target.rotation
    shift = target.intrinsics @ target.camera_from_world[:, :3, 3:]
    inverse = source.world_from_camera
    turn = project @ inverse[:, :3, :3] @ torch.linalg.inv(source.intrinsics)
    return np.ascontiguousarray(torch.cat([turn, project @ inverse[:, :3, 3:] + shift], dim=2).numpy())


def _pixel_matrices_back(target: Cameras, source: Cameras) -> np.ndarray:
    """(N,3,4) the other way: homogeneous pixels of N source cameras from pixel and depth of the one target camera."""
    project = source.intrinsics @ source.rotation
    shift = source.intrinsics @ source.camera_from_world[:, :3, 3:]
    inverse = target.world_from_camera
    turn = project @ inverse[:, :3, :3] @ torch.linalg.inv(target.intrinsics)
    return np.ascontiguousarray(torch.cat([turn, project @ inverse[:, :3, 3:] + shift], dim=2).numpy())


def _splats(images: DepthImages, camera: Cameras, bias: np.ndarray) -> Samples:
    """The samples as discs for a camera."""
    source = images.cameras
    inverse = source.world_from_camera
    rotation = camera.rotation
    turn = rotation @ inverse[:, :3, :3] @ torch.linalg.inv(source.intrinsics)
    eye = rotation @ inverse[:, :3, 3:] + camera.camera_from_world[:, :3, 3:]
    size = source.footprint(torch.ones(len(source), dtype=torch.float64))
    own_rays = inverse[:, :3, :3] @ torch.linalg.inv(source.intrinsics)
    return Samples(
        view(images.depth, np.float32),
        view(facing_normals(images), np.float32),
        np.ascontiguousarray(torch.cat([turn, eye], dim=2).numpy()),
        np.ascontiguousarray(own_rays.numpy()),
        size.numpy(),
        bias,
    )
