"""Meshes as researchers write them: shapes in a line, lists and arrays in place of tensors."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch

import torchrender as tr
from torchrender.errors import InputError, MeshError, OptionError

TRIANGLE = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]


def volume(mesh: tr.Mesh) -> float:
    """Signed volume inside: positive where faces turn outwards."""
    a, b, c = mesh.vertices[mesh.faces].unbind(1)
    return float((torch.linalg.cross(a, b) * c).sum() / 6)


@pytest.mark.parametrize(
    ("mesh", "inside", "box"),
    [
        (tr.Mesh.box([1, 2, 3], [4, 5, 6]), 6.0, [[3.5, 4, 4.5], [4.5, 6, 7.5]]),
        (tr.Mesh.box(2), 8.0, [[-1, -1, -1], [1, 1, 1]]),
        (tr.Mesh.sphere(0.5, (0, 1, 0), segments=128), math.pi / 6, [[-0.5, 0.5, -0.5], [0.5, 1.5, 0.5]]),
        (tr.Mesh.plane((2, 4), (0, 1, 0)), 8.0 / 3, [[-1, 1, -2], [1, 1, 2]]),  # the pyramid below it
    ],
)
def test_shapes_have_their_size_place_and_outside(mesh: tr.Mesh, inside: float, box: list) -> None:
    assert volume(mesh) == pytest.approx(inside, rel=2e-3)
    assert torch.allclose(tr.Scene(meshes=(mesh,)).bounds, torch.tensor(box).double(), atol=1e-9)
    assert mesh.normals is not None and torch.allclose(mesh.normals.norm(dim=1), torch.ones(len(mesh.normals)))


def test_shapes_take_a_name_and_a_material() -> None:
    mesh = tr.Mesh.sphere(name="moon", material=3)
    assert (mesh.name, mesh.material) == ("moon", 3)


@pytest.mark.parametrize(("make", "error"), [
    (lambda: tr.Mesh.box([1, 0, 1]), InputError), (lambda: tr.Mesh.plane(-1), InputError),
    (lambda: tr.Mesh.sphere(0), OptionError), (lambda: tr.Mesh.sphere(segments=2), OptionError),
    (lambda: tr.Mesh.box(1, [0, math.nan, 0]), InputError),
])  # fmt: skip
def test_shapes_refuse_what_they_cannot_be(make, error) -> None:
    with pytest.raises(error):
        make()


def test_lists_and_arrays_are_taken_as_tensors() -> None:
    wanted = tr.Mesh(vertices=torch.tensor(TRIANGLE).double(), faces=torch.tensor([[0, 1, 2]]))
    rows = np.array(TRIANGLE, dtype=">f8")[:, ::-1][:, ::-1]  # of another byte order, and not contiguous
    for vertices, faces in ((TRIANGLE, [[0, 1, 2]]), (rows, np.array([[0, 1, 2]], dtype=np.uint16))):
        mesh = tr.Mesh(vertices=vertices, faces=faces, colors=[[1, 0, 0]] * 3, uv=np.zeros((3, 2)))
        assert torch.equal(mesh.vertices, wanted.vertices) and mesh.vertices.dtype == torch.float64
        assert mesh.faces.tolist() == [[0, 1, 2]] and mesh.colors.dtype == torch.float32
        depth = tr.rasterize_depth(mesh, tr.Cameras.look_at([0.2, 0.2, 2], [0.2, 0.2, 0], width=8, height=8))
        assert float(depth.min()) == pytest.approx(2.0)
    kept = np.array(TRIANGLE, dtype=np.float32)
    mesh = tr.Mesh(vertices=kept, faces=[[0, 1, 2]])
    kept[:] = 7.0  # the caller's array is his own
    assert mesh.vertices.dtype == torch.float32 and float(mesh.vertices.max()) == 1.0


@pytest.mark.parametrize(("vertices", "faces", "told"), [
    ([[0, 0], [1, 1, 1]], [[0, 1, 2]], "rows of one length"), ("abc", [[0, 1, 2]], "rows of one length"),
    (TRIANGLE, [[0.0, 1.0, 2.0]], "faces must be an integer"), (TRIANGLE, [0, 1, 2], r"\(F, 3\)"),
    (TRIANGLE, [[0, 1, 3]], "must index 3 vertices"), ([[math.nan] * 3], [[0, 0, 0]], "NaN"),
])  # fmt: skip
def test_lists_that_are_no_mesh_are_refused(vertices, faces, told) -> None:
    with pytest.raises(MeshError, match=told):
        tr.Mesh(vertices=vertices, faces=faces)
