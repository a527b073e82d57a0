from __future__ import annotations

import math
import struct
from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image

from torchrender.errors import InputError, SceneFileError
from torchrender.scene.files.texture_file import MissingTextureWarning
from torchrender.scene.load import load
from torchrender.scene.mesh import Mesh
from torchrender.scene.smooth import crease_normals, weld

# Triangles, extent and whether the surface is closed, from the description of the data.
MESHES = {
    "meshes/stanford_bunny.ply": (69451, (0.1557, 0.1543, 0.1207)),
    "meshes/stanford_dragon_res2.ply": (202434, (0.2046, 0.1444, 0.0915)),
    "meshes/armadillo.ply": (86482, (0.8386, 1.0, 0.7628)),
    "meshes/utah_teapot.obj": (6320, (6.434, 3.15, 4.0)),
    "meshes/suzanne.obj": (968, (2.7344, 1.9687, 1.7031)),
    "meshes/fandisk.obj": (12946, (4.8279, 5.2445, 2.6803)),
    "meshes/spot_textured.glb": (5856, (0.943, 1.69, 1.718)),
    "scenes/bookstore.glb": (100969, (15.702, 3.718, 14.609)),
    "scenes/house_garden.glb": (10497, (0.503, 0.187, 0.504)),
    "scenes/low_poly_tree.glb": (1126, (4.075, 7.463, 5.047)),
    "scenes/forest_tile.glb": (2900, (1.841, 0.734, 1.183)),
    "references/common/meshes/matpreview_shape0.ply": (512, (2.1338, 1.6228, 1.2964)),
    "references/common/meshes/matpreview_shape1.ply": (3936, (1.8545, 1.8545, 1.718)),
    "references/common/meshes/matpreview_shape2.ply": (57152, (2.223, 2.4399, 2.1897)),
    "references/common/meshes/rectangle.obj": (2, (2.0, 2.0, 0.0)),
    "references/common/meshes/sphere.obj": (32512, (2.0, 2.0, 2.0)),
}


@pytest.mark.filterwarnings("ignore:.*faces that are there twice")
@pytest.mark.parametrize("name", MESHES)
def test_real_files(data_dir: Path, name: str) -> None:
    triangles, extent = MESHES[name]
    scene = load(data_dir / name)
    assert scene.geometry.triangle_count == triangles
    low, high = scene.bounds
    assert (high - low).tolist() == pytest.approx(extent, abs=1e-3)
    normals = scene.geometry.normals
    assert normals is not None
    used = normals[scene.geometry.faces.unique().long()]  # vertices of no face stay where the file has them
    assert bool(((used.norm(dim=1) - 1).abs() < 1e-4).all())


@pytest.mark.parametrize(
    ("name", "objects", "textures"),
    [("bookstore.glb", 165, 24), ("house_garden.glb", 2, 1), ("low_poly_tree.glb", 1, 1), ("forest_tile.glb", 1, 0)],
)
def test_real_scenes_share_textures(data_dir: Path, name: str, objects: int, textures: int) -> None:
    scene = load(data_dir / "scenes" / name)
    assert len({m.object_id for m in scene.meshes}) == objects
    assert len({id(m.diffuse_texture) for m in scene.materials if m.diffuse_texture is not None}) == textures


def test_garden_plants_are_cut_out(data_dir: Path) -> None:
    plants = load(data_dir / "scenes" / "house_garden.glb").materials[1]
    assert plants.alpha_cutoff == 0.5
    assert plants.diffuse_texture is not None
    assert 0.05 < float((plants.diffuse_texture[..., 3] < 0.5).float().mean()) < 0.95


def test_every_cornell_box_mesh_loads(data_dir: Path) -> None:
    files = sorted((data_dir / "scenes" / "cornell_box" / "meshes").glob("*.obj"))
    assert len(files) == 8
    for file in files:
        corners = [len(line.split()) - 1 for line in file.read_text().splitlines() if line.startswith("f ")]
        assert load(file).geometry.triangle_count == sum(n - 2 for n in corners)


def test_points_without_triangles_are_refused(data_dir: Path) -> None:
    with pytest.raises(SceneFileError, match="holds 5210 points but no triangles"):
        load(data_dir / "points" / "kitten_normals.ply")


# ---------------------------------------------------------------------- normals


def loop_normal(mesh: Mesh, corner: int) -> torch.Tensor:
    """Angle-weighted normal at a position over all faces that touch it: right where no edge there is sharp."""
    here = mesh.vertices[corner]
    total = torch.zeros(3, dtype=torch.float64)
    for face in mesh.faces:
        points = mesh.vertices[face]
        for k in range(3):
            if torch.equal(points[k], here):
                a, b = points[(k + 1) % 3] - here, points[(k + 2) % 3] - here
                angle = math.acos(max(-1.0, min(1.0, float(a @ b / a.norm() / b.norm()))))
                normal = torch.linalg.cross(a, b)
                total += normal / normal.norm() * angle
    return (total / total.norm()).float()


def test_smooth_normals_match_the_loop(tmp_path: Path) -> None:
    vertices, faces = icosphere()
    write_obj(tmp_path / "a.obj", vertices, faces)
    mesh = load(tmp_path / "a.obj").meshes[0]
    assert len(mesh.vertices) == len(vertices)
    assert mesh.normals is not None
    for corner in range(0, len(vertices), 5):
        torch.testing.assert_close(mesh.normals[corner], loop_normal(mesh, corner), rtol=0, atol=1e-5)


def icosphere() -> tuple[np.ndarray, np.ndarray]:
    import trimesh

    sphere = trimesh.creation.icosphere(subdivisions=2)
    return np.asarray(sphere.vertices), np.asarray(sphere.faces)


def write_obj(path: Path, vertices: np.ndarray, faces: np.ndarray) -> None:
    lines = [f"v {x!r} {y!r} {z!r}" for x, y, z in vertices.tolist()]
    path.write_text("\n".join([*lines, *("f " + " ".join(str(i + 1) for i in f) for f in faces.tolist())]))


def test_machine_part_keeps_sharp_edges(data_dir: Path) -> None:
    scene = load(data_dir / "meshes" / "fandisk.obj")
    geometry = scene.geometry
    assert geometry.normals is not None
    corner = geometry.normals[geometry.faces.long()]
    turned = (corner * geometry.face_normals[:, None]).sum(-1)
    # No corner leans far away from its face, and large parts are exactly flat.
    assert float(turned.min()) > math.cos(math.radians(50))
    assert float((turned > 0.9999).float().mean()) > 0.3
    assert geometry.vertices.shape[0] > 6475


def test_sharp_edges_are_split_and_fan_tips_are_linear() -> None:
    count = 20000
    angle = np.arange(count) * 2 * np.pi / count
    rim = np.stack([np.cos(angle), np.zeros(count), np.sin(angle)], axis=1)
    k = np.arange(count)
    faces = np.stack([np.full(count, count), (k + 1) % count, k], axis=1)
    source, _, normals = crease_normals(np.vstack([rim, [[0, 0.2, 0]]]), faces)
    # One vertex of 20,000 faces stays one vertex, and takes no time that grows with the square.
    assert len(source) == count + 1
    np.testing.assert_allclose(normals[source == count], [[0, 1, 0]], atol=1e-6)


def test_both_zeros_are_one_place() -> None:
    """Two faces of a ridge share its ends, which one of them writes as -0: a seam there would show."""
    right, left = (
        [[0.0, 0.0, 0.0], [0.0, 0.0, 1.0], [1.0, -0.1, 0.0]],
        [[-0.0] * 3, [-0.0, 0.0, 1.0], [-1.0, -0.1, 0.0]],
    )
    vertices = np.array([*right, *left])
    faces = np.array([[0, 1, 2], [3, 5, 4]])
    assert len(weld(vertices)[0]) == 4
    source, new, normals = crease_normals(vertices, faces)
    along = normals[new[np.isin(source[new], (0, 1, 3, 4))]]
    np.testing.assert_allclose(along, [[0, 1, 0]] * 4, atol=1e-6)


def test_degenerate_faces_leave_their_neighbours_alone() -> None:
    vertices = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [2, 0, 0], [1e-200, 0, 0]], dtype=float)
    faces = np.array([[0, 1, 2], [0, 1, 3], [0, 0, 1]])
    _, new_faces, normals = crease_normals(vertices, faces)
    assert np.isfinite(normals).all()
    np.testing.assert_allclose(normals[new_faces[0]], [[0, 0, 1]] * 3)


# ------------------------------------------------------------------ OBJ, PLY, STL


OBJ = """mtllib a.mtl
o left
v 0 0 0 # a comment
v 1 0 0
v 1 1 0
v 0 1 0
vt 0 0
vt 1 0
vt 1 1
vt 0 1
usemtl red paint
f 1/1 2/2 3/3 4/4
o right
v 5 0 0
v 6 0 0
v 6 1 0
v 5.5 2 0
v 5 1 0
usemtl tiles
f 5/1 6/2 7/3 8/3 9/4
usemtl red paint
f -5/1 -4/2 -3/3
"""
MTL = """newmtl red paint
Kd 0.8 0.1 0.0
Ks 0.5 0.25 0.0
Ns 98
newmtl tiles
map_Kd -s 2 2 2 the tiles.png
Ke 1 2 3
d 0.5
"""


def test_obj_with_materials_and_objects(tmp_path: Path) -> None:
    (tmp_path / "a.obj").write_text(OBJ)
    (tmp_path / "a.mtl").write_text(MTL)
    Image.new("RGB", (2, 2), (255, 0, 0)).save(tmp_path / "the tiles.png")
    scene = load(tmp_path / "a.obj")
    found = sorted((m.name, scene.materials[m.material].name, m.object_id, len(m.faces)) for m in scene.meshes)
    ids = {m.name: m.object_id for m in scene.meshes}
    assert found == sorted(
        [
            ("left", "red paint", ids["left"], 2),
            ("right", "red paint", ids["right"], 1),
            ("right", "tiles", ids["right"], 3),
        ]
    )
    assert ids["left"] != ids["right"]
    paint = next(m for m in scene.materials if m.name == "red paint")
    assert paint.diffuse.tolist() == pytest.approx([0.8, 0.1, 0.0])
    assert (paint.specular, paint.shininess) == pytest.approx((0.5, 98.0))
    assert paint.specular_color.tolist() == pytest.approx([1.0, 0.5, 0.0])
    tiles = next(m for m in scene.materials if m.name == "tiles")
    assert tiles.emission.tolist() == [1.0, 2.0, 3.0]
    assert tiles.diffuse.tolist() == [1.0, 1.0, 1.0]  # no Kd: the picture alone is the colour
    assert tiles.diffuse_texture is not None
    assert tiles.diffuse_texture[0, 0].tolist() == pytest.approx([1.0, 0.0, 0.0])
    assert (tiles.alpha_cutoff, tiles.blend, tiles.opacity) == (None, True, 0.5)
    assert tiles.sampler("diffuse_texture").transform.tolist() == [[2.0, 0.0, 0.0], [0.0, 2.0, 0.0]]
    corners = scene.geometry.vertices[scene.geometry.faces.long()]
    area = torch.linalg.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert float(area[:, 2].sum() / 2) == pytest.approx(1.0 + 1.5 + 0.5)
    assert bool((area[:, 2] > 0).all())


def test_obj_missing_files_are_warnings(tmp_path: Path) -> None:
    (tmp_path / "a.obj").write_text(OBJ)
    with pytest.warns(
        MissingTextureWarning, match=r"mtllib a\.mtl: the file cannot be read \(No such file or directory\)"
    ):
        scene = load(tmp_path / "a.obj")
    assert scene.geometry.triangle_count == 6
    told = "mtllib a.mtl: the file cannot be read (No such file or directory); the plain colour is used (1)"
    assert scene.report.plain()["not_used"] == [told]
    (tmp_path / "a.mtl").write_text(MTL)
    with pytest.warns(MissingTextureWarning, match=r"material 'tiles': texture 'the tiles.png': no such file"):
        scene = load(tmp_path / "a.obj")
    assert len(scene.materials) == 2
    assert [told.partition(":")[0] for told in scene.report.plain()["not_used"]] == ["material 'tiles'"]


def test_obj_normals_of_the_file_are_kept(tmp_path: Path) -> None:
    (tmp_path / "a.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nvn 0 0 3\nvn 0 1 0\nf 1//1 2//1 3//2\n")
    mesh = load(tmp_path / "a.obj").meshes[0]
    assert mesh.normals is not None
    assert mesh.normals[mesh.faces[0]].tolist() == [[0, 0, 1], [0, 0, 1], [0, 1, 0]]


def ply(header: str, body: bytes, kind: str = "binary_little_endian") -> bytes:
    return f"ply\nformat {kind} 1.0\n{header}end_header\n".encode() + body


VERTICES = "element vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
FACES = "element face 1\nproperty list uchar int vertex_indices\n"


def test_ply_colours_are_decoded(tmp_path: Path) -> None:
    header = VERTICES + "property uchar red\nproperty uchar green\nproperty uchar blue\n" + FACES
    rows = b"".join(struct.pack("<3f3B", *p, 255, 188, 0) for p in ((0, 0, 0), (1, 0, 0), (0, 1, 0)))
    (tmp_path / "a.ply").write_bytes(ply(header, rows + struct.pack("<B3i", 3, 0, 1, 2)))
    colors = load(tmp_path / "a.ply").meshes[0].colors
    assert colors is not None
    assert colors[0].tolist() == pytest.approx([1.0, 0.5029, 0.0], abs=1e-4)


def test_ply_keeps_normals_beside_texture_coordinates(tmp_path: Path) -> None:
    names = "".join(f"property float {n}\n" for n in ("nx", "ny", "nz", "s", "t"))
    rows = b"".join(struct.pack("<8f", *p, 0, 0, 1, *p[:2]) for p in ((0, 0, 0), (1, 0, 0), (0, 1, 0)))
    (tmp_path / "a.ply").write_bytes(ply(VERTICES + names + FACES, rows + struct.pack("<B3i", 3, 0, 1, 2)))
    mesh = load(tmp_path / "a.ply").meshes[0]
    assert mesh.uv is not None
    assert mesh.normals is not None
    assert mesh.uv.tolist() == [[0, 0], [1, 0], [0, 1]]
    assert mesh.normals.tolist() == [[0, 0, 1]] * 3


def test_ply_face_colours(tmp_path: Path) -> None:
    text = "0 0 0\n1 0 0\n0 1 0\n3 0 1 2 255 0 0\n"
    header = VERTICES + FACES + "property uchar red\nproperty uchar green\nproperty uchar blue\n"
    (tmp_path / "a.ply").write_bytes(ply(header, text.encode(), "ascii"))
    mesh = load(tmp_path / "a.ply").meshes[0]
    assert mesh.colors is not None
    assert mesh.colors.tolist() == [[1, 0, 0]] * 3


@pytest.mark.parametrize("binary", [True, False])
def test_stl_is_welded_for_smoothing(tmp_path: Path, binary: bool) -> None:
    vertices, faces = icosphere()
    triangles = vertices[faces].astype(np.float32)
    if binary:
        rows = b"".join(struct.pack("<12fH", 0, 0, 0, *t.reshape(-1), 0) for t in triangles)
        (tmp_path / "a.stl").write_bytes(b"\0" * 80 + struct.pack("<I", len(faces)) + rows)
    else:
        lines = ["solid ball"]
        for t in triangles:
            lines += [
                "facet normal 0 0 0",
                "outer loop",
                *(f"vertex {x} {y} {z}" for x, y, z in t.tolist()),
                "endloop",
                "endfacet",
            ]
        (tmp_path / "a.stl").write_text("\n".join([*lines, "endsolid ball\n"]))
    mesh = load(tmp_path / "a.stl").meshes[0]
    assert len(mesh.faces) == len(faces)
    assert mesh.normals is not None
    torch.testing.assert_close(mesh.normals, torch.nn.functional.normalize(mesh.vertices.float()), rtol=0, atol=0.03)


# ------------------------------------------------------------------------ names


def test_built_in_scene_by_name() -> None:
    scene = load("cornell_box")
    assert scene.geometry.triangle_count > 0


def test_unknown_names_and_kinds(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"no scene is named 'cornel_box'; known: .*did you mean 'cornell_box'"):
        load("cornel_box")
    with pytest.raises(SceneFileError, match=r"cannot read \.fbx; supported: \.toml, \.glb"):
        load(tmp_path / "a.fbx")
    with pytest.raises(SceneFileError, match="no such file"):
        load(tmp_path / "a.glb")
    with pytest.raises(SceneFileError, match="no such file"):
        load(tmp_path / "nothing")
    with pytest.raises(InputError, match="size must be left out where a file is read"):
        load(tmp_path / "a.glb", size=5)
