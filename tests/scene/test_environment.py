"""Light from everywhere: irradiance and filtered light beside integrals over the pixels, and the sun apart."""

from __future__ import annotations

import math
from pathlib import Path

import pytest
import torch
from torch import Tensor

from torchrender.errors import ImageFileError, InputError, OptionError
from torchrender.images.exr import write_exr
from torchrender.images.files import read_image
from torchrender.scene.environment import Environment
from torchrender.scene.light import DirectionalLight
from torchrender.scene.model import Scene
from torchrender.scene.sky.irradiance import latlong_directions

MAPS = (
    *("blender_courtyard.exr", "blender_interior.exr", "forest.hdr", "grace_latlong_small.hdr", "lobby_1k.hdr"),
    *("museum.exr", "park_1k.hdr", "pisa_latlong_small.hdr", "studio.hdr"),
)


def units(count: int, seed: int = 0) -> Tensor:
    made = torch.Generator().manual_seed(seed)
    return torch.nn.functional.normalize(torch.randn(count, 3, generator=made), dim=-1)


def pixels(height: int, width: int) -> tuple[Tensor, Tensor]:
    """Directions (N,3) and solid angles (N,1) of a picture's pixels, from their edges."""
    edges = torch.cos(torch.linspace(0, math.pi, height + 1, dtype=torch.float64))
    solid = ((edges[:-1] - edges[1:]) * 2 * math.pi / width)[:, None].expand(height, width).reshape(-1, 1)
    return latlong_directions(height, width).reshape(-1, 3), solid.float()


def integral(radiance: Tensor, normals: Tensor) -> Tensor:
    """Irradiance (N,3), pixel by pixel."""
    directions, solid = pixels(*radiance.shape[:2])
    light = radiance.reshape(-1, 3) * solid
    return torch.cat([(part @ directions.T).clamp_min(0.0) @ light for part in normals.split(16)])


def sun_sky(*, height: int = 64, sun: tuple[int, int] = (16, 40), power: float = 4000.0) -> Tensor:
    sky = torch.full((height, 2 * height, 3), 0.3)
    sky[height // 2 :] = 0.05
    sky[sun] = torch.tensor([power, 0.9 * power, 0.7 * power])
    return sky


@pytest.mark.parametrize("name", MAPS)
def test_irradiance_of_photographed_skies_is_the_integral(data_dir: Path, name: str) -> None:
    radiance = read_image(data_dir / "envmaps" / name)[..., :3].clamp_min(0.0)
    normals = units(64)
    exact = integral(radiance, normals)
    error = (Environment(radiance=radiance).irradiance(normals) / exact - 1).abs()
    assert float(error.max()) < 0.02 and float(error.mean()) < 2e-3


def test_irradiance_of_one_bright_pixel_is_its_cosine() -> None:
    sky = torch.zeros(128, 256, 3)
    sky[40, 77] = 1e5
    directions, solid = pixels(128, 256)
    towards, size = directions[40 * 256 + 77], float(solid[40 * 256 + 77])
    normals = units(200)
    expected = 1e5 * size * (normals @ towards).clamp_min(0.0)[:, None].expand(200, 3)
    torch.testing.assert_close(Environment(radiance=sky).irradiance(normals), expected, rtol=2e-3, atol=1e-3)


def test_a_turned_sky_lights_turned_surfaces_alike() -> None:
    sky = torch.rand(32, 64, 3, generator=torch.Generator().manual_seed(3))
    turned = Environment(radiance=sky, rotation_deg=90.0)
    plain = Environment(radiance=sky)
    normals = units(50)
    onward = torch.stack([-normals[:, 2], normals[:, 1], normals[:, 0]], dim=-1)  # a quarter to the right
    torch.testing.assert_close(turned.lookup(normals), plain.lookup(onward), atol=1e-4, rtol=0)
    torch.testing.assert_close(turned.irradiance(normals), plain.irradiance(onward), rtol=1e-4, atol=1e-5)
    rough = torch.full((50,), 0.6)
    torch.testing.assert_close(turned.prefiltered(normals, rough), plain.prefiltered(onward, rough), rtol=1e-3, atol=0)


def test_irradiance_has_gradients() -> None:
    sky = torch.rand(8, 16, 3, generator=torch.Generator().manual_seed(3)).requires_grad_()
    normals = units(4)
    environment = Environment(radiance=sky)
    total = environment.irradiance(normals).sum()
    total.backward()
    assert sky.grad is not None
    # Irradiance is linear in radiance.
    assert float((sky.grad * sky.detach()).sum()) == pytest.approx(float(total.detach()), rel=1e-4)
    assert Environment(radiance=sky.detach()).irradiance(normals).sum() == pytest.approx(
        float(total.detach()), rel=1e-4
    )


@pytest.mark.parametrize("roughness", [0.25, 0.5, 1.0])
@pytest.mark.parametrize("name", ["park_1k.hdr", "pisa_latlong_small.hdr"])
def test_filtered_skies_are_means_over_the_lobe(data_dir: Path, name: str, roughness: float) -> None:
    radiance = read_image(data_dir / "envmaps" / name)[..., :3].clamp_min(0.0)
    mirrored = units(40)
    directions, solid = pixels(*radiance.shape[:2])
    alpha = roughness**2
    exact = []
    for part in mirrored.split(8):
        cosine = (part @ directions.T).clamp(-1.0, 1.0)
        lobe = (alpha / ((1 + cosine) / 2 * (alpha**2 - 1) + 1)).square() * cosine.clamp_min(0.0) * solid.T
        exact.append(lobe @ radiance.reshape(-1, 3) / lobe.sum(dim=1, keepdim=True))
    found = Environment(radiance=radiance).prefiltered(mirrored, torch.tensor(roughness))
    error = (found / torch.cat(exact) - 1).abs()
    assert float(error.median()) < 0.01 and float(error.quantile(0.9)) < 0.04


@pytest.mark.parametrize("roughness", [0.0, 0.05, 0.3, 0.77, 1.0])
def test_a_white_surrounding_looks_the_same_in_every_mirror(roughness: float) -> None:
    white = Environment.constant(torch.tensor([1.0, 0.5, 2.0]))
    seen = white.prefiltered(units(20), torch.full((20,), roughness))
    torch.testing.assert_close(seen, torch.tensor([1.0, 0.5, 2.0]).expand(20, 3), rtol=1e-4, atol=0)


def test_a_perfect_mirror_shows_the_picture() -> None:
    sky = Environment(radiance=torch.rand(16, 32, 3, generator=torch.Generator().manual_seed(3)), intensity=2.0)
    torch.testing.assert_close(sky.prefiltered(units(20), torch.zeros(20)), sky.lookup(units(20)))


def test_filtering_says_that_it_gives_radiance_no_gradient() -> None:
    sky = Environment(radiance=torch.rand(8, 16, 3).requires_grad_())
    with pytest.raises(InputError, match="radiance"):
        sky.prefiltered(units(2), torch.full((2,), 0.5))


# ----------------------------------------------------------------------- sun


@pytest.mark.parametrize("rotation", [0.0, 70.0])
def test_the_sun_becomes_a_light_and_no_light_is_lost(rotation: float) -> None:
    whole = Environment(radiance=sun_sky(), intensity=1.5, rotation_deg=rotation)
    rest, sun = whole.split_sun()
    assert isinstance(sun, DirectionalLight)
    towards = latlong_directions(64, 128)[16, 40]
    angle = math.radians(rotation)
    x, y, z = towards.tolist()
    seen = torch.tensor([math.cos(angle) * x + math.sin(angle) * z, y, math.cos(angle) * z - math.sin(angle) * x])
    torch.testing.assert_close(-sun.direction, seen, atol=1e-3, rtol=0)
    normals = units(100)
    light = (normals @ -sun.direction).clamp_min(0.0)[:, None] * sun.irradiance
    torch.testing.assert_close(rest.irradiance(normals) + light, whole.irradiance(normals), rtol=5e-3, atol=5e-3)
    assert float(rest.radiance.max()) < 1.0
    torch.testing.assert_close(rest.background(seen[None]), whole.lookup(seen[None]))
    again, none = rest.split_sun()
    assert again is rest and none is None


def test_softboxes_and_overcast_skies_have_no_sun() -> None:
    box = torch.full((64, 128, 3), 0.1)
    box[10:20, 30:50] = 50.0
    weak = sun_sky(power=3.0)
    for sky in (box, weak, torch.rand(64, 128, 3), torch.ones(1, 1, 3), torch.zeros(64, 128, 3)):
        environment = Environment(radiance=sky)
        rest, sun = environment.split_sun()
        assert rest is environment and sun is None


@pytest.mark.parametrize(("name", "expected"), [("park_1k.hdr", True), ("pisa_latlong_small.hdr", False)])
def test_suns_of_photographed_skies(data_dir: Path, name: str, expected: bool) -> None:
    environment = Environment(radiance=read_image(data_dir / "envmaps" / name)[..., :3])
    rest, sun = environment.split_sun()
    assert (sun is not None) == expected
    if sun is not None:
        normals = units(40)
        light = (normals @ -sun.direction).clamp_min(0.0)[:, None] * sun.irradiance
        torch.testing.assert_close(rest.irradiance(normals) + light, environment.irradiance(normals), rtol=0.02, atol=0)


def test_a_scene_under_a_sun_has_its_light() -> None:
    scene = Scene(environment=Environment(radiance=sun_sky()))
    lit = scene.with_sun_apart()
    assert len(lit.lights) == 1 and lit.environment is not scene.environment
    assert lit.with_sun_apart() is lit
    dark = Scene(environment=Environment.constant(torch.ones(3)))
    assert dark.with_sun_apart() is dark


# ----------------------------------------------------------------- bad input


@pytest.mark.parametrize("dtype", [torch.float16, torch.float64, torch.bfloat16])
def test_pictures_of_any_float_type_are_taken(dtype: torch.dtype) -> None:
    sky = Environment(radiance=torch.full((4, 8, 3), 0.5, dtype=dtype))
    assert sky.lookup(units(3)).dtype == torch.float32
    torch.testing.assert_close(sky.irradiance(units(3)), torch.full((3, 3), math.pi / 2), rtol=1e-3, atol=0)


@pytest.mark.parametrize(
    "radiance",
    [
        torch.zeros(4, 8, 3, dtype=torch.uint8),
        torch.full((4, 8, 3), -1.0),
        torch.full((4, 8, 3), math.nan),
        torch.full((4, 8, 3), 1e300, dtype=torch.float64),
        torch.zeros(4, 8),
        torch.zeros(0, 8, 3),
    ],
)
def test_bad_pictures_are_named(radiance: Tensor) -> None:
    with pytest.raises(InputError, match="environment 'sky': radiance"):
        Environment(radiance=radiance, name="sky")
    with pytest.raises(OptionError, match="intensity"):
        Environment(radiance=torch.ones(1, 1, 3), intensity=-1.0)


def test_the_last_column_goes_over_into_the_first() -> None:
    """Behind the viewer, at azimuth 180 degrees, both stand side by side."""
    radiance = torch.rand(9, 6, 3, generator=torch.Generator().manual_seed(2))
    behind = Environment(radiance=radiance).lookup(torch.tensor([0.0, 0.0, 1.0]))
    torch.testing.assert_close(behind, (radiance[4, 0] + radiance[4, -1]) / 2, atol=1e-5, rtol=0)


def test_intensities_multiply_all_that_is_looked_up() -> None:
    sky = Environment(radiance=torch.full((4, 8, 3), 0.25), intensity=2.0)
    up = torch.tensor([0.0, 1.0, 0.0])
    for found, wanted in ((sky.lookup(up), 0.5), (sky.irradiance(up), 0.5 * math.pi), (sky.background(up), 0.5)):
        torch.testing.assert_close(found, torch.full((3,), wanted), rtol=0.01, atol=0)


def test_cameras_see_the_picture_that_holds_the_sun() -> None:
    sky = Environment(radiance=torch.zeros(4, 8, 3), shown=torch.ones(4, 8, 3))
    up = torch.tensor([0.0, 1.0, 0.0])
    assert float(sky.lookup(up).max()) == 0.0 and float(sky.background(up).min()) == 1.0


def test_environments_come_from_files_and_arrays(tmp_path: Path) -> None:
    picture = torch.rand(4, 8, 3)
    write_exr(tmp_path / "sky.exr", {name: picture[..., k] for k, name in enumerate("RGB")})
    made = Environment.load(tmp_path / "sky.exr", intensity=2.0, rotation_deg=30.0)
    assert (made.name, made.intensity, made.rotation_deg) == ("sky", 2.0, 30.0)
    torch.testing.assert_close(made.radiance, picture, rtol=1e-3, atol=1e-3)
    assert torch.equal(Environment(radiance=picture.numpy()).radiance, picture)
    with pytest.raises(ImageFileError, match="no such file"):
        Environment.load(tmp_path / "none.hdr")


@pytest.mark.parametrize(
    ("given", "told"),
    [
        ("studio.hdr", r"take Environment\.load\('studio\.hdr'\)"),
        (Path("studio.hdr"), r"take Environment\.load\('studio\.hdr'\)"),
        (torch.ones(2, 4, 3), r"take Environment\(radiance=\.\.\.\)"),
        (3, "must be an Environment, got int"),
    ],
)
def test_what_is_no_environment_is_refused_by_the_scene(given: object, told: str) -> None:
    with pytest.raises(InputError, match=told):
        Scene(environment=given)  # type: ignore[arg-type]


def test_files_and_codes_are_no_radiance() -> None:
    word: object = "studio.hdr"
    with pytest.raises(InputError, match=r"take Environment\.load\('studio\.hdr'\)"):
        Environment(radiance=word)  # type: ignore[arg-type]
    with pytest.raises(InputError, match=r"must hold floats in linear light, got uint8: divide"):
        Environment(radiance=torch.zeros(2, 4, 3, dtype=torch.uint8))


def test_pictures_of_few_columns_light_as_what_cameras_see_of_them() -> None:
    """Interpolated between columns, however wide these are."""
    rows = 128
    few = Environment(radiance=torch.rand(rows, 4, 3, generator=torch.Generator().manual_seed(3)))
    many = Environment(radiance=few.lookup(latlong_directions(rows, 2 * rows)))
    normals = units(40)
    torch.testing.assert_close(few.irradiance(normals), many.irradiance(normals), rtol=1e-4, atol=1e-5)
