"""Soft shadows: closed forms, agreement of engines, skipping, several lights and pictures, errors."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch
from torch import Tensor

from shadow_scenes import box, flat_image, floor, quad
from torchrender.buffers import GBuffer
from torchrender.effects.shadows.soft_shadow import (
    SoftShadowOptions,
    count_bits,
    join,
    occluders,
    soft_shadow,
)
from torchrender.effects.shadows.traced import traced_visibility
from torchrender.errors import InputError, OptionError
from torchrender.raster import rasterize
from torchrender.rays import RayCaster
from torchrender.scene.camera import Cameras
from torchrender.scene.light import RectLight
from torchrender.scene.material import Material
from torchrender.scene.mesh import concatenate
from torchrender.scene.model import Scene
from torchrender.scene.shapes import sphere

EXACT = SoftShadowOptions(engine="packets", umbra_probes=0, skip_lit=False)


def square_light(side: float = 2.0, height: float = 6.0, x: float = 0.0, name: str = "area") -> RectLight:
    return RectLight(
        corner=torch.tensor([x - side / 2, height, -side / 2]),
        edge_u=torch.tensor([side, 0.0, 0.0]),
        edge_v=torch.tensor([0.0, 0.0, side]),
        name=name,
    )


@pytest.fixture(scope="module")
def table() -> tuple[Scene, Cameras]:
    ball = sphere(0.6)
    ball = type(ball)(vertices=ball.vertices + torch.tensor([1.2, 0.7, 0.3]), faces=ball.faces, name="ball")
    scene = Scene(meshes=(floor(), box((-1.5, 0.0, -0.8), (-0.4, 1.0, 0.6)), ball))
    return scene, Cameras.look_at((0.0, 5.0, 6.0), (0.0, 0.3, 0.0), width=72, height=56, fov_deg=50.0)


def test_half_plane_has_the_analytic_penumbra() -> None:
    """Below the edge of a half plane at height h, the visible share of a light of side w at height H is linear."""
    side, height, edge = 2.0, 6.0, 2.0
    scene = Scene(meshes=(floor(), quad((-40.0, edge, 40.0), (40.0, 0.0, 0.0), (0.0, 0.0, -80.0))))
    camera = flat_image()
    buffer = rasterize(Scene(meshes=(floor(),)), camera)
    result = soft_shadow(scene.geometry, square_light(side, height), buffer, SoftShadowOptions(light_samples=32))
    x = buffer.position[0, :, 100, 0]  # this camera has x along its rows
    # The point (x, 0) sees the light's point a through the edge's plane at x + (a - x) edge / height > 0.
    first_seen = x * (1.0 - height / edge)
    expected = ((side / 2 - first_seen) / side).clamp(0.0, 1.0)
    found = result.visibility[0, 0, :, 100].double()
    assert float((found - expected).abs().max()) <= 1.0 / 32 + 0.01
    assert bool((found[expected == 0] == 0).all()) and float(found.max()) == 1.0


@pytest.mark.parametrize("visibility", ["ray", "shadow_map"])
def test_skipping_changes_nothing(table: tuple[Scene, Cameras], visibility: str) -> None:
    scene, camera = table
    buffer = rasterize(scene, camera)
    ready = occluders(scene.geometry)
    exact = soft_shadow(
        ready,
        square_light(),
        buffer,
        SoftShadowOptions(visibility=visibility, engine="packets", umbra_probes=0, skip_lit=False),
    )
    quick = soft_shadow(ready, square_light(), buffer, SoftShadowOptions(visibility=visibility, engine="packets"))
    assert torch.equal(exact.bits, quick.bits)
    covered = buffer.covered
    shares = [float((exact.lit[:, 0][covered] == k).float().mean()) for k in (0, 256)]
    assert min(shares) > 0.01 and sum(shares) < 0.98


def test_packets_answer_as_drawn_maps_do(table: tuple[Scene, Cameras]) -> None:
    scene, camera = table
    buffer = rasterize(scene, camera)
    options = {"visibility": "shadow_map", "light_samples": 4, "map_size": 256}
    drawn = soft_shadow(scene.geometry, square_light(), buffer, SoftShadowOptions(engine="maps", **options))
    traced = soft_shadow(scene.geometry, square_light(), buffer, SoftShadowOptions(**options))
    differing = int(count_bits(drawn.bits ^ traced.bits).sum())
    assert differing <= 1e-4 * 16 * buffer.covered.numel()
    assert drawn.outside == traced.outside == (0,)


def test_rays_answer_as_the_ray_caster_does(table: tuple[Scene, Cameras]) -> None:
    scene, camera = table
    buffer = rasterize(scene, camera)
    light = square_light()
    options = SoftShadowOptions(engine="packets", light_samples=4, slope_bias=0.0, constant_bias=1e-3)
    result = soft_shadow(scene.geometry, light, buffer, options)
    points, normals = buffer.position[buffer.covered], buffer.geometric_normal[buffer.covered].double()
    caster = RayCaster(scene.geometry)
    expected = torch.zeros(len(points), dtype=torch.int32)
    for sample in light.samples(4).double():
        toward = sample - points
        blocked = caster.occluded(points, toward, t_min=1e-3, t_max=1.0)
        expected += (~blocked & ((toward * normals).sum(-1) > 0)).int()
    assert torch.equal(result.lit[:, 0][buffer.covered], expected)


def test_lights_and_pictures_are_independent(table: tuple[Scene, Cameras]) -> None:
    scene, camera = table
    other = Cameras.look_at((4.0, 3.0, -5.0), (0.0, 0.3, 0.0), width=72, height=56, fov_deg=50.0)
    lights = [square_light(), square_light(1.0, 4.0, 2.5, "second")]
    options = SoftShadowOptions(light_samples=8)
    together = soft_shadow(
        scene.geometry, lights, rasterize(scene, Cameras.cat([camera, other])), options, bounds=scene.bounds
    )
    assert together.lit.shape == (2, 2, 56, 72) and together.visibility.dtype == torch.float32
    for b, one in enumerate((camera, other)):
        for k, light in enumerate(lights):
            alone = soft_shadow(scene.geometry, light, rasterize(scene, one), options, bounds=scene.bounds)
            assert torch.equal(alone.lit[0, 0], together.lit[b, k])
    assert torch.equal(together.visibility, together.lit / together.above.clamp_min(1))
    assert int(together.above.min()) > 0 or bool((together.visibility[together.above == 0] == 0).all())
    assert torch.equal(count_bits(together.bits[:, 0]), together.lit[:, 0])


def test_several_geometries_shadow_like_one(table: tuple[Scene, Cameras]) -> None:
    scene, camera = table
    parts = [concatenate([mesh]) for mesh in scene.meshes]
    joined = join(parts)
    assert torch.equal(joined.faces, scene.geometry.faces) and torch.equal(joined.runs, scene.geometry.runs)
    buffer = rasterize(scene, camera)
    whole = soft_shadow(scene.geometry, square_light(), buffer, EXACT)
    assert torch.equal(soft_shadow(parts, square_light(), buffer, EXACT).bits, whole.bits)


def test_no_occluders_and_empty_pixels_are_lit() -> None:
    empty = rasterize(Scene(), flat_image(20, 16))
    seen = soft_shadow(join([]), square_light(), empty)
    assert bool((seen.lit == 256).all()) and bool((seen.visibility == 1).all())
    lone = rasterize(Scene(meshes=(floor(),)), flat_image(20, 16))
    assert bool((soft_shadow(join([]), square_light(), lone).visibility == 1).all())


def test_cost_of_lit_pixels_is_a_small_share() -> None:
    """A floor below nothing but a far-off box: groups are found clear without tracing a ray."""
    import time

    scene = Scene(
        meshes=(floor(40.0), *(box((x, 1.0, z), (x + 0.2, 1.1, z + 0.2)) for x in range(-3, 3) for z in (0, 1)))
    )
    ready = occluders(scene.geometry)
    light = square_light(1.0)

    def cost(place: tuple[float, float], options: SoftShadowOptions) -> float:
        view = Cameras.look_at(
            (place[0], 9.0, place[1]), (place[0], 0.0, place[1] - 1e-3), width=200, height=200, fov_deg=20.0
        )
        buffer = rasterize(Scene(meshes=(floor(40.0),)), view)
        best = float("inf")
        for _ in range(3):
            start = time.perf_counter()
            soft_shadow(ready, light, buffer, options, bounds=scene.bounds)
            best = min(best, time.perf_counter() - start)
        return best

    assert cost((25.0, 25.0), SoftShadowOptions(engine="packets")) < 0.6 * cost((25.0, 25.0), EXACT)


@pytest.mark.parametrize("engine", ["rays", "packets"])
def test_samples_below_a_surface_are_left_out(engine: str) -> None:
    """A wall that sees half of the light, with nothing before it, sees all of what sends it light."""
    wall = quad((1.0, 0.0, 2.0), (0.0, 0.0, -4.0), (0.0, 3.0, 0.0), "wall")  # faces -x; the light is 2 wide around 0
    scene = Scene(meshes=(wall,))
    camera = Cameras.look_at((-4.0, 2.0, 0.0), (1.0, 1.5, 0.0), width=40, height=40, fov_deg=40.0)
    buffer = rasterize(scene, camera)
    light = square_light(2.0, 6.0, x=1.0)
    found = soft_shadow(scene.geometry, light, buffer, SoftShadowOptions(engine=engine))
    covered = buffer.covered
    assert bool((found.above[:, 0][covered] == 128).all()) and bool((found.lit[:, 0][covered] == 128).all())
    assert bool((found.visibility[:, 0][covered] == 1).all())
    traced = traced_visibility(RayCaster(scene.geometry), light, buffer, samples=16)
    assert bool((traced[covered] == 1).all())


def test_rays_agree_with_traced_light_samples(table: tuple[Scene, Cameras]) -> None:
    """Traced one by one or refined; in penumbrae also against 4,096 rays."""
    scene, camera = table
    buffer = rasterize(scene, camera)
    light, caster = square_light(), RayCaster(scene.geometry)
    traced = traced_visibility(caster, light, buffer, samples=16)
    penumbra = buffer.covered & (traced > 0.01) & (traced < 0.99)
    assert int(penumbra.sum()) > 60
    many = traced_visibility(caster, light, only(buffer, penumbra), samples=64)
    for refine in (1, 2):
        options = SoftShadowOptions(engine="rays", refine=refine)
        found = soft_shadow(scene.geometry, light, buffer, options).visibility[:, 0]
        wrong = (found - traced)[buffer.covered].abs()
        assert float(wrong.mean()) * 255 < (0.05 if refine == 1 else 0.5)
        assert float((found - many)[penumbra].abs().mean()) * 255 < 1.0


def only(buffer: GBuffer, kept: Tensor) -> GBuffer:
    """The same picture with fewer pixels that show something."""
    return replace(buffer, triangle=torch.where(kept, buffer.triangle, -1))


def test_holes_let_light_through_rays() -> None:
    """A sheet with a checkerboard of holes: about half of the light arrives below it."""
    texture = torch.ones(2, 2, 4)
    texture[0, 0, 3] = texture[1, 1, 3] = 0.0
    sheet = replace(quad((-2.0, 2.0, 2.0), (4.0, 0, 0), (0, 0, -4.0), "sheet"), material=1,
                    uv=torch.tensor([[0.0, 0], [8, 0], [8, 8], [0, 8]]))  # fmt: skip
    materials = (Material(name="plain"), Material(name="holes", diffuse_texture=texture, alpha_cutoff=0.5))
    scene = Scene(meshes=(floor(), sheet), materials=materials)
    buffer = rasterize(Scene(meshes=(floor(),)), flat_image(30, 24))
    inner = buffer.covered & (buffer.position[..., (0, 2)].abs().amax(-1) < 0.8)
    found = soft_shadow(scene.geometry, square_light(2.0, 6.0), buffer, SoftShadowOptions(engine="rays")).visibility
    traced = traced_visibility(RayCaster(scene.geometry), square_light(2.0, 6.0), buffer, samples=16)
    assert 0.4 < float(found[:, 0][inner].mean()) < 0.6
    assert float((found[:, 0] - traced)[inner].abs().mean()) < 0.02


@pytest.mark.parametrize(
    "wrong",
    [
        {"light_samples": 0},
        {"visibility": "x"},
        {"engine": "maps"},
        {"map_size": 2},
        {"constant_bias": -1.0},
        {"refine": 0},
        {"occluders": "mesh"},
        {"engine": "rays", "visibility": "shadow_map"},
    ],
)
def test_options_name_what_is_wrong(wrong: dict) -> None:
    with pytest.raises(OptionError, match=next(iter(wrong))):
        SoftShadowOptions(**wrong)


def test_no_light_is_an_error(table: tuple[Scene, Cameras]) -> None:
    scene, camera = table
    with pytest.raises(InputError, match="lights"):
        soft_shadow(scene.geometry, [], rasterize(scene, camera))
