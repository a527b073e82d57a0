"""Haar wavelets: closed forms, and brute force over every triple."""

from __future__ import annotations

import itertools

import pytest
import torch

from torchrender.errors import InputError
from torchrender.numerics.wavelets.haar import (
    Haar,
    basis,
    basis_images,
    first,
    inverse,
    transform,
    triple_integrals,
    triple_product,
    tripling_coefficient,
)


def random(*shape: int) -> torch.Tensor:
    return torch.rand(*shape, generator=torch.Generator().manual_seed(sum(shape))).double()


@pytest.mark.parametrize("side", [2, 4, 8])
def test_the_basis_is_orthonormal(side: int) -> None:
    images = basis_images(side).reshape(side * side, -1)
    assert torch.allclose(images @ images.T / side**2, torch.eye(side * side).double(), atol=1e-14)


def test_signs_make_the_third_kind_the_product_of_the_others() -> None:
    _, across, down, both = basis_images(2)
    assert torch.equal(across, torch.tensor([[1.0, -1.0], [1.0, -1.0]]).double())
    assert torch.equal(across * down, both)


@pytest.mark.parametrize("side", [2, 8, 32])
def test_transform_and_back(side: int) -> None:
    image = random(3, 2, side, side)
    made = transform(image)
    assert torch.allclose(inverse(made.means[..., 0], made.wavelets), image, atol=1e-14)
    assert made.levels == side.bit_length() - 1


def test_means_are_sums_of_coarser_wavelets() -> None:
    """The recursion of section 7.1 beside plain means over squares."""
    image = random(16, 16)
    made = transform(image)
    for level in range(4):
        for row, column in itertools.product(range(1 << level), repeat=2):
            total = float(made.means[0])
            for above in range(level):
                steps = level - above
                i, j = row >> steps, column >> steps
                qy, qx = (row >> (steps - 1)) & 1, (column >> (steps - 1)) & 1
                a, b, c = made.wavelets[first(above) + i * (1 << above) + j].tolist()
                x, y = 1 - 2 * qx, 1 - 2 * qy
                total += (1 << above) * (x * a + y * b + x * y * c)
            size = 16 >> level
            square = image[row * size : (row + 1) * size, column * size : (column + 1) * size]
            assert total == pytest.approx(float(square.mean()), abs=1e-14)
            assert float(made.means[first(level) + row * (1 << level) + column]) == pytest.approx(total, abs=1e-14)


@pytest.mark.parametrize(("side", "count"), [(2, 16), (4, 184), (8, 1288)])
def test_tripling_coefficients_are_integrals(side: int, count: int) -> None:
    """8 - 7 N + 9 N log4 N of them do not vanish, N = side^2."""
    integrals = triple_integrals(side)
    functions = list(basis(side))
    found = torch.zeros_like(integrals)
    for u, v, w in itertools.combinations_with_replacement(range(len(functions)), 3):
        value = tripling_coefficient(functions[u], functions[v], functions[w])
        for order in itertools.permutations((u, v, w)):
            found[order] = value
    assert torch.allclose(found, integrals, atol=1e-12)
    assert int((found != 0).sum()) == count


def test_triple_product_is_the_sum_over_texels() -> None:
    a, b, c = (random(6, 32, 32 + k)[..., k:] for k in range(3))
    found = triple_product(transform(a), transform(b), transform(c))
    assert torch.allclose(found, (a * b * c).mean((-1, -2)), rtol=0, atol=1e-13)


def test_the_printed_sum_fails() -> None:
    """The source repeats one of six products and leaves another out: it shows on random images."""
    a, b, c = (transform(random(6, 16, 16 + k)[..., k:]) for k in range(3))
    size = torch.cat([torch.full((4**level,), 2.0**level) for level in range(4)]).double()
    p, x, y = a.wavelets.unbind(-1), b.wavelets.unbind(-1), c.wavelets.unbind(-1)
    fault = triple_product(a, b, c) + (size * (p[2] * x[0] * y[1] - p[2] * x[1] * y[0])).sum(-1)
    wanted = triple_product(a, b, c)
    assert float((fault - wanted).abs().max()) > 1e-6


def test_the_complement_turns_wavelets_over() -> None:
    bits = (random(2, 32, 32) > 0.5).double()
    hidden, seen = transform(bits), transform(1 - bits)
    assert torch.equal(seen.wavelets, -hidden.wavelets)
    assert torch.equal(seen.means, 1 - hidden.means)


def test_gradients() -> None:
    image = random(1, 4, 4).requires_grad_()

    def product(value: torch.Tensor) -> torch.Tensor:
        made = transform(value)
        return triple_product(made, made, Haar(made.means, made.wavelets))

    assert torch.autograd.gradcheck(product, (image,))


@pytest.mark.parametrize("shape", [(4,), (3, 3), (4, 8), (1, 1)])
def test_sides_that_are_no_power_of_two(shape: tuple[int, ...]) -> None:
    with pytest.raises(InputError, match="power of two"):
        transform(torch.zeros(shape))
