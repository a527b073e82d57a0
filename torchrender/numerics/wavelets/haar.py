"""Two-dimensional Haar wavelets of square images, and integrals of products of three of them.

An image of side S = 2^k is a function on [0,1]^2 that is constant on texels. Squares of level l = 0 ... k-1 have the
side 2^-l; they are numbered level by level and row by row, so that square (row, column) of level l has the number
``first(l) + row 2^l + column``. Each carries three wavelets, in the order 01 (left less right), 10 (top less bottom)
and 11 (their product), of height 2^l: with the constant 1 they form an orthonormal basis.

Source: Ng, Ramamoorthi and Hanrahan, *Triple product wavelet integrals for all-frequency relighting*, 2004; and
specification 08, sections 6 and 7.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from typing import NamedTuple

import torch
from torch import Tensor

from torchrender.checks import check_tensor
from torchrender.errors import InputError

SIGNS = torch.tensor([[1.0, -1.0, 1.0, -1.0], [1.0, 1.0, -1.0, -1.0], [1.0, -1.0, -1.0, 1.0]], dtype=torch.float64)
"""(3,4) sign of each wavelet in its four quarters: top left, top right, bottom left, bottom right."""


@dataclass(frozen=True, eq=False)
class Haar:
    """Images (...,S,S) in the basis."""

    means: Tensor  # (...,N) of every square, N = (S^2 - 1) / 3; the first is the coefficient of the constant
    wavelets: Tensor  # (...,N,3)

    @property
    def levels(self) -> int:
        """Levels of squares: the binary logarithm of S."""
        return level_count(self.means.shape[-1])


def first(level: int) -> int:
    """Number of the first square of a level."""
    return int((4**level - 1) // 3)


def level_count(squares: int) -> int:
    """Levels that so many squares make."""
    return int((3 * squares + 1).bit_length() - 1) // 2


@cache
def square_levels(levels: int) -> Tensor:
    """(N,) int64 level of each square."""
    return torch.cat([torch.full((4**level,), level) for level in range(levels)])


def transform(image: Tensor) -> Haar:
    """Images (...,S,S) in the basis; S is a power of two, at least 2. Differentiable.

    Raises:
        InputError: sides that are not such a number.
    """
    side = image.shape[-1]
    if image.dim() < 2 or image.shape[-2] != side or side < 2 or side & (side - 1):
        raise InputError(f"image must have shape (..., S, S) with S a power of two from 2 on, got {tuple(image.shape)}")
    signs = SIGNS.to(image.dtype)
    means, wavelets = [], []
    mean = image
    for level in range(side.bit_length() - 2, -1, -1):
        count = 1 << level
        parts = mean.reshape(*mean.shape[:-2], count, 2, count, 2).transpose(-3, -2)
        quarters = parts.reshape(*mean.shape[:-2], count * count, 4)
        wavelets.append(quarters @ signs.T * (0.25 / count))
        means.append(quarters.mean(dim=-1))
        mean = means[-1].reshape(*mean.shape[:-2], count, count)
    return Haar(torch.cat(means[::-1], dim=-1), torch.cat(wavelets[::-1], dim=-2))


def inverse(scaling: Tensor, wavelets: Tensor) -> Tensor:
    """Images (...,S,S) of a coefficient (...) of the constant and wavelets (...,N,3). Differentiable."""
    signs = SIGNS.to(wavelets.dtype)
    image = scaling[..., None, None]
    for level in range(level_count(wavelets.shape[-2])):
        count, start = 1 << level, first(level)
        change = wavelets[..., start : start + count * count, :] @ signs * count
        quarters = image.reshape(*image.shape[:-2], count * count, 1) + change
        parts = quarters.reshape(*image.shape[:-2], count, count, 2, 2).transpose(-3, -2)
        image = parts.reshape(*image.shape[:-2], 2 * count, 2 * count)
    return image


def triple_product(a: Haar, b: Haar, c: Haar) -> Tensor:
    """Integrals (...) of the products of three images over [0,1]^2: the sum over all coefficients that do not vanish.

    Three wavelets of the same square and of different types, in all six orders; pairs of the same wavelet times the
    mean of the third image over its square, which is the sum of all coarser wavelets of that image there.
    """
    size = torch.pow(2.0, square_levels(a.levels).double()).to(a.means.dtype)
    total = a.means[..., 0] * b.means[..., 0] * c.means[..., 0]
    for one, two, three in itertools.permutations(range(3)):
        product = a.wavelets[..., one] * b.wavelets[..., two] * c.wavelets[..., three]
        total = total + (size * product).sum(dim=-1)
    for x, y, z in ((a, b, c), (a, c, b), (b, c, a)):
        total = total + ((x.wavelets * y.wavelets).sum(dim=-1) * z.means).sum(dim=-1)
    return total


class Basis(NamedTuple):
    """A function of the basis."""

    level: int  # -1: the constant
    row: int
    column: int
    kind: int  # 0, 1, 2: wavelets 01, 10, 11


CONSTANT = Basis(-1, 0, 0, 0)


def basis(side: int) -> Iterator[Basis]:
    """All functions of the basis of images of a side."""
    yield CONSTANT
    for level in range(side.bit_length() - 1):
        for row, column, kind in itertools.product(range(1 << level), range(1 << level), range(3)):
            yield Basis(level, row, column, kind)


def basis_images(side: int) -> Tensor:
    """(S^2,S,S) float64: the basis, as :func:`basis` lists it."""
    squares = (side * side - 1) // 3
    scaling, wavelets = torch.zeros(side * side).double(), torch.zeros(side * side, squares, 3).double()
    scaling[0] = 1.0
    for number, f in enumerate(basis(side)):
        if number:
            wavelets[number, first(f.level) + f.row * (1 << f.level) + f.column, f.kind] = 1.0
    return inverse(scaling, wavelets)


def tripling_coefficient(u: Basis, v: Basis, w: Basis) -> float:
    """Integral of the product of three functions of the basis, in closed form."""
    coarse, *pair = sorted((u, v, w), key=lambda f: f.level)
    if pair[0].level < 0 or pair[1].level < 0:
        return 1.0 if pair[1].level < 0 else 0.0
    if coarse[:3] == pair[0][:3] == pair[1][:3]:
        return float(1 << coarse.level) if {coarse.kind, pair[0].kind, pair[1].kind} == {0, 1, 2} else 0.0
    if pair[0] != pair[1]:
        return 0.0
    if coarse.level < 0:
        return 1.0
    fine = pair[0]
    steps = fine.level - coarse.level
    if steps == 0 or (fine.row >> steps, fine.column >> steps) != (coarse.row, coarse.column):
        return 0.0
    quarter = 2 * ((fine.row >> (steps - 1)) & 1) + ((fine.column >> (steps - 1)) & 1)
    return float(1 << coarse.level) * float(SIGNS[coarse.kind, quarter])


def triple_integrals(side: int) -> Tensor:
    """(S^2,S^2,S^2) float64 by brute force: products of images, summed."""
    images = check_tensor("images", basis_images(side), ("N", side, side)).reshape(side * side, -1)
    return torch.einsum("ux,vx,wx->uvw", images, images, images) / (side * side)
