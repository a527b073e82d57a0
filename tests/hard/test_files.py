"""Damaged, hostile and odd files: always an error that names the file, never a crash, a hang or garbage."""

from __future__ import annotations

import json
import struct
import zlib
from pathlib import Path

import numpy as np
import OpenEXR
import pytest
import torch
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from PIL import Image

from gltf_builder import TRIANGLE, Glb
from torchrender.errors import ImageFileError, MeshError, SceneFileError, TorchRenderError
from torchrender.images.files import MAX_PIXELS, read_image, read_image_bytes, write_image
from torchrender.report.fuzz.seeds import glb, seeds
from torchrender.scene.files.volume_file import read_volume
from torchrender.scene.load import load

MESH_SUFFIXES = (".glb", ".gltf", ".obj", ".ply", ".stl", ".toml")
IMAGE_SUFFIXES = (".png", ".jpg", ".hdr", ".exr")


def triangle() -> Glb:
    glb = Glb(nodes=[{"mesh": 0, "name": "thing"}])
    glb.mesh(faces=[0, 1, 2])
    return glb


# ------------------------------------------------------------ missing and broken


@pytest.mark.parametrize("suffix", (*MESH_SUFFIXES, *IMAGE_SUFFIXES))
def test_missing_empty_and_folder(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"thing{suffix}"
    read = read_image if suffix in IMAGE_SUFFIXES else load
    with pytest.raises(SceneFileError, match=r"thing.*: no such file"):
        read(path)
    path.write_bytes(b"")
    with pytest.raises(SceneFileError, match=r"thing.*: the file is empty"):
        read(path)
    path.unlink()
    path.mkdir()
    with pytest.raises(SceneFileError, match=r"thing.*: Is a directory"):
        read(path)


@pytest.mark.parametrize("suffix", (*MESH_SUFFIXES, *IMAGE_SUFFIXES))
@pytest.mark.parametrize("content", [b"\0" * 200, b"hello world\n" * 9, b"\xff\xfe" * 99, b"{}", b"[" * 100_000])
def test_other_content(tmp_path: Path, suffix: str, content: bytes) -> None:
    path = tmp_path / f"thing{suffix}"
    path.write_bytes(content)
    with pytest.raises(SceneFileError, match="thing"):
        (read_image if suffix in IMAGE_SUFFIXES else load)(path)


@pytest.mark.parametrize("name", ["coffee.png", "china.jpg"])
@pytest.mark.parametrize("share", [0.001, 0.1, 0.5, 0.99])
def test_cut_off_photos(tmp_path: Path, data_dir: Path, name: str, share: float) -> None:
    data = (data_dir / "photos" / name).read_bytes()
    (tmp_path / name).write_bytes(data[: int(len(data) * share)])
    with pytest.raises(ImageFileError, match=name):
        read_image(tmp_path / name)


@pytest.mark.parametrize("name", ["museum.exr", "pisa_latlong_small.hdr"])
@pytest.mark.parametrize("share", [0.001, 0.1, 0.5, 0.99])
def test_cut_off_environments(tmp_path: Path, data_dir: Path, name: str, share: float) -> None:
    data = (data_dir / "envmaps" / name).read_bytes()
    (tmp_path / name).write_bytes(data[: int(len(data) * share)])
    with pytest.raises(ImageFileError, match=name):
        read_image(tmp_path / name)


@pytest.mark.parametrize("name", ["meshes/spot_textured.glb", "meshes/stanford_bunny.ply", "scenes/forest_tile.glb"])
@pytest.mark.parametrize("share", [0.00005, 0.01, 0.5, 0.999])
def test_cut_off_meshes(tmp_path: Path, data_dir: Path, name: str, share: float) -> None:
    source = data_dir / name
    data = source.read_bytes()
    path = tmp_path / source.name
    path.write_bytes(data[: int(len(data) * share)])
    with pytest.raises(SceneFileError, match=source.name):
        load(path)


@settings(deadline=None, max_examples=50, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.lists(st.tuples(st.floats(0, 1, exclude_max=True), st.integers(0, 255)), min_size=1, max_size=6))
def test_flipped_bytes_in_glb(tmp_path: Path, changes: list[tuple[float, int]]) -> None:
    """Whatever a byte is changed to: a scene of finite vertices, or one of this package's errors."""
    data = bytearray(triangle().bytes())
    for place, value in changes:
        data[int(place * len(data))] = value
    (tmp_path / "a.glb").write_bytes(bytes(data))
    try:
        scene = load(tmp_path / "a.glb")
    except TorchRenderError:
        return
    assert bool(torch.isfinite(scene.geometry.vertices).all())


@settings(deadline=None, max_examples=50, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.sampled_from([".obj", ".ply", ".stl", ".toml"]), st.data())
def test_flipped_bytes_in_text(tmp_path: Path, suffix: str, data: st.DataObject) -> None:
    text = bytearray(TEXTS[suffix])
    for _ in range(data.draw(st.integers(1, 4))):
        text[data.draw(st.integers(0, len(text) - 1))] = data.draw(st.integers(0, 255))
    (tmp_path / f"a{suffix}").write_bytes(bytes(text))
    try:
        scene = load(tmp_path / f"a{suffix}")
    except TorchRenderError:
        return
    assert bool(torch.isfinite(scene.geometry.vertices).all())


TEXTS = {
    ".obj": b"v 0 0 0\nv 1 0 0\nv 0 1 0\nvn 0 0 1\nf 1//1 2//1 3//1\n",
    ".ply": b"ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
    b"element face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n",
    ".stl": b"solid a\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\n"
    b"endsolid a\n",
    ".toml": b"name = 'a'\n[[geometry]]\nshape = 'box'\nsize = [1, 2, 3]\n"
    b"[[light]]\ntype = 'point'\nposition = [1, 2, 3]\n",
}


# ------------------------------------------------------------------------- bombs


def test_declared_counts_are_checked_before_memory_is_taken(tmp_path: Path) -> None:
    glb = triangle()
    glb.json["accessors"][0]["count"] = 2**40
    with pytest.raises(SceneFileError, match=r"accessors\[0\]: declares 1099511627776 elements"):
        load(glb.write(tmp_path / "a.glb"))
    glb = triangle()
    glb.json["accessors"][0].pop("bufferView")
    glb.json["accessors"][0]["count"] = 2**40
    with pytest.raises(SceneFileError, match=r"accessors\[0\]: declares 1099511627776 elements without data"):
        load(glb.write(tmp_path / "a.glb"))
    glb = triangle()
    glb.json["accessors"][1]["count"] = 3 * 10**12
    with pytest.raises(SceneFileError, match=r"declares 1000000000000 triangles, the limit is 50000000"):
        load(glb.write(tmp_path / "a.glb"))


def test_many_instances_of_one_mesh(tmp_path: Path) -> None:
    glb = Glb(nodes=[{"children": list(range(1, 3001))}, *[{"mesh": 0}] * 3000])
    glb.mesh(faces=np.tile([0, 1, 2], 20_000))
    with pytest.raises(SceneFileError, match="declares 60000000 triangles"):
        load(glb.write(tmp_path / "a.glb"))


@pytest.mark.parametrize("kind", ["ascii", "binary_little_endian"])
def test_ply_counts(tmp_path: Path, kind: str) -> None:
    header = TEXTS[".ply"].replace(b"ascii", kind.encode()).replace(b"vertex 3", b"vertex 9000000000000")
    (tmp_path / "a.ply").write_bytes(header)
    with pytest.raises(SceneFileError, match=r"a\.ply: cut off: the header declares at least"):
        load(tmp_path / "a.ply")


def test_stl_count(tmp_path: Path) -> None:
    (tmp_path / "a.stl").write_bytes(b"\0" * 80 + struct.pack("<I", 2**32 - 1) + b"\0" * 50)
    with pytest.raises(SceneFileError, match=r"a\.stl"):
        load(tmp_path / "a.stl")


def png_of_size(width: int, height: int) -> bytes:
    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    head = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    return (
        b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", zlib.compress(b"\0" * 100)) + chunk(b"IEND", b"")
    )


@pytest.mark.parametrize("size", [(30000, 30000), (2**31 - 1, 2**31 - 1)])
def test_pictures_of_huge_declared_size(tmp_path: Path, size: tuple[int, int]) -> None:
    width, height = size
    hdr = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y %d +X %d\n" % (min(height, 10**9 - 1), min(width, 10**9 - 1))
    for suffix, data in ((".png", png_of_size(width, height)), (".hdr", hdr)):
        (tmp_path / f"big{suffix}").write_bytes(data)
        with pytest.raises(ImageFileError, match=rf"big\{suffix}: declares .*limit (is|of) {MAX_PIXELS}"):
            read_image(tmp_path / f"big{suffix}")


def test_a_picture_of_16k_declared_in_200_bytes(tmp_path: Path) -> None:
    """Within the limit of pixels, but no file of that size can hold them: refused before memory is taken."""
    data = png_of_size(16384, 16384)
    (tmp_path / "a.png").write_bytes(data)
    assert len(data) < 200
    with pytest.raises(
        ImageFileError, match=r"declares 16384 x 16384 pixels, \d+ bytes cannot|declares more pixels than the limit"
    ):
        read_image(tmp_path / "a.png")


def test_draco_streams_that_declare_more_than_they_hold(tmp_path: Path) -> None:
    suffix, data = seeds()["glb draco"]
    start = data.index(b"DRACO")
    sequential = data[start + 8] == 0
    place = start + (11 if sequential else 12)
    # Numbers of seven bits a byte: two to the 35th, in place of the first count.
    bomb = data[:place] + b"\xff\xff\xff\xff\x7f" + data[place + 5 :]
    (tmp_path / f"a{suffix}").write_bytes(bomb)
    with pytest.raises(SceneFileError, match=r"KHR_draco_mesh_compression: declares \d{10,} faces"):
        load(tmp_path / f"a{suffix}")


@pytest.mark.parametrize("count", [2**20, 2**31 - 1, 2**40])
def test_meshopt_streams_that_declare_more_than_they_hold(tmp_path: Path, count: int) -> None:
    suffix, data = seeds()["glb meshopt"]
    text = data[20 : 20 + struct.unpack_from("<I", data, 12)[0]]
    document = json.loads(text)
    entry = document["bufferViews"][0]["extensions"]["EXT_meshopt_compression"]
    entry["count"] = count
    (tmp_path / f"a{suffix}").write_bytes(glb((document, data[28 + len(text) :])))
    with pytest.raises(SceneFileError, match=r"EXT_meshopt_compression: (declares|unfolds|damaged)"):
        load(tmp_path / f"a{suffix}")


def test_exr_of_huge_declared_size(tmp_path: Path) -> None:
    write_image(tmp_path / "a.exr", torch.zeros(4, 4, 3))
    data = (tmp_path / "a.exr").read_bytes()
    window = struct.pack("<4i", 0, 0, 3, 3)
    (tmp_path / "a.exr").write_bytes(data.replace(window, struct.pack("<4i", 0, 0, 99_999, 99_999)))
    with pytest.raises(ImageFileError, match=rf"a\.exr: declares 100000 x 100000 pixels, the limit is {MAX_PIXELS}"):
        read_image(tmp_path / "a.exr")


def test_volume_counts(tmp_path: Path) -> None:
    head = b"VOL\x03" + struct.pack("<5i6f", 1, 60000, 60000, 60000, 1, 0, 0, 0, 1, 1, 1)
    (tmp_path / "a.vol").write_bytes(head)
    with pytest.raises(SceneFileError, match="cut off or too large"):
        read_volume(tmp_path / "a.vol")
    np.save(tmp_path / "a.npy", np.array([[[-1.0]]]))
    with pytest.raises(SceneFileError, match="must be finite and not negative"):
        read_volume(tmp_path / "a.npy")
    np.save(tmp_path / "b.npy", np.array([[["x"]]], dtype=object), allow_pickle=True)
    with pytest.raises(SceneFileError, match=r"must hold numbers \(D, H, W\)"):
        read_volume(tmp_path / "b.npy")


# ------------------------------------------------------------------- odd numbers


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_nan_vertices_name_the_mesh(tmp_path: Path, bad: float) -> None:
    vertices = np.array(TRIANGLE)
    vertices[1, 2] = bad
    glb = Glb(nodes=[{"mesh": 0, "name": "thing"}])
    glb.mesh(vertices)
    with pytest.raises(MeshError, match=r"mesh 'thing': 1 of 3 vertices are NaN or infinite"):
        load(glb.write(tmp_path / "a.glb"))
    rows = b"".join(struct.pack("<12fH", 0, 0, 0, *t.reshape(-1), 0) for t in [vertices.astype(np.float32)])
    (tmp_path / "scan.stl").write_bytes(b"\0" * 80 + struct.pack("<I", 1) + rows)
    with pytest.raises(MeshError, match=r"mesh 'scan': 1 of 3 vertices"):
        load(tmp_path / "scan.stl")


def test_indices_beyond_the_vertices(tmp_path: Path) -> None:
    glb = Glb(nodes=[{"mesh": 0}])
    glb.mesh(faces=[0, 1, 7])
    with pytest.raises(SceneFileError, match=r"meshes\[0\]\.primitives\[0\]: indices must be below 3, got 7"):
        load(glb.write(tmp_path / "a.glb"))
    (tmp_path / "a.obj").write_bytes(TEXTS[".obj"].replace(b"3//1", b"9//1"))
    with pytest.raises((SceneFileError, MeshError), match="a"):
        load(tmp_path / "a.obj")


@pytest.mark.parametrize(
    ("node", "message"),
    [
        ({"matrix": [1, 2, 3]}, r"nodes\[0\]\.matrix: must be 16 finite numbers"),
        ({"translation": ["x", 0, 0]}, r"nodes\[0\]\.translation: must be 3 finite numbers"),
        ({"mesh": 5}, r"meshes\[5\]: there is no such entry, meshes has 1"),
        ({"mesh": -1}, r"meshes\[-1\]: there is no such entry"),
        ({"mesh": 0, "children": [0]}, r"nodes\[0\]: is reached twice"),
        ({"mesh": 0, "children": [9]}, r"nodes\[9\]: there is no such entry"),
    ],
)
def test_bad_nodes(tmp_path: Path, node: dict[str, object], message: str) -> None:
    glb = triangle()
    glb.json["nodes"] = [node]
    with pytest.raises(SceneFileError, match=message):
        load(glb.write(tmp_path / "a.glb"))


@pytest.mark.parametrize("scale", [1e14, 1e-30, 1e-200])
def test_extreme_scales_keep_unit_normals(tmp_path: Path, scale: float) -> None:
    glb = triangle()
    glb.json["nodes"][0]["scale"] = [scale] * 3
    normals = load(glb.write(tmp_path / "a.glb")).geometry.normals
    assert normals is not None and bool(((normals.norm(dim=1) - 1).abs() < 1e-5).all())


def test_scales_that_light_cannot_count_are_refused(tmp_path: Path) -> None:
    glb = triangle()
    glb.json["nodes"][0]["scale"] = [1e30] * 3
    with pytest.raises(TorchRenderError, match="must lie within 1e\\+15 scene units"):
        load(glb.write(tmp_path / "a.glb"))


def test_flattened_instances_have_no_normals(tmp_path: Path) -> None:
    glb = triangle()
    glb.json["nodes"][0]["scale"] = [1, 1, 0]
    mesh = load(glb.write(tmp_path / "a.glb")).meshes[0]
    assert mesh.normals is None
    assert bool(torch.isfinite(mesh.vertices).all())


def test_required_extensions_that_are_unknown(tmp_path: Path) -> None:
    glb = triangle()
    glb.json["extensionsRequired"] = ["EXT_of_nobody"]
    with pytest.raises(SceneFileError, match="not supported: EXT_of_nobody"):
        load(glb.write(tmp_path / "a.glb"))


def test_files_outside_are_not_fetched_from_the_web(tmp_path: Path) -> None:
    glb = triangle()
    glb.json["buffers"] = [{"byteLength": 10, "uri": "https://example.org/a.bin"}]
    with pytest.raises(SceneFileError, match="web addresses are not fetched"):
        load(glb.write(tmp_path / "a.glb"))


def test_exr_with_nothing_to_show(tmp_path: Path) -> None:
    planes = {"Z": np.zeros((2, 2), np.float32)}
    with OpenEXR.File({"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}, planes) as file:
        file.write(str(tmp_path / "z.exr"))
    with pytest.raises(ImageFileError, match="has Z"):
        read_image(tmp_path / "z.exr")


def test_suffix_may_lie_about_the_kind(tmp_path: Path) -> None:
    Image.new("RGB", (3, 2)).save(tmp_path / "a.jpg", "PNG")
    assert read_image(tmp_path / "a.jpg").shape == (2, 3, 3)
    with pytest.raises(ImageFileError, match="no picture of a known kind"):
        read_image_bytes(b"GIF89a" + b"\0" * 50, "a.gif")
