"""Room that is kept from view to view."""

from __future__ import annotations

from torchrender.kernels.raster.memory import Memory


def test_what_is_lent_is_not_handed_out_again() -> None:
    memory = Memory()
    points, lists = memory.points(10), memory.lists(5)
    assert memory.points(4) is points and memory.lists(5) is lists
    with memory.lent():
        assert memory.points(10) is not points and memory.lists(5) is not lists
    assert memory.points(10) is points and memory.lists(5) is lists


def test_rows_are_as_many_as_threads_and_no_planes_are_known() -> None:
    memory = Memory()
    first = memory.buffers(2)
    first.known[:] = 3
    assert memory.buffers(2) is first and (first.known == -1).all()
    assert len(memory.buffers(3).keys) == 3 and len(memory.notes(3)) == 3
    assert memory.notes(3) is memory.notes(3)
