from __future__ import annotations

import json
from pathlib import Path

import pytest
import torch

from torchrender.scene import shapes
from torchrender.scene.info import scene_info
from torchrender.scene.light import PointLight
from torchrender.scene.load import load
from torchrender.scene.material import Material
from torchrender.scene.mesh import Mesh
from torchrender.scene.model import Scene


def test_counts_of_a_small_scene() -> None:
    texture = torch.ones(2, 2, 3)
    materials = (Material(diffuse_texture=texture), Material(diffuse_texture=texture), Material())
    scene = Scene(
        meshes=(shapes.box(torch.ones(3)), shapes.box(torch.ones(3))),
        materials=materials,
        lights=(PointLight(position=torch.zeros(3)), PointLight(position=torch.ones(3))),
    )
    info = scene_info(scene)
    assert (info["triangles"], info["vertices"], info["objects"]) == (24, 48, 2)
    assert (info["materials"], info["textures"], info["lights"]) == (3, 1, {"PointLight": 2})
    assert info["bounds"] == [[-0.5] * 3, [0.5] * 3]
    assert info["diagonal"] == pytest.approx(3**0.5)
    # Two boxes in the same place are two closed objects, not one with doubled faces.
    assert info["closed"]
    assert info["warnings"] == []
    json.dumps(info)


def test_warnings() -> None:
    vertices = torch.tensor([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])
    mesh = Mesh(vertices=vertices, faces=torch.tensor([[0, 1, 2], [0, 1, 1]]))
    scene = Scene(meshes=(mesh,), materials=(Material(name="cloth", diffuse_texture=torch.ones(1, 1, 3)),))
    info = scene_info(scene)
    assert info["degenerate_triangles"] == 1
    assert info["open_edges"] == 3
    text = " | ".join(info["warnings"])
    for part in ("1 triangles have no area", "3 edges", "coordinates: cloth", "no light"):
        assert part in text


def test_flipped_face_is_not_closed() -> None:
    box = shapes.box(torch.ones(3))
    faces = box.faces.clone()
    faces[0] = faces[0].flip(0)
    assert scene_info(Scene(meshes=(box,)))["closed"]
    flipped = Mesh(vertices=box.vertices, faces=faces)
    assert scene_info(Scene(meshes=(flipped,)))["open_edges"] == 3


def test_empty_scene() -> None:
    info = scene_info(Scene())
    assert (info["triangles"], info["closed"], info["open_edges"]) == (0, False, 0)
    assert "the scene has no triangles" in info["warnings"]


@pytest.mark.parametrize(
    ("name", "closed"), [("armadillo.ply", True), ("fandisk.obj", True), ("utah_teapot.obj", False)]
)
def test_real_meshes(data_dir: Path, name: str, closed: bool) -> None:
    assert scene_info(load(data_dir / "meshes" / name))["closed"] is closed
