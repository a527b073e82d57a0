from __future__ import annotations

import sys
from pathlib import Path

import cv2
import numpy as np
import OpenEXR
import pytest
import torch
from PIL import Image

from torchrender.errors import ImageFileError, InputError
from torchrender.images import files as image_io
from torchrender.images.exr import upsample_chroma
from torchrender.images.files import read_image, read_image_bytes, write_bytes, write_image, write_npz
from torchrender.numerics.color import linear_from_srgb, srgb_from_linear

# Kind, size (W,H,C) and largest value, from the description of the data. Decoders differ by half a step of the
# shared-exponent mantissa in HDR files, hence the tolerance.
ENVIRONMENTS = {
    "grace_latlong_small.hdr": (256, 128, 3512.0),
    "pisa_latlong_small.hdr": (256, 128, 3.945),
    "lobby_1k.hdr": (1024, 512, 1276.0),
    "park_1k.hdr": (1024, 512, 6.938e4),
    "museum.exr": (512, 256, 19.28),
    "blender_interior.exr": (1024, 512, 3.395e4),
    "blender_courtyard.exr": (1024, 512, 55.56),
}
PHOTOS = {
    "Desk.exr": (644, 874, 4),
    "Carrots.exr": (600, 400, 4),
    "MtTamNorth.exr": (1198, 796, 3),
    "MtTamNorth.jpg": (1198, 796, 3),
    "motorcycle_left.png": (741, 500, 3),
    "coffee.png": (600, 400, 3),
    "gravel.png": (512, 512, 1),
    "grass.png": (512, 512, 1),
    "brick.png": (512, 512, 1),
    "leuvenA.jpg": (751, 563, 3),
    "building.jpg": (868, 600, 3),
    "china.jpg": (640, 427, 3),
}


@pytest.mark.parametrize("name", ENVIRONMENTS)
def test_environments_load(data_dir: Path, name: str) -> None:
    width, height, largest = ENVIRONMENTS[name]
    image = read_image(data_dir / "envmaps" / name)
    assert image.shape == (height, width, 3)
    assert image.dtype == torch.float32
    assert bool(torch.isfinite(image).all())
    assert float(image.max()) == pytest.approx(largest, rel=5e-3)


@pytest.mark.parametrize("name", PHOTOS)
def test_photos_load(data_dir: Path, name: str) -> None:
    width, height, channels = PHOTOS[name]
    image = read_image(data_dir / "photos" / name)
    assert image.shape == (height, width, channels)
    assert bool(torch.isfinite(image).all())
    # Photographs in EXR may hold small negative values: colours outside the primaries.
    assert float(image.min()) >= (-0.05 if name.endswith("exr") else 0.0)


def test_luminance_chroma_looks_like_the_published_jpeg(data_dir: Path) -> None:
    hdr = read_image(data_dir / "photos" / "MtTamNorth.exr").clamp(0, 1)
    jpeg = read_image(data_dir / "photos" / "MtTamNorth.jpg")
    for channel in range(3):
        pair = torch.stack([hdr[..., channel].flatten(), jpeg[..., channel].flatten()]).sqrt()
        assert float(torch.corrcoef(pair)[0, 1]) > 0.998


@pytest.mark.parametrize("size", [8, 9])
def test_chroma_upsampling_keeps_samples_and_smooth_signals(size: int) -> None:
    t = np.arange(4 * size, dtype=np.float32)
    signal = np.sin(t / 9)[:, None].repeat(2, axis=1)
    out = upsample_chroma(signal[::2], 0, len(t))
    np.testing.assert_array_equal(out[::2], signal[::2])
    np.testing.assert_allclose(out[14:-14], signal[14:-14], atol=1e-3)
    assert upsample_chroma(signal[:size, :1], 0, 2 * size - 1).shape == (2 * size - 1, 1)


@pytest.mark.parametrize(("mode", "channels"), [("L", 1), ("LA", 2), ("RGB", 3), ("RGBA", 4)])
def test_png_bytes_round_trip(tmp_path: Path, mode: str, channels: int) -> None:
    codes = np.random.default_rng(1).integers(0, 256, (5, 7, channels), dtype=np.uint8)
    Image.fromarray(codes[..., 0] if channels == 1 else codes, mode).save(tmp_path / "a.png")
    image = read_image(tmp_path / "a.png")
    colors = 1 if channels < 3 else 3
    expected = torch.from_numpy(codes / 255.0)
    torch.testing.assert_close(
        image[..., :colors].double(), linear_from_srgb(expected[..., :colors]), rtol=0, atol=1e-7
    )
    torch.testing.assert_close(image[..., colors:].double(), expected[..., colors:], rtol=0, atol=1e-7)
    write_image(tmp_path / "b.png", image)
    assert torch.equal(read_image(tmp_path / "b.png"), image)


def test_palette_and_one_bit_pictures(tmp_path: Path) -> None:
    codes = np.array([[[255, 0, 0], [0, 255, 0]]], dtype=np.uint8)
    Image.fromarray(codes).quantize(4).save(tmp_path / "p.png")
    torch.testing.assert_close(read_image(tmp_path / "p.png"), torch.tensor([[[1.0, 0, 0], [0, 1.0, 0]]]))
    Image.fromarray(np.array([[0, 255]], dtype=np.uint8)).convert("1").save(tmp_path / "1.png")
    torch.testing.assert_close(read_image(tmp_path / "1.png"), torch.tensor([[[0.0], [1.0]]]))


@pytest.mark.parametrize("channels", [1, 3, 4])
def test_sixteen_bit_png_keeps_its_precision(tmp_path: Path, channels: int) -> None:
    codes = np.random.default_rng(2).integers(0, 65536, (4, 6, channels), dtype=np.uint16)
    stored = codes if channels == 1 else codes[..., [2, 1, 0, 3][:channels]]
    assert cv2.imwrite(str(tmp_path / "deep.png"), stored)
    image = read_image(tmp_path / "deep.png")
    assert image.shape == (4, 6, channels)
    colors = min(channels, 3)
    back = srgb_from_linear(image[..., :colors].double()) * 65535
    np.testing.assert_allclose(back.numpy(), codes[..., :colors], atol=0.02)
    np.testing.assert_allclose(image[..., colors:].numpy() * 65535, codes[..., colors:], atol=0.02)


def test_orientation_tag_is_applied(tmp_path: Path) -> None:
    picture = Image.fromarray(np.full((4, 8, 3), 128, np.uint8))
    exif = Image.Exif()
    exif[0x0112] = 6
    picture.save(tmp_path / "turned.jpg", exif=exif)
    assert read_image(tmp_path / "turned.jpg").shape == (8, 4, 3)


@pytest.mark.parametrize("channels", [1, 2, 3, 4])
def test_exr_round_trip_is_exact(tmp_path: Path, channels: int) -> None:
    image = torch.randn(6, 5, channels) * 1e3
    image[0, 0, 0] = torch.inf
    write_image(tmp_path / "a.exr", image)
    assert torch.equal(read_image(tmp_path / "a.exr"), image)


def test_exr_named_channels(tmp_path: Path) -> None:
    image = torch.rand(3, 4, 2)
    write_image(tmp_path / "a.exr", image, channels=("depth", "object"))
    with OpenEXR.File(str(tmp_path / "a.exr"), separate_channels=True) as file:
        np.testing.assert_array_equal(file.channels()["object"].pixels, image[..., 1].numpy())
    with pytest.raises(ImageFileError, match=r"needs channels R, G, B or Y, has depth, object"):
        read_image(tmp_path / "a.exr")


def test_exr_layers_and_half_floats(tmp_path: Path) -> None:
    planes = {f"view.{c}": np.full((2, 3), k, np.float16) for k, c in enumerate("RGBA")}
    with OpenEXR.File({"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}, planes) as file:
        file.write(str(tmp_path / "layer.exr"))
    expected = torch.tensor([0.0, 1.0, 2.0, 3.0]).expand(2, 3, 4)
    assert torch.equal(read_image(tmp_path / "layer.exr"), expected)


def test_bytes_and_file_agree(data_dir: Path) -> None:
    for name in ("photos/coffee.png", "envmaps/museum.exr", "envmaps/pisa_latlong_small.hdr"):
        assert torch.equal(read_image_bytes((data_dir / name).read_bytes(), name), read_image(data_dir / name))


def test_npz(tmp_path: Path) -> None:
    write_npz(tmp_path / "a.npz", {"depth": torch.arange(4.0), "id": np.array([1, -1])})
    with np.load(tmp_path / "a.npz") as back:
        assert back["depth"].tolist() == [0, 1, 2, 3]
        assert back["id"].dtype == np.int64
    with pytest.raises(ImageFileError, match="npz"):
        write_npz(tmp_path / "a.zip", {})


def test_png_is_clamped_and_rounded(tmp_path: Path) -> None:
    write_image(tmp_path / "a.png", torch.tensor([[-1.0, 0.0, 0.216, 1.0, torch.inf]]))
    assert np.asarray(Image.open(tmp_path / "a.png")).tolist() == [[0, 0, 128, 255, 255]]


def test_bad_arguments(tmp_path: Path) -> None:
    with pytest.raises(ImageFileError, match=r"supported: \.png, \.exr"):
        write_image(tmp_path / "a.jpg", torch.zeros(2, 2, 3))
    with pytest.raises(ImageFileError, match=r"folder .* does not exist"):
        write_image(tmp_path / "no" / "a.png", torch.zeros(2, 2, 3))
    with pytest.raises(InputError, match="NaN"):
        write_image(tmp_path / "a.png", torch.full((2, 2, 3), torch.nan))
    with pytest.raises(InputError, match="shape"):
        write_image(tmp_path / "a.png", torch.zeros(1, 2, 2, 3))
    with pytest.raises(InputError, match="1 to 4 channels"):
        write_image(tmp_path / "a.png", torch.zeros(2, 2, 5))
    with pytest.raises(InputError, match="2 different names"):
        write_image(tmp_path / "a.exr", torch.zeros(2, 2, 2), channels=("a", "a"))
    assert list(tmp_path.iterdir()) == []


def test_failed_write_leaves_the_old_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    target = tmp_path / "a.exr"
    write_image(target, torch.zeros(2, 2, 3))
    before = target.read_bytes()

    def broken(path: Path, _: object) -> None:
        path.write_bytes(b"half a pict")
        raise OSError("disk full")

    monkeypatch.setattr(image_io, "write_exr", broken)
    with pytest.raises(ImageFileError, match="disk full"):
        write_image(target, torch.ones(2, 2, 3))
    assert target.read_bytes() == before
    assert [p.name for p in tmp_path.iterdir()] == ["a.exr"]


@pytest.mark.skipif(sys.platform == "win32", reason="its names are shorter")
def test_names_as_long_as_files_may_have_are_taken_and_longer_ones_refused(tmp_path: Path) -> None:
    longest = tmp_path / ("n" * 251 + ".png")
    write_bytes(longest, b"1")
    assert longest.read_bytes() == b"1"
    with pytest.raises(ImageFileError, match="cannot be written"):
        write_bytes(tmp_path / ("n" * 260 + ".png"), b"1")
    assert list(tmp_path.iterdir()) == [longest]
