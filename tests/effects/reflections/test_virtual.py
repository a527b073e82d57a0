"""What mirrors show as pictures of their own: mirrored points stay where they are when the eye moves."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch
from torch import Tensor

from reflection_scenes import looking, mirror_scene, placed, prepared, scene_of, sphere_scene, traced
from torchrender.buffers import ReflectionState
from torchrender.client.drawing import draw_keyframes
from torchrender.client.mirrors import draw_with_mirrors
from torchrender.effects.reflections.reflectors import reflected_rays
from torchrender.effects.reflections.virtual import virtual_images
from torchrender.image import Image
from torchrender.passes.light.direct_light import MIRROR_SHARE
from torchrender.pipeline.options import RenderOptions
from torchrender.rays import RayCaster
from torchrender.renderer import render
from torchrender.scene.camera import Cameras
from torchrender.scene.light import PointLight
from torchrender.scene.material import Material
from torchrender.scene.model import Scene
from torchrender.scene.shapes import box, sphere
from torchrender.wire.containers import KeyframeImage, read_container
from torchrender_service.renderers.keyframes import Stamp, first_message, mirror_message
from torchrender_service.renderers.streaming.layers import MIRRORS_NEED, mirror_layer

OPTIONS = RenderOptions(reflections="traced", shadows=False, ambient_visibility="off", buffers=MIRRORS_NEED)


def stepped(camera: Cameras, step: float) -> Cameras:
    """The camera moved to its right."""
    matrix = camera.camera_from_world.clone()
    matrix[:, 0, 3] -= step
    return replace(camera, camera_from_world=matrix)


def virtual_points(scene: Scene, camera: Cameras) -> tuple[Tensor, Tensor, Tensor]:
    """Of each mirror pixel: its virtual point, the point that it mirrors, and which pixels these are."""
    gbuffer, pixels, _ = prepared(scene, camera)
    made = virtual_images(scene, gbuffer, traced(scene, camera))
    near = made.known.reshape(-1)[pixels.pixel] & torch.isfinite(made.depth.reshape(-1)[pixels.pixel])
    part = pixels.select(near)
    along = made.depth.reshape(-1)[part.pixel].double() / part.depth * part.length
    hits = reflected_rays(part).first_hits(RayCaster(scene.geometry))
    real = part.position + hits.t[:, None] * part.direction
    return camera.eye[0] + along[:, None] * part.view, real, part.pixel


def test_a_plane_mirror_shows_points_behind_it_as_far_as_they_are_before() -> None:
    seen, real, pixel = virtual_points(mirror_scene(), looking(48))
    assert len(pixel) > 500
    torch.testing.assert_close(seen, real * torch.tensor([1.0, 1.0, -1.0], dtype=torch.float64), rtol=1e-5, atol=1e-5)


def test_a_bulging_mirror_shows_them_by_the_mirror_equation() -> None:
    """Seen almost straight on: 1 / v = 1 / d + 2 / R."""
    scene = sphere_scene()
    camera = Cameras.look_at([0.0, 0.0, 2.9], [0.0, 0.0, 0.0], width=161, height=161, fov_deg=50.0)
    gbuffer, pixels, _ = prepared(scene, camera)
    layer = traced(scene, camera)
    made = virtual_images(scene, gbuffer, layer)
    middle = (0, 80, 80)
    distance, depth = float(layer.distance[middle]), float(gbuffer.depth[middle])
    wanted = depth + 1.0 / (1.0 / distance + 2.0 / 0.8)
    assert float(made.depth[middle]) == pytest.approx(wanted, rel=0.01)
    assert bool((made.known == (layer.state != ReflectionState.NONE)).all())
    assert len(pixels)


def keyframe(image: Image, camera: Cameras) -> tuple[KeyframeImage, KeyframeImage]:
    """Layer 0 and the mirrors of a picture, as a client gets them, colours without loss."""
    mirrors = mirror_layer(image, camera)
    assert mirrors is not None
    stamp = Stamp(id=0, layers=2, color="webp", quality=100)
    first = first_message(stamp, camera, image.visibility.depth[0], image.radiance[0], render_ms=0.0, plan=None)
    messages = (first, mirror_message(stamp, mirrors))
    one, two = (read_container(m, max_pixels=10**6, max_images=1)[0] for m in messages)
    return one, two


def test_a_client_moves_mirrored_points_to_where_they_are_seen() -> None:
    """After a step of 4 % of the depth: virtual points within a pixel, and a picture far better than a painted one."""
    scene, camera = mirror_scene(), looking(160)
    gbuffer, _, _ = prepared(scene, camera)
    step = 0.04 * float(gbuffer.depth[gbuffer.covered].median())
    moved = stepped(camera, step)
    seen, real, _ = virtual_points(scene, camera)
    wanted = real * torch.tensor([1.0, 1.0, -1.0], dtype=torch.float64)  # where a mirror in z = 0 shows them
    error = (moved.project(seen[None])[0] - moved.project(wanted[None])[0]).norm(dim=-1)
    assert float(error.max()) < 1.0
    image = render(scene, camera, options=OPTIONS)
    truth = render(scene, moved, options=OPTIONS).radiance[0]
    first, mirrors = keyframe(image, camera)
    ours, painted = draw_with_mirrors([first], mirrors, moved), draw_keyframes([first], moved)
    mask = (prepared(scene, moved)[0].material == 0) & ours.valid
    errors = [float((made.color[0] - truth).abs()[mask[0]].mean()) for made in (ours, painted)]
    assert errors[0] < 0.35 * errors[1]
    still = draw_with_mirrors([first], mirrors, camera)
    assert float((still.color[0] - image.radiance[0].clamp(0, 1)).abs()[still.valid[0]].mean()) < 0.01


def mirrored_place(eye: Tensor, seen: Tensor, start: Tensor, radius: float) -> Tensor:
    """Points (N,3) of a ball about the origin at which an eye sees points (N,3) mirrored, searched from (N,3)."""
    normal = torch.nn.functional.normalize(start, dim=-1)
    for _ in range(200):
        place = radius * normal
        ways = [torch.nn.functional.normalize(other - place, dim=-1) for other in (eye, seen)]
        half = torch.nn.functional.normalize(ways[0] + ways[1], dim=-1)
        normal = torch.nn.functional.normalize(0.7 * normal + 0.3 * half, dim=-1)
    return radius * normal


def chrome_ball() -> Scene:
    ball = placed(sphere(0.8, 64), (0.0, 0.0, 0.0), 3)
    return scene_of(ball, *sphere_scene().meshes[1:])


def test_a_chrome_ball_shows_points_within_a_pixel_of_where_they_are_seen() -> None:
    """A bent mirror shows a point at two places, as the eye steps sideways or up: what is warped lies between them."""
    scene, camera = chrome_ball(), looking(160)
    moved = stepped(camera, 0.08)  # 4 % of the depth
    seen, real, pixel = virtual_points(scene, camera)
    surface = prepared(scene, camera)[0].position.reshape(-1, 3)[pixel]
    places = [mirrored_place(c.eye[0], real, surface, 0.8) for c in (camera, moved)]
    truth = [c.project(p[None])[0] for c, p in zip((camera, moved), places)]
    found = [c.project(seen[None])[0] for c in (camera, moved)]
    cosine = (torch.nn.functional.normalize(camera.eye[0] - surface, dim=-1) * surface / 0.8).sum(-1)
    error = ((found[1] - found[0]) - (truth[1] - truth[0])).norm(dim=-1).reshape(-1)
    assert float(error[cosine > 0.2].max()) < 1.0  # all but a rim of 2 % of the radius
    assert float((error < 1.0).double().mean()) > 0.96
    rim = (cosine > 0.1) & (cosine <= 0.2)  # what the page on reuse says of it
    assert int(rim.sum()) > 100 and float(error[rim].max()) < 1.5


def test_a_chrome_ball_moves_its_picture_as_it_should() -> None:
    scene, camera = chrome_ball(), looking(160)
    moved = stepped(camera, 0.08)
    image = render(scene, camera, options=OPTIONS)
    truth = render(scene, moved, options=OPTIONS).radiance[0].clamp(0, 1)
    first, mirrors = keyframe(image, camera)
    gbuffer = prepared(scene, moved)[0]
    facing = (gbuffer.normal * torch.nn.functional.normalize(moved.eye[0] - gbuffer.position, dim=-1)).sum(-1)
    mask = ((gbuffer.material == 3) & (facing > 0.3))[0]
    errors = [
        float((made.color[0].clamp(0, 1) - truth).abs()[mask & made.valid[0]].mean())
        for made in (draw_with_mirrors([first], mirrors, moved), draw_keyframes([first], moved))
    ]
    assert errors[0] < 0.5 * errors[1]


def test_a_bulging_mirror_shows_the_sky_at_its_focus_and_a_hollow_one_nothing_that_stands_still() -> None:
    """What is infinitely far is seen half a radius behind a ball, whatever moves; past its focus a hollow one flips."""
    ball = scene_of(placed(sphere(0.8, 64), (0.0, 0.0, 0.0), 3))
    camera = Cameras.look_at([0.0, 0.0, 2.9], [0.0, 0.0, 0.0], width=161, height=161, fov_deg=50.0)
    gbuffer = prepared(ball, camera)[0]
    made = virtual_images(ball, gbuffer, traced(ball, camera))
    middle = (0, 80, 80)
    assert float(made.depth[middle]) == pytest.approx(float(gbuffer.depth[middle]) + 0.4, rel=0.01)
    hollow = placed(sphere(2.0, 64), (0.0, 0.0, 0.0), 3)
    assert hollow.normals is not None
    room = scene_of(replace(hollow, faces=hollow.faces.flip(1), normals=-hollow.normals))
    inside = Cameras.look_at([0.0, 0.3, 0.5], [0.0, 0.0, -2.0], width=81, height=81, fov_deg=40.0)
    seen = virtual_images(room, prepared(room, inside)[0], traced(room, inside))
    assert not bool(seen.known[:, 10:70, 10:70].any())


def test_flat_sides_stay_flat_beside_an_edge() -> None:
    """A chrome block: two sides that meet are no bend, so each is a plane mirror up to its last pixel."""
    block = placed(box(torch.tensor([1.0, 1.0, 1.0])), (0.0, 0.0, 0.0), 3)
    scene = scene_of(block, *sphere_scene().meshes[2:])
    camera = Cameras.look_at([1.6, 0.3, 2.0], [0.0, 0.0, 0.0], width=96, height=96, fov_deg=45.0)
    gbuffer, layer = prepared(scene, camera)[0], traced(scene, camera)
    made = virtual_images(scene, gbuffer, layer)
    mirrors = layer.state == ReflectionState.TRACED
    length = (gbuffer.position - camera.eye[0]).norm(dim=-1)
    wanted = gbuffer.depth * ((length + layer.distance) / length).float()
    assert int(mirrors.sum()) > 500 and bool(made.known[mirrors].all())
    torch.testing.assert_close(made.depth[mirrors], wanted[mirrors], rtol=1e-3, atol=0)


def test_what_a_painted_metal_mirrors_has_the_colour_of_its_paint() -> None:
    """The mirrored part of a picture is what the picture holds of it, where materials vary over the surface: a teal
    helmet is teal also when its light is carried to another view."""
    teal = torch.tensor([[[0.05, 0.5, 0.5], [0.5, 0.3, 0.05]]])
    metal = torch.tensor([[[0.0, 0.3, 1.0], [0.0, 0.5, 0.6]]])
    ball = sphere(0.8, 64)
    uv = torch.rand(len(ball.vertices), 2, generator=torch.Generator().manual_seed(1))
    paint = Material(
        diffuse=torch.ones(3), metallic=1.0, roughness=1.0, diffuse_texture=teal, metallic_roughness_texture=metal
    )
    scene = Scene(
        meshes=[replace(ball, uv=uv, material=0)],
        materials=[paint],
        lights=[PointLight(position=torch.tensor([2.0, 3.0, 4.0]), intensity=torch.full((3,), 30.0))],
        ambient=torch.full((3,), 0.7),
    )
    camera = Cameras.look_at([0.0, 0.5, 2.9], [0.0, 0.0, 0.0], width=64, height=64, fov_deg=50.0)
    made = render(scene, camera, options=replace(OPTIONS, buffers=(*MIRRORS_NEED, MIRROR_SHARE.name)))
    layer = mirror_layer(made, camera)
    assert layer is not None and int(layer.known.sum()) > 300
    matte = made.radiance[0] - layer.radiance
    assert float(matte[layer.known].min()) > -1e-5, "no more of it than there is"
    share = made.buffers[MIRROR_SHARE.name]
    direct = render(scene, camera, options=replace(OPTIONS, reflections="off", buffers=())).radiance[0]
    torch.testing.assert_close(matte[layer.known], (direct - share.replaced[0])[layer.known], rtol=1e-4, atol=1e-5)
