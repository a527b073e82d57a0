"""Transparent voxels and volumes (specification 05, section 8)."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from torchrender.errors import InputError, OptionError
from torchrender.kernels.voxels.volume_march import OPAQUE
from torchrender.scene import shapes
from torchrender.scene.camera import Cameras
from torchrender.scene.material import Material
from torchrender.scene.model import Scene
from torchrender.voxels.attributes import voxelize_scene
from torchrender.voxels.grid import Voxels, make_grid
from torchrender.voxels.volume import (
    VolumeLayer,
    VolumeLight,
    density_layer,
    over_background,
    render_volume,
    surface_layer,
    voxel_layer,
)
from voxel_shapes import unit_grid


def front(size: int = 24, **more: float) -> Cameras:
    """Looking along -z at the box [0, 8]^3 from afar."""
    return Cameras.look_at((4.0, 4.0, 40.0), (4.0, 4.0, 0.0), width=size, height=size, fov_deg=12, **more)


def uniform(alpha: int, smooth: bool, **place: object) -> VolumeLayer:
    rgba = torch.zeros(8, 8, 8, 4, dtype=torch.uint8)
    rgba[..., 0], rgba[..., 3] = 188, alpha
    return VolumeLayer(rgba=rgba, origin=torch.zeros(3), spacing=torch.ones(3), smooth=smooth, **place)


@pytest.mark.parametrize("smooth", [True, False])
@pytest.mark.parametrize("alpha", [10, 60])
def test_uniform_slab_is_closed_form_at_any_step(smooth: bool, alpha: int) -> None:
    """1 - (1 - a)^length, and halving the step changes less than 1e-6."""
    layer, camera = uniform(alpha, smooth), front()
    images = [render_volume([layer], camera, step=step) for step in (1.0, 0.5, 0.25, 0.13)]
    for image in images[1:]:
        assert float((image - images[0]).abs().amax()) < 1e-6
    toward = torch.nn.functional.normalize(camera.rays()[1], dim=-1)[0, 12, 12]
    length = 8.0 / float(-toward[2])
    wanted = 1 - (1 - alpha / 255) ** length
    assert float(images[0][0, 12, 12, 3]) == pytest.approx(wanted, abs=1e-5)
    assert float(images[0][0, 12, 12, 0]) == pytest.approx(wanted * 0.5029, rel=1e-3)


def twin(layer: VolumeLayer, origin: np.ndarray, direction: np.ndarray, step: float) -> np.ndarray:
    """One ray through cubes of one colour, sample after sample."""
    nx, ny, nz = layer.dims
    low, high = layer.origin.numpy(), layer.origin.numpy() + layer.spacing.numpy() * np.array([nx, ny, nz])
    with np.errstate(divide="ignore"):
        t0, t1 = (low - origin) / direction, (high - origin) / direction
    begin, end = max(np.minimum(t0, t1).max(), 0.0), np.maximum(t0, t1).min()
    color, clear = np.zeros(3), 1.0
    if begin >= end:
        return np.zeros(4)
    count = int(np.ceil((end - begin) / step - 1e-9))
    length = (end - begin) / count
    for s in range(count):
        at = origin + (begin + (s + 0.5) * length) * direction
        i, j, k = np.clip(np.floor((at - low) / layer.spacing.numpy()).astype(int), 0, [nx - 1, ny - 1, nz - 1])
        code = layer.rgba[k, j, i].numpy() / 255.0
        linear = np.where(code[:3] <= 0.04045, code[:3] / 12.92, ((code[:3] + 0.055) / 1.055) ** 2.4)
        alpha = 1 - (1 - min(code[3], 1 - 1e-6)) ** (length / layer.reference)
        color += clear * alpha * linear
        clear *= 1 - alpha
        if clear < 1 - OPAQUE:
            break
    return np.array([*color, 1 - clear])


def test_rays_equal_the_slow_twin() -> None:
    generator = torch.Generator().manual_seed(0)
    rgba = torch.randint(0, 256, (17, 9, 20, 4), generator=generator, dtype=torch.uint8)
    rgba[..., 3] = torch.where(torch.rand(17, 9, 20, generator=generator) < 0.7, 0, rgba[..., 3] // 3)
    rgba[:8, :, :8, 3] = 0  # a whole brick that can be skipped
    layer = VolumeLayer(rgba=rgba, origin=torch.tensor([-1.0, 0, 0]), spacing=torch.tensor([0.5, 1, 0.4]), smooth=False)
    camera = Cameras.look_at((9.0, 7.0, 12.0), (4.0, 4.0, 3.0), width=16, height=12, fov_deg=50)
    image = render_volume([layer], camera, step=0.37)
    origins, toward = camera.rays()
    toward = torch.nn.functional.normalize(toward, dim=-1)
    for j in range(12):
        for i in range(16):
            wanted = twin(layer, origins[0, j, i].numpy(), toward[0, j, i].numpy(), 0.37)
            assert np.allclose(image[0, j, i].numpy(), wanted, atol=1e-5)


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_what_lies_between_empty_blocks_is_met_from_every_side(axis: int, side: float) -> None:
    """Five blocks of eight cells along each axis; the filled ones stand alone, none at the border of the layer."""
    generator = torch.Generator().manual_seed(7)
    rgba = torch.zeros(40, 40, 40, 4, dtype=torch.uint8)
    for block in ((1, 1, 3), (3, 1, 1), (1, 3, 2), (3, 3, 3)):
        low = [8 * place + 2 for place in block]
        part = rgba[tuple(slice(start, start + 4) for start in low)]
        part[..., :3] = torch.randint(0, 256, (4, 4, 4, 3), generator=generator, dtype=torch.uint8)
        part[..., 3] = 120
    layer = VolumeLayer(rgba=rgba, origin=torch.zeros(3), spacing=torch.ones(3), smooth=False)
    eye = torch.tensor([20.37, 19.81, 20.13])
    eye[axis] += 60.0 * side
    up = (0.0, 0.0, 1.0) if axis == 1 else (0.0, 1.0, 0.0)
    camera = Cameras.look_at(eye, (20.17, 19.93, 20.29), up=up, width=13, height=13, fov_deg=33.7)
    image = render_volume([layer], camera, step=0.45)[0]
    origins, toward = camera.rays()
    toward = torch.nn.functional.normalize(toward, dim=-1)
    wanted = np.stack([
        [twin(layer, origins[0, j, i].numpy(), toward[0, j, i].numpy(), 0.45) for i in range(13)] for j in range(13)
    ])  # fmt: skip
    assert (wanted[..., 3] > 0.2).sum() >= 6
    # A sample on the border of two cells may count for either: one of about nine across a block.
    off = np.abs(image.numpy() - wanted).max(axis=-1)
    assert np.abs(image[..., 3].numpy() - wanted[..., 3]).max() < 0.15 and (off > 1e-5).sum() <= 3


def test_smooth_layers_are_linear_between_centres() -> None:
    """Seen along z, a ramp of optical depth along x is a ramp, whatever lies between the centres."""
    rgba = torch.zeros(1, 4, 64, 4, dtype=torch.uint8)
    rgba[..., 3] = torch.arange(64, dtype=torch.uint8)
    layer = VolumeLayer(rgba=rgba, origin=torch.zeros(3), spacing=torch.ones(3))
    camera = Cameras.look_at((32.0, 2.0, 5000.0), (32.0, 2.0, 0.0), width=128, height=4, fov_deg=0.02)
    depth = -torch.log1p(-render_volume([layer], camera)[0, 1, :, 3])
    table = -torch.log1p(-torch.arange(64) / 255.0)
    seen = depth[20:-20]
    assert bool((seen[1:] >= seen[:-1] - 1e-6).all())
    assert float((seen[1:] - seen[:-1]).amax()) < 1.5 * float((table[1:] - table[:-1]).amax())


def test_layers_mix_by_optical_depth() -> None:
    """Two layers in the same place are as dense as both; far apart, the nearer one covers the farther."""
    layer, camera = uniform(20, False), front()
    one, two = render_volume([layer], camera)[..., 3], render_volume([layer, layer], camera)[..., 3]
    assert torch.allclose(1 - two, (1 - one) ** 2, atol=1e-5)
    solid = Voxels.from_dense(torch.ones(1, 4, 4, 4), unit_grid(4))
    near = voxel_layer(solid, (1.0, 0.0, 0.0), 1.0)
    behind = VolumeLayer(rgba=voxel_layer(solid, (0.0, 1.0, 0.0), 1.0).rgba, origin=torch.tensor([0, 0, -9.0]),
                         spacing=torch.ones(3))  # fmt: skip
    camera = Cameras.look_at((2.0, 2.0, 40.0), (2.0, 2.0, 0.0), width=9, height=9, fov_deg=5)
    for order in ([near, behind], [behind, near]):
        middle = render_volume(order, camera)[0, 4, 4]
        assert float(middle[0]) > 0.99 and float(middle[1]) < 1e-3


@pytest.mark.parametrize("opacity", [1.0, 0.5])
def test_panes_stay_panes_however_opaque_walls_are(opacity: float) -> None:
    """A ray through panes that fill sides of cells loses what blending takes, whatever else the picture holds."""
    across = (torch.tensor([8.0, 0.0, 0.0]), torch.tensor([0.0, 8.0, 0.0]))
    for own, count in ((0.3, 1), (0.3, 3), (0.05, 2), (1.0, 1)):
        sheets = tuple(shapes.quad(torch.tensor([0.0, 0.0, 1.5 + 2 * k]), *across) for k in range(count))
        pane = Material(opacity=own, blend=own < 1.0, double_sided=True)
        surface = voxelize_scene(Scene(meshes=sheets, materials=(pane,)), unit_grid(8))
        image = render_volume([surface_layer(surface, opacity)], front(), step=0.02)
        wanted = 1.0 - (1.0 - opacity * own) ** count
        assert float(image[0, 12, 12, 3]) == pytest.approx(wanted, abs=0.015), (own, count)


def test_batch_of_cameras_and_what_misses() -> None:
    scene = Scene(meshes=(shapes.sphere(1.0, 32),))
    surface = voxelize_scene(scene, make_grid(scene.bounds[None], 32))
    layer = surface_layer(surface, 0.4, color=(0.2, 0.4, 0.9))
    views = [Cameras.look_at(eye, (0, 0, 0), width=20, height=20, fov_deg=50) for eye in ((0.0, 0, 4), (4.0, 0, 0))]
    both = render_volume([layer], Cameras.cat(views))
    for b, view in enumerate(views):
        assert torch.equal(render_volume([layer], view)[0], both[b])
    assert float(both[:, 0, 0].amax()) == 0.0 and float(both[:, 10, 10, 3].amin()) > 0.3
    picture = over_background(both, (0.5, 0.5, 0.5))
    assert torch.allclose(picture[:, 0, 0], torch.tensor(0.5))
    # The limb is seen along the surface, through more cells than the middle.
    assert float(both[0, 10, :, 3].amax()) > float(both[0, 10, 10, 3]) + 0.1


def test_light_is_brighter_where_it_falls() -> None:
    scene = Scene(meshes=(shapes.plane(torch.tensor([2.0, 2.0])),))
    surface = voxelize_scene(scene, make_grid(scene.bounds[None], 16))
    up = surface_layer(surface, 0.9, color=(1, 1, 1), light=VolumeLight(toward=(0, 1, 0), ambient=0.1))
    along = surface_layer(surface, 0.9, color=(1, 1, 1), light=VolumeLight(toward=(1, 0, 0), ambient=0.1))
    assert int(up.rgba[..., 0].amax()) == 255 and int(along.rgba[..., 0].amax()) < 100


def test_ct_with_voxels(data_dir) -> None:
    """A voxel ball inside the head is seen through it, and changes nothing where it is not."""
    ct = torch.from_numpy(np.load(data_dir / "volumes" / "head_ct_64x64x93.npy").astype(np.float32))
    transfer = [(400.0, (0.9, 0.6, 0.5), 0.0), (1000.0, (0.9, 0.6, 0.5), 0.03), (3000.0, (1.0, 1.0, 1.0), 0.3)]
    head = density_layer(ct, transfer, spacing=(3.2, 3.2, 1.5))
    centre = head.spacing * torch.tensor(head.dims) / 2
    ball = shapes.sphere(20.0, 32)
    scene = Scene(meshes=(type(ball)(vertices=ball.vertices + centre, faces=ball.faces, normals=ball.normals),))
    layer = surface_layer(voxelize_scene(scene, make_grid(scene.bounds[None], 24)), 0.9, color=(0.0, 0.1, 1.0))
    eye = (centre + torch.tensor([0.0, -400.0, 0.0])).tolist()
    camera = Cameras.look_at(eye, centre.tolist(), width=32, height=32, fov_deg=40, up=(0, 0, -1))
    alone, mixed = render_volume([head], camera)[0], render_volume([head, layer], camera)[0]
    assert float(alone[16, 16, 3]) > 0.2
    assert float(mixed[16, 16, 2] - mixed[16, 16, 0]) > float(alone[16, 16, 2] - alone[16, 16, 0]) + 0.1
    assert torch.allclose(mixed[2], alone[2], atol=2e-2)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: render_volume([], front()), "layers must not be empty"),
        (lambda: render_volume([uniform(9, True)], front(), step=0.0), "step must be"),
        (lambda: VolumeLayer(rgba=torch.zeros(2, 2, 2, 4), origin=torch.zeros(3), spacing=torch.ones(3)), "uint8"),
        (lambda: VolumeLight(ambient=2.0), "ambient must be"),
        (lambda: VolumeLight(toward=(0, 0, 0)), "toward must not be zero"),
        (lambda: density_layer(torch.zeros(2, 2, 2), [(1.0, 0.5, 0.1), (1.0, 0.5, 0.2)]), "ascending"),
        (lambda: density_layer(torch.full((2, 2, 2), torch.nan), [(1.0, 0.5, 0.1)]), "density must be finite"),
        (lambda: voxel_layer(Voxels.empty(unit_grid(2)), opacity=3.0), "opacity must be"),
    ],
)
def test_wrong_input_is_named(call: object, message: str) -> None:
    with pytest.raises((InputError, OptionError), match=message):
        call()  # type: ignore[operator]
