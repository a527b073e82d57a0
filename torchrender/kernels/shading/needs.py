"""Which stages of the shading kernel a picture needs, and where their code is."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache
from typing import Any

import numpy as np
from numba import typeof
from numba.core import types

from torchrender.kernels.shading import parts
from torchrender.kernels.shading.records import (
    MATERIAL,
    METALLIC,
    PHONG,
    RECT,
    TILE,
    Looks,
    Out,
    Packed,
    Reach,
    Samples,
    Sky,
    Stages,
    View,
    Work,
)
from torchrender.kernels.stages import Stage

_SPLIT = (*TILE, 1, 1)
SHEEN = 4
"""Flag of :attr:`Looks.groups_of`."""


def stages_of(samples: Samples, view: View, packed: Packed, looks: Looks, sky: Sky, reach: Reach, out: Out) -> Stages:
    """The stages that these call for, compiled; split for one worker, which the caller changes."""
    given = (samples, view, packed, looks, sky, reach, out)
    wanted = frozenset(_needs(packed, looks, sky, reach, out))
    writeable = tuple(array.flags.writeable for record in given for array in record)
    return _compiled(wanted, writeable, _Types(given))


def _needs(packed: Packed, looks: Looks, sky: Sky, reach: Reach, out: Out) -> Iterator[str]:
    """Names of the stages beside those that every picture needs."""
    kinds = [kind for kind in (PHONG, METALLIC) if (looks.groups_of[:, 2] == kind).any()]
    lights = set(reach.lights[:, 0].tolist())
    layered = (looks.numbers[:, MATERIAL["coat"]] > 0).any(), (looks.groups_of[:, 3] & SHEEN > 0).any()
    found = {
        "further": len(packed.further) > 0 or len(packed.tangent_row) > 0,
        "bend": len(packed.tangent_row) > 0,
        "textures": len(looks.groups) > 0,
        "background": sky.radiance.shape[0] * sky.radiance.shape[1] > 1,
        "rectangle": RECT in lights,
        "small_light": bool(lights - {RECT}),
        "phong": PHONG in kinds and bool(lights),
        "metallic": METALLIC in kinds,
        "metallic_light": METALLIC in kinds and bool(lights - {RECT}),
        "lobes": METALLIC in kinds and RECT in lights,
        "metallic_rectangle": METALLIC in kinds and RECT in lights,
        "coat": layered[0],
        "coat_light": layered[0] and bool(lights - {RECT}),
        "coat_rectangle": layered[0] and RECT in lights,
        "sheen_light": layered[1] and bool(lights),
        "mirrors": len(out.replaced) > 0,
        "surface": len(out.surface) > 0,
    }
    return (name for name, needed in found.items() if needed)


class _Types:
    """Types of the records, made when a new combination is met: equal to all others, so that it is no part of a key."""

    def __init__(self, given: tuple[Any, ...]) -> None:
        self.given = given

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Types)

    def __hash__(self) -> int:
        return 0


@cache
def _compiled(wanted: frozenset[str], writeable: tuple[bool, ...], told: _Types) -> Stages:
    del writeable  # what types depend on, as all arrays have their kinds of numbers and lie row by row
    samples, view, packed, looks, sky, reach, out = (typeof(one) for one in told.given)
    told.given = ()
    number, light, work = types.int64, typeof(np.zeros(1, np.float32)), typeof(_work())
    arguments = {
        "surfaces": (types.UniTuple(number, 4), samples, view, packed, looks, work),
        "further": (packed, work, number),
        "textures": (looks, work, number),
        "bend": (looks, work, number),
        "surface": (out, work, number),
        "ambient": (looks, sky, reach, work, number, number),
        "background": (view, sky, work, number, types.float32[:, ::1]),
        "small_light": (work, number, light),
        "rectangle": (work, number, light),
        "phong": (work, number, light, types.boolean),
        "metallic": (looks, sky, out, work, number, number),
        "metallic_light": (sky, work, number, light),
        "lobes": (sky, work, number),
        "metallic_rectangle": (sky, work, number, light),
        "sheen_light": (looks, work, number, light),
        "coat": (sky, work, number),
        "coat_light": (work, number, light),
        "coat_rectangle": (sky, work, number, light),
        "write": (looks, out, work, number, number),
        "mirrors": (looks, out, work, number),
    }
    always = {"surfaces", "ambient", "write"}
    stages = {name: getattr(parts, name) for name in Stages._fields[len(_SPLIT) :]}
    assert all(isinstance(one, Stage) for one in stages.values())
    made = {n: s.address(*arguments[n]) if n in wanted | always else 0 for n, s in stages.items()}
    return Stages(*_SPLIT, **made)


def _work() -> Work:
    small, whole = np.zeros(1, np.uint32), np.zeros(1, np.int64)
    return Work(np.zeros(1, np.float32), small, small, small, small, whole, np.zeros(1, np.bool_), small, small)
