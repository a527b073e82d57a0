"""How much light from everywhere is hidden, told from a picture's depth."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
import torch

import torchrender as tr
from torchrender.effects.ambient.traced import traced_ambient
from torchrender.passes.light.hidden_light import DISTANCES, SIDE, depth_visibility, eye_visibility
from torchrender.passes.senses import few, roughly
from torchrender.pipeline.history import RenderHistory
from torchrender.planning.costs import Knowledge, sense_of
from torchrender.planning.curves import load_curves
from torchrender.quality.metrics import flip
from torchrender.raster import rasterize
from torchrender.rays import RayCaster
from torchrender.renderer import NO_LIMIT


def by_loops(place: torch.Tensor, normal: torch.Tensor, covered: torch.Tensor, reach: float) -> torch.Tensor:
    """The same of images (h,w,...), pixel by pixel."""
    height, width = covered.shape
    found = torch.ones(height, width)
    for i in range(height):
        for j in range(width):
            if not covered[i, j]:
                continue
            squares = 0.0
            for row, column in ((1, 0), (1, 1), (0, 1), (-1, 1), (-1, 0), (-1, -1), (0, -1), (1, -1)):
                highest = 0.0
                for far in DISTANCES:
                    k, m = i + row * far, j + column * far
                    if 0 <= k < height and 0 <= m < width and covered[k, m]:
                        way = place[k, m] - place[i, j]
                        if 0.0 < float(way.norm()) <= reach:
                            highest = max(highest, float(way @ normal[i, j] / way.norm()))
                squares += min(highest, 1.0) ** 2
            found[i, j] = 1.0 - squares / 8
    return found


@pytest.mark.parametrize("reach", [math.inf, 0.3])
def test_visibility_is_that_of_loops(reach: float) -> None:
    scene = tr.load("cornell_box")
    seen = rasterize(scene, scene.camera(width=24, height=20))
    found = depth_visibility(seen, reach)
    wanted = by_loops(seen.position[0].float(), seen.normal[0], seen.covered[0], reach)
    assert max(seen.covered.shape[1:]) <= SIDE
    torch.testing.assert_close(found[0], wanted, atol=2e-3, rtol=0)
    assert float(found[seen.covered].min()) < 0.9


def test_what_is_left_out_is_sensed_about_as_rays_tell_it() -> None:
    scene = tr.load("grass", size=3000)
    camera = scene.camera(width=96, height=72)
    sensed = []
    for way in ("traced", "off"):
        options = tr.RenderOptions(ambient_visibility=way, fixed=("ambient_visibility",))
        history = tr.render(scene, camera, history=RenderHistory(), options=options, budget_ms=NO_LIMIT).history
        assert history is not None and history.pace is not None
        sensed.append(history.pace.known)
    rays = sensed[0][sense_of("ambient_visibility")]
    depth = sensed[1][sense_of(roughly("ambient_visibility"))]
    assert sense_of("ambient_visibility") not in sensed[1]
    assert rays / 1.6 < depth < rays * 1.6


def test_nothing_is_hidden_in_the_open() -> None:
    scene = tr.load("cornell_box")
    seen = rasterize(scene, scene.camera(width=24, height=20))
    assert float(depth_visibility(seen, 1e-9).min()) == 1.0
    assert float(depth_visibility(replace(seen, normal=-seen.normal), math.inf).max()) <= 1.0


def room(*others: tr.Mesh) -> tr.Scene:
    """A closed one on open ground, under a bright sky."""
    walls = tr.Mesh.box([4.0, 3.0, 4.0], [0.0, 1.5, 0.0], name="room")
    table = tr.Mesh.box([0.8, 0.8, 0.8], [0.8, 0.4, -0.8], name="table", material=1)
    ground = tr.Mesh.plane(30.0, name="ground", material=1)
    paints = [tr.Material(diffuse=[0.8, 0.8, 0.75]), tr.Material(diffuse=[0.5, 0.35, 0.2])]
    sky = tr.Environment.constant([0.5, 0.55, 0.6])
    return tr.Scene(meshes=(walls, table, ground, *others), materials=paints, environment=sky)


def unlit() -> tr.Scene:
    """The same in the light that scenes without lamps get: what is near hides it."""
    return room().replace(environment=None)


def inside(turn: float = 0.0) -> tr.Cameras:
    toward = [math.cos(turn), 1.4, math.sin(turn)]
    return tr.Cameras.look_at([0.0, 1.5, 0.0], toward, width=96, height=72, fov_deg=60)


def outside() -> tr.Cameras:
    return tr.Cameras.look_at([9.0, 4.0, 3.0], [0.0, 1.5, 0.0], width=96, height=72, fov_deg=60)


def test_the_eye_sees_whether_there_is_a_sky() -> None:
    """None in a closed room; on open ground all of it over the ground, and about what rays find in a yard."""
    seen = rasterize(room(), inside())
    assert float(eye_visibility(room(), seen, math.inf)[0][seen_few(seen)].max()) < 0.02  # type: ignore[index]
    plane = tr.Scene(meshes=(tr.Mesh.plane(30.0),))
    seen = rasterize(plane, tr.Cameras.look_at([0.0, 2.0, 0.0], [3.0, 0.0, 0.0], width=40, height=30))
    assert float(eye_visibility(plane, seen, math.inf)[0].min()) > 0.98  # type: ignore[index]
    sides = [tr.Mesh.box([0.2, 3.0, 6.0], [x, 1.5, 0.0]) for x in (-2.0, 2.0)]
    yard = tr.Scene(meshes=(tr.Mesh.plane(30.0), *sides))
    seen = rasterize(yard, tr.Cameras.look_at([0.0, 1.0, 0.0], [0.0, 0.0, 2.0], width=32, height=32))
    rays = traced_ambient(RayCaster(yard.geometry), seen, rays=64, reach=1.0, share=False, spacing=1, far=True)
    found = eye_visibility(yard, seen, math.inf)
    assert found is not None and 0.3 < float(rays.sky[seen.covered].mean()) < 0.8
    assert float(found[0][seen.covered].mean()) == pytest.approx(float(rays.sky[seen.covered].mean()), rel=0.25)
    near = eye_visibility(yard, seen, math.inf, (math.inf, 1.0, 1e-6))
    assert near is not None and torch.equal(near[0], found[0]) and float(near[2].min()) == 1.0
    assert float(near[1][seen.covered].mean()) == pytest.approx(float(rays.near[seen.covered].mean()), abs=0.1)


def seen_few(seen: tr.GBuffer) -> torch.Tensor:
    return few(seen.covered, SIDE)


def test_who_does_not_look_around() -> None:
    scene, eye = room(), inside()
    seen = rasterize(scene, eye)
    assert eye_visibility(scene, seen, 0.0) is None
    five = rasterize(scene, eye[[0] * 5])
    assert eye_visibility(scene, five, math.inf) is None
    flat = tr.Cameras.orthographic_view([0.0, 1.5, 0.0], [1.0, 1.5, 0.0], width=8, height=8, view_height=1.0)
    assert eye_visibility(scene, rasterize(scene, flat), math.inf) is None


def flip_of(image: tr.Image, scene: tr.Scene) -> float:
    exact = tr.RenderOptions(ambient_visibility="traced", point_shadows="traced", supersample=2)
    return float(flip(image.displayed(), tr.render(scene, image.cameras, options=exact).displayed())[0])


@pytest.mark.parametrize("bound", [0.05, 0.1])
def test_a_bound_holds_where_no_light_from_everywhere_arrives(bound: float) -> None:
    """Black is right, and was taken for a room in which nothing depends on what hides the sky."""
    scene = room()
    assert flip_of(tr.render(scene, inside(), max_error=bound), scene) <= bound


def test_what_an_eye_senses_outside_says_nothing_inside() -> None:
    scene, history = room(), RenderHistory()
    for view in (outside(), outside(), inside(), inside(0.05), inside(0.1)):
        image = tr.render(scene, view, max_error=0.1, history=history)
        history = image.history
        assert flip_of(image, scene) <= 0.1


@pytest.mark.parametrize("make", [room, unlit])
def test_what_a_budget_leaves_out_comes_back_inside(make) -> None:
    """The first picture inside stands by the choice outside; what it sees is what the next ones go by."""
    off = tr.RenderOptions(ambient_visibility="off", fixed=("ambient_visibility",))
    scene, history, known = make(), RenderHistory(), []
    for view in (outside(), inside(), inside(0.05)):
        history = tr.render(scene, view, options=off, budget_ms=NO_LIMIT, history=history).history
        known.append(history.pace.known[sense_of(roughly("ambient_visibility"))])
    assert known[1] > 5 * max(known[0], 0.01) and known[2] > 0.1


def test_a_budget_knows_nothing_of_a_view_that_leaps() -> None:
    """What an eye outside sensed is forgotten, and what was chosen by it: the picture inside is as one alone."""
    scene, history = room(), RenderHistory()
    for view in (outside(), outside()):
        history = tr.render(scene, view, budget_ms=2e3, history=history).history
    assert sense_of(roughly("ambient_visibility")) in history.pace.known and history.pace.search is not None
    known = Knowledge.of(scene, inside(), tr.RenderOptions(), history, load_curves())
    assert not any(name.startswith(sense_of("")) for name in known.pace.known) and known.pace.search is None
    near = Knowledge.of(scene, outside(), tr.RenderOptions(), history, load_curves())
    assert near.pace is history.pace
    image = tr.render(scene, inside(), budget_ms=2e3, history=history)
    assert flip_of(image, scene) < 0.05
