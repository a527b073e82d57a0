"""From a scene and photos to a style: the stages in order, each timed."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
import torch
from torch import Tensor

from torchrender.checks import as_vector
from torchrender.clock import StepClock
from torchrender.errors import InputError
from torchrender.photo.photograph import Photo, prepare_photo
from torchrender.photo.style import finish
from torchrender.photo.style.adjacency import adjacency
from torchrender.photo.style.candidates import Candidates, fit_candidates, thinned, without_doubles
from torchrender.photo.style.cost import CostParts
from torchrender.photo.style.objects import StyleObjects, cut_scene
from torchrender.photo.style.options import StyleOptions, StyleWarning, check_options
from torchrender.photo.style.prior import roles
from torchrender.photo.style.search import SearchResult
from torchrender.photo.style.session import Progress, Region, Style, StyleProblem
from torchrender.photo.style.statistics import StyleTables, build_tables
from torchrender.photo.style.terms import default_light, mean_terms, view_terms
from torchrender.photo.style.views import look, make_views
from torchrender.scene.camera import Cameras
from torchrender.scene.model import Scene

_LISTED = 8


def style_scene(
    scene: Scene,
    photos: Tensor | Sequence[Tensor],
    options: StyleOptions | None = None,
    *,
    cameras: Cameras | None = None,
    light: Sequence[float] | Tensor | None = None,
    keep: Sequence[str] = (),
    pick: Mapping[str, Region] | None = None,
    progress: Progress | None = None,
) -> Style:
    """Materials for a scene from the colours of one or several photos.

    Args:
        scene: meshes that are objects already; light sources keep their material.
        photos: linear light (H,W,C), or (H,W) grey, as ``read_image`` gives it; several count alike.
        options: what may be chosen.
        cameras: 1 to 15 views instead of generated ones; their size counts, not that of the options.
        light: (3,) position of the white point light that the fit assumes; default 5 % below the top centre, or
            outside where all views are.
        keep: objects that keep the material they have: names, ``#number`` or patterns.
        pick: regions of the first photo (left, top, right, bottom in pixels) whose material an object takes.
        progress: called with the name of the stage and a count whenever one gets on.

    Raises:
        InputError: no photo or a bad one, no object, names that fit nothing, regions outside the photo.

    Warns:
        StyleWarning: objects that no view shows, which get a neutral material.
    """
    options = StyleOptions() if options is None else options
    tell = progress or _silent
    clock = StepClock()
    with clock.measure("photo"):
        prepared = _prepared(photos)
    check_options(options)
    objects = cut_scene(scene, options.cut)
    wishes = _wishes(objects, prepared[0], keep, pick or {})
    given = None if light is None else as_vector("light", light, 3, torch.float64)
    tell("views", 0)
    with clock.measure("views"):
        shown = make_views(scene, objects, options) if cameras is None else cameras
        views = look(scene, objects, shown, options.visible_share)
        position = default_light(scene, shown) if given is None else given
        terms = view_terms(scene, views, position, options.keep_textures)
    with clock.measure("neighbours"):
        problem = StyleProblem(
            scene=scene,
            objects=objects,
            options=options,
            photos=prepared,
            views=views,
            terms=terms,
            light=position,
            near=adjacency(scene, objects, options.seed),
            role=roles(scene, objects),
            cosine=mean_terms(terms, len(objects)),
            colors=finish.own_colors(scene, objects, views),
        )
    return _fitted(problem, clock, tell, wishes)


def _prepared(photos: Tensor | Sequence[Tensor]) -> tuple[Photo, ...]:
    given = [photos] if isinstance(photos, Tensor) else list(photos)
    if not given:
        raise InputError("photos must hold at least one photo")
    names = ["photo"] if len(given) == 1 else [f"photos[{k}]" for k in range(len(given))]
    return tuple(prepare_photo(photo, name) for photo, name in zip(given, names, strict=True))


def _wishes(
    objects: StyleObjects, photo: Photo, keep: Sequence[str], pick: Mapping[str, Region]
) -> tuple[list[int], dict[int, tuple[Region, int]]]:
    """Objects that keep their material, and regions of photos by object."""
    if not isinstance(pick, Mapping):
        raise InputError(f"pick must map objects to regions, got {type(pick).__name__}")
    picked = {objects.one(word): (region, 0) for word, region in pick.items()}
    for region, _ in picked.values():
        photo.region(region)
    held = objects.find(keep)
    both = [objects.names[i] for i in held if i in picked]
    if both:
        raise InputError(f"{both[0]!r} cannot both keep its material and take one from the photo")
    return held, picked


def _fitted(
    problem: StyleProblem,
    clock: StepClock,
    tell: Progress,
    wishes: tuple[list[int], dict[int, tuple[Region, int]]],
) -> Style:
    """Candidates, their tables, what is kept and picked, and the search."""
    options = problem.options
    tell("fit", len(problem.views))
    with clock.measure("fit"):
        candidates = fit_candidates(problem.photos, problem.views, problem.terms, options, problem.role)
    tell("tables", candidates.materials.shape[1])
    with clock.measure("tables"):
        tables = build_tables(problem.terms, candidates.materials, options.search.bins, candidates.rendered)
    style = _first(problem, candidates, tables, clock)
    held, picked = wishes
    if held:
        rows = finish.own_rows(problem.scene, problem.objects, problem.colors, problem.width)
        style = replace(style.with_column(rows, held), kept=frozenset(held))
    style = style.picked(picked) if picked else style
    style = style.searched(tell)
    _warn_unseen(style)
    return style


def _silent(stage: str, count: int) -> None:
    del stage, count


def _first(problem: StyleProblem, candidates: Candidates, tables: StyleTables, clock: StepClock) -> Style:
    """A style that nothing was searched for yet."""
    usable = without_doubles(candidates)
    if problem.options.search.cluster is not None:
        usable = thinned(candidates.materials, usable, problem.options.search.cluster, problem.options.seed)
    nothing = np.zeros(len(problem.objects), dtype=np.int64)
    parts = CostParts(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    return Style(
        problem=problem,
        candidates=candidates,
        tables=tables,
        usable=usable,
        locked={},
        kept=frozenset(),
        weights=None,
        highlights={},
        sliders=(0.0, 0.0, 0.0),
        start=nothing,
        result=SearchResult(nothing, 0.0, (0.0,), (tuple(nothing.tolist()),), (False,), "no move"),
        before=parts,
        after=parts,
        timings_ms=clock.elapsed_ms,
    )


def _warn_unseen(style: Style) -> None:
    names = style.unseen
    if names:
        listed = ", ".join(repr(n) for n in names[:_LISTED])
        more = f" and {len(names) - _LISTED} more" if len(names) > _LISTED else ""
        warnings.warn(
            f"{len(names)} of {len(style.names)} objects are too small in every view and get a neutral material:"
            f" {listed}{more}",
            StyleWarning,
            stacklevel=4,
        )
