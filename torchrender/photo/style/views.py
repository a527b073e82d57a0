"""Views of a scene that together show its objects: from within a room, or from around what is no room."""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor

from torchrender.buffers import GBuffer
from torchrender.errors import InputError
from torchrender.photo.style.objects import StyleObjects
from torchrender.photo.style.options import MAX_VIEWS, StyleOptions
from torchrender.raster import rasterize, rasterize_visibility
from torchrender.rays import RayCaster
from torchrender.scene.camera import Cameras
from torchrender.scene.model import Scene

FOV_DEG = 60.0
EYE_HEIGHT = 1.5  # metres, in scenes as high as a room
ROOM_HEIGHTS = (2.0, 6.0)
EYE_SHARE, TARGET_SHARE = 0.55, 0.4  # of the scene's height
SHRINK = 0.05
CLEAR = 0.3  # of the way to the target
AIMED_SHARE = 0.02  # of the picture that an aimed view gives its object
MIN_FOV_DEG = 20.0
RIM_RAYS, RIM_SHARE = 40, 0.9  # rays that tell rooms from things, and where on the way to the rim they start
STEPS = 17  # tried on the way to the target
SMALL = (160, 120)  # pixels of pictures that only count objects
TRIED = 24  # objects considered for one more view


@dataclass(frozen=True, eq=False)
class Views:
    """n views of a scene and what they show."""

    cameras: Cameras  # n
    gbuffer: GBuffer
    object: Tensor  # (n,H,W) int64, -1 where nothing is that gets a material
    pixels: Tensor  # (m,n) int64 pixels of each object in each view
    visible: Tensor  # (m,n) bool: large enough there to be fitted

    def __len__(self) -> int:
        return len(self.cameras)


def look(scene: Scene, objects: StyleObjects, cameras: Cameras, visible_share: float = 0.003) -> Views:
    """What given cameras see. An object is visible where it covers ``visible_share`` of all pixels.

    Raises:
        InputError: no camera, or more than ``MAX_VIEWS``.
    """
    if not 1 <= len(cameras) <= MAX_VIEWS:
        raise InputError(f"cameras must be 1 to {MAX_VIEWS} views, got {len(cameras)}")
    gbuffer = rasterize(scene, cameras)
    seen = _objects_of(objects, gbuffer.triangle)
    pixels = count_pixels(seen, len(objects))
    least = visible_share * cameras.width * cameras.height
    return Views(cameras, gbuffer, seen, pixels, pixels >= max(least, 1.0))


def count_pixels(seen: Tensor, count: int) -> Tensor:
    """(m,n) int64 pixels of each of ``count`` objects in maps (n,H,W) of objects, -1 for none."""
    views = seen.shape[0]
    keys = seen.reshape(views, -1) + 1 + (count + 1) * torch.arange(views)[:, None]
    return torch.bincount(keys.reshape(-1), minlength=views * (count + 1)).reshape(views, count + 1)[:, 1:].T


def make_views(scene: Scene, objects: StyleObjects, options: StyleOptions) -> Cameras:
    """Generated views: ``options.views`` evenly around the scene, then some aimed at objects that these do not show.

    Rooms are seen from within: eyes along the floor's rectangle, shrunk by 5 %, at 1.5 m, or 55 % of the height where
    the scene is not as high as a room; each looks at the middle and moves inwards until the way there is clear for
    30 %. A scene that rays leave to its sides is no room and is seen from outside, in turn from lower and higher.

    Raises:
        InputError: a scene without extent.
    """
    if not scene.diagonal > 0:
        raise InputError(f"scene {scene.name!r} has no extent")
    caster = RayCaster(scene.geometry)
    target = _target(scene)
    rim = _rim(scene, options.views)
    inside = _is_room(caster, scene)
    eyes = _inside(scene, objects, (caster, rim, target)) if inside else _orbit(scene, options.views)
    cameras = _cameras(scene, eyes, target, (options.width, options.height))
    return _complete(scene, objects, cameras, options)


def _cameras(scene: Scene, eyes: Tensor, target: Tensor, size: tuple[int, int]) -> Cameras:
    near = 1e-3 * scene.diagonal
    return Cameras.look_at(eyes, target, width=size[0], height=size[1], fov_deg=FOV_DEG, near=near)


# ---------------------------------------------------------------------- eyes


def _target(scene: Scene) -> Tensor:
    low, high = scene.bounds
    target = (low + high) / 2
    target[1] = low[1] + TARGET_SHARE * (high[1] - low[1])
    return target


def _rim(scene: Scene, count: int) -> Tensor:
    """(n,3) points at even distances along the shrunk floor rectangle, at eye height; the first in a corner."""
    low, high = scene.bounds
    height = float(high[1] - low[1])
    above = EYE_HEIGHT if ROOM_HEIGHTS[0] <= height <= ROOM_HEIGHTS[1] else EYE_SHARE * height
    inset = SHRINK / 2 * (high - low)
    (x0, _, z0), (x1, _, z1) = (low + inset).tolist(), (high - inset).tolist()
    width, depth = x1 - x0, z1 - z0
    points = []
    for k in range(count):
        s = k / count * 2 * (width + depth)
        if s < width:
            x, z = x0 + s, z0
        elif s < width + depth:
            x, z = x1, z0 + s - width
        elif s < 2 * width + depth:
            x, z = x1 - (s - width - depth), z1
        else:
            x, z = x0, z1 - (s - 2 * width - depth)
        points.append((x, float(low[1]) + above, z))
    return torch.tensor(points, dtype=torch.float64)


def _is_room(caster: RayCaster, scene: Scene) -> bool:
    """Whether most level rays that start near the rim of the floor and leave the middle still meet a wall.

    Measured on rooms and things: at least 62 % for rooms, at most 42 % for others. Which way walls are turned does not
    count, and a thick wall around the rim is a wall, too.
    """
    rim, centre = _rim(scene, RIM_RAYS), scene.bounds.mean(dim=0)
    outward = rim - centre
    outward[:, 1] = 0.0
    outward[outward.norm(dim=1) <= 0] = torch.tensor([1.0, 0.0, 0.0], dtype=torch.float64)
    start = torch.lerp(centre.expand_as(rim), rim, RIM_SHARE)
    start[:, 1] = rim[:, 1]
    return float(caster.first_hit(start, outward).hit.double().mean()) > 0.5


def _inside(scene: Scene, objects: StyleObjects, stage: tuple[RayCaster, Tensor, Tensor]) -> Tensor:
    """(n,3) eyes within a room: on the way from the rim to the target, the first that have 30 % of it clear.

    An eye that shows less than half as many objects as most do (it may stand behind a wall of a room with corners)
    goes on to where the most are seen.
    """
    caster, rim, target = stage
    steps = torch.linspace(0.0, 0.8, STEPS, dtype=torch.float64)
    tried = torch.lerp(rim[:, None], target.expand_as(rim)[:, None], steps[:, None])  # (n,STEPS,3)
    flat = tried.reshape(-1, 3)
    hit = caster.first_hit(flat, target - flat, t_max=CLEAR).hit.reshape(tried.shape[:2])
    first = torch.where((~hit).any(dim=1), (~hit).long().argmax(dim=1), 0)
    eyes = tried[torch.arange(len(rim)), first]
    shown = _shown(scene, objects, eyes, target)
    for k in (shown < 0.5 * float(shown.double().median())).nonzero().reshape(-1).tolist():
        open_ways = (~hit[k]).nonzero().reshape(-1)
        if len(open_ways):
            found = _shown(scene, objects, tried[k, open_ways], target)
            eyes[k] = tried[k, open_ways[found.argmax()]]
    return eyes


def _shown(scene: Scene, objects: StyleObjects, eyes: Tensor, target: Tensor) -> Tensor:
    """(n,) number of objects that cover 0.3 % of a small picture from each eye."""
    cameras = _cameras(scene, eyes, target, SMALL)
    seen = _objects_of(objects, rasterize_visibility(scene.geometry, cameras).triangle)
    return (count_pixels(seen, len(objects)) >= 0.003 * SMALL[0] * SMALL[1]).sum(dim=0)


def _orbit(scene: Scene, count: int) -> Tensor:
    """(n,3) eyes around a scene that is no room; its bounding sphere just fits the view."""
    centre, radius = _target(scene), scene.diagonal / 2
    distance = radius / math.sin(math.radians(FOV_DEG / 2)) * 0.8
    angles = torch.arange(count, dtype=torch.float64) * (2 * math.pi / count) + 0.4
    tilt = torch.where(torch.arange(count) % 2 == 0, math.radians(18.0), math.radians(40.0)).double()
    around = torch.stack([tilt.cos() * angles.sin(), tilt.sin(), tilt.cos() * angles.cos()], dim=1)
    return centre + distance * around


# -------------------------------------------------------------- aimed views


def _complete(scene: Scene, objects: StyleObjects, cameras: Cameras, options: StyleOptions) -> Cameras:
    """More views, while objects are seen nowhere and there may be more: each time the one that shows most of them."""
    least = max(options.visible_share * options.width * options.height, 1.0)
    seen = _objects_of(objects, rasterize_visibility(scene.geometry, cameras).triangle)
    pixels = count_pixels(seen, len(objects))
    boxes = object_boxes(scene, objects)
    given_up: set[int] = set()
    while len(cameras) < MAX_VIEWS:
        hidden = [i for i in (pixels < least).all(dim=1).nonzero().reshape(-1).tolist() if i not in given_up]
        if not hidden:
            break
        tried = _spread(hidden, TRIED)
        aimed = Cameras.cat([_aim(cameras, boxes[i], pixels[i], i, options) for i in tried])
        small = rasterize_visibility(scene.geometry, aimed.scaled(0.5))
        shown = count_pixels(_objects_of(objects, small.triangle), len(objects)) >= least * 0.25
        gain = shown[hidden].sum(dim=0)
        best = int(gain.argmax())
        if int(gain[best]) == 0:
            given_up.update(tried)
            continue
        chosen = aimed[best]
        cameras = Cameras.cat([cameras, chosen])
        more = count_pixels(_objects_of(objects, rasterize_visibility(scene.geometry, chosen).triangle), len(objects))
        pixels = torch.cat([pixels, more], dim=1)
        if not bool((pixels[hidden] >= least).any()):
            given_up.add(tried[best])
    return cameras


def _aim(cameras: Cameras, box: Tensor, pixels: Tensor, number: int, options: StyleOptions) -> Cameras:
    """A view of one object from the eye that sees most of it; else from the nearest eye, or another one in turn."""
    centre, radius = box.mean(dim=0), float((box[1] - box[0]).norm()) / 2
    distance = (cameras.eye - centre).norm(dim=1)
    first = min(len(cameras), options.views)
    if int(pixels.max()) > 0:
        eye = int(pixels.argmax())
    else:
        eye = int(distance[:first].argsort()[number % min(3, first)])
    size = 2 * math.atan2(radius, max(float(distance[eye]), 1e-12))
    fov = min(max(math.degrees(size) / (2 * math.sqrt(AIMED_SHARE)), MIN_FOV_DEG), FOV_DEG)
    position = cameras.eye[eye]
    if float(distance[eye]) <= 1e-9 * max(radius, 1e-30):
        position = position + torch.tensor([0.0, 0.0, max(radius, 1e-6)], dtype=torch.float64)
    near = float(cameras.near[0])
    return Cameras.look_at(
        position, centre, width=options.width, height=options.height, fov_deg=fov, near=near, up=(0.0, 1.0, 1e-3)
    )


def object_boxes(scene: Scene, objects: StyleObjects) -> Tensor:
    """(m,2,3) float64 bounding boxes of the triangles of each object."""
    boxes = []
    for numbers in objects.meshes:
        corners = torch.cat([scene.meshes[k].vertices.double()[scene.meshes[k].faces.reshape(-1)] for k in numbers])
        boxes.append(torch.stack([corners.amin(dim=0), corners.amax(dim=0)]))
    return torch.stack(boxes)


def _objects_of(objects: StyleObjects, triangle: Tensor) -> Tensor:
    """Objects of triangle ids, -1 where there is none."""
    return torch.where(triangle >= 0, objects.triangle[triangle.clamp_min(0)], -1)


def _spread(items: list[int], count: int) -> list[int]:
    """At most ``count`` of the items, evenly spaced."""
    if len(items) <= count:
        return items
    return [items[k * len(items) // count] for k in range(count)]
