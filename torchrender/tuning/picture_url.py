"""Pictures as text, for pages that fetch nothing from elsewhere."""

from __future__ import annotations

import base64
import io

import numpy as np
import torch
from PIL import Image as Pillow
from torch import Tensor

SHOWN = 240
"""Pixels of a side, at most."""


def picture_url(picture: Tensor | None) -> str:
    """A picture (H,W,3) or (H,W) in [0,1] as a data URL; an empty one for None."""
    if picture is None:
        return ""
    planes = picture.float()[..., None].expand(*picture.shape, 3) if picture.dim() == 2 else picture.float()
    codes = (planes.clamp(0.0, 1.0) * 255.0 + 0.5).to(torch.uint8).numpy()
    image = Pillow.fromarray(np.ascontiguousarray(codes))
    image.thumbnail((SHOWN, SHOWN), Pillow.Resampling.LANCZOS)
    data = io.BytesIO()
    image.save(data, "WEBP", quality=60)
    return "data:image/webp;base64," + base64.b64encode(data.getvalue()).decode()
