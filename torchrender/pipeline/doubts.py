"""What can be drawn but hardly was meant so: said once, from what a picture has at hand."""

from __future__ import annotations

import contextlib
import math
import warnings
from collections.abc import Iterator
from contextvars import ContextVar
from dataclasses import replace

import torch
from torch import Tensor

from torchrender.buffers import VisibilityBuffer
from torchrender.errors import (
    ColorWarning,
    ExposureWarning,
    LightWarning,
    NormalsWarning,
    SceneWarning,
    UnitsWarning,
    ViewWarning,
)
from torchrender.pipeline.options import RenderOptions
from torchrender.scene.camera import Cameras
from torchrender.scene.light import Light, PointLight, RectLight, SpotLight, light_color
from torchrender.scene.mesh import Geometry
from torchrender.scene.model import Scene

LARGE = 1000.0
"""Scene units across from which on metres are doubted."""
FAR = 100.0
"""Scene units across from which on it is doubted that lamps without units reach."""
DIM = 1e-3
"""Irradiance that shows as black."""
ASKED = 1000
"""Vertices that are asked for their light."""
LOOKS = 24
"""Pixels along a side of a picture that are asked what they see."""
MOST = 0.98
"""Share of what is asked that must agree before something is said."""

Doubt = tuple[type[SceneWarning], str]


def scene_doubts(scene: Scene) -> list[Doubt]:
    """About lights and units; kept with the scene."""
    known: list[Doubt] | None = scene.__dict__.get("_doubts")
    if known is None:
        known = [*_dark_lights(scene), *_flat_lights(scene), *_units(scene), *_bytes(scene)]
        scene.__dict__["_doubts"] = known
    return known


def view_doubts(scene: Scene, seen: VisibilityBuffer) -> list[Doubt]:
    """About B views of a scene, from a few hundred of their pixels."""
    geometry = scene.geometry
    if not geometry.triangle_count:
        return []
    found: list[Doubt] = []
    height, width = seen.triangle.shape[1:]
    rows, columns = (torch.arange(min(n, LOOKS)) * n // min(n, LOOKS) for n in (height, width))
    for number, triangle in enumerate(seen.triangle[:, rows][:, :, columns].flatten(1)):
        if not bool((triangle >= 0).any()):
            if not bool((seen.triangle[number] >= 0).any()):
                found.append((ViewWarning, _nothing(scene, seen, number)))
        elif not seen.cameras.orthographic:
            found += _sides(scene, geometry, triangle[triangle >= 0].unique(), (seen, number))
    return found


def picture_doubts(scene: Scene, seen: VisibilityBuffer, radiance: Tensor) -> list[Doubt]:
    """About B pictures (B,H,W,3) of a scene in which something is seen, and nothing of it lit."""
    if any(kind is LightWarning for kind, _ in scene_doubts(scene)):  # that is why
        return []
    height, width = seen.triangle.shape[1:]
    rows, columns = (torch.arange(min(n, LOOKS)) * n // min(n, LOOKS) for n in (height, width))
    found: list[Doubt] = []
    for number, (light, triangle) in enumerate(zip(radiance.detach(), seen.triangle, strict=True)):
        few = light[rows][:, columns][triangle[rows][:, columns] >= 0]
        covered = triangle >= 0
        if len(few) and not float(few.max()) > 0 and not float(light[covered].max()) > 0:
            found.append((LightWarning, f"{scene.name}: camera {number} sees only black: {_unlit(scene)}"))
    return found


def _unlit(scene: Scene) -> str:
    """Why nothing may be lit."""
    names = [repr(light.name) for light in scene.lights if bool((light_color(light) > 0).any())]
    if not names:
        return "there is no light that shines"
    told = ", ".join(names[:4]) + (" ..." if len(names) > 4 else "")
    return (
        f"light of {told} does not arrive at what it sees: the lamp is inside something closed, behind what is seen, "
        "or shines the other way"
    )


def say(doubts: list[Doubt]) -> None:
    """Warn, each text once."""
    for kind, text in dict.fromkeys(doubts):
        if kind is not ViewWarning or not _LOOKING_ABOUT.get():
            warnings.warn(text, kind, stacklevel=3)


_LOOKING_ABOUT: ContextVar[bool] = ContextVar("looking_about", default=False)


@contextlib.contextmanager
def looking_about() -> Iterator[None]:
    """Somebody moves the camera by hand: a look past everything, or from inside of something, is no mistake."""
    token = _LOOKING_ABOUT.set(True)
    try:
        yield
    finally:
        _LOOKING_ABOUT.reset(token)


def exposure_of(scene: Scene, options: RenderOptions, *, quiet: bool = False) -> float | None:
    """EV for display, None for automatic; lights in candela and lux ask for the latter: said, if not quiet."""
    if not isinstance(options.exposure, str):
        return options.exposure
    if not scene.photometric:
        return 0.0
    if not quiet:
        warnings.warn(f"{scene.name}: lights in candela and lux: exposure is automatic", ExposureWarning, stacklevel=4)
    return None


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
    colors += [(f"diffuse_texture of material {name!r}", texture) for name, texture in textures]
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


def _nothing(scene: Scene, seen: VisibilityBuffer, number: int) -> str:
    eye, (low, high) = seen.cameras.eye[number], scene.bounds
    ahead = seen.cameras.forward[number]
    told = _before_the_near_plane(scene, seen.cameras[number])
    if told:
        return f"{scene.name}: camera {number} sees nothing: {told}"
    return (
        f"{scene.name}: camera {number} sees nothing: it stands at {_told(eye)} and looks along {_told(ahead)}; "
        f"the scene lies between {_told(low)} and {_told(high)}"
    )


def _before_the_near_plane(scene: Scene, camera: Cameras) -> str:
    """Where something would be seen but for the near plane, or the far plane: which, and what to give instead."""
    pixels, z = camera.project(scene.geometry.vertices[:: max(1, scene.geometry.vertices.shape[0] // ASKED)])
    size = torch.tensor([camera.width, camera.height])
    ahead = z[0][((pixels[0] >= 0) & (pixels[0] <= size)).all(-1) & (z[0] > 0)]
    if not len(ahead):
        return ""
    least, most, near, far = float(ahead.min()), float(ahead.max()), float(camera.near[0]), float(camera.far[0])
    if most < near:
        told = f"all of it ends {most:.3g} ahead, before the near plane"
        return f"{told}: give the camera near={0.1 * least:.1g}, not {near:g}"
    if least > far:
        return f"it begins {least:.3g} ahead, behind the far plane: give the camera far={2 * most:.1g}, not {far:g}"
    return ""


def _told(point: Tensor) -> str:
    return "(" + ", ".join(f"{v + 0.0:.3g}" for v in point.tolist()) + ")"


def _sides(scene: Scene, geometry: Geometry, triangles: Tensor, view: tuple[VisibilityBuffer, int]) -> list[Doubt]:
    """A single object whose backs fill the picture, and objects whose normals are on the other side of their faces."""
    seen, number = view
    faces = geometry.faces[triangles].long()
    a, b, c = geometry.vertices[faces].unbind(1)
    normal = torch.linalg.cross(b - a, c - a)
    size = normal.norm(dim=1)
    objects = geometry.object_id[triangles]
    found: list[Doubt] = []
    if len(objects.unique()) == 1 and bool((seen.triangle[number] >= 0).all()):
        back = ((seen.cameras.eye[number] - a) * normal).sum(1) < 0
        if float(back.double().mean()) >= MOST:
            name = _name(scene, int(objects[0]))
            found.append((ViewWarning, f"{scene.name}: camera {number} stands inside {name!r}: all it sees are backs"))
    if geometry.normals is None:
        return found
    shading = geometry.normals[faces].double()
    given = (shading.abs().sum(-1) > 0).all(1) & (size > 0)
    inward = ((shading * normal[:, None]).sum(-1) < 0).all(1)
    for one in objects[given & inward].unique():
        own = given & (objects == one)
        if float(inward[own].double().mean()) >= MOST and _is_turned(geometry, int(one)):
            text = f"normals of {_name(scene, int(one))!r} point to the inside of its faces: turn them, or its faces"
            found.append((NormalsWarning, f"{scene.name}: {text}"))
    return found


def _is_turned(geometry: Geometry, number: int) -> bool:
    """Whether normals of most triangles of an object, also of those out of view, are on the other side."""
    faces = geometry.faces[geometry.object_id == number].long()
    a, b, c = geometry.vertices[faces].unbind(1)
    assert geometry.normals is not None
    along = (geometry.normals[faces].double() * torch.linalg.cross(b - a, c - a)[:, None]).sum(-1)
    return float((along < 0).all(1).double().mean()) >= MOST


def _name(scene: Scene, number: int) -> str:
    for place, mesh in enumerate(scene.meshes):
        if (place if mesh.object_id is None else mesh.object_id) == number:
            return mesh.name
    return f"object {number}"
