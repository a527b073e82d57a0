"""The shading kernel against its twin in torch, pixel by pixel, for everything that a material can have."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
import torch
from torch import Tensor

from shading_scenes import LAMP, LIGHTS, PANEL, SUN, as_codes, noise, scene_of_all, views
from torchrender.buffers import RaySurface
from torchrender.kernels.compile import kernel
from torchrender.kernels.shading import (
    gather,
    layers,
    lights,
    lobes,
    maps,
    needs,
    parts,
    rectangles,
    shade,
    simd,
    sky,
    spread,
)
from torchrender.kernels.shading.pack import pack_planes
from torchrender.kernels.shading.records import CHANNEL, MATERIAL, MOST_KINDS, SLOT, SLOTS, SPAN, TILE, Work
from torchrender.numerics.ggx import dielectric_fresnel
from torchrender.pipeline.options import RenderOptions
from torchrender.raster import rasterize, rasterize_visibility, surface_attributes
from torchrender.rays import RayCaster
from torchrender.renderer import render
from torchrender.scene.camera import Cameras
from torchrender.scene.material import TEXTURES, Material
from torchrender.scene.mesh import Mesh
from torchrender.scene.model import Scene
from torchrender.shading.fused import send_fused
from torchrender.shading.lobes import Around, Sent
from torchrender.shading.plain import send
from torchrender.shading.ray_surface import ray_surface

EXACT = 1e-4


def different(found: Tensor, wanted: Tensor) -> Tensor:
    """Relative differences (N,), at least of a thousandth."""
    return ((found - wanted).abs() / wanted.abs().clamp_min(1e-3)).amax(0)


def check(found: Sent, wanted: Sent, covered: Tensor) -> None:
    for name in ("radiance", "replaced", "mirrored"):
        a, b = getattr(found, name)[:, covered], getattr(wanted, name)[:, covered]
        assert bool(torch.isfinite(a).all()), name
        error = different(a, b)
        # Texels and mip levels change by steps: a coordinate on an edge may fall on either side.
        assert float((error > EXACT).float().mean()) <= 2e-3, (name, float(error.max()))


def factors(scene: Scene, count: int) -> Tensor:
    generator = torch.Generator().manual_seed(0)
    return (torch.rand(len(scene.lights), count, generator=generator) * 3 - 1).clamp(0, 1)


def test_all_textures_of_materials_are_among_those_that_are_compared() -> None:
    """The kernel once knew nothing of ``transmission_texture``: what it let pass was missing from pictures."""
    used = {name for name in TEXTURES for material in scene_of_all().materials if getattr(material, name) is not None}
    assert used == set(TEXTURES) == set(CHANNEL)


def test_where_the_texture_lets_nothing_pass_a_surface_is_as_without() -> None:
    closed = Material(metallic=0.0, roughness=0.6, transmission=1.0, transmission_texture=torch.zeros(2, 2, 1))
    open_ = replace(closed, transmission=0.0, transmission_texture=None)
    options = RenderOptions(ambient_visibility="off", shadows=False)  # what passes light hides nothing there
    scenes = [scene_of_all(LAMP).replace(materials=[one] * 8) for one in (closed, open_)]
    pictures = [render(scene, views(), options=options).radiance for scene in scenes]
    assert float(pictures[1].mean()) > 0.05
    torch.testing.assert_close(*pictures, rtol=1e-5, atol=1e-5)


@pytest.mark.parametrize("coded", [True, False])
@pytest.mark.parametrize("environment", [True, False])
@pytest.mark.parametrize("orthographic", [True, False])
def test_images_against_torch(environment: bool, orthographic: bool, coded: bool) -> None:
    scene = scene_of_all(*LIGHTS, environment=environment)
    scene = as_codes(scene) if coded else scene
    all_of_it = replace(scene.geometry, see_through=None)  # what shows what lies behind, too
    seen = rasterize_visibility(all_of_it, views(count=2, orthographic=orthographic))
    gbuffer = surface_attributes(scene, seen)
    shadow = factors(scene, seen.triangle.numel())
    covered = gbuffer.covered.reshape(-1)
    assert set(gbuffer.material[gbuffer.covered].tolist()) == set(range(len(scene.materials)))
    found = send_fused(scene, seen, shadow, Around(), ("polygon", None, True))
    check(found, send(scene, gbuffer, shadow, Around(), "polygon"), covered)


def test_ambient_visibility_and_bent_normals_against_torch() -> None:
    scene = scene_of_all(SUN)
    gbuffer = rasterize(scene, views())
    bent = torch.nn.functional.normalize(gbuffer.normal + torch.tensor([0.3, 0.2, -0.1]), dim=-1).reshape(-1, 3).T
    around = Around(torch.rand(bent.shape[1], generator=torch.Generator().manual_seed(1)), bent)
    found = send_fused(scene, gbuffer, None, around, ("polygon", None, True))
    check(found, send(scene, gbuffer, None, around, "polygon"), gbuffer.covered.reshape(-1))


def test_hits_of_rays_against_torch() -> None:
    scene = scene_of_all(*LIGHTS)
    origins, directions = (v.reshape(-1, 3) for v in views(40, 30).rays())
    directions = directions * (1 + torch.arange(len(directions), dtype=torch.float64)[:, None] % 3)
    hits = RayCaster(scene.geometry).first_hit(origins, directions)
    samples: RaySurface = ray_surface(scene, origins, directions, hits, 0.01).image
    shadow = factors(scene, len(origins))
    found = send_fused(scene, samples, shadow, Around(), ("centre", None, True))
    covered = samples.covered.reshape(-1)
    assert bool((found.radiance[:, ~covered] == 0).all()) and bool(covered.any())
    check(found, send(scene, samples, shadow, Around(), "centre"), covered)


def test_a_light_that_nothing_sees_and_an_empty_scene() -> None:
    scene = scene_of_all(*LIGHTS)
    seen = rasterize_visibility(scene.geometry, views(16, 12))
    none = torch.zeros(len(LIGHTS), seen.triangle.numel())
    dark = send_fused(scene, seen, none, Around(), ("polygon", None, False)).radiance
    unlit = send_fused(scene_of_all(), seen, None, Around(), ("polygon", None, False)).radiance
    torch.testing.assert_close(dark, unlit)
    nothing = Scene(ambient=torch.tensor([0.1, 0.2, 0.3]))
    empty = rasterize_visibility(nothing.geometry, views(16, 12))
    found = send_fused(nothing, empty, None, Around(), ("polygon", None, False)).radiance
    torch.testing.assert_close(found, nothing.ambient[:, None].expand(3, 16 * 12))


def strips(count: int) -> Scene:
    """Upright strips side by side, each with a material of its own, most with a texture of odd sides."""
    meshes, made = [], []
    for k in range(count):
        left, right = (2.0 * (k + e) / count - 1.0 for e in (0, 1))
        corners = torch.tensor([[left, -1.0, 0.0], [right, -1.0, 0.0], [right, 1.0, 0.0], [left, 1.0, 0.0]])
        faces = torch.tensor([[0, 1, 2], [0, 2, 3]])
        uv = torch.tensor([[0.0, 0.0], [1.0, 0.0], [1.0, 3.0], [0.0, 3.0]]) * (1 + k % 3) - 0.7
        meshes.append(Mesh(vertices=corners, faces=faces, uv=uv, material=k))
        texture = noise(23 + k, 37, 3, k) if k % 5 else None
        diffuse = torch.tensor([k / count, 0.5, 1.0 - k / count])
        if k % 2:
            made.append(Material(diffuse=diffuse, diffuse_texture=texture, roughness=0.5, metallic=0.3))
        else:
            made.append(Material(diffuse=diffuse, diffuse_texture=texture, specular=0.2 + 0.01 * k, shininess=5.0 + k))
    return Scene(meshes=tuple(meshes), materials=tuple(made), lights=(SUN, LAMP), ambient=torch.full((3,), 0.1))


@pytest.mark.parametrize("count", [MOST_KINDS // 2, MOST_KINDS, MOST_KINDS + 8])
def test_tiles_with_few_and_with_many_materials(count: int) -> None:
    scene = strips(count)
    camera = Cameras.look_at([0.3, 0.2, 2.2], [0.0, 0.0, 0.0], width=TILE[0], height=3 * TILE[1] + 1, fov_deg=5.4)
    gbuffer = rasterize(scene, camera)
    assert set(gbuffer.material[0, TILE[1] : 2 * TILE[1]].unique().tolist()) >= set(range(count))  # in one tile
    found = send_fused(scene, gbuffer, None, Around(), ("polygon", None, True))
    check(found, send(scene, gbuffer, None, Around(), "polygon"), gbuffer.covered.reshape(-1))


def test_a_turn_of_the_sky_by_a_whole_circle_changes_nothing() -> None:
    scene, camera = scene_of_all(), views(40, 30)
    assert scene.environment is not None
    made = []
    for turn in (-40.0, -400.0, 320.0):
        turned = replace(scene, environment=replace(scene.environment, rotation_deg=turn))
        seen = rasterize_visibility(turned.geometry, camera)
        made.append(send_fused(turned, seen, None, Around(), ("polygon", None, False)).radiance)
        direction = torch.nn.functional.normalize(camera.rays()[1].reshape(-1, 3), dim=-1).float()
        empty = ~seen.covered.reshape(-1)
        assert turned.environment is not None
        wanted = turned.environment.background(direction[empty])
        torch.testing.assert_close(made[-1][:, empty].T, wanted, rtol=1e-3, atol=1e-4)
    torch.testing.assert_close(made[1], made[0], rtol=1e-3, atol=1e-4)
    torch.testing.assert_close(made[2], made[0], rtol=1e-3, atol=1e-4)


@kernel()
def spread_all(mat, numbers, kinds, found, s):
    flags = np.zeros(1, np.bool_)
    work = Work(s, mat, mat, mat, mat, found, flags, mat, kinds)
    found[3] = spread.kinds_of(mat, mat.shape[0], kinds)
    spread.spread(work, mat.shape[0], 3, numbers, 2)


@pytest.mark.parametrize(("kinds", "told"), [(1, 1), (5, 5), (MOST_KINDS, MOST_KINDS), (MOST_KINDS + 1, 0)])
def test_numbers_of_materials(kinds: int, told: int) -> None:
    rng = np.random.default_rng(4)
    chosen = np.sort(rng.permutation(50)[:kinds]).astype(np.uint32)
    mat = rng.permutation(np.concatenate([chosen, rng.choice(chosen, 100)]))
    numbers = rng.integers(0, 4, (50, 3)).astype(np.float32)
    s, found, listed = np.zeros(300, np.float32), np.zeros(4, np.int64), np.zeros(MOST_KINDS, np.uint32)
    spread_all(mat, numbers, listed, found, s)
    assert found[3] == told
    np.testing.assert_array_equal(listed[:told], chosen[:told])
    np.testing.assert_array_equal(s[3 : 3 + len(mat)], numbers[mat, 2])
    assert not s[:3].any() and not s[3 + len(mat) :].any()


# ------------------------------------------------------------------- functions of numbers


@kernel()
def over(values, out):
    for i in range(values.shape[0]):
        x = values[i]
        out[i, 0] = simd.exp2(x)
        out[i, 1] = simd.log2(abs(x) + np.float32(1e-6))
        out[i, 2] = simd.angle(abs(x), np.float32(1) - x)
        out[i, 3] = simd.fifth(x)
        out[i, 4] = simd.dielectric(np.float32(1.25), min(abs(x), np.float32(1)))


def test_functions_of_numbers() -> None:
    x = np.linspace(-30, 30, 4001).astype(np.float32)
    out = np.zeros((len(x), 5), np.float32)
    over(x, out)
    wide = x.astype(np.float64)
    np.testing.assert_allclose(out[:, 0], 2.0**wide, rtol=3e-7)
    np.testing.assert_allclose(out[:, 1], np.log2(np.abs(x) + np.float32(1e-6)), atol=3e-6)
    np.testing.assert_allclose(out[:, 2], np.arctan2(np.abs(wide), 1 - wide), atol=4e-7)
    np.testing.assert_allclose(out[:, 3], (1 - wide.clip(0, 1)) ** 5, atol=1e-6)
    fresnel = dielectric_fresnel(1.25, torch.from_numpy(np.abs(wide).clip(0, 1)))
    np.testing.assert_allclose(out[:, 4], fresnel.numpy(), rtol=1e-5)
    low = np.array([-130.0, -1e9, -99.0], np.float32)
    over(low, out)
    np.testing.assert_allclose(out[:3, 0], [2.0**-100, 2.0**-100, 2.0**-99], rtol=3e-7)


@kernel()
def weigh(values, places, weights, out):
    for i in range(places.shape[0]):
        p, q = np.int64(places[i, 0]), np.int64(places[i, 1])
        out[i, 0], out[i, 1], out[i, 2], out[i, 3] = simd.weighed(values, (p, q), (weights[i, 0], weights[i, 1]))


def test_four_numbers_at_once() -> None:
    rng = np.random.default_rng(3)
    values, weights = rng.normal(size=40).astype(np.float32), rng.normal(size=(9, 2)).astype(np.float32)
    places, out = rng.integers(0, 37, (9, 2)), np.zeros((9, 4), np.float32)
    weigh(values, places, weights, out)
    for i, (p, q) in enumerate(places):
        wanted = weights[i, 0] * values[p : p + 4] + weights[i, 1] * values[q : q + 4]
        np.testing.assert_allclose(out[i], wanted, rtol=1e-6, atol=1e-6)


@kernel()
def turn(values, places, out, narrow):
    p = (places[0], places[1], places[2], places[3], places[4], places[5], places[6], places[7])
    simd.columns(values, p, out, (1, 11, 21, 31, 41, 51, 61, 71))
    simd.columns(values, p, narrow, (1, 11, 21, 31))


@pytest.mark.parametrize("kind", [np.float32, np.uint32])
def test_rows_into_columns(kind: type) -> None:
    rng = np.random.default_rng(5)
    values, places = rng.integers(1, 1 << 22, 60).astype(kind), rng.integers(0, 52, 8)
    out, narrow = np.zeros(80, kind), np.zeros(40, kind)
    turn(values, places, out, narrow)
    for made in (out, narrow):
        rows = made.reshape(-1, 10)
        for k, row in enumerate(rows):
            np.testing.assert_array_equal(row[1:9], values[places + k])
            assert row[0] == 0 and row[9] == 0


def test_planes_against_numpy() -> None:
    rng = np.random.default_rng(0)
    vertices, faces = rng.normal(size=(9, 3)), rng.permutation(9).reshape(3, 3).astype(np.int32)
    uv, second = rng.random((9, 2)).astype(np.float32), rng.random((9, 2)).astype(np.float32)
    planes, density = np.zeros((3, 4), np.float32), np.zeros(3, np.float32)
    pack_planes(vertices, faces, uv, second, planes, density)
    for t, (a, b, c) in enumerate(faces):
        cross = np.cross(vertices[b] - vertices[a], vertices[c] - vertices[a])
        area = np.linalg.norm(cross)
        np.testing.assert_allclose(planes[t, :3], cross / area, atol=1e-6)
        for coordinates, found in ((uv, planes[t, 3]), (second, density[t])):
            p, q = (coordinates[k].astype(float) - coordinates[a] for k in (b, c))
            assert found == pytest.approx(math.sqrt(abs(p[0] * q[1] - p[1] * q[0]) / area), rel=1e-5)


def test_every_module_of_the_kernel_is_used_by_it() -> None:
    used = (gather.gather, layers.add_coat, lights.rectangle, lobes.add_metallic, maps.textures, sky.diffuse)
    used = (*used, rectangles.add_metallic_rectangle, spread.spread)
    assert all(callable(one) for one in (*used, shade.shade, parts.surfaces, needs.stages_of))
    assert SLOTS * SPAN * 4 < 256 << 10 and len(set(SLOT.values())) == SLOTS and max(MATERIAL.values()) < 32
    assert noise(4, 4, 3, 0).shape == (4, 4, 3) and PANEL.area > 0
