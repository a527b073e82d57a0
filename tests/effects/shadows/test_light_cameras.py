"""Cameras of lights: known points, coverage of the scene, cubes without gaps."""

from __future__ import annotations

import math

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from torchrender.effects.shadows.light_cameras import choose_views, light_cameras, light_frames, light_view
from torchrender.errors import InputError, OptionError
from torchrender.scene.light import DirectionalLight, PointLight, RectLight, SpotLight

BOX = torch.tensor([[[-1.0, 0.0, -2.0], [3.0, 2.0, 2.0]]])
SIZE = {"width": 600, "height": 512}


def corners(boxes: torch.Tensor) -> torch.Tensor:
    low, high = boxes.double().unbind(1)
    choices = torch.cartesian_prod(*[torch.tensor([0.0, 1.0], dtype=torch.float64)] * 3)
    return (low[:, None] + choices * (high - low)[:, None]).reshape(-1, 3)


def random_points(count: int = 500, boxes: torch.Tensor = BOX) -> torch.Tensor:
    generator = torch.Generator().manual_seed(0)
    low, high = boxes[0].double()
    return low + torch.rand(count, 3, generator=generator, dtype=torch.float64) * (high - low)


def test_spot_projects_a_known_point():
    light = SpotLight(position=torch.tensor([0.0, 1.0, 5.0]), direction=torch.tensor([0.0, 0.0, -1.0]), outer_deg=45.0)
    camera = light_cameras(light, BOX, **SIZE, border=6.0)
    uv, z = camera.project(torch.tensor([[0.0, 1.0, 1.0], [1.0, 2.0, 1.0]]))
    assert z[0].tolist() == pytest.approx([4.0, 4.0], abs=1e-5)
    assert uv[0, 0].tolist() == pytest.approx([300.0, 256.0], abs=1e-5)
    # The cone's edge at 45 degrees lies six texels from the border: focal lengths 294 and 250; v points down.
    assert uv[0, 1].tolist() == pytest.approx([300 + 294 / 4, 256 - 250 / 4], abs=1e-5)


def test_directional_projects_a_known_point():
    light = DirectionalLight(direction=torch.tensor([0.0, 0.0, -1.0]))
    camera = light_cameras(light, BOX, width=400, height=200, border=0.0)
    uv, z = camera.project(corners(BOX))
    # 4 units wide on 400 texels and 2 units high on 200, but for the rim of one part in a thousand.
    assert camera.intrinsics[0, 0, 0] == pytest.approx(100 / 1.001, rel=1e-9)
    assert uv[0].amin(0).tolist() == pytest.approx([200 - 200 / 1.001, 100 - 100 / 1.001], abs=1e-5)
    assert float(z.max() - z.min()) == pytest.approx(4.0, abs=1e-5)


@settings(deadline=None, max_examples=40)
@given(st.lists(st.floats(-1, 1), min_size=3, max_size=3).filter(lambda d: math.hypot(*d) > 0.1))
def test_directional_holds_the_scene_for_any_direction(direction):
    light = DirectionalLight(direction=torch.tensor(direction))
    camera = light_cameras(light, BOX, **SIZE, border=5.0)
    uv, z = camera.project(corners(BOX))
    assert bool((uv >= 5.0).all()) and bool((uv[..., 0] <= 595).all()) and bool((uv[..., 1] <= 507).all())
    assert bool((z > camera.near).all()) and bool((z < camera.far).all())
    # and wastes nothing: the scene touches all four sides.
    assert uv.amin((0, 1)).tolist() == pytest.approx([5.0, 5.0], abs=1.0)


@pytest.mark.parametrize("axis", [None, [0.0, -1.0, 0.0], [1.0, 2.0, -0.5]])
def test_faces_of_a_cube_meet_without_gaps(axis):
    position = torch.tensor([0.5, 1.0, 0.2])
    if axis is None:
        light = PointLight(position=position)
    else:
        light = SpotLight(position=position, direction=torch.tensor(axis), outer_deg=80.0)
    cameras = light_cameras(light, BOX, width=128, height=96, border=7.0)
    assert len(cameras) == (6 if axis is None else 5)
    points = random_points()
    if axis is not None:
        points = points[((points - position) @ light.direction.double()) > 0]
    chosen = choose_views(points, cameras, 0.0)
    uv, z = cameras.project(points)
    rows = torch.arange(len(points))
    own, depth = uv[chosen, rows], z[chosen, rows]
    high = torch.tensor([128 - 7, 96 - 7])
    assert bool((own >= 7 - 1e-9).all()) and bool((own <= high + 1e-9).all())
    assert bool((depth > 0).all()) and bool((depth <= cameras.far[0]).all())
    assert len(chosen.unique()) == len(cameras)


def test_depth_range_is_tight_outside_and_safe_inside():
    outside = light_cameras(PointLight(position=torch.tensor([1.0, 10.0, 0.0])), BOX, **SIZE)
    assert outside.near[0] == pytest.approx(8.0, rel=2e-3) and outside.far[0] == pytest.approx(10.0, rel=2e-3)
    inside = light_cameras(PointLight(position=torch.tensor([1.0, 1.0, 0.0])), BOX, **SIZE)
    assert 0 < inside.near[0] < 1e-3 and inside.far[0] == pytest.approx(2.0, rel=2e-3)


def test_spot_fits_only_what_its_cone_meets():
    boxes = torch.cat([BOX, BOX + 100.0])
    light = SpotLight(position=torch.tensor([1.0, 9.0, 0.0]), direction=torch.tensor([0.0, -1.0, 0.0]), outer_deg=20.0)
    camera = light_cameras(light, boxes, **SIZE)
    assert camera.near[0] == pytest.approx(7.0, rel=2e-3) and camera.far[0] == pytest.approx(9.0, rel=2e-3)


def test_rectangle_looks_from_its_centre_to_its_emitting_side():
    light = RectLight(
        corner=torch.tensor([0.0, 5.0, 0.0]), edge_u=torch.tensor([1.0, 0, 0]), edge_v=torch.tensor([0, 0, 1.0])
    )
    cameras = light_cameras(light, BOX, **SIZE)
    assert len(cameras) == 5
    assert torch.allclose(cameras.eye, torch.tensor([0.5, 5.0, 0.5], dtype=torch.float64).expand(5, 3))
    assert torch.allclose(cameras.forward[0], light.normal.double())
    line = RectLight(corner=torch.zeros(3), edge_u=torch.ones(3), edge_v=torch.zeros(3))
    assert len(light_cameras(line, BOX, **SIZE)) == 6


@pytest.mark.parametrize(
    "light",
    [
        PointLight(position=torch.tensor([0.0, 1.0, 0.0])),
        DirectionalLight(direction=torch.tensor([0.0, -1.0, 0.0])),
        SpotLight(position=torch.tensor([0.0, 50.0, 0.0]), direction=torch.tensor([0.0, 1.0, 0.0])),
    ],
)
@pytest.mark.parametrize("boxes", [torch.zeros(0, 2, 3), torch.zeros(1, 2, 3), BOX * torch.tensor([1.0, 0.0, 1.0])])
def test_empty_flat_and_unseen_scenes_have_cameras(light, boxes):
    cameras = light_cameras(light, boxes, **SIZE)
    assert bool((cameras.far > cameras.near).all()) and bool(torch.isfinite(cameras.far).all())


def test_far_from_the_origin_the_cube_keeps_its_directions():
    position = torch.tensor([1e7, 1e7, -1e7])
    cameras = light_cameras(PointLight(position=position), BOX + position, **SIZE)
    assert torch.equal(cameras.rotation.abs().sum(-1), torch.ones(6, 3, dtype=torch.float64))


def test_wrong_arguments_are_named():
    light = PointLight(position=torch.zeros(3))
    with pytest.raises(InputError, match="boxes"):
        light_cameras(light, torch.zeros(2, 3), **SIZE)
    with pytest.raises(InputError, match="boxes must be finite"):
        light_cameras(light, torch.full((1, 2, 3), math.nan), **SIZE)
    with pytest.raises(OptionError, match="border"):
        light_cameras(light, BOX, width=64, height=64, border=20.0)


def test_light_view_carries_the_cameras_numbers():
    cameras = light_cameras(PointLight(position=torch.tensor([1.0, 1.0, 0.0])), BOX, **SIZE)
    view = light_view(cameras, 3)
    points = random_points(50)
    camera = points @ view.rotation.T + view.translation
    uv, z = cameras[3].project(points)
    front = z[0] > 0
    u = camera[:, 0] / camera[:, 2] * view.focal[0] + view.centre[0]
    assert torch.allclose(u[front], uv[0, front, 0]) and torch.allclose(camera[:, 2], z[0])


def test_parallel_depths_count_from_the_middle_of_what_is_there():
    """Far from the world's origin float32 must still hold them."""
    away = torch.tensor([4e6, -3e6, 5e5])
    camera = light_cameras(DirectionalLight(direction=torch.tensor([0.3, -1.0, 0.2])), BOX.double() + away, **SIZE)
    _, z = camera.project(corners(BOX.double() + away))
    assert float(z.abs().max()) < 10.0 and bool((z > camera.near).all()) and bool((z < camera.far).all())


def test_frames_of_a_light_cover_all_that_it_sends_to():
    for light, count in (
        (DirectionalLight(direction=torch.tensor([0.0, -1.0, 0.0])), 1),
        (SpotLight(position=torch.zeros(3), direction=torch.tensor([0.0, 0, 1.0]), outer_deg=64.0), 1),
        (SpotLight(position=torch.zeros(3), direction=torch.tensor([0.0, 0, 1.0]), outer_deg=66.0), 5),
        (PointLight(position=torch.zeros(3)), 6),
    ):
        frames, parallel = light_frames(light)
        assert frames.shape == (count, 4, 4) and parallel == isinstance(light, DirectionalLight)
        turned = frames[:, :3, :3] @ frames[:, :3, :3].transpose(1, 2)
        assert torch.allclose(turned, torch.eye(3, dtype=torch.float64).expand_as(turned), atol=1e-12)
