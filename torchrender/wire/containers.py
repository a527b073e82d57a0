"""Keyframe messages as depth images of the package: what reprojection needs, made of depth and colour alone."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor
from torch.utils.weak import WeakIdKeyDictionary

from torchrender.brief import brief
from torchrender.buffers import DepthImages
from torchrender.numerics.color import srgb_table
from torchrender.scene.camera import Cameras
from torchrender.wire.cameras import cameras_of
from torchrender.wire.codec import checksum, decode_color, decode_depth, decode_mask
from torchrender.wire.errors import CodecError, ProtocolError
from torchrender.wire.messages import Keyframe, Type, decode, split_blobs

_KEPT: WeakIdKeyDictionary = WeakIdKeyDictionary()
SKY = 1e4
"""Distance at which the sky is drawn, in depths of the farthest surface."""
THIN = 0.02
"""Share of 1/z by which all neighbours of a sample must be farther, or nearer, for it to be of none's surface."""


@dataclass(frozen=True, eq=False)
class KeyframeImage:
    """One decoded message."""

    header: Keyframe
    camera: Cameras
    depth: Tensor  # (H,W); +inf for sky and where there is nothing
    codes: Tensor  # (H,W,3) uint8 sRGB
    known: Tensor  # (H,W) bool: a sample or sky

    __repr__ = brief


def decode_keyframe(header: Keyframe, blobs: Sequence[memoryview], joined: memoryview) -> KeyframeImage:
    """The picture of a message.

    Args:
        blobs: without padding. joined: all of them as they came, for the checksum.

    Raises:
        CodecError: damaged. CameraError: a camera that is not usable.
    """
    if checksum(joined) != header.crc32:
        raise CodecError("the checksum of the blobs does not fit: ask for a new keyframe")
    size = {"width": header.camera.width, "height": header.camera.height}
    depth = decode_depth(blobs[0], bits=header.depth.bits, near=header.depth.near, **size)
    codes = torch.from_numpy(np.array(decode_color(blobs[1], header.color.codec, **size)))
    known = torch.ones(depth.shape, dtype=torch.bool)
    if header.mask is not None:
        known = decode_mask(blobs[2], **size)
    depth = torch.where(known, depth, torch.inf)
    return KeyframeImage(header, cameras_of(header.camera), depth, codes, known)


def read_container(data: bytes, *, max_pixels: int, max_images: int) -> list[KeyframeImage]:
    """All pictures of a container; sizes are checked before memory is taken.

    Raises:
        ProtocolError: no container, cut off, or more or larger pictures than allowed. CodecError: damaged pictures.
    """
    rest = memoryview(data)
    images: list[KeyframeImage] = []
    while rest:
        received = decode(rest, (Type.KEYFRAME,), whole=False)
        header = received.message
        assert isinstance(header, Keyframe)
        if len(images) == max_images or header.camera.width * header.camera.height > max_pixels:
            raise ProtocolError(f"a container may hold {max_images} pictures of {max_pixels} pixels each")
        images.append(decode_keyframe(header, split_blobs(received), received.blobs))
        rest = rest[received.size :]
    if not images:
        raise ProtocolError("the container holds no keyframe")
    return images


def depth_images_of(images: Sequence[KeyframeImage], *, sky: bool = True) -> DepthImages:
    """Depth images (N,H,W) for :func:`torchrender.reproject`; normals are those of the depth planes.

    They are kept with the first of ``images`` until it is drawn with others. Ids are 0 where there
    is a sample and -1 elsewhere: the stream does not carry them.

    Args:
        images: of one size.
        sky: draw the sky as a surface ``SKY`` times as far away as the farthest one.

    Raises:
        ProtocolError: none, or of several sizes.
    """
    if not images or len({tuple(image.depth.shape) for image in images}) != 1:
        raise ProtocolError("keyframes that are drawn together must be at least one, and of one size")
    asked = (*images[1:], sky)
    known: tuple[tuple[object, ...], DepthImages] | None = _KEPT.get(images[0])
    if known is None or known[0] != asked:
        known = (asked, _depth_images(images, sky))
        _KEPT[images[0]] = known
    return known[1]


def _depth_images(images: Sequence[KeyframeImage], sky: bool) -> DepthImages:
    cameras = Cameras.cat([image.camera for image in images])
    depth = torch.stack([image.depth for image in images])
    normal = torch.stack([plane_normals(image.depth, image.camera) for image in images])
    if sky:
        finite = depth[torch.isfinite(depth)]
        far = SKY * (float(finite.max()) if len(finite) else 1.0)
        open_sky = torch.stack([image.known & torch.isinf(image.depth) for image in images])
        depth = torch.where(open_sky, torch.tensor(far, dtype=depth.dtype), depth)
    filled = torch.isfinite(depth)
    ids = torch.where(filled, 0, -1)
    position = cameras.unproject(cameras.pixel_centres(), torch.where(filled, depth, 1.0))
    color = srgb_table(8)[torch.stack([image.codes for image in images]).long()]
    return DepthImages(
        cameras=cameras,
        depth=depth,
        triangle=ids,
        object_id=ids,
        barycentric=torch.zeros(*depth.shape, 2),
        position=torch.where(filled[..., None], position, 0.0),
        normal=torch.where(filled[..., None], normal, 0.0),
        color=torch.where(filled[..., None], color, 0.0),
        layer=torch.zeros(depth.shape, dtype=torch.int32),
        truncated=torch.zeros(depth.shape, dtype=torch.bool),
        parameters={},
    )


def plane_normals(depth: Tensor, camera: Cameras) -> Tensor:
    """(H,W,3) unit world normals that face the camera, from depth (H,W).

    A plane's inverse depth is linear in pixel coordinates, ``1/z = m.(u,v,1)``, and its normal is ``-K^T m``. Along
    each axis it is the mean of both neighbours' where these agree, and else that of the neighbour with the more similar
    inverse depth, which is the one on the same surface. A sample without neighbours faces the camera, and so does one
    whose neighbours are both much farther or nearer, as on a cord, or the only one is.
    """
    inverse = torch.where(torch.isfinite(depth), 1.0 / depth.double(), torch.nan)
    du, dv = _slope(inverse, 1), _slope(inverse, 0)
    centres = camera.pixel_centres()
    rest = torch.nan_to_num(inverse) - du * centres[..., 0] - dv * centres[..., 1]
    plane = torch.stack([du, dv, rest], dim=-1) @ camera.intrinsics[0]
    normal = -(plane @ camera.rotation[0])
    return torch.nn.functional.normalize(normal, dim=-1).float()


def _slope(inverse: Tensor, axis: int) -> Tensor:
    """The change along an axis on one surface; 0 where neither neighbour is of it. As static/js/surface.js does it."""
    step = inverse.diff(dim=axis)
    edge = torch.full_like(inverse.narrow(axis, 0, 1), torch.nan)
    after, before = torch.cat([step, edge], dim=axis), torch.cat([edge, step], dim=axis)
    smaller = torch.where(before.isnan() | (after.abs() <= before.abs()), after, before)
    alone = ~(before * after >= 0.0) & (smaller.abs() > THIN * inverse)  # a missing neighbour is NaN
    agree = (after - before).abs() <= 0.5 * smaller.abs()
    return torch.nan_to_num(torch.where(agree, 0.5 * (after + before), torch.where(alone, 0.0, smaller)))
