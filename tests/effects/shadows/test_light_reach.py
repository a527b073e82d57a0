"""Which lights reach what is seen: every reason why one does not, and lists of tiles."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch

from shadow_scenes import box, floor
from torchrender.effects.shadows.light_reach import light_reach, shines, takes_light
from torchrender.errors import OptionError
from torchrender.raster import rasterize
from torchrender.scene.camera import Cameras
from torchrender.scene.light import DirectionalLight, PointLight, RectLight, SpotLight
from torchrender.scene.material import Material
from torchrender.scene.model import Scene
from torchrender.shade import shade

VIEW = Cameras.look_at((0.0, 4.0, 6.0), (0.0, 0.0, 0.0), width=70, height=50)


def vector(*values: float) -> torch.Tensor:
    return torch.tensor(values)


REACHING = {
    "sun": DirectionalLight(direction=vector(0.2, -1.0, 0.1)),
    "lamp": PointLight(position=vector(0.0, 2.0, 0.0)),
    "spot": SpotLight(position=vector(0.0, 3.0, 0.0), direction=vector(0.0, -1.0, 0.0)),
    "panel": RectLight(corner=vector(-1.0, 3.0, -1.0), edge_u=vector(2.0, 0, 0), edge_v=vector(0.0, 0, 2.0)),
}
DARK = {
    "below the floor": PointLight(position=vector(0.0, -2.0, 0.0)),
    "sun from below": DirectionalLight(direction=vector(0.0, 1.0, 0.0)),
    "cone beside the view": SpotLight(position=vector(0.0, 3.0, 0.0), direction=vector(0.0, 1.0, 0.0)),
    "off": PointLight(position=vector(0.0, 2.0, 0.0), intensity=torch.zeros(3)),
    "range that ends before": PointLight(position=vector(0.0, 2.0, 0.0), range=1.99),
    "spot that ends before": SpotLight(position=vector(0.0, 3.0, 0.0), direction=vector(0.0, -1.0, 0.0), range=2.99),
    "panel that looks up": RectLight(
        corner=vector(-1.0, 3.0, -1.0), edge_u=vector(0.0, 0, 2.0), edge_v=vector(2.0, 0, 0)
    ),
    "panel without area": RectLight(corner=vector(-1.0, 3.0, -1.0), edge_u=vector(0.0, 0, 2.0), edge_v=torch.zeros(3)),
}  # fmt: skip


def scene_of(*lights, **changes) -> Scene:
    return replace(Scene(meshes=(floor(4.0),), lights=tuple(lights)), **changes)


def test_lights_that_reach_and_lights_that_do_not() -> None:
    scene = scene_of(*REACHING.values(), *DARK.values())
    found = light_reach(scene, rasterize(scene, VIEW))
    assert found.any.tolist() == [True] * len(REACHING) + [False] * len(DARK)
    assert not shines(DARK["off"]) and shines(DARK["below the floor"])


def test_black_surfaces_and_the_sky_take_no_light() -> None:
    black = Material(name="black", diffuse=torch.zeros(3), specular=0.0)
    scene = scene_of(*REACHING.values(), materials=(black,))
    assert not bool(light_reach(scene, rasterize(scene, VIEW)).any.any())
    up = Cameras.look_at((0.0, 4.0, 6.0), (0.0, 20.0, 0.0), width=20, height=20)
    lit = scene_of(*REACHING.values())
    found = light_reach(lit, rasterize(lit, up))
    assert not bool(found.any.any()) and len(found.lights) == 0 and int(found.starts[-1]) == 0


@pytest.mark.parametrize("side", [1, 16, 1000])
def test_lists_of_tiles_bring_all_the_light(side: int) -> None:
    """Shading with the listed lights alone gives the whole picture."""
    spots = [
        SpotLight(position=vector(x, 1.0, z), direction=vector(0.1, -1.0, 0.0), inner_deg=10.0, outer_deg=25.0)
        for x in (-3.0, -1.0, 1.0, 3.0) for z in (-3.0, 0.0, 3.0)
    ]  # fmt: skip
    scene = Scene(meshes=(floor(4.0), box((-0.5, 0.0, -0.5), (0.5, 1.0, 0.5))), lights=(*spots, *REACHING.values()))
    both = Cameras.cat([VIEW, Cameras.look_at((3.0, 2.0, -3.0), (0.0, 0.0, 0.0), width=70, height=50)])
    seen = rasterize(scene, both)
    found = light_reach(scene, seen, side=side)
    rows, columns = -(-50 // side), -(-70 // side)
    assert len(found.starts) == 2 * rows * columns + 1 and found.reaches.shape == (2, len(scene.lights))
    factors = torch.zeros(2, len(scene.lights), 50, 70)
    for b in range(2):
        for t in range(rows * columns):
            top, left = t // columns * side, t % columns * side
            for light in found.lights[found.starts[b * rows * columns + t] : found.starts[b * rows * columns + t + 1]]:
                factors[b, int(light), top : top + side, left : left + side] = 1.0
    assert torch.allclose(shade(scene, seen, factors), shade(scene, seen), atol=1e-6)
    if side == 16:
        assert float(factors[:, : len(spots)].mean()) < 0.4


def test_side_is_checked() -> None:
    scene = scene_of(*REACHING.values())
    with pytest.raises(OptionError, match="side"):
        light_reach(scene, rasterize(scene, VIEW), side=0)


def test_cloth_and_lacquer_take_light_and_lamps_without_area_send_none() -> None:
    black = {"diffuse": torch.zeros(3), "metallic": 0.0, "specular_weight": 0.0}
    kinds = ({}, {"sheen_color": torch.ones(3), "sheen_roughness": 0.5}, {"clearcoat": 1.0})
    scene = scene_of(materials=tuple(Material(**black, **kind) for kind in kinds))
    assert takes_light(scene).tolist() == [False, True, True, False]
    line = RectLight(corner=vector(0, 2, 0), edge_u=vector(1, 0, 0), edge_v=vector(0, 0, 0))
    assert not shines(line) and shines(replace(line, edge_v=vector(0, 0, 1)))
    dark = PointLight(position=vector(0, 2, 0), intensity=vector(0, 0, 0))
    assert not shines(dark) and shines(replace(dark, intensity=vector(0, 0, 1)))
