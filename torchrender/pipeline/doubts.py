"""What can be drawn but hardly was meant so: said once, from what a picture has at hand."""

from __future__ import annotations

import contextlib
import math
import warnings
from collections.abc import Iterator, Sequence
from contextvars import ContextVar
from dataclasses import replace

import torch
from torch import Tensor

from torchrender.effects.shadows.light_cameras import wide_lights
from torchrender.errors import (
    ColorWarning,
    EmptyWarning,
    ExposureWarning,
    LightWarning,
    NotUsedWarning,
    TorchRenderWarning,
    UnitsWarning,
    ViewWarning,
)
from torchrender.numerics.texels.coded import codes_of
from torchrender.pipeline.options import RenderOptions
from torchrender.scene.light import Light, PointLight, RectLight, SpotLight, light_color
from torchrender.scene.model import Scene

LARGE = 1000.0
"""Scene units across from which on metres are doubted."""
FAR = 100.0
"""Scene units across from which on it is doubted that lamps without units reach."""
DIM = 1e-3
"""Irradiance that shows as black."""
ASKED = 1000
"""Vertices that are asked for their light."""
MOST = 0.98
"""Share of what is asked that must agree before something is said."""

Doubt = tuple[type[TorchRenderWarning], str]


def scene_doubts(scene: Scene) -> list[Doubt]:
    """About lights and units; kept with the scene."""
    known: list[Doubt] | None = scene.__dict__.get("_doubts")
    if known is None:
        known = [*_emptiness(scene), *_dark_lights(scene), *_flat_lights(scene), *_units(scene), *_bytes(scene)]
        known += [*_opacities(scene), *_glows(scene)]
        scene.__dict__["_doubts"] = known
    return known


def shadow_doubts(scene: Scene, options: RenderOptions) -> list[Doubt]:
    """About lights that one map from their middle is too little for, in a picture made so."""
    if not options.shadows or options.area_shadows != "pcss":
        return []
    wide = wide_lights(scene)
    if not wide:
        return []
    told = f"{lights_told(scene, wide)} large beside what stands close by: maps from the middle see little around that"
    return [(LightWarning, f'{scene.name}: {told}: area_shadows="sampled" does')]


def lights_told(scene: Scene, numbers: Sequence[int]) -> str:
    """Lights as texts name them, and the verb."""
    first = f"light {scene.lights[numbers[0]].name!r}"
    return f"{first} is" if len(numbers) == 1 else f"{first} and {len(numbers) - 1} more are"


def say(doubts: list[Doubt]) -> None:
    """Warn, each text once."""
    for kind, text in dict.fromkeys(doubts):
        if kind is not ViewWarning or not is_looking_about():
            warnings.warn(text, kind, stacklevel=3)


_LOOKING_ABOUT: ContextVar[bool] = ContextVar("looking_about", default=False)


def is_looking_about() -> bool:
    """Whether somebody moves the camera by hand."""
    return _LOOKING_ABOUT.get()


@contextlib.contextmanager
def looking_about() -> Iterator[None]:
    """Somebody moves the camera by hand: a look past everything, or from inside of something, is no mistake."""
    token = _LOOKING_ABOUT.set(True)
    try:
        yield
    finally:
        _LOOKING_ABOUT.reset(token)


_CAMERA_NAMES: ContextVar[tuple[str, ...]] = ContextVar("camera_names", default=())


@contextlib.contextmanager
def naming_cameras(*names: str) -> Iterator[None]:
    """Cameras of pictures that are made here have these names; an empty one: its number."""
    token = _CAMERA_NAMES.set(names)
    try:
        yield
    finally:
        _CAMERA_NAMES.reset(token)


def camera_told(number: int) -> str:
    """A camera as texts name it."""
    names = _CAMERA_NAMES.get()
    return f"camera {names[number]!r}" if number < len(names) and names[number] else f"camera {number}"


def exposure_of(scene: Scene, options: RenderOptions, *, quiet: bool = False) -> float | None:
    """EV for display, None for automatic; lights in candela and lux ask for the latter: said, if not quiet."""
    if not isinstance(options.exposure, str):
        return options.exposure
    if not scene.photometric:
        return 0.0
    if not quiet:
        warnings.warn(f"{scene.name}: lights in candela and lux: exposure is automatic", ExposureWarning, stacklevel=4)
    return None


def _emptiness(scene: Scene) -> list[Doubt]:
    if scene.geometry.triangle_count or scene.environment is not None or not all(m.is_empty for m in scene.media):
        return []
    holds = f"its {len(scene.meshes)} meshes have no triangles" if scene.meshes else "it has no meshes"
    return [(EmptyWarning, f"{scene.name}: {holds}, no media and no environment: there is nothing to be seen")]


def _opacities(scene: Scene) -> list[Doubt]:
    """Materials that are drawn opaque, and say otherwise."""
    return [
        (NotUsedWarning, f"{scene.name}: opacity {m.opacity:g} of material {m.name!r} is not used: {_BLEND}")
        for m in scene.materials
        if m.opacity < 1.0 and not m.blend and m.alpha_cutoff is None
    ]


_BLEND = "give it blend=True, so that what lies behind shows through, or alpha_cutoff, so that less alpha is a hole"


def _glows(scene: Scene) -> list[Doubt]:
    """Media that would glow if they absorbed."""
    how = "a medium emits absorption times emission: give it absorption"
    return [
        (NotUsedWarning, f"{scene.name}: emission of medium {medium.name!r} is not used, as it absorbs nothing: {how}")
        for medium in scene.media
        if bool((medium.emission > 0).any()) and not bool(((medium.emission > 0) & (medium.absorption > 0)).any())
    ]


def _dark_lights(scene: Scene) -> list[Doubt]:
    boxes = scene.geometry.cluster_bounds
    if not len(boxes):
        return []
    dark = [light for light in scene.lights if _faces_away(light, boxes)]
    turned = "turn its direction" if dark and isinstance(dark[0], SpotLight) else "swap edge_u and edge_v"
    return [
        (LightWarning, f"{scene.name}: light {light.name!r} faces away from everything there is: {turned}")
        for light in dark
    ]


def _flat_lights(scene: Scene) -> list[Doubt]:
    return [
        (LightWarning, f"{scene.name}: light {light.name!r} has no area and lights nothing: {_edges(light)}")
        for light in scene.lights
        if isinstance(light, RectLight) and light.area == 0 and bool((light.radiance > 0).any())
    ]


def _edges(light: RectLight) -> str:
    if bool((light.edge_u != 0).any()) and bool((light.edge_v != 0).any()):
        return "edge_u and edge_v are parallel"
    return "an edge has length zero"


def _bytes(scene: Scene) -> list[Doubt]:
    """Colours that are likely to count from 0 to 255."""
    colors = [(f"colors of mesh {m.name!r}", m.colors) for m in scene.meshes if m.colors is not None]
    colors += [(f"diffuse of material {m.name!r}", m.diffuse) for m in scene.materials]
    textures = [(m.name, m.diffuse_texture) for m in scene.materials if m.diffuse_texture is not None]
    # Those that are kept as codes end at 1.
    colors += [(f"diffuse_texture of material {name!r}", t) for name, t in textures if codes_of(t) is None]
    high = [(name, float(c.detach().max())) for name, c in colors if c.numel() and float(c.detach().max()) > BYTES]
    how = "colours are linear light from 0 to 1: divide those of 8 bits by 255, and undo sRGB"
    return [(ColorWarning, f"{scene.name}: {name} reach {most:.4g}: {how}") for name, most in high]


BYTES = 4.0
"""Reflected share of light from on which a colour is taken for one of 8 bits."""


def _faces_away(light: Light, boxes: Tensor) -> bool:
    """Whether no box (N,2,3) reaches the side, or the cone, that the light shines to."""
    low, high = boxes.unbind(1)
    if isinstance(light, RectLight):
        normal = light.normal.double()
        ahead = torch.where(normal > 0, high, low) - light.corner
        return light.area > 0 and not bool(((ahead * normal).sum(1) > 1e-9 * ahead.norm(dim=1)).any())
    if isinstance(light, SpotLight):
        middle, radius = (low + high) / 2 - light.position, (high - low).norm(dim=1) / 2
        distance, along = middle.norm(dim=1), (middle * light.direction.double()).sum(1)
        angle = torch.acos((along / distance.clamp_min(1e-300)).clamp(-1, 1))
        width = torch.asin((radius / distance.clamp_min(1e-300)).clamp(max=1.0))
        inside = distance <= radius
        return not bool((inside | (angle - width < math.radians(light.outer_deg))).any())
    return False


def _units(scene: Scene) -> list[Doubt]:
    near = [light for light in scene.lights if isinstance(light, PointLight | SpotLight)]
    if not near:
        return []
    size = scene.diagonal
    if scene.photometric and size >= LARGE:
        text = f"{scene.name}: {size:,.0f} units across, and lights in candela, which take a unit as a metre"
        return [(UnitsWarning, f"{text}: if these are millimetres, scale meshes, lights and cameras by 0.001")]
    if scene.photometric or size < FAR or len(near) < len(scene.lights) or replace(scene, lights=()).is_lit:
        return []
    most = _brightest(scene.geometry.vertices, near)
    if not 0 < most < DIM:
        return []
    text = (
        f"{scene.name}: {size:,.0f} units across, and its lamps bring an irradiance of {most:.1g} at most to nearly all"
        " of it: light falls off with the squared distance"
    )
    how = "scale meshes, lights and cameras by 0.001, or multiply intensities by 1e6"
    return [(UnitsWarning, f"{text}; if these are millimetres, {how}")]


def _brightest(vertices: Tensor, lamps: list[PointLight | SpotLight]) -> float:
    """Irradiance that all but a few of the vertices (V,3) stay below, whatever hides the lamps from them."""
    points = vertices[:: max(1, len(vertices) // ASKED)]
    total = torch.zeros(len(points), dtype=torch.float64)
    for lamp in lamps:
        power = float(light_color(lamp).detach().max())
        total += power / (points - lamp.position).square().sum(1).clamp_min(1e-30)
    return float(total.quantile(MOST))
