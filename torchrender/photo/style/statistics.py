"""Colour statistics of pictures in Lab, how far two are apart, and tables that answer for any choice of materials.

``E(S,V) = |mu_S - mu_V|^2 + |sigma_S - sigma_V|^2 + 1 - sum_bins min(H_S, H_V)`` over Lab a and b. The source minimises
the intersection itself, which is larger for pictures that are more alike; here it is one minus that.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from torchrender.checks import check_choice, check_range, check_tensor
from torchrender.errors import InputError
from torchrender.photo.dominant import palette
from torchrender.photo.lab import lab_from_linear
from torchrender.photo.photograph import Photo
from torchrender.photo.style.terms import ViewTerms, radiance

AB_RANGE = 128.0
UNITS = {"normalized": 1.0 / AB_RANGE, "raw": 1.0}


@dataclass(frozen=True, eq=False)
class ColorStatistics:
    """Of the pixels of one picture."""

    mean: Tensor  # (2,) float64 of a and b
    deviation: Tensor  # (2,) float64
    histogram: Tensor  # (bins*bins,) float64, sum 1 (0 without pixels); b runs fastest

    @classmethod
    def of(cls, lab: Tensor, bins: int = 32, weights: Tensor | None = None) -> ColorStatistics:
        """Of Lab pixels (N,3), each with a weight (N,) >= 0. No pixel, or no weight: all zero.

        Raises:
            InputError: another shape. OptionError: ``bins`` outside [8, 64].
        """
        check_tensor("lab", lab, ("N", 3))
        check_range("bins", bins, 8, 64)
        lab = lab.double()
        weight = torch.ones(len(lab), dtype=torch.float64) if weights is None else weights.double()
        check_tensor("weights", weight, (len(lab),))
        total = float(weight.sum())
        if not total > 0:
            zero = torch.zeros(2, dtype=torch.float64)
            return cls(zero, zero, torch.zeros(bins * bins, dtype=torch.float64))
        ab = lab[:, 1:]
        mean = weight @ ab / total
        square = weight @ ab.square() / total
        counts = torch.bincount(ab_bin(lab, bins), weight, minlength=bins * bins)
        return cls(mean, (square - mean.square()).clamp_min(0.0).sqrt(), counts / total)


def photo_pixels(photos: Sequence[Photo]) -> tuple[Tensor, Tensor]:
    """Lab (N,3) of all pixels of all photos, and weights (N,) that sum to one for each photo."""
    weights = [torch.full((len(p.lab),), 1.0 / len(p.lab), dtype=torch.float64) for p in photos]
    return torch.cat([p.lab for p in photos]), torch.cat(weights)


def photo_statistics(
    photos: Sequence[Photo], bins: int = 32, weights: Sequence[float] | None = None, seed: int = 0
) -> ColorStatistics:
    """Of photos that count alike; ``weights`` multiply what the colours of their palette of that size count."""
    lab, weight = photo_pixels(photos)
    if weights is not None:
        _, label = palette(lab, len(weights), seed=seed)
        weight = weight * torch.tensor(list(weights), dtype=torch.float64)[label]
    return ColorStatistics.of(lab, bins, weight)


def ab_bin(lab: Tensor, bins: int) -> Tensor:
    """(N,) int64 bin of Lab pixels (N,3) in a histogram over [-128,128) squared."""
    cell = ((lab[:, 1:] + AB_RANGE) * (bins / (2 * AB_RANGE))).floor().long().clamp_(0, bins - 1)
    return cell[:, 0] * bins + cell[:, 1]


def style_terms(
    wanted: ColorStatistics, seen: ColorStatistics, units: str = "normalized"
) -> tuple[float, float, float]:
    """The three parts of E: means, deviations, histograms; symmetric, and 0 for a picture and itself.

    Raises:
        OptionError: other ``units``. InputError: histograms of different size.
    """
    check_choice("units", units, tuple(UNITS))
    if wanted.histogram.shape != seen.histogram.shape:
        raise InputError("both histograms must have the same number of bins")
    scale = UNITS[units]
    mean = float((scale * (wanted.mean - seen.mean)).square().sum())
    deviation = float((scale * (wanted.deviation - seen.deviation)).square().sum())
    common = float(torch.minimum(wanted.histogram, seen.histogram).sum())
    return mean, deviation, min(max(1.0 - common, 0.0), 1.0)


def style_distance(wanted: ColorStatistics, seen: ColorStatistics, units: str = "normalized") -> float:
    """E of two pictures."""
    return sum(style_terms(wanted, seen, units))


@dataclass(frozen=True, eq=False)
class StyleTables:
    """Sums over the pixels of object i in view j with candidate c, for the P pairs (i,j) where there are any.

    Without inter-reflection a pixel depends on the material of its own object alone, so sums over a view with any
    choice are sums of rows here: exactly what rendering it would give, without rendering. Pairs are sorted by object.
    """

    object: np.ndarray  # (P,) int64
    view: np.ndarray  # (P,) int64
    count: np.ndarray  # (P,) float64 pixels
    sums: np.ndarray  # (P,C,5) float64: sums of a, b, a^2, b^2, L
    counts: np.ndarray  # (P,C,K) float32 pixels by used bin
    bins: np.ndarray  # (K,) int64 bins that any candidate reaches
    side: int  # bins per side
    objects: int  # m
    views: int  # n

    def joined(self, other: StyleTables) -> StyleTables:
        """More candidates for the same pairs."""
        bins = np.union1d(self.bins, other.bins)
        counts = np.zeros((*self.counts.shape[:1], self.counts.shape[1] + other.counts.shape[1], len(bins)), np.float32)
        counts[:, : self.counts.shape[1], np.searchsorted(bins, self.bins)] = self.counts
        counts[:, self.counts.shape[1] :, np.searchsorted(bins, other.bins)] = other.counts
        sums = np.concatenate([self.sums, other.sums], axis=1)
        return StyleTables(
            self.object, self.view, self.count, sums, counts, bins, self.side, self.objects, self.views
        )  # fmt: skip

    def mean_lightness(self) -> np.ndarray:
        """(m,C) mean L of each object over its pixels in all views; 0 where it has none."""
        total = np.zeros((self.objects, self.sums.shape[1]))
        pixels = np.zeros(self.objects)
        np.add.at(total, self.object, self.sums[:, :, 4])
        np.add.at(pixels, self.object, self.count)
        return total / np.maximum(pixels, 1.0)[:, None]


def build_tables(
    terms: Sequence[ViewTerms], materials: Tensor, bins: int = 32, wanted: Tensor | None = None
) -> StyleTables:
    """Tables of candidates (m,C,8|10), rendering every view once with every candidate.

    Only those ``wanted`` (m,C) bool are rendered (None: all); the rows of others are zero.
    """
    count, columns = materials.shape[:2]
    wanted = torch.ones(count, columns, dtype=torch.bool) if wanted is None else wanted
    parts = [_view_table(view, materials, bins, wanted) for view in terms]
    used = torch.zeros(bins * bins, dtype=torch.bool)
    for _, _, _, histogram in parts:
        used |= (histogram > 0).any(dim=0).any(dim=0)
    kept = used.nonzero().reshape(-1)
    objects = torch.cat([p[0] for p in parts])
    views = torch.cat([torch.full((len(p[0]),), j) for j, p in enumerate(parts)])
    order = (objects * len(terms) + views).argsort()
    pixels = torch.cat([p[1] for p in parts])
    # Nothing may be wanted that any view shows: sizes are named, for none follows from no elements.
    sums = torch.cat([p[2] for p in parts]).reshape(len(objects), columns, 5)
    counts = torch.cat([p[3][..., kept] for p in parts]).reshape(len(objects), columns, len(kept))
    return StyleTables(
        object=objects[order].numpy(),
        view=views[order].numpy(),
        count=pixels[order].double().numpy(),
        sums=sums[order].numpy(),
        counts=counts[order].numpy(),
        bins=kept.numpy(),
        side=bins,
        objects=count,
        views=len(terms),
    )


def _view_table(view: ViewTerms, materials: Tensor, bins: int, wanted: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """Of one view: objects (p,), pixels (p,), sums (p,C,5), counts (p,C,bins^2) float32."""
    pixels = torch.bincount(view.object, minlength=len(materials))
    present = (pixels > 0).nonzero().reshape(-1)
    place = torch.zeros(len(materials), dtype=torch.int64)
    place[present] = torch.arange(len(present))
    columns = materials.shape[1]
    sums = torch.zeros(len(present), columns, 5, dtype=torch.float64)
    counts = torch.zeros(len(present), columns, bins * bins)
    for c in range(columns):
        part = view.of(wanted[:, c])
        if not len(part.row):
            continue
        own = place[part.object]
        lab = lab_from_linear(radiance(part, materials[:, c]))
        a, b = lab[:, 1], lab[:, 2]
        for k, value in enumerate((a, b, a * a, b * b, lab[:, 0])):
            sums[:, c, k] = torch.bincount(own, value, minlength=len(present))
        key = own * (bins * bins) + ab_bin(lab, bins)
        counts[:, c] = torch.bincount(key, minlength=len(present) * bins * bins).reshape(len(present), -1).float()
    return present, pixels[present], sums, counts


def rendered_distance(
    terms: Sequence[ViewTerms], materials: Tensor, wanted: ColorStatistics, units: str = "normalized"
) -> Tensor:
    """(n,3) float64 parts of E of every view, rendered whole with materials (m,8|10): what the tables must equal."""
    side = round(len(wanted.histogram) ** 0.5)
    parts = [
        style_terms(wanted, ColorStatistics.of(lab_from_linear(radiance(view, materials)), side), units)
        if len(view.row)
        else (0.0, 0.0, 0.0)
        for view in terms
    ]
    return torch.tensor(parts, dtype=torch.float64)
