"""Marks of a photo that was made larger or smaller."""

from __future__ import annotations

from dataclasses import fields, is_dataclass, replace
from typing import Any, TypeVar

T = TypeVar("T")
POINTS = ("center", "at", "foot", "top", "object_top", "shadow_tip")
POLYGONS = ("polygon", "lit", "base", "shadow", "sunlit")
LENGTHS_X = ("focal", "radius")
LENGTHS_Y = ("horizon",)


def scaled_record(record: T, x: float, y: float) -> T:
    """Every place of a record, and of records in it, times (x, y)."""
    changed: dict[str, Any] = {}
    for item in fields(record):  # type: ignore[arg-type]
        value, name = getattr(record, item.name), item.name
        if value is None:
            continue
        if name in POINTS:
            changed[name] = (value[0] * x, value[1] * y)
        elif name in POLYGONS:
            changed[name] = tuple((p[0] * x, p[1] * y) for p in value)
        elif name in LENGTHS_X:
            changed[name] = value * x
        elif name in LENGTHS_Y:
            changed[name] = value * y
        elif name == "corners":
            changed[name] = {k: (p[0] * x, p[1] * y) for k, p in value.items()}
        elif is_dataclass(value):
            changed[name] = scaled_record(value, x, y)
        elif isinstance(value, tuple) and value and is_dataclass(value[0]):
            changed[name] = tuple(scaled_record(v, x, y) for v in value)
    return replace(record, **changed)  # type: ignore[type-var]
