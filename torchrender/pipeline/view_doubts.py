"""What a view can show but hardly was meant to: told from a few hundred of its pixels."""

from __future__ import annotations

import math
from dataclasses import replace

import torch
from torch import Tensor

from torchrender.buffers import GBuffer, VisibilityBuffer
from torchrender.errors import LightWarning, NormalsWarning, ViewWarning
from torchrender.numerics.winding import winding_number
from torchrender.pipeline.doubts import ASKED, MOST, Doubt, camera_told, is_looking_about, scene_doubts
from torchrender.raster import rasterize_visibility
from torchrender.scene.camera import Cameras
from torchrender.scene.light import SpotLight, light_color
from torchrender.scene.mesh import Geometry
from torchrender.scene.model import Scene

LOOKS = 24
"""Pixels along a side of a picture that are asked what they see."""
CLOSE = 1e-6
"""Near plane that cuts nothing off, as a share of the camera's or of the scene's size, whichever is less."""
FARTHEST = 1e18
"""Far plane that cuts nothing off, also of orthographic cameras, whose far plane is finite; scene units."""
THIN_DEG = 1.0
"""Half angle of a spot's cone below which it is asked whether its beam is wider than pixels."""
INSIDE = 0.9
"""Winding number of an object about the eye from which on the eye is within it."""


def view_doubts(scene: Scene, seen: VisibilityBuffer) -> list[Doubt]:
    """About B views of a scene, from a few hundred of their pixels."""
    geometry = scene.geometry
    if not geometry.triangle_count:
        return []
    found: list[Doubt] = []
    height, width = seen.triangle.shape[1:]
    rows, columns = (torch.arange(min(n, LOOKS)) * n // min(n, LOOKS) for n in (height, width))
    for number, triangle in enumerate(seen.triangle[:, rows][:, :, columns].flatten(1)):
        found += _thin_beams(scene, seen, number)
        if not bool((triangle >= 0).any()):
            if not is_looking_about() and not bool((seen.triangle[number] >= 0).any()):
                found += _nothing(scene, seen, number)
        elif not seen.cameras.orthographic:
            found += _sides(scene, geometry, triangle[triangle >= 0].unique(), (seen, number))
    return found


def _thin_beams(scene: Scene, seen: VisibilityBuffer, number: int) -> list[Doubt]:
    """Beams of spots that end in view between pixels, or might."""
    thin = [light for light in scene.lights if isinstance(light, SpotLight) and light.outer_deg < THIN_DEG]
    if not thin or not isinstance(seen, GBuffer):
        return []
    covered = seen.covered[number]
    places, spacing = seen.position[number][covered], seen.cameras[number].footprint(seen.depth[number][covered][None])
    if not len(places):
        return []
    found: list[Doubt] = []
    for light in thin:
        if not bool((light.intensity > 0).any()):
            continue
        away = places - light.position
        along = (away @ light.axis).clamp_min(0.0)
        beside = (away - along[:, None] * light.axis).norm(dim=1)
        nearest = int((beside - spacing[0]).argmin())
        width = 2.0 * float(along[nearest]) * math.tan(math.radians(light.outer_deg))
        if float(beside[nearest]) < float(spacing[0, nearest]) + width and width < float(spacing[0, nearest]):
            told = f"{width / float(spacing[0, nearest]):.2g} pixels wide where it ends: it may fall between them"
            found.append((LightWarning, f"{scene.name}: the beam of light {light.name!r} is {told}"))
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
            told = _black(scene, triangle[covered].unique()) or _unlit(scene)
            found.append((LightWarning, f"{scene.name}: {camera_told(number)} sees only black: {told}"))
    return found


def _black(scene: Scene, triangles: Tensor) -> str:
    """Of what material all is that is seen, if none of it could send any light."""
    materials = [scene.materials[int(n)] for n in scene.geometry.material[triangles].unique()]
    if any(bool((m.diffuse > 0).any()) or float(m.mirror_color.detach().max()) > 0 for m in materials):
        return ""
    names = ", ".join(sorted({repr(m.name) for m in materials}))
    return f"diffuse of material {names} is black, and mirrors nothing"


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


def _nothing(scene: Scene, seen: VisibilityBuffer, number: int) -> list[Doubt]:
    """Why a camera sees nothing solid; no doubt where it looks through panes."""
    eye, (low, high) = seen.cameras.eye[number], scene.bounds
    ahead = seen.cameras.forward[number]
    told = _before_the_near_plane(scene, seen.cameras[number])
    if not told:
        panes, cut = _through(scene, seen.cameras[number])
        if panes:
            return []
        told = (
            f"all that is before it is cut out by the alpha of {cut}"
            if cut
            else f"it stands at {_told(eye)} and looks along {_told(ahead)}; "
            f"the scene lies between {_told(low)} and {_told(high)}"
        )
    return [(ViewWarning, f"{scene.name}: {camera_told(number)} sees nothing: {told}")]


def _through(scene: Scene, camera: Cameras) -> tuple[bool, str]:
    """Whether something that shows what lies behind is in view; else names of materials whose holes are."""
    geometry = scene.geometry
    if geometry.see_through is None and not any(m.alpha_cutoff is not None for m in scene.materials):
        return False, ""
    few = camera.scaled(min(1.0, LOOKS / min(camera.width, camera.height)))
    if geometry.see_through is not None and bool(rasterize_visibility(geometry.panes, few).covered.any()):
        return True, ""
    whole = replace(geometry.solid, cutout=None)
    hit = rasterize_visibility(whole, few)
    names = {scene.materials[int(n)].name for n in whole.material[hit.triangle[hit.covered]].unique()}
    return False, ", ".join(repr(name) for name in sorted(names))


def _before_the_near_plane(scene: Scene, camera: Cameras) -> str:
    """Where something would be seen but for the near plane, or the far plane: which, and what to give instead."""
    pixels, z = camera.project(scene.geometry.vertices[:: max(1, scene.geometry.vertices.shape[0] // ASKED)])
    size = torch.tensor([camera.width, camera.height])
    ahead = z[0][((pixels[0] >= 0) & (pixels[0] <= size)).all(-1) & (z[0] > 0)]
    near, far = float(camera.near[0]), float(camera.far[0])
    # Corners of a triangle that fills the picture lie beside it.
    few = camera.scaled(min(1.0, LOOKS / min(camera.width, camera.height)))
    close, farthest = few.near.clamp_max(scene.diagonal or 1.0) * CLOSE, torch.full_like(few.far, FARTHEST)
    hit = rasterize_visibility(scene.geometry, replace(few, near=close, far=farthest))
    ahead = torch.cat([ahead, hit.depth[hit.covered].double()])
    if not len(ahead):
        return ""
    least, most = float(ahead.min()), float(ahead.max())
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
        eye = seen.cameras.eye[number]
        backs = float((((eye - a) * normal).sum(1) < 0).double().mean()) >= MOST
        if backs and not is_looking_about() and _surrounds(geometry, int(objects[0]), eye):
            name = _name(scene, int(objects[0]))
            found.append(
                (ViewWarning, f"{scene.name}: {camera_told(number)} stands inside {name!r}: all it sees are backs")
            )
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


def _surrounds(geometry: Geometry, number: int, eye: Tensor) -> bool:
    """Whether a place is inside of an object, and not only behind one of its sides."""
    faces = geometry.faces[geometry.object_id == number].long()
    return float(winding_number(geometry.vertices[faces], eye[None])) > INSIDE


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
