"""Light of earlier pictures for another view."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch
from torch import Tensor

from reflection_scenes import looking, mirror_scene
from torchrender.buffers import GBuffer
from torchrender.effects.reflections.virtual import virtual_images
from torchrender.effects.upsampling.carried import LitPicture, MirroredLight, carried_light
from torchrender.errors import GradientError, InputError
from torchrender.numerics.color import srgb_from_linear
from torchrender.passes.mirrors.reflections import REFLECTIONS
from torchrender.passes.seen.gbuffer import GBUFFER
from torchrender.pipeline.options import RenderOptions
from torchrender.raster import rasterize_visibility
from torchrender.renderer import render
from torchrender.scene.camera import Cameras
from torchrender.scene.load import load

SIZE = 96
NEEDED = RenderOptions(buffers=(GBUFFER.name, REFLECTIONS.name), reflections="traced", reuse=None)


def beside(camera: Cameras, right: float, ahead: float = 0.0) -> Cameras:
    """The camera moved along its own axes."""
    matrix = camera.camera_from_world.clone()
    matrix[0, :3, 3] -= torch.tensor([right, 0.0, ahead], dtype=torch.float64)
    return replace(camera, camera_from_world=matrix)


def lit(scene, camera: Cameras, *, apart: bool = True) -> LitPicture:
    """A picture whose mirrored light is apart, or painted on."""
    image = render(scene, camera, options=NEEDED)
    gbuffer, layer = image.buffers[GBUFFER.name], image.buffers.get(REFLECTIONS.name)
    assert isinstance(gbuffer, GBuffer)
    if layer is None or not apart:
        return LitPicture(image.visibility, image.radiance[0])
    made = virtual_images(image.scene, gbuffer, layer)
    return LitPicture(image.visibility, image.radiance[0], MirroredLight(made.depth[0], made.light[0], made.known[0]))


def error(found: Tensor, wanted: Tensor, counted: Tensor) -> float:
    """Mean difference of display values."""
    return float((srgb_from_linear(found.clamp(0, 1)) - srgb_from_linear(wanted.clamp(0, 1))).abs()[counted].mean())


def test_the_same_view_takes_its_own_light() -> None:
    scene = load("cornell_box")
    picture = lit(scene, scene.camera(width=SIZE, height=SIZE))
    found = carried_light(picture.seen, [picture], scene.geometry.material)
    assert found.share == 1.0
    assert torch.allclose(found.light, picture.light, atol=1e-5)


def test_a_view_beside_is_known_but_for_what_was_hidden() -> None:
    scene = load("cornell_box")
    camera = scene.camera(width=SIZE, height=SIZE)
    picture, other = lit(scene, camera), lit(scene, beside(camera, 0.03 * scene.diagonal))
    found = carried_light(other.seen, [picture], scene.geometry.material)
    assert 0.85 < found.share < 1.0
    assert error(found.light, other.light, found.known) < 0.02
    both = carried_light(other.seen, [picture, other], scene.geometry.material)
    assert both.share == 1.0, "the nearest one goes first, the others fill in"
    assert error(both.light, other.light, both.known) < 1e-5


def test_hidden_surfaces_get_no_light_of_what_hid_them() -> None:
    """A box before a wall: what comes out behind its outline is not known, rather than in its colour."""
    scene = load("cornell_box")
    camera = scene.camera(width=SIZE, height=SIZE)
    picture, seen = lit(scene, camera), rasterize_visibility(scene.geometry, beside(camera, 0.1 * scene.diagonal))
    painted = replace(picture, light=picture.seen.object_id[0, ..., None].float().expand(-1, -1, 3).contiguous())
    found = carried_light(seen, [painted], scene.geometry.material)
    wanted = seen.object_id[0].float()
    assert float((found.light[..., 0] - wanted).abs()[found.known].max()) < 1e-4


def test_mirrored_things_move_as_they_do_and_not_as_the_mirror() -> None:
    scene = mirror_scene()
    camera = looking(SIZE)
    other = lit(scene, beside(camera, 0.06 * scene.diagonal))
    materials = scene.geometry.material
    apart, painted = (carried_light(other.seen, [lit(scene, camera, apart=how)], materials) for how in (True, False))
    assert other.mirrors is not None
    counted = other.mirrors.known & apart.known & apart.mirrors.known & ~apart.stale
    assert int(counted.sum()) > 200
    assert error(apart.light, other.light, counted) < 0.5 * error(painted.light, other.light, counted)


def test_what_does_not_fit_is_refused() -> None:
    scene = load("cornell_box")
    picture = lit(scene, scene.camera(width=16, height=12))
    with pytest.raises(InputError, match="light must have shape"):
        carried_light(picture.seen, [replace(picture, light=torch.zeros(3, 3, 3))], scene.geometry.material)
    wanted = replace(picture, light=picture.light.clone().requires_grad_())
    with pytest.raises(GradientError, match="light"):
        carried_light(picture.seen, [wanted], scene.geometry.material)
    flat = replace(picture.seen, cameras=replace(picture.seen.cameras, orthographic=True))
    with pytest.raises(InputError, match="perspective"):
        carried_light(flat, [picture], scene.geometry.material)
