"""Views into media: what these add and take belongs to the rays of the eye, and is made for each view anew."""

from __future__ import annotations

from dataclasses import dataclass, replace

import torch
from torch import Tensor

from torchrender.buffers import VisibilityBuffer
from torchrender.effects.media.in_view import boxes_in_view, boxes_of
from torchrender.effects.upsampling.joint import joint_upsampled
from torchrender.image import Image
from torchrender.passes.picture.resample import resampled
from torchrender.passes.picture.scattering import SCATTERING, Hazed, layer_before
from torchrender.pipeline.history import RenderHistory
from torchrender.pipeline.options import RenderOptions
from torchrender.raster import rasterize_visibility
from torchrender.scene.camera import Cameras
from torchrender.scene.model import Scene

SCALE, SCALE_MOVING = 1 / 4, 1 / 6
"""Of a side of the picture that media are made for, to be spread along surfaces: what they add changes slowly, but at
outlines. Of views at rest, and of those that move, in half the time: in front of the street lamp 50 and 46 dB beside
media of all pixels."""
SLICES = (256, 256)
"""Of each light's depth images, where rays are lit."""
PANELS = 4
"""Along each of these rays, through heights."""
THICK = 0.02
"""Transmittance below which nothing is known of what lies behind."""


@dataclass(frozen=True, eq=False)
class Haze:
    """What media put before what one camera sees: ``seen = passed * behind + added``."""

    passed: Tensor  # (H,W,3) transmittance
    added: Tensor  # (H,W,3) radiance

    @classmethod
    def of(
        cls,
        scene: Scene,
        seen: VisibilityBuffer,
        options: RenderOptions,
        past: RenderHistory,
        *,
        moving: bool = False,
    ) -> Haze | None:
        """Made quickly for a new view; None where the pictures before left no depth images of the lights."""
        options = replace(options, scattering=replace(options.scattering, block=1, slices=SLICES, panels=PANELS))
        few = rasterize_visibility(scene.geometry, seen.cameras.scaled(SCALE_MOVING if moving else SCALE))
        layer = layer_before(scene, few, options, past)
        if layer is None:
            return None
        return cls(layer.transmittance[0], layer.scattered[0]).spread(scene, few, seen)

    def spread(self, scene: Scene, few: VisibilityBuffer, seen: VisibilityBuffer) -> Haze:
        """That of pixels as few as ``few`` for what is ``seen``, along its surfaces."""
        both = torch.cat([self.passed, self.added], dim=-1)[None]
        passed, added = joint_upsampled(both, few, seen, scene.geometry.material)[0].split(3, dim=-1)
        return Haze(passed, added)

    @classmethod
    def of_image(cls, image: Image) -> Haze | None:
        """Of a picture that carries it, of one or several samples a pixel; None: there was none."""
        hazed = image.buffers.get(SCATTERING.name)
        if not isinstance(hazed, Hazed) or hazed.layer is None:
            return None
        size = (image.cameras.height, image.cameras.width)
        parts = (hazed.layer.transmittance, hazed.layer.scattered)
        return cls(*((part if part.shape[1:3] == size else resampled(part, size, "joint"))[0] for part in parts))

    def part(self, rows: slice, columns: slice) -> Haze:
        """Of some pixels."""
        return Haze(self.passed[rows, columns], self.added[rows, columns])

    @property
    def thick(self) -> Tensor:
        """(H,W) bool: nothing is known of what lies behind."""
        return self.passed.amin(dim=-1) < THICK

    def behind(self, light: Tensor, chosen: Tensor | None = None) -> Tensor:
        """What was behind the light (H,W,3) that is seen; with ``chosen`` (H,W) of these N pixels, (N,3)."""
        passed, added = (part if chosen is None else part[chosen] for part in (self.passed, self.added))
        return ((light - added) / passed.clamp_min(THICK)).clamp_min(0.0)

    def before(self, light: Tensor) -> Tensor:
        """The light (H,W,3) of what lies behind, as it is seen."""
        return torch.addcmul(self.added, self.passed, light)


def is_hazy(scene: Scene, camera: Cameras, options: RenderOptions) -> bool:
    """Whether a view looks into media."""
    return options.media and bool(boxes_in_view(boxes_of(scene.media), camera).any())
