"""Hard cases of reflection reuse: no reflector, one of a pixel, contact, infinity, jumps, degenerate optics."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch

from reuse_scenes import eye_camera, mirror_key, mirror_scene, rectangle, views_of
from torchrender.buffers import ReflectionState
from torchrender.effects.reflections.key_frame import make_key_frame, match_reflections
from torchrender.effects.reflections.moved import shift_reflections, warp_to_view
from torchrender.effects.reflections.reflectors import reflective_pixels
from torchrender.effects.reflections.reuse import ReuseState, reuse_reflections
from torchrender.effects.reflections.reuse_options import ReuseOptions
from torchrender.effects.reflections.traced import trace_reflections
from torchrender.pipeline.options import RenderOptions
from torchrender.raster import rasterize
from torchrender.rays import RayCaster
from torchrender.report.common.hits import hit_shader
from torchrender.scene.camera import Cameras
from torchrender.scene.light import PointLight
from torchrender.scene.material import Material
from torchrender.scene.model import Scene

EYE = [0.3, 0.2, 3.0]
WARPS = pytest.mark.parametrize("warp", ["reverse", "forward"])


def reuse(key, camera, kind="plane", warp="reverse", **options):
    gbuffer, layer = views_of(kind, camera, **options)
    pixels = reflective_pixels(mirror_scene(), gbuffer)
    made = reuse_reflections(
        pixels, gbuffer, lambda _: layer, ReuseState(key), ReuseOptions(contrast=1.0, second_warp=warp)
    )
    assert bool(torch.isfinite(made.layer.color).all()) and not bool(made.layer.distance.isnan().any())
    return made, layer, pixels


def closeness(made, layer) -> float:
    reused = made.layer.state == ReflectionState.REUSED
    return float((made.layer.color - layer.color)[reused].abs().amax()) if bool(reused.any()) else 0.0


@WARPS
def test_a_jump_far_away_and_behind_is_traced(warp: str) -> None:
    key = mirror_key("plane", EYE, 32)
    for eye, target in (([40.0, 3.0, 4.0], (0.0, 0.0, 0.0)), ([0.2, 0.1, 0.004], (0.3, 0.1, 0.0))):
        made, layer, _ = reuse(key, eye_camera(eye, 32, target), warp=warp)
        assert closeness(made, layer) < 0.05


@WARPS
def test_an_eye_that_crosses_the_mirror_plane(warp: str) -> None:
    """A mirror with two faces: from behind nothing is served from the front."""
    key = mirror_key("plane", [0.3, 0.2, 0.6], 32)
    for z in (0.2, 1e-3, 1e-9):
        made, layer, _ = reuse(key, eye_camera([0.3, 0.2, z], 32, (0.3, 0.8, 0.0)), warp=warp)
        assert closeness(made, layer) < 0.1
    behind = torch.tensor([[0.3, 0.2, -0.5]], dtype=torch.float64)
    matches = match_reflections(key, behind)
    assert not bool(matches.valid.any()) and bool(torch.isfinite(matches.offset).all())
    on_plane = torch.tensor([[0.3, 0.2, 0.0]], dtype=torch.float64)
    assert not bool(match_reflections(key, on_plane).valid.any())


@WARPS
@pytest.mark.parametrize("kind", ["plane", "convex"])
def test_everything_mirrored_is_infinitely_far(warp: str, kind: str) -> None:
    key = mirror_key(kind, EYE, 48, rho=2.0, endless=True)
    assert bool(torch.isinf(key.distance[key.reflector >= 0]).all())
    made, layer, pixels = reuse(key, eye_camera([0.4, 0.15, 2.9], 48), kind, warp, rho=2.0, endless=True)
    assert made.report.traced_share < 0.35
    assert closeness(made, layer) < 4 / 255
    reused = made.layer.state == ReflectionState.REUSED
    assert bool(torch.isinf(made.layer.distance[reused]).all())
    assert len(pixels) > 500


def test_contact_is_a_match_and_nothing_divides_by_zero() -> None:
    gbuffer, layer = views_of("plane", eye_camera(EYE, 24))
    for distance in (0.0, 1e-12, 1e-4):
        near = replace(layer, distance=torch.where(layer.state > 0, distance, 0.0))
        key = make_key_frame(gbuffer, near)
        eye = key.cameras.eye + torch.tensor([0.05, -0.02, 0.0], dtype=torch.float64)
        matches = match_reflections(key, eye)
        assert bool(torch.isfinite(matches.offset).all())
        # What touches the mirror is mirrored where it touches, from wherever it is seen.
        assert not bool(matches.end[matches.valid].any())
        assert float(matches.valid.double().mean()) > 0.9
        moved = shift_reflections(key, matches)
        assert bool(torch.isfinite(moved.source[moved.certainty > 0]).all())


def test_no_reflector_in_view() -> None:
    gbuffer, layer = views_of("plane", eye_camera([0.0, 0.0, 3.0], 16, (0.0, 9.0, 3.0)))
    pixels = reflective_pixels(mirror_scene(), gbuffer)
    assert len(pixels) == 0
    first = reuse_reflections(pixels, gbuffer, lambda _: layer, None)
    assert first.report.traced_share == 0.0 and not first.state.renew
    again = reuse_reflections(pixels, gbuffer, lambda _: layer, first.state)
    assert again.report.traced_share == 0.0 and not again.state.renew and not bool(again.layer.state.any())
    # Reflectors that come into view are all traced, by an empty key frame.
    made, layer, pixels = reuse(first.state.key, eye_camera(EYE, 16))
    assert made.report.traced == len(pixels) > 0 and made.state.renew


@WARPS
def test_reflectors_of_one_and_two_pixels_are_traced(warp: str) -> None:
    gbuffer, layer = views_of("plane", eye_camera(EYE, 16))
    for chosen in ([(8, 8)], [(8, 8), (8, 9)], [(0, 0)], [(15, 15), (15, 14)]):
        mask = torch.zeros(1, 16, 16, dtype=torch.bool)
        for y, x in chosen:
            mask[0, y, x] = True
        some = replace(layer, state=layer.state * mask)
        key = make_key_frame(gbuffer, some)
        matches = match_reflections(key, key.cameras.eye + 0.01)
        assert not bool(matches.valid.any())
        pixels = reflective_pixels(mirror_scene(), gbuffer, mask)
        moved = shift_reflections(key, matches)
        warped = warp_to_view(key, moved, pixels, ReuseOptions(second_warp=warp))
        assert not bool(warped.found.any())


@pytest.mark.parametrize("size", [(1, 1), (1, 5), (5, 1), (2, 2)])
def test_tiny_pictures(size: tuple[int, int]) -> None:
    camera = Cameras.look_at([0.1, 0.0, 3.0], [0.1, 0.0, 0.0], width=size[1], height=size[0], fov_deg=10.0)
    gbuffer, layer = views_of("plane", camera)
    key = make_key_frame(gbuffer, layer)
    pixels = reflective_pixels(mirror_scene(), gbuffer)
    made = reuse_reflections(pixels, gbuffer, lambda _: layer, ReuseState(key))
    assert made.report.reflective == len(pixels) > 0
    assert torch.equal(made.layer.color, layer.color)


def test_pixels_without_a_normal_are_left_out() -> None:
    gbuffer, layer = views_of("plane", eye_camera(EYE, 24))
    normal = gbuffer.normal.clone()
    normal[0, 5:9] = 0.0
    normal[0, 12] *= 0.3
    normal[0, 14] *= 0.7
    key = make_key_frame(replace(gbuffer, normal=normal), layer)
    assert not bool((key.reflector[0, 5:9] >= 0).any()) and not bool((key.reflector[0, 12] >= 0).any())
    kept = key.reflector[0, 14] >= 0
    assert bool(kept.any())
    assert torch.allclose(key.surface[0, 14, kept, 3:6].norm(dim=-1), torch.ones(int(kept.sum())), atol=1e-6)
    broken = torch.full_like(normal[0, 2], torch.nan)
    normal[0, 2] = broken
    key = make_key_frame(replace(gbuffer, normal=normal), layer)
    assert not bool((key.reflector[0, 2] >= 0).any())
    matches = match_reflections(key, key.cameras.eye + 0.02)
    assert bool(torch.isfinite(matches.offset).all())


def test_a_concave_mirror_near_its_focus_gives_no_noise() -> None:
    """The shell is 8 away and the eye 3: with a focal distance around them matches are ill-conditioned or absent."""
    for rho in (3.0, 4.0, 5.0, 6.0, 8.0):
        key = mirror_key("concave", EYE, 48, rho=rho)
        made, layer, _ = reuse(key, eye_camera([0.35, 0.17, 2.95], 48), "concave", rho=rho)
        assert closeness(made, layer) < 0.03


def test_coplanar_reflectors_are_never_matched_across() -> None:
    def two(position):
        return (position[..., 0] > 0.1).long() + 1

    key = mirror_key("plane", EYE, 64, id_of=two)
    matches = match_reflections(key, key.cameras.eye + torch.tensor([[0.3, 0.0, 0.0]], dtype=torch.float64))
    flat = key.reflector.reshape(-1)
    ends = key.pixel + matches.end[:, 0].long() * 64 + matches.end[:, 1].long()
    assert torch.equal(flat[ends], flat[key.pixel])
    left, right = key.reflector[0, :, :-1], key.reflector[0, :, 1:]
    across = (left == 1) & (right == 2)
    across = across[:-1] & across[1:]  # blocks with one reflector on either side
    assert int(across.sum()) > 30 and not bool(key.joined[0][across].any())
    moved = shift_reflections(key, matches)
    known = moved.certainty[0] == 2
    x, y = (moved.source[0][known] - 0.5).round().long().unbind(-1)
    assert torch.equal(key.reflector[0][y, x], key.reflector[0][known])


def test_a_reflector_with_steps_is_not_joined_across_them() -> None:
    gbuffer, layer = views_of("plane", eye_camera(EYE, 32))
    depth, position = gbuffer.depth.clone(), gbuffer.position.clone()
    depth[0, :, 16:] += 0.5
    eye = gbuffer.cameras.eye[0]
    position[0, :, 16:] = eye + (position[0, :, 16:] - eye) * 1.2
    key = make_key_frame(replace(gbuffer, depth=depth, position=position), layer)
    assert not bool(key.joined[0, :, 15].any()) and bool(key.joined[0, 10:20, 8].all())


def test_a_thing_that_touches_the_mirror_does_not_smear() -> None:
    """A card that stands on a mirror floor and reaches in front of it: edges, contact and jumps at once."""
    scene = Scene(
        meshes=(
            rectangle([-3.0, 0.0, -3.0], [0.0, 0.0, 6.0], [6.0, 0.0, 0.0], 0),
            rectangle([-0.5, 0.0, -1.0], [1.0, 0.0, 0.0], [0.0, 1.2, 0.0], 1),
            rectangle([-4.0, -1.0, -5.0], [8.0, 0.0, 0.0], [0.0, 6.0, 0.0], 2),
        ),
        materials=(
            Material(name="mirror", specular=0.9, diffuse=torch.full((3,), 0.1)),
            Material(name="card", diffuse=torch.tensor([0.9, 0.2, 0.1])),
            Material(name="wall", diffuse=torch.tensor([0.2, 0.4, 0.8])),
        ),
        lights=(PointLight(position=torch.tensor([0.5, 4.0, 2.0]), intensity=torch.full((3,), 30.0)),),
        ambient=torch.full((3,), 0.2),
    )
    caster, shader = RayCaster(scene.geometry), hit_shader(scene, RenderOptions(shadows=False))
    state = None
    for k in range(5):
        camera = Cameras.look_at([0.1 + 0.06 * k, 1.4, 3.0], [0.0, 0.3, -1.0], width=96, height=96, fov_deg=45.0)
        gbuffer = rasterize(scene, camera)
        pixels = reflective_pixels(scene, gbuffer)
        made = reuse_reflections(pixels, gbuffer, lambda p: trace_reflections(caster, p, shader), state)
        exact = trace_reflections(caster, pixels, shader)
        error = (made.layer.color - exact.color).abs().amax(-1)
        assert float((error > 0.1).double().sum()) < 0.01 * len(pixels)
        state = made.state
    assert made.report.traced_share < 0.25
