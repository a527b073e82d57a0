"""OBJ, MTL, PLY and STL in the forms that programs write: areas, colours and names are what the file says."""

from __future__ import annotations

import struct
import tracemalloc
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image

import torchrender as tr
from torchrender.errors import MeshError, NotUsedWarning, RepairedWarning, SceneFileError
from torchrender.images.files import write_image
from torchrender.scene.files.plain import numbers, ply_columns
from torchrender.scene.files.plain.polygons import triangulate
from torchrender.scene.load import load


def area(scene: tr.Scene) -> float:
    geometry = scene.geometry
    corners = geometry.vertices[geometry.faces.long()]
    return float(
        0.5 * torch.linalg.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]).norm(dim=1).sum()
    )


def signed_area(scene: tr.Scene) -> float:
    """Of a surface in the plane z = 0, seen from +z."""
    geometry = scene.geometry
    corners = geometry.vertices[geometry.faces.long()]
    return float(0.5 * torch.linalg.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])[:, 2].sum())


def text(folder: Path, name: str, content: str | bytes) -> Path:
    (folder / name).write_bytes(content if isinstance(content, bytes) else content.encode())
    return folder / name


# --------------------------------------------------------------------- polygons

CONCAVE = {
    "L": ([(0, 0), (2, 0), (2, 1), (1, 1), (1, 2), (0, 2)], 3.0),
    "U": ([(0, 0), (3, 0), (3, 2), (2, 2), (2, 1), (1, 1), (1, 2), (0, 2)], 5.0),
    "arrow": ([(0, 0), (2, 0), (2, 2), (1.5, 0.5)], 1.0),
    "arrow, reflex corner first": ([(1.5, 0.5), (0, 0), (2, 0), (2, 2)], 1.0),
    "square": ([(0, 0), (1, 0), (1, 1), (0, 1)], 1.0),
}


@pytest.mark.parametrize("shape", CONCAVE)
@pytest.mark.parametrize("turned", [False, True])
@pytest.mark.parametrize("suffix", [".obj", ".ply"])
def test_concave_polygons_cover_their_area_and_keep_their_side(
    tmp_path: Path, shape: str, turned: bool, suffix: str
) -> None:
    points, expected = CONCAVE[shape]
    points = points[::-1] if turned else points
    rows = "".join(f"{'v ' if suffix == '.obj' else ''}{x} {y} 0\n" for x, y in points)
    count = len(points)
    if suffix == ".obj":
        content = rows + "f " + " ".join(str(k + 1) for k in range(count)) + "\n"
    else:
        head = f"ply\nformat ascii 1.0\nelement vertex {count}\nproperty float x\nproperty float y\nproperty float z\n"
        head += "element face 1\nproperty list uchar int vertex_index\nend_header\n"
        content = head + rows + f"{count} " + " ".join(map(str, range(count))) + "\n"
    scene = load(text(tmp_path, f"a{suffix}", content))
    assert area(scene) == pytest.approx(expected)
    assert signed_area(scene) == pytest.approx(-expected if turned else expected)


@settings(deadline=None)
@given(st.lists(st.floats(0.2, 1.0), min_size=3, max_size=25), st.integers(0, 2), st.integers(0, 24))
def test_star_shaped_polygons(radii: list[float], axis: int, start: int) -> None:
    """Any polygon around a point, in any plane, from any corner on: the shoelace area, every triangle on its side."""
    angles = 2 * np.pi * np.arange(len(radii)) / len(radii)
    flat = np.stack([np.cos(angles), np.sin(angles)], axis=1) * np.array(radii)[:, None]
    flat = np.roll(flat, start % len(radii), axis=0)
    points = np.zeros((len(radii), 3))
    points[:, (axis + 1) % 3], points[:, (axis + 2) % 3] = flat[:, 0], flat[:, 1]
    places, _ = triangulate(points, np.arange(len(radii)), np.array([len(radii)]))
    a, b, c = (points[places[:, k]] for k in range(3))
    sides = 0.5 * np.cross(b - a, c - a)[:, axis]
    x, y = flat.T
    shoelace = 0.5 * float((x * np.roll(y, -1) - y * np.roll(x, -1)).sum())
    assert float(sides.sum()) == pytest.approx(shoelace, rel=1e-9)
    assert float(sides.min()) > -1e-9


# -------------------------------------------------------------------------- OBJ

SQUARE = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n"


@pytest.mark.parametrize(
    "faces",
    [
        "f 1 2 3 4", "f -4 -3 -2 -1", "f 1 -3 3 -1", "f 1// 2// 3// 4//", "f 1 2 \\\n3 4", "f 1 2 \\  \n 3 4",
        "f 1 2 3 4 # a square", "  f  1\t2  3 4 ", "f 1 2 3\nf 1 3 4\nf 1 3\nf", "s off\nf 1 2 3 4", "g a b\nf 1 2 3 4",
    ],
)  # fmt: skip
@pytest.mark.filterwarnings("ignore:.*left out")
def test_ways_to_write_a_square(tmp_path: Path, faces: str) -> None:
    assert signed_area(load(text(tmp_path, "a.obj", SQUARE + faces + "\n"))) == pytest.approx(1.0)


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "utf-16-le", "utf-16-be"])
@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
def test_encodings_and_line_ends(tmp_path: Path, encoding: str, end: str) -> None:
    content = ("o stühle\n" + SQUARE + "f 1 2 3 4\n").replace("\n", end)
    scene = load(text(tmp_path, "a.obj", content.encode(encoding)))
    assert area(scene) == 1.0 and scene.meshes[0].name == "stühle"


def test_relative_indices_count_from_where_they_stand(tmp_path: Path) -> None:
    content = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nf -3/-1 -2/-1 -1/-1\n"
    content += "v 5 0 0\nv 7 0 0\nv 5 2 0\nvt 1 1\nf -3/-1 -2/-1 -1/-2\n"
    scene = load(text(tmp_path, "a.obj", content))
    assert area(scene) == pytest.approx(0.5 + 2.0)
    uv = scene.meshes[0].uv
    assert uv is not None and sorted(set(map(tuple, uv.tolist()))) == [(0.0, 0.0), (1.0, 1.0)]


@pytest.mark.parametrize(
    ("faces", "message"),
    [
        ("f 1 2 9", "face 1 names vertex 9, there are 4"),
        ("f 1 2 -9", "face 1 names vertex -9, there are 4 before it"),
        ("f 1/1 2/1 3/1", "face 1 names texture coordinate 1, there are 0"),
        ("f 1 2 x", "a corner of a face is no index"),
        ("f 0 1 2", "face 1 names vertex 0"),
        ("v 1 2 x\nf 1 2 3", "holds something that is no number"),
    ],
)
def test_damaged_obj(tmp_path: Path, faces: str, message: str) -> None:
    with pytest.raises(SceneFileError, match=message):
        load(text(tmp_path, "a.obj", SQUARE + faces + "\n"))


@pytest.mark.parametrize("extra", ["0.25 0.5 1", "1 0.25 0.5 1", "0.25 0.5 1 1 1"])
def test_vertex_colours(tmp_path: Path, extra: str) -> None:
    content = "".join(f"{line} {extra}\n" for line in SQUARE.strip().split("\n")) + "f 1 2 3 4\n"
    colors = load(text(tmp_path, "a.obj", content)).meshes[0].colors
    expected = [0.25, 0.5, 1.0] if extra != "0.25 0.5 1 1 1" else [0.5, 1.0, 1.0]
    assert colors is not None and colors[0].tolist() == pytest.approx(expected)


def test_smoothing_groups(tmp_path: Path) -> None:
    """A roof of two slopes: flat without a group, smooth within one, split between two."""
    roof = "v -1 0 0\nv -1 0 1\nv 0 1 0\nv 0 1 1\nv 1 0 0\nv 1 0 1\n"
    ridges = {}
    for name, groups in {"off": ("off", "off"), "one": ("1", "1"), "two": ("1", "2")}.items():
        scene = load(text(tmp_path, "a.obj", f"{roof}s {groups[0]}\nf 1 2 4 3\ns {groups[1]}\nf 3 4 6 5\n"))
        geometry = scene.geometry
        assert geometry.normals is not None
        ridge = geometry.normals[geometry.vertices[:, 1] == 1.0]
        ridges[name] = float(ridge[:, 1].min())
    assert ridges == {"off": pytest.approx(0.5**0.5), "one": pytest.approx(1.0), "two": pytest.approx(0.5**0.5)}


def test_what_obj_holds_besides_surfaces_is_said(tmp_path: Path) -> None:
    content = SQUARE + "f 1 2 3 4\nl 1 2\nl 2 3\np 1\ncurv 0 1 1 2\nxyz 1\n"
    with pytest.warns(NotUsedWarning, match=r"lines \(2\), points \(1\), free-form .*\(1\), statement 'xyz' \(1\)"):
        load(text(tmp_path, "a.obj", content))


def test_faces_that_are_there_twice_are_kept_once(tmp_path: Path) -> None:
    with pytest.warns(RepairedWarning, match=r"faces that are there twice: kept once \(1\)"):
        scene = load(text(tmp_path, "a.obj", SQUARE + "f 1 2 3\nf 3 1 2\nf 3 2 1\n"))
    assert scene.geometry.triangle_count == 2  # the other side is no double


# -------------------------------------------------------------------------- MTL


def material(folder: Path, entry: str, *, library: str = "mtllib a.mtl") -> tr.Material:
    (folder / "a.mtl").write_text(f"newmtl paint it\n{entry}\n")
    content = f"{library}\n{SQUARE}vt 0 0\nusemtl paint it\nf 1/1 2/1 3/1 4/1\n"
    return load(text(folder, "a.obj", content)).materials[0]


def picture(folder: Path, name: str, color: Any, mode: str = "RGB") -> None:
    Image.new(mode, (2, 2), color).save(folder / name)


@pytest.mark.parametrize(
    ("entry", "opacity", "blend"),
    [("d 0.3", 0.3, True), ("Tr 0.7", 0.3, True), ("d 1", 1.0, False), ("d 0.3\nTr 0.3", 0.3, True)],
)
def test_opacity(tmp_path: Path, entry: str, opacity: float, blend: bool) -> None:
    made = material(tmp_path, entry)
    assert (made.opacity, made.blend) == (pytest.approx(opacity), blend)


def test_halo_and_spectral_colours_are_said(tmp_path: Path) -> None:
    with pytest.warns(NotUsedWarning, match="MTL kd spectral: 0.8 is taken.*MTL d -halo, the plain opacity is taken"):
        made = material(tmp_path, "d -halo 0.5\nKd spectral file.rfl")
    assert made.opacity == 0.5
    with pytest.warns(RepairedWarning, match="MTL kd xyz"):
        made = material(tmp_path, "Kd xyz 0.9505 1.0 1.089")
    assert made.diffuse.tolist() == pytest.approx([1.0, 1.0, 1.0], abs=2e-3)  # the white point of D65


@pytest.mark.parametrize(("model", "mirrors"), [(0, False), (1, False), (2, False), (3, True), (5, True)])
def test_illum_decides_about_reflection(tmp_path: Path, model: int, mirrors: bool) -> None:
    made = material(tmp_path, f"Ks 0.9 0.9 0.9\nNs 100\nillum {model}")
    assert made.is_reflector == mirrors
    # Model 2 keeps its highlight, 0 and 1 have none.
    assert (float(made.mirror_color.max()) > 0) == (model >= 2)


def test_black_under_a_picture_shows_the_picture(tmp_path: Path) -> None:
    picture(tmp_path, "red.png", (255, 0, 0))
    with pytest.warns(RepairedWarning, match="Kd 0 under a map_Kd"):
        made = material(tmp_path, "Kd 0 0 0\nmap_Kd red.png")
    assert made.diffuse_texture is not None
    assert (made.diffuse * made.diffuse_texture[0, 0]).tolist() == [1.0, 0.0, 0.0]


def test_options_of_maps(tmp_path: Path) -> None:
    picture(tmp_path, "my red.png", (255, 0, 0))
    made = material(tmp_path, "map_Kd -s 2 3 1 -o 0.5 0.25 -clamp on -mm 0.25 0.5 my red.png")
    sampler = made.sampler("diffuse_texture")
    assert sampler.transform.tolist() == [[2.0, 0.0, 0.5], [0.0, 3.0, 0.25]] and sampler.wrap_u == "clamp"
    assert made.diffuse_texture is not None and made.diffuse_texture[0, 0].tolist() == [0.75, 0.25, 0.25]


@pytest.mark.parametrize("name", ["a.bmp", "a.tga", "a.webp", "a.png"])
def test_kinds_of_pictures(tmp_path: Path, name: str) -> None:
    picture(tmp_path, name, (0, 0, 255))
    texture = material(tmp_path, f"map_Kd {name}").diffuse_texture
    assert texture is not None
    torch.testing.assert_close(texture[0, 0, :3], torch.tensor([0.0, 0.0, 1.0]), atol=0.02, rtol=0)


def test_metal_and_roughness(tmp_path: Path) -> None:
    picture(tmp_path, "rough.png", 51, "L")
    picture(tmp_path, "normal.png", (128, 128, 255))
    made = material(tmp_path, "Pm 0.5\nmap_Pr rough.png\nPc 0.25\nPcr 0.125\nnorm -bm 2 normal.png\nNi 1.4")
    assert (made.metallic, made.roughness, made.clearcoat, made.clearcoat_roughness) == (0.5, 1.0, 0.25, 0.125)
    assert made.ior == 1.4 and made.normal_scale == 2.0 and made.normal_texture is not None
    assert made.metallic_roughness_texture is not None
    assert made.metallic_roughness_texture[0, 0].tolist() == pytest.approx([1.0, 0.2, 1.0])


def test_heights_become_normals(tmp_path: Path) -> None:
    """A ramp that rises to the right leans to the left, by the slope that the file names."""
    ramp = np.repeat(np.linspace(0, 255, 16).astype(np.uint8)[None], 16, axis=0)
    Image.fromarray(ramp).save(tmp_path / "bump.png")
    texture = material(tmp_path, "map_Bump -bm 0.5 bump.png").normal_texture
    assert texture is not None
    normal = 2 * texture[8, 8] - 1
    assert float(normal[0]) < 0 and float(normal[1]) == pytest.approx(0.0, abs=1e-6)
    assert float(normal.norm()) == pytest.approx(1.0, abs=1e-5)


@pytest.mark.parametrize(("soft", "expected"), [(False, (0.5, False)), (True, (None, True))])
def test_masks_cut_or_blend(tmp_path: Path, soft: bool, expected: tuple[float | None, bool]) -> None:
    mask = np.tile(np.array([100, 150] if soft else [0, 255], np.uint8), (4, 2))
    Image.fromarray(mask).save(tmp_path / "mask.png")
    made = material(tmp_path, "map_d mask.png")
    assert (made.alpha_cutoff, made.blend) == expected
    assert made.diffuse_texture is not None and made.diffuse_texture.shape == (4, 4, 4)


@pytest.mark.parametrize("name", ["C:\\\\Users\\\\x\\\\Red.PNG", "/home/x/red.png", "RED.png", "../textures/red.png"])
def test_pictures_of_other_machines_are_found_beside_the_file(tmp_path: Path, name: str) -> None:
    write_image(tmp_path / "red.png", torch.tensor([1.0, 0.0, 0.0]).expand(2, 2, 3))
    (tmp_path / "a.mtl").write_text(f"newmtl a\nKd 1 1 1\nmap_Kd {name}\n")
    (tmp_path / "a.obj").write_text("mtllib A.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl a\nf 1 2 3\n")
    with pytest.warns(RepairedWarning, match=r"red\.png beside the file is taken"):
        found = load(tmp_path / "a.obj").materials[0].diffuse_texture
    assert found is not None and found[0, 0].tolist() == [1.0, 0.0, 0.0]


def test_columns_that_are_not_used_are_named(tmp_path: Path) -> None:
    (tmp_path / "a.ply").write_text(
        "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
        "property float quality\nproperty uchar red\nelement face 1\nproperty list uchar int vertex_indices\n"
        "property int flags\nend_header\n0 0 0 1 2\n1 0 0 1 2\n0 1 0 1 2\n3 0 1 2 7\n"
    )
    with pytest.warns(NotUsedWarning, match=r"columns of vertices: quality, red \(2\), columns of faces: flags \(1\)"):
        load(tmp_path / "a.ply")


def test_several_libraries(tmp_path: Path) -> None:
    (tmp_path / "b c.mtl").write_text("newmtl other\nKd 1 0 0\n")
    for library in ("mtllib none.mtl a.mtl", "mtllib b c.mtl\nmtllib a.mtl"):
        with pytest.warns(tr.scene.files.texture_file.MissingTextureWarning) if "none" in library else no_warning():
            assert material(tmp_path, "Kd 0 1 0", library=library).diffuse.tolist() == [0.0, 1.0, 0.0]


class no_warning:
    def __enter__(self) -> None: ...
    def __exit__(self, *_: object) -> None: ...


# -------------------------------------------------------------------------- PLY

TYPES = {
    "char": "b", "uchar": "B", "short": "h", "ushort": "H", "int": "i", "uint": "I", "float": "f", "double": "d",
    "int8": "b", "uint8": "B", "int16": "h", "uint16": "H", "int32": "i", "uint32": "I", "float32": "f", "float64": "d",
}  # fmt: skip


def ply(order: str, elements: list[tuple[str, list[str], list[list[Any]]]]) -> bytes:
    """A file of elements: name, properties as they stand in the header, rows of values and lists."""
    head = f"ply\nformat {order} 1.0\ncomment made by a test\n"
    body = b""
    for name, properties, rows in elements:
        head += f"element {name} {len(rows)}\n" + "".join(f"property {p}\n" for p in properties)
        for row in rows:
            words: list[str] = []
            for declared, value in zip(properties, row, strict=True):
                parts = declared.split()
                mark = ">" if order == "binary_big_endian" else "<"
                if parts[0] == "list":
                    words += [str(len(value)), *map(str, value)]
                    if order != "ascii":
                        body += struct.pack(mark + TYPES[parts[1]], len(value))
                        body += struct.pack(f"{mark}{len(value)}{TYPES[parts[2]]}", *value)
                else:
                    words.append(str(value))
                    body += b"" if order == "ascii" else struct.pack(mark + TYPES[parts[0]], value)
            body += (" ".join(words) + "\n").encode() if order == "ascii" else b""
    return head.encode() + b"end_header\n" + body


XYZ = ["float x", "float y", "float z"]
CORNERS = [[0, 0, 0], [2, 0, 0], [2, 1, 0], [0, 1, 0], [1, 3, 0]]
ORDERS = ["ascii", "binary_little_endian", "binary_big_endian"]


@pytest.mark.parametrize("order", ORDERS)
@pytest.mark.parametrize("lists", ["uchar int", "int uint", "ushort short", "uint8 uint16"])
@pytest.mark.parametrize("faces", [[[0, 1, 2, 3], [3, 2, 4]], [[3, 2, 4], [0, 1, 2, 3]], [[0, 1, 2, 4, 3]]])
def test_polygons_of_different_sizes(tmp_path: Path, order: str, lists: str, faces: list[list[int]]) -> None:
    data = ply(order, [("vertex", XYZ, CORNERS), ("face", [f"list {lists} vertex_indices"], [[f] for f in faces])])
    assert signed_area(load(text(tmp_path, "a.ply", data))) == pytest.approx(4.0)


@pytest.mark.parametrize("order", ORDERS)
def test_strips(tmp_path: Path, order: str) -> None:
    """Two strips in one list; triangles keep one side, and what is degenerate joins."""
    corners = [[0, 0, 0], [0, 1, 0], [1, 0, 0], [1, 1, 0], [2, 0, 0], [2, 1, 0]]
    strip = [0, 2, 1, 3, -1, 2, 4, 3, 5]
    data = ply(order, [("vertex", XYZ, corners), ("tristrips", ["list int int vertex_indices"], [[strip]])])
    assert signed_area(load(text(tmp_path, "a.ply", data))) == pytest.approx(2.0)


@pytest.mark.parametrize("order", ORDERS)
@pytest.mark.parametrize(
    ("kind", "names", "value", "expected"),
    [
        ("uchar", ("red", "green", "blue"), (255, 188, 0), (1.0, 0.5029, 0.0)),
        ("ushort", ("r", "g", "b"), (65535, 48316, 0), (1.0, 0.5029, 0.0)),
        ("short", ("diffuse_red", "diffuse_green", "diffuse_blue"), (255, 188, 0), (1.0, 0.5029, 0.0)),
        ("int", ("red", "green", "blue"), (255, 188, 0), (1.0, 0.5029, 0.0)),
        ("uint", ("red", "green", "blue"), (255, 188, 0), (1.0, 0.5029, 0.0)),
        ("float", ("red", "green", "blue"), (1.0, 0.5, 0.0), (1.0, 0.5, 0.0)),
        ("double", ("red", "green", "blue"), (1.0, 0.5, 0.0), (1.0, 0.5, 0.0)),
        ("float", ("red", "green", "blue"), (255.0, 188.0, 0.0), (1.0, 0.5029, 0.0)),
    ],
)
def test_colours_of_every_type_and_name(
    tmp_path: Path, order: str, kind: str, names: tuple[str, ...], value: Any, expected: tuple[float, ...]
) -> None:
    rows = [[*c, *value] for c in CORNERS]
    vertex = ("vertex", XYZ + [f"{kind} {n}" for n in names], rows)
    data = ply(order, [vertex, ("face", ["list uchar int vertex_indices"], [[[0, 1, 2]]])])
    colors = load(text(tmp_path, "a.ply", data)).meshes[0].colors
    assert colors is not None and colors[0].tolist() == pytest.approx(expected, abs=1e-3)
    points = tr.load_points(text(tmp_path, "b.ply", ply(order, [vertex])))
    assert points.color is not None and points.color[0].tolist() == pytest.approx(expected, abs=1e-3)


@pytest.mark.parametrize(
    "names", [("nx", "ny", "nz"), ("normal_x", "normal_y", "normal_z"), ("normalx", "normaly", "normalz")]
)
def test_names_of_normals(tmp_path: Path, names: tuple[str, ...]) -> None:
    vertex = ("vertex", XYZ + [f"float {n}" for n in names], [[*c, 0, 0, -2] for c in CORNERS])
    points = tr.load_points(text(tmp_path, "a.ply", ply("ascii", [vertex])))
    assert points.normal is not None and points.normal[0].tolist() == [0.0, 0.0, -1.0] and not points.two_sided


def test_pictures_and_coordinates(tmp_path: Path) -> None:
    picture(tmp_path, "red.png", (255, 0, 0))
    vertex = ("vertex", [*XYZ, "float texture_u", "float texture_v"], [[*c, c[0] / 2, c[1]] for c in CORNERS])
    data = ply("ascii", [vertex, ("face", ["list uchar int vertex_indices"], [[[0, 1, 2, 3]]])])
    data = data.replace(b"made by a test", b"TextureFile red.png")
    scene = load(text(tmp_path, "a.ply", data))
    assert scene.materials[0].diffuse_texture is not None and scene.meshes[0].uv is not None
    # Each corner of each face brings its own.
    faces = ("face", ["list uchar int vertex_indices", "list uchar float texcoord"], [[[0, 1, 2], [0, 0, 1, 0, 1, 1]]])
    scene = load(text(tmp_path, "b.ply", ply("binary_little_endian", [("vertex", XYZ, CORNERS), faces])))
    uv = scene.meshes[0].uv
    assert uv is not None and sorted(uv.tolist()) == [[0, 0], [1, 0], [1, 1]]


def test_vertices_that_are_not_finite_can_be_dropped(tmp_path: Path) -> None:
    corners = [*CORNERS[:4], ["nan", 3, 0]]
    faces = ("face", ["list uchar int vertex_indices"], [[[0, 1, 2, 3]], [[3, 2, 4]]])
    path = text(tmp_path, "a.ply", ply("ascii", [("vertex", XYZ, corners), faces]))
    with pytest.raises(MeshError, match="1 of 5 vertices are NaN or infinite"):
        load(path)
    with pytest.warns(RepairedWarning, match=r"dropped with their faces \(1\)"):
        scene = load(path, drop_invalid=True)
    assert area(scene) == pytest.approx(2.0)
    points = text(tmp_path, "b.ply", ply("ascii", [("vertex", XYZ, corners)]))
    with pytest.raises(SceneFileError, match="1 of 5 points are NaN or infinite, first 4"):
        tr.load_points(points)
    with pytest.warns(RepairedWarning, match=r"points that are NaN or infinite: dropped \(1\)"):
        assert len(tr.load_points(points, drop_invalid=True)) == 4


def test_normals_that_are_not_finite_are_said_and_not_known(tmp_path: Path) -> None:
    normals = [[0, 0, 1], ["nan", 0, 1], [0, 0, 1], [0, "inf", 0], [0, 0, 1]]
    rows = [[*corner, *normal] for corner, normal in zip(CORNERS, normals, strict=True)]
    vertex = ("vertex", [*XYZ, "float nx", "float ny", "float nz"], rows)
    told = r"repaired: normals that are NaN or infinite: taken as not known \(2\)"
    faces = ("face", ["list uchar int vertex_indices"], [[[0, 1, 2, 3]]])
    with pytest.warns(RepairedWarning, match=told):
        mesh = load(text(tmp_path, "a.ply", ply("ascii", [vertex, faces]))).meshes[0]
    assert mesh.normals is not None
    assert mesh.normals.tolist() == [[0, 0, 1], [0, 0, 0], [0, 0, 1], [0, 0, 0], [0, 0, 1]]
    points = text(tmp_path, "b.ply", ply("ascii", [vertex]))
    with pytest.warns(RepairedWarning, match=told):
        cloud = tr.load_points(points)
    assert cloud.normal is not None and bool((cloud.normal.norm(dim=1) > 0.99).all()), "they are estimated"
    with pytest.warns(RepairedWarning, match=told):
        tr.pack_points(points, tmp_path / "b.trp")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ((b"float x", b"half x"), "unknown type 'half'"),
        ((b"ascii", b"morse"), "unknown format 'morse'"),
        ((b"0 0 0\n", b"0 0 x\n"), "text that is no number"),
        ((b"3 0 1 2", b"3 0 1 9"), "faces must index 5 vertices, got 0 to 9"),
        ((b"3 0 1 2", b"3 0 1"), "cut off"),
        ((b"end_header", b"property float w\nnonsense\nend_header"), "damaged header: 'nonsense'"),
    ],
)
def test_damaged_ply(tmp_path: Path, change: tuple[bytes, bytes], message: str) -> None:
    data = ply("ascii", [("vertex", XYZ, CORNERS), ("face", ["list uchar int vertex_indices"], [[[0, 1, 2]]])])
    with pytest.raises(SceneFileError, match=message):
        load(text(tmp_path, "a.ply", data.replace(*change)))


# -------------------------------------------------------------------------- STL


def stl(attributes: list[int], header: bytes = b"", behind: bytes = b"") -> bytes:
    rows = b""
    for k, attribute in enumerate(attributes):
        rows += struct.pack("<12fH", 0, 0, 1, k, 0, 0, k + 1, 0, 0, k, 1, 0, attribute)
    return header.ljust(80, b" ") + struct.pack("<I", len(attributes)) + rows + behind


def test_bytes_behind_the_last_facet(tmp_path: Path) -> None:
    with pytest.warns(NotUsedWarning, match=r"bytes behind the last facet \(7\)"):
        scene = load(text(tmp_path, "a.stl", stl([0], behind=b"trailer")))
    assert area(scene) == 0.5
    with pytest.raises(SceneFileError, match="cut off: declares 2 facets"):
        load(text(tmp_path, "b.stl", stl([0, 0])[:-3]))


def test_a_binary_file_may_begin_with_solid(tmp_path: Path) -> None:
    assert area(load(text(tmp_path, "a.stl", stl([0, 0], header=b"solid facet")))) == 1.0


@pytest.mark.parametrize(
    ("header", "attribute", "expected"),
    [
        (b"", 0x8000 | 31, (0.0, 0.0, 1.0)),  # VisCAM: blue in the lowest bits
        (b"", 0x8000 | 31 << 10, (1.0, 0.0, 0.0)),
        (b"COLOR=\xff\x00\x00\xff", 31, (1.0, 0.0, 0.0)),  # Magics: red in the lowest bits
        (b"COLOR=\x00\xff\x00\xff", 31 << 10, (0.0, 0.0, 1.0)),
        (b"COLOR=\x00\xff\x00\xff", 0x8000, (0.0, 1.0, 0.0)),  # the colour of the whole
    ],
)
def test_colours_of_both_dialects(tmp_path: Path, header: bytes, attribute: int, expected: tuple[float, ...]) -> None:
    colors = load(text(tmp_path, "a.stl", stl([attribute], header=header))).meshes[0].colors
    assert colors is not None and colors[0].tolist() == pytest.approx(expected)
    assert load(text(tmp_path, "b.stl", stl([0]))).meshes[0].colors is None


def test_several_solids(tmp_path: Path) -> None:
    facet = "facet normal 0 0 1\nouter loop\nvertex {0} 0 0\nvertex {1} 0 0\nVERTEX {0} 1 0\nendloop\nendfacet\n"
    content = "".join(f"solid part {k}\n{facet.format(2 * k, 2 * k + 1)}endsolid\n" for k in range(3))
    scene = load(text(tmp_path, "a.stl", content))
    assert [m.name for m in scene.meshes] == ["part 0", "part 1", "part 2"]
    assert [m.object_id for m in scene.meshes] == [0, 1, 2] and area(scene) == pytest.approx(1.5)
    with pytest.raises(SceneFileError, match="2 corners are no whole triangles"):
        load(text(tmp_path, "b.stl", content[: content.index("VERTEX")]))


# ------------------------------------------------------------------ large files


def test_text_is_parsed_block_by_block_within_four_times_the_mesh(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Wherever a block ends, numbers are whole; and the memory beside the mesh is less than three of it."""
    monkeypatch.setattr(numbers, "BLOCK", 1 << 16)
    monkeypatch.setattr(ply_columns, "ROWS", 1 << 12)
    side = 180
    u, v = np.meshgrid(np.arange(side) / side, np.arange(side) / side)
    points = np.stack([u, v, 0.1 * np.sin(9 * u) * np.cos(7 * v)], axis=-1).reshape(-1, 3).round(6)
    corner = np.arange(side * side).reshape(side, side)
    a, b, c, d = (corner[i : side - 1 + i, j : side - 1 + j].reshape(-1) for i, j in ((0, 0), (0, 1), (1, 1), (1, 0)))
    faces = np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])
    head = f"ply\nformat ascii 1.0\nelement vertex {len(points)}\nproperty float x\nproperty float y\n"
    head += f"property float z\nelement face {len(faces)}\nproperty list uchar int vertex_indices\nend_header\n"
    rows = [" ".join(map(repr, p)) for p in points.tolist()] + [f"3 {i} {j} {k}" for i, j, k in faces.tolist()]
    (tmp_path / "a.ply").write_text(head + "\n".join(rows) + "\n")
    load(tmp_path / "a.ply")  # compiled and imported
    tracemalloc.start()
    try:
        mesh = load(tmp_path / "a.ply").meshes[0]
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert np.array_equal(mesh.vertices.numpy(), points) and np.array_equal(mesh.faces.numpy(), faces)
    assert mesh.normals is not None
    size = sum(t.numel() * t.element_size() for t in (mesh.vertices, mesh.faces, mesh.normals))
    assert peak < 4.0 * size


@pytest.mark.parametrize("block", [1, 2, 5, 17])
def test_blocks_may_end_anywhere(monkeypatch: pytest.MonkeyPatch, block: int) -> None:
    monkeypatch.setattr(numbers, "BLOCK", block)
    text = b" 1.5 -2e3\n\t7 nan   1e400 12345678901234567890\r\n"
    found = numbers.numbers_of(text)
    np.testing.assert_array_equal(found, [1.5, -2e3, 7.0, np.nan, np.inf, 12345678901234567890.0])
    with pytest.raises(ValueError, match="'x' is no number"):
        numbers.numbers_of(b"1 2 x 3")


@pytest.mark.parametrize("kind", ["ply", "obj"])
def test_vertices_keep_their_order_and_copies_of_sharp_edges_stand_behind_them(tmp_path: Path, kind: str) -> None:
    corners = [(x, y, z) for z in (0, 1) for y in (0, 1) for x in (0, 1)] + [(5, 5, 5)]
    faces = [(6, 7, 5), (6, 5, 4), (0, 2, 3), (0, 3, 1), (1, 3, 7), (1, 7, 5)]
    if kind == "ply":
        rows = [" ".join(map(str, row)) for row in corners] + [f"3 {a} {b} {c}" for a, b, c in faces]
        head = ["ply", "format ascii 1.0", "element vertex 9", *(f"property float {n}" for n in "xyz")]
        head += ["element face 6", "property list uchar int vertex_indices", "end_header"]
        content = "\n".join([*head, *rows, ""])
    else:
        rows = [f"v {x} {y} {z}" for x, y, z in corners] + [f"f {a + 1} {b + 1} {c + 1}" for a, b, c in faces]
        content = "\n".join([*rows, ""])
    mesh = tr.load(text(tmp_path, f"cube.{kind}", content)).meshes[0]
    given = torch.tensor(corners, dtype=torch.float64)
    if kind == "ply":
        assert torch.equal(mesh.vertices[:9].double(), given)
    assert torch.equal(mesh.vertices[mesh.faces].double(), given[torch.tensor(faces)])
    assert mesh.normals is not None and len(mesh.vertices) > 9


@pytest.mark.parametrize("order", ["ascii", "binary_little_endian"])
def test_a_header_that_declares_fewer_vertices_than_there_are_is_told(tmp_path: Path, order: str) -> None:
    """What follows is read as faces, which then are none."""
    head = f"ply\nformat {order} 1.0\nelement vertex 2\nproperty float x\nproperty float y\nproperty float z\n"
    head += "element face 1\nproperty list uchar int vertex_indices\nend_header\n"
    rows = b"0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n"
    if order != "ascii":
        rows = struct.pack("<9f", 0, 0, 0, 1, 0, 0, 0, 1, 0) + struct.pack("<B3i", 3, 0, 1, 2)
    path = text(tmp_path, "a.ply", head.encode() + rows)
    told = r"holds no triangles \(.*less than three corners.*data behind the rows that the header declares"
    with pytest.raises(SceneFileError, match=told):
        load(path)


@pytest.mark.parametrize(("rest", "said"), [(b"", False), (b"\n\n", False), (b"\0\0", False), (b"\1\2\3", True)])
def test_data_behind_a_binary_file_are_told(tmp_path: Path, rest: bytes, said: bool) -> None:
    head = "ply\nformat binary_little_endian 1.0\nelement vertex 3\nproperty float x\nproperty float y\n"
    head += "property float z\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n"
    rows = struct.pack("<9f", 0, 0, 0, 1, 0, 0, 0, 1, 0) + struct.pack("<B3i", 3, 0, 1, 2)
    path = text(tmp_path, "a.ply", head.encode() + rows + rest)
    with warnings.catch_warnings(record=True) as found:
        warnings.simplefilter("always", NotUsedWarning)
        assert load(path).geometry.triangle_count == 1
    assert any("data behind the rows" in str(w.message) for w in found) == said
