"""The pass ``resample``: brings the picture to its size."""

from __future__ import annotations

import math
from collections.abc import Callable

import torch
from torch import Tensor

from torchrender.buffers import GBuffer
from torchrender.effects.upsampling.carried import LitPicture, carried_light
from torchrender.effects.upsampling.gathered import GatheredLight
from torchrender.effects.upsampling.joint import joint_upsampled
from torchrender.effects.upsampling.outlines import smooth_outlines
from torchrender.numerics.texels.scaling import scaled_bilinearly
from torchrender.passes.contract import Amounts, Buffers, Pass
from torchrender.passes.hard import VIEW, HardEffect, Law, Outputs, Subject
from torchrender.passes.outlook import Outlook, Verdict
from torchrender.passes.picture.composite import COMPOSITE
from torchrender.passes.seen.gbuffer import GBUFFER
from torchrender.passes.seen.picture_visibility import PICTURE_VISIBILITY
from torchrender.passes.senses import detail
from torchrender.passes.settings import settings
from torchrender.pipeline.buffer import Buffer
from torchrender.pipeline.frame import Frame
from torchrender.raster import rasterize
from torchrender.shade import shade

PICTURE = Buffer("picture", Tensor)
"""Radiance (B,H,W,3) at the picture's size."""

ROUNDING = 1e-6
"""Shares of a sample below this are rounding."""


def applies(outlook: Outlook) -> Verdict:
    """Every picture has a size."""
    factor = outlook.options.supersample
    if factor == 1:
        return Verdict(True, "one sample per pixel: handed on as it is")
    return Verdict(True, f"mean of {factor:g} x {factor:g} samples" if factor > 1 else f"scaled up by {1 / factor:g}")


def asks(outlook: Outlook) -> Buffers:
    """What all pixels see, as a guide."""
    guided = outlook.options.upscaling == "joint" and outlook.options.supersample < 1
    return (PICTURE_VISIBILITY,) if guided else ()


def run(frame: Frame) -> Tensor:
    """Radiance (B,H,W,3) at the picture's size."""
    radiance = frame[COMPOSITE]
    size = (frame.cameras.height, frame.cameras.width)
    rows, columns = radiance.shape[1:3]
    if (rows, columns) == size:
        return radiance
    guide = frame.get(PICTURE_VISIBILITY)
    if guide is not None and (rows < size[0] or columns < size[1]):
        return joint_upsampled(radiance, frame[GBUFFER], guide, frame.scene.geometry.material)
    return resampled(radiance, size, frame.options.upscaling)


def resampled(radiance: Tensor, size: tuple[int, int], upscaling: str) -> Tensor:
    """Linear radiance (B,h,w,3) at another size (H,W): means where there are more samples, else scaled up.

    Args:
        upscaling: "nearest", else bilinear.
    """
    height, width = size
    rows, columns = radiance.shape[1:3]
    if (rows, columns) == (height, width):
        return radiance
    planes = radiance.permute(0, 3, 1, 2)
    if rows % height == 0 and columns % width == 0:
        planes = torch.nn.functional.interpolate(planes, size=size, mode="area")
    elif rows >= height and columns >= width:
        return _means(_means(radiance, 1, height), 2, width)
    elif upscaling == "nearest":
        planes = torch.nn.functional.interpolate(planes, size=size, mode="nearest-exact")
    else:
        planes = scaled_bilinearly(planes, size)
    return planes.permute(0, 2, 3, 1).contiguous()


def _means(values: Tensor, axis: int, size: int) -> Tensor:
    """Means over as many equal parts of an axis: samples that lie in two of them count for each by their share.

    Whole windows instead, as of ``interpolate(mode="area")``, would give such a sample to both and blur.
    """
    count = values.shape[axis]
    step = count / size
    begin = torch.arange(size, dtype=torch.float64, device=values.device) * step
    shape = [-1 if dimension == axis else 1 for dimension in range(values.dim())]
    total = torch.zeros(())
    for number in range(math.ceil(step) + 1):
        place = begin.floor() + number
        share = (torch.minimum(begin + step, place + 1.0) - torch.maximum(begin, place)).clamp(min=0.0) / step
        if float(share.max()) > ROUNDING:
            part = values.index_select(axis, place.long().clamp(max=count - 1))
            total = total + part * share.to(values.dtype).reshape(shape)
    return total


def senses(frame: Frame) -> dict[str, float]:
    """How much of the picture hangs on its number of pixels: its detail."""
    slope, lost = detail(frame, frame[COMPOSITE])
    return {"gbuffer": slope, "resample": lost}


def amounts(outlook: Outlook) -> Amounts:
    """Once; rendered pixels, if they are not the picture's; the picture's, if these are more."""
    factor = outlook.options.supersample
    rendered = 0.0 if factor == 1 else outlook.pixels
    return (1.0, rendered, outlook.picture_pixels if factor < 1 else 0.0)


# ---------------------------------------------------------------- hard cases

FILTERS = ("nearest", "bilinear")
SIZES = ((7, 5), (48, 64), (12, 97))  # height and width: fewer pixels, more, and both
FEWER = (0.5, 0.3)
"""Rendered pixels per pixel and side."""


def _resampled(subject: Subject) -> Outputs:
    radiance = shade(subject.scene, subject.gbuffer)
    return {
        f"{way} {height} x {width}": resampled(radiance, (height, width), way)
        for way in FILTERS
        for height, width in SIZES
    }


def _grey_stays_grey(subject: Subject, _: Outputs) -> float:
    grey = torch.full((*subject.gbuffer.triangle.shape, 3), 0.4)
    parts = [resampled(grey, size, way) for way in FILTERS for size in SIZES]
    return max(float((part - 0.4).abs().max()) for part in parts)


def _scaled_up(subject: Subject, radiance: Callable[[GBuffer], Tensor]) -> list[Tensor]:
    scene, made = subject.scene, []
    for factor in FEWER:
        few = rasterize(scene, subject.cameras.scaled(factor))
        made.append(joint_upsampled(radiance(few), few, subject.gbuffer, scene.geometry.material))
    return made


def _guided(subject: Subject) -> Outputs:
    made = _scaled_up(subject, lambda few: shade(subject.scene, few))
    return {f"by {1 / factor:g}": radiance for factor, radiance in zip(FEWER, made, strict=True)}


def _grey_stays_grey_guided(subject: Subject, _: Outputs) -> float:
    made = _scaled_up(subject, lambda few: torch.full((*few.triangle.shape, 3), 0.4))
    return max(float((part - 0.4).abs().max()) for part in made)


def _lit(subject: Subject) -> tuple[GBuffer, Tensor]:
    """What one camera sees, and its light."""
    seen = rasterize(subject.scene, subject.cameras[0])
    return seen, shade(subject.scene, seen)[0]


def _carried(subject: Subject) -> Outputs:
    scene, camera = subject.scene, subject.cameras[0]
    seen, light = _lit(subject)
    picture = LitPicture(seen, light)
    aside = rasterize(scene, camera.sub_camera(0.4, 0.3, camera.width, camera.height))
    own, other = (carried_light(view, [picture], scene.geometry.material).light for view in (seen, aside))
    return {"own": own, "aside": other}


def _own_light(subject: Subject, outputs: Outputs) -> float:
    seen, light = _lit(subject)
    off = (outputs["own"] - light).abs()[seen.covered[0]] / max(float(light.max()), 1e-30)
    return float(off.max()) if off.numel() else 0.0


def _gathered(subject: Subject) -> Outputs:
    seen, light = _lit(subject)
    wanted, found = seen.covered[0].clone(), torch.zeros_like(light)
    if not seen.cameras.orthographic:
        kept = GatheredLight.none().with_samples(subject.scene, seen, wanted, light[wanted])
        kept.place(subject.scene, seen, wanted, found)
    return {"own": torch.where((seen.covered[0] & ~wanted)[..., None], found, light)}


def _outlined(subject: Subject) -> Outputs:
    seen, light = _lit(subject)
    return {"light": light if seen.cameras.orthographic else smooth_outlines(subject.scene.geometry, seen, light)}


def _within_the_picture(subject: Subject, outputs: Outputs) -> float:
    light = _lit(subject)[1].reshape(-1, 3)
    low, high, found = light.amin(dim=0), light.amax(dim=0), outputs["light"]
    return float(torch.maximum(low - found, found - high).max()) / max(float(high.max()), 1e-30)


HARD = (
    HardEffect(
        name="gathered_light",
        about=VIEW,
        modules=("effects.upsampling.gathered",),
        run=_gathered,
        bounds=lambda s: {"own": (0.0, s.radiance_limit)},
        law=Law(
            text="a view takes its own samples as they are: largest difference, of the brightest",
            deviation=_own_light,
            limit=1e-3,
        ),
        parallel=False,
    ),
    HardEffect(
        name="smooth_outlines",
        about=VIEW,
        modules=("effects.upsampling.outlines",),
        run=_outlined,
        bounds=lambda s: {"light": (0.0, s.radiance_limit)},
        law=Law(
            text="no pixel leaves the range of the picture: by how much, of the brightest",
            deviation=_within_the_picture,
            limit=1e-5,
        ),
        parallel=False,
    ),
    HardEffect(
        name="carried_light",
        about=VIEW,
        modules=("effects.upsampling.carried",),
        run=_carried,
        bounds=lambda s: dict.fromkeys(("own", "aside"), (0.0, s.radiance_limit)),
        law=Law(
            text="a view takes its own light as it is: largest difference, of the brightest",
            deviation=_own_light,
            limit=1e-3,
        ),
        parallel=False,
    ),
    HardEffect(
        name="resample",
        about=VIEW,
        modules=("passes.picture.resample",),
        run=_resampled,
        bounds=lambda s: {f"{way} {h} x {w}": (0.0, s.radiance_limit) for way in FILTERS for h, w in SIZES},
        law=Law(
            text="a picture of one colour keeps it at any size: largest difference",
            deviation=_grey_stays_grey,
            limit=1e-6,
        ),
    ),
    HardEffect(
        name="joint_upsampling",
        about=VIEW,
        modules=("effects.upsampling.joint",),
        run=_guided,
        bounds=lambda s: {f"by {1 / factor:g}": (0.0, s.radiance_limit) for factor in FEWER},
        law=Law(
            text="a picture of one colour keeps it: largest difference", deviation=_grey_stays_grey_guided, limit=1e-6
        ),
    ),
)

PASS = Pass(
    name="resample",
    summary="brings the picture to its size",
    makes=PICTURE,
    needs=(GBUFFER, COMPOSITE),
    asks=asks,
    applies=applies,
    run=run,
    settings=settings(
        "upscaling",
        {name: {"upscaling": name} for name in ("nearest", "bilinear", "joint")},
        context={"supersample": 0.5},
        shows=lambda options: options.supersample < 1,
    ),
    amounts=amounts,
    senses=senses,
    hard=HARD,
)
