"""Shortcuts for what numba's front end does most of the time: it takes three quarters of the time to compile a kernel.

Measured over the kernel that shades, 15 s of it: two fifths went into asking dozens of templates, for each ``a + b`` of
two numbers, what its type is (the answer is the same every time), a tenth into comparing flags option by option, a
tenth into listing the variables of statements, which nine passes do for each. Of what was left 5 % told nobody of locks
and 3 % looked for new declarations before each helper. As in :mod:`libraries`, insides of numba change, so this is for
the versions that it was tested with.
"""

from __future__ import annotations

import importlib
from typing import Any

import llvmlite.binding
from numba.core import ir, types
from numba.core.base import BaseContext as BaseTarget
from numba.core.targetconfig import TargetConfig
from numba.core.types.functions import BaseFunction
from numba.core.typing.context import BaseContext

_LEAVES = frozenset({str, int, float, bool, type(None), ir.Loc})
"""What statements hold that are no variables and hold none."""
_PLAIN = (types.Number, types.Boolean, types.Array)
_SAME_HASH = 0x5EED

_list_vars = ir.Inst._rec_list_vars
_call_type = BaseFunction.get_call_type
_refreshed_types, _refreshed_target = BaseContext.refresh, BaseTarget.refresh


def _same_options(one: TargetConfig, other: object) -> Any:
    if not isinstance(other, TargetConfig):
        return NotImplemented
    return one is other or one._values == other._values or one.values() == other.values()


def _options_hash(_: TargetConfig) -> int:
    """Numba's hashes the names of all options alone: it is the same for all, too, but takes a while."""
    return _SAME_HASH


def _variables(self: ir.Inst, value: Any) -> list[ir.Var]:
    """Variables within a value, in their order."""
    kind = type(value)
    if kind is ir.Var:
        return [value]
    if kind in _LEAVES:
        return []
    if kind is dict:
        value = value.values()
    elif kind is not list and kind is not tuple:
        found: list[ir.Var] = _list_vars(self, value)
        return found
    out: list[ir.Var] = []
    for one in value:
        kind = type(one)
        if kind is ir.Var:
            out.append(one)
        elif kind not in _LEAVES:
            out += _variables(self, one)
    return out


def _type_of_call(self: BaseFunction, context: Any, args: Any, kws: Any) -> Any:
    """Of numbers and arrays, kept where the function is one of numba's own kind, that no types choose the code of."""
    if kws or type(args) is not tuple or not all(isinstance(one, _PLAIN) for one in args):
        return _call_type(self, context, args, kws)
    known = self.__dict__.setdefault("_torchrender_known", {})
    found = known.get(args)
    if found is None:
        found = _call_type(self, context, args, kws)
        if found is not None and self._impl_keys.get(found.args) is self.typing_key:
            known[args] = found
    return found


def _import_without_blas() -> None:
    """Numba imports SciPy's linear algebra to see whether it is there; it is, and kernels do without."""
    linalg: Any = importlib.import_module("numba.np.linalg")
    asked = linalg.ensure_blas
    linalg.ensure_blas = bool  # says nothing and does nothing
    try:
        arrays: Any = importlib.import_module("numba.np.arraymath")
        arrays.ensure_blas = asked
    finally:
        linalg.ensure_blas = asked


def _counted(context: Any) -> tuple[int, ...]:
    """How much is declared where a context looks for functions."""
    return tuple(
        len(kept) for registry in context._registries for kept in vars(registry).values() if type(kept) is list
    )


def _refresh_types(self: BaseContext) -> None:
    """Look through a dozen registries where one of them has got something since."""
    counted = _counted(self)
    if self.__dict__.get("_torchrender_counted") != counted:
        _refreshed_types(self)
        self._torchrender_counted = counted  # what this has added is looked at next time


def _refresh_target(self: BaseTarget) -> None:
    """Likewise, for code as for types."""
    counted = _counted(self)
    if self.__dict__.get("_torchrender_counted") != counted:
        _refreshed_target(self)
        self._torchrender_counted = counted
    self.typing_context.refresh()


def _tell_no_locks() -> None:
    """Numba tells all who compile, for each call of LLVM, that a lock was taken, and that it was given back."""
    callbacks = llvmlite.binding.ffi.lib._lock._cblist
    callbacks[:] = [pair for pair in callbacks if pair[0].__module__ != "numba.core.base"]


def shorten() -> None:
    """Put the shortcuts in place; again does nothing more."""
    _tell_no_locks()
    BaseContext.refresh = _refresh_types
    BaseTarget.refresh = _refresh_target
    _import_without_blas()
    TargetConfig.__eq__ = _same_options
    TargetConfig.__hash__ = _options_hash
    ir.Inst._rec_list_vars = _variables
    BaseFunction.get_call_type = _type_of_call
