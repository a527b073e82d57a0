"""Measure gradient-enhanced pictures: ``python -m torchrender.report.enhancement [--quick] [-o docs/results]``.

Writes ``enhancement.md``, ``.json`` and ``.jpg``. Objects of others come from the folder of ``TORCHRENDER_DATA``.
Needs libigl; pymeshlab's time is told where it is installed.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from torchrender.effects.enhancement.curvature import vertex_curvature
from torchrender.effects.enhancement.enhance import enhanced, enhancement
from torchrender.effects.enhancement.gradient import Lighting
from torchrender.effects.enhancement.options import EnhanceOptions
from torchrender.pipeline.options import RenderOptions
from torchrender.quality.machine import machine_record
from torchrender.quality.pages import write_record, write_text
from torchrender.quality.timing import take_turns
from torchrender.renderer import render
from torchrender.report.common.command import run_study
from torchrender.report.enhancement import baselines, measures
from torchrender.report.enhancement.objects import Subject, bumps, subjects
from torchrender.report.enhancement.page import page
from torchrender.report.enhancement.sheet import write_sheet

LIGHTS = ((0.0, 0.0, 0.0), (-3.0, -3.0, 0.0), (3.0, -3.0, 0.0))
EVEN = EnhanceOptions(plain_weight=1.0, gradient_weight=0.6, exponent=1.5, centred=True)
SHIFT = 0.03
LIMITED = replace(EVEN, overshoot_limit=1 / 3)
OURS = {"ours": EVEN, "ours, limited": LIMITED}
DISTANCES_CM = (50.0, 100.0, 150.0, 200.0)


def _lit(subject: Subject) -> Lighting:
    return Lighting((subject.lamp,))


def enhanced_picture(subject: Subject, options: EnhanceOptions) -> Tensor:
    """(1,H,W) by gradients."""
    size = enhancement(subject.surface, subject.curvature(options), _lit(subject), options)[..., :1].double()
    size = size * subject.square[..., None]
    made = enhanced(subject.plain[..., None].float(), size.float(), subject.surface, options)
    return made[..., 0].double()


def unclamped(subject: Subject, options: EnhanceOptions) -> Tensor:
    """(1,H,W) the same as published: below zero, too."""
    size = enhancement(subject.surface, subject.curvature(options), _lit(subject), options)[..., 0].double()
    return options.plain_weight * subject.plain + options.gradient_weight * size * subject.square


def published_table() -> list[dict[str, Any]]:
    """Rows of section 8."""
    rows = []
    for magnitude in ("sum", "signed_l2"):
        for light in LIGHTS:
            subject, found = bumps(light), []
            for terms in (("geometry",), ("geometry", "projection")):
                made = unclamped(subject, EnhanceOptions(magnitude=magnitude, terms=terms))
                found.append([measures.gain(subject, made, r) for r in (measures.GRAZING, measures.FRONT)])
            rows.append({"mag": magnitude, "light": light, "without": found[0], "with": found[1]})
    return rows


def ways(subject: Subject) -> dict[str, tuple[Tensor, float]]:
    """Pictures (1,H,W) of all methods with the weight of the plain one in each."""
    plain, covered, surface = subject.plain, subject.seen.covered, subject.surface
    bend = baselines.normal_bend(surface).double()
    frontal = replace(EVEN, terms=("geometry",))
    made = {
        "plain": plain,
        "unsharp mask": baselines.unsharp_mask(plain, covered),
        "2-D gradient": baselines.picture_gradient(plain, covered),
        "Radiance Scaling": baselines.radiance_scaling(plain, bend),
        "eye-dome lighting": baselines.eye_dome(plain, surface),
        "SSAO": baselines.screen_occlusion(plain, surface),
        "ours without projection": enhanced_picture(subject, frontal),
        **{name: enhanced_picture(subject, options) for name, options in OURS.items()},
    }
    found = {name: (picture, 1.0) for name, picture in made.items()}
    published = EnhanceOptions(magnitude="sum")
    found["Radiance Scaling, shift 0.03"] = (_level(subject, lambda g: baselines.radiance_scaling(plain, bend, g)), 1.0)
    ours = _level(subject, lambda w: enhanced_picture(subject, replace(EVEN, gradient_weight=w)))
    found["ours, shift 0.03"] = (ours, 1.0)
    return {**found, "as published (sum, 0.8, 0.4)": (enhanced_picture(subject, published), published.plain_weight)}


def _level(subject: Subject, make: Callable[[float], Tensor]) -> Tensor:
    """The picture of the greatest strength up to 1 whose mean level is off by no more than ``SHIFT``."""
    low, high = 0.0, 1.0
    if measures.mean_shift(subject, make(high)) <= SHIFT:
        return make(high)
    for _ in range(8):
        middle = (low + high) / 2
        fits = measures.mean_shift(subject, make(middle)) <= SHIFT
        low, high = (middle, high) if fits else (low, middle)
    return make(low)


def measured(subject: Subject) -> dict[str, dict[str, float]]:
    """All measures of all methods on one object."""
    ridges = measures.ridge_mask(subject)
    rows = {}
    for name, (made, weight) in ways(subject).items():
        rows[name] = {
            "grazing": measures.gain(subject, made, measures.GRAZING),
            "front": measures.gain(subject, made, measures.FRONT),
            "shift": measures.mean_shift(subject, made),
            "overshoot": measures.overshoot(subject, made, weight),
            "ridges": float("nan") if name == "plain" else measures.ridge_score(subject, made, weight, ridges),
        }
    return rows


def distances(subject: Subject) -> list[dict[str, float]]:
    """RMS difference of ours from Radiance Scaling and from ours without projection, by distance of the eye."""
    made = ways(subject)
    rows = []
    for distance in DISTANCES_CM:
        seen = {name: baselines.seen_from(picture, distance) for name, (picture, _) in made.items()}
        rows.append({"cm": distance} | {
            name: float((seen["ours"] - seen[name])[subject.seen.covered].square().mean().sqrt())
            for name in ("Radiance Scaling", "ours without projection", "plain")
        })  # fmt: skip
    return rows


def terms_table(subject: Subject) -> list[dict[str, Any]]:
    """Terms on and off, on a rendered picture with shadows and highlights."""
    scene, rows = subject.scene, []
    usual = ("geometry", "projection")
    base = torch.zeros(())
    for terms in ((), ("geometry",), usual, (*usual, "visibility"), (*usual, "specular")):
        options = EnhanceOptions(plain_weight=1.0, terms=terms, magnitude="sum")
        image = render(scene, subject.cameras, options=RenderOptions(enhance=options if terms else None))
        picture = image.radiance.mean(-1).double()
        base = picture if not terms else base
        chosen = (subject.facing > 0.15) & (subject.facing < 0.4) & subject.inner
        spread = [float(baselines.high_pass(p, subject.seen.covered)[chosen].std()) for p in (base, picture)]
        rows.append({
            "terms": list(terms), "gain": spread[1] / max(spread[0], 1e-12),
            "shift": float((picture - base)[subject.seen.covered].mean()),
            "ms": image.timings_ms.get("enhancement", 0.0),
        })  # fmt: skip
    return rows


def times(data: Path, quick: bool) -> dict[str, Any]:
    """Descriptor and frame, as ratios."""
    scene = next((s.scene for s in subjects(data, 64) if s.name == "dragon"), None) or bumps().scene
    geometry = bumps().scene.geometry  # the dragon is no manifold, which peers refuse
    normals = geometry.normals
    assert normals is not None
    candidates: dict[str, Callable[[], object]] = {
        "ours": lambda: vertex_curvature(geometry.vertices, geometry.faces, normals)
    }
    try:
        import pymeshlab

        mesh = pymeshlab.Mesh(geometry.vertices.numpy(), geometry.faces.numpy())
        meshes = pymeshlab.MeshSet()
        meshes.add_mesh(mesh)
        candidates["pymeshlab"] = lambda: meshes.compute_curvature_principal_directions_per_vertex()
    except ImportError:
        pass
    found: dict[str, Any] = {"vertices": len(geometry.vertices)}
    found["descriptor"] = {k: v.record() for k, v in take_turns(candidates, runs=3 if quick else 7, warm_up=1).items()}
    size = 256 if quick else 1024
    lit = scene.with_default_light()
    camera = lit.camera(width=size, height=size)
    history = render(lit, camera, history=_history()).history
    wishes = {"plain": None, "enhanced": EnhanceOptions(), "limited": EnhanceOptions(overshoot_limit=1 / 3)}
    past = render(lit, camera, history=history, options=RenderOptions(enhance=EnhanceOptions())).history
    frames = {
        name: (lambda wish=wish: render(lit, camera, history=past, options=RenderOptions(enhance=wish)))
        for name, wish in wishes.items()
    }
    found["frame"] = {k: v.record() for k, v in take_turns(frames, runs=3 if quick else 9, warm_up=2).items()}
    found["size"] = size
    return found


def _history() -> Any:
    from torchrender.pipeline.history import RenderHistory

    return RenderHistory()


def run(folder: Path, quick: bool) -> list[Path]:
    """Measure and write."""
    data = Path(os.environ.get("TORCHRENDER_DATA", "../shared/data"))
    chosen = subjects(data, 256 if quick else 512)
    chosen = chosen[:1] if quick else chosen
    record = {
        "machine": machine_record(),
        "table": published_table(),
        "objects": {s.name: measured(s) for s in [bumps(), *chosen]},
        "distance": distances(chosen[0]),
        "terms": terms_table(chosen[0]),
        "times": times(data, quick),
    }
    write_sheet(folder / "enhancement.jpg", [(s, ways(s)) for s in chosen])
    write_record(folder / "enhancement.json", record)
    write_text(folder / "enhancement.md", page(record))
    return [folder / f"enhancement.{suffix}" for suffix in ("md", "json", "jpg")]


def main() -> None:
    """The command."""
    torch.manual_seed(0)
    run_study(__doc__, run, quick="one object, small pictures")
