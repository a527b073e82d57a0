"""Point clouds from files and meshes, and what is estimated for them."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch

from point_scenes import sphere_cloud
from torchrender.errors import InputError, MeshError, SceneFileError
from torchrender.numerics.color import linear_from_srgb
from torchrender.points.cloud import PointCloud
from torchrender.points.load import COVER, SampledWarning, holds_points, load_points, sample_points
from torchrender.scene.material import Material
from torchrender.scene.mesh import Mesh
from torchrender.scene.model import Scene
from torchrender.scene.shapes import box, quad, sphere

HEADER = "ply\nformat ascii 1.0\nelement vertex {count}\nproperty float x\nproperty float y\nproperty float z\n"


def write_ply(path, rows, extra=""):
    path.write_text(HEADER.format(count=len(rows)) + extra + "end_header\n" + "\n".join(rows) + "\n")
    return path


def test_a_ply_file_keeps_its_normals_colours_and_radii(tmp_path):
    names = ("float nx", "float ny", "float nz", "uchar red", "uchar green", "uchar blue", "float radius")
    rows = [f"{k} {k * k} 0 0 0 2 {10 * k} 128 255 {0.5 + k}" for k in range(8)]
    cloud = load_points(write_ply(tmp_path / "cloud.ply", rows, "".join(f"property {n}\n" for n in names)))
    assert len(cloud) == 8 and cloud.name == "cloud" and not cloud.two_sided
    assert torch.equal(cloud.normal, torch.tensor([0.0, 0.0, 1.0]).expand(8, 3))
    torch.testing.assert_close(cloud.radius, 0.5 + torch.arange(8.0))
    torch.testing.assert_close(cloud.color[3], linear_from_srgb(torch.tensor([30.0, 128.0, 255.0]) / 255))


def test_radii_are_three_quarters_of_the_sixth_neighbour(tmp_path):
    g = np.random.default_rng(0)
    points = g.normal(size=(60, 3)).round(4)
    cloud = load_points(write_ply(tmp_path / "c.ply", [" ".join(map(str, p)) for p in points]))
    distance = np.sort(np.linalg.norm(points[:, None] - points[None], axis=2), axis=1)[:, 6]
    np.testing.assert_allclose(cloud.radius.numpy(), 0.75 * distance, rtol=1e-5)


def test_normals_of_a_closed_surface_are_found_with_their_side():
    truth = sphere_cloud(3000)
    found = PointCloud(position=truth.position).completed()
    assert not found.two_sided
    assert float((found.normal * truth.normal).sum(1).min()) > 0.98


def test_an_open_sheet_is_drawn_from_both_sides():
    g = torch.Generator().manual_seed(0)
    position = torch.rand(2000, 3, generator=g).double() * torch.tensor([1.0, 1.0, 0.0])
    found = PointCloud(position=position).completed()
    assert found.two_sided
    assert float(found.normal[:, 2].abs().min()) > 0.999


def test_given_normals_decide_the_side_of_missing_ones():
    truth = sphere_cloud(2000)
    inwards = -truth.normal
    inwards[::7] = torch.nan
    found = PointCloud(position=truth.position, normal=inwards, radius=truth.radius).completed()
    assert float((found.normal * truth.normal).sum(1).max()) < -0.98
    assert torch.equal(found.radius, truth.radius)


def test_samples_are_spread_by_area_with_normals_and_radii():
    scene = Scene(meshes=(box(size=(1.0, 2.0, 3.0)), quad(corner=(9, 0, 0), edge_u=(4, 0, 0), edge_v=(0, 4, 0))))
    cloud = sample_points(scene, 20_000, seed=1)
    total = 2 * (2 + 3 + 6) + 16
    share = float((cloud.position[:, 0] > 5).float().mean())
    assert share == pytest.approx(16 / total, abs=0.002)
    torch.testing.assert_close(cloud.radius, torch.full((20_000,), COVER * math.sqrt(total / 20_000)))
    on_box = cloud.position[:, 0] < 5
    half = torch.tensor([0.5, 1.0, 1.5], dtype=torch.float64)
    beside = (cloud.position[on_box] / half * cloud.normal[on_box].double()).sum(1)
    torch.testing.assert_close(beside, torch.ones_like(beside), atol=1e-6, rtol=0)
    assert torch.equal(sample_points(scene, 500, seed=3).position, sample_points(scene, 500, seed=3).position)


def test_open_meshes_are_two_sided_and_inside_out_ones_are_turned():
    whole = sphere(segments=16)
    turned = Mesh(vertices=whole.vertices, faces=whole.faces.flip(1))
    half = Mesh(vertices=whole.vertices, faces=whole.faces[: len(whole.faces) // 2])
    for mesh, two_sided in ((whole, False), (turned, False), (half, True)):
        cloud = sample_points(Scene(meshes=(mesh,)), 500)
        assert cloud.two_sided == two_sided
        if not two_sided:
            assert float((cloud.normal * cloud.position).sum(1).min()) > 0


def test_samples_carry_texture_material_and_vertex_colours():
    texture = torch.zeros(2, 2, 3)
    texture[:, 0], texture[:, 1] = torch.tensor([1.0, 0.0, 0.0]), torch.tensor([0.0, 0.0, 1.0])
    texture = texture.repeat_interleave(64, 0).repeat_interleave(64, 1)
    plate = quad(corner=(0, 0, 0), edge_u=(1, 0, 0), edge_v=(0, 1, 0))
    material = Material(name="m", diffuse=torch.tensor([0.5, 1.0, 1.0]), diffuse_texture=texture)
    cloud = sample_points(Scene(meshes=(plate,), materials=(material,)), 3000)
    left = (cloud.position[:, 0] > 0.1) & (cloud.position[:, 0] < 0.4)
    right = (cloud.position[:, 0] > 0.6) & (cloud.position[:, 0] < 0.9)
    torch.testing.assert_close(cloud.color[left], torch.tensor([0.5, 0.0, 0.0]).expand(int(left.sum()), 3))
    torch.testing.assert_close(cloud.color[right], torch.tensor([0.0, 0.0, 1.0]).expand(int(right.sum()), 3))


def test_meshes_are_sampled_and_points_are_not(tmp_path):
    assert len(load_points("cornell_box", samples=100)) == 100
    path = write_ply(tmp_path / "p.ply", ["0 0 0", "1 0 0", "0 1 0"])
    assert holds_points(path) and not holds_points(tmp_path / "other.ply")
    with pytest.raises(InputError, match="samples is for meshes only"):
        load_points(path, samples=5)


@pytest.mark.parametrize("emission", [0.0, 0.5])
def test_emission_that_points_do_not_have_is_said(tmp_path, emission):
    (tmp_path / "a.toml").write_text(
        f"[[material]]\nname = 'a'\nemission = {emission}\n[[geometry]]\nshape = 'box'\nmaterial = 'a'\n"
    )
    with pytest.warns(SampledWarning) as told:
        load_points(tmp_path / "a.toml")
    assert ("without the light that they emit" in str(told[0].message)) == (emission > 0)


@pytest.mark.parametrize(
    ("rows", "reason"), [(["nan 0 0", "1 1 1"], "1 of 2 points are NaN"), ([], "no points"), (["0 0"], "cut|damaged")]
)
def test_unusable_files_are_refused(tmp_path, rows, reason):
    with pytest.raises(SceneFileError, match=reason):
        load_points(write_ply(tmp_path / "bad.ply", rows))


def test_a_scene_without_surfaces_is_refused():
    flat = Mesh(vertices=torch.zeros(3, 3), faces=torch.tensor([[0, 1, 2]]))
    with pytest.raises(MeshError, match="no surface"):
        sample_points(Scene(meshes=(flat,)), 10)


def test_real_clouds(data_dir):
    kitten = load_points(data_dir / "points" / "kitten_normals.ply")
    assert len(kitten) == 5210 and not kitten.two_sided
    found = PointCloud(position=kitten.position).completed()
    assert float((found.normal * kitten.normal).sum(1).mean()) > 0.98
    room = load_points(data_dir / "points" / "livingroom_fragment_colored.ply")
    assert room.color is not None and room.two_sided
