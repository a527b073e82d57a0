"""Cameras that look out of a light: spot cones, parallel light, cubes around points.

Every camera is fitted to what is there: a set of axis-aligned boxes (C,2,3), for instance
``Geometry.cluster_bounds`` (tight) or ``Scene.bounds[None]`` (loose). Depth is camera z and linear, so a small near
plane costs no precision. ``border`` texels on each side are kept free for filters.
"""

from __future__ import annotations

import math
from dataclasses import replace

import torch
from torch import Tensor

from torchrender.checks import check_finite, check_range, check_tensor
from torchrender.numerics.shadow_compare import LightView
from torchrender.raster import rasterize_depth
from torchrender.scene.camera import Cameras, look_at_matrix, pinhole_matrix
from torchrender.scene.light import DirectionalLight, Light, PointLight, RectLight, SpotLight
from torchrender.scene.mesh import Geometry
from torchrender.scene.model import Scene

NEAREST = 1e-10
"""Smallest near plane of a light inside the scene, as a share of its far plane."""

WIDEST_CONE_DEG = 65.0
"""Half angle above which one picture plane wastes most of its texels and a spot gets the faces of a cube."""

_UP = torch.tensor([0.0, 1.0, 0.0], dtype=torch.float64)
_PAD = 1e-3


def light_cameras(light: Light, boxes: Tensor, *, width: int, height: int, border: float = 2.0) -> Cameras:
    """The views a light needs to see everything it can light inside ``boxes``.

    Args:
        light: directional: one orthographic camera around the boxes; spot: one perspective camera around its cone
            (the five faces of half a cube if its half angle exceeds 65 degrees); point: six faces of a cube;
            rectangle: five faces at its centre, towards its emitting side (six if it has no area).
        boxes: (C,2,3) smallest and largest corners, scene units; none at all stand for a unit box at the origin.
        width, height: size of each image in texels; they need not be equal.
        border: texels left free at each side, so that filter taps of points at the edge stay inside.

    Raises:
        InputError: wrong shape of ``boxes`` or values that are not finite.
        OptionError: a border that leaves less than half of the image.
    """
    boxes = _checked(boxes)
    check_range("border", border, 0.0, min(width, height) / 4)
    size = (width, height, border)
    if isinstance(light, DirectionalLight):
        return _parallel(light, boxes, size)
    frames = light_frames(light)[0]
    slope = 1.0
    if isinstance(light, SpotLight) and len(frames) == 1:
        slope = math.tan(math.radians(light.outer_deg))
    k = pinhole_matrix((width / 2 - border) / slope, (height / 2 - border) / slope, width / 2, height / 2)
    return _fit_depth(_unfitted(frames, k, width, height), boxes)


def light_frames(light: Light) -> tuple[Tensor, bool]:
    """World-to-view matrices (F,4,4) float64 of all that a light may need, and whether its light is parallel.

    Parallel light: one, around the world's origin; a spot: one, or five where its half angle exceeds 65 degrees; a
    point: the six faces of a cube; a rectangle: five around its emitting side (six if it has no area).
    """
    if isinstance(light, DirectionalLight):
        return look_at_matrix(torch.zeros(3), light.direction, _UP)[None], True
    if isinstance(light, PointLight):
        return _cube(light.position, None), False
    if isinstance(light, RectLight):
        return _cube(light.centre, light.normal if light.area > 0 else None), False
    if light.outer_deg > WIDEST_CONE_DEG:
        return _cube(light.position, light.direction), False
    return _standing(light.position, light.direction.double()[None]), False


def light_view(cameras: Cameras, index: int) -> LightView:
    """One camera as the plain numbers that shadow arithmetic works on."""
    k, matrix = cameras.intrinsics[index], cameras.camera_from_world[index]
    return LightView(
        rotation=matrix[:3, :3],
        translation=matrix[:3, 3],
        focal=(float(k[0, 0]), float(k[1, 1])),
        centre=(float(k[0, 2]), float(k[1, 2])),
        near=float(cameras.near[index]),
        far=float(cameras.far[index]),
        orthographic=cameras.orthographic,
    )


def choose_views(points: Tensor, cameras: Cameras, margin: float, fitted: bool = False) -> Tensor:
    """(N,) int64: the view in which a light looks up each of N points (N,3).

    Faces of a whole cube: the one that the point lies in front of most. Views ``fitted`` to a picture, and parallel
    ones: the first that holds it ``margin`` texels away from its border, else the first that holds it, else the last.
    """
    if len(cameras) == 1:
        return torch.zeros(len(points), dtype=torch.int64)
    if not cameras.orthographic and not fitted:
        return cameras.transform(points)[..., 2].argmax(dim=0)
    uv, z = cameras.project(points)
    size = torch.tensor([cameras.width, cameras.height], dtype=torch.float64)
    deep = (z > cameras.near[:, None]) & (z <= cameras.far[:, None])
    rated = sum(((uv >= m) & (uv < size - m)).all(-1) & deep for m in (margin, 0.0))
    assert isinstance(rated, Tensor)
    last = torch.zeros_like(rated)
    last[-1] = 1
    return (rated * 2 + last).argmax(dim=0)


# ---------------------------------------------------------------- one kind of light each


def _parallel(light: DirectionalLight, boxes: Tensor, size: tuple[int, int, float]) -> Cameras:
    width, height, border = size
    matrix = look_at_matrix(torch.zeros(3), light.direction, _UP)
    low, high = extent(matrix, boxes)
    diagonal = float((high - low).norm())
    half = ((high - low) / 2).clamp_min(diagonal * _PAD)[:2] * (1 + _PAD)
    focal = torch.tensor([width / 2 - border, height / 2 - border], dtype=torch.float64) / half
    # Counted from the middle of what is there: float32 depths far from the world's origin would be coarse.
    matrix[:3, 3] = -(low + high) / 2
    k = pinhole_matrix(float(focal[0]), float(focal[1]), width / 2, height / 2)
    depth = (high - low)[2] / 2 + 0.01 * diagonal  # a flat scene has no depth of its own
    return Cameras(matrix[None], k[None], width, height, -depth, depth, orthographic=True)


def _cube(position: Tensor, axis: Tensor | None) -> Tensor:
    """Six faces along the world's axes, or five around ``axis`` that leave out the one behind it."""
    if axis is None:
        frame = torch.eye(3, dtype=torch.float64)
    else:
        frame = look_at_matrix(torch.zeros(3), axis, _UP)[:3, :3]
    directions = [frame[2], frame[0], -frame[0], frame[1], -frame[1]] + ([-frame[2]] if axis is None else [])
    ups = [frame[2] if abs(float(d @ frame[1])) > 0.5 else frame[1] for d in directions]
    return _standing(position, torch.stack(directions), ups)


def _standing(position: Tensor, directions: Tensor, ups: list[Tensor] | None = None) -> Tensor:
    """World-to-view matrices (F,4,4) of views from one point."""
    # The frame of each view is made at the origin: eye + direction would round it away far from the origin.
    pairs = zip(directions, ups or [_UP] * len(directions), strict=True)
    rotations = torch.stack([look_at_matrix(torch.zeros(3), d, up)[:3, :3] for d, up in pairs])
    matrix = torch.eye(4, dtype=torch.float64).repeat(len(directions), 1, 1)
    matrix[:, :3, :3] = rotations
    matrix[:, :3, 3] = -rotations @ position.double()
    return matrix


# ---------------------------------------------------------------- fitting


def _unfitted(matrix: Tensor, k: Tensor, width: int, height: int) -> Cameras:
    near, far = torch.tensor(1.0, dtype=torch.float64), torch.tensor(2.0, dtype=torch.float64)
    return Cameras(matrix, k.expand(len(matrix), 3, 3), width, height, near, far)


def _fit_depth(cameras: Cameras, boxes: Tensor) -> Cameras:
    """Near and far around the part of the boxes that any view can see; the same for all views, so biases agree."""
    lows, highs = [], []
    for index, planes in enumerate(cameras.frustum_planes()[:, :4]):
        centre, half = boxes.mean(1), (boxes[:, 1] - boxes[:, 0]) / 2
        reach = centre @ planes[:, :3].T + planes[:, 3] + half @ planes[:, :3].abs().T
        seen = boxes[(reach >= 0).all(dim=1)]
        if len(seen):
            low, high = extent(cameras.camera_from_world[index], seen)
            lows.append(float(low[2]))
            highs.append(float(high[2]))
    span = float((boxes[:, 1].amax(0) - boxes[:, 0].amin(0)).norm())
    far = max([*highs, 0.0]) * (1 + _PAD)
    if not far > span * NEAREST:  # nothing lies in front of the light
        far = span
    near = max(min([*lows, far]) * (1 - _PAD), far * NEAREST)
    near = min(near, far * (1 - 0.02))
    limits = [torch.tensor(v, dtype=torch.float64) for v in (near, far)]
    return replace(cameras, near=limits[0], far=limits[1])


def _checked(boxes: Tensor) -> Tensor:
    boxes = check_finite("boxes", check_tensor("boxes", boxes, ("C", 2, 3))).detach().to("cpu", torch.float64)
    if len(boxes) == 0 or not bool((boxes[:, 1] > boxes[:, 0]).any()):
        point = boxes[:1].mean(1) if len(boxes) else torch.zeros(1, 3, dtype=torch.float64)
        return torch.stack([point - 0.5, point + 0.5], dim=1)
    return boxes


def extent(camera_from_world: Tensor, boxes: Tensor) -> tuple[Tensor, Tensor]:
    """Smallest and largest camera-space corner (3,) of all boxes."""
    rotation, shift = camera_from_world[:3, :3], camera_from_world[:3, 3]
    centre = boxes.mean(1) @ rotation.T + shift
    half = (boxes[:, 1] - boxes[:, 0]) / 2 @ rotation.abs().T
    return (centre - half).amin(0), (centre + half).amax(0)


# ---------------------------------------------------------------- one view or many

BESIDE = 0.25
"""Share of the view straight ahead from which on what stands close to a rectangle hides too much of it."""

AROUND = 1.5
"""Times as far as that reaches what is seen around it."""

_TEXELS = 24


def wide_lights(scene: Scene) -> tuple[int, ...]:
    """Numbers of the rectangles whose shadows no view from their middle tells.

    Nearer than half their width something fills much of the view straight ahead, and more lies behind it: other parts
    of the light see past. Found once and kept with the scene.
    """
    known: tuple[int, ...] | None = scene.__dict__.get("_wide_lights")
    if known is None:
        geometry = scene.geometry.solid
        lights = [(n, light) for n, light in enumerate(scene.lights) if isinstance(light, RectLight)]
        known = tuple(n for n, light in lights if light.area > 0 and hidden_ahead(geometry, light) > BESIDE)
        scene.__dict__["_wide_lights"] = known
    return known


def hidden_ahead(geometry: Geometry, light: RectLight) -> float:
    """Share of the view of 90 degrees straight ahead from a rectangle's middle that is filled from close by."""
    boxes = geometry.cluster_bounds
    if not len(boxes):
        return 0.0
    matrix = _standing(light.centre, light.normal.double()[None])
    rotation, shift = matrix[0, :3, :3], matrix[0, :3, 3]
    centre = boxes.mean(1) @ rotation.T + shift
    half = (boxes[:, 1] - boxes[:, 0]) / 2 @ rotation.abs().T
    deepest = centre[:, 2] + half[:, 2]
    ahead = (deepest > 0) & ((centre.abs() - half)[:, :2] <= deepest[:, None]).all(-1)
    if not bool(ahead.any()):
        return 0.0
    close = min(math.sqrt(light.area) / 2, float(deepest[ahead].max()) / AROUND)
    beside = (centre.abs() - half)[:, :2].amax(-1)  # of the view's edge, as far as it is deep
    if not bool((ahead & (centre[:, 2] - half[:, 2] < close) & (beside <= close)).any()):
        return 0.0
    k = pinhole_matrix(_TEXELS / 2, _TEXELS / 2, _TEXELS / 2, _TEXELS / 2)
    limits = [torch.tensor(v * close, dtype=torch.float64) for v in (1e-6, 1.0)]
    view = replace(_unfitted(matrix, k[None], _TEXELS, _TEXELS), near=limits[0], far=limits[1])
    return float(torch.isfinite(rasterize_depth(geometry, view)).float().mean())
