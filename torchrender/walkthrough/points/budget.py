"""How large a walkthrough may become: textures and points within a share of the photos."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from torchrender.errors import OptionError
from torchrender.walkthrough.density import Samples
from torchrender.walkthrough.frames.prepare import Capture
from torchrender.walkthrough.frames.record import CaptureWarning
from torchrender.walkthrough.model import PIXEL_BYTES, POINT_BYTES, TEXEL_BYTES, PlanePatch
from torchrender.walkthrough.options import WalkthroughOptions
from torchrender.walkthrough.points.merging import merge_points
from torchrender.walkthrough.textures import MARGIN, TextureReport
from torchrender.walkthrough.view_colors import BYTES

USUAL_SHARE, FEW = 0.25, 4.0
"""Of the photos' raw size that is aimed at unless the options name a share; of few photos, which hardly overlap, as
much as this many of them take."""

LEAST_SCALE, NAMED_SCALE = 0.7, 0.25
"""Of the density of texels, below which textures do not become coarser, unless a share is named."""

MOST_TEXTURE = 0.9
"""Of the room, that textures may take where a share is named: some points must be left."""

PROBE = 4
"""Times that a first look at the textures is coarser."""

Texture = Callable[[WalkthroughOptions], tuple[list[PlanePatch], TextureReport]]


def within_budget(
    capture: Capture, samples: Samples, texture: Texture, options: WalkthroughOptions
) -> tuple[list[PlanePatch], TextureReport, Samples]:
    """Textures by ``texture(options)``, and the points, merged and coarser so that all fits into ``size_share``.

    Where a share is named, it is kept to; else only points that look alike merge, and texels grow by half at most.

    Raises:
        OptionError: colours that depend on the view alone take more than the share.
    """
    raw, named = PIXEL_BYTES * capture.depth.size, options.size_share
    share = max(USUAL_SHARE, FEW / len(capture)) if named is None else named
    room = share * raw - _view_bytes(capture, options)
    if named is not None and room <= 0:
        raise OptionError(f"size_share {named:g} leaves no room beside view_detail = {options.view_detail}")
    samples = _at_most(samples, options.max_points)
    scale = 1.0
    if POINT_BYTES * len(samples.position) + 2 * TEXEL_BYTES * capture.depth.size > room:
        samples, scale = _shared_out(samples, _expected_bytes(texture, options), max(room, 0.0))
    rho = max(options.rho_scale * max(scale, LEAST_SCALE if named is None else NAMED_SCALE), NAMED_SCALE)
    patches, report = texture(replace(options, rho_scale=rho) if scale < 1 else options)
    while named is not None and rho > NAMED_SCALE and _texture_bytes(patches) > MOST_TEXTURE * room:
        # Rims of small textures take more than expected.
        rho = max(rho * min((0.9 * MOST_TEXTURE * room / _texture_bytes(patches)) ** 0.5, 0.9), NAMED_SCALE)
        patches, report = texture(replace(options, rho_scale=rho))
    left = room - _texture_bytes(patches)
    samples = merge_points(samples, max(int(left / POINT_BYTES), 1), strict=named is not None)
    over = POINT_BYTES * len(samples.position) - left
    if named is not None and over > 0:
        warnings.warn(
            f"size_share {named:g} cannot be kept: {over:.0f} bytes more than its {share * raw:.0f} are needed",
            CaptureWarning,
            stacklevel=4,
        )
    return patches, report, samples


def _shared_out(samples: Samples, textures: float, room: float) -> tuple[Samples, float]:
    """Points merged, those alike first, and the factor of the density of texels that leaves both within ``room``."""
    points = POINT_BYTES * len(samples.position)
    if points + textures <= room:
        return samples, 1.0
    # What several photos sampled at one place goes unseen; so points give twice as much as textures.
    wanted = max(room - textures, 0.5 * points * room / (points + textures))
    samples = merge_points(samples, int(wanted / POINT_BYTES))
    left = max(room - POINT_BYTES * len(samples.position), 0.0)
    return samples, min((left / max(textures, 1.0)) ** 0.5, 1.0)


def _expected_bytes(texture: Texture, options: WalkthroughOptions) -> float:
    """About what textures will take, from much coarser ones."""
    rho = max(options.rho_scale / PROBE, NAMED_SCALE)
    times = options.rho_scale / rho
    patches, _ = texture(replace(options, rho_scale=rho, fill="off"))
    rim = 2 * (MARGIN + 1)
    sides = [np.maximum(np.array(p.texture.shape[:2]) - rim, 1) * times + rim for p in patches]
    return float(TEXEL_BYTES * sum(s.prod() for s in sides))


def _texture_bytes(patches: list[PlanePatch]) -> int:
    return TEXEL_BYTES * sum(p.texture.shape[0] * p.texture.shape[1] for p in patches)


def _view_bytes(capture: Capture, options: WalkthroughOptions) -> int:
    if not options.view_detail:
        return 0
    height, width = capture.size
    return BYTES * len(capture) * -(-height // options.view_detail) * -(-width // options.view_detail)


def _at_most(samples: Samples, most: int) -> Samples:
    count = len(samples.position)
    if count <= most:
        return samples
    warnings.warn(
        f"{count} points are more than max_points = {most}: neighbours are merged", CaptureWarning, stacklevel=5
    )
    return merge_points(samples, most, strict=True)
