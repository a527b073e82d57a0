"""Soft shadows measured: errors of sampled occluders beside the published ones, times, and the cost of penumbrae.

``python -m torchrender.report.soft_shadows [--quick] [-o docs/results]`` writes ``soft-shadows.md``, ``.json`` and
pictures. Errors are taken on an evenly thinned picture, which changes means by less than their third digit.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

from torchrender.effects.shadows.occluders import OccluderOptions, approximate_occluders
from torchrender.effects.shadows.soft_shadow import LightVisibility, Occluders, SoftShadowOptions, occluders
from torchrender.images.files import write_image
from torchrender.quality.machine import machine_record
from torchrender.quality.pages import write_record
from torchrender.report.common.command import study_parser
from torchrender.report.common.progress import part
from torchrender.report.soft_shadows.errors import mean_errors, signed_picture
from torchrender.report.soft_shadows.page import write_page
from torchrender.report.soft_shadows.penumbra import penumbra_errors
from torchrender.report.soft_shadows.subject import QUICK, StudyOptions, Subject, study_light
from torchrender.report.soft_shadows.times import penumbra_cost, times
from torchrender.scene.procedural import build

METHODS = ("nonredundant", "conventional", "depth_peeling")
MESH_METHODS = {"grid": METHODS[:1], "splat": METHODS[:1]}  # ablations of non-redundant images
PARTS = ("errors", "times")
LITERAL: dict[str, Any] = {
    "pixel_test": "identity", "guess_ratio": 1.1, "merge_guesses": False, "adaptive_split": False
}  # fmt: skip
"""Algorithms 3 and 4 to the letter."""
_LETTERS: dict[str, dict[str, Any]] = {
    "as published": LITERAL,
    **{f"published, but {k}": LITERAL | {k: getattr(OccluderOptions(), k)} for k in LITERAL},
    "ours": {},
}
"""To the letter, then with each of our changes alone, and with all of them."""
WHOLE = ("as published", "ours")
"""Rows of all methods: the others are of non-redundant images."""


class _Errors:
    """The errors of one scene; cells that several tables ask for are measured once."""

    def __init__(self, subject: Subject, study: StudyOptions) -> None:
        self.subject, self.study = subject, study
        self._references: dict[tuple[float, int], dict[str, LightVisibility]] = {}
        self._cells: dict[tuple[OccluderOptions, float], dict[str, Any]] = {}
        self._maps: dict[tuple[OccluderOptions, float], LightVisibility] = {}  # by shadow maps

    def tables(self, folder: Path, name: str) -> dict[str, Any]:
        """Resolution, light and mesh tables; writes the scene's picture."""
        study = self.study
        methods = {m: OccluderOptions(method=m, mesh="hybrid", size=study.size) for m in METHODS}
        first = methods[METHODS[0]]
        self.cell(first, 1.0)
        reference = self.reference(1.0, study.size)["shadow_map"]
        picture = signed_picture(self._maps[first, 1.0], reference, self.subject.view.covered)
        write_image(folder / f"soft-shadows-{name}.png", picture)

        def row(ratio: float, chosen: Sequence[str] = METHODS, **change: Any) -> dict[str, Any]:
            return {m: self.cell(replace(methods[m], **change), ratio) for m in chosen}

        sizes = (study.size, *(size for scene, size in study.larger if scene == name))
        swept = name in study.swept
        letters = _LETTERS if swept else {label: _LETTERS[label] for label in WHOLE if name in study.literal}
        return {
            "resolution": {str(size): row(1.0, size=size) for size in sizes},
            "light": {str(ratio): row(ratio) for ratio in study.ratios} if swept else {},
            "literal": {
                label: row(1.0, METHODS if label in WHOLE else METHODS[:1], **changes)
                for label, changes in letters.items()
            },
            "mesh": {
                mesh: row(1.0, MESH_METHODS.get(mesh, METHODS), mesh=mesh)
                for mesh in study.meshes
                if swept or mesh not in MESH_METHODS
            },
        }

    def reference(self, ratio: float, size: int) -> dict[str, LightVisibility]:
        """A (maps of the original triangles) and B (rays to them; the bias only covers float32 depths)."""
        if (ratio, size) not in self._references:
            ready = occluders(self.subject.scene.geometry)
            maps = self.options("shadow_map", size)
            rays = replace(maps, visibility="ray", constant_bias=1e-4, slope_bias=0.0)
            lit = {"shadow_map": self.subject.lit(ready, ratio, maps), "ray": self.subject.lit(ready, ratio, rays)}
            self._references[ratio, size] = lit
        return self._references[ratio, size]

    def options(self, visibility: str, size: int) -> SoftShadowOptions:
        """The same bias and map size for approximation and reference."""
        return SoftShadowOptions(
            visibility=visibility, engine="packets", light_samples=self.study.light_samples, map_size=size
        )

    def casters(self, options: OccluderOptions, ratio: float) -> Occluders:
        """The approximate occluders."""
        light = study_light(self.subject.box, ratio)
        return occluders(approximate_occluders(self.subject.scene, light, options, bounds=self.subject.box))

    def cell(self, options: OccluderOptions, ratio: float) -> dict[str, Any]:
        """Mean and maximum errors against A and B."""
        if (options, ratio) not in self._cells:
            ready = self.casters(options, ratio)
            cell: dict[str, Any] = {"triangles": ready.geometry.triangle_count}
            for label, visibility in (("A", "shadow_map"), ("B", "ray")):
                lit = self.subject.lit(ready, ratio, self.options(visibility, options.size))
                if visibility == "shadow_map":
                    self._maps[options, ratio] = lit
                truth = self.reference(ratio, options.size)[visibility]
                cell[label] = mean_errors(lit, truth, self.subject.view.covered)
            self._cells[options, ratio] = cell
        return self._cells[options, ratio]


def error_tables(study: StudyOptions, folder: Path) -> dict[str, Any]:
    """Tables 8 to 10 and the ablation of meshes: errors by scene, resolution, light size and method."""
    found = {}
    for name in study.scenes:
        with part(f"errors, {name}"):
            found[name] = _Errors(Subject.of(build(name), study.picture), study).tables(folder, name)
    return {
        table: {name: found[name][table] for name in study.scenes if found[name][table]}
        for table in ("resolution", "light", "literal", "mesh")
    }


def skipping_error(study: StudyOptions) -> dict[str, float]:
    """Mean error, scale 0 to 255, of default settings against tracing everything."""
    out = {}
    for name in study.scenes:
        subject = Subject.of(build(name), study.picture)
        ready, n = occluders(subject.scene.geometry), study.light_samples
        quick = subject.lit(ready, 1.0, SoftShadowOptions(light_samples=n))
        exact = subject.lit(ready, 1.0, SoftShadowOptions(light_samples=n, refine=1, skip_lit=False, umbra_probes=0))
        out[name] = 255.0 * float((quick.visibility - exact.visibility).abs()[:, 0][subject.view.covered].mean())
    return out


def run(study: StudyOptions, folder: Path, parts: Sequence[str] = PARTS) -> dict[str, Any]:
    """Measure and write the page; parts left out keep what ``soft-shadows.json`` holds of an earlier run."""
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / "soft-shadows.json"
    record: dict[str, Any] = {} if set(parts) == set(PARTS) else json.loads(path.read_text() if path.exists() else "{}")
    record |= {"machine": machine_record(), "study": asdict(study)}
    if "errors" in parts:
        record |= {"errors": error_tables(study, folder), "skipping": skipping_error(study)}
        record["penumbrae"] = penumbra_errors(study)
    if "times" in parts:
        record["times"] = times(study)
        with part("cost of penumbrae"):
            record["penumbra"] = penumbra_cost(study)
    write_record(path, record)
    if {"errors", "times"} <= set(record):
        write_page(record, folder)
    return record


def main() -> None:
    """The command."""
    parser = study_parser(__doc__, quick="one scene, small pictures: checks that it works")
    parser.add_argument("--only", choices=PARTS, help="measure this anew and keep the rest of an earlier run")
    given = parser.parse_args()
    run(QUICK if given.quick else StudyOptions(), given.output, [given.only] if given.only else PARTS)
