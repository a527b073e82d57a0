"""Stages are called by their address and do what the same function does; the front end's shortcuts change no answer."""

from __future__ import annotations

import operator

import numpy as np
import pytest
from numba import int64, typeof, types
from numba.core import ir
from numba.core.compiler import Flags
from numba.core.errors import TypingError
from numba.core.registry import cpu_target

from torchrender.kernels import front_end, libraries
from torchrender.kernels.compile import kernel
from torchrender.kernels.stages import run, stage


@stage("tests")
def add_to(values, more, twice):
    for i in range(values.shape[0]):
        values[i] += 2 * more if twice else more


@kernel()
def through(address, values, more):
    run(address, (values, more, True))
    run(address, (values, more, values[0] < 0))


def test_a_stage_is_called_by_its_address() -> None:
    values = np.arange(5.0)
    kinds = (typeof(values), int64, types.boolean)
    address = add_to.address(*kinds)
    assert address != 0 and add_to.address(*kinds) == address and add_to.need == "tests"
    through(address, values, 3)
    np.testing.assert_array_equal(values, np.arange(5.0) + 9)
    assert add_to.is_kept(kinds)
    other = add_to.address(types.float32[::1], int64, types.boolean)
    assert other not in (0, address)
    small = np.zeros(3, np.float32)
    through(other, small, 1)
    np.testing.assert_array_equal(small, [3, 3, 3])


def test_variables_of_statements_are_those_that_numba_lists() -> None:
    def function(a, b, c):
        total = 0.0
        for i in range(a):
            total += (b[i, 0], c)[1] * max(b[i, 1], total)
        return [total, *c], {"x": total}

    from numba.core.compiler import run_frontend

    statements = [one for block in run_frontend(function).blocks.values() for one in block.body]
    assert len(statements) > 20
    for one in statements:
        wanted = front_end._list_vars(one, one.__dict__)
        assert front_end._variables(one, one.__dict__) == wanted
        assert isinstance(one, ir.Stmt)


@pytest.mark.skipif(not libraries.is_used(), reason="the shortcuts are for versions of numba that were tested")
def test_types_of_calls_are_those_that_numba_finds() -> None:
    context = cpu_target.typing_context
    context.refresh()
    kinds = [types.int64, types.uint32, types.float32, types.float64, types.boolean, types.float32[::1]]
    for name in ("add", "truediv", "lt", "and_", "getitem"):
        function = context.resolve_value_type(getattr(operator, name))
        for a in kinds:
            for b in kinds:
                found = []
                for way in (front_end._call_type, front_end._type_of_call, front_end._type_of_call):
                    try:
                        found.append(way(function, context, (a, b), {}))
                    except TypingError:
                        found.append(None)
                assert found[0] == found[1] == found[2], (name, a, b)


def test_flags_are_equal_where_all_their_options_are() -> None:
    one, same, other = Flags(), Flags(), Flags()
    same.nrt = one.nrt  # set, to what it is anyway
    other.fastmath = True
    assert one == same and hash(one) == hash(same) and one != other and one != "flags"
