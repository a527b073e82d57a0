"""All-frequency shadows of objects as spheres: errors against sums over texels, and times.

The points are 128 x 128 of a plane. Models and skies are those of a folder of shared data (bunny or armadillo; grace,
pisa, forest, studio).
"""

from __future__ import annotations

import os
from dataclasses import dataclass, replace
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np
import torch
from torch import Tensor

from torchrender.arrays import view
from torchrender.effects.sky_shadows.fit import fit_spheres
from torchrender.effects.sky_shadows.light import SkyLight, prepare_light
from torchrender.effects.sky_shadows.moving import Binding
from torchrender.effects.sky_shadows.occluder import joined, kept_spheres
from torchrender.effects.sky_shadows.options import SkyLightOptions, SphereOptions
from torchrender.effects.sky_shadows.shade import caps_of, hidden_bits, shade
from torchrender.images.files import read_image
from torchrender.kernels.sky_shadows.light import Samples, hidden_words
from torchrender.quality.machine import machine_record
from torchrender.quality.pages import write_record, write_text
from torchrender.rays import RayCaster
from torchrender.report.all_frequency.page import page
from torchrender.report.all_frequency.ways import (
    best_harmonics,
    exponentiated_harmonics,
    mesh_bits,
    texel_sum,
    wavelet_sum,
)
from torchrender.report.common.command import study_parser
from torchrender.scene.environment import Environment
from torchrender.scene.load import load
from torchrender.scene.mesh import concatenate
from torchrender.scene.shapes import torus

SKIES = {
    "grace": "grace_latlong_small.hdr",
    "pisa": "pisa_latlong_small.hdr",
    "forest": "forest.hdr",
    "studio": "studio.hdr",
}
SPHERES, TERMS = (32, 64, 96, 128), (50, 200)
SIDE, CHECKED, HARMONIC = 128, 400, 120
RUNS = 5


@dataclass(frozen=True, eq=False)
class Stage:
    """A model over a plane of points."""

    name: str
    points: Tensor  # (P,3)
    normals: Tensor
    caster: RayCaster
    spheres: dict[int, Tensor]  # (S,4) by number
    snug: dict[int, Tensor]  # the same as pictures take them: together they hold the model's volume
    fits: dict[int, float]  # E over the volume


def stage(folder: Path, name: str, numbers: tuple[int, ...], options: SphereOptions) -> Stage:
    """The model, spheres fitted to it, and the plane under it."""
    scene = load(folder / "meshes" / name)
    vertices, faces = joined(scene.meshes)
    low, high = scene.bounds
    middle, size = (low + high) / 2, float((high - low).max())
    line = torch.linspace(-1.0, 1.0, SIDE, dtype=torch.float64) * size
    z, x = torch.meshgrid(line, line, indexing="ij")
    points = torch.stack([x + middle[0], torch.full_like(x, float(low[1]) - 0.01 * size), z + middle[2]], dim=-1)
    sets = {n: kept_spheres(vertices, faces, replace(options, spheres=n)) for n in numbers}
    return Stage(
        name=Path(name).stem,
        points=points.reshape(-1, 3),
        normals=torch.tensor([0.0, 1.0, 0.0]).expand(SIDE * SIDE, 3),
        caster=RayCaster(concatenate(scene.meshes)),
        spheres={n: s.spheres for n, s in sets.items()},
        snug={n: Binding(s, vertices, faces).at(vertices, snug=True) for n, s in sets.items()},
        fits={n: s.relative_error for n, s in sets.items()},
    )


def sky(folder: Path, name: str) -> Environment:
    """One of :data:`SKIES`, whole: its sun is not split off."""
    return Environment(radiance=read_image(folder / "envmaps" / SKIES[name])[..., :3].float(), name=name)


def fastest(work: Any) -> float:
    """Milliseconds, the least of a few runs."""
    work()
    times = []
    for _ in range(RUNS):
        begin = perf_counter()
        work()
        times.append(perf_counter() - begin)
    return 1e3 * min(times)


def errors(found: Tensor, wanted: Tensor, whole: Tensor) -> dict[str, float]:
    """Root mean square and largest difference in percent of the unshadowed light, and PSNR of the share in dB."""
    share = ((found - wanted) / whole.clamp_min(1e-30)).double()
    mean = float(share.square().mean())
    return {
        "rms": 100 * mean**0.5,
        "most": 100 * float(share.abs().max()),
        "psnr": -10 * float(np.log10(max(mean, 1e-30))),
    }


def accuracy(at: Stage, environment: Environment, count: int) -> dict[str, Any]:
    """Errors of every way at some of the points."""
    rows = torch.randperm(len(at.points), generator=torch.Generator().manual_seed(0))[:CHECKED]
    points, normals, spheres = at.points[rows], at.normals[rows], at.spheres[count]
    light = prepare_light(environment)
    mesh = texel_sum(mesh_bits(at.caster, points, normals, 1e-6), normals, light)
    exact, table = (
        hidden_bits(points[None], normals[None], spheres[None], SkyLightOptions(direct_bits=way))[0]
        for way in (True, False)
    )
    by_exact, by_table = texel_sum(exact, normals, light), texel_sum(table, normals, light)
    whole = texel_sum(torch.zeros(1, 6, 32, 32, dtype=torch.bool), normals[:1], light)
    made: dict[str, Any] = {
        "spheres for mesh": errors(by_exact, mesh, whole),
        "the same, points inside under a half-space": errors(
            _by_bits(at.spheres[count], points, normals, light), mesh, whole
        ),
        "snug spheres, points inside under a half-space": errors(
            _by_bits(at.snug[count], points, normals, light), mesh, whole
        ),
        "table for exact caps": errors(by_table, by_exact, whole),
        "all wavelets for texels": errors(wavelet_sum(table[:64], normals[:64], light), by_table[:64], whole),
    }
    for name, options in _ways().items():
        found = _shaded(points, normals, spheres, prepare_light(environment, options))
        made[name] = errors(found, by_table, whole) | {"mesh": errors(found, mesh, whole)["rms"]}
    few = slice(0, HARMONIC)
    own = _shaded(points[few], normals[few], spheres, prepare_light(environment, SkyLightOptions(direct_bits=True)))
    made["ours, exact caps"] = errors(own, by_exact[few], whole)
    made["best harmonics"] = errors(best_harmonics(exact[few], normals[few], light), by_exact[few], whole)
    shexp = exponentiated_harmonics(points[few], normals[few], spheres, light)
    made["SHEXP"] = errors(shexp, by_exact[few], whole)
    return made


def _by_bits(spheres: Tensor, points: Tensor, normals: Tensor, light: SkyLight) -> Tensor:
    """The sum over texels, as pictures treat points inside of spheres."""
    options = SkyLightOptions(direct_bits=True, inside="half")
    return texel_sum(hidden_bits(points[None], normals[None], spheres[None], options)[0], normals, light)


def fits(folder: Path, options: SphereOptions) -> list[dict[str, Any]]:
    """What stands out of a torus and of a scanned figure, and how long that took to find."""
    ring = torus(1.0, 0.35, 48)
    figure = joined(load(folder / "meshes" / "armadillo.ply").meshes)
    made = []
    for name, (vertices, faces), asked in (
        ("torus, 16", (ring.vertices.double(), ring.faces), 0.30),
        ("torus, 32", (ring.vertices.double(), ring.faces), 0.10),
        ("torus, 64", (ring.vertices.double(), ring.faces), 0.06),
        ("armadillo, 64", figure, None),
    ):
        begin = perf_counter()
        found = fit_spheres(vertices, faces, replace(options, spheres=int(name.split()[-1])))
        took = perf_counter() - begin
        points = torch.cat([vertices, vertices[faces].mean(1)])
        labels = torch.cat([found.vertex_sphere, found.face_sphere])
        out = (points - found.centres[labels]).norm(dim=-1) > found.radii[labels] * (1 + 1e-9)
        used = torch.cat([torch.unique(faces), torch.arange(len(faces)) + len(vertices)])
        made.append(
            {"name": name, "error": found.relative_error, "asked": asked, "s": took, "out": int(out[used].sum())}
        )
    return made


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


def _shaded(points: Tensor, normals: Tensor, spheres: Tensor, light: SkyLight) -> Tensor:
    return shade(points[None], normals[None], spheres[None], light).radiance[0].double()


def times(at: Stage, environment: Environment) -> dict[str, Any]:
    """Milliseconds for all points, by spheres, terms and levels; of stages; of a light that turns."""
    made: dict[str, Any] = {"all": {}, "stages": {}}
    for count, spheres in at.spheres.items():
        for terms in TERMS:
            for level in (1, 2):
                light = prepare_light(environment, SkyLightOptions(terms=terms, levels=level))
                took = fastest(lambda s=spheres, one=light: _shaded(at.points, at.normals, s, one))
                made["all"][f"{count},{terms},{level}"] = took
    count = 64 if 64 in at.spheres else next(iter(at.spheres))
    spheres = at.spheres[count]
    samples = Samples(
        view(at.points, np.float64), view(at.normals, np.float32), np.full(len(at.points), -1, np.int32),
        np.zeros(len(at.points), np.int32),
    )  # fmt: skip
    words = np.zeros((len(at.points), 96), np.int64)
    for name, options in (("caps by table", SkyLightOptions()), ("caps one by one", SkyLightOptions(direct_bits=True))):
        caps = caps_of(options)
        made["stages"][name] = fastest(lambda c=caps: hidden_words(samples, view(spheres, np.float64), c, words))
    angle = iter(np.linspace(1.0, 60.0, 100))
    made["stages"]["light that turns"] = fastest(
        lambda: prepare_light(replace(environment, rotation_deg=float(next(angle))))
    )
    light = prepare_light(environment)
    part = slice(0, 1024)

    def plain() -> None:
        bits = hidden_bits(at.points[None, part], at.normals[None, part], spheres[None], light.options)[0]
        texel_sum(bits, at.normals[part], light)

    made["stages"]["plain sum over texels"] = fastest(plain) * len(at.points) / 1024
    return made


def main() -> None:
    """Measure, and write page and record."""
    parser = study_parser(__doc__, quick="two skies, a coarse fit")
    parser.add_argument("--data", type=Path, default=Path(os.environ.get("TORCHRENDER_DATA", "../shared/data")))
    parser.add_argument("--model", default="stanford_bunny.ply", help="a mesh of the data's folder meshes")
    parser.add_argument("--shared-machine", action="store_true", help="say that others used the machine meanwhile")
    arguments = parser.parse_args()
    quick = arguments.quick
    fit = SphereOptions(starts=1, resolution=48, teleports=6) if quick else SphereOptions()
    torch.set_grad_enabled(False)
    at = stage(arguments.data, arguments.model, SPHERES, fit)
    names = list(SKIES)[:2] if quick else list(SKIES)
    record = {
        "machine": machine_record(),
        "shared": arguments.shared_machine,
        "quick": quick,
        "model": at.name,
        "fits": {str(n): e for n, e in at.fits.items()},
        "models": [] if quick else fits(arguments.data, SphereOptions()),
        "accuracy": {f"{name},{n}": accuracy(at, sky(arguments.data, name), n) for name in names for n in (32, 64)},
        "times": times(at, sky(arguments.data, names[0])),
    }
    arguments.output.mkdir(parents=True, exist_ok=True)
    write_record(arguments.output / "all-frequency-shadows.json", record)
    write_text(arguments.output / "all-frequency-shadows.md", page(record))
