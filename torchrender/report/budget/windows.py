"""Windows of a picture with every pass at its reference: whole references of large pictures take minutes each."""

from __future__ import annotations

from dataclasses import dataclass, replace

import torch
from torch import Tensor

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

ROWS = 3
"""Windows along each side of the picture, evenly spread: a quarter of the pixels of 256², a twelfth of 512²."""


@dataclass(frozen=True, eq=False)
class Windows:
    """What a picture should be, in part; small pictures as a whole."""

    parts: tuple[tuple[int, int, Image], ...]  # top and left corner, picture of the window with its margin

    @classmethod
    def of(cls, scene: Scene, camera: Cameras) -> Windows:
        """Rendered, what lasts kept from window to window."""
        options, history, parts = exact_options(), RenderHistory(), []
        for top, height in _spans(camera.height):
            for left, width in _spans(camera.width):
                window = camera.sub_camera(left, top, width, height)
                image = render(scene, window, options=options, history=history.shared())
                history = image.history or history
                parts.append((top, left, replace(image, history=None)))
        return cls(tuple(parts))

    def error(self, image: Image) -> float:
        """Mean FLIP of a picture's pixels in the windows, without margins; all exposed as the picture."""
        exposure = auto_exposure(image.radiance) if image.exposure is None else image.exposure
        shown, values = replace(image, exposure=exposure).displayed(), []
        for top, left, wanted in self.parts:
            height, width = wanted.radiance.shape[1:3]
            exposed = replace(wanted, exposure=exposure, tone_map=image.tone_map).displayed()
            part = flip_map(shown[:, top : top + height, left : left + width].float(), exposed.float())
            values.append(_inside(part).reshape(-1))
        return float(torch.cat(values).mean())


def _spans(size: int) -> list[tuple[int, int]]:
    """Begin and length of windows along one axis; one of everything where they would cover most of it."""
    length = SIDE + 2 * MARGIN
    if ROWS * length > 2 * size // 3 + length:
        return [(0, size)]
    return [(round((size - length) * (i + 0.5) / ROWS), length) for i in range(ROWS)]


def _inside(image: Tensor) -> Tensor:
    """A window (B,H,W) without its margin; a whole picture as it is."""
    height, width = image.shape[1:]
    rows = slice(MARGIN, -MARGIN) if height == SIDE + 2 * MARGIN else slice(None)
    columns = slice(MARGIN, -MARGIN) if width == SIDE + 2 * MARGIN else slice(None)
    return image[:, rows, columns]
