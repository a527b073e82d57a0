"""How much light from everywhere is hidden, told from a picture's depth."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
import torch

import torchrender as tr
from torchrender.passes.light.hidden_light import DISTANCES, SIDE, depth_visibility
from torchrender.passes.senses import roughly
from torchrender.pipeline.history import RenderHistory
from torchrender.planning.costs import sense_of
from torchrender.raster import rasterize
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
