"""The GGX microfacet lobe, Fresnel's term of dielectrics and the sheen lobe, as functions of cosines.

Sources: Walter et al., *Microfacet models for refraction through rough surfaces*, 2007 (GGX); Heitz, *Understanding the
masking-shadowing function in microfacet-based BRDFs*, 2014 (height-correlated Smith term); Schlick 1994; Estevez and
Kulla, *Production friendly microfacet sheen BRDF*, 2017 (sheen); Neubelt and Pettineo, *Crafting a next-gen material
pipeline for The Order: 1886*, 2013 (its visibility term).
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

SMOOTHEST = 0.045
"""Least roughness that small lights are seen with: a perfect mirror would show them in no pixel at all."""

EXCESS_OF = (1.5, 1.2)
"""Indices of refraction whose excess over Schlick's term tables hold; the first is that of clear coats."""
LEAST_IOR = 1.05

LEAST_COSINE = 1e-3
"""Cosines to the eye and to lights count as at least this much in denominators."""


def ggx_alpha(roughness: Tensor) -> Tensor:
    """Width (...) of the lobe: the square of the roughness, which is taken as at least :data:`SMOOTHEST`."""
    return roughness.clamp_min(SMOOTHEST).square()


def ggx_lobe(sine_square: Tensor, to_light: Tensor, to_eye: Tensor, alpha: Tensor) -> Tensor:
    """``D G / (4 cos cos)`` (N,) per steradian.

    Args:
        sine_square: (N,) squared sine between normal and half vector: exact where its cosine would lose all digits.
        to_light, to_eye: (N,) cosines to the normal.
        alpha: (N,) width.
    """
    square = alpha * alpha
    spread = sine_square + square * (1.0 - sine_square)
    distribution = square / (math.pi * spread * spread)
    light, eye = to_light.clamp_min(LEAST_COSINE), to_eye.clamp_min(LEAST_COSINE)
    masked = (
        light * (eye * eye * (1.0 - square) + square).sqrt() + eye * (light * light * (1.0 - square) + square).sqrt()
    )
    return distribution * 0.5 / masked


def fifth_power(cosine: Tensor) -> Tensor:
    """``(1 - cos)^5``, Schlick's weight of grazing angles."""
    one = (1.0 - cosine).clamp(0.0, 1.0)
    square = one * one
    return square * square * one


def dielectric_fresnel(slowed: Tensor | float, cosine: Tensor) -> Tensor:
    """Share (...) of unpolarised light that the smooth face of a dielectric mirrors; 1 at grazing angles.

    Args:
        slowed: (...) squared index of refraction less one, above zero.
        cosine: (...) in [0,1] between its normal and the light.

    Fresnel's term with the cosine within taken out: nothing cancels in float32.
    """
    far = (slowed + cosine * cosine).sqrt() + cosine
    across = slowed / (far * far)
    along = (cosine * far - 1.0) / (cosine * across * far + 1.0)
    return 0.5 * across.square() * (1.0 + along.square())


def fresnel_excess(ior: float, cosine: Tensor) -> Tensor:
    """What Fresnel's term exceeds Schlick's by (...), at cosines (...); below zero near grazing angles."""
    reflectance = ((ior - 1.0) / (ior + 1.0)) ** 2
    schlick = reflectance + (1.0 - reflectance) * fifth_power(cosine)
    return dielectric_fresnel(ior * ior - 1.0, cosine) - schlick


class Refraction(NamedTuple):
    """What Fresnel's term of one dielectric needs, see :func:`refraction`."""

    reflectance: float  # along the normal
    slowed: float  # squared index less one
    excess: tuple[float, float]  # of the indices EXCESS_OF: what their terms exceed Schlick's by adds up to its own
    share: float  # of all of that; 1 but for indices next to one


@lru_cache(maxsize=1024)
def refraction(ior: float) -> Refraction:
    """Numbers of a dielectric of an index of refraction of at least 1.

    Albedos are linear in what is mirrored, so that a table for two indices serves all: the sum of their two excesses,
    fitted over the hemisphere, is within 2e-3 of that of any index from 1.2 to 2 and within 0.015 up to 3, and means
    over all directions are within 1 %. Between 1 and 1.05 the term of the latter shrinks: at 1 nothing is mirrored.
    """
    used = max(ior, LEAST_IOR)
    points, weights = np.polynomial.legendre.leggauss(64)
    cosine = torch.from_numpy((points + 1.0) / 2.0)
    root = (torch.from_numpy(weights) * (cosine + 0.025)).sqrt()
    known = torch.stack([fresnel_excess(one, cosine) for one in EXCESS_OF], dim=1) * root[:, None]
    wanted = fresnel_excess(used, cosine) * root
    first, second = torch.linalg.lstsq(known, wanted[:, None]).solution[:, 0].tolist()
    share = 1.0 if ior >= LEAST_IOR else (ior - 1.0) / (LEAST_IOR - 1.0)
    return Refraction(((used - 1.0) / (used + 1.0)) ** 2, used * used - 1.0, (first, second), share)


def sheen_lobe(sine_square: Tensor, to_light: Tensor, to_eye: Tensor, roughness: Tensor) -> Tensor:
    """The sheen lobe (N,) per steradian: Charlie's distribution with Neubelt's visibility term."""
    inverse = 1.0 / roughness.clamp_min(0.07).square()
    distribution = (2.0 + inverse) * sine_square.clamp_min(1e-12).pow(0.5 * inverse) / (2.0 * math.pi)
    light, eye = to_light.clamp_min(LEAST_COSINE), to_eye.clamp_min(LEAST_COSINE)
    return distribution / (4.0 * (light + eye - light * eye))


def half_vector_terms(normal: Tensor, to_eye: Tensor, to_light: Tensor) -> tuple[Tensor, Tensor]:
    """Squared sine (N,) of the half vector to the normal, cosine (N,) to the eye; all unit vectors (3,N)."""
    half = to_eye + to_light
    half = half / half.square().sum(0).sqrt().clamp_min(1e-18)
    sine = torch.linalg.cross(normal, half, dim=0).square().sum(0)
    return sine.clamp(0.0, 1.0), (to_eye * half).sum(0).clamp(0.0, 1.0)
