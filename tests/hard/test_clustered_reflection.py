"""Clustered reflections where numbers are hard: specification 03, section 11."""

from __future__ import annotations

import warnings
from dataclasses import replace

import numpy as np
import pytest
import torch

from reflection_scenes import (
    clustered,
    looking,
    mirror_scene,
    prepared,
    rectangle,
    scene_of,
    sphere_scene,
    traced,
)
from torchrender.buffers import ReflectionState
from torchrender.effects.reflections.clustered import ClusteredReflections, clustered_reflections
from torchrender.effects.reflections.clusters.cameras import build_cluster_cameras
from torchrender.effects.reflections.clusters.grouping import cluster_pixels
from torchrender.effects.reflections.reflectors import ReflectivePixels, reflective, reflective_pixels
from torchrender.kernels.rays import depth_march
from torchrender.pipeline.options import RenderOptions
from torchrender.raster import rasterize
from torchrender.renderer import render
from torchrender.scene.camera import Cameras
from torchrender.scene.model import Scene


@pytest.fixture(autouse=True)
def no_warnings():
    with warnings.catch_warnings(), np.errstate(all="raise", under="ignore"):
        warnings.simplefilter("error")
        yield


def sound(made: ClusteredReflections) -> None:
    """Nothing is NaN; colour is finite; distance is positive or infinite."""
    layer = made.layer
    assert bool(torch.isfinite(layer.color).all())
    assert not bool(torch.isnan(layer.distance).any()) and bool((layer.distance >= 0).all())
    assert bool(torch.isfinite(layer.direction).all())


def only(pixels: ReflectivePixels, shader: object, scene: Scene, rows: list[int]) -> ClusteredReflections:
    return clustered_reflections(scene, pixels.select(torch.tensor(rows, dtype=torch.int64)), shader)  # type: ignore[arg-type]


def test_no_reflective_pixel() -> None:
    scene = mirror_scene()
    _, pixels, shader = prepared(scene, looking(24))
    made = only(pixels, shader, scene, [])
    sound(made)
    assert len(made.cameras) == 0 and not bool(made.layer.state.any())


@pytest.mark.parametrize("count", [1, 2, 3])
@pytest.mark.parametrize("builder", [mirror_scene, sphere_scene])
def test_single_pixels_and_collinear_clusters(builder, count: int) -> None:
    scene = builder()
    _, pixels, shader = prepared(scene, looking(48))
    middle = len(pixels) // 2
    made = only(pixels, shader, scene, list(range(middle, middle + count)))
    sound(made)
    assert int((made.layer.state != ReflectionState.NONE).sum()) == count


def test_every_pixel_reflects() -> None:
    scene, cameras = mirror_scene(), Cameras.look_at([0, 0, 1], [0, 0, 0], width=32, height=32)
    pixels, made = clustered(scene, cameras)
    sound(made)
    assert len(pixels) == 32 * 32


@pytest.mark.parametrize("height", [0.0, 1e-12, 1e-7, 1e-4, 1e-2])
def test_eye_in_and_near_the_mirror_plane(height: float) -> None:
    scene = mirror_scene()
    cameras = Cameras.look_at([-2.5, 0.0, height], [2.5, 0.0, height / 2], width=48, height=48, fov_deg=60.0)
    _, made = clustered(scene, cameras)
    sound(made)


def test_grazing_view_equals_rays() -> None:
    scene = mirror_scene()
    cameras = Cameras.look_at([-2.9, 0.0, 0.05], [2.0, 0.3, 0.0], width=64, height=64, fov_deg=50.0)
    _, made = clustered(scene, cameras)
    reference = traced(scene, cameras)
    sound(made)
    different = (made.layer.color - reference.color).abs().amax(-1) > 2e-3
    assert float(different.float().mean()) < 0.02


def test_reflector_that_touches_what_it_mirrors() -> None:
    """A floor that stands on the mirror: at the contact line reflections must meet their objects."""
    touching = rectangle([-2.0, -1.0, 0.0], [4.0, 0.0, 0.0], [0.0, 0.0, 4.0], 2)
    base = mirror_scene()
    scene = replace(base, meshes=(*base.meshes, touching))
    cameras = looking(96, (0.3, 0.4, 3.0))
    _, made = clustered(scene, cameras)
    reference = traced(scene, cameras)
    sound(made)
    mirror = reference.state != ReflectionState.NONE
    off = (made.layer.distance - reference.distance).abs() > 1e-3
    off &= torch.isfinite(reference.distance) | torch.isfinite(made.layer.distance)
    assert float(off[mirror].float().mean()) < 0.01


def test_mirrors_that_face_each_other() -> None:
    base = mirror_scene()
    scene = replace(base, meshes=(base.meshes[0], replace(base.meshes[1], material=3)))
    _, made = clustered(scene, looking(48))
    sound(made)


def test_tiles_a_hair_apart_are_one_plane_that_does_not_see_itself() -> None:
    """Heights that differ by rounding, or by less than the tolerance of planes."""
    rng = np.random.default_rng(1)
    tiles = [
        rectangle([-2.0 + i, -2.0 + j, float(rng.uniform(-2e-4, 2e-4))], [1, 0, 0], [0, 1, 0], 0)
        for i in range(4)
        for j in range(4)
    ]
    tiles = [replace(t, object_id=0) for t in tiles]
    scene = scene_of(*tiles, rectangle([3.0, -2.0, 4.0], [-4.0, 0.0, 0.0], [0.0, 4.0, 0.0], 1))
    cameras = looking(96, (-0.5, 0.3, 3.0))
    _, made = clustered(scene, cameras)
    reference = traced(scene, cameras)
    assert len(made.cameras) < 16
    off = (made.layer.distance - reference.distance).abs() > 0.01
    off &= torch.isfinite(reference.distance) | torch.isfinite(made.layer.distance)
    assert float(off.float().mean()) < 0.01


def test_parallel_planes_of_one_object_are_split() -> None:
    planes = [replace(rectangle([-2.0 + 2 * i, -2.0, -0.5 * i], [2, 0, 0], [0, 4, 0], 0), object_id=0) for i in (0, 1)]
    scene = scene_of(*planes, rectangle([3.0, -2.0, 4.0], [-4.0, 0.0, 0.0], [0.0, 4.0, 0.0], 1))
    _, pixels, _ = prepared(scene, looking(64))
    bins = cluster_pixels(pixels, scene.diagonal)  # planes not looked for
    assert len(bins) == 1
    made = build_cluster_cameras(pixels, bins, scene.diagonal)
    assert len(made) == 2 and bool(made.planar.all())


def test_hollow_mirrors_split_and_stay_finite() -> None:
    """Inside of a sphere, the eye beyond its focus: the bundle crosses before the mirror."""
    ball = sphere_scene()
    inside = replace(
        ball.meshes[0],
        faces=ball.meshes[0].faces.flip(1),
        normals=None if ball.meshes[0].normals is None else -ball.meshes[0].normals,
    )
    scene = scene_of(inside, ball.meshes[1])
    eye = Cameras.look_at([0.0, 0.0, 0.6], [0.0, 0.0, -0.8], width=32, height=32, fov_deg=60.0)
    for options in ({}, {"self_reflection": "diffuse"}, {"centre": "thesis"}):
        _, made = clustered(scene, eye, deviation_deg=20.0, image_scale=1.0, **options)
        sound(made)


@pytest.mark.parametrize("scale", [1e-3, 1e3])
def test_scale_and_place_do_not_matter(scale: float) -> None:
    offset = torch.tensor([1e4, -2e4, 3e4]) * scale
    base, cameras = sphere_scene(), looking(64)
    meshes = tuple(replace(m, vertices=(m.vertices.double() * scale + offset)) for m in base.meshes)
    scene = Scene(meshes=meshes, materials=base.materials, ambient=torch.ones(3))
    near = Cameras.look_at(
        cameras.eye[0] * scale + offset, offset.double(), width=64, height=64, fov_deg=50.0, near=0.01 * scale
    )
    _, made = clustered(scene, near)
    sound(made)
    reference = traced(scene, near)
    mirror = reference.state != ReflectionState.NONE
    close = (made.layer.distance - reference.distance).abs() <= 0.02 * reference.distance + 0.02 * scale
    assert float(close[mirror].float().mean()) > 0.95


def test_normals_that_are_not_numbers_are_left_out() -> None:
    scene, cameras = sphere_scene(), looking(48)
    gbuffer = rasterize(scene, cameras)
    normal = gbuffer.normal.clone()
    normal[:, 20:24] = float("nan")
    normal[:, 30:32] = 0.0
    broken = replace(gbuffer, normal=normal)
    mask = reflective(scene, broken)
    assert not bool(mask[:, 20:24].any()) and not bool(mask[:, 30:32].any())
    _, _, shader = prepared(scene, cameras)
    sound(clustered_reflections(scene, reflective_pixels(scene, broken), shader))


def test_batches_and_parallel_projection() -> None:
    scene = sphere_scene()
    two = Cameras.cat([looking(48), looking(48, (1.0, 0.5, 2.5))])
    options = RenderOptions(reflections="clustered")
    both = render(scene, two, options=options).radiance
    for index in range(2):
        alone = render(scene, two[index], options=options).radiance
        assert float((both[index] - alone[0]).abs().mean()) < 5e-3  # shares of the view scale the bins
    flat = replace(
        looking(48),
        orthographic=True,
        intrinsics=torch.tensor([[[20.0, 0, 24], [0, 20.0, 24], [0, 0, 1]]], dtype=torch.float64),
        far=torch.tensor([100.0]),
    )
    for made in (scene, mirror_scene()):
        _, some = clustered(made, flat)
        sound(some)
        reference = traced(made, flat)
        mirror = reference.state != ReflectionState.NONE
        assert bool(mirror.any())
        error = (some.layer.color - reference.color).abs().amax(-1)[mirror]
        assert float((error > 0.05).float().mean()) < 0.08


# ------------------------------------------------------------------- marching


def test_depth_along_the_projection_is_exact() -> None:
    rng = np.random.default_rng(5)
    for _ in range(200):
        t0, t1 = sorted(rng.uniform(0, 5, 2))
        origin, direction = rng.uniform(-1, 1, 3) + np.array([0, 0, 8]), rng.uniform(-1, 1, 3)
        a, b = origin + t0 * direction, origin + t1 * direction
        share = rng.uniform()
        z = depth_march.depth_at(1 / a[2], 1 / b[2] - 1 / a[2], share)
        t = depth_march.length_at((t0, t1, a[2], b[2]), share)
        point = origin + t * direction
        screen = (1 - share) * a[:2] / a[2] + share * b[:2] / b[2]
        assert z == pytest.approx(point[2], rel=1e-9)
        assert point[:2] / point[2] == pytest.approx(screen, rel=1e-9, abs=1e-12)
