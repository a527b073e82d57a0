"""Files of compressed points: whole, piece by piece, and damaged."""

from __future__ import annotations

import struct
import zlib

import pytest
import torch
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from point_scenes import sphere_cloud
from torchrender.errors import ImageFileError, PointFileError
from torchrender.points.codec import compress
from torchrender.points.draw import render_points
from torchrender.points.file import open_points, write_points
from torchrender.points.tree import PatchOptions, build_patches
from torchrender.scene.camera import Cameras


@pytest.fixture(scope="module")
def model():
    return build_patches(sphere_cloud(20_000), PatchOptions(max_points=512))


@pytest.fixture
def file(model, tmp_path):
    path = tmp_path / "sphere.trp"
    size = write_points(path, model)
    assert size == path.stat().st_size
    return path


@pytest.mark.parametrize("normals", ["angles", "octahedron"])
def test_a_file_holds_the_model(model, tmp_path, normals):
    path = tmp_path / "model.trp"
    write_points(path, model, normals=normals)
    read = open_points(path)
    camera = model.camera(width=96, height=96)
    first, second = (render_points(p, camera) for p in (compress(model, normals=normals), read))
    for name in ("image", "depth", "weight"):
        assert torch.equal(getattr(first, name), getattr(second, name))
    assert (read.name, read.two_sided, read.point_count) == ("model", False, model.point_count)


def test_only_what_is_in_view_is_read(file):
    points = open_points(file)
    assert points.nodes.access.nodes_read == 0
    close = Cameras.look_at([0.0, 0.0, 1.3], [0.0, 0.0, 0.0], width=64, height=64, fov_deg=20)
    drawn = render_points(points, close).statistics[0]
    assert points.nodes.access.nodes_read == drawn.nodes < 0.05 * len(points.nodes)
    assert drawn.bytes_read == 8 * drawn.nodes
    before = points.nodes.access.nodes_read
    render_points(points, close)
    assert points.nodes.access.nodes_read == before


def test_points_without_colours_and_two_sided(tmp_path):
    cloud = sphere_cloud(500, colored=False)
    object.__setattr__(cloud, "two_sided", True)
    path = tmp_path / "plain.trp"
    write_points(path, build_patches(cloud))
    read = open_points(path)
    assert read.two_sided and not read.nodes.has_color


def test_damage_to_nodes_shows_where_they_are_drawn(file):
    data = bytearray(file.read_bytes())
    data[-1] ^= 1  # the last colour of the last patch's deepest level
    file.write_bytes(data)
    points = open_points(file)
    whole = Cameras.look_at([0.0, 0.0, 3.0], [0.0, 0.0, 0.0], width=64, height=64)
    depth = torch.full((1,), int((points.headers.start[-1, 1:] > points.headers.start[-1, :-1]).sum()) - 1)
    with pytest.raises(PointFileError, match=r"sphere\.trp.*checksum of patch"):
        points.nodes.gather(points, torch.tensor([len(points.headers) - 1]), depth)
    assert render_points(points, whole[[]]).image.shape[0] == 0


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (lambda d: d[:0], "no file of compressed points"),
        (lambda d: b"PNG" + d, "no file of compressed points"),
        (lambda d: d[:40], "no file of compressed points"),
        (lambda d: d[:-1], "cut off"),
        (lambda d: d[:4000], "cut off"),
        (lambda d: d + b"\0", "cut off or damaged"),
        (lambda d: d[:8] + struct.pack("<I", 2) + d[12:], "version 2"),
        (lambda d: d[:16] + b"\xff" * 8 + d[24:], "checksum of the preamble"),
        (lambda d: d[:100] + bytes([d[100] ^ 4]) + d[101:], "checksum of the headers"),
    ],
)  # fmt: skip
def test_damaged_files_are_refused(file, change, reason):
    file.write_bytes(change(file.read_bytes()))
    with pytest.raises(PointFileError, match=reason) as caught:
        open_points(file)
    assert caught.value.path == file


def test_right_checksums_do_not_excuse_wrong_indices(file):
    """Somebody who can compute a CRC must not get the reader to leave the file."""
    data = bytearray(file.read_bytes())
    preamble = struct.Struct("<8sIIQQQI")
    magic, version, flags, patches, levels, nodes, _ = preamble.unpack(data[: preamble.size])
    begin = preamble.size + 4
    count = begin + 8 * patches * (6 + 4 + 1) + 4 * patches * levels * 3
    data[count : count + 8] = struct.pack("<q", 10**12)
    end = count + 8 * patches + 4 * 256 + 4 * patches * levels
    head = preamble.pack(magic, version, flags, patches, levels, nodes, zlib.crc32(bytes(data[begin:end])))
    data[:begin] = head + struct.pack("<I", zlib.crc32(head))
    file.write_bytes(data)
    with pytest.raises(PointFileError, match="too many"):
        open_points(file)


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.data())
def test_no_flipped_bit_goes_unnoticed(file, data):
    original = file.read_bytes()
    place = data.draw(st.integers(0, len(original) - 1))
    changed = bytearray(original)
    changed[place] ^= 1 << data.draw(st.integers(0, 7))
    path = file.with_name("changed.trp")
    path.write_bytes(changed)
    try:
        points = open_points(path)
        headers = points.headers
        depth = (headers.start[:, 1:] > headers.start[:, :-1]).sum(1)
        every = torch.arange(len(headers)).repeat_interleave(depth)
        points.nodes.gather(points, every, torch.cat([torch.arange(int(d)) for d in depth]))
    except PointFileError:
        return
    # Only the empty bytes between the parts of the file have no meaning.
    assert original[place] == 0


def test_missing_files_and_folders(tmp_path, model):
    with pytest.raises(PointFileError, match="no such file"):
        open_points(tmp_path / "none.trp")
    with pytest.raises(PointFileError, match=r"\.trp"):
        write_points(tmp_path / "points.ply", model)
    with pytest.raises(ImageFileError, match="does not exist"):
        write_points(tmp_path / "no" / "points.trp", model)
    assert not list(tmp_path.iterdir())
