"""Built-in scenes: counts, repeatability, sound geometry, and rooms without holes."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from torchrender.errors import InputError
from torchrender.raster import rasterize
from torchrender.scene.camera import Cameras
from torchrender.scene.files.scene_file import load_scene_file
from torchrender.scene.mesh import Mesh
from torchrender.scene.model import Scene
from torchrender.scene.procedural import MAX_TRIANGLES, SCENES, build
from torchrender.scene.procedural.anything import anything
from torchrender.scene.procedural.parts.curves import (
    blades,
    cylinder,
    lathe,
    leaves,
    polyline,
    sphere,
    torus,
    tubes,
)
from torchrender.scene.procedural.parts.furniture import carpet, curtain, pile, towel
from torchrender.scene.procedural.parts.shapes import (
    Part,
    box,
    boxes,
    extruded,
    frame,
    gridded_box,
    merge,
    rounded_box,
    sheet,
)
from torchrender.scene.procedural.parts.textures import noise, rug
from torchrender.scene.procedural.parts.vessels import basin_tap, bottle, bowl, dome, kettle, shade, stand, teapot, vase

ROOT = Path(__file__).resolve().parents[2]
USUAL = {"nest": 67_000, "grass": 56_000, "city": 50_000, "tree": 113_000, "living_room": 280_000, "washroom": 90_000,
         "hall": 40_000, "street_lamp": 30_000, "panes": 4_800, "walker": 14_000}  # fmt: skip
ROOMS = ("living_room", "washroom")
OPEN = ("ground", "view hills", "view trees")  # surfaces that are seen from one side only
_built: dict[str, Scene] = {}


def usual(name: str) -> Scene:
    if name not in _built:
        _built[name] = build(name)
    return _built[name]


def triangles(scene: Scene) -> int:
    return sum(len(m.faces) for m in scene.meshes)


def volume(vertices: np.ndarray, faces: np.ndarray) -> float:
    a, b, c = (vertices[faces[:, k]] - vertices.mean(axis=0) for k in range(3))
    return float((a * np.cross(b, c)).sum() / 6)


def open_edges(vertices: np.ndarray, faces: np.ndarray) -> int:
    """Directed edges without a partner that runs the other way, vertices at one place taken as one."""
    _, same = np.unique(np.round(vertices, 6), axis=0, return_inverse=True)
    f = same.reshape(-1)[faces]
    edges = np.concatenate([f[:, (0, 1)], f[:, (1, 2)], f[:, (2, 0)]]).astype(np.int64)
    edges = edges[edges[:, 0] != edges[:, 1]]
    key, back = edges[:, 0] * (f.max() + 1) + edges[:, 1], edges[:, 1] * (f.max() + 1) + edges[:, 0]
    return len(np.setdiff1d(key, back))


def areas(mesh: Mesh) -> torch.Tensor:
    v = mesh.vertices.double()
    a, b, c = (v[mesh.faces[:, k]] for k in range(3))
    return torch.linalg.cross(b - a, c - a).norm(dim=1) / 2


RNG = np.random.default_rng(5)
T = np.linspace(0, 1, 9)[None, :, None]
SOLIDS = {
    "box": box((0, 0, 0), (1, 2, 3)),
    "boxes": boxes(np.array([[0, 0, 0], [3, 1, 0]]), np.array([[1, 1, 1], [0.5, 2, 1]]), np.array([30.0, -70.0])),
    "gridded box": gridded_box(np.zeros(3), np.ones(3), (2, 3, 4)),
    "rounded box": rounded_box((1.0, 0.4, 0.7), 0.1, steps=3, cells=2),
    "plain rounded box": rounded_box((1.0, 0.4, 0.7), 0.1, steps=0),
    "cushion": rounded_box((0.5, 0.5, 0.2), 0.09, steps=3, cells=5, puff=0.05),
    "frame": frame(1.0, 2.0, 0.1, 0.05),
    "plate": extruded((0, 1, 2, 3), (0, 1, 2), ((1, 0, 1), (1, 1, 1)), 0.3),
    "sphere": sphere((1.0, 0.5, 0.8), 12),
    "torus": torus(1.0, 0.3, 12, 8),
    "cylinder": cylinder(0.5, 0.0, 1.0, 12),
    "bevelled cylinder": cylinder(0.5, -1.0, 1.0, 12, bevel=0.05, rows=3),
    "turned": lathe(polyline([(0, 0), (1, 0), (0.5, 1), (0, 1)], 12), 10),
    "tubes": tubes(RNG.normal(0, 1, (3, 1, 3)) + T * RNG.normal(0, 1, (3, 1, 3)) + 0.2 * T**2, np.full((3, 9), 0.1), 5),
    "leaves": leaves(
        RNG.normal(0, 1, (9, 3)), RNG.normal(0, 1, (9, 3)), RNG.normal(0, 1, (9, 3)), np.ones(9), np.ones(9)
    ),
    "blades": blades(np.zeros((5, 3)), RNG.normal(0, 0.2, (5, 3)) * (1, 0, 1), np.ones(5), np.full(5, 0.1), 3),
    "curtain": curtain(RNG, 0.6, 2.0, 4, 0.6),
    "carpet": carpet(2.0, 1.0, 0.4),
    "pile": pile(RNG, 2.0, 1.0, 50, 0.02),
    "towel": towel(0.4, 0.6, 0.6),
    "vase": vase("tall", 0.4),
    "bowl": bowl(0.2, 0.1, 0.4),
    "kettle": kettle(0.4),
    "teapot": teapot(0.4),
    "lamp shade": shade(0.2, 0.1, 0.3, 0.4),
    "dome": dome(0.2, 0.4),
    "stand": stand(1.0, 0.1, 0.01, 0.4),
    "bottle": bottle(0.2, 0.03, 0.4),
    "tap": basin_tap(0.4),
}


@pytest.mark.parametrize("name", SOLIDS)
def test_solids_are_closed_and_wound_outwards(name: str) -> None:
    part = SOLIDS[name]
    assert open_edges(part.vertices, part.faces) == 0
    assert volume(part.vertices, part.faces) > 0
    if part.normals is not None and name != "pile":  # wool shades like its pad, on purpose
        a, b, c = (part.vertices[part.faces[:, k]] for k in range(3))
        facing = (np.cross(b - a, c - a)[:, None] * part.normals[part.faces]).sum(axis=-1)
        assert (facing > -1e-9).mean() > 0.97


def test_closed_forms() -> None:
    assert volume(SOLIDS["box"].vertices, SOLIDS["box"].faces) == pytest.approx(6.0)
    assert volume(SOLIDS["plate"].vertices, SOLIDS["plate"].faces) == pytest.approx(5 * 0.3)
    assert volume(SOLIDS["frame"].vertices, SOLIDS["frame"].faces) == pytest.approx((2.0 - 0.8 * 1.8) * 0.05)
    ball = sphere(2.0, 96)
    assert volume(ball.vertices, ball.faces) == pytest.approx(4 / 3 * np.pi * 8, rel=5e-3)
    assert np.abs(ball.normals - ball.vertices / 2).max() < 0.01  # type: ignore[operator]
    ring = torus(2.0, 0.5, 96, 48)
    assert volume(ring.vertices, ring.faces) == pytest.approx(2 * np.pi**2 * 2.0 * 0.25, rel=1e-2)


@given(st.lists(st.sampled_from(sorted(SOLIDS)), min_size=1, max_size=4), st.floats(-180, 180), st.booleans())
@settings(deadline=None, max_examples=20)
def test_merging_and_moving_keep_volume(names: list[str], yaw: float, flip: bool) -> None:
    parts = [SOLIDS[n] for n in names]
    whole = merge(parts)
    moved = whole.moved((3.0, -2.0, 1.0), yaw_deg=yaw).transformed(np.diag([-1.0 if flip else 1.0, 1.0, 1.0]))
    total = sum(volume(p.vertices, p.faces) for p in parts)
    assert whole.count == sum(p.count for p in parts)
    assert volume(moved.vertices, moved.faces) == pytest.approx(total, rel=1e-6)


def test_sheet_normals_point_up() -> None:
    x, z = np.meshgrid(np.linspace(-1, 1, 9), np.linspace(-1, 1, 7), indexing="xy")
    part: Part = sheet(np.stack([x, 0.3 * np.sin(x), z], axis=-1))
    assert part.normals is not None and (part.normals[:, 1] > 0.5).all()


def test_textures_are_valid_and_repeat() -> None:
    field = noise(np.random.default_rng(0), 64)
    assert abs(field.mean()) < 1e-5 and field.std() == pytest.approx(1.0, rel=1e-4)
    seam, inside = np.abs(field[0] - field[-1]).mean(), np.abs(field[1:] - field[:-1]).mean()
    assert seam < 1.6 * inside
    picture = rug(np.random.default_rng(0), (0.5, 0.4, 0.3), (0.3, 0.1, 0.1), (0.1, 0.1, 0.2))
    assert picture.min() >= 0 and picture.max() <= 1


# ------------------------------------------------------------------- scenes


@pytest.mark.parametrize("name", SCENES)
def test_usual_count_and_cameras(name: str) -> None:
    scene = usual(name)
    wanted = USUAL.get(name, 96)
    assert abs(triangles(scene) - wanted) <= 0.05 * wanted
    assert next(iter(scene.cameras)) == "default" and "close" in scene.cameras
    assert scene.name == name and (scene.lights or scene.environment) and (scene.ambient > 0).all()
    camera = scene.camera(width=1024, height=768)
    assert float(camera.near) < 0.02 * scene.diagonal < float(camera.far)


@pytest.mark.parametrize("name", SCENES)
def test_geometry_is_sound(name: str) -> None:
    scene = usual(name)
    for mesh in scene.meshes:
        assert float(areas(mesh).min()) > 1e-16 * scene.diagonal**2, mesh.name
        if mesh.normals is not None:
            length = mesh.normals.double().norm(dim=1)
            assert bool(((length - 1).abs() < 1e-3).logical_or(length == 0).all()), mesh.name
        material = scene.materials[mesh.material]
        assert (mesh.uv is None) == (material.diffuse_texture is None), mesh.name
        if mesh.colors is not None:
            assert float(mesh.colors.min()) >= 0, mesh.name
    for material in scene.materials:
        assert float(material.diffuse.min()) >= 0 and float(material.diffuse.max()) <= 1
        texture = material.diffuse_texture
        if texture is not None:
            assert max(texture.shape[:2]) <= 512 and float(texture.min()) >= 0 and float(texture.max()) <= 1


@pytest.mark.parametrize("name", SCENES)
def test_objects_are_closed_and_wound_outwards(name: str) -> None:
    for mesh in usual(name).meshes:
        if mesh.name in OPEN:
            continue
        v, f = mesh.vertices.double().numpy(), mesh.faces.numpy()
        assert volume(v, f) > 0, mesh.name
        if len(f) < 20_000:  # welding float32 vertices of tiny parts is a matter of luck
            assert open_edges(v, f) <= 0.002 * len(f), mesh.name


@pytest.mark.parametrize("name", SCENES)
def test_same_seed_same_tensors(name: str) -> None:
    size = max(SCENES[name].fewest, 12_000)
    first, again, other = build(name, triangles=size), build(name, triangles=size), build(name, triangles=size, seed=1)
    assert all(torch.equal(a.vertices, b.vertices) for a, b in zip(first.meshes, again.meshes, strict=True))
    assert all(
        torch.equal(a.diffuse_texture, b.diffuse_texture)
        for a, b in zip(first.materials, again.materials, strict=True)
        if a.diffuse_texture is not None and b.diffuse_texture is not None
    )
    if name != "cornell_box":
        assert any(
            a.vertices.shape != b.vertices.shape or not torch.equal(a.vertices, b.vertices)
            for a, b in zip(first.meshes, other.meshes)
        )


@pytest.mark.parametrize("name", SCENES)
@pytest.mark.parametrize("share", [0.0, 0.4, 1.7, 4.0])
def test_scaling(name: str, share: float) -> None:
    builder = SCENES[name]
    wanted = max(round(builder.usual * share), builder.fewest)
    assert abs(triangles(build(name, triangles=wanted)) - wanted) <= 0.1 * wanted


@pytest.mark.parametrize("wanted", [97, 114, 150, 311, 1000, 77_777])
def test_cornell_box_meets_odd_counts(wanted: int) -> None:
    assert abs(triangles(build("cornell_box", triangles=wanted)) - wanted) <= 0.1 * wanted


def test_three_million() -> None:
    assert abs(triangles(build("grass", triangles=MAX_TRIANGLES)) - MAX_TRIANGLES) <= 0.1 * MAX_TRIANGLES


def test_wrong_wishes() -> None:
    with pytest.raises(InputError, match="known scenes: nest, grass"):
        build("castle")
    for wrong in (0, SCENES["nest"].fewest - 1, MAX_TRIANGLES + 1, 5e4):
        with pytest.raises(InputError, match="triangles of 'nest' must be in"):
            build("nest", triangles=wrong)  # type: ignore[arg-type]
    with pytest.raises(InputError, match="seed"):
        build("nest", seed=-1)


@pytest.mark.parametrize(("name", "least", "share"), [("living_room", 20, 0.3), ("washroom", 15, 0.3)])
def test_reflectors_are_separate_objects(name: str, least: int, share: float) -> None:
    scene = usual(name)
    mirrors = [m for m in scene.meshes if scene.materials[m.material].is_reflector]
    assert len({m.object_id for m in mirrors}) >= least
    assert sum(len(m.faces) for m in mirrors) >= share * triangles(scene)
    assert any(scene.materials[m.material].specular >= 0.9 for m in mirrors)


@pytest.mark.parametrize("name", ROOMS)
@pytest.mark.parametrize("detail", ["usual", "fewest"])
def test_rooms_are_closed(name: str, detail: str) -> None:
    scene = usual(name) if detail == "usual" else build(name, triangles=SCENES[name].fewest)
    for camera in scene.cameras:
        seen = rasterize(scene, scene.camera(camera, width=160, height=120))
        assert bool((seen.triangle >= 0).all()), camera


@pytest.mark.parametrize("name", ROOMS)
def test_rooms_are_closed_all_round(name: str) -> None:
    scene = usual(name)
    eye = scene.camera(width=64, height=64).eye[0]
    offsets = torch.tensor([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]], dtype=torch.float64)
    cameras = Cameras.look_at(eye.expand(6, 3), eye + offsets, width=96, height=96, fov_deg=92.0, near=0.01)
    assert bool((rasterize(scene, cameras).triangle >= 0).all())


@pytest.mark.parametrize("name", SCENES)
def test_scene_files_name_every_scene(name: str) -> None:
    scene = load_scene_file(ROOT / "scenes" / f"{name}.toml")
    assert scene.name == name and triangles(scene) == triangles(usual(name))
    assert list(scene.cameras) == list(usual(name).cameras)


@pytest.mark.parametrize("seed", [0, 7, 16])
def test_random_scenes_are_whole_and_come_again(seed: int) -> None:
    scene, again = anything(seed), anything(seed)
    assert all(torch.equal(a.vertices, b.vertices) for a, b in zip(scene.meshes, again.meshes, strict=True))
    assert 100 <= scene.geometry.triangle_count <= 300_000 and 1 <= len(scene.lights) <= 5
    assert torch.isfinite(scene.geometry.vertices).all() and 3.0 <= scene.diagonal <= 120.0
    for name in ("default", "close"):
        view = scene.camera(name, width=32, height=24)
        assert rasterize(scene, view).covered.float().mean() > 0.1, name


def test_random_scenes_differ_in_everything() -> None:
    found = [anything(seed) for seed in range(12)]
    kinds = {type(light).__name__ for scene in found for light in scene.lights}
    assert kinds == {"PointLight", "SpotLight", "RectLight", "DirectionalLight"}
    assert 0 < sum(scene.environment is not None for scene in found) < 12
    assert any(m.is_reflector for scene in found for m in scene.materials)
    assert any(m.diffuse_texture is not None for scene in found for m in scene.materials)
    counts = [scene.geometry.triangle_count for scene in found]
    assert max(counts) > 20 * min(counts)
