"""Windows of a picture with every pass at its reference: whole references of large pictures take minutes each."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import torch

from torchrender.image import Image
from torchrender.numerics.tonemap import auto_exposure
from torchrender.pipeline.history import RenderHistory
from torchrender.quality.metrics import flip_map
from torchrender.renderer import render
from torchrender.scene.camera import Cameras
from torchrender.scene.model import Scene
from torchrender.tuning.measure import exact_options

SIDE, MARGIN = 48, 12
"""Pixels of a window that count, along each side, and those around it that an observer's eye takes in with them."""

COUNT, STEP = 9, 4
"""Windows of a picture, each in a row and a column of its own; the next row's is so many columns further."""

WHOLE = 2 / 3
"""Share of a picture from which on windows are no quicker than all of it."""


class Window(NamedTuple):
    """A part of a picture as it should be."""

    top: int
    left: int
    wanted: Image  # with its margin, as far as the picture goes
    inside: tuple[slice, slice]  # rows and columns of it that count


@dataclass(frozen=True, eq=False)
class Windows:
    """What a picture should be, in part; small pictures as a whole."""

    parts: tuple[Window, ...]

    @classmethod
    def of(cls, scene: Scene, camera: Cameras) -> Windows:
        """Rendered, what lasts kept from window to window."""
        options, history, parts = exact_options(), RenderHistory(), []
        for rows, columns in _places(camera.height, camera.width):
            top, left = (max(span.start - MARGIN, 0) for span in (rows, columns))
            bottom, right = min(rows.stop + MARGIN, camera.height), min(columns.stop + MARGIN, camera.width)
            window = camera.sub_camera(left, top, right - left, bottom - top)
            image = render(scene, window, options=options, history=history.shared())
            history = image.history or history
            inside = slice(rows.start - top, rows.stop - top), slice(columns.start - left, columns.stop - left)
            parts.append(Window(top, left, replace(image, history=None), inside))
        return cls(tuple(parts))

    def error(self, image: Image) -> float:
        """Mean FLIP of a picture's pixels in the windows, without margins; all exposed as the picture."""
        exposure = auto_exposure(image.radiance) if image.exposure is None else image.exposure
        shown, values = replace(image, exposure=exposure).displayed(), []
        for top, left, wanted, (rows, columns) in self.parts:
            height, width = wanted.radiance.shape[1:3]
            exposed = replace(wanted, exposure=exposure, tone_map=image.tone_map).displayed()
            part = flip_map(shown[:, top : top + height, left : left + width].float(), exposed.float())
            values.append(part[:, rows, columns].reshape(-1))
        return float(torch.cat(values).mean())


def _places(height: int, width: int) -> list[tuple[slice, slice]]:
    """Rows and columns that count: those of all windows, or of the whole picture where it is small."""
    length = SIDE + 2 * MARGIN
    if COUNT * length**2 > WHOLE * height * width or min(height, width) < length:
        return [(slice(0, height), slice(0, width))]
    return [(_span(n, height), _span(n * STEP % COUNT, width)) for n in range(COUNT)]


def _span(number: int, size: int) -> slice:
    """Of one of as many strips of a side, about its middle."""
    start = round((number + 0.5) * size / COUNT - SIDE / 2)
    start = min(max(start, 0), size - SIDE)
    return slice(start, start + SIDE)
