"""The picture of the study: photos beside rooms in their style, and the same from other photos."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import torch
from PIL import Image
from torch import Tensor

from torchrender.images.files import write_atomically
from torchrender.numerics.color import srgb_from_linear
from torchrender.photo.photograph import resized
from torchrender.photo.style.session import Style
from torchrender.renderer import render
from torchrender.scene.model import Scene

TILE = (300, 225)
GAP = 6
SCENES = ("living room", "washroom", "bookstore")
PHOTOS = ("reading corner", "kitchenette", "kitchen", "billiard room")


def draw_gallery(styles: Mapping[tuple[str, str], Style], folder: Path) -> None:
    """``material-style.jpg``: a photo a row, then the scenes in its style."""
    photos = [p for p in PHOTOS if any(q == p for _, q in styles)]
    rows = []
    for photo in photos:
        found = [styles[s, photo] for s in SCENES if (s, photo) in styles]
        tiles = [resized(found[0].problem.photos[0].pixels, *TILE), *(_tile(style) for style in found)]
        rows.append(torch.cat([_framed(t) for t in tiles], dim=1))
    width = min(r.shape[1] for r in rows)
    sheet = srgb_from_linear(torch.cat([r[:, :width] for r in rows]).clamp(0.0, 1.0))
    picture = Image.fromarray((sheet * 255 + 0.5).to(torch.uint8).numpy())
    write_atomically(folder / "material-style.jpg", lambda path: picture.save(path, quality=88, optimize=True))


def _framed(tile: Tensor) -> Tensor:
    out = torch.ones(TILE[1] + GAP, TILE[0] + GAP, 3)
    out[: TILE[1], : TILE[0]] = tile
    return out


def _tile(style: Style) -> Tensor:
    """The scene from its first camera under its own light, tone mapped; by Phong's model where nothing lights it."""
    scene = style.scene
    if scene.lights and scene.cameras:
        return _own_light(scene)
    views = style.problem.views
    # Views that are aimed at single objects come last, and make poor pictures.
    best = int(views.visible[:, : style.problem.options.views].sum(dim=0).argmax())
    return resized(style.pictures()[best], *TILE)


def _own_light(scene: Scene) -> Tensor:
    camera = scene.camera(width=2 * TILE[0], height=2 * TILE[1])
    radiance = render(scene, camera).radiance[0].detach()
    bright = float(np.quantile(radiance.amax(dim=-1).numpy(), 0.97))
    return resized((radiance / max(bright, 1e-6)).clamp(0.0, 1.0), *TILE)
