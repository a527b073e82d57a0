"""The GGX microfacet lobe, the clear coat's Fresnel term and the sheen lobe, as functions of cosines.

Sources: Walter et al., *Microfacet models for refraction through rough surfaces*, 2007 (GGX); Heitz, *Understanding the
masking-shadowing function in microfacet-based BRDFs*, 2014 (height-correlated Smith term); Schlick 1994; Estevez and
Kulla, *Production friendly microfacet sheen BRDF*, 2017 (sheen); Neubelt and Pettineo, *Crafting a next-gen material
pipeline for The Order: 1886*, 2013 (its visibility term).
"""

from __future__ import annotations

import math

import torch
from torch import Tensor

SMOOTHEST = 0.045
"""Least roughness that small lights are seen with: a perfect mirror would show them in no pixel at all."""

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
