"""A key frame's reflections moved over its reflectors, and the reflectors then seen from a new view.

Specification 04, sections 6 and 7.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from torchrender.arrays import view
from torchrender.checks import check_tensor, options_of
from torchrender.effects.reflections.key_frame import ReflectionKeyFrame, ReflectionMatches
from torchrender.effects.reflections.reflectors import ReflectivePixels
from torchrender.effects.reflections.reuse_options import ReuseOptions
from torchrender.kernels.reflections.gather import gather
from torchrender.kernels.reflections.records import Gathered, KeyFrame, KeyView, Limits, Pixels
from torchrender.kernels.reflections.shift import SURE, draw_moved, resolve_moved
from torchrender.scene.camera import Cameras

FATES = ("found", "outside", "other surface", "unreliable", "broken", "off ray", "contrast")
"""What :attr:`WarpedReflections.state` counts: a value; a place outside the key frame; another surface there; a place
that no reliable triangle covers; neighbours that mirror different things; a point too far off the pixel's own ray;
neighbours whose colours differ too much."""


@dataclass(frozen=True, eq=False)
class MovedReflections:
    """The intermediate image: for each pixel of B key frames the key position whose reflection is seen there now."""

    source: Tensor  # (B,H,W,2) float32 (x, y) in pixels, NaN where nothing has moved to
    certainty: Tensor  # (B,H,W) uint8: 0 uncovered, 1 covered but not reliable, 2 reliable

    @property
    def reliable(self) -> Tensor:
        """(B,H,W) bool."""
        return self.certainty == SURE


@dataclass(frozen=True, eq=False)
class WarpedReflections:
    """What N reflective pixels of a new view mirror according to the key frame."""

    color: Tensor  # (N,3) float32
    distance: Tensor  # (N,) float32
    source: Tensor  # (N,2) float32 (x, y) key position
    state: Tensor  # (N,) uint8 index into FATES

    @property
    def found(self) -> Tensor:
        """(N,) bool."""
        return self.state == 0


def shift_reflections(
    key: ReflectionKeyFrame, matches: ReflectionMatches, options: ReuseOptions | None = None
) -> MovedReflections:
    """Draw the grid of key pixels with every vertex moved to its match; the nearest reflection wins.

    Triangles that have grown too much, are flipped or bridge a jump in reflected distance are drawn, so that nothing
    shows through them, but are not reliable.
    """
    options = options_of(options, ReuseOptions)
    count, height, width = key.reflector.shape
    source = np.full((count, height, width, 2), np.nan, np.float32)
    certainty = np.zeros((count, height, width), np.uint8)
    for b, place in enumerate(_places(key, matches)):
        ids, shape = view(key.reflector[b], np.int32), view(key.joined[b], np.uint8)
        keys = np.zeros(height * width, np.uint64)
        draw_moved(place, view(key.order[b], np.float32), shape, ids, ids, keys)
        breaks = view(key.breaks[b], np.uint8)
        resolve_moved(keys, place, shape, breaks, float(options.area_ratio), ids, source[b], certainty[b])
    return MovedReflections(torch.from_numpy(source), torch.from_numpy(certainty))


def warp_to_view(
    key: ReflectionKeyFrame,
    moved: MovedReflections,
    pixels: ReflectivePixels,
    options: ReuseOptions | None = None,
    weight: Tensor | None = None,
) -> WarpedReflections:
    """What the reflective pixels of B new views mirror, as far as the moved reflections of B key frames tell.

    Reverse (the default): each pixel projects its own surface point into the key view. Forward: the key frame's
    surface is drawn into the new view, and a pixel takes the place of the triangle that covers it.

    Args:
        weight: (N,) share of what a pixel mirrors in its colour, for the limit of contrast; None: one.
    """
    options = options_of(options, ReuseOptions)
    check_tensor("moved.certainty", moved.certainty, tuple(key.reflector.shape))
    count = len(pixels)
    color, distance = np.zeros((count, 3), np.float32), np.zeros(count, np.float32)
    source, state = np.zeros((count, 2), np.float32), np.zeros(count, np.uint8)
    size = pixels.shape[1] * pixels.shape[2]
    tolerance = _tolerance(pixels)
    weight = torch.ones(count) if weight is None else check_tensor("weight", weight, (count,))
    for b in range(len(key.cameras)):
        rows = (pixels.pixel // size == b).nonzero().reshape(-1)
        if not len(rows):
            continue
        part = slice(int(rows[0]), int(rows[-1]) + 1)  # flat places are in order
        camera = key.cameras[b]
        matrix = camera.intrinsics[0] @ camera.rotation[0]
        place = _drawn(key, b, pixels, part) if options.second_warp == "forward" else torch.zeros(0, 2)
        frame = KeyFrame(
            view(key.surface[b], np.float32), view(key.reflector[b], np.int32), view(key.reached[b], np.float32),
            view(key.distance[b], np.float32), view(key.color[b], np.float32), view(key.breaks[b], np.uint8),
            view(moved.source[b], np.float32), view(moved.certainty[b], np.uint8),
        )  # fmt: skip
        gather(
            Pixels(
                view(place, np.float64),
                view(pixels.object_id[part], np.int32),
                view(tolerance[part], np.float64),
                view(weight[part], np.float32),
                view(pixels.position[part], np.float64),
                view(pixels.direction[part], np.float64),
            ),
            KeyView(view(camera.eye[0], np.float64), view(matrix, np.float64), float(camera.near[0])),
            frame,
            Limits(float(options.correction), float(options.contrast)),
            Gathered(*(a[part] for a in (color, distance, source, state))),
        )
    return WarpedReflections(*(torch.from_numpy(a) for a in (color, distance, source, state)))


def _places(key: ReflectionKeyFrame, matches: ReflectionMatches) -> np.ndarray:
    """(B,H,W,2) float32 new x and y of every pixel centre; NaN where there is no match."""
    count, height, width = key.reflector.shape
    places = torch.full((count * height * width, 2), torch.nan)
    rows = matches.valid.nonzero().reshape(-1)
    pixel = key.pixel[rows]
    x, y = pixel % width, pixel // width % height
    places[pixel] = torch.stack([x, y], dim=1).float() + 0.5 + matches.offset[rows].flip(1)
    return view(places.reshape(count, height, width, 2), np.float32)


def _lookup(camera: Cameras, position: Tensor) -> Tensor:
    """(N,3) float64 u, v and depth of world points (N,3); depth 0 where they have no image."""
    uv, depth = camera.project(position[None])
    behind = ~(depth[0] > camera.near)
    return torch.cat([uv[0], depth[0][:, None]], dim=1).masked_fill(behind[:, None], 0.0)


def _tolerance(pixels: ReflectivePixels) -> Tensor:
    """(N,) depth by which a key pixel may be off and still be the same surface."""
    width = pixels.pixel_angle * pixels.length
    cosine = (pixels.normal * pixels.view).sum(-1).abs().clamp_min(0.1)
    return 0.01 * pixels.length + 2.0 * width / cosine


def _drawn(key: ReflectionKeyFrame, b: int, pixels: ReflectivePixels, part: slice) -> Tensor:
    """(N,2) key positions under pixels of the new view, by drawing the key frame's surface there; -1 where none is."""
    _, height, width = pixels.shape
    rows = key.rows()[b]
    size = key.reflector.shape[1] * key.reflector.shape[2]
    seen = _lookup(
        pixels.cameras[b], key.surface[b].reshape(-1, 8)[key.pixel[rows] - b * size, :3] + key.cameras.eye[b]
    )
    before = seen[:, 2] > 0
    place, depth = torch.full((size, 2), torch.nan), torch.ones(size)
    own = key.pixel[rows] - b * size
    place[own[before]] = seen[before, :2].float()
    depth[own[before]] = seen[before, 2].float()
    shape = tuple(key.reflector.shape[1:])
    ids = view(key.reflector[b], np.int32)
    targets = torch.full((height * width,), -1, dtype=torch.int32)
    targets[pixels.pixel[part] - b * height * width] = pixels.object_id[part].int()
    goal = view(targets.reshape(height, width), np.int32)
    corners, joined = view(place.reshape(*shape, 2), np.float32), view(key.joined[b], np.uint8)
    keys, whole = np.zeros(height * width, np.uint64), np.zeros(shape, np.uint8)
    draw_moved(corners, view(depth.reshape(shape), np.float32), joined, ids, goal, keys)
    source, certainty = np.full((height, width, 2), np.nan, np.float32), np.zeros((height, width), np.uint8)
    resolve_moved(keys, corners, joined, whole, np.inf, goal, source, certainty)
    found = torch.from_numpy(source).reshape(-1, 2)[pixels.pixel[part] - b * height * width]
    return torch.nan_to_num(found, nan=-1.0).double()
