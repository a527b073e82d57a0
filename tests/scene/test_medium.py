"""Media as data: checks, files, moves, and fog for scenes that have none."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from torchrender.errors import InputError, OptionError, SceneFileError
from torchrender.scene.files.scene_file import load_scene_file
from torchrender.scene.files.scene_write import write_scene
from torchrender.scene.load import load
from torchrender.scene.medium import Medium, medium_from_values, medium_values
from torchrender.scene.place import place_medium
from torchrender.scene.procedural.fog import changed_media, with_fog

LOW, HIGH = torch.zeros(3), torch.ones(3)


def test_a_medium_checks_itself() -> None:
    for bad, word in (
        ({"high": LOW}, "high must exceed low"),
        ({"scattering": torch.tensor([0.1, -0.1, 0.1])}, "scattering must not be negative"),
        ({"density": -1.0}, "density"),
        ({"density": torch.zeros(2, 2)}, "density must be"),
        ({"density": torch.full((2, 2, 2), math.nan)}, "density must be finite"),
        ({"density": torch.ones(2, 2, 2), "falloff": 1.0}, "go with a number"),
        ({"asymmetry": 1.0}, "asymmetry"),
        ({"falloff": -1.0}, "falloff"),
        ({"falloff": 10.0, "floor": 9.0}, "falloff times the depth"),
        ({"density_scales": "all"}, "density_scales"),
    ):
        with pytest.raises(InputError, match=word):
            Medium(**{"low": LOW, "high": HIGH, **bad})


@pytest.mark.parametrize("grid", [np.full((1, 1, 2), 3, np.uint16), [[[3, 3]]]])
def test_the_density_of_a_grid_may_be_an_array_or_a_list(grid: object) -> None:
    density = Medium(low=LOW, high=HIGH, density=grid).density
    assert isinstance(density, torch.Tensor) and density.tolist() == [[[3.0, 3.0]]] and density.dtype == torch.float32
    with pytest.raises(InputError, match="density must be numbers in rows"):
        Medium(low=LOW, high=HIGH, density=[[[1.0, 2.0], [1.0]]])


def test_empty_media_are_known() -> None:
    nothing = torch.zeros(3)
    assert Medium(low=LOW, high=HIGH, density=0.0).is_empty
    assert Medium(low=LOW, high=HIGH, scattering=nothing).is_empty
    assert Medium(low=LOW, high=HIGH, density=torch.zeros(2, 2, 2)).is_empty
    assert not Medium(low=LOW, high=HIGH, density=0.0, density_scales="absorption").is_empty
    assert not Medium(low=LOW, high=HIGH, scattering=nothing, absorption=torch.ones(3)).is_empty


def test_a_moved_medium_keeps_its_optical_depth() -> None:
    medium = Medium(low=LOW, high=HIGH, density=2.0, falloff=1.5, floor=0.25)
    matrix = torch.eye(4) * 4.0
    matrix[3, 3], matrix[1, 3] = 1.0, 7.0
    moved = place_medium(medium, matrix)
    assert moved.ground == pytest.approx(8.0) and moved.falloff == pytest.approx(0.375)
    torch.testing.assert_close(moved.extinction * 4.0, medium.extinction)


def test_scene_files_hold_all_of_a_medium(tmp_path: Path) -> None:
    grid = torch.rand(3, 4, 5)
    media = (
        Medium(low=LOW, high=HIGH, density=1.5, falloff=0.8, floor=0.1, asymmetry=0.3, name="mist"),
        Medium(low=-HIGH, high=HIGH, density=grid, emission=torch.ones(3), density_scales="absorption", name="smoke"),
    )
    write_scene(tmp_path / "scene.toml", replace(load("cornell_box"), media=media))
    read = load_scene_file(tmp_path / "scene.toml").media
    for wanted, found in zip(media, read, strict=True):
        for name in ("low", "high", "absorption", "scattering", "emission"):
            torch.testing.assert_close(getattr(found, name), getattr(wanted, name))
        for name in ("asymmetry", "falloff", "floor", "density_scales", "name"):
            assert getattr(found, name) == getattr(wanted, name)
    torch.testing.assert_close(read[1].density, grid)
    assert read[0].density == 1.5


def test_a_wrong_key_of_a_medium_is_named(tmp_path: Path) -> None:
    file = tmp_path / "scene.toml"
    file.write_text("[[medium]]\nlow = [0, 0, 0]\nhigh = [1, 1, 1]\nfallof = 2\n")
    with pytest.raises(SceneFileError, match=r"fallof.*did you mean 'falloff'"):
        load_scene_file(file)


@pytest.mark.parametrize("name", ["head_ct_64x64x93.npy", "mitsuba_volume.vol"])
def test_volumes_of_others_are_media(data_dir: Path, tmp_path: Path, name: str) -> None:
    volume = data_dir / "volumes" / name
    file = tmp_path / "scene.toml"
    file.write_text(f'[[medium]]\nlow = [-1, -1, -1]\nhigh = [1, 1, 1]\ndensity = 3\ndensity_file = "{volume}"\n')
    density = load_scene_file(file).media[0].density
    assert isinstance(density, torch.Tensor) and density.dim() == 3
    assert 0.1 < float(density.max()) <= 6.0 and float(density.min()) >= 0.0


def test_fog_surrounds_the_scene_and_its_cameras() -> None:
    scene = load("cornell_box")
    fog = with_fog(scene, {"scattering": 0.3, "height": 0.5, "asymmetry": 0.2}).media[0]
    low, high = scene.bounds
    assert bool((fog.low < low).all()) and bool((fog.high > high).all())
    for camera in scene.cameras.values():
        assert bool((camera.eye[0] > fog.low).all()) and bool((camera.eye[0] < fog.high).all())
    assert fog.falloff == 2.0 and fog.ground == pytest.approx(float(low[1]))
    assert float(fog.scattering[0]) == pytest.approx(0.3)
    usual = with_fog(scene, {}).media[0]
    assert float(usual.scattering[0]) * scene.diagonal == pytest.approx(1.0, rel=0.6)
    with pytest.raises(OptionError, match="no 'dens'"):
        with_fog(scene, {"dens": 1.0})
    with pytest.raises(OptionError, match="height"):
        with_fog(scene, {"height": 0.0})


def test_thicker_media_are_other_media_in_the_same_scene() -> None:
    scene = with_fog(load("cornell_box"), {"scattering": 0.3})
    geometry = scene.geometry
    thick = changed_media(scene, 2.0, 0.5)
    assert thick.geometry is geometry and thick.meshes is scene.meshes and thick.lights is scene.lights
    assert float(thick.media[0].scattering[0]) == pytest.approx(0.6) and thick.media[0].asymmetry == 0.5
    assert changed_media(scene) is scene
    with pytest.raises(OptionError, match="density"):
        changed_media(scene, -1.0)
    assert np.isfinite(float(changed_media(scene, 0.0).media[0].extinction.sum()))


def test_plain_values_bring_a_medium_back() -> None:
    for medium in (
        Medium(low=LOW, high=HIGH, density=1.5, falloff=0.8, floor=0.1, asymmetry=0.3, name="mist"),
        Medium(low=LOW, high=HIGH, density=torch.rand(2, 3, 4), density_scales="absorption"),
    ):
        again = medium_from_values(json.loads(json.dumps(medium_values(medium))))
        assert again.name == medium.name and again.density_scales == medium.density_scales
        assert again.floor == medium.floor and again.falloff == pytest.approx(medium.falloff)
        torch.testing.assert_close(again.scattering, medium.scattering)
        torch.testing.assert_close(torch.as_tensor(again.density), torch.as_tensor(medium.density))
    for bad, word in (
        ({"low": [0, 0, 0]}, "needs high"),
        ({"low": [0, 0, 0], "high": [1, 1, 1], "colour": 1}, "no 'colour'"),
        ({"low": [0, 0, 0], "high": [1, 1, 1], "density": "thick"}, "density must be"),
        ({"low": [0, 0], "high": [1, 1, 1]}, "low"),
    ):
        with pytest.raises(InputError, match=word):
            medium_from_values(bad)


def test_boxes_keep_their_places_far_from_the_origin() -> None:
    """float32 steps are 1/16 there: sides of the box would move by as much."""
    low, high = torch.tensor([786432.3, -655360.7, 917504.1], dtype=torch.float64), torch.full((3,), 1e6 + 0.3).double()
    medium = Medium(low=low, high=high)
    assert torch.equal(medium.low, low) and torch.equal(medium.high, high)
    again = medium_from_values(medium_values(medium))
    assert torch.equal(again.low, low) and torch.equal(again.high, high)


@pytest.mark.parametrize("corner", ["low", "high"])
def test_boxes_have_an_end(corner: str) -> None:
    """Numbers whose squares float32 does not hold are told, before NumPy warns of them."""
    box = {"low": torch.full((3,), -9e14), "high": torch.full((3,), 9e14)}
    assert Medium(**box).low.tolist() == [pytest.approx(-9e14)] * 3
    sign = -1.0 if corner == "low" else 1.0
    with pytest.raises(InputError, match=rf"medium 'haze': {corner} must lie within 1e\+15 scene units .* got 1e\+300"):
        Medium(**{**box, corner: torch.full((3,), sign * 1e300, dtype=torch.float64)}, name="haze")
