"""Files that show what others' programs got wrong: each is read rightly here."""

from __future__ import annotations

import warnings
from pathlib import Path

import pytest
import torch

import torchrender as tr
from torchrender.errors import NotUsedWarning, RepairedWarning, TorchRenderWarning
from torchrender.scene.load import load


def area(scene: tr.Scene) -> float:
    corners = scene.geometry.vertices[scene.geometry.faces.long()]
    return float(
        0.5 * torch.linalg.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]).norm(dim=1).sum()
    )


@pytest.mark.parametrize(
    ("name", "expected"),
    [("concave.obj", 3.0), ("concave_u.obj", 5.0), ("concave_arrow.obj", 1.0), ("concave_arrow.ply", 1.0)],
)
def test_concave_polygons_are_not_filled(cases: Path, name: str, expected: float) -> None:
    assert area(load(cases / name)) == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize(
    ("name", "axis", "low", "high", "triangles"),
    [
        ("skin.glb", 0, 0, 1, 2),
        ("skin_posed.glb", 1, 5, 6, 2),
        ("morph.glb", 1, 0, 4, 2),
        ("instancing.glb", 0, 0, 5, 6),
    ],
)
def test_what_bends_and_repeats(cases: Path, name: str, axis: int, low: float, high: float, triangles: int) -> None:
    scene = load(cases / name)
    assert len(scene.geometry.faces) == triangles
    assert scene.bounds[:, axis].tolist() == pytest.approx([low, high], abs=1e-5)


@pytest.mark.parametrize("name", ["col_float_255_points.ply", "col_diffuse_points.ply", "col.ply"])
def test_colours_of_points(cases: Path, name: str) -> None:
    color = tr.load_points(cases / name).color
    assert color is not None and float(color[:, 0].min()) == pytest.approx(1.0, abs=1e-6)
    assert float(color.min()) >= 0.0 and float(color.max()) <= 1.0


def test_normals_of_points(cases: Path) -> None:
    normal = tr.load_points(cases / "nrm.ply").normal
    assert normal is not None and torch.equal(normal, normal[:1].expand_as(normal))


def test_gaussians_are_ellipsoids(cases: Path) -> None:
    with pytest.warns(NotUsedWarning, match=r"higher harmonics\) \(45\)"):
        cloud = tr.load_points(cases / "gs.ply")
    assert cloud.spread is not None and cloud.opacity is not None and cloud.color is not None
    scale = torch.linalg.eigvalsh(cloud.spread).clamp_min(0).sqrt()
    assert float(scale.max()) == pytest.approx(0.082, abs=0.002)


def test_bytes_behind_the_last_facet_and_colours(cases: Path) -> None:
    with pytest.warns(NotUsedWarning, match="behind the last facet"):
        assert len(load(cases / "trail.stl").geometry.faces) == 1
    colors = load(cases / "color.stl").meshes[0].colors
    assert colors is not None and colors[0].tolist() == pytest.approx([1.0, 0.0, 0.0])


def test_a_line_goes_on_behind_a_blank(cases: Path) -> None:
    assert area(load(cases / "cont2.obj")) == area(load(cases / "cont.obj")) == pytest.approx(1.0)


@pytest.mark.parametrize("name", ["k.obj", "k2.obj"])
def test_black_materials_and_paths_of_other_machines_show_their_picture(cases: Path, name: str) -> None:
    with pytest.warns(RepairedWarning):
        material = load(cases / name).materials[0]
    assert material.diffuse_texture is not None and material.diffuse.tolist() == [1.0, 1.0, 1.0]


def test_points_that_are_not_finite_can_be_dropped(cases: Path) -> None:
    with pytest.raises(tr.errors.SceneFileError, match="2 of 64 points are NaN"):
        tr.load_points(cases / "nan.ply")
    with pytest.warns(RepairedWarning, match=r"dropped \(2\)"):
        assert len(tr.load_points(cases / "nan.ply", drop_invalid=True)) == 62


def test_every_other_file_loads_or_says_why(cases: Path, data_dir: Path) -> None:
    """Nothing else than an error of the package, and no warning of another kind."""
    files = [f for f in sorted(cases.iterdir()) if f.suffix in (".glb", ".gltf", ".obj", ".ply", ".stl", ".toml")]
    files += sorted((data_dir / "gltf").glob("*/*.gltf"))
    said = {}
    for file in files:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            warnings.simplefilter("ignore", TorchRenderWarning)
            try:
                load(file)
            except tr.errors.SceneFileError as error:
                said[file.name] = error.reason
    points = [f for f in said if f.endswith(".ply")]
    assert all("points but no triangles" in said[f] for f in points)
    assert set(said) - set(points) == {"bom.gltf"} and "cannot be read" in said["bom.gltf"]
