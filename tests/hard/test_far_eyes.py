"""Eyes many diagonals away see what near ones do: rays of all effects leave the surfaces they start from."""

from __future__ import annotations

import math
from typing import Any

import pytest
import torch
from torch import Tensor

import torchrender as tr

AWAY = (3.0, 30.0, 300.0, 3000.0)
TOWARD = torch.tensor([2.2, 1.7, 3.1], dtype=torch.float64)


def _eye(away: float, *, across: float = 2.5, side: int = 48) -> tr.Cameras:
    """A camera that shows ``across`` units about the origin from ``away`` units; infinitely far where it is inf."""
    toward = TOWARD / TOWARD.norm()
    if math.isinf(away):
        return tr.Cameras.orthographic_view(
            (300.0 * toward).tolist(), [0.0, 0.0, 0.0], width=side, height=side, view_height=across
        )
    return tr.Cameras.look_at(
        (away * toward).tolist(), [0.0, 0.0, 0.0], width=side, height=side, near=away - 2.9,
        fov_deg=math.degrees(2.0 * math.atan(0.5 * across / away)),
    )  # fmt: skip


def _light(scene: tr.Scene, away: float, **options: Any) -> Tensor:
    return tr.render(scene, _eye(away), options=tr.RenderOptions(**options)).radiance[0]


@pytest.mark.parametrize("size", [1e-3, 1.0, 1e3])
@pytest.mark.parametrize("way", ["auto", "traced"])
def test_nothing_hides_light_from_a_convex_body(way: str, size: float) -> None:
    scene = tr.Scene(meshes=[tr.Mesh.box(size)], ambient=[0.5] * 3)
    for away in (*AWAY, math.inf):
        cameras = _eye(away)
        scale = torch.diag(torch.tensor([size, size, size, 1.0], dtype=torch.float64))
        placed = cameras.world_from_camera.clone()
        placed[:, :3, 3] = (scale[:3, :3] @ placed[:, :3, 3, None])[..., 0]
        if math.isinf(away):
            eye = placed[0, :3, 3].tolist()
            cameras = tr.Cameras.orthographic_view(eye, [0.0] * 3, width=48, height=48, view_height=2.5 * size)
        else:
            eye = placed[0, :3, 3].tolist()
            fov = math.degrees(2.0 * math.atan(1.25 / away))
            cameras = tr.Cameras.look_at(
                eye, [0.0] * 3, width=48, height=48, fov_deg=fov, near=(away - 2.9) * size, far=(away + 3) * size
            )
        picture = tr.render(scene, cameras, options=tr.RenderOptions(ambient_visibility=way))
        seen = picture.radiance[picture.gbuffer.covered]
        assert len(seen) > 400
        torch.testing.assert_close(seen, torch.full_like(seen, 0.4), rtol=0.0, atol=0.004)


def _balls(**material: Any) -> tr.Scene:
    return tr.Scene(
        meshes=[tr.Mesh.sphere(0.7, [0.0, 0.1, 0.0], material=1), tr.Mesh.plane(4.0, [0.0, -0.7, 0.0])],
        materials=[tr.Material(diffuse=[0.6, 0.5, 0.4]), tr.Material(**material)],
        lights=[tr.PointLight(position=[1.5, 3.0, 2.0], intensity=20.0)],
        ambient=[0.05] * 3,
    )


@pytest.mark.parametrize(
    "material",
    [
        {"diffuse": [0.7, 0.9, 1.0], "opacity": 0.35, "blend": True},
        {"diffuse": [0.9, 0.9, 0.9], "metallic": 1.0, "roughness": 0.0},
    ],
    ids=["glass", "mirror"],
)
def test_balls_show_the_same_from_everywhere(material: dict[str, Any]) -> None:
    """Pixels that differ from those of an eye infinitely far away: outlines alone, as fine as a pixel."""
    scene = _balls(**material)
    wanted = _light(scene, math.inf)
    for away in AWAY[1:]:
        off = (_light(scene, away) - wanted).abs().amax(dim=-1) > 0.04
        assert float(off.float().mean()) < 0.04, f"{away} units away"


def test_what_is_near_a_mirror_stays_in_a_large_world() -> None:
    """A mirror ball of a metre on grounds of up to a thousand kilometres mirrors the ground beneath it."""
    eye = tr.Cameras.look_at([0.0, 1.5, 4.0], [0.0, 0.5, 0.0], width=48, height=36, fov_deg=30.0)
    found = []
    for side in (20.0, 1e4, 1e6):
        ball = tr.Mesh.sphere(0.5, [0.0, 0.5, 0.0], material=1)
        post = tr.Mesh.box([0.1, 0.3, 0.1], [0.0, 0.15, 0.62])
        scene = tr.Scene(
            meshes=[tr.Mesh.plane(side), ball, post],
            materials=[
                tr.Material(diffuse=[0.6, 0.4, 0.2]),
                tr.Material(diffuse=[0.9] * 3, metallic=1.0, roughness=0.0),
            ],
            lights=[tr.DirectionalLight(direction=[-0.3, -1.0, -0.5], irradiance=3.0)],
        )
        picture = tr.render(scene, eye, options=tr.RenderOptions(reflections="traced", background=[0.0] * 3))
        found.append(picture.radiance[0][(picture.gbuffer.material == 1)[0]])
    assert float(found[0].mean()) > 0.1
    for other in found[1:]:
        assert float(((other - found[0]).abs().amax(dim=-1) > 0.02).float().mean()) < 0.08  # the far edge of the ground


def test_halos_do_not_depend_on_the_size_of_the_scene() -> None:
    eye = tr.Cameras.look_at([0.0, 2.0, 8.0], [0.0, 4.0, 0.0], width=64, height=48, fov_deg=40.0)
    fog = tr.Medium(low=[-10.0, 0.0, -10.0], high=[10.0, 10.0, 10.0], scattering=0.05)
    found = []
    for side in (40.0, 1e3, 1e5):
        lamp = tr.PointLight(position=[0.0, 5.0, 0.0], intensity=30.0)
        scene = tr.Scene(meshes=[tr.Mesh.plane(side)], lights=[lamp], media=[fog])
        picture = tr.render(scene, eye, options=tr.RenderOptions(background=[0.0] * 3)).radiance[0]
        found.append(picture[:20])  # over the horizon
    for other in found[1:]:
        torch.testing.assert_close(other, found[0], rtol=0.02, atol=1e-3)
