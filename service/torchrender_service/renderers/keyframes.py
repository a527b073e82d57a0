"""Pictures and their layers as keyframe messages."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from typing import Any

from torch import Tensor

from torchrender.numerics.tonemap import tone_map
from torchrender.scene.camera import Cameras
from torchrender.wire.cameras import header_of
from torchrender.wire.codec import BITS, Array, checksum, display_bytes, encode_color, encode_depth, encode_mask
from torchrender.wire.messages import Bits, ColorBlob, ColorCodec, DepthBlob, Keyframe, MaskBlob, encode, padded
from torchrender.wire.viewing import ToneMap
from torchrender_service.renderers.jobs import BITS_STILL, QUALITY_MOVING
from torchrender_service.renderers.streaming.layers import Layer

REACH = 0.25
"""Of the typical depth: as far as a client may go from a keyframe before the next one is there."""
SLIP = 0.125
"""Pixels by which samples may then be off because their depth is rounded."""


@dataclass(frozen=True, kw_only=True)
class Stamp:
    """What all messages of a keyframe say alike."""

    id: int
    layers: int  # in all
    pose: int = -1
    time_ms: float = 0.0
    still: bool = False
    samples: int = 1
    bits: Bits = BITS_STILL
    color: ColorCodec = "jpeg"
    quality: int = QUALITY_MOVING  # 100: WebP without loss
    scene_s: float | None = None  # seconds into the scene's animation
    revision: int = 0  # of the scene
    settings: int = 0
    exposure: float = 0.0  # EV
    tone_map: ToneMap = "none"
    mirrors: bool = False  # of the layer that holds what mirrors show


def enough_bits(focal: float, nearest: float, typical: float) -> Bits:
    """The fewest bits of depth that keep samples within ``SLIP`` pixels of their place, else the most there are.

    Rounding ``nearest / z`` to half of one of ``2^bits - 1`` levels moves a sample by ``focal * shift / nearest`` times
    that error, for an eye that is ``shift`` away from the keyframe's.

    Args:
        focal: pixels. nearest, typical: depths, scene units; where nothing is seen +inf and 0.
    """
    slip = focal * REACH * typical / nearest * 0.5
    return next((bits for bits in BITS if slip <= SLIP * (2**bits - 1)), BITS[-1])


def first_message(
    stamp: Stamp, camera: Cameras, depth: Tensor, radiance: Tensor, *, render_ms: float, plan: dict[str, Any] | None
) -> bytes:
    """Layer 0: depth (H,W) and linear radiance (H,W,3), displayed as the stamp says."""
    return _message(stamp, 0, camera, depth, radiance, None, render_ms, plan)


def layer_message(stamp: Stamp, number: int, layer: Layer, *, render_ms: float) -> bytes:
    """Layer ``number`` >= 1."""
    return _message(stamp, number, layer.camera, layer.depth, layer.radiance, layer.known, render_ms, None)


def mirror_message(stamp: Stamp, mirrors: Layer) -> bytes:
    """The last layer: what the mirrors of layer 0 show."""
    stamp = replace(stamp, mirrors=True)
    number = stamp.layers - 1
    return _message(stamp, number, mirrors.camera, mirrors.depth, mirrors.radiance, mirrors.known, 0.0, None)


def displayed(stamp: Stamp, radiance: Tensor) -> Array:
    """(H,W,3) uint8 sRGB of linear radiance (H,W,3), exposed and tone mapped."""
    if stamp.tone_map == "none":
        return display_bytes(radiance, 2.0**stamp.exposure)
    return display_bytes(tone_map(radiance.detach(), stamp.tone_map, exposure=stamp.exposure))


def _message(
    stamp: Stamp,
    number: int,
    camera: Cameras,
    depth: Tensor,
    radiance: Tensor,
    known: Tensor | None,
    render_ms: float,
    plan: dict[str, Any] | None,
) -> bytes:
    begin = time.perf_counter()
    encoded = encode_depth(depth, bits=stamp.bits)
    codes = displayed(stamp, radiance)
    blobs = [encoded.data, encode_color(codes, stamp.color, quality=stamp.quality, known=known)]
    if known is not None:
        blobs.append(encode_mask(known))
    crc32 = checksum(padded(blobs))
    header = Keyframe(
        id=stamp.id,
        pose=stamp.pose,
        time_ms=stamp.time_ms,
        camera=header_of(camera),
        layer=number,
        layers=stamp.layers,
        still=stamp.still,
        samples=stamp.samples,
        scene_s=stamp.scene_s,
        revision=stamp.revision,
        settings=stamp.settings,
        exposure=stamp.exposure,
        tone_map=stamp.tone_map,
        mirrors=stamp.mirrors,
        depth=DepthBlob(codec="pz1", bits=stamp.bits, near=encoded.near, length=len(encoded.data), error=encoded.error),
        color=ColorBlob(codec=stamp.color, length=len(blobs[1])),
        mask=None if known is None else MaskBlob(length=len(blobs[2])),
        crc32=crc32,
        render_ms=round(render_ms, 3),
        encode_ms=round(1e3 * (time.perf_counter() - begin), 3),
        plan=plan,
    )
    return encode(header, blobs)
