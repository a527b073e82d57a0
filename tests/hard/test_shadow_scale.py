"""Shadows hold at any size of the ground, far from the origin, in micrometres and megametres, and for odd lights."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
import torch
from torch import Tensor

from shadow_scenes import box, floor, quad
from torchrender.effects.shadows.light_reach import light_reach
from torchrender.effects.shadows.shadow_map import FILTERS, ShadowOptions, light_visibility
from torchrender.effects.shadows.soft_shadow import SoftShadowOptions, soft_shadow
from torchrender.effects.shadows.traced import traced_visibility
from torchrender.raster import rasterize
from torchrender.rays import RayCaster
from torchrender.renderer import render
from torchrender.scene.camera import Cameras
from torchrender.scene.light import DirectionalLight, PointLight, RectLight, SpotLight
from torchrender.scene.material import Material
from torchrender.scene.mesh import Mesh
from torchrender.scene.model import Scene
from torchrender.scene.procedural import build
from torchrender.shade import shade

SUN = DirectionalLight(direction=torch.tensor([-0.6, -1.0, -0.2]))
POST = box((-0.15, 0.0, -0.15), (0.15, 0.6, 0.15))
EYE, TARGET = (0.8, 0.9, 1.2), (0.0, 0.2, 0.0)
EDGES = ("none", "bilinear", "pcf", "poisson")


def look(width: int = 160, height: int = 120, scale: float = 1.0, move: Tensor | None = None) -> Cameras:
    move = torch.zeros(3, dtype=torch.float64) if move is None else move
    eye, target = (torch.tensor(v, dtype=torch.float64) * scale + move for v in (EYE, TARGET))
    return Cameras.look_at(eye, target, width=width, height=height, near=1e-3 * scale)


def on_ground(half: float) -> Scene:
    return Scene(meshes=(POST, floor(half)), lights=(SUN,))


def shares(found: Tensor, wanted: Tensor, counted: Tensor) -> tuple[float, float]:
    """Of the dark pixels those that are lit, and of the lit ones those that are dark."""
    lit, dark = counted & (wanted > 0.5), counted & (wanted < 0.5)
    return float((found > 0.5)[dark].double().mean()), float((found < 0.5)[lit].double().mean())


@pytest.mark.parametrize("half", [50.0, 150.0, 500.0, 2048.0, 5000.0])
def test_a_small_box_keeps_its_shadow_on_any_ground(half: float) -> None:
    small, large = on_ground(2.0), on_ground(half)
    reference = rasterize(small, look())
    exact = traced_visibility(RayCaster(small.geometry), SUN, reference)
    seen = rasterize(large, look())
    both = seen.covered & reference.covered & (seen.object_id == reference.object_id)
    facing = both & ((seen.geometric_normal @ -SUN.direction) > 0)
    assert int((exact < 0.5)[facing].sum()) > 100
    traced = traced_visibility(RayCaster(large.geometry), SUN, seen)
    for found, kept in ((light_visibility(large, SUN, seen), 0.98), (traced, 0.99)):
        lost, false = shares(found, exact, facing)
        assert lost <= 1 - kept and false <= 0.003


MOVES = {"utm": (408201.5848, 4080928.0166, 812.25), "origin": (0.0, 0.0, 0.0), "odd": (-3e6 + 0.37, 1e5 / 3, 7e6 / 11)}


@pytest.mark.parametrize("name", MOVES)
@pytest.mark.parametrize("scale", [1e-6, 1.0, 1e6])
def test_the_same_picture_anywhere_and_at_any_scale(name: str, scale: float) -> None:
    """Shadow factors of every filter, and of rays, equal those at the origin."""
    move = torch.tensor(MOVES[name], dtype=torch.float64) * scale

    def placed(mesh: Mesh) -> Mesh:
        return Mesh(vertices=mesh.vertices.double() * scale + move, faces=mesh.faces, name=mesh.name)

    here, there = (Scene(meshes=(POST, floor(2.0)), lights=(SUN,)) for _ in "12")
    there = replace(there, meshes=tuple(placed(mesh) for mesh in there.meshes))
    first, second = rasterize(here, look(80, 60)), rasterize(there, look(80, 60, scale, move))
    assert float((first.triangle != second.triangle).double().mean()) < 1e-3
    same = first.triangle == second.triangle
    a, b = (traced_visibility(RayCaster(s.geometry), SUN, g) for s, g in ((here, first), (there, second)))
    assert float((a - b)[same].abs().mean()) <= 1e-3
    for kind in EDGES:
        options = ShadowOptions(filter=kind, size=512)
        a, b = (light_visibility(s, SUN, g, options) for s, g in ((here, first), (there, second)))
        assert float((a - b)[same].abs().mean()) <= 1e-3, kind


@pytest.mark.parametrize("name", ["city", "nest", "grass", "tree", "cornell_box", "washroom"])
def test_no_false_shadow_with_any_filter_that_softens_edges(name: str) -> None:
    sizes = {"city": 12000, "nest": 12000, "grass": 9000, "tree": 12000, "washroom": 9000}
    scene = build(name, triangles=sizes.get(name))
    seen = rasterize(scene, scene.camera(width=120, height=120))
    caster = RayCaster(scene.geometry)
    for light in scene.lights[:2]:
        exact = traced_visibility(caster, light, seen)
        counted = seen.covered & faces(light, seen)
        for kind in EDGES:
            found = light_visibility(scene, light, seen, ShadowOptions(filter=kind, filter_radius=2, size=512))
            lost, false = shares(found, exact, counted)
            assert false <= 0.003 and lost <= 0.03, (light.name, kind)


def faces(light, seen) -> Tensor:
    """(B,H,W) bool: the surface is not turned away from the light, and lies in its range, in its cone, on its side."""
    if isinstance(light, DirectionalLight):
        return (seen.geometric_normal @ -light.direction) > 0
    place = light.centre if isinstance(light, RectLight) else light.position
    toward = torch.nn.functional.normalize(place.double() - seen.position, dim=-1)
    found = (toward * seen.geometric_normal).sum(-1) > 1e-6  # beyond what float32 depth leaves open
    if isinstance(light, PointLight | SpotLight):
        found &= (place.double() - seen.position).norm(dim=-1) < light.range
    if isinstance(light, SpotLight):
        found &= (toward @ -light.direction.double()) > math.cos(math.radians(light.outer_deg))
    return found & ((toward @ -light.normal.double()) > 0) if isinstance(light, RectLight) else found


ODD = {
    "on a surface": PointLight(position=torch.tensor([0.5, 0.0, 0.4])),
    "inside a mesh": PointLight(position=torch.tensor([0.0, 0.3, 0.0])),
    "at 1e6": PointLight(position=torch.tensor([6e5, 1e6, 2e5])),
    "spot at 1e6": SpotLight(
        position=torch.tensor([0.0, 1e6, 0.0]), direction=torch.tensor([0.0, -1, 0]), inner_deg=0.05, outer_deg=0.1
    ),
    "narrow": SpotLight(
        position=torch.tensor([0.6, 1.5, 0.4]), direction=torch.tensor([-6.0, -12, -4]), inner_deg=0.05, outer_deg=0.1
    ),
    "0.01 degrees": SpotLight(
        position=torch.tensor([0.6, 1.5, 0.4]), direction=torch.tensor([-6.0, -12, -4]), inner_deg=0.0, outer_deg=0.005
    ),
    "179 degrees": SpotLight(
        position=torch.tensor([0.6, 1.5, 0.4]), direction=torch.tensor([0.0, -1, 0]), outer_deg=89.5
    ),
    "with a range": PointLight(position=torch.tensor([0.6, 0.9, 0.4]), range=1.0),
    "sun at the horizon": DirectionalLight(direction=torch.tensor([-1.0, -1e-3, -0.3])),
    "sun along the floor": DirectionalLight(direction=torch.tensor([-1.0, 0.0, 0.0])),
    "occluder behind": PointLight(position=torch.tensor([0.3, 0.3, 0.0])),
}  # fmt: skip


@pytest.mark.parametrize("name", ODD)
def test_odd_lights_agree_with_rays(name: str) -> None:
    light, scene = ODD[name], on_ground(2.0)
    seen = rasterize(scene, look(96, 72))
    exact = traced_visibility(RayCaster(scene.geometry), light, seen)
    counted = seen.covered & faces(light, seen)
    for kind in FILTERS:
        found = light_visibility(scene, light, seen, ShadowOptions(filter=kind, size=256, light_width=0.02))
        assert bool(torch.isfinite(found).all()) and float(found.min()) >= 0 and float(found.max()) <= 1
        if kind in EDGES and bool(counted.any()):
            wrong = (found > 0.5) != (exact > 0.5)
            assert float(wrong[counted].double().mean()) <= 0.005, kind


def test_coincident_lights_have_the_same_shadows() -> None:
    scene, lamp = on_ground(2.0), PointLight(position=torch.tensor([1.0, 1.0, 0.4]))
    seen = rasterize(scene, look(64, 48))
    first, second = (light_visibility(scene, replace(lamp), seen) for _ in "12")
    assert torch.equal(first, second) and 0.05 < float(first.mean()) < 0.999


def test_corners_of_a_room_are_lit_up_to_the_edge() -> None:
    """A lamp in a closed room: no wall has a dark pixel, not along its inner edges either."""
    room = Scene(meshes=(box((-2.0, 0.0, -2.0), (2.0, 3.0, 2.0)),))
    view = Cameras.look_at((0.0, 1.5, 1.9), (0.3, 1.0, -2.0), width=200, height=160, fov_deg=110.0)
    seen = rasterize(room, view)
    for x in (0.3, -1.1, 1.7):
        lamp = PointLight(position=torch.tensor([x, 1.7, -0.2]))
        for kind in EDGES:
            found = light_visibility(room, lamp, seen, ShadowOptions(filter=kind, size=256))
            assert int((found < 0.5)[seen.covered].sum()) == 0, kind


def test_light_reaches_as_far_as_its_range_and_no_farther() -> None:
    """Lists, shading and shadows of a light with a range; another that ends before the floor changes nothing."""
    lamp, short = ODD["with a range"], PointLight(position=torch.tensor([-1.0, 0.8, -1.0]), range=0.7)
    scene = replace(on_ground(2.0), lights=(lamp,), ambient=torch.zeros(3))
    image, more = (render(s, look(96, 72)).radiance for s in (scene, replace(scene, lights=(lamp, short))))
    assert torch.equal(image, more)
    seen = rasterize(scene, look(96, 72))
    away = (seen.position - lamp.position).norm(dim=-1)
    lit = (away < 0.98) & faces(lamp, seen) & (traced_visibility(RayCaster(scene.geometry), lamp, seen) > 0.5)
    lit, beyond = lit & seen.covered, seen.covered & (away > 1.0 + 1e-6)
    assert int(lit.sum()) > 100 and int(beyond.sum()) > 100
    assert bool((image.amax(dim=-1)[lit] > 0).all()) and float(image[beyond].abs().max()) == 0


def test_a_beam_of_a_hundredth_of_a_degree_lights_its_spot() -> None:
    """Cosines of float32 cannot tell such an angle; its light is still as strong in the middle as a point light's."""
    up = torch.tensor([0.3, 1e4, -0.2])
    beam = SpotLight(position=up, direction=torch.tensor([0.0, -1.0, 0.0]), inner_deg=0.0, outer_deg=0.005)
    bright = replace(beam, intensity=torch.full((3,), 1e8))
    scene = Scene(meshes=(floor(2.0),), lights=(bright,))
    view = Cameras.look_at((0.3, 4.0, -0.1), (0.3, 0.0, -0.2), width=61, height=61, fov_deg=40.0)
    plain, fused = (shade(replace(scene, lights=(light,)), rasterize(scene, view)) for light in (
        PointLight(position=up, intensity=bright.intensity), bright))  # fmt: skip
    seen = rasterize(scene, view)
    angle = ((seen.position[..., [0, 2]] - up[[0, 2]]).norm(dim=-1) / 1e4).rad2deg()
    share = bright.cone(angle.double().deg2rad().cos())
    wanted = plain[..., 0] * share
    assert 0.1 < float((share > 0).double().mean()) < 0.9
    assert float((fused[..., 0] - wanted).abs()[seen.covered].max()) < 0.02 * float(plain.max())
    assert bool(light_reach(scene, seen).any.all())


def test_receivers_parallel_to_the_light_and_leaves_with_holes() -> None:
    """Light along a wall gives it nothing, and no value in between; a leaf shadows from both sides, holes do not."""
    wall = quad((0.0, 0.0, -2.0), (0.0, 0.0, 4.0), (0.0, 2.0, 0.0))
    scene = Scene(meshes=(floor(2.0), wall))
    down = DirectionalLight(direction=torch.tensor([0.0, -1.0, 0.0]))
    seen = rasterize(scene, Cameras.look_at((3.0, 2.0, 2.0), (0.0, 0.5, 0.0), width=80, height=60))
    found = light_visibility(scene, down, seen)
    assert bool((found[seen.object_id == 1] == 0).all()) and float(found[seen.object_id == 0].min()) == 1.0
    leaf = Mesh(vertices=POST.vertices[:3] + torch.tensor([0.0, 0.5, 0.0]), faces=torch.tensor([[0, 1, 2], [0, 2, 1]]))
    both = Scene(meshes=(floor(2.0), leaf))
    seen = rasterize(both, look(96, 72))
    wanted = traced_visibility(RayCaster(both.geometry), SUN, seen)
    lost, false = shares(light_visibility(both, SUN, seen), wanted, seen.covered & faces(SUN, seen))
    assert lost == 0 and false == 0


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_leaves_with_holes_shadow_by_what_is_left_of_them(side: float) -> None:
    """A cut-out sheet, seen by the light from either side: solid texels shadow, missing ones do not."""
    texture = torch.zeros(8, 8, 4)
    texture[..., 3] = ((torch.arange(8)[:, None] // 2 + torch.arange(8) // 2) % 2).float()
    leaf = replace(
        quad((-0.5, 0.7, 0.5 * side), (1.0, 0, 0), (0, 0, -side)),
        uv=torch.tensor([[0.0, 0], [1, 0], [1, 1], [0, 1]]),
        material=1,
    )
    materials = (Material(), Material(name="leaf", diffuse_texture=texture, alpha_cutoff=0.5))
    scene = Scene(meshes=(floor(2.0), leaf), materials=materials, lights=(SUN,))
    seen = rasterize(scene, look(120, 90))
    exact = traced_visibility(RayCaster(scene.geometry), SUN, seen)
    ground = seen.covered & (seen.object_id == 0)
    solid = replace(scene, materials=(Material(), Material(name="sheet")))
    whole = traced_visibility(RayCaster(solid.geometry), SUN, rasterize(solid, look(120, 90)))
    both = ground & (rasterize(solid, look(120, 90)).object_id == 0)
    dark, all_dark = int((exact < 0.5)[both].sum()), int((whole < 0.5)[both].sum())
    assert all_dark > 300 and 0.35 < dark / all_dark < 0.65
    for kind in EDGES:
        lost, false = shares(light_visibility(scene, SUN, seen, ShadowOptions(filter=kind, size=512)), exact, ground)
        assert lost <= 0.02 and false <= 0.003, kind


@pytest.mark.parametrize("half", [2.0, 2000.0])
def test_area_lights_keep_contact_on_any_ground(half: float) -> None:
    """Where float32 is too coarse for the whole scene, packets of our own tree answer."""
    light = RectLight(
        corner=torch.tensor([0.8, 1.5, 0.2]), edge_u=torch.tensor([0.0, 0, -0.4]), edge_v=torch.tensor([-0.4, 0, 0.0])
    )
    light = replace(light, edge_u=light.edge_v, edge_v=light.edge_u) if float(light.normal[1]) > 0 else light
    scene = Scene(meshes=(POST, floor(half)))
    seen = rasterize(scene, look(80, 60))
    exact = traced_visibility(RayCaster(scene.geometry), light, seen, samples=8)
    found = soft_shadow(scene.geometry, light, seen, SoftShadowOptions(light_samples=8)).visibility[:, 0]
    assert float((found - exact)[seen.covered].abs().mean()) * 255 < 0.5
    assert 0.02 < float((exact < 0.5)[seen.covered].double().mean()) < 0.5
