"""Which panes lie before what a picture shows, against rays."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import replace

import torch

from torchrender.effects.transparency.before import panes_before, told_apart
from torchrender.raster import rasterize_visibility
from torchrender.rays import RayCaster
from torchrender.scene.load import load
from torchrender.scene.model import Scene
from torchrender.scene.procedural import build


def behind(scene: Scene, camera) -> tuple[torch.Tensor, list[tuple[int, ...]]]:
    """Sums of panes, and the objects that rays meet before solid surfaces, one for each crossing."""
    seen = rasterize_visibility(scene.geometry, camera)
    origins, directions = (rays[0].reshape(-1, 3) for rays in camera.rays())
    limit = seen.depth.reshape(-1).double()
    caster = RayCaster(scene.geometry.panes)
    met: list[list[int]] = [[] for _ in limit]
    hits, rows = caster.first_hit(origins, directions, t_max=limit), torch.arange(len(limit))
    while len(kept := hits.hit.nonzero().reshape(-1)):
        rows, triangles = rows[kept], hits.triangle[kept]
        for row, triangle in zip(rows.tolist(), triangles.tolist(), strict=True):
            met[row].append(int(scene.geometry.object_id[triangle]))
        hits = caster.next_hit(origins[rows], directions[rows], hits.t[kept], triangles, t_max=limit[rows])
    return panes_before(scene, seen).reshape(-1), [tuple(sorted(one)) for one in met]


def test_pixels_have_the_same_number_where_rays_meet_the_same_panes() -> None:
    scene = build("panes", triangles=600)
    numbers, met = behind(scene, scene.camera(width=96, height=72))
    of_set = defaultdict(list)
    for number, objects in zip(numbers.tolist(), met, strict=True):
        of_set[objects].append(number)
    assert len(of_set) > 12 and () in of_set
    usual = {objects: max(set(found), key=found.count) for objects, found in of_set.items()}
    assert usual[()] == 0
    large = {objects: number for objects, number in usual.items() if len(of_set[objects]) > 5}
    assert len(set(large.values())) == len(large) > 6, "other panes, another number"
    right = sum(found.count(usual[objects]) for objects, found in of_set.items())
    assert right > 0.97 * len(numbers), "the rasteriser and rays part at edges alone"


def test_nothing_is_told_apart_where_nothing_shows_what_lies_behind() -> None:
    scene = load("cornell_box")
    seen = rasterize_visibility(scene.geometry, scene.camera(width=32, height=24))
    assert told_apart(scene, seen) is seen
    assert not panes_before(scene, seen).any()


def test_names_change_behind_panes_alone() -> None:
    scene = build("panes", triangles=600)
    seen = rasterize_visibility(scene.geometry, scene.camera(width=64, height=48))
    apart, before = told_apart(scene, seen), panes_before(scene, seen)
    assert torch.equal(apart.object_id != seen.object_id, before != 0)
    assert apart.depth is seen.depth and replace(apart, object_id=seen.object_id).triangle is seen.triangle
