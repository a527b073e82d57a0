"""Which kernels Python calls with which types of arguments: recorded, to be compiled before they are called.

``data/kernels.json`` is written by ``python tests/kernel_uses.py --write`` and held against use by a test.
"""

from __future__ import annotations

import importlib
import json
from collections.abc import Set
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

from numba.core import types

from torchrender.kernels.compile import Kernel

RECORDED = Path(__file__).parent.parent / "data" / "kernels.json"
PACKAGE = "torchrender.kernels."
GROUPS = ("render", "depth", "points", "voxels", "serve")
"""What kernels can be compiled for. The parts of ``render`` are named ``render.`` and the pass, with ``.more`` at the
end what only other settings than the usual ones need, or ``render.shading.`` and what only some scenes have;
``render.any`` is needed by all, ``render.files`` to read files, ``serve.first`` by first keyframes."""
MORE = ".more"


@dataclass(frozen=True)
class Use:
    """A kernel with types of arguments."""

    kernel: str  # module below torchrender.kernels and function
    arguments: str  # types as JSON
    seconds: float  # of one core, to compile it where it was recorded
    parts: tuple[str, ...]  # what needs it

    @property
    def module(self) -> str:
        """Module below ``torchrender.kernels``."""
        return self.kernel.rpartition(".")[0]

    def serves(self, wanted: Set[str]) -> bool:
        """Whether it belongs to one of these parts; a group stands for all of its parts at their usual settings."""
        return any(part in wanted or (_group(part) in wanted and not part.endswith(MORE)) for part in self.parts)


@cache
def recorded() -> tuple[Use, ...]:
    """All that is recorded."""
    rows = json.loads(RECORDED.read_text())["kernels"]
    return tuple(Use(r["kernel"], json.dumps(r["types"]), float(r["seconds"]), tuple(r["parts"])) for r in rows)


def _group(part: str) -> str:
    return part.partition(".")[0]


def kernel_of(use: Use) -> Kernel:
    """The function itself; its module is imported."""
    found = getattr(importlib.import_module(PACKAGE + use.module), use.kernel.rpartition(".")[2])
    if not isinstance(found, Kernel):
        raise TypeError(f"{use.kernel} is not a kernel")
    return found


def types_of(use: Use) -> tuple[Any, ...]:
    """Numba's types of the arguments."""
    return tuple(_type(one) for one in json.loads(use.arguments))


def described(kind: Any) -> Any:
    """A type as plain values.

    Raises:
        TypeError: a kind of argument that no kernel takes yet.
    """
    if isinstance(kind, types.Array):
        told: dict[str, Any] = {"array": str(kind.dtype), "ndim": kind.ndim, "layout": kind.layout}
        return told if kind.mutable else told | {"readonly": True}
    if isinstance(kind, types.NamedTuple | types.NamedUniTuple):
        made = kind.instance_class
        return {"record": f"{made.__module__}:{made.__qualname__}", "of": [described(one) for one in kind.types]}
    if isinstance(kind, types.UniTuple | types.Tuple):
        return {"tuple": [described(one) for one in kind.types]}
    if isinstance(kind, types.Omitted):
        return {"omitted": kind.value}
    if isinstance(kind, types.Number | types.Boolean | types.NoneType):
        return str(kind)
    raise TypeError(f"{kind} of type {type(kind).__name__} cannot be recorded")


def _type(told: Any) -> Any:
    if isinstance(told, str):
        return types.none if told == "none" else types.boolean if told == "bool" else getattr(types, told)
    if "array" in told:
        return types.Array(_type(told["array"]), told["ndim"], told["layout"], readonly=told.get("readonly", False))
    if "omitted" in told:
        return types.Omitted(told["omitted"])
    if "tuple" in told:
        return types.BaseTuple.from_types([_type(one) for one in told["tuple"]])
    module, _, name = told["record"].partition(":")
    record = getattr(importlib.import_module(module), name)
    if len(record._fields) != len(told["of"]):
        raise TypeError(f"{name} has {len(record._fields)} fields now, recorded are {len(told['of'])}")
    return types.BaseTuple.from_types([_type(one) for one in told["of"]], record)
