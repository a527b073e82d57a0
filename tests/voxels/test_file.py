"""Voxel files: nothing is lost, and damage is told."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest
import torch

from torchrender.errors import InputError, SceneFileError
from torchrender.scene import shapes
from torchrender.scene.model import Scene
from torchrender.voxels.attributes import voxelize_scene
from torchrender.voxels.file import VERSION, VoxelModel, read_voxels, write_voxels
from torchrender.voxels.grid import Voxels, make_grid
from voxel_shapes import unit_grid


@pytest.fixture
def model() -> VoxelModel:
    scene = Scene(meshes=(shapes.torus(1.0, 0.3, 24),))
    return VoxelModel.of(voxelize_scene(scene, make_grid(scene.bounds[None], 40)), "ring")


def arrays(path: Path) -> dict[str, np.ndarray]:
    with np.load(path) as file:
        return {name: file[name] for name in file.files}


def test_round_trip(model: VoxelModel, tmp_path: Path) -> None:
    write_voxels(tmp_path / "ring.npz", model)
    back = read_voxels(tmp_path / "ring.npz")
    assert back.voxels.equals(model.voxels) and (back.kind, back.name) == ("surface", "ring")
    for name in ("normal", "color", "density"):
        assert torch.equal(getattr(back, name), getattr(model, name))
    assert back.info()["voxels"] == model.voxels.count and back.info()["attributes"] == ["normal", "color", "density"]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"version": np.array(VERSION + 1)}, "has version 2, this program reads up to 1"),
        ({"version": np.array("one")}, "version must be a whole number"),
        ({"format": np.array("something else")}, "is no voxel file"),
        ({"dims": np.array([40, 40])}, "three cell counts"),
        ({"dims": np.array([40, 41, 40])}, "must be bytes"),
        ({"dims": np.array([0, 1, 1])}, "damaged"),
        ({"cell": np.array(-1.0)}, "damaged"),
        ({"cell": np.array(1)}, "must be numbers"),
        ({"origin": np.array([0.0, np.nan, 0.0])}, "damaged"),
        ({"bits": np.zeros((3, 3), np.float32)}, "must be bytes"),
        ({"color": np.zeros((2, 3), np.uint8)}, "must be bytes"),
        ({"kind": np.array("hollow")}, "kind must be one of"),
        ({"bits": None}, "bits missing"),
        ({"name": np.array(["a", "b"], dtype=object)}, "damaged"),
    ],
)
def test_damaged_files(model: VoxelModel, tmp_path: Path, change: dict[str, np.ndarray | None], message: str) -> None:
    path = tmp_path / "ring.npz"
    write_voxels(path, model)
    content = {name: value for name, value in (arrays(path) | change).items() if value is not None}
    np.savez(path, **content)
    with pytest.raises(SceneFileError, match=message):
        read_voxels(path)


def test_cut_off_missing_and_foreign_files(model: VoxelModel, tmp_path: Path) -> None:
    path = tmp_path / "ring.npz"
    write_voxels(path, model)
    data = path.read_bytes()
    for length in (0, 3, 100, len(data) // 2, len(data) - 1):
        path.write_bytes(data[:length])
        with pytest.raises(SceneFileError, match="damaged, cut off or no NPZ file"):
            read_voxels(path)
    flipped = bytearray(data)
    flipped[len(data) // 2] ^= 255
    path.write_bytes(bytes(flipped))
    with pytest.raises(SceneFileError, match="damaged"):
        read_voxels(path)
    np.save(tmp_path / "plain.npy", np.zeros(3))
    with pytest.raises(SceneFileError, match="no NPZ file, as voxel files"):
        read_voxels(tmp_path / "plain.npy")
    with pytest.raises(SceneFileError, match="no such file"):
        read_voxels(tmp_path / "none.npz")


def test_files_that_cannot_be_written_are_no_images(model: VoxelModel, tmp_path: Path) -> None:
    for name in ("none/ring.npz", "none/ring.vox", "ring.obj"):
        with pytest.raises(SceneFileError) as told:
            write_voxels(tmp_path / name, model)
        assert type(told.value) is SceneFileError and name in str(told.value)


def test_magicavoxel(model: VoxelModel, tmp_path: Path) -> None:
    """The chunks of the file say what the cells are; z is up."""
    write_voxels(tmp_path / "ring.vox", model)
    data = (tmp_path / "ring.vox").read_bytes()
    nx, ny, nz = model.voxels.grid.dims
    assert data[:8] == b"VOX " + struct.pack("<i", 150)
    name, size, children = data[8:12], *struct.unpack_from("<2i", data, 12)
    assert (name, size, children) == (b"MAIN", 0, len(data) - 20)
    assert data[20:24] == b"SIZE" and struct.unpack_from("<3i", data, 32) == (nx, nz, ny)
    assert data[44:48] == b"XYZI"
    count = struct.unpack_from("<i", data, 56)[0]
    cells = np.frombuffer(data, np.uint8, 4 * count, 60).reshape(-1, 4).astype(int)
    dense = np.zeros((nz, ny, nx), bool)
    dense[nz - 1 - cells[:, 1], cells[:, 2], cells[:, 0]] = True
    assert np.array_equal(dense, model.voxels.dense()[0].numpy()) and cells[:, 3].min() >= 1
    rest = 60 + 4 * count
    assert data[rest : rest + 4] == b"RGBA" and len(data) == rest + 12 + 1024
    palette = np.frombuffer(data, np.uint8, 1024, rest + 12).reshape(-1, 4)
    assert model.color is not None
    assert np.abs(palette[cells[:, 3] - 1, :3].astype(int) - model.color.numpy()).max() <= 8


def test_wrong_output_is_refused(model: VoxelModel, tmp_path: Path) -> None:
    with pytest.raises(SceneFileError, match=r"\.npz or \.vox"):
        write_voxels(tmp_path / "ring.obj", model)
    with pytest.raises(SceneFileError, match="at most 256 cells"):
        write_voxels(tmp_path / "long.vox", VoxelModel(voxels=Voxels.empty(unit_grid(300, 1, 1))))
    with pytest.raises(InputError, match="one grid"):
        VoxelModel(voxels=Voxels.empty(make_grid(torch.zeros(2, 2, 3), (4, 4, 4))))
    with pytest.raises(InputError, match="color must be uint8"):
        VoxelModel(voxels=model.voxels, color=torch.zeros(model.voxels.count, 3))
    write_voxels(tmp_path / "empty.vox", VoxelModel(voxels=Voxels.empty(unit_grid(3))))


def test_other_files_are_told_in_plain_words(tmp_path: Path) -> None:
    (tmp_path / "model.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    with pytest.raises(
        SceneFileError, match=r"model\.obj: damaged, cut off or no NPZ file, as voxel files of torchrender are$"
    ):
        read_voxels(tmp_path / "model.obj")
