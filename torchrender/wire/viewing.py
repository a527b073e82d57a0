"""Messages of a viewer beside the keyframes: how the server is, where to look, and what a pixel shows."""

from __future__ import annotations

from typing import Literal

import msgspec

from torchrender.wire.fields import CameraHeader, Natural, NotNegative, Number, Text, Vector

ToneMap = Literal["none", "reinhard", "aces"]
Effect = Literal["lights", "shadows", "ambient", "reflections", "transparency", "media"]
"""What a viewer can leave out of its pictures."""


class Status(msgspec.Struct, frozen=True, kw_only=True):
    """A sign of life of the server, about once a second, and whenever something changes."""

    doing: Literal["moving", "still", "smooth"] | None = None  # the kind of picture that is being made
    since_ms: NotNegative = 0.0  # for so long
    ahead: Natural = 0  # jobs of others that the renderer does first


class Look(msgspec.Struct, frozen=True, kw_only=True):
    """The program that shows the scene wants it seen from here."""

    camera: CameraHeader


class Pick(msgspec.Struct, frozen=True, kw_only=True):
    """What does this pixel show?"""

    seq: Natural
    camera: CameraHeader
    x: Number  # pixels of that camera; the first one's centre is at 0.5
    y: Number


class Picked(msgspec.Struct, frozen=True, kw_only=True):
    """The surface that the pixel of a PICK shows, found by ids; nothing where ``triangle`` is -1."""

    seq: Natural
    triangle: int = -1  # of the whole scene
    object: int = -1  # number of the mesh
    face: int = -1  # of that mesh
    name: Text = ""  # of the mesh
    material: Text = ""
    point: Vector = (0.0, 0.0, 0.0)  # world
    normal: Vector = (0.0, 0.0, 0.0)
    depth: NotNegative = 0.0  # along the view
