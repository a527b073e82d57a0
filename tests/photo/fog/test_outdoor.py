"""Fog outdoors: depth, light, layer, lamps, haze, photos of every kind."""

from __future__ import annotations

import math
import warnings

import numpy as np
import pytest
import torch
from PIL import Image

from torchrender.errors import ImageFileError, InputError, OptionError
from torchrender.images.files import read_image, write_image
from torchrender.photo.fog import FogMedium, FogOptions, FogPhoto, FogWarning, Marks, add_fog, outdoor
from torchrender.photo.fog import picture as fog_picture
from torchrender.photo.fog.depth.labels import SKY, depth_from_labels, label_map, outdoor_camera, read_labels
from torchrender.photo.fog.depth.measured import (
    dense_from_points,
    depth_from_points,
    depth_from_stereo,
    filled,
    read_depth,
    read_lidar,
)
from torchrender.photo.fog.depth.segments import cut_out, guess_sky
from torchrender.photo.fog.estimate import estimate_haze
from torchrender.photo.fog.marks.file import marks_of
from torchrender.photo.fog.outdoor import upper_share
from torchrender.photo.fog.picture import prepare

H, W = 60, 80
TABLE = {
    "camera": {"horizon": 25.0, "height": 1.6},
    "region": [{"label": "sky", "polygon": [[0, 0], [80, 0], [80, 25], [0, 25]]},
               {"label": "vertical", "polygon": [[10, 10], [20, 10], [20, 40], [10, 40]]}],
    "outdoor": {"near": 3.0, "far": 90.0},
}  # fmt: skip


def photo() -> torch.Tensor:
    picture = 0.1 + 0.1 * torch.rand(H, W, 3, generator=torch.Generator().manual_seed(2))
    picture[:25] = torch.tensor([0.5, 0.6, 0.8])
    return picture


def marks(**more: object) -> Marks:
    return marks_of({**TABLE, **more})


def test_depth_of_labels() -> None:
    m = marks()
    camera = outdoor_camera(m, W, H)
    found = depth_from_labels(label_map(m, W, H), m, camera)
    inverse = 1 / found.depth[26:, 50]
    assert torch.allclose(inverse[2:] - inverse[1:-1], (inverse[1:-1] - inverse[:-2]), atol=1e-12)
    first = int((found.label == 0).any(dim=1).nonzero()[0])
    ground = (found.label[first] == 0).nonzero()[0]
    assert float(found.depth[-1, 50]) == pytest.approx(3.0)
    assert float(found.depth[first, ground]) == pytest.approx(90.0)
    assert bool((found.depth[found.label == SKY] == found.depth.max()).all())
    standing = found.depth[12:40, 15]
    lowest = int((found.label == 1).any(dim=1).nonzero()[-1])
    assert bool((standing == standing[0]).all()) and float(standing[0]) == pytest.approx(float(found.depth[lowest, 50]))


def test_level_ground_without_depths_is_the_plane() -> None:
    m = marks(outdoor={})
    camera = outdoor_camera(m, W, H)
    found = depth_from_labels(label_map(m, W, H), m, camera)
    place = camera.unproject(torch.tensor([[[40.0, 50.5]]], dtype=torch.float64), found.depth[50, 40].reshape(1, 1))
    assert float(place[0, 0, 1]) == pytest.approx(0.0, abs=1e-9)
    assert not bool(camera.rays(torch.tensor([[[40.0, 25.0]]], dtype=torch.float64))[1][0, 0, 1].abs() > 1e-9)


def test_length_counts_along_the_ray() -> None:
    scene = FogPhoto(photo(), marks()).outdoors
    assert scene is not None
    corner = scene.camera.rays()[1][0][-1, 0].norm() * scene.depth[-1, 0]
    assert float(scene.length[-1, 0]) == pytest.approx(float(corner), rel=1e-6)


def test_layer_is_constant_airlight_in_its_limit() -> None:
    fog = FogPhoto(photo(), marks(), FogOptions(loss="none", matte_px=0))
    made = fog.foggy(FogMedium.of(visibility=50.0))
    scene = fog.outdoors
    assert scene is not None
    left = torch.exp(-3.912 / 50.0 * scene.length)[..., None]
    expected = photo() * left + 0.5 * scene.light.sky * (1 - left)
    below = scene.length * scene.direction[..., 1] < 98.0  # the layer ends at 100 m
    assert float((made.composite - expected)[below].abs().max()) < 1 / 255


@pytest.mark.parametrize("loss", ["absorbed", "single", "none"])
@pytest.mark.parametrize("eye", [1.6, 150.0])
def test_closed_forms_beside_steps(loss: str, eye: float) -> None:
    m = marks(camera={"horizon": 25.0, "height": eye},
              outdoor={"shadow": [[30, 50], [40, 50], [40, 58], [30, 58]],
                       "sunlit": [[50, 50], [70, 50], [70, 58], [50, 58]]})  # fmt: skip
    picture = photo()
    picture[:, 45:] *= 3.0
    fog = FogPhoto(picture, m, FogOptions(loss=loss, matte_px=0, top=60.0))
    scene = fog.outdoors
    assert scene is not None and float(scene.light.sun.min()) > 0
    medium = FogMedium.of(scattering=0.02, absorption=0.005, asymmetry=0.4)
    found = outdoor.scattered(scene, medium)
    kappa, lost = 0.025, {"single": 0.025, "absorbed": 0.005, "none": 0.0}[loss]
    sine = float(scene.light.to_sun[1])
    g = 0.4
    for row, column in ((5, 40), (40, 60), (55, 5)):
        way, length = scene.direction[row, column].double(), float(scene.length[row, column])
        steps = 200_000
        t = (torch.arange(steps, dtype=torch.float64) + 0.5) / steps * length
        height = scene.eye + way[1] * t
        inside = (height < 60.0).double()
        walked = torch.cumsum(inside, 0) * length / steps
        below = (60.0 - height).clamp_min(0.0)
        cosine = float(way @ scene.light.to_sun)
        phase = (1 - g * g) / (4 * math.pi * (1 + g * g - 2 * g * cosine) ** 1.5)
        upper = float(upper_share(way[1], g))
        if loss == "absorbed":
            upper += (1 - upper) * (1 - math.exp(-0.02 * 60.0))
        light = scene.light.sun[1] * phase * torch.exp(-lost * below / sine) + scene.light.sky[1] * upper * torch.exp(
            -2 * lost * below
        )
        slow = float((light * torch.exp(-kappa * walked) * inside * 0.02).sum() * length / steps)
        assert float(found[row, column, 1]) == pytest.approx(slow, rel=2e-3, abs=1e-7)


def test_share_from_above() -> None:
    rise = torch.linspace(-1, 1, 9)
    assert bool((upper_share(rise, 0.0) == 0.5).all())
    forward = upper_share(rise, 0.7)
    # Looking up into what scatters forwards, light from above comes on; up and down together are all there is.
    assert bool((forward[1:] > forward[:-1]).all())
    assert torch.allclose(forward + forward.flip(0), torch.ones(9), atol=0.01)


def test_light_is_found_again() -> None:
    sky, sun, albedo, sine = torch.tensor([0.4, 0.5, 0.7]), torch.tensor([2.0, 1.8, 1.5]), 0.2, 0.7
    picture = photo()
    shadow, lit = sky * albedo, sky * albedo + sun * albedo / math.pi * sine
    picture[50:58, 30:40], picture[50:58, 50:70] = shadow, lit
    m = marks(outdoor={"near": 3.0, "far": 90.0, "shadow": [[31, 51], [39, 51], [39, 57], [31, 57]],
                       "sunlit": [[51, 51], [69, 51], [69, 57], [51, 57]]})  # fmt: skip
    fog = FogPhoto(picture, m)
    assert fog.outdoors is not None
    light = fog.outdoors.light
    assert torch.allclose(light.sky, sky, rtol=0.05)
    assert torch.allclose(light.sun * float(light.to_sun[1]) / sine, sun, rtol=0.05)
    swapped = marks(outdoor={"shadow": m.outdoor.sunlit, "sunlit": m.outdoor.shadow})
    with pytest.warns(FogWarning, match="swapped"):
        FogPhoto(picture, swapped)


def test_sun_from_a_shadow() -> None:
    m = marks(outdoor={"near": 3.0, "far": 90.0, "object_top": [15, 12], "shadow_tip": [40, 50]})
    fog = FogPhoto(photo(), m)
    assert fog.outdoors is not None
    top, tip = (fog.camera.unproject(torch.tensor([[[x, y]]], dtype=torch.float64), fog.depth[y, x].reshape(1, 1))[0, 0]
                for x, y in ((15, 12), (40, 50)))  # fmt: skip
    assert torch.allclose(fog.outdoors.light.to_sun, torch.nn.functional.normalize(top - tip, dim=0))
    flipped = marks(outdoor={"object_top": [40, 50], "shadow_tip": [15, 12]})
    with pytest.warns(FogWarning, match="below one degree"):
        FogPhoto(photo(), flipped)
    with pytest.raises(InputError, match="outside the photo"):
        FogPhoto(photo(), marks(outdoor={"object_top": [400, 5], "shadow_tip": [1, 50]}))


def test_lamp_is_brightest_where_it_stands_and_hidden_by_depth() -> None:
    lamp = {"at": [50, 35], "distance": 12.0, "color": [1.0, 0.8, 0.5]}
    medium = FogMedium.of(visibility=60.0)
    bare = FogPhoto(photo(), marks()).foggy(medium).scattered
    halo = FogPhoto(photo(), marks(lamp=[lamp])).foggy(medium).scattered - bare
    assert float(halo[33:37, 48:52].mean()) > 10 * float(halo.median())
    hidden = FogPhoto(photo(), marks(lamp=[lamp]), depth=torch.full((H, W), 6.0)).foggy(medium).scattered
    open_ = FogPhoto(photo(), marks(), depth=torch.full((H, W), 6.0)).foggy(medium).scattered
    assert float((hidden - open_).max()) < 0.2 * float(halo.max())
    with pytest.raises(InputError, match=r"lamp\[0\] lies outside"):
        FogPhoto(photo(), marks(lamp=[{"at": [500, 3]}]))


def test_own_fog_is_found_again() -> None:
    random = torch.Generator().manual_seed(5)
    length = 5 + 145 * torch.rand(150, 200, generator=random)
    clear = torch.rand(150, 200, 3, generator=random) ** 2 * 0.6
    for visibility in (60.0, 200.0):
        left = torch.exp(-3.912 / visibility * length)[..., None]
        airlight = torch.tensor([0.6, 0.65, 0.7])
        haze = estimate_haze(clear * left + airlight * (1 - left), length)
        assert haze.visibility == pytest.approx(visibility, rel=0.1)
        assert torch.allclose(haze.airlight, airlight, rtol=0.1)
        near = length < 30.0
        assert torch.allclose(haze.lifted(haze.moved(clear, length), length)[near], clear[near], atol=1e-3)
    with pytest.raises(InputError, match="depths must vary"):
        estimate_haze(clear, torch.full((150, 200), 5.0))


@pytest.mark.parametrize("channels", [1, 2, 3, 4])
def test_photos_of_any_channels(channels: int) -> None:
    picture = torch.rand(H, W, channels, generator=torch.Generator().manual_seed(1))
    made = FogPhoto(picture, marks()).foggy(FogMedium.of(visibility=80.0))
    assert made.composite.shape[2] == (4 if channels in (2, 4) else 3)
    if channels == 4:
        assert torch.equal(made.composite[..., 3], picture[..., 3])


def test_codes_and_turned_photos(tmp_path) -> None:
    codes = (np.random.default_rng(0).random((H, W)) * 65535).astype(np.uint16)
    Image.fromarray(codes).save(tmp_path / "deep.png")
    turned = Image.fromarray((photo().numpy() * 255).astype(np.uint8).transpose(1, 0, 2).copy())
    exif = turned.getexif()
    exif[0x0112] = 6
    turned.save(tmp_path / "turned.jpg", exif=exif)
    for name in ("deep.png", "turned.jpg"):
        picture = read_image(tmp_path / name)
        clear = FogPhoto(picture, marks()).foggy(FogMedium.of(scattering=0.0))
        assert picture.shape[:2] == (H, W)
        assert float((clear.composite - picture).abs().max()) <= 1 / 255


def test_large_photos_are_halved_and_said(monkeypatch: pytest.MonkeyPatch) -> None:
    large = torch.zeros(3000, 4000, 3)
    with pytest.warns(FogWarning, match="4000 x 3000 pixels: fog is computed at 1/2"):
        assert prepare(large).work_size == (1500, 2000)
    # The same with a small photo, so that what comes out can be looked at.
    picture = photo().repeat_interleave(4, 0).repeat_interleave(4, 1)
    given, medium = marks(photo={"width": 80, "height": 60}), FogMedium.of(visibility=80.0)
    with pytest.warns(FogWarning, match="are stretched"):
        whole = FogPhoto(picture, given).foggy(medium)
    monkeypatch.setattr(fog_picture, "MAX_PIXELS", H * W * 5)
    with pytest.warns(FogWarning, match="1/2"), warnings.catch_warnings():
        warnings.filterwarnings("ignore", message="the marks are those", category=FogWarning)
        made = FogPhoto(picture, given).foggy(medium)
    assert made.composite.shape == picture.shape
    assert float((made.composite - whole.composite).abs().mean()) < 0.003


def test_batches_are_their_photos() -> None:
    batch = torch.stack([photo(), photo().flip(1)])
    medium = FogMedium.of(visibility=80.0)
    both = add_fog(batch, marks(), medium)
    for k in range(2):
        assert torch.equal(both[k].composite, FogPhoto(batch[k], marks()).foggy(medium).composite)


def test_bad_photos_and_media_are_named() -> None:
    for bad in (torch.zeros(4), torch.zeros(4, 4, 7), torch.full((H, W, 3), math.nan), torch.zeros(H, W, 3).byte()):
        with pytest.raises(InputError, match="photo"):
            FogPhoto(bad, marks())
    with pytest.raises(InputError, match="marks are those of a photo"):
        FogPhoto(photo(), marks(photo={"width": 100, "height": 30}))
    with pytest.raises(OptionError, match="either visibility or scattering"):
        FogMedium.of()
    with pytest.raises(OptionError, match="absorption must be at most"):
        FogMedium.of(visibility=100.0, absorption=1.0)
    with pytest.raises(InputError, match="needs labels or regions"):
        FogPhoto(photo(), Marks())
    with pytest.raises(InputError, match="density must be None outdoors"):
        FogPhoto(photo(), marks()).foggy(FogMedium.of(scattering=0.1, density=torch.ones(2, 2, 2)))


def test_depth_files(tmp_path) -> None:
    depth = np.full((H, W), 4000, np.uint16)
    depth[:5] = 0
    Image.fromarray(depth).save(tmp_path / "d.png")
    np.save(tmp_path / "d.npy", depth / 1000.0)
    for name in ("d.png", "d.npy"):
        found = read_depth(tmp_path / name)
        assert float(found[10, 10]) == 4.0 and bool(torch.isinf(found[0]).all())
        assert float(filled(found).max()) == 4.0
    with pytest.raises(InputError, match="knows no pixel"):
        filled(torch.zeros(3, 3))
    (tmp_path / "bad.npy").write_bytes(b"nothing")
    for name in ("bad.npy", "none.png", "d.bmp"):
        with pytest.raises(ImageFileError):
            read_depth(tmp_path / name)
    Image.fromarray(np.zeros((H, W, 3), np.uint8)).save(tmp_path / "colour.png")
    with pytest.raises(ImageFileError, match="one plane"):
        read_labels(tmp_path / "colour.png")


def test_depth_is_the_plane_that_says_so(tmp_path) -> None:
    """Of pictures with depth that this project, Blender and others write; never a colour, never a guess."""
    depth, red = torch.full((4, 5), 7.0), torch.full((4, 5, 3), 0.25)
    whole = torch.cat([red, depth[..., None]], dim=2)
    planes = {
        "z": (depth, "Z"), "rgbz": (whole, "RGBZ"), "v": (depth, "V"), "y": (depth, "Y"),
        "layer": (whole, ("L.R", "L.G", "L.B", "L.Depth.Z")),
        "alpha": (torch.stack([depth, torch.ones(4, 5)], dim=2), "YA"),
    }  # fmt: skip
    for name, (values, channels) in planes.items():
        write_image(tmp_path / f"{name}.exr", values, channels=tuple(channels))
        assert bool((read_depth(tmp_path / f"{name}.exr") == 7.0).all()), name
    write_image(tmp_path / "rgb.exr", red)
    with pytest.raises(ImageFileError, match="Z or Y, has B, G, R"):
        read_depth(tmp_path / "rgb.exr")
    mask = np.ones((4, 5), np.float32)
    np.savez(tmp_path / "two.npz", mask=mask, depth=7 * mask)
    np.savez(tmp_path / "one.npz", anything=7 * mask)
    for name in ("one.npz", "two.npz"):
        assert bool((read_depth(tmp_path / name) == 7.0).all())
    np.savez(tmp_path / "odd.npz", mask=mask, z=7 * mask)
    with pytest.raises(ImageFileError, match="named depth, has mask, z"):
        read_depth(tmp_path / "odd.npz")
    Image.fromarray(np.full((4, 5), 130, np.uint8)).save(tmp_path / "eight.png")
    with pytest.raises(ImageFileError, match="8 bits"):
        read_depth(tmp_path / "eight.png")
    assert bool((read_depth(tmp_path / "eight.png", 0.1) == 13.0).all())


def test_stereo_finds_a_plane() -> None:
    texture = torch.rand(80, 240, 1, generator=torch.Generator().manual_seed(3)).expand(-1, -1, 3)
    left, right = texture[:, :200], texture[:, 8:208]
    found = depth_from_stereo(left, right, focal=400.0, baseline=0.1, disparities=32)
    known = torch.isfinite(found)
    assert float(known.float().mean()) > 0.5
    assert float(found[known].median()) == pytest.approx(400 * 0.1 / 8, rel=0.02)
    with pytest.raises(InputError, match="one size"):
        depth_from_stereo(left, right[:, :50], focal=400.0, baseline=0.1)


def test_nearest_point_counts(tmp_path) -> None:
    projection = torch.tensor([[10.0, 0, 5, 0], [0, 10.0, 5, 0], [0, 0, 1, 0]])
    points = torch.tensor([[0.0, 0, 4], [0, 0, 2], [0, 0, -3], [9, 9, 1]])
    sparse = depth_from_points(points, projection, 10, 10)
    assert float(sparse[5, 5]) == 2.0 and int(torch.isfinite(sparse).sum()) == 1
    assert float(dense_from_points(sparse)[5, 6]) == pytest.approx(2.0, rel=1e-5)
    (tmp_path / "p.bin").write_bytes(b"12345")
    with pytest.raises(ImageFileError):
        read_lidar(tmp_path / "p.bin", tmp_path / "none.txt")


def test_strokes_and_sky() -> None:
    picture = photo()
    sky = guess_sky(picture)
    assert float(sky[:24].float().mean()) > 0.95 and float(sky[27:].float().mean()) < 0.02
    inside, outside = torch.zeros(H, W, dtype=torch.bool), torch.zeros(H, W, dtype=torch.bool)
    inside[5:8, 5:70], outside[50:53, 5:70] = True, True
    found = cut_out(picture, inside, outside)
    assert float(found[:24].float().mean()) > 0.95 and float(found[30:].float().mean()) < 0.05
    with pytest.raises(InputError, match="inside has no pixel"):
        cut_out(picture, torch.zeros_like(inside), outside)
