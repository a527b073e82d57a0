"""Two-dimensional colour transfer, which recolours each picture by itself, beside materials."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np
import torch
from skimage.color import deltaE_ciede2000
from torch import Tensor

from torchrender.numerics.color import linear_from_srgb, srgb_from_linear
from torchrender.photo.lab import lab_from_linear, linear_from_lab
from torchrender.photo.style.session import Style
from torchrender.photo.style.statistics import ColorStatistics, style_terms
from torchrender.photo.style.terms import pictures

GREY = (0.1, 0.1, 0.1, 0.5, 0.5, 0.5, 0.0, 20.0)
WIDTH, HEIGHT = 640, 480
LEAST_SPREAD = 0.1  # of a or b; less is rounding on grey
Transfer = Callable[[Tensor, Tensor], Tensor]


def reinhard(picture: Tensor, photo: Tensor) -> Tensor:
    """Means and deviations of a and b of the photo on a picture, (H,W,3) linear each."""
    own, other = lab_from_linear(picture.double()), lab_from_linear(photo.double())
    for channel in (1, 2):
        mean, deviation = own[..., channel].mean(), own[..., channel].std()
        wanted, spread = other[..., channel].mean(), other[..., channel].std()
        scale = spread / deviation if float(deviation) > LEAST_SPREAD else 0.0
        own[..., channel] = (own[..., channel] - mean) * scale + wanted
    return linear_from_lab(own).clamp(0.0, 1.0).float()


def color_matcher() -> Transfer | None:
    """The package color-matcher with its compound of histogram matching and Gaussian transport; None if absent."""
    try:
        from color_matcher import ColorMatcher
        from color_matcher.normalizer import Normalizer
    except ImportError:
        return None

    def transfer(picture: Tensor, photo: Tensor) -> Tensor:
        source, target = ((srgb_from_linear(x.float()) * 255).numpy() for x in (picture, photo))
        made = ColorMatcher().transfer(src=source, ref=target, method="hm-mvgd-hm")
        codes = np.asarray(Normalizer(made).uint8_norm(), dtype=np.float32)
        return linear_from_srgb(torch.from_numpy(codes / 255)).float()

    return transfer


def flat_rows(style: Style) -> list[dict[str, Any]]:
    """Distance of (a,b) to the photo, drift of one object's colour over views, time per 640 x 480 picture."""
    views = style.problem.views
    grey = torch.tensor(GREY, dtype=torch.float64).expand(len(style.names), 8)
    rest = torch.full((*views.object.shape, 3), 0.5)
    plain = pictures(views, style.problem.terms, grey, rest)
    photo = style.problem.photos[0].pixels
    ways: dict[str, Transfer | None] = {"mean and deviation of a, b": reinhard, "color-matcher": color_matcher()}
    rows = []
    for name, way in ways.items():
        if way is None:
            continue
        made = torch.stack([way(picture, photo) for picture in plain])
        rows.append({"way": name, **_row(style, made), "ms": _time(way, plain[0], photo)})
    ours = pictures(views, style.problem.terms, style.materials, rest)
    begin = time.perf_counter()
    pictures(views, style.problem.terms, style.materials, rest)
    once = 1e3 * (time.perf_counter() - begin) / len(views) * WIDTH * HEIGHT / rest[0, ..., 0].numel()
    return [*rows, {"way": "materials", **_row(style, ours), "ms": once}]


def _time(way: Transfer, picture: Tensor, photo: Tensor) -> float:
    from torchrender.photo.photograph import resized

    picture, photo = resized(picture, WIDTH, HEIGHT), resized(photo, WIDTH, HEIGHT)
    times = []
    for _ in range(3):
        begin = time.perf_counter()
        way(picture, photo)
        times.append(time.perf_counter() - begin)
    return 1e3 * float(np.median(times))


def _row(style: Style, made: Tensor) -> dict[str, float]:
    """Over the pixels of objects: ab-distance of moments and of histograms per view, and drift per object."""
    wanted, moments, common = style.wanted(), [], []
    drift = []
    seen = style.problem.views.object
    for j in range(len(made)):
        lab = lab_from_linear(made[j][seen[j] >= 0].double())
        parts = style_terms(wanted, ColorStatistics.of(lab), "raw")
        moments.append((parts[0] + parts[1]) ** 0.5)
        common.append(parts[2])
    lab = lab_from_linear(made.double())
    for i in style.problem.views.visible.any(dim=1).nonzero().reshape(-1).tolist():
        means = [
            lab[j][seen[j] == i].mean(dim=0)
            for j in style.problem.views.visible[i].nonzero().reshape(-1).tolist()
        ]  # fmt: skip
        if len(means) < 2:
            continue
        colors = torch.stack(means).numpy()
        # Shading changes lightness from view to view; a colour that drifts changes hue and saturation.
        colors[:, 0] = colors[:, 0].mean()
        pairs = [deltaE_ciede2000(a, b) for k, a in enumerate(colors) for b in colors[:k]]
        drift.append(float(np.max(pairs)))
    return {
        "ab_distance": float(np.mean(moments)),
        "histogram": float(np.mean(common)),
        "drift": float(np.mean(drift)) if drift else 0.0,
    }
