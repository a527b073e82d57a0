"""Reuse of reflections: the acceptance list of specification 04."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch
from torch import Tensor

from reuse_scenes import eye_camera, mirror_key, mirror_scene, rectangle, shell_color, views_of
from torchrender.buffers import GBuffer, ReflectionLayer, ReflectionState
from torchrender.effects.reflections.key_frame import make_key_frame, match_reflections
from torchrender.effects.reflections.moved import MovedReflections, shift_reflections, warp_to_view
from torchrender.effects.reflections.reflectors import (
    ReflectivePixels,
    blend_reflections,
    mirrored_share,
    reflective_pixels,
)
from torchrender.effects.reflections.reuse import ReuseState, reuse_reflections
from torchrender.effects.reflections.reuse_options import ReuseOptions
from torchrender.effects.reflections.traced import trace_reflections
from torchrender.errors import InputError, OptionError
from torchrender.numerics.color import srgb_from_linear
from torchrender.pipeline.options import RenderOptions
from torchrender.raster import rasterize
from torchrender.rays import RayCaster
from torchrender.report.common.hits import hit_shader
from torchrender.report.reflections.baselines import depth_reprojection, mirror_motion_vectors
from torchrender.scene.camera import Cameras
from torchrender.scene.cameras.path import built_in_path
from torchrender.scene.light import PointLight
from torchrender.scene.material import Material
from torchrender.scene.model import Scene
from torchrender.scene.procedural import build
from torchrender.shade import shade

SMOOTH = ReuseOptions(contrast=1.0)
EYE = [0.3, 0.2, 3.0]


def moved_eye(by: Tensor | list[float]) -> list[float]:
    return [a + float(b) for a, b in zip(EYE, by, strict=True)]


def pixels_of(kind: str, camera: Cameras, **options: object):
    gbuffer, layer = views_of(kind, camera, **options)
    return gbuffer, layer, reflective_pixels(mirror_scene(), gbuffer)


def interior(key, margin: int) -> Tensor:
    """Key pixels whose square neighbourhood is all reflector."""
    mask = (key.reflector >= 0).float()[:, None]
    inner = -torch.nn.functional.max_pool2d(-mask, 2 * margin + 1, 1, margin)
    return inner.reshape(-1)[key.pixel] > 0.5


@pytest.mark.parametrize("kind", ["plane", "convex", "concave"])
@pytest.mark.parametrize("shift", [0.0, 1e-9])
def test_without_motion_nothing_moves(kind: str, shift: float) -> None:
    key = mirror_key(kind, EYE, 48, rho=2.0)
    eye = key.cameras.eye + shift
    matches = match_reflections(key, eye, options=SMOOTH)
    # The concave mirror's focus is near the eye: at its rim some matches are not well defined.
    assert float(matches.valid.double().mean()) >= (1.0 if kind != "concave" or not shift else 0.98)
    assert not bool(matches.end.any())
    assert float(matches.offset[matches.valid].abs().max()) < 1e-3
    gbuffer, layer, pixels = pixels_of(kind, eye_camera(EYE, 48), rho=2.0)
    asked = []

    def trace(chosen: ReflectivePixels):
        asked.append(chosen.pixel)
        return layer

    made = reuse_reflections(pixels, gbuffer, trace, ReuseState(key), SMOOTH)
    found = made.layer.state == ReflectionState.REUSED
    assert float((made.layer.color - layer.color)[found].abs().max()) < 1 / 255
    corners = torch.zeros(key.reflector.shape, dtype=torch.bool)
    bits = key.joined[0] != 0
    for j, i in ((0, 0), (0, 1), (1, 0), (1, 1)):
        corners[0, j : j + bits.shape[0], i : i + bits.shape[1]] |= bits
    lonely = (key.reflector >= 0) & ~corners
    assert made.report.traced <= int(lonely.sum())
    assert not asked or set(asked[0].tolist()) <= set(lonely.reshape(-1).nonzero().reshape(-1).tolist())


def test_a_plane_mirror_is_matched_to_a_fraction_of_a_pixel() -> None:
    key = mirror_key("plane", EYE, 96)
    eye = torch.tensor([moved_eye([0.15, -0.05, 0.0])], dtype=torch.float64)  # 5 % of the distance
    matches = match_reflections(key, eye)
    point = key.reached[0].reshape(-1, 4)[key.pixel, :3].double() + key.cameras.eye[0]
    virtual = point * torch.tensor([1.0, 1.0, -1.0], dtype=torch.float64)
    part = -virtual[:, 2] / (eye[0, 2] - virtual[:, 2])
    exact = key.cameras.project((virtual + part[:, None] * (eye[0] - virtual))[None])[0][0]
    at = torch.stack([key.pixel % 96, key.pixel // 96], 1) + 0.5 + matches.offset.flip(1)
    chosen = matches.valid & interior(key, 6)
    assert int(chosen.sum()) > 1500
    off = (at - exact)[chosen].norm(dim=1)
    assert float((off < 1.0).double().mean()) >= 0.99
    assert float(off.median()) < 0.02


def test_a_convex_mirror_is_matched_where_the_whole_image_has_its_minimum() -> None:
    key = mirror_key("convex", EYE, 64, rho=1.0)
    eye = torch.tensor([moved_eye([0.3, -0.2, 0.1])], dtype=torch.float64)
    matches = match_reflections(key, eye, options=ReuseOptions(refine=False))
    surface = key.surface[0].reshape(-1, 8)[key.pixel].double().numpy()
    reached = key.reached[0].reshape(-1, 4)[key.pixel, :3].double().numpy()
    to_eye = (eye - key.cameras.eye)[0].numpy() - surface[:, :3]
    rng = np.random.default_rng(0)
    chosen = rng.permutation((matches.valid & interior(key, 4)).nonzero().reshape(-1).numpy())[:200]
    same, errors = 0, []
    refined = match_reflections(key, eye).offset.flip(1)
    for k in chosen:
        toward = reached[k] - surface[:, :3]
        rise = (toward * surface[:, 3:6]).sum(1, keepdims=True)
        u = 2 * rise * surface[:, 3:6] - toward
        u /= np.linalg.norm(u, axis=1, keepdims=True)
        d = np.linalg.norm(to_eye - (to_eye * u).sum(1, keepdims=True) * u, axis=1)
        d[(rise[:, 0] <= 0) | ((to_eye * surface[:, 3:6]).sum(1) <= 0)] = np.inf
        best = int(key.pixel[int(np.argmin(d))])
        own = int(key.pixel[k])
        end = matches.end[k].tolist()
        same += best == own + end[0] * 64 + end[1]
        exact = np.array([best % 64, best // 64])
        errors.append(np.linalg.norm(np.array([own % 64, own // 64]) + refined[k].numpy() - exact))
    assert len(chosen) == 200
    assert same >= 180
    assert np.mean(errors) <= 0.7


def test_start_values_shorten_the_walk() -> None:
    key = mirror_key("convex", EYE, 96, rho=2.0)
    walk = ReuseOptions(search="walk")
    start, steps, cold, changed = None, 0.0, 0.0, []
    for k in range(1, 13):
        eye = torch.tensor([moved_eye([0.05 * k, -0.03 * k, 0.0])], dtype=torch.float64)
        warm, fresh = match_reflections(key, eye, start, walk), match_reflections(key, eye, options=walk)
        start = warm.end
        steps += float(warm.steps.double().mean())
        cold += float(fresh.steps.double().mean())
        both = warm.valid & fresh.valid
        changed.append(float((warm.end != fresh.end)[both].any(1).double().mean()))
    assert cold > 3 * steps
    assert max(changed) <= 0.02


def test_both_second_warps_agree() -> None:
    key = mirror_key("convex", EYE, 64, rho=2.0)
    camera = eye_camera(moved_eye([0.15, 0.1, -0.05]), 64)
    _, layer, pixels = pixels_of("convex", camera, rho=2.0)
    moved = shift_reflections(key, match_reflections(key, camera.eye))
    reverse = warp_to_view(key, moved, pixels, SMOOTH)
    forward = warp_to_view(key, moved, pixels, ReuseOptions(contrast=1.0, second_warp="forward"))
    both = reverse.found & forward.found
    assert float(both.double().mean()) > 0.8
    difference = (reverse.color - forward.color)[both].abs().amax(1)
    assert float((difference <= 2 / 255).double().mean()) >= 0.98
    wanted = layer.color.reshape(-1, 3)[pixels.pixel]
    assert float((reverse.color - wanted)[reverse.found].abs().mean()) < 1 / 255


@pytest.mark.parametrize(("kind", "rho"), [("plane", 1.0), ("convex", 6.0), ("concave", 16.0)])
def test_reuse_is_five_times_closer_than_a_warp_by_depth(kind: str, rho: float) -> None:
    key = mirror_key(kind, EYE, 96, rho=rho)
    camera = eye_camera(moved_eye([0.2, 0.1, -0.1]), 96)
    _, layer, pixels = pixels_of(kind, camera, rho=rho)
    moved = shift_reflections(key, match_reflections(key, camera.eye))
    made, painted = warp_to_view(key, moved, pixels, SMOOTH), depth_reprojection(key, pixels)
    wanted = layer.color.reshape(-1, 3)[pixels.pixel]
    both = made.found & painted.found
    assert float(both.double().mean()) > 0.6
    own, other = ((color - wanted)[both].abs().mean() for color in (made.color, painted.color))
    assert float(other) > 5 * float(own)
    assert float(own) < 0.5 / 255
    # The distances go with the colours: reused reflections can be reused and verified.
    length = layer.distance.reshape(-1)[pixels.pixel]
    assert float(((made.distance - length).abs() / length)[made.found].median()) < 1e-3


def test_motion_vectors_are_right_for_planes_and_worse_on_curves() -> None:
    errors = {}
    for kind in ("plane", "convex"):
        key = mirror_key(kind, EYE, 64, rho=1.5)
        camera = eye_camera(moved_eye([0.2, 0.1, -0.1]), 64)
        _, layer, pixels = pixels_of(kind, camera, rho=1.5)
        made = mirror_motion_vectors(key, pixels)
        wanted = layer.color.reshape(-1, 3)[pixels.pixel]
        errors[kind] = float((made.color - wanted)[made.found].abs().mean()) if bool(made.found.any()) else np.inf
        if kind == "plane":
            assert float(made.found.double().mean()) > 0.6
    assert errors["plane"] < 0.5 / 255
    assert errors["convex"] > 2 * errors["plane"]


def test_more_traced_than_the_threshold_makes_exactly_the_next_picture_a_key_frame() -> None:
    gbuffer, layer, pixels = pixels_of("plane", eye_camera(EYE, 48))
    traced = []

    def trace(chosen: ReflectivePixels):
        traced.append(len(chosen))
        return layer_of[0]

    layer_of = [layer]
    first = reuse_reflections(pixels, gbuffer, trace, None, SMOOTH)
    assert first.report.key_frame and traced == [len(pixels)] and first.report.traced_share == 1.0
    assert not first.state.renew  # a key frame asks for no other
    far = eye_camera(moved_eye([1.2, 0.6, 0.0]), 48)
    gbuffer, layer_of[0], pixels = pixels_of("plane", far)
    second = reuse_reflections(pixels, gbuffer, trace, first.state, SMOOTH)
    assert not second.report.key_frame and second.report.traced_share > 0.3 and second.state.renew
    assert second.report.traced == traced[1] == sum(second.report.pixels.values()) - second.report.pixels["found"]
    third = reuse_reflections(pixels, gbuffer, trace, second.state, SMOOTH)
    assert third.report.key_frame and not third.state.renew
    fourth = reuse_reflections(pixels, gbuffer, trace, third.state, SMOOTH)
    assert not fourth.report.key_frame and fourth.report.traced_share < 0.01
    lax = reuse_reflections(pixels, gbuffer, trace, first.state, ReuseOptions(contrast=1.0, key_frame_threshold=1.0))
    assert not lax.state.renew


def room(tint: float = 0.8) -> Scene:
    """A mirror in the plane z = 0, a glossless floor, and two cards at different distances before the mirror."""
    board = (torch.arange(8)[:, None] + torch.arange(8)) % 2
    checks = (0.2 + 0.6 * board.float())[..., None].expand(8, 8, 3).contiguous()
    return Scene(
        meshes=(
            rectangle([-2.0, -1.5, 0.0], [4.0, 0.0, 0.0], [0.0, 3.0, 0.0], 0),
            rectangle([4.0, -3.0, 5.0], [-8.0, 0.0, 0.0], [0.0, 6.0, 0.0], 1),
            rectangle([0.6, -0.5, 3.9], [-1.0, 0.0, 0.0], [0.0, 1.0, 0.0], 2),
        ),
        materials=(
            Material(name="mirror", specular=1.0, diffuse=torch.zeros(3)),
            Material(name="wall", diffuse=torch.ones(3), diffuse_texture=checks),
            Material(name="card", diffuse=torch.tensor([tint, 0.2, 0.1])),
        ),
        lights=(PointLight(position=torch.tensor([0.0, 0.0, 2.0]), intensity=torch.full((3,), 12.0)),),
        ambient=torch.full((3,), 0.2),
    )


def room_camera(x: float, size: int = 96) -> Cameras:
    return Cameras.look_at([x, 0.1, 3.0], [0.1, 0.0, 0.0], width=size, height=size, fov_deg=50.0)


def test_a_room_with_edges_stays_close_to_rays_and_opens_no_gaps() -> None:
    scene = room()
    caster, shader = RayCaster(scene.geometry), hit_shader(scene, RenderOptions(shadows=False))
    state, shares, errors, old = None, [], [], []
    for k in range(6):
        gbuffer = rasterize(scene, room_camera(-0.6 + 0.03 * k))
        pixels = reflective_pixels(scene, gbuffer)
        made = reuse_reflections(pixels, gbuffer, lambda p: trace_reflections(caster, p, shader), state)
        exact = trace_reflections(caster, pixels, shader)
        seen = exact.state > 0
        errors.append(float((made.layer.color - exact.color)[seen].abs().mean()))
        if state is not None:
            painted = depth_reprojection(state.key, pixels)
            wanted = exact.color.reshape(-1, 3)[pixels.pixel]
            old.append(float((painted.color - wanted)[painted.found].abs().mean()))
            shares.append(made.report.traced_share)
        reused = made.layer.state == ReflectionState.REUSED
        distance, true = made.layer.distance[reused], exact.distance[reused]
        occlusion = ((distance - true).abs() > 0.02 * true).double()
        assert not len(occlusion) or float(occlusion.mean()) < 0.01
        state = made.state
    assert max(errors) < 1 / 255
    assert sum(old) > 5 * sum(errors)
    assert 0.0 < sum(shares) / len(shares) < 0.25


def test_views_in_a_batch_are_reused_like_single_ones() -> None:
    scene = room()
    caster, shader = RayCaster(scene.geometry), hit_shader(scene, RenderOptions(shadows=False))

    def run(xs: list[float], state: ReuseState | None):
        gbuffer = rasterize(scene, Cameras.cat([room_camera(x, 48) for x in xs]))
        pixels = reflective_pixels(scene, gbuffer)
        return reuse_reflections(pixels, gbuffer, lambda p: trace_reflections(caster, p, shader), state)

    both = run([-0.55, 0.45], run([-0.6, 0.4], None).state).layer
    for k, (before, after) in enumerate(((-0.6, -0.55), (0.4, 0.45))):
        single = run([after], run([before], None).state).layer
        assert torch.equal(single.state[0], both.state[k])
        assert torch.allclose(single.color[0], both.color[k], atol=1e-6)
    alone = run([-0.6], run([-0.6, 0.4], None).state)
    assert alone.report.key_frame  # another number of views starts anew


def test_the_same_pictures_whatever_happened_before_are_the_same() -> None:
    key = mirror_key("convex", EYE, 48, rho=2.0)
    camera = eye_camera(moved_eye([0.1, 0.0, 0.0]), 48)
    _, _, pixels = pixels_of("convex", camera, rho=2.0)
    results = [warp_to_view(key, shift_reflections(key, match_reflections(key, camera.eye)), pixels) for _ in range(2)]
    assert torch.equal(results[0].color, results[1].color) and torch.equal(results[0].state, results[1].state)


def test_wrong_arguments_are_named() -> None:
    key = mirror_key("plane", EYE, 16)
    with pytest.raises(InputError, match="eye"):
        match_reflections(key, torch.zeros(2, 3))
    with pytest.raises(InputError, match="start"):
        match_reflections(key, torch.ones(1, 3), torch.zeros(3, 2, dtype=torch.int32))
    for name, value in (("ratio", 0.4), ("area_ratio", 0.5), ("max_steps", 4), ("key_frame_threshold", 1.5)):
        with pytest.raises(OptionError, match=name):
            ReuseOptions(**{name: value})
    with pytest.raises(OptionError, match="second_warp"):
        ReuseOptions(second_warp="sideways")
    _, _, pixels = pixels_of("plane", eye_camera(EYE, 16))
    other = MovedReflections(torch.zeros(1, 8, 8, 2), torch.zeros(1, 8, 8, dtype=torch.uint8))
    with pytest.raises(InputError, match="certainty"):
        warp_to_view(key, other, pixels)


def test_the_shell_has_a_visible_pattern() -> None:
    """Guards the other tests: a constant picture would hide every error."""
    assert float(mirror_key("plane", EYE, 32).color.std()) > 0.05
    assert float(shell_color(torch.eye(3, dtype=torch.float64) * 8).std()) > 0.05
    assert make_key_frame(*views_of("plane", eye_camera(EYE, 8))).pixel.numel() > 0


@pytest.mark.parametrize("name", ["living_room", "washroom"])
def test_on_walks_through_the_rooms(name: str) -> None:
    """The figures of the acceptance list, on the displayed picture; depth is the warp as if painted on the mirrors."""
    scene = build(name, triangles=12000)
    caster, shader = RayCaster(scene.geometry), hit_shader(scene, RenderOptions(shadows=False))
    cameras = built_in_path(scene, "walk1").cameras(300, width=384, height=384, near=0.02)
    state, own, painted, shares = None, [], [], []
    for number in (150, 151, 152):
        gbuffer = rasterize(scene, cameras[number])
        pixels = reflective_pixels(scene, gbuffer)
        weight = mirrored_share(scene, gbuffer, pixels)
        before = state
        made = reuse_reflections(pixels, gbuffer, lambda p: trace_reflections(caster, p, shader), state, None, weight)
        state = made.state
        if before is None:
            continue
        exact = trace_reflections(caster, pixels, shader)
        other = depth_reprojection(before.key, pixels)
        color = exact.color.reshape(-1, 3).clone()
        color[pixels.pixel[other.found]] = other.color[other.found]
        direct = shade(scene, gbuffer)

        def shown(layer: ReflectionLayer, gbuffer: GBuffer = gbuffer, direct: Tensor = direct) -> Tensor:
            return srgb_from_linear(blend_reflections(scene, gbuffer, direct, layer).clamp(0.0, 1.0))

        truth, seen = shown(exact), exact.state > 0
        own.append(float((shown(made.layer) - truth)[seen].abs().mean()))
        layer = replace(exact, color=color.reshape(exact.color.shape))
        painted.append(float((shown(layer) - truth)[seen].abs().mean()))
        shares.append(made.report.traced_share)
        assert not made.report.key_frame, shares
    assert np.mean(own) < 1 / 255
    assert np.mean(painted) > 5 * np.mean(own)
    assert np.mean(shares) <= 0.25, shares
