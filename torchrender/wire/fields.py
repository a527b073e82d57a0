"""Numbers, words and cameras as the headers of messages hold them: each with its range."""

from __future__ import annotations

from typing import Annotated

import msgspec
from msgspec import Meta

_LARGEST = 1e15

Natural = Annotated[int, Meta(ge=0, le=2**53)]
MAX_SIDE = 32768
"""Pixels along a side of a picture."""
Side = Annotated[int, Meta(ge=1, le=MAX_SIDE)]
Number = Annotated[float, Meta(ge=-_LARGEST, le=_LARGEST)]
Positive = Annotated[float, Meta(gt=0.0, le=_LARGEST)]
NotNegative = Annotated[float, Meta(ge=0.0, le=_LARGEST)]
Vector = Annotated[tuple[Number, ...], Meta(min_length=3, max_length=3)]
Matrix = Annotated[tuple[Number, ...], Meta(min_length=16, max_length=16)]
Text = Annotated[str, Meta(max_length=4096)]
Words = Annotated[tuple[Annotated[str, Meta(max_length=32)], ...], Meta(max_length=16)]


class CameraHeader(msgspec.Struct, frozen=True, kw_only=True):
    """A pinhole camera: x right, y down, z forward; pixel centres at halves."""

    world_from_camera: Matrix  # 16 numbers row by row, rigid
    fx: Positive
    fy: Positive
    cx: Number
    cy: Number
    width: Side
    height: Side
    near: Positive
