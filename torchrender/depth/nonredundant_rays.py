"""Non-redundant depth images by visibility redundancy: rays walk on until they meet something that nobody has seen."""

from __future__ import annotations

import torch
from torch import Tensor

from torchrender.buffers import RayHits
from torchrender.depth.options import SamplingOptions
from torchrender.depth.probes import Probes
from torchrender.depth.ray_visibility import RayVisibility
from torchrender.depth.samples import Samples
from torchrender.raster import rasterize_visibility
from torchrender.scene.camera import Cameras
from torchrender.scene.model import Scene


def visibility_nonredundant(
    scene: Scene, cameras: Cameras, viewpoints: Cameras | None, options: SamplingOptions
) -> Samples:
    """The nearest non-redundant surface in every pixel, by visibility redundancy.

    First hits are rasterised; where they are redundant, rays go on behind them.

    Args:
        viewpoints: what camera i is compared with: the first i of these; None: the cameras themselves.
    """
    found = Samples.room_for(cameras)
    rays = RayVisibility(scene, options) if len(cameras) > 1 else None
    for number in range(len(cameras)):
        first = Samples.first_hits(rasterize_visibility(scene.geometry, cameras[number], cull=options.cull))
        found.put(number, first)
        if number and rays is not None:
            found.put(number, _walk(rays, first, number, cameras if viewpoints is None else viewpoints))
    return found


def _walk(rays: RayVisibility, first: Samples, number: int, viewpoints: Cameras) -> Samples:
    """Replace, in place, the redundant first hits of image ``number`` by what lies behind them."""
    options, camera = rays.options, first.seen.cameras
    probes = Probes.of(first.seen, 0)
    flat = probes.pixels[:, 1] * camera.width + probes.pixels[:, 0]
    origins, directions = (r[0] for r in camera.rays(probes.pixels[None] + 0.5))
    t, triangle = probes.depth.double(), probes.triangle  # directions have camera z 1, so t is depth
    for _ in range(options.max_skips):
        redundant = rays.captured(origins + t[:, None] * directions, triangle, viewpoints, number)
        flat, origins, directions = flat[redundant], origins[redundant], directions[redundant]
        t, triangle = t[redundant], triangle[redundant]
        if not len(flat):
            return first
        first.layer.view(-1)[flat] += 1
        behind = t * (1.0 + options.relative_tolerance) + options.scene_tolerance * rays.diagonal
        hits = rays.next_surface(origins, directions, behind, triangle, float(camera.far[0]))
        _store(first, flat, hits, rays.geometry.object_id)
        hit = hits.hit
        flat, origins, directions = flat[hit], origins[hit], directions[hit]
        # Decided for the depth that is stored, so that a stored sample can be tested again.
        t, triangle = hits.t[hit].float().double(), hits.triangle[hit]
    _store(first, flat, RayHits.misses(len(flat)), rays.geometry.object_id)
    first.truncated.view(-1)[flat] = True
    return first


def _store(samples: Samples, flat: Tensor, hits: RayHits, object_id: Tensor) -> None:
    """Write hits, or emptiness, into the given pixels."""
    seen, hit = samples.seen, hits.hit
    seen.depth.view(-1)[flat] = hits.t.float()
    seen.triangle.view(-1)[flat] = hits.triangle
    seen.object_id.view(-1)[flat] = torch.where(hit, object_id[hits.triangle.clamp_min(0)], -1)
    seen.barycentric.view(-1, 2)[flat] = hits.barycentric
