"""What is near to the eye is seen: near planes follow the view, and those that are given hold where they were given."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch

import torchrender as tr
from browser_stage import Visit

SIZE = {"width": 240, "height": 160}
AHEAD = "() => window.torchrender.keyframes.some((k) => Math.abs(k.camera.near - {near}) < 1e-9)"
STANDS = """() => {
    const here = window.torchrender?.camera, there = window.torchrender?.keyframes[0]?.camera;
    return there && !window.torchrender.moving
        && there.world_from_camera.every((v, n) => Math.abs(v - here.world_from_camera[n]) < 1e-6);
}"""


def test_what_comes_close_is_not_cut_off(browser: Any) -> None:
    red, grey = tr.Material(name="red", diffuse=torch.tensor([0.8, 0.05, 0.05])), tr.Material(name="grey")
    ball = tr.Mesh.sphere(0.5, (0.0, 0.5, 0.0), segments=24, name="ball")
    floor = tr.Mesh.box((4.0, 0.1, 4.0), (0.0, -0.3, 0.0), name="floor", material=1)
    scene = tr.Scene(meshes=[ball, floor], materials=[red, grey], name="close")
    context = browser.new_context(viewport=SIZE)
    with tr.show(scene, browser=False) as view:
        visit = Visit.begin(context, view.url.partition("?")[0], scene=view.id, layers=0, **SIZE)
        visit.wait(STANDS)
        assert visit.state("camera")["near"] < 0.01, "whoever goes on from the first view comes closer"
        given = tr.Cameras.look_at((0.5, 4.0, 1.0), (0.0, 0.5, 0.0), near=0.02, **SIZE)
        view.camera = given
        visit.wait(AHEAD.format(near=0.02))
        visit.wait(STANDS)
        assert float(view.camera.near[0]) == 0.02, "as it was given"
        assert is_red(middle(visit)), "the ball is in the middle"
        picked = view.pick(SIZE["width"] / 2, SIZE["height"] / 2)
        assert picked is not None and picked.mesh.name == "ball" and float(picked.point[1]) > 0.8, "its upper side"
        view.camera = tr.Cameras.look_at((0.5, 4.0, 1.0), (0.0, 0.5, 0.0), near=4.3, **SIZE)  # cuts the ball away
        visit.wait(AHEAD.format(near=4.3))
        visit.wait(STANDS)
        assert not is_red(middle(visit))
        visit.page.mouse.move(120, 80)
        for _ in range(12):
            visit.page.mouse.wheel(0, -400)
            visit.page.wait_for_timeout(60)
        visit.wait(STANDS)
        assert visit.state("camera")["near"] < 0.011
        colors, covered = visit.capture()
        assert covered.mean() > 0.95 and is_red(colors[40:120, 60:180].mean((0, 1))), "close before the ball"
    assert not visit.problems
    context.close()


def middle(visit: Visit) -> np.ndarray[Any, Any]:
    colors, covered = visit.capture()
    assert covered[78:82, 118:122].all()
    return colors[78:82, 118:122].mean((0, 1))


def is_red(color: np.ndarray[Any, Any]) -> bool:
    return bool(color[0] > 1.5 * color[1])
