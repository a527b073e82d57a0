"""Ambient visibility from depth images: what hides the sky is searched for along slices through the eye.

Horizon-based occlusion (Bavoil and Sainz, *Image-space horizon-based ambient occlusion*, 2008; Jimenez et al.,
*Practical realtime strategies for accurate indirect occlusion*, 2016) with sectors in place of two horizons (Therrien
et al., *Screen space indirect lighting with visibility bitmask*, 2023), so that light passes behind what is near.
Beyond these: slices go on around the eye, through six views of what the picture does not show, so that a closed room
lets no sky in; and a second depth image tells where things end.
"""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from torchrender.arrays import view
from torchrender.buffers import GBuffer
from torchrender.effects.ambient.lattice import lattice_of, spread
from torchrender.effects.ambient.options import AmbientOptions
from torchrender.effects.ambient.visibility import WHOLE, AmbientVisibility, as_images
from torchrender.errors import InputError
from torchrender.kernels.ambient.horizon import (
    PATTERN,
    SECTORS,
    Points,
    Search,
    Surroundings,
    measure_points,
)
from torchrender.raster import rasterize_visibility
from torchrender.scene.camera import Cameras
from torchrender.scene.mesh import Geometry

JOINED = 10.0
"""Neighbouring steps see one surface if it leans no more than this against the sphere about the eye."""

THICKNESS = 0.15
"""Of surfaces that are seen from behind, in their distance from the eye."""

ORDER = (0, 8, 2, 10, 12, 4, 14, 6, 3, 11, 1, 9, 15, 7, 13, 5)
"""Numbers of the pattern over a tile of 4 x 4: neighbours are far apart."""

FACES = ((1, 2), (2, 1), (2, 0), (0, 2), (0, 1), (1, 0))
"""Axes of columns and rows of the six views; see :class:`Surroundings`."""


def horizon_ambient(
    geometry: Geometry, gbuffer: GBuffer, options: AmbientOptions, *, reach: float, far: bool = True
) -> AmbientVisibility:
    """Visibility (B,H,W) by depth images around each camera's eye.

    Args:
        geometry: what hides.
        gbuffer: what perspective cameras see.
        reach: scene units within which something hides near light.
        far: the search goes on beyond the reach, all around. False: all of its steps lie within, and what is farther
            away counts as open, also for the sky.

    Raises:
        InputError: cameras that are orthographic: they have no eye.
    """
    cameras = gbuffer.cameras
    if cameras.orthographic:
        raise InputError("gbuffer must be of perspective cameras: others have no eye that slices go through")
    shape = gbuffer.depth.shape
    seen = gbuffer.covered.flatten(1).any(dim=1).tolist()
    if not any(seen):  # the sky: nothing around needs to be drawn
        return AmbientVisibility(torch.ones(shape), torch.ones(shape), torch.zeros(*shape, 3))
    pixels = torch.ones(*shape, 5)
    for k in (k for k, some in enumerate(seen) if some):
        around = _surroundings(geometry, cameras[k], gbuffer.depth[k], options)
        _measure(around, gbuffer, k, _search(options, around, reach, far), pixels[k], options.spacing)
    covered = gbuffer.covered
    near = torch.where(covered, pixels[..., 1].clamp(0.0, 1.0), 1.0)
    if not far:
        return AmbientVisibility(near, near, gbuffer.normal)
    sky = torch.where(covered, pixels[..., 0].clamp(0.0, 1.0), 1.0)
    aside = torch.einsum("bij,bhwi->bhwj", cameras.rotation.float(), pixels[..., 2:])
    bent = aside + WHOLE * sky[..., None] * gbuffer.normal
    return as_images(covered, sky[covered], near[covered], bent[covered], gbuffer.normal)


def _measure(around: Surroundings, gbuffer: GBuffer, k: int, search: Search, out: Tensor, spacing: int) -> None:
    """Fill the pixels (H,W,5) of camera ``k``: every few of them searches, and the others follow."""
    grid = lattice_of(gbuffer, k, spacing)
    seen, ray = grid.seen, grid.ray
    tile = torch.tensor(ORDER).reshape(4, 4)
    number = tile[(torch.arange(len(grid.rows)) % 4)[:, None], torch.arange(len(grid.columns)) % 4]
    points = Points(
        view(torch.nn.functional.normalize(ray[seen], dim=-1), np.float32),
        view(grid.position[seen].norm(dim=-1), np.float32),
        view(grid.normal[seen], np.float32),
        view(number[seen], np.int64),
    )
    found = np.zeros((len(points.distance), 5), np.float32)
    measure_points(around, points, _tables(), search, found)
    values = torch.zeros(*seen.shape, 5)
    values[seen] = torch.from_numpy(found)
    spread(gbuffer, k, grid, values, out)


def _surroundings(geometry: Geometry, camera: Cameras, depth: Tensor, options: AmbientOptions) -> Surroundings:
    """Depth images around the eye of one camera."""
    k = camera.intrinsics[0]
    lens = torch.stack([k[0, 0], k[1, 1], k[0, 2], k[1, 2]])
    height, width = depth.shape
    back = torch.full((1, 1), torch.inf)
    cube = [torch.zeros(6, 0, 0), torch.zeros(6, 0, 0)]
    if options.backs:
        small = camera.scaled(1.0 / max(2, options.spacing)) if min(height, width) >= 4 else camera
        back = rasterize_visibility(geometry, small, cull="front").depth[0]
    if options.around:
        six = cube_cameras(camera, options.around)
        cube[0] = rasterize_visibility(geometry, six).depth
        cube[1] = torch.full((6, 1, 1), torch.inf).expand_as(cube[0])
        if options.backs:
            cube[1] = rasterize_visibility(geometry, six, cull="front").depth
    return Surroundings(*(view(v, np.float32) for v in (depth, back, lens, *cube)))


def cube_cameras(camera: Cameras, size: int) -> Cameras:
    """Six views from the eye along the axes of a camera's frame."""
    turns = torch.zeros(6, 4, 4, dtype=torch.float64)
    turns[:, 3, 3] = 1.0
    for face, (right, down) in enumerate(FACES):
        turns[face, 0, right] = turns[face, 1, down] = 1.0
        turns[face, 2, face // 2] = 1.0 - 2.0 * (face % 2)
    half = size / 2
    intrinsics = torch.tensor([[half, 0, half], [0, half, half], [0, 0, 1]], dtype=torch.float64).expand(6, 3, 3)
    near, far = camera.near.expand(6), camera.far.expand(6)
    return Cameras(turns @ camera.camera_from_world, intrinsics, size, size, near, far)


def _search(options: AmbientOptions, around: Surroundings, reach: float, far: bool) -> Search:
    """Steps lie within the angle that the reach takes up, denser beside the point; half of them all around if far."""
    fx, fy = around.lens[:2].tolist()
    place = torch.arange(options.steps)[None] + (torch.arange(PATTERN)[:, None] + 0.5) / PATTERN
    steps = place * ((2.0 if far else 1.0) / options.steps)
    first = min(1.5 / fx, 1.5 / fy)
    return Search(options.slices, view(steps, np.float32), first, reach, JOINED, THICKNESS)


def _tables() -> tuple[np.ndarray, np.ndarray]:
    """Cosine, sine and width of the sectors, and the turn of the slices of each number of the pattern."""
    edge = torch.arange(SECTORS + 1, dtype=torch.float64) / (SECTORS // 2)
    along = 1.0 - edge
    angle = torch.atan2(1.0 - along.abs(), along)
    middle = (angle[1:] + angle[:-1]) / 2
    sectors = torch.stack([middle.cos(), middle.sin(), angle[1:] - angle[:-1]], dim=-1)
    turns = (torch.arange(PATTERN) * 7 % PATTERN + 0.5) / PATTERN
    return view(sectors, np.float32), view(turns, np.float32)
