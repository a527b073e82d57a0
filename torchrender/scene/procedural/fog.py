"""Fog for a scene that brings none: one medium around it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import torch

from torchrender.errors import OptionError
from torchrender.scene.medium import Medium
from torchrender.scene.model import Scene

KEYS = ("scattering", "absorption", "emission", "asymmetry", "density", "height", "floor")
MARGIN = 0.02
"""By which the fog's box exceeds the scene, as a share of its diagonal."""


def with_fog(scene: Scene, values: Mapping[str, float]) -> Scene:
    """The scene with fog around all of it, and around its cameras, in place of the media that it has.

    Args:
        values: ``scattering``, ``absorption`` in 1/unit (0.1 over the scene's diagonal where neither is given),
            ``emission`` as radiance (times absorption: without that there is none), ``asymmetry`` g, ``density``, and
            ``height``: over so many scene units upwards from ``floor`` (the lowest point of the scene) it gets thinner
            by a factor e.

    Raises:
        OptionError: an unknown name, or a height that is not positive; InputError: a value out of its range.
    """
    for name in values:
        if name not in KEYS:
            raise OptionError(f"fog has no {name!r}; known: {', '.join(KEYS)}")
    low, high = scene.bounds
    eyes = torch.cat([camera.eye for camera in scene.cameras.values()]) if scene.cameras else torch.zeros(0, 3)
    corners = torch.cat([low[None], high[None], eyes.double()])
    size = float((corners.amax(0) - corners.amin(0)).norm()) or 1.0
    height = values.get("height")
    if height is not None and not height > 0:
        raise OptionError(f"height of fog must be > 0, got {height}")
    usual = 0.0 if "absorption" in values or "emission" in values else 1.0 / size
    fog = Medium(
        low=corners.amin(0) - MARGIN * size,
        high=corners.amax(0) + MARGIN * size,
        scattering=torch.full((3,), values.get("scattering", usual)),
        absorption=torch.full((3,), values.get("absorption", 0.0)),
        emission=torch.full((3,), values.get("emission", 0.0)),
        asymmetry=values.get("asymmetry", 0.0),
        density=values.get("density", 1.0),
        falloff=0.0 if height is None else 1.0 / height,
        floor=None if height is None else values.get("floor", float(low[1])),
        name="fog",
    )
    return replace(scene, media=(fog,))


def changed_media(scene: Scene, density: float = 1.0, asymmetry: float | None = None) -> Scene:
    """The scene with all media ``density`` times as thick, and with another asymmetry g; nothing else changes.

    Raises:
        OptionError: a negative factor, or g outside [-0.99, 0.99].
    """
    if not 0.0 <= density <= 1e6:
        raise OptionError(f"density must be in [0, 1e6], got {density}")
    if density == 1.0 and asymmetry is None:
        return scene
    media = tuple(
        replace(
            medium,
            scattering=medium.scattering * density,
            absorption=medium.absorption * density,
            asymmetry=medium.asymmetry if asymmetry is None else asymmetry,
        )
        for medium in scene.media
    )
    return scene.replace(media=media)
