"""A camera's picture is the same among others as alone, in every pass; its exposure, if automatic, is that of all."""

from __future__ import annotations

import pytest
import torch
from torch import Tensor

import torchrender as tr
from torchrender.effects.ambient.options import AmbientOptions
from torchrender.effects.reflections.traced import TraceOptions
from torchrender.scene.camera import Cameras

WAYS = {
    "as it is": {},
    "rays": {"ambient_visibility": "traced", "reflections": "traced"},
    "shared rays": {"ambient_visibility": "traced", "ambient": AmbientOptions(rays=4, share=True)},
    "few rays": {"ambient_visibility": "traced", "ambient": AmbientOptions(rays=4, ray_spacing=2)},
    "clusters": {"reflections": "clustered"},
    "glossy": {"reflections": "traced", "tracing": TraceOptions(glossy_rays=2)},
    "traced panes": {"transparency": "traced"},
}


def some_scene(seed: int) -> tr.Scene:
    """Boxes, a mirror or glossy floor, a pane, lamps, fog and light from everywhere, as chance will have it."""
    chance = torch.Generator().manual_seed(seed)

    def number(low: float, high: float) -> float:
        return low + (high - low) * float(torch.rand((), generator=chance))

    materials = (
        tr.Material(diffuse=[0.5, 0.5, 0.5]),
        tr.Material(diffuse=[0.9, 0.8, 0.8], metallic=1.0, roughness=0.0 if seed % 2 else number(0.1, 0.4)),
        tr.Material(diffuse=[0.1, 0.1, 1.0], opacity=0.4, blend=True),
    )
    boxes = [tr.Mesh.box(number(0.4, 0.9), [number(-1, 1), 0.5, number(-1, 1)], material=k) for k in (0, 1)]
    floor = tr.Mesh.plane(4, material=1 if seed % 2 else 0)
    lamps = (
        tr.PointLight(position=[2, 3, 1], intensity=20),
        tr.RectLight(corner=[-0.5, 3, -0.5], edge_u=[1, 0, 0], edge_v=[0, 0, 1], radiance=3),
        tr.DirectionalLight(direction=[-1, -2, -1], irradiance=1),
    )
    return tr.Scene(
        meshes=(*boxes, floor, tr.Mesh.plane(1, [0, 1.5, 0], material=2)),
        materials=materials,
        lights=lamps[: 1 + seed % 3],
        ambient=[0.1, 0.1, 0.1],
        environment=tr.Environment.constant([0.5, 0.6, 0.7]) if seed % 3 else None,
        media=(tr.Medium(low=[-3, -1, -3], high=[3, 2, 3], scattering=0.05, absorption=0.05),) if seed % 2 else (),
    )


def eyes(edge_on: bool) -> tuple[Cameras, Cameras]:
    """Two views, the second through an eye in the plane of a large pane, which none of its depth images shows."""
    first = Cameras.look_at([2, 2, 4], [0, 0.5, 0], width=40, height=30)
    return first, Cameras.look_at([-2.5, 1.5 if edge_on else 1.1, 3], [0, 0.5, 0], width=40, height=30)


def difference(scene: tr.Scene, cameras: tuple[Cameras, ...], options: tr.RenderOptions) -> Tensor:
    """(B,) largest differences of the batch to each camera alone, as shares of the brightest."""
    together = tr.render(scene, Cameras.cat(cameras), options=options).radiance
    alone = torch.cat([tr.render(scene, camera, options=options).radiance for camera in cameras])
    return (together - alone).abs().flatten(1).amax(dim=1) / alone.max()


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("seed", (1, 2))
def test_a_picture_is_the_same_among_others(seed: int, way: str) -> None:
    options = tr.RenderOptions(exposure=None, **WAYS[way])
    assert float(difference(some_scene(seed), eyes(False), options).max()) < 2e-5


@pytest.mark.parametrize("order", (1, -1))
def test_an_eye_in_a_wall_s_plane_casts_rays_for_itself_alone(order: int) -> None:
    wall = tr.Mesh.box(1.0, [0, 0.5, 0])
    scene = tr.Scene(meshes=(wall, tr.Mesh.plane(4)), materials=(tr.Material(diffuse=[0.5, 0.5, 0.5]),), lights=())
    scene = scene.replace(environment=tr.Environment.constant([1, 1, 1]))
    aside = Cameras.look_at([2, 2, 4], [0, 0.5, 0], width=96, height=72)
    edge_on = Cameras.look_at([-2, 1, 3], [0, 0.5, 0], width=96, height=72)  # in the plane of the box's lid
    assert float(difference(scene, (aside, edge_on)[::order], tr.RenderOptions()).max()) == 0.0


def test_automatic_exposure_is_one_for_all_pictures_of_a_batch() -> None:
    """As its documentation says: pictures of a batch may be those of a sequence, which must not flicker."""
    scene, cameras = some_scene(2), Cameras.cat(eyes(False))
    image = tr.render(scene, cameras, options=tr.RenderOptions(exposure=None))
    shown, sent = image.displayed(), image.radiance
    factor = (shown / sent.clamp_min(1e-9))[(shown > 0.05) & (shown < 0.95)]
    assert float(factor.std() / factor.mean()) < 1e-3
