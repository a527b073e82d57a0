"""Phong materials fitted to pixels by linear least squares (specification 11, section 4).

The printed system, expanded to first order about the exponent ``alpha0``, reads its fourth unknown as the exponent;
that holds only where k_s happens to be the value assumed for it. Its column space is kept, its reading is not:
``I ~ k_a + k_d d + k_s s^a0 + delta a0 s^a0 ln s`` with ``alpha = a0 (1 + delta / k_s)``, solved again about the
exponent found until that stays.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from scipy.optimize import lsq_linear
from torch import Tensor

from torchrender.checks import check_tensor, options_of
from torchrender.photo.style.options import FitOptions
from torchrender.photo.style.terms import DARK_MIRROR

MAX_EXPONENT = 200.0
NEUTRAL_EXPONENT = 20.0
LEAST_SPECULAR = 0.02
SETTLED = 1e-3
AMBIENT_SHARE = 0.2
"""Of the diffuse reflectance, in the prior."""
UNLIT_COSINE = 0.5
"""Assumed mean of d where the light reaches no pixel, which says nothing about k_d."""

Array = np.ndarray[Any, Any]


def printed_design(diffuse: Tensor, mirror: Tensor, alpha0: float = 20.0, specular0: float = 0.5) -> Tensor:
    """(N,4) rows of the system as published: ``[1, d, s^a0 (1 - a0 ln s), k_s0 s^a0 ln s]``.

    Unknowns ``[k_a, k_d, k_s, alpha]``; the last one means what it says only for k_s = k_s0, see
    :func:`corrected_exponent`.
    """
    power, slope = _lobe(mirror, alpha0)
    return torch.stack([torch.ones_like(diffuse), diffuse, power - alpha0 * slope, specular0 * slope], dim=1)


def corrected_exponent(printed: Tensor, specular: Tensor, specular0: float = 0.5) -> Tensor:
    """The exponent that a printed solution stands for: ``k_s0 alpha / k_s``; the neutral one where k_s < 0.02."""
    usable = specular > LEAST_SPECULAR
    return torch.where(usable, specular0 * printed / torch.where(usable, specular, 1.0), NEUTRAL_EXPONENT)


def design(diffuse: Tensor, mirror: Tensor, alpha0: float = 20.0) -> Tensor:
    """(N,4) rows ``[1, d, s^a0, a0 s^a0 ln s]`` of the unknowns ``[k_a, k_d, k_s, delta]``; N values d and s each."""
    power, slope = _lobe(mirror, alpha0)
    return torch.stack([torch.ones_like(diffuse), diffuse, power, alpha0 * slope], dim=1)


def _lobe(mirror: Tensor, alpha0: float) -> tuple[Tensor, Tensor]:
    """``s^a0`` and ``s^a0 ln s``, both 0 for s below ``DARK_MIRROR``."""
    shiny = mirror >= DARK_MIRROR
    log = torch.where(shiny, mirror, 1.0).log()
    power = torch.where(shiny, (alpha0 * log).exp(), 0.0)
    return power, power * log


def fit_phong(color: Tensor, diffuse: Tensor, mirror: Tensor, options: FitOptions | None = None) -> Tensor:
    """A material row ``[k_a (3), k_d (3), k_s, alpha]`` (8,) float64 from N pixels.

    Args:
        color: (N,3) linear light.
        diffuse: (N,) d = max(n.l, 0).
        mirror: (N,) s = max(r.v, 0).
        options: with ``spec_color`` the row has ten numbers, k_s for each channel.

    The solution minimises squared errors plus ``ridge N`` times the squared distance to a matt material of the mean
    colour, within k_a, k_d, k_s in [0,1] and alpha in [1,200]. A k_s below 0.02 counts as none.

    Raises:
        InputError: wrong shapes, or no pixel.
    """
    options = options_of(options, FitOptions)
    check_tensor("color", color, ("N", 3))
    check_tensor("diffuse", diffuse, (len(color),))
    check_tensor("mirror", mirror, (len(color),))
    if not len(color):
        return torch.tensor([0.0] * 7 + [NEUTRAL_EXPONENT], dtype=torch.float64)
    color, diffuse, mirror = color.double(), diffuse.double(), mirror.double()
    if not options.spec_color:
        return _fit_channels(color, diffuse, mirror, options)
    rows = [_fit_channels(color[:, c : c + 1], diffuse, mirror, options) for c in range(3)]
    ambient, matt, specular, exponent = (torch.stack([r[k] for r in rows]) for k in range(4))
    weight = float(specular.sum())
    alpha = float((specular * exponent).sum()) / weight if weight > 0 else NEUTRAL_EXPONENT
    return torch.cat([ambient, matt, specular, torch.tensor([alpha], dtype=torch.float64)])


def _fit_channels(color: Tensor, diffuse: Tensor, mirror: Tensor, options: FitOptions) -> Tensor:
    """``[k_a (C), k_d (C), k_s, alpha]`` of C channels that share one highlight."""
    prior = _Prior.of(color.mean(dim=0).numpy(), float(diffuse.mean()), options.ridge)
    lit = bool((diffuse > 0).any())
    if not options.specular or not lit or not bool((mirror >= DARK_MIRROR).any()):
        return _as_row(_matt(_normal_equations(color, diffuse, mirror, options.alpha0), prior, lit), None)
    alpha0 = options.alpha0
    for _ in range(options.refine + 1):
        system = _normal_equations(color, diffuse, mirror, alpha0)
        solution = _shiny(system, prior, alpha0)
        specular, delta = solution[-2], solution[-1]
        if specular < LEAST_SPECULAR:
            return _as_row(_matt(system, prior, lit), None)
        alpha = min(max(alpha0 * (1.0 + delta / specular), 1.0), MAX_EXPONENT)
        if abs(alpha - alpha0) < SETTLED * alpha0:
            break
        alpha0 = min(max(alpha, alpha0 / 2.0), alpha0 * 2.0)
    return _as_row(solution[:-2], (specular, alpha))


def _as_row(matt: Array, highlight: tuple[float, float] | None) -> Tensor:
    return torch.from_numpy(np.concatenate([matt, highlight or (0.0, NEUTRAL_EXPONENT)]))


# ------------------------------------------------------------------- systems


@dataclass(frozen=True, eq=False)
class _System:
    """``M^T M / N`` and ``M^T I / N``: everything that least squares needs of the pixels."""

    matrix: Array  # (4,4)
    right: Array  # (4,C)


@dataclass(frozen=True, eq=False)
class _Prior:
    """A matt material of the mean colour, and the weight of not being it."""

    ambient: Array  # (C,)
    diffuse: Array  # (C,)
    ridge: float

    @classmethod
    def of(cls, mean: Array, cosine: float, ridge: float) -> _Prior:
        matt = mean / (AMBIENT_SHARE + (cosine if cosine > 0 else UNLIT_COSINE))
        return cls(AMBIENT_SHARE * matt, matt, ridge)


def _normal_equations(color: Tensor, diffuse: Tensor, mirror: Tensor, alpha0: float) -> _System:
    rows = design(diffuse, mirror, alpha0)
    count = len(rows)
    return _System((rows.T @ rows / count).numpy(), (rows.T @ color / count).numpy())


def _stacked(system: _System, prior: _Prior) -> tuple[Array, Array]:
    """The system of all channels, unknowns ``[k_a (C), k_d (C), k_s, delta]``, with the prior's rows."""
    channels = system.right.shape[1]
    m, r = system.matrix, system.right
    size = 2 * channels + 2
    matrix, right = np.zeros((size, size)), np.zeros(size)
    for i in range(2):
        own = slice(i * channels, (i + 1) * channels)
        right[own] = r[i] + prior.ridge * (prior.ambient, prior.diffuse)[i]
        for j in range(2):
            matrix[own, j * channels : (j + 1) * channels] = m[i, j] * np.eye(channels)
        matrix[own, 2 * channels :] = m[i, 2:]
        matrix[2 * channels :, own] = m[2:, i][:, None]
    matrix[2 * channels :, 2 * channels :] = channels * m[2:, 2:]
    right[2 * channels :] = r[2:].sum(axis=1)
    return matrix + prior.ridge * np.eye(size), right


def _matt(system: _System, prior: _Prior, lit: bool) -> Array:
    """``[k_a (C), k_d (C)]`` without a highlight, each channel for itself."""
    channels = system.right.shape[1]
    if not lit:
        # Only ambient light is seen; the diffuse reflectance is that of a matt thing in usual light.
        diffuse = prior.diffuse / max(1.0, float(prior.diffuse.max()))
        return np.concatenate([np.clip(system.right[0], 0.0, 1.0), diffuse])
    matrix, right = _stacked(system, prior)
    keep = slice(0, 2 * channels)
    return _bounded(matrix[keep, keep], right[keep], np.zeros(2 * channels), np.ones(2 * channels))


def _shiny(system: _System, prior: _Prior, alpha0: float) -> Array:
    """``[k_a (C), k_d (C), k_s, delta]`` within all bounds.

    The exponent's bounds are two half planes, ``-k_s (1 - 1/a0) <= delta <= k_s (200/a0 - 1)``. In the distances u and
    w to them they are signs, so that an active-set solver for boxes finds the bounded minimum; where k_s <= 1 is
    broken, it holds with equality, because the problem is convex.
    """
    matrix, right = _stacked(system, prior)
    size = len(right)
    free = _free(matrix, right)
    low, high = 1.0 - 1.0 / alpha0, MAX_EXPONENT / alpha0 - 1.0
    specular, delta = free[-2], free[-1]
    if free[:-1].min() >= 0.0 and free[:-1].max() <= 1.0 and -low * specular <= delta <= high * specular:
        return free
    change = np.eye(size)
    change[-2:, -2:] = np.array([[1.0, 1.0], [high, -low]]) / (low + high)
    ceiling = np.ones(size)
    ceiling[-2:] = np.inf
    found = change @ _bounded(change.T @ matrix @ change, change.T @ right, np.zeros(size), ceiling)
    if found[-2] <= 1.0:
        return found
    others = [k for k in range(size) if k != size - 2]
    floor, ceiling = np.zeros(size - 1), np.ones(size - 1)
    floor[-1], ceiling[-1] = -low, high
    rest = right[others] - matrix[others, size - 2]
    part = _bounded(matrix[np.ix_(others, others)], rest, floor, ceiling)
    return np.concatenate([part[:-1], [1.0], part[-1:]])


def _free(matrix: Array, right: Array) -> Array:
    """The unbounded minimum; of least length where the pixels leave something open."""
    try:
        return np.linalg.solve(matrix, right)
    except np.linalg.LinAlgError:
        return np.linalg.lstsq(matrix, right, rcond=None)[0]


def _bounded(matrix: Array, right: Array, low: Array, high: Array) -> Array:
    """Minimum of ``x^T A x / 2 - b^T x`` within a box, A symmetric and not negative."""
    free = _free(matrix, right)
    if np.isfinite(free).all() and (free >= low).all() and (free <= high).all():
        return free
    values, vectors = np.linalg.eigh(matrix)
    # A root of A; directions that the pixels say nothing about keep a trace, so that they stay where b is zero.
    root = np.sqrt(np.maximum(values, 1e-14 * max(values[-1], 1e-300)))
    rows = root[:, None] * vectors.T
    return lsq_linear(rows, (vectors.T @ right) / root, (low, high), method="bvls", tol=1e-14).x
