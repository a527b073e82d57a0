"""Radiance of N points under lights and sky: Phong's lobe, or GGX with coat and sheen.

Metallic-roughness follows glTF 2.0, with Schlick's term for metals and Fresnel's own for what is none. What the lobe of
one bounce between microfacets loses comes back with the colour of the metal (Turquin, *Practical multiple scattering
compensation for microfacet models*, 2019), so that a white metal sends back all light at every roughness. The diffuse
part gets what is not mirrored, on the way in and on the way out (Kelemen and Szirmay-Kalos, *A microfacet based coupled
specular-matte BRDF model*, 2001): reciprocal, never above one.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import torch
from torch import Tensor

from torchrender.numerics.ggx import (
    EXCESS_OF,
    dielectric_fresnel,
    fifth_power,
    ggx_alpha,
    ggx_lobe,
    half_vector_terms,
    sheen_lobe,
)
from torchrender.numerics.lobe import schlick
from torchrender.numerics.lobe_albedo import albedo_table, look_up, mean_albedo, sheen_albedo
from torchrender.numerics.split_sum import directional_albedo
from torchrender.shading.lights import Lit
from torchrender.shading.linear_cosines import nearest_point
from torchrender.shading.sky import Sky, SkyLobe, sky_lobe
from torchrender.shading.surface import Surface

COAT_F0, COAT_SLOWED = 0.04, EXCESS_OF[0] ** 2 - 1.0


class Around(NamedTuple):
    """How much of the light from all around reaches N points."""

    visibility: Tensor | None = None  # (N,) share
    normal: Tensor | None = None  # (3,N) unit mean direction that it comes from; None: the surface's normal

    def towards(self, normal: Tensor, smooth: Tensor) -> Tensor:
        """Unit direction (3,N) of light on surfaces of that normal (3,N): it turns as maps turn the smooth normal."""
        if self.normal is None:
            return normal
        return torch.nn.functional.normalize(self.normal + (normal - smooth), dim=0)


@dataclass(frozen=True, eq=False)
class Sent:
    """Light that N points send to the eye, and what of it mirrors replace by what they show."""

    radiance: Tensor  # (3,N)
    replaced: Tensor  # (3,N) is taken away where a mirrored picture is known,
    mirrored: Tensor  # (3,N) and that picture times this added


def phong(surface: Surface, sky: Sky, around: Around, lights: Sequence[Lit]) -> Sent:
    """Lambert's diffuse light and Phong's normalised highlight."""
    s = surface
    seen = s.occlusion if around.visibility is None else s.occlusion * around.visibility
    diffuse = sky.diffuse(around.towards(s.normal, s.smooth)) * seen
    specular = torch.zeros_like(s.base)
    facing = (s.normal * s.to_eye).sum(0)
    mirror = 2.0 * facing * s.normal - s.to_eye
    for light, amount in ((one.light, one.amount) for one in lights):
        color = light.color[:, None]
        diffuse = diffuse + color * (amount / math.pi)
        cosine = (mirror * light.direction).sum(0).clamp(0.0, 1.0)
        lobe = (s.shininess + 2.0) / (2.0 * math.pi) * cosine.pow(s.shininess)
        specular = specular + color * (amount * lobe)
    matte = s.base * diffuse
    share = schlick(s.degree, facing.abs())
    tint = s.highlight / s.degree.clamp_min(1e-12)
    return Sent(matte + s.highlight * specular + s.emission, share * matte, share * tint)


def metallic_roughness(surface: Surface, sky: Sky, around: Around, lights: Sequence[Lit]) -> Sent:
    """GGX with energy compensation over a coupled diffuse part, under sheen and a clear coat."""
    s, m = surface, _Mix.of(surface)
    seen = s.occlusion if around.visibility is None else s.occlusion * around.visibility
    diffuse = sky.diffuse(around.towards(s.normal, s.smooth)) * seen
    glossy = sky_about(sky, s.normal, s.to_eye, sky_lobe(m.eye, s.roughness, m.grazing))
    specular_seen = specular_occlusion(m.eye, seen, s.roughness)
    through = 1.0 - _coat_share(s)
    mirrored = m.mirrored * m.sheen_left * through
    replaced = mirrored * glossy * specular_seen
    sheen = s.sheen * m.sheen_share * diffuse
    total = s.emission + sheen + m.matte * m.sheen_left * m.left_eye * diffuse * through + replaced
    for one in lights:
        value = one.amount * m.lobes(one, through)
        if one.light.corners is not None:
            value = value + m.rectangle(one, mirrored, m.sheen_left * through)
        total = total + one.light.color[:, None] * value
    if bool((s.clearcoat > 0).any()):
        total = total + _coat(s, sky, seen, lights)
    return Sent(total, replaced, mirrored)


def unlit(surface: Surface) -> Sent:
    """The colour as it is."""
    none = torch.zeros_like(surface.base)
    return Sent(surface.base, none, none)


def lobe_middle(normal: Tensor, to_eye: Tensor, eye: Tensor, part: Tensor) -> Tensor:
    """Unit direction (3,N) that light from all around is looked up in, a ``part`` (N,) of the way from the normal to
    the mirrored direction; ``eye``: cosines (N,) to the eye.
    """
    mirror = 2.0 * eye * normal - to_eye
    turned = normal + (mirror - normal) * part
    return turned / turned.square().sum(0).sqrt().clamp_min(1e-18)


def sky_about(sky: Sky, normal: Tensor, to_eye: Tensor, lobes: Sequence[SkyLobe]) -> Tensor:
    """Radiance (3,N) of light from all around that lobes about the mirrored direction take in."""
    eye = (normal * to_eye).sum(0).clamp(1e-4, 1.0)
    total = torch.zeros_like(normal)
    for lobe in lobes:
        total = total + lobe.share * sky.mirrored(lobe_middle(normal, to_eye, eye, lobe.part), lobe.roughness)
    return total


def specular_occlusion(eye: Tensor, seen: Tensor, roughness: Tensor) -> Tensor:
    """Share (N,) of mirrored light where a share (N,) of all directions is open.

    Source: Lagarde and de Rousiers, *Moving Frostbite to physically based rendering*, 2014, section 4.10.2.
    """
    power = torch.exp2(-16.0 * roughness - 1.0)
    open_share = (eye.clamp_min(0.0) + seen).clamp_min(1e-6).pow(power) - 1.0 + seen
    return torch.where(seen >= 1.0, 1.0, open_share.clamp(0.0, 1.0))


@dataclass(frozen=True, eq=False)
class _Mix:
    """Terms of a surface that do not depend on lights."""

    surface: Surface
    eye: Tensor  # (N,) cosine to the eye
    f0: Tensor  # (3,N)
    pure: Tensor  # (N,) weight of Fresnel's own term
    once: Tensor  # (N,) share of light from everywhere that facets mirror which mirror all
    again: Tensor  # (3,N) what comes back of lost light
    mirrored: Tensor  # (3,N) share of light from everywhere that is mirrored
    grazing: Tensor  # (N,) share of that which Fresnel's term adds to what is mirrored along the normal
    matte: Tensor  # (3,N) diffuse reflectance
    left_eye: Tensor  # (N,) share of diffuse light that gets out towards the eye
    inner: Tensor  # (N,) mean share that gets in
    bare: Tensor  # (4,N) weights of the factors of a dielectric's albedo
    sheen_left: Tensor  # (N,) what sheen leaves to the lobes below
    sheen_share: Tensor  # (N,)

    @classmethod
    def of(cls, s: Surface) -> _Mix:
        eye = (s.normal * s.to_eye).sum(0).clamp(1e-4, 1.0)
        factors = look_up(albedo_table().split, eye, s.roughness).T
        a, b = factors[0], factors[1]
        cloth = torch.zeros_like(eye)
        if bool((s.sheen > 0).any()):
            cloth = sheen_albedo(eye, s.sheen_roughness)
        f0 = torch.lerp(s.dielectric, s.base, s.metallic)
        f90 = torch.lerp(s.weight, torch.ones_like(s.weight), s.metallic)
        lost = 1.0 / (a + b).clamp_min(1e-3) - 1.0
        low, pure = s.dielectric.amax(0), s.weight * (1.0 - s.metallic)
        even, most = f90 * b + pure * (s.excess * factors[2:]).sum(0), f0.amax(0)
        bare = torch.stack([low, s.weight, *(s.weight * s.excess)])
        return cls(
            surface=s,
            eye=eye,
            f0=f0,
            pure=pure,
            once=a + b,
            again=1.0 + f0 * lost,
            mirrored=(f0 * a + even) * (1.0 + f0 * lost),
            grazing=_added(most, a, b, even),
            matte=s.base * (1.0 - s.metallic) * (1.0 - s.transmission),
            left_eye=1.0 - (bare * factors).sum(0) * (1.0 + low * lost),
            inner=1.0 - (bare * mean_albedo(s.roughness)).sum(0),
            bare=bare,
            sheen_left=1.0 - s.sheen.amax(0) * cloth,
            sheen_share=cloth,
        )

    def fresnel(self, half: Tensor) -> Tensor:
        """Fresnel's term (3,N) of facets at cosines (N,): Schlick's of the metal, its own of the rest."""
        s, grazing = self.surface, fifth_power(half)
        even = self.pure * dielectric_fresnel(s.slowed, half) + s.metallic * grazing
        return even + (self.f0 - self.pure * s.reflectance) * (1.0 - grazing)

    def rectangle(self, lit: Lit, whole: Tensor, under: Tensor) -> Tensor:
        """Value (3,N) of a rectangle's mirror image, where one that fills the lobe has that of ``whole`` (3,N).

        The less of the lobe it fills, the more counts Fresnel's term of the facets that show it, in place of the mean.
        """
        s = self.surface
        assert lit.light.corners is not None
        share = lit.mirrored(s.normal, s.to_eye, s.roughness)
        mirror = 2.0 * (s.normal * s.to_eye).sum(0) * s.normal - s.to_eye
        _, half = half_vector_terms(s.normal, s.to_eye, nearest_point(lit.light.corners, mirror))
        some = self.fresnel(half) * self.again * self.once * under
        return share * torch.lerp(some, whole, share)

    def lobes(self, lit: Lit, through: Tensor) -> Tensor:
        """Value (3,N) of all lobes under the coat, for light from its direction; not the mirrored one of rectangles."""
        s, direction = self.surface, lit.light.direction
        to_light = (s.normal * direction).sum(0)
        sine, half = half_vector_terms(s.normal, s.to_eye, direction)
        specular = self.fresnel(half) * self.again * ggx_lobe(sine, to_light, self.eye, ggx_alpha(s.roughness))
        if lit.light.corners is not None:
            specular = torch.zeros_like(specular)
        kept = (self.bare * torch.stack(directional_albedo(to_light, s.roughness))).sum(0)
        gets_in = (1.0 - kept) / self.inner.clamp_min(1e-3)
        value = (specular + self.matte * (self.left_eye * gets_in / math.pi)) * self.sheen_left
        value = value * through
        if bool((s.sheen > 0).any()):
            value = value + s.sheen * sheen_lobe(sine, to_light, self.eye, s.sheen_roughness)
        return value


def _added(along: Tensor, a: Tensor, b: Tensor, even: Tensor) -> Tensor:
    """Share (N,) of mirrored light ``along a + even`` that is not that of facets which all mirror ``along``."""
    return (1.0 - along * (a + b) / (along * a + even).clamp_min(1e-6)).clamp(0.0, 1.0)


def _coat_share(s: Surface) -> Tensor:
    """Share (N,) that the clear coat mirrors, and keeps from what is below."""
    eye = (s.smooth * s.to_eye).sum(0).clamp(1e-4, 1.0)
    return s.clearcoat * dielectric_fresnel(COAT_SLOWED, eye)


def _coat(s: Surface, sky: Sky, seen: Tensor, lights: Sequence[Lit]) -> Tensor:
    """Light (3,N) that the clear coat mirrors."""
    eye = (s.smooth * s.to_eye).sum(0).clamp(1e-4, 1.0)
    a, b, c, _ = directional_albedo(eye, s.coat_roughness)
    lobes = sky_lobe(eye, s.coat_roughness, _added(torch.full_like(a, COAT_F0), a, b, b + c))
    share = s.clearcoat * (COAT_F0 * a + b + c)
    glossy = sky_about(sky, s.smooth, s.to_eye, lobes)
    total = share * glossy * specular_occlusion(eye, seen, s.coat_roughness)
    alpha = ggx_alpha(s.coat_roughness)
    for one in lights:
        light, amount = one.light, one.amount
        if light.corners is not None:
            value = share * one.mirrored(s.smooth, s.to_eye, s.coat_roughness)
            total = total + light.color[:, None] * value
            continue
        to_light = (s.smooth * light.direction).sum(0).clamp_min(0.0)
        bent = (s.normal * light.direction).sum(0).clamp_min(1e-3)
        sine, half = half_vector_terms(s.smooth, s.to_eye, light.direction)
        value = s.clearcoat * dielectric_fresnel(COAT_SLOWED, half) * ggx_lobe(sine, to_light, eye, alpha)
        # The amount holds the cosine at the bent normal; the coat lies flat.
        total = total + light.color[:, None] * (amount / bent * to_light * value)
    return total
