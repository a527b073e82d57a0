"""The numpy view of a tensor, and arrays that are handed out again."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
import torch

import torchrender as tr
from torchrender.arrays import LINE, Recycler, empty_aligned, view
from torchrender.errors import InputError

SHAPE = (300, 300)


def test_memory_is_shared_where_type_and_layout_fit_and_copied_elsewhere():
    tensor = torch.arange(6.0).reshape(2, 3)
    shared = view(tensor, np.float32)
    tensor[1, 2] = 9.0
    assert shared[1, 2] == 9.0
    for copied in (view(tensor, np.float64), view(tensor.T, np.float32)):
        assert copied.flags.c_contiguous
    tensor[1, 2] = 7.0
    assert copied.shape == (3, 2) and copied[2, 1] == 9.0


def test_a_tensor_with_gradients_is_seen_without_them():
    tensor = torch.ones(3, requires_grad=True)
    np.testing.assert_array_equal(view(tensor * 2, np.float32), [2.0, 2.0, 2.0])


def place(array: np.ndarray) -> int:
    return array.__array_interface__["data"][0]


def test_an_array_is_handed_out_again_when_nothing_holds_it() -> None:
    memory = Recycler(1 << 20)
    first = memory.empty(SHAPE, np.float32)
    where = place(first)
    del first
    second = memory.empty(SHAPE, np.int32)
    assert place(second) == where and second.shape == SHAPE and second.dtype == np.int32


def test_views_and_tensors_keep_it() -> None:
    memory = Recycler(1 << 20)
    held = memory.empty(SHAPE, np.float32)
    where, part = place(held), held[5]
    tensor = torch.from_numpy(held)
    row = tensor[3]
    for kept in ("array", "view", "tensor"):
        assert place(memory.empty(SHAPE, np.float32)) != where, kept
        if kept == "array":
            del held
        elif kept == "view":
            del part
        else:
            del tensor
    assert place(memory.empty(SHAPE, np.float32)) != where, "a row of the tensor"
    del row
    again = [memory.empty(SHAPE, np.float32) for _ in range(2)]
    assert where in [place(array) for array in again]


def test_no_more_is_kept_than_asked_for() -> None:
    memory = Recycler(1 << 20)
    held = [memory.empty(SHAPE, np.float64) for _ in range(3)]
    assert len({place(array) for array in held}) == 3
    for number, array in enumerate(held):
        array[:] = number
    assert [float(array.max()) for array in held] == [0, 1, 2]
    assert sum(a.nbytes for a in memory._arrays) <= 1 << 20
    assert memory.empty((1 << 10, 1 << 10), np.float64).shape == (1 << 10, 1 << 10), "larger than all that is kept"
    assert memory.empty((0, 5), np.float32).size == 0


@pytest.fixture
def double() -> Iterator[None]:
    torch.set_default_dtype(torch.float64)
    yield
    torch.set_default_dtype(torch.float32)


def _made() -> list[torch.Tensor]:
    """What a program makes that says no type anywhere."""
    found = []
    for name in ("cornell_box", "washroom"):
        scene = tr.load(name)
        found += [
            tr.render(scene, width=32, height=24).radiance,
            tr.render(scene, width=32, height=24, budget_ms=1e6).radiance,
        ]
    ball = tr.Scene(meshes=[tr.Mesh.sphere(0.5)], lights=[tr.PointLight(position=[1, 2, 3], intensity=9)])
    camera = tr.Cameras.look_at([0, 0, 3], [0, 0, 0], width=24, height=16)
    tr.plan(ball, camera)
    position = torch.linspace(-1, 1, 150, dtype=torch.float64).reshape(50, 3).sin()
    return [*found, tr.render(ball, camera).radiance, tr.render_points(tr.PointCloud(position=position), camera).image]


def test_pictures_do_not_depend_on_the_default_type(request: pytest.FixtureRequest) -> None:
    wanted = _made()
    request.getfixturevalue("double")
    for found, single in zip(_made(), wanted, strict=True):
        assert found.dtype is torch.float32 and torch.equal(found, single)
    with pytest.raises(InputError):
        tr.render("cornell_box", width=-1)
    assert torch.get_default_dtype() is torch.float64, "the program's own stays"


def test_arrays_begin_with_a_line_of_the_cache() -> None:
    memory = Recycler(1 << 20)
    made = [empty_aligned((k, 3), np.float32) for k in range(1, 40)] + [memory.empty(SHAPE, np.int64) for _ in range(3)]
    made.append(memory.empty((5,), np.uint8))
    assert all(place(array) % LINE == 0 and array.flags.c_contiguous for array in made)
    assert made[4].shape == (5, 3) and empty_aligned((0, 2), np.float64).shape == (0, 2)
