"""Which way reflections are made when nobody says: the most accurate of the quick ones."""

from __future__ import annotations

from dataclasses import replace

import torch

from reflection_scenes import looking, sphere_scene
from torchrender.effects.reflections.clustered import ClusterOptions
from torchrender.passes.mirrors import reflections
from torchrender.passes.mirrors.reflections import WAYS, settle
from torchrender.passes.outlook import Outlook
from torchrender.passes.seen.ray_caster import RAY_CASTER
from torchrender.pipeline.history import RenderHistory
from torchrender.pipeline.options import RenderOptions
from torchrender.planning.planner import plan
from torchrender.renderer import render

SCENE = sphere_scene()
TIMES = {"clustered": 20.0, "hybrid": 30.0, "traced": 10.0}


def chosen(tree_ms: float, history: RenderHistory | None = None, **options: object) -> str:
    """The way, where all but the tree takes the same in each."""
    wish = RenderOptions(**options)  # type: ignore[arg-type]
    past = RenderHistory.alone() if history is None else history
    outlook = Outlook(scene=SCENE, cameras=looking(), options=wish, history=past)

    def prices(made: RenderOptions) -> dict[object, float | None]:
        way = "hybrid" if made.reflections == "clustered" and made.reflection.missing == "trace" else made.reflections
        tree = {} if way == "clustered" else {RAY_CASTER: tree_ms}
        return {"reflections": TIMES[way], **tree}

    made = settle(outlook, prices)  # type: ignore[arg-type]
    return "hybrid" if made.reflections == "clustered" and made.reflection.missing == "trace" else made.reflections


def test_rays_are_cast_where_the_tree_is_cheap() -> None:
    assert chosen(5.0) == "traced"
    assert chosen(0.0) == "traced"


def test_clusters_spare_a_tree_that_costs_more() -> None:
    assert chosen(500.0) == "clustered"


def test_a_sequence_pays_for_its_tree_once() -> None:
    assert chosen(500.0, RenderHistory()) == "traced"
    changed = replace(RenderHistory(), pictures=3)  # and no tree is left: the scene has changed
    assert chosen(500.0, changed) == "clustered"


def test_a_wish_stays_a_wish() -> None:
    assert chosen(0.0, reflections="clustered") == "clustered"
    assert chosen(500.0, reflections="traced") == "traced"


def test_what_was_never_measured_is_not_chosen() -> None:
    outlook = Outlook(scene=SCENE, cameras=looking(), options=RenderOptions(), history=RenderHistory.alone())
    assert settle(outlook, lambda _: {RAY_CASTER: None}).reflections == "traced"


def test_the_plan_names_the_way_and_the_picture_takes_it() -> None:
    made = plan(SCENE, looking())
    assert made.row("reflections").setting != "custom" and made.options.reflections in ("traced", "clustered")
    image = render(SCENE, looking(24))
    assert image.plan is not None
    same = render(SCENE, looking(24), options=image.plan.options)
    assert torch.equal(image.radiance, same.radiance)


def test_own_options_of_clusters_leave_rays() -> None:
    """At settings that were never timed nothing says that they are quick."""
    wish = RenderOptions(reflection=ClusterOptions(bin_factor=0.7))
    assert plan(SCENE, looking(), options=wish).options.reflections == "traced"


def test_a_budget_still_chooses_from_all_ways() -> None:
    """One that nothing keeps takes the quickest way: in a picture alone that may be rays, for a cube map of the
    surroundings is first made."""
    tight = plan(SCENE, looking(256), budget_ms=1.0)
    for name in WAYS | {"environment": {"reflections": "environment"}}:
        other = reflections.PASS.settings.named(name).applied(tight.options)
        took = plan(SCENE, looking(256), options=other).predicted_ms
        assert tight.predicted_ms is not None and took is not None
        assert tight.predicted_ms <= 1.001 * took, name
