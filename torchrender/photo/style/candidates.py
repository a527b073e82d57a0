"""Candidates: the material that each photo, laid over each view, gives each object."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
import torch
from torch import Tensor

from torchrender.photo.dominant import dominant_pixels
from torchrender.photo.lab import lab_from_linear
from torchrender.photo.photograph import Photo, resized
from torchrender.photo.style.options import NEUTRAL, FitOptions, StyleOptions
from torchrender.photo.style.phong import fit_phong
from torchrender.photo.style.prior import CEILING, WALL
from torchrender.photo.style.terms import ViewTerms
from torchrender.photo.style.views import Views

MIN_PIXELS = 50
SATURATED = 0.98
START_CLUSTERS = 3


@dataclass(frozen=True, eq=False)
class Candidates:
    """C candidates for each of m objects; without several photos or picks, candidate c comes from view c."""

    materials: Tensor  # (m,C,8|10) float64
    valid: Tensor  # (m,C) bool
    misfit: Tensor  # (m,C) float64 in [0,1]: how far the photo over the object is from the material, 0 where not valid

    @property
    def rendered(self) -> Tensor:
        """(m,C) bool candidates that can be chosen: valid ones, and the first, neutral one of an object without any."""
        out = self.valid.clone()
        out[:, 0] |= ~self.valid.any(dim=1)
        return out

    def with_column(self, rows: Tensor, chosen: Tensor) -> Candidates:
        """One candidate more: ``rows`` (m,8|10), of use for the objects ``chosen`` (m,) bool."""
        materials = torch.cat([self.materials, rows[:, None]], dim=1)
        misfit = torch.cat([self.misfit, torch.zeros(len(rows), 1, dtype=torch.float64)], dim=1)
        return Candidates(materials, torch.cat([self.valid, chosen[:, None]], dim=1), misfit)


def neutral(width: int = 8) -> Tensor:
    """(8|10,) float64 material of an object that nothing is known of."""
    row = torch.tensor(NEUTRAL, dtype=torch.float64)
    return row if width == 8 else torch.cat([row[:6], row[6:7].expand(3), row[7:]])


def fit_pixels(color: Tensor, terms: tuple[Tensor, Tensor], options: FitOptions) -> tuple[Tensor, float] | None:
    """Material row of one object from the photo's pixels (N,3) over it, and its misfit; None where too few are left.

    ``terms`` are d and s, (N,) each. The pixels are thinned, the largest colour cluster is kept, and saturated pixels
    are left out unless nothing else is there: a blown-out wall is at least white. The misfit is the mean distance in
    Lab of all pixels to what the material shows there, over 100: small where the photo has one thing behind the whole
    object.
    """
    if len(color) > options.max_pixels:
        rows = torch.arange(options.max_pixels) * len(color) // options.max_pixels
        color, terms = color[rows], (terms[0][rows], terms[1][rows])
    lab = lab_from_linear(color.double())
    kept = dominant_pixels(lab.float(), options.seeds)
    # 0.98 of the code in the picture file.
    clean = kept & (color.amax(dim=1) <= ((SATURATED + 0.055) / 1.055) ** 2.4)
    kept = clean if int(clean.sum()) >= MIN_PIXELS else kept
    if int(kept.sum()) < MIN_PIXELS:
        return None
    row = fit_phong(color[kept], terms[0][kept], terms[1][kept], options)
    shown = row[:3] + terms[0][:, None] * row[3:6] + row[6:-1] * terms[1][:, None].pow(row[-1])
    return row, min(float((lab_from_linear(shown) - lab).norm(dim=1).mean()) / 100.0, 1.0)


def fit_of(options: FitOptions, role: int) -> FitOptions:
    """How an object of this role is fitted."""
    matt = role in (CEILING, WALL) and not options.glossy_walls
    return replace(options, specular=False) if matt else options


def fit_candidates(
    photos: Sequence[Photo], views: Views, terms: tuple[ViewTerms, ...], options: StyleOptions, role: Tensor
) -> Candidates:
    """Candidates of all objects, whose roles (m,) say how they are fitted: photo by photo, view by view."""
    count, width = len(views.visible), 10 if options.fit.spec_color else 8
    made = neutral(width).expand(count, len(photos) * len(views), width).clone()
    valid = torch.zeros(made.shape[:2], dtype=torch.bool)
    misfit = torch.zeros(made.shape[:2], dtype=torch.float64)
    shape = (views.cameras.width, views.cameras.height)
    for p, photo in enumerate(photos):
        laid = photo.laid_over(*shape, options.place).reshape(-1, 3)
        for j, view in enumerate(terms):
            order = view.object.argsort(stable=True)
            ends = torch.bincount(view.object, minlength=count).cumsum(0).tolist()
            for i in views.visible[:, j].nonzero().reshape(-1).tolist():
                own = order[(ends[i - 1] if i else 0) : ends[i]]
                seen = view.diffuse[own], view.mirror[own]
                found = fit_pixels(laid[view.row[own]], seen, fit_of(options.fit, int(role[i])))
                if found is not None:
                    place = i, p * len(views) + j
                    (made[place], misfit[place]), valid[place] = found, True
    return Candidates(made, valid, misfit)


def fit_region(pixels: Tensor, index: int, views: Views, terms: tuple[ViewTerms, ...], options: FitOptions) -> Tensor:
    """Material row of one object from a region (h,w,3) of a photo, stretched over the object where it is largest.

    Without clear pixels enough it is a matt material of the region's main colour.
    """
    width = 10 if options.spec_color else 8
    if int(views.pixels[index].max()) > 0:
        j = int(views.pixels[index].argmax())
        view = terms[j]
        own = (view.object == index).nonzero().reshape(-1)
        row, column = view.row[own] // views.cameras.width, view.row[own] % views.cameras.width
        top, left = int(row.min()), int(column.min())
        laid = resized(pixels, int(column.max()) - left + 1, int(row.max()) - top + 1)
        made = fit_pixels(laid[row - top, column - left], (view.diffuse[own], view.mirror[own]), options)
        if made is not None:
            return made[0]
    flat = pixels.reshape(-1, 3).double()
    kept = dominant_pixels(lab_from_linear(flat).float(), options.seeds)
    color = flat[kept].mean(dim=0)
    out = neutral(width)
    diffuse = color / (0.2 + 0.5)
    out[3:6] = diffuse / max(1.0, float(diffuse.max()))
    out[:3] = 0.2 * out[3:6]
    return out


def without_doubles(candidates: Candidates) -> Tensor:
    """(m,C) bool: valid, and not equal to an earlier valid candidate of the same object."""
    rows, valid = candidates.materials, candidates.valid
    same = (rows[:, :, None] == rows[:, None]).all(dim=-1) & valid[:, None]
    earlier = torch.ones(valid.shape[1], valid.shape[1]).tril(-1).bool()
    return valid & ~(same & earlier).any(dim=-1)


def _clusters(rows: np.ndarray, count: int, seed: int) -> np.ndarray:
    """(N,) label of each row; exponents are scaled to the size of the other numbers."""
    points = rows.astype(np.float32)
    points[:, -1] /= 100.0
    count = min(count, len(np.unique(points, axis=0)))
    if count <= 1:
        return np.zeros(len(points), dtype=np.int64)
    cv2.setRNGSeed(seed)
    until = (cv2.TERM_CRITERIA_MAX_ITER | cv2.TERM_CRITERIA_EPS, 30, 1e-5)
    _, labels, _ = cv2.kmeans(points, count, None, until, 3, cv2.KMEANS_PP_CENTERS)
    return np.asarray(labels[:, 0], dtype=np.int64)


def _medoid(rows: np.ndarray) -> int:
    points = rows.copy()
    points[:, -1] /= 100.0
    return int(np.linalg.norm(points[:, None] - points[None], axis=2).sum(axis=1).argmin())


def start_choice(materials: Tensor, usable: Tensor, seed: int) -> Tensor:
    """(m,) int64 start of the search: the medoid of the largest of three clusters of each object's candidates."""
    choice = torch.zeros(len(usable), dtype=torch.int64)
    for i in range(len(usable)):
        columns = usable[i].nonzero().reshape(-1)
        if len(columns):
            rows = materials[i, columns].numpy()
            labels = _clusters(rows, START_CLUSTERS, seed)
            largest = np.flatnonzero(labels == np.bincount(labels).argmax())
            choice[i] = columns[largest[_medoid(rows[largest])]]
    return choice


def thinned(materials: Tensor, usable: Tensor, count: int, seed: int) -> Tensor:
    """(m,C) bool: of each object's usable candidates the medoids of at most ``count`` clusters."""
    out = torch.zeros_like(usable)
    for i in range(len(usable)):
        columns = usable[i].nonzero().reshape(-1)
        if not len(columns):
            continue
        rows = materials[i, columns].numpy()
        labels = _clusters(rows, count, seed)
        for label in np.unique(labels):
            members = np.flatnonzero(labels == label)
            out[i, columns[members[_medoid(rows[members])]]] = True
    return out
