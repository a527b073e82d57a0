"""Errors of every way to the same light."""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor

from torchrender.effects.sky_shadows.light import SkyLight, prepare_light
from torchrender.effects.sky_shadows.options import SkyLightOptions
from torchrender.effects.sky_shadows.picture import SHIFTS
from torchrender.effects.sky_shadows.shade import hidden_bits, shade
from torchrender.report.all_frequency.stage import Stage, errors
from torchrender.report.all_frequency.ways import (
    best_harmonics,
    exponentiated_harmonics,
    mesh_bits,
    texel_sum,
    wavelet_sum,
)
from torchrender.scene.environment import Environment

CHECKED, HARMONIC = 400, 120
DARK = 0.2
"""Share of the light that the mesh hides at least from points that count as dark."""

OFFSET = 1e-6
"""Where rays begin above the plane, in the model's size."""


def shaded(points: Tensor, normals: Tensor, spheres: Tensor, light: SkyLight) -> Tensor:
    """(P,3) float64 what :func:`shade` finds."""
    return shade(points[None], normals[None], spheres[None], light).radiance[0].double()


def _by_shifts(points: Tensor, normals: Tensor, spheres: Tensor, light: SkyLight) -> Tensor:
    """The mean over the ways of rounding that neighbouring points of a picture take."""
    parts = []
    for one in torch.tensor(SHIFTS):
        shift = one.expand(1, len(points), 3)
        parts.append(shade(points[None], normals[None], spheres[None], light, shift=shift).radiance[0].double())
    return torch.stack(parts).mean(0)


def accuracy(at: Stage, environment: Environment, count: int) -> dict[str, Any]:
    """Errors of every way at some of the points."""
    rows = at.some(CHECKED)
    points, normals, spheres = at.points[rows], at.normals[rows], at.spheres[count]
    light = prepare_light(environment)
    mesh = texel_sum(mesh_bits(at.caster, points, normals, OFFSET * at.size), normals, light)
    exact, table = (
        hidden_bits(points[None], normals[None], spheres[None], SkyLightOptions(direct_bits=way))[0]
        for way in (True, False)
    )
    by_exact, by_table = texel_sum(exact, normals, light), texel_sum(table, normals, light)
    whole = unshadowed(normals, light)
    dark = (mesh / whole.clamp_min(1e-30)).mean(dim=1) < 1.0 - DARK
    few = slice(0, HARMONIC)

    def row(found: Tensor, wanted: Tensor) -> dict[str, float]:
        """Errors of all points given, the first ones, and of the dark ones among them."""
        hard = dark[: len(found)]
        return errors(found, wanted, whole) | {"dark": errors(found[hard], wanted[hard], whole)["rms"]}

    made: dict[str, Any] = {
        "spheres for mesh": row(by_exact, mesh),
        "the same, points inside under a half-space": row(_by_bits(spheres, points, normals, light), mesh),
        "snug spheres, points inside under a half-space": row(_by_bits(at.snug[count], points, normals, light), mesh),
        "table for exact caps": row(by_table, by_exact),
        "all wavelets for texels": row(wavelet_sum(table[:64], normals[:64], light), by_table[:64]),
    }
    for name, options in _ways().items():
        found = shaded(points, normals, spheres, prepare_light(environment, options))
        made[name] = row(found, by_table) | {"mesh": errors(found, mesh, whole)["rms"]}
    made["ours, table, against exact caps"] = row(shaded(points, normals, spheres, light), by_exact)
    made["ours, table, mean of four shifts, against exact caps"] = row(
        _by_shifts(points, normals, spheres, light), by_exact
    )
    own = shaded(points[few], normals[few], spheres, prepare_light(environment, SkyLightOptions(direct_bits=True)))
    made["ours, exact caps"] = row(own, by_exact[few])
    made["best harmonics"] = row(best_harmonics(exact[few], normals[few], light), by_exact[few])
    made["SHEXP"] = row(exponentiated_harmonics(points[few], normals[few], spheres, light), by_exact[few])
    return made


def by_spheres(at: Stage, environment: Environment) -> dict[str, dict[str, float]]:
    """By number of spheres: how they fit, and errors of their exact visibility against the mesh's."""
    rows = at.some(CHECKED)
    points, normals = at.points[rows], at.normals[rows]
    light = prepare_light(environment)
    whole = unshadowed(normals, light)
    mesh = texel_sum(mesh_bits(at.caster, points, normals, OFFSET * at.size), normals, light)
    return {
        str(n): {
            "outside": at.fits[n],
            "covering": errors(_by_bits(at.spheres[n], points, normals, light), mesh, whole)["rms"],
            "snug": errors(_by_bits(at.snug[n], points, normals, light), mesh, whole)["rms"],
        }
        for n in at.spheres
    }


def unshadowed(normals: Tensor, light: SkyLight) -> Tensor:
    """(1,3) the light where nothing is hidden, of the first of normals that are all the same."""
    return texel_sum(torch.zeros(1, 6, 32, 32, dtype=torch.bool), normals[:1], light)


def _by_bits(spheres: Tensor, points: Tensor, normals: Tensor, light: SkyLight) -> Tensor:
    """The sum over texels, as pictures treat points inside of spheres."""
    options = SkyLightOptions(direct_bits=True, inside="half")
    return texel_sum(hidden_bits(points[None], normals[None], spheres[None], options)[0], normals, light)


def _ways() -> dict[str, SkyLightOptions]:
    letter = {
        f"as published, {n} terms, {level} level": SkyLightOptions(
            terms=n, cosine_terms=n, levels=level, blend="nearest"
        )
        for n in (50, 200) for level in (1, 2)
    }  # fmt: skip
    ours = {
        f"ours, {n} terms, {level} level": SkyLightOptions(terms=n, levels=level)
        for n in (50, 100, 200)
        for level in (1, 2)
    }
    blended = {"as published, 200 terms, 2 level, blended normals": SkyLightOptions(terms=200, cosine_terms=200)}
    return letter | blended | ours | {"ours, all terms": SkyLightOptions(terms=6138)}
