"""What the fields of a mesh must be."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import torch
from torch import Tensor

from torchrender.checks import as_array, check_finite, check_name, check_not_negative
from torchrender.errors import MeshError
from torchrender.scene.parts.columns import are_whole
from torchrender.scene.parts.places import check_near

_KINDS = {"vertices": torch.float64, "faces": torch.int64}
_SHAPES = {"normals": (3,), "uv": (2,), "uv1": (2,), "tangents": (4,), "colors": (3,), "alpha": ()}


def checked_fields(given: Mapping[str, Any]) -> dict[str, Tensor | None]:
    """The arrays among the fields of a mesh, as tensors.

    Raises:
        MeshError: as :class:`~torchrender.scene.mesh.Mesh` says.
    """
    name = given["name"]
    check_name("name of a mesh", name)
    _check_numbers(given)
    arrays: dict[str, Tensor | None] = {}
    for field in ("vertices", "faces", *_SHAPES):
        value = given[field]
        told, kind = f"mesh {name!r}: {field}", _KINDS.get(field, torch.float32)
        arrays[field] = None if value is None else as_array(told, value, kind, MeshError)
    v, f = arrays["vertices"], arrays["faces"]
    if not isinstance(v, Tensor) or v.dim() != 2 or v.shape[1] != 3 or not v.is_floating_point():
        raise MeshError(f"mesh {name!r}: vertices must be a float tensor (V, 3), got {describe(v)}")
    if not isinstance(f, Tensor) or f.dim() != 2 or f.shape[1] != 3 or not are_whole(f):
        raise MeshError(f"mesh {name!r}: faces must be an integer tensor (F, 3), got {describe(f)}")
    for field, tail in _SHAPES.items():
        value, shape = arrays[field], (v.shape[0], *tail)
        if value is not None and value.shape != shape:
            raise MeshError(f"mesh {name!r}: {field} must have shape {shape}, got {describe(value)}")
    finite = torch.isfinite(v).all(dim=1)
    if not bool(finite.all()):
        bad = (~finite).nonzero().reshape(-1)
        raise MeshError(
            f"mesh {name!r}: {bad.numel()} of {v.shape[0]} vertices are NaN or infinite, first {int(bad[0])}"
        )
    check_near(f"mesh {name!r}: vertices", v, MeshError)
    for field in ("colors", "alpha", "tangents"):
        value, told = arrays[field], f"mesh {name!r}: {field}"
        if value is None:
            continue
        if not value.is_floating_point():
            raise MeshError(f"{told} must hold floats, got {describe(value)}")
        check_finite(told, value, MeshError)
        if field != "tangents":
            check_not_negative(told, value, MeshError)
    if f.numel() and (int(f.min()) < 0 or int(f.max()) >= v.shape[0]):
        raise MeshError(f"mesh {name!r}: faces must index {v.shape[0]} vertices, got {int(f.min())} to {int(f.max())}")
    return arrays


def _check_numbers(given: Mapping[str, Any]) -> None:
    for field in ("material", "object_id"):
        value = given[field]
        if isinstance(value, bool) or not isinstance(value, int | np.integer | None):
            how = "" if field == "object_id" else " in Scene(materials=[...])"
            raise MeshError(f"mesh {given['name']!r}: {field} must be a number{how}, got {value!r}")


def describe(value: object) -> str:
    """Type and shape of a value, for error messages."""
    return f"{value.dtype} {tuple(value.shape)}" if isinstance(value, Tensor) else type(value).__name__
