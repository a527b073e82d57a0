"""Key frames of reflections, and where on the reflectors the same points are mirrored towards a moved eye.

Specification 04, sections 3 and 5.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from torchrender.arrays import view
from torchrender.buffers import DepthImages, GBuffer, ReflectionLayer, ReflectionState
from torchrender.checks import check_tensor, options_of
from torchrender.effects.reflections.reuse_options import ReuseOptions
from torchrender.errors import InputError
from torchrender.kernels.reflections import match as kernels
from torchrender.kernels.reflections.shift import FAINT
from torchrender.reconstruct.corners import ReconstructOptions
from torchrender.reconstruct.grid_mesh import fit_grid
from torchrender.scene.camera import Cameras

CAUSES = ("valid", "border", "silhouette", "ratio", "steps")
"""What :attr:`ReflectionMatches.cause` counts: a match; a walk that ended at the image's border, at the reflector's
outline, where the distance has no true minimum; or one that was cut off."""


@dataclass(frozen=True, eq=False)
class ReflectionKeyFrame:
    """What every reflective pixel of B pictures saw, and where: the reflection depth image of the specification.

    Positions are relative to each picture's eye, so that float32 keeps its precision far from the world's origin. The
    specular degree is not kept: colours are blended by the material of the picture that shows them.
    """

    cameras: Cameras
    surface: Tensor  # (B,H,W,8) float32 position, unit normal, footprint, camera depth of reflectors
    reflector: Tensor  # (B,H,W) int32 object, -1 where nothing is reflected
    reached: Tensor  # (B,H,W,4) float32 reflected point and 1; or unit direction and 0 where the ray left the scene
    distance: Tensor  # (B,H,W) float32 ray length from reflector to reflected point, +inf where there is none
    color: Tensor  # (B,H,W,3) float32 reflected radiance
    order: Tensor  # (B,H,W) float32 depth plus distance: of reflections that fall together the least is seen
    joined: Tensor  # (B,H-1,W-1) uint8 triangles between neighbouring pixels of one reflector's surface
    breaks: Tensor  # (B,H,W) uint8 bit 0, 1: what is mirrored visibly does not go on in the pixel to the right, below;
    # bit 2, 3: its distance jumps there, but the colours are about the same
    pixel: Tensor  # (N,) int64 flat places of the reflective pixels

    def rows(self) -> list[Tensor]:
        """Which of the N pixels belong to each of the B pictures."""
        size = self.reflector.shape[1] * self.reflector.shape[2]
        picture = self.pixel // max(size, 1)
        return [(picture == b).nonzero().reshape(-1) for b in range(len(self.cameras))]


@dataclass(frozen=True, eq=False)
class ReflectionMatches:
    """For N key pixels the place, relative to their own, where their reflected point is mirrored towards a new eye."""

    end: Tensor  # (N,2) int32 (rows, columns) to the best pixel
    offset: Tensor  # (N,2) float32 the same with the part of a pixel
    cause: Tensor  # (N,) uint8 index into CAUSES
    steps: Tensor  # (N,) int32 length of the walk; 0 where there was none

    @property
    def valid(self) -> Tensor:
        """(N,) bool."""
        return self.cause == kernels.VALID


def make_key_frame(
    gbuffer: GBuffer, layer: ReflectionLayer, options: ReuseOptions | None = None, weight: Tensor | None = None
) -> ReflectionKeyFrame:
    """The key frame of pictures whose reflections are all known.

    Args:
        weight: (B,H,W) share of what is mirrored in a pixel's colour; None: one.

    Pixels without a normal, and those whose layer state is NONE, are left out.

    Raises:
        InputError: orthographic cameras, or a layer of another size.
    """
    options = options_of(options, ReuseOptions)
    cameras = gbuffer.cameras
    if cameras.orthographic:
        raise InputError("reflections are reused between perspective cameras only")
    shape = tuple(gbuffer.depth.shape)
    check_tensor("layer.state", layer.state, shape)
    normal = torch.nn.functional.normalize(gbuffer.normal.double(), dim=-1, eps=1e-30)
    mirrors = (layer.state != ReflectionState.NONE) & (gbuffer.normal.square().sum(-1) > 0.25)
    eye = cameras.eye[:, None, None]
    position = torch.where(mirrors[..., None], gbuffer.position - eye, 0.0)
    depth = torch.where(mirrors, gbuffer.depth, torch.inf)
    surface = torch.cat([position, normal, cameras.footprint(gbuffer.depth.double())[..., None], depth[..., None]], -1)
    near = torch.isfinite(layer.distance)
    length = torch.where(near, layer.distance, 0.0).double()[..., None]
    point = torch.where(near[..., None], position + length * layer.direction.double(), layer.direction.double())
    reached = torch.cat([point, near[..., None].double()], -1)
    seen = layer.color.clamp(0.0, 1.0)
    if weight is not None:
        seen = seen * check_tensor("weight", weight, shape)[..., None]
    return ReflectionKeyFrame(
        cameras=cameras,
        surface=surface.float(),
        reflector=torch.where(mirrors, gbuffer.object_id, -1).int(),
        reached=reached.float(),
        distance=layer.distance,
        color=layer.color,
        order=(depth + torch.where(near, layer.distance, 10.0 * _extent(gbuffer))).float(),
        joined=_joined(gbuffer, depth),
        breaks=_breaks(depth, position.norm(dim=-1), layer.distance, surface[..., 6], seen, options),
        pixel=mirrors.reshape(-1).nonzero().reshape(-1),
    )


def _extent(gbuffer: GBuffer) -> float:
    """Diagonal of what the pictures show: ten times this stands for infinity where distances are compared."""
    seen = gbuffer.position[gbuffer.covered]
    return float((seen.amax(0) - seen.amin(0)).norm()) if len(seen) else 1.0


def _breaks(
    depth: Tensor, path: Tensor, distance: Tensor, footprint: Tensor, seen: Tensor, options: ReuseOptions
) -> Tensor:
    """Bits (B,H,W) of where what is mirrored does not go on in the next pixel: a jump in distance, or an edge.

    An edge is a difference in inverse mirrored depth that does not continue the differences to either side of it: in a
    plane mirror the inverse depth of a mirrored plane is linear in the picture, as that of any plane.
    """
    whole = torch.isfinite(depth) & torch.isfinite(distance) & (depth > 0)
    inverse = torch.where(whole, path / (depth * (path + distance)), 0.0)
    bits = torch.zeros(depth.shape, dtype=torch.uint8)
    for bit, axis in ((1, 2), (2, 1)):
        count = depth.shape[axis] - 1
        if count < 1:
            continue
        jumps = _jumps(distance, footprint, axis, options.jump) | _edges(inverse, axis, options.edge)
        visible = seen.diff(dim=axis).abs().amax(-1) > options.contrast
        bits.narrow(axis, 0, count).bitwise_or_(torch.where(visible, bit, FAINT * bit).to(torch.uint8) * jumps)
    return bits


def _pairs(image: Tensor, axis: int) -> tuple[Tensor, Tensor]:
    """Neighbours along an axis."""
    count = image.shape[axis] - 1
    return image.narrow(axis, 0, count), image.narrow(axis, 1, count)


def _jumps(distance: Tensor, footprint: Tensor, axis: int, limit: float) -> Tensor:
    first, second = _pairs(distance, axis)
    least, most = torch.minimum(first, second), torch.maximum(first, second)
    return torch.isfinite(least) & (most - least > limit * least + 4.0 * torch.maximum(*_pairs(footprint, axis)))


def _edges(inverse: Tensor, axis: int, limit: float) -> Tensor:
    step = inverse.diff(dim=axis)
    turn = step.diff(dim=axis).abs()
    end = torch.full_like(step.narrow(axis, 0, 1), torch.inf)
    bend = torch.minimum(torch.cat([end, turn], axis), torch.cat([turn, end], axis))
    size = step.abs()
    return (size > limit * torch.maximum(*_pairs(inverse, axis))) & (bend > 0.5 * size)


def _joined(gbuffer: GBuffer, depth: Tensor) -> Tensor:
    """Triangles of neighbouring pixels on one reflector, without those across a depth edge of it."""
    images = DepthImages(
        cameras=gbuffer.cameras,
        depth=depth,
        triangle=gbuffer.triangle,
        object_id=gbuffer.object_id,
        barycentric=gbuffer.barycentric,
        position=gbuffer.position,
        normal=gbuffer.geometric_normal,
        color=gbuffer.color,
        layer=torch.zeros(depth.shape, dtype=torch.int32),
        truncated=torch.zeros(depth.shape, dtype=torch.bool),
        parameters={},
    )
    return fit_grid(images, ReconstructOptions(match_id=True)).shape


def match_reflections(
    key: ReflectionKeyFrame, eye: Tensor, start: Tensor | None = None, options: ReuseOptions | None = None
) -> ReflectionMatches:
    """Where on the reflectors the key pixels' reflected points are mirrored towards new eyes.

    An eye that has not moved leaves every pixel where it is, without a search: reflections depend on nothing else.

    Args:
        eye: (B,3) world space, one for each picture of the key frame.
        start: (N,2) int32 ``end`` of an earlier match with the same key frame, where the walks begin.

    Raises:
        InputError: eyes or start of a wrong shape.
    """
    options = options_of(options, ReuseOptions)
    check_tensor("eye", eye, (len(key.cameras), 3))
    count = len(key.pixel)
    end, offset = np.zeros((count, 2), np.int32), np.zeros((count, 2), np.float32)
    cause, steps = np.zeros(count, np.uint8), np.zeros(count, np.int32)
    begin = end if start is None else view(check_tensor("start", start, (count, 2)), np.int32)
    moved = eye.double() - key.cameras.eye
    height, width = key.reflector.shape[1:]
    for b, rows in enumerate(key.rows()):
        if not len(rows) or not bool(moved[b].abs().max() > 0.0):
            continue
        part = slice(int(rows[0]), int(rows[-1]) + 1)  # flat places are in order
        settings = kernels.Settings(options.max_steps, float(options.ratio), options.search == "leap", options.refine)
        kernels.match(
            kernels.KeyPixels(
                view(key.surface[b].reshape(-1, 8), np.float32),
                view(key.reflector[b].reshape(-1), np.int32),
                view(key.reached[b].reshape(-1, 4), np.float32),
                height,
                width,
            ),
            view(key.pixel[part] - b * height * width, np.int64),
            view(moved[b], np.float64),
            begin[part].copy(),
            settings,
            kernels.Matches(*(a[part] for a in (end, offset, cause, steps))),
        )
    return ReflectionMatches(*(torch.from_numpy(a) for a in (end, offset, cause, steps)))
