"""Clustered reflections: the acceptance list of specification 03, section 14."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise

import pytest
import torch
from torch import Tensor

from reflection_scenes import (
    clustered,
    looking,
    mirror_scene,
    prepared,
    rectangle,
    scene_of,
    sphere_scene,
    traced,
    true_hits,
)
from torchrender.buffers import ReflectionState
from torchrender.effects.reflections.clustered import ClusterOptions, clustered_reflections
from torchrender.effects.reflections.clusters.cameras import CameraOptions, build_cluster_cameras, cluster_fit
from torchrender.effects.reflections.clusters.extents import HALF_ANGLE_DEG
from torchrender.effects.reflections.clusters.grouping import cluster_pixels, share_of_bins
from torchrender.effects.reflections.reflectors import reflective
from torchrender.errors import OptionError
from torchrender.pipeline.options import RenderOptions
from torchrender.quality.metrics import mean_absolute_error, psnr
from torchrender.renderer import render
from torchrender.report.reflections.errors import occlusion_errors
from torchrender.scene.camera import Cameras
from torchrender.scene.procedural import build


def eye(angle_deg: float, size: int = 64) -> Cameras:
    """A camera that looks at the middle of the mirror at z = 0 at this angle to its normal."""
    a = math.radians(angle_deg)
    place = [3.0 * math.sin(a), 0.2, 3.0 * math.cos(a)]
    return Cameras.look_at(place, [0.0, 0.0, 0.0], width=size, height=size, fov_deg=40.0)


# ---------------------------------------------------------------- clusters


def test_a_floor_is_one_cluster_however_its_normals_round() -> None:
    scene = mirror_scene()
    _, pixels, _ = prepared(scene, eye(20.0))
    generator = torch.Generator().manual_seed(0)
    noise = 1e-6 * torch.randn(len(pixels), 3, generator=generator, dtype=torch.float64)
    up = torch.tensor([0.0, 1.0, 0.0], dtype=torch.float64) + noise
    floor = replace(pixels, normal=torch.nn.functional.normalize(up, dim=-1))
    assert len(cluster_pixels(floor, scene.diagonal)) == 1
    assert len(cluster_pixels(pixels, scene.diagonal, plane_share=0.0)) == 1


def test_a_lone_sphere_has_at_most_65_clusters_and_keys_repeat() -> None:
    scene = sphere_scene()
    _, pixels, _ = prepared(scene, looking())
    first = cluster_pixels(pixels, scene.diagonal)
    assert 20 <= len(first) <= 65
    assert torch.equal(first.cluster, cluster_pixels(pixels, scene.diagonal).cluster)
    assert int(first.sizes.min()) > 0 and int(first.sizes.sum()) == len(pixels)
    for number in range(len(first)):  # the sort keeps each cluster together
        assert bool((first.cluster[first.members(number)] == number).all())


def test_scale_rules() -> None:
    share, visible = torch.tensor([0.25, 0.75]), torch.tensor([2, 2])
    assert torch.allclose(share_of_bins(share, visible, "sqrt_share", 1.0), share.sqrt())
    assert torch.allclose(share_of_bins(share, visible, "literal", 1.0), share / 2)
    assert torch.allclose(share_of_bins(share, visible, "mean", 1.0), torch.tensor([0.5, 1.0]))


# ----------------------------------------------------------------- cameras


@pytest.mark.parametrize("angle", [0.0, 35.0, 80.0])
def test_planar_mirrors_take_the_mirrored_eye_and_equal_rays(angle: float) -> None:
    scene, cameras = mirror_scene(), eye(angle)
    pixels, made = clustered(scene, cameras)
    views = made.cameras
    assert bool(views.planar.all()) and len(views) == 1
    assert float((views.shift - 1.0).abs().max()) == 0.0
    mirrored = cameras.eye[0] * torch.tensor([1.0, 1.0, -1.0])
    assert float((views.eye[0] - mirrored).norm()) < 1e-7 * scene.diagonal  # pixels come from float32 depth
    exact = replace(pixels, position=pixels.position * torch.tensor([1.0, 1.0, 0.0]))
    views_exact = build_cluster_cameras(exact, cluster_pixels(exact, scene.diagonal), scene.diagonal)
    assert float((views_exact.eye[0] - mirrored).norm()) < 1e-9 * scene.diagonal
    assert not bool(occlusion_errors(scene, pixels, views, true_hits(scene, pixels)).any())
    reference = traced(scene, cameras)
    difference = (made.layer.color - reference.color).abs().amax(-1)
    assert float((difference > 2e-3).float().mean()) < 0.01  # texel edges and the card's rim
    finite = torch.isfinite(reference.distance) & torch.isfinite(made.layer.distance)
    assert float((made.layer.distance - reference.distance)[finite].abs().max()) < 1e-4


def test_shift_is_the_mirror_equation() -> None:
    """A convex cap much smaller than its radius: f h = 1 / (1 / h + 2 / radius) for a far plane far away."""
    radius, h = 2.0, 3.0
    x, y = torch.meshgrid(torch.linspace(-0.125, 0.125, 21), torch.linspace(-0.125, 0.125, 21), indexing="ij")
    x, y = x.double(), y.double()
    z = (radius**2 - x**2 - y**2).sqrt() - radius
    place = torch.stack([x, y, z], -1).reshape(-1, 3)
    normal = (place + torch.tensor([0.0, 0.0, radius])) / radius
    view = torch.nn.functional.normalize(place - torch.tensor([0.0, 0.0, h]), dim=-1)
    toward = view - 2 * (view * normal).sum(-1, keepdim=True) * normal
    pixels = _bundle(place, normal, view, toward)
    clusters = cluster_pixels(pixels, 1000 * h, bins=(1, 1))
    made = build_cluster_cameras(pixels, clusters, 1000 * h, CameraOptions(centre="thesis"))
    assert float(made.shift[0] * h) == pytest.approx(1.0 / (1.0 / h + 2.0 / radius), rel=0.05)
    best = build_cluster_cameras(pixels, clusters, 1000 * h, CameraOptions(centre="least_squares"))
    assert _deviation(best.eye[0], place, toward) < 0.2 * _deviation(made.eye[0], place, toward)


def _bundle(place: Tensor, normal: Tensor, view: Tensor, toward: Tensor):
    scene = mirror_scene()
    _, some, _ = prepared(scene, looking(21))
    values = {
        "pixel": torch.arange(len(place)),
        "position": place,
        "normal": normal,
        "geometric_normal": normal,
        "view": view,
        "direction": toward,
        "gloss": torch.zeros(len(place), dtype=torch.float64),
        "object_id": torch.zeros(len(place), dtype=torch.int64),
        "depth": torch.full((len(place),), 3.0, dtype=torch.float64),
        "length": torch.full((len(place),), 3.0, dtype=torch.float64),
        "pixel_angle": torch.full((len(place),), 0.01, dtype=torch.float64),
    }
    return type(some)(shape=(1, 21, 21), cameras=looking(21, (0.0, 0.0, 3.0)), **values)


def _deviation(centre: Tensor, place: Tensor, toward: Tensor) -> float:
    line = torch.nn.functional.normalize(place - centre, dim=-1)
    return float(torch.acos((line * toward).sum(-1).clamp(-1, 1)).mean())


@pytest.mark.parametrize("aim", ["rays", "normal"])
def test_starts_and_ends_lie_in_the_image(aim: str) -> None:
    scene = sphere_scene()
    _, pixels, _ = prepared(scene, looking())
    clusters = cluster_pixels(pixels, scene.diagonal)
    made = build_cluster_cameras(pixels, clusters, scene.diagonal, CameraOptions(centre="thesis", aim=aim))
    slope = math.tan(math.radians(HALF_ANGLE_DEG))
    for number in range(len(made)):
        rows = made.clusters.members(number)
        frame = made.frame[number]
        climb = pixels.direction[rows] @ frame[3]
        height = (pixels.position[rows] - frame[0]) @ frame[3]
        t = torch.where(climb > 0, (made.reach[number] - height) / climb, scene.diagonal).clamp_max(scene.diagonal)
        ends = pixels.position[rows] + t[:, None] * pixels.direction[rows]
        seen = torch.cat([pixels.position[rows], ends]) - made.eye[number]
        look = made.look[number]
        depth = seen @ look[2]
        at = torch.stack([seen @ look[0], seen @ look[1]], -1) / depth[:, None]
        within = (depth > 0) & (at.abs() <= slope).all(-1)
        low, high = made.box[number, :2], made.box[number, 2:]
        assert bool(((at >= low - 1e-9) & (at <= high + 1e-9)).all(-1)[within].all())


# ------------------------------------------------------------------ pictures


def test_the_sphere_meets_what_rays_meet() -> None:
    scene, cameras = sphere_scene(), looking(80)
    pixels, made = clustered(scene, cameras)
    reference = traced(scene, cameras)
    mirror = reference.state != ReflectionState.NONE
    far = (made.layer.distance - reference.distance).abs() <= 0.02 * reference.distance + 0.02
    assert float(far[mirror].float().mean()) > 0.99
    error = (made.layer.color - reference.color).abs()[mirror].mean()
    assert float(error) < 9 / 255
    assert float(occlusion_errors(scene, pixels, made.cameras, true_hits(scene, pixels)).float().mean()) < 0.04


def test_more_clusters_do_not_miss_more() -> None:
    scene = sphere_scene()
    errors = []
    for m in (0.05, 0.25, 1.0):
        plain = {"camera_share": 0.0, "deviation_deg": 180.0, "layers": 1, "image_scale": 1.0}
        pixels, made = clustered(scene, looking(), bin_factor=m, **plain)
        missed = occlusion_errors(
            scene, pixels, made.cameras, true_hits(scene, pixels), ClusterOptions(bin_factor=m, **plain)
        )
        errors.append(float(missed.float().mean()))
    assert errors[0] >= errors[1] - 0.005 and errors[1] >= errors[2] - 0.005
    assert errors[0] > errors[2]


def test_rays_left_open_can_be_traced() -> None:
    scene, cameras = sphere_scene(), looking()
    few = {"bin_factor": 0.05, "deviation_deg": 180.0, "layers": 2}
    _, plain = clustered(scene, cameras, **few)
    _, hybrid = clustered(scene, cameras, **few, missing="trace", trace_below=0.0)
    reference = traced(scene, cameras)
    assert 0.01 < float(plain.unknown.mean()) < 0.95
    error = [float((x.layer.color - reference.color).abs().mean()) for x in (plain, hybrid)]
    assert error[1] < 0.6 * error[0]
    states = set(hybrid.layer.state.unique().tolist())
    assert int(ReflectionState.TRACED) in states and int(ReflectionState.DEPTH_IMAGE) in states


@pytest.mark.parametrize("name", ["living_room", "washroom"])
def test_rooms_meet_the_figures(name: str) -> None:
    scene = build(name, triangles=30000)
    pictures = {}
    for mode in ("traced", "clustered", "environment"):
        options = RenderOptions(reflections=mode, shadows=False)
        pictures[mode] = render(scene, width=160, height=160, options=options)
    image = {mode: p.radiance.clamp(0, 1) ** (1 / 2.2) for mode, p in pictures.items()}
    mask = reflective(scene, pictures["traced"].gbuffer)
    error, baseline = (
        255.0 * mean_absolute_error(image[mode], image["traced"], mask=mask) for mode in ("clustered", "environment")
    )
    assert float(error.max()) <= 9.0
    assert 2.0 * float(error.mean()) < float(baseline.mean())
    assert float(psnr(image["clustered"], image["traced"])) > 32.0  # few pixels: the study measures 512 x 512


# --------------------------------------------------------------------- gloss


def test_gloss_zero_is_the_mirror_and_small_gloss_is_near_it() -> None:
    cameras = looking()
    _, mirror = clustered(sphere_scene(), cameras)
    _, once = clustered(sphere_scene(gloss=0.0), cameras, glossy_rays=1)
    assert torch.equal(mirror.layer.color, once.layer.color)
    _, nearly = clustered(sphere_scene(gloss=1e-4), cameras)
    assert float((mirror.layer.color - nearly.layer.color).abs().mean()) < 0.01
    steps = [clustered(sphere_scene(gloss=g), cameras, fade=True, lobe="cone")[1].layer.color for g in (0.099, 0.101)]
    assert float((steps[0] - steps[1]).abs().mean()) < 0.01


def test_rough_surfaces_show_only_what_is_near() -> None:
    scene, cameras = mirror_scene(gloss=1.0), eye(20.0)
    gbuffer, pixels, shader = prepared(scene, cameras)
    direct = torch.full((*gbuffer.triangle.shape, 3), 0.37)
    made = clustered_reflections(scene, pixels, shader, ClusterOptions(fade=True, lobe="cone"), direct=direct)
    mirror = made.layer.state != ReflectionState.NONE
    assert float((made.layer.color[mirror] - 0.37).abs().max()) < 1e-6  # the card is further than the far plane


def test_fade_follows_the_height() -> None:
    cameras = eye(20.0)
    colors = []
    for z in (0.2, 0.3, 0.4, 0.5, 0.6):
        scene = scene_of(
            rectangle([-3.0, -3.0, 0.0], [6.0, 0.0, 0.0], [0.0, 6.0, 0.0], 0),
            rectangle([4.0, -4.0, z], [-3.9, 0.0, 0.0], [0.0, 8.0, 0.0], 2),
            rectangle([-4.0, -4.0, 4.0], [8.0, 0.0, 0.0], [0.0, 8.0, 0.0], 2),
            gloss=0.9,
        )
        gbuffer, pixels, shader = prepared(scene, cameras)
        black = torch.zeros(*gbuffer.triangle.shape, 3)
        made = clustered_reflections(scene, pixels, shader, ClusterOptions(fade=True, lobe="cone"), direct=black)
        colors.append(float(made.layer.color.mean()))
    assert all(a >= b - 1e-6 for a, b in pairwise(colors))


# ------------------------------------------------------------------- kernels


def test_box_of_neighbours_matches_a_loop() -> None:
    scene = sphere_scene()
    _, pixels, _ = prepared(scene, looking(48))
    clusters = cluster_pixels(pixels, scene.diagonal)
    chunks, owner = clusters.chunks()
    rays = tuple(x.numpy() for x in (pixels.position, pixels.normal, pixels.direction))
    centre = torch.zeros(len(clusters), 3, dtype=torch.float64)
    axis = torch.nn.functional.normalize(torch.ones_like(centre), dim=-1)
    out = torch.zeros(len(chunks), 4, dtype=torch.float64)
    bundle = cluster_fit.Bundle(chunks, owner, clusters.order.numpy(), *rays)
    cluster_fit.plane_spread(bundle, centre.numpy(), axis.numpy(), out.numpy())
    for row, number in enumerate(owner.tolist()):
        members = clusters.members(number)
        height = pixels.position[members] @ axis[number]
        assert float(out[row, 0]) == pytest.approx(float(height.max()))
        assert float(out[row, 1]) == pytest.approx(float((-height).max()))
        assert float(out[row, 3]) == pytest.approx(float(pixels.position[members].square().sum(-1).max()))


def test_options_name_what_is_wrong() -> None:
    for name, value in (
        ("bin_factor", 0.0),
        ("bins", (0, 8)),
        ("centre", "middle"),
        ("depth_tolerance", 1.0),
        ("missing", "guess"),
    ):
        with pytest.raises(OptionError, match=name):
            ClusterOptions(**{name: value})
    scene = mirror_scene()
    _, pixels, shader = prepared(scene, eye(0.0, 8))
    with pytest.raises(OptionError, match="caster"):
        clustered_reflections(scene, pixels, shader, ClusterOptions(missing="trace"))
