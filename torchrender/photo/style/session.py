"""A scene that takes the style of photos, and what a person may change about it afterwards.

The stages are those of specification 11: views, a material for each object from each view, and a choice among them.
Every change gives a new :class:`Style`; only what it touches is computed again.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from torchrender.brief import brief
from torchrender.checks import check_range
from torchrender.clock import StepClock
from torchrender.errors import InputError
from torchrender.photo.dominant import MAX_COLORS, palette
from torchrender.photo.photograph import Photo
from torchrender.photo.style import finish
from torchrender.photo.style.adjacency import Smoothness
from torchrender.photo.style.candidates import Candidates, fit_of, fit_region, start_choice
from torchrender.photo.style.cost import CostParts, StyleCost
from torchrender.photo.style.objects import StyleObjects
from torchrender.photo.style.options import StyleOptions
from torchrender.photo.style.prior import prior_cost
from torchrender.photo.style.search import SearchResult, tabu_search
from torchrender.photo.style.statistics import (
    ColorStatistics,
    StyleTables,
    build_tables,
    photo_pixels,
    photo_statistics,
)
from torchrender.photo.style.terms import ViewTerms, pictures
from torchrender.photo.style.views import Views
from torchrender.scene.files.scene_write import write_scene
from torchrender.scene.model import Scene

Progress = Callable[[str, int], None]
Region = Sequence[float]
USUAL_VIEWS = 10


@dataclass(frozen=True, eq=False)
class StyleProblem:
    """What does not change while a person locks, picks and searches again."""

    scene: Scene
    objects: StyleObjects
    options: StyleOptions
    photos: tuple[Photo, ...]
    views: Views
    terms: tuple[ViewTerms, ...]
    light: Tensor  # (3,) float64
    near: Tensor  # (m,m) bool neighbours
    role: Tensor  # (m,) int64, see prior
    cosine: Tensor  # (m,) float64 mean d of each object
    colors: Tensor  # (m,3) float64 mean reflectance of its present materials

    @property
    def width(self) -> int:
        """Numbers in a material row."""
        return 10 if self.options.fit.spec_color else 8


@dataclass(frozen=True, eq=False)
class Style:
    """The style of photos on a scene. m objects, n views, C candidates."""

    problem: StyleProblem
    candidates: Candidates
    tables: StyleTables
    usable: Tensor  # (m,C) bool candidates that the search may take, before locks
    locked: Mapping[int, int]  # object -> candidate
    kept: frozenset[int]  # objects locked to the material they came with
    weights: tuple[float, ...] | None  # of the palette's colours in the photos' statistics
    highlights: Mapping[int, tuple[float, float]]
    sliders: tuple[float, float, float]
    start: np.ndarray  # (m,) choice that the search started from
    result: SearchResult
    before: CostParts  # F of the start
    after: CostParts  # F of the choice
    timings_ms: Mapping[str, float]

    # --------------------------------------------------------------- reading

    __repr__ = brief

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the m objects."""
        return self.problem.objects.names

    @property
    def choice(self) -> Tensor:
        """(m,) int64 chosen candidate of each object."""
        return torch.from_numpy(self.result.choice.copy())

    @property
    def unseen(self) -> tuple[str, ...]:
        """Objects that got no candidate: the neutral material."""
        without = ~self.candidates.valid.any(dim=1)
        return tuple(self.names[i] for i in without.nonzero().reshape(-1).tolist() if i not in self.locked)

    @property
    def history(self) -> tuple[float, ...]:
        """F of the start and after every move of the search."""
        return self.result.history

    @property
    def materials(self) -> Tensor:
        """(m,8|10) float64 rows ``[k_a, k_d, k_s, alpha]`` with all later changes."""
        rows = self.candidates.materials[torch.arange(len(self.names)), self.choice].clone()
        for index, (specular, exponent) in self.highlights.items():
            rows[index, 6:-1], rows[index, -1] = specular, exponent
        free = torch.tensor([i not in self.kept for i in range(len(rows))])
        rows[free] = finish.adjusted(rows[free], self.problem.cosine[free], self.sliders)
        return rows

    @property
    def scene(self) -> Scene:
        """The scene with its new materials; nothing else of it changes."""
        problem, rows = self.problem, self.materials
        colors = finish.albedo(rows, problem.cosine)
        made = [
            None
            if i in self.kept
            else finish.as_material(
                name, colors[i].float(), float(rows[i, 6:-1].mean()), float(rows[i, -1])
            )
            for i, name in enumerate(self.names)
        ]  # fmt: skip
        ratios = colors / problem.colors.clamp_min(1e-4) if problem.options.keep_textures else None
        return finish.styled_scene(problem.scene, problem.objects, made, ratios)

    def pictures(self) -> Tensor:
        """(n,H,W,3) float32 linear renderings of the views by Phong's model, as the search sees them."""
        views, scene = self.problem.views, self.problem.scene
        glow = torch.stack([m.emission for m in scene.materials]).clamp(0.0, 1.0)
        rest = torch.where(
            views.gbuffer.covered[..., None], glow[views.gbuffer.material.clamp_min(0)], torch.tensor(0.8)
        )
        return pictures(views, self.problem.terms, self.materials, rest)

    def palette(self, colors: int = 5) -> tuple[Tensor, Tensor]:
        """Main colours of the photos: Lab (k,3) and their shares (k,) of the pixels, most frequent first."""
        lab, weight = photo_pixels(self.problem.photos)
        centres, label = palette(lab, colors, seed=self.problem.options.seed)
        share = torch.bincount(label, weight, minlength=len(centres))
        return centres, share / share.sum()

    def save(self, path: str | Path, *, add_light: bool = False) -> list[Path]:
        """Write the scene as ``.glb``, or as ``.toml`` with a GLB file beside it; returns the files.

        ``add_light``: a scene that nothing lights gets the light that the fit assumes.

        Raises:
            SceneFileError: another suffix, missing folder, or a file that cannot be written.
        """
        problem, scene = self.problem, self.scene
        return write_scene(path, finish.with_style_light(scene, problem.views, problem.light) if add_light else scene)

    # -------------------------------------------------------------- changing

    def lock(self, *words: str) -> Style:
        """Keep the present choice for these objects and search again; names, ``#number`` or patterns."""
        found = self.problem.objects.find(words)
        return self.searched(locked={**self.locked, **{i: int(self.result.choice[i]) for i in found}})

    def unlock(self, *words: str) -> Style:
        """Free these objects (none named: all) and search again."""
        found = self.problem.objects.find(words) if words else range(len(self.names))
        locked = {i: c for i, c in self.locked.items() if i not in found}
        return self.searched(locked=locked, kept=self.kept - set(found))

    def keep(self, *words: str) -> Style:
        """Keep the materials that these objects came with, and search for the others again."""
        found = self.problem.objects.find(words)
        if not found:
            return self
        problem = self.problem
        rows = finish.own_rows(problem.scene, problem.objects, problem.colors, problem.width)
        return self.with_column(rows, found).searched(kept=self.kept | set(found))

    def choose(self, word: str, candidate: int) -> Style:
        """Lock an object to one of its valid candidates, by number, and search for the others again."""
        index = self.problem.objects.one(word)
        if (
            not isinstance(candidate, int)
            or not 0 <= candidate < self.usable.shape[1]
            or not bool(self.candidates.valid[index, candidate])
        ):
            known = self.candidates.valid[index].nonzero().reshape(-1).tolist()
            raise InputError(f"candidate of {self.names[index]!r} must be one of {known}, got {candidate}")
        return self.searched(locked={**self.locked, index: candidate}, kept=self.kept - {index})

    def pick(self, word: str, region: Region, photo: int = 0) -> Style:
        """Give an object the material of a region of a photo, lock it, and search for the others again.

        Args:
            word: names one object.
            region: left, top, right, bottom in pixels of the photo as it was given.
            photo: which photo, from 0.

        Raises:
            InputError: no or several objects, a region outside the photo, no such photo.
        """
        index = self.problem.objects.one(word)
        return self.picked({index: (region, photo)}).searched()

    def with_palette(self, weights: Sequence[float]) -> Style:
        """Search again with the colours of :meth:`palette` counting more or less: 1 as they are, 0 not at all.

        Raises:
            InputError: no weight, or all of them zero. OptionError: one outside [0, 100].
        """
        values = tuple(float(w) for w in weights)
        check_range("len(weights)", len(values), 0, MAX_COLORS)
        for k, value in enumerate(values):
            check_range(f"weights[{k}]", value, 0.0, 100.0)
        if not any(values):
            raise InputError("weights must hold at least one number above zero")
        return self.searched(weights=values)

    def adjusted(self, *, lightness: float = 0.0, saturation: float = 0.0, warmth: float = 0.0) -> Style:
        """All new materials lighter, more saturated, warmer; each in [-1,1], 0 for as they are. Nothing is searched.

        Raises:
            OptionError: a number outside [-1, 1].
        """
        sliders = (lightness, saturation, warmth)
        for name, value in zip(("lightness", "saturation", "warmth"), sliders, strict=True):
            check_range(name, value, -1.0, 1.0)
        return replace(self, sliders=(float(lightness), float(saturation), float(warmth)))

    def add_highlight(self, word: str, specular: float, exponent: float = 20.0) -> Style:
        """Give objects a highlight of height ``specular`` in [0,1] and a Phong exponent in [1,200].

        Raises:
            InputError: no such object. OptionError: a number outside its range.
        """
        check_range("specular", specular, 0.0, 1.0)
        check_range("exponent", exponent, 1.0, 200.0)
        found = self.problem.objects.find([word])
        return replace(self, highlights={**self.highlights, **dict.fromkeys(found, (specular, exponent))})

    # --------------------------------------------------------------- private

    def cost(self) -> StyleCost:
        """F as a function of the choice."""
        options, problem = self.problem.options.search, self.problem
        # The views' part of F grows with their number, and an object's share in it falls with that of objects.
        share = len(problem.views) / len(self.names)
        weight = 0.05 * share if options.smooth_weight is None else options.smooth_weight
        strength = options.prior_weight * len(problem.views) / USUAL_VIEWS
        return StyleCost(
            self.tables,
            self.wanted(),
            Smoothness.of(self.candidates.materials, problem.near, options.smooth),
            smooth_weight=weight,
            prior=prior_cost(problem.role, self.tables.mean_lightness(), strength),
            misfit=options.fit_weight * share * self.candidates.misfit.numpy(),
            units=options.units,
        )

    def wanted(self) -> ColorStatistics:
        """Colour statistics of the photos, each of them with the same weight."""
        options = self.problem.options
        return photo_statistics(self.problem.photos, options.search.bins, self.weights, options.seed)

    def free(self) -> np.ndarray:
        """(m,C) bool candidates that the search may take, locks counted."""
        usable = self.usable.clone()
        for index, column in self.locked.items():
            usable[index] = False
            usable[index, column] = True
        return usable.numpy()

    def with_column(self, rows: Tensor, found: Sequence[int]) -> Style:
        """One candidate more, to which the objects ``found`` are locked."""
        chosen = torch.zeros(len(self.names), dtype=torch.bool)
        chosen[list(found)] = True
        more = build_tables(self.problem.terms, rows[:, None], self.problem.options.search.bins, chosen[:, None])
        column = self.usable.shape[1]
        return replace(
            self,
            candidates=self.candidates.with_column(rows, chosen),
            tables=self.tables.joined(more),
            # For others than those locked to it, it is no choice.
            usable=torch.cat([self.usable, torch.zeros(len(chosen), 1, dtype=torch.bool)], dim=1),
            locked={**self.locked, **dict.fromkeys(found, column)},
        )

    def picked(self, picks: Mapping[int, tuple[Region, int]]) -> Style:
        problem = self.problem
        rows = self.candidates.materials[torch.arange(len(self.names)), self.choice].clone()
        for index, (region, photo) in picks.items():
            if not 0 <= photo < len(problem.photos):
                raise InputError(f"photo must be in [0, {len(problem.photos) - 1}], got {photo}")
            pixels = problem.photos[photo].region(region)
            fit = fit_of(problem.options.fit, int(problem.role[index]))
            rows[index] = fit_region(pixels, index, problem.views, problem.terms, fit)
        return replace(self.with_column(rows, list(picks)), kept=self.kept - set(picks))

    def searched(self, progress: Progress | None = None, **changes: object) -> Style:
        """With some fields changed, searched again: from the usual start, and from what was chosen before.

        So nothing gets worse by locking what is there already.
        """
        clock = StepClock()
        changed = replace(self, **changes)  # type: ignore[arg-type]
        options = self.problem.options
        with clock.measure("search"):
            free = changed.free()
            cost = changed.cost()
            start = start_choice(changed.candidates.materials, torch.from_numpy(free), options.seed).numpy()
            before = np.where(free[np.arange(len(start)), self.result.choice], self.result.choice, start)
            step = None if progress is None else lambda k: progress("search", k)
            result = tabu_search(cost, start, free, options.search, step)
            if self.result.iterations and not np.array_equal(before, start):
                again = tabu_search(cost, before, free, options.search, step)
                result = again if again.cost < result.cost else result
        timings = {**changed.timings_ms, **clock.elapsed_ms}
        parts = cost.parts(start), cost.parts(result.choice)
        return replace(changed, start=start, result=result, before=parts[0], after=parts[1], timings_ms=timings)
