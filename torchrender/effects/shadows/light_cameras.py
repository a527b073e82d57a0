"""Cameras that look out of a light: spot cones, parallel light, cubes around points, cascades along a view.

Every camera is fitted to what is there: a set of axis-aligned boxes (C,2,3), for instance
``Geometry.cluster_bounds`` (tight) or ``Scene.bounds[None]`` (loose). Depth is camera z and linear, so a small near
plane costs no precision. ``border`` texels on each side are kept free for filters.
"""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise

import torch
from torch import Tensor

from torchrender.checks import check_finite, check_range, check_tensor
from torchrender.numerics.shadow_compare import LightView
from torchrender.scene.camera import Cameras, look_at_matrix, pinhole_matrix
from torchrender.scene.light import DirectionalLight, Light, PointLight, RectLight, SpotLight

NEAREST = 1e-4
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
    if isinstance(light, PointLight):
        return _fit_depth(_cube(light.position, None, size), boxes)
    if isinstance(light, RectLight):
        return _fit_depth(_cube(light.centre, light.normal if light.area > 0 else None, size), boxes)
    if light.outer_deg > WIDEST_CONE_DEG:
        return _fit_depth(_cube(light.position, light.direction, size), boxes)
    return _fit_depth(_cone(light, size), boxes)


def cascade_cameras(
    light: DirectionalLight,
    boxes: Tensor,
    view: Cameras,
    *,
    count: int,
    width: int,
    height: int,
    border: float = 2.0,
) -> Cameras:
    """``count`` orthographic views per camera of ``view``, from the nearest slice of its frustum to the farthest.

    Slices end at ``cascade_splits``; each is enclosed by a sphere, so that turning the view does not change the texel
    size, and placed in whole texels (texel snapping), so that moving the view does not make edges crawl. A side that
    the sphere covers completely is cut to the boxes. All cascades keep the depth range of the boxes: casters outside
    the view count too.

    Returns:
        B * count cameras; those of one view stand together.
    """
    boxes = _checked(boxes)
    check_range("border", border, 0.0, min(width, height) / 4)
    check_range("count", count, 1)
    scene = _parallel(light, boxes, (width, height, border))
    k = scene.intrinsics[0]
    room = torch.tensor([width / 2 - border, height / 2 - border], dtype=torch.float64)
    scene_half = room / k[(0, 1), (0, 1)]
    scene_centre = (torch.tensor([width, height]) / 2 - k[:2, 2]) / k[(0, 1), (0, 1)]
    views = []
    for index in range(len(view)):
        for corners in _slice_corners(view[index], boxes, count):
            centre = corners.mean(0)
            radius = float((corners - centre).norm(dim=1).max()) * (1 + _PAD)
            place = scene.transform(centre[None])[0, 0, :2]
            whole = scene_half <= radius
            half = torch.where(whole, scene_half, radius)
            texel = half / room
            snapped = torch.round(place / texel) * texel
            place = torch.where(whole, scene_centre, snapped)
            focal = 1.0 / texel
            offset = torch.tensor([width, height], dtype=torch.float64) / 2 - place * focal
            numbers = [float(x) for x in (*focal, *offset)]
            views.append(replace(scene, intrinsics=pinhole_matrix(*numbers)[None]))
    return Cameras.cat(views)


def cascade_splits(near: float, far: float, count: int, weight: float = 0.7) -> list[float]:
    """``count + 1`` depths from near to far: ``weight`` times logarithmic plus the rest uniform steps.

    Source: Zhang et al., Parallel-split shadow maps, 2006.
    """
    shares = [i / count for i in range(count + 1)]
    splits = [weight * near * (far / near) ** s + (1 - weight) * (near + (far - near) * s) for s in shares]
    return [near, *splits[1:-1], far]


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


def choose_views(points: Tensor, cameras: Cameras, margin: float) -> Tensor:
    """(N,) int64: the view in which a light looks up each of N points (N,3).

    Faces of a cube: the one that the point lies in front of most. Cascades: the first that holds it ``margin`` texels
    away from its border, else the last.
    """
    if len(cameras) == 1:
        return torch.zeros(len(points), dtype=torch.int64)
    if not cameras.orthographic:
        return cameras.transform(points)[..., 2].argmax(dim=0)
    uv, z = cameras.project(points)
    high = torch.tensor([cameras.width - margin, cameras.height - margin], dtype=torch.float64)
    holds = ((uv >= margin) & (uv < high)).all(-1) & (z > cameras.near[:, None]) & (z <= cameras.far[:, None])
    first = holds.to(torch.uint8).argmax(dim=0)
    return torch.where(holds.any(0), first, len(cameras) - 1)


# ---------------------------------------------------------------- one kind of light each


def _parallel(light: DirectionalLight, boxes: Tensor, size: tuple[int, int, float]) -> Cameras:
    width, height, border = size
    # The frame hangs on the world's origin, not on the boxes: texels then stay where they are when the scene grows.
    matrix = look_at_matrix(torch.zeros(3), light.direction, _UP)
    low, high = _extent(matrix, boxes)
    diagonal = float((high - low).norm())
    half = ((high - low) / 2).clamp_min(diagonal * _PAD)[:2] * (1 + _PAD)
    centre = (low + high)[:2] / 2
    focal = torch.tensor([width / 2 - border, height / 2 - border], dtype=torch.float64) / half
    offset = torch.tensor([width / 2, height / 2], dtype=torch.float64) - centre * focal
    k = pinhole_matrix(float(focal[0]), float(focal[1]), float(offset[0]), float(offset[1]))
    # A flat scene has no depth of its own, yet the biases are shares of the depth range.
    pad = 0.01 * diagonal
    return Cameras(matrix[None], k[None], width, height, low[2] - pad, high[2] + pad, orthographic=True)


def _cone(light: SpotLight, size: tuple[int, int, float]) -> Cameras:
    width, height, border = size
    eye = light.position.double()
    matrix = look_at_matrix(eye, eye + light.direction.double(), _UP)
    slope = math.tan(math.radians(light.outer_deg))
    k = pinhole_matrix((width / 2 - border) / slope, (height / 2 - border) / slope, width / 2, height / 2)
    return _unfitted(matrix[None], k, width, height)


def _cube(position: Tensor, axis: Tensor | None, size: tuple[int, int, float]) -> Cameras:
    """Six faces along the world's axes, or five around ``axis`` that leave out the one behind it."""
    width, height, border = size
    eye = position.double()
    if axis is None:
        frame = torch.eye(3, dtype=torch.float64)
    else:
        frame = look_at_matrix(torch.zeros(3), axis, _UP)[:3, :3]
    directions = [frame[2], frame[0], -frame[0], frame[1], -frame[1]] + ([-frame[2]] if axis is None else [])
    # The frame of each face is made at the origin: eye + direction would round it away far from the origin.
    ups = [frame[2] if abs(float(d @ frame[1])) > 0.5 else frame[1] for d in directions]
    rotations = torch.stack([look_at_matrix(torch.zeros(3), d, up)[:3, :3] for d, up in zip(directions, ups)])
    matrix = torch.eye(4, dtype=torch.float64).repeat(len(directions), 1, 1)
    matrix[:, :3, :3] = rotations
    matrix[:, :3, 3] = -rotations @ eye
    return _unfitted(
        matrix, pinhole_matrix(width / 2 - border, height / 2 - border, width / 2, height / 2), width, height
    )


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
            low, high = _extent(cameras.camera_from_world[index], seen)
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


def _extent(camera_from_world: Tensor, boxes: Tensor) -> tuple[Tensor, Tensor]:
    """Smallest and largest camera-space corner (3,) of all boxes."""
    rotation, shift = camera_from_world[:3, :3], camera_from_world[:3, 3]
    centre = boxes.mean(1) @ rotation.T + shift
    half = (boxes[:, 1] - boxes[:, 0]) / 2 @ rotation.abs().T
    return (centre - half).amin(0), (centre + half).amax(0)


def _slice_corners(view: Cameras, boxes: Tensor, count: int) -> list[Tensor]:
    """Corners (8,3) of the slices of one view's frustum, nearest first."""
    low, high = _extent(view.camera_from_world[0], boxes)
    far = float(high[2])
    if view.orthographic:
        near, far = max(float(view.near[0]), float(low[2])), min(float(view.far[0]), far)
        far = max(far, near + float((high - low).norm()) * _PAD)
        splits = [near + (far - near) * i / count for i in range(count + 1)]
    else:
        near = float(view.near[0])
        # Steps of sqrt(2) keep the slices, and with them the texel size, still while the view moves a little.
        far = max(far, near * 2)
        far = min(math.sqrt(2) ** math.ceil(2 * math.log2(far)), float(view.far[0]))
        splits = cascade_splits(max(near, far * NEAREST), far, count)
        splits[0] = near
    w, h = float(view.width), float(view.height)
    pixels = torch.tensor([[0.0, 0.0], [w, 0.0], [0.0, h], [w, h]], dtype=torch.float64).repeat(2, 1)[None]
    depths = [torch.tensor([a] * 4 + [b] * 4, dtype=torch.float64)[None] for a, b in pairwise(splits)]
    return [view.unproject(pixels, d)[0] for d in depths]
