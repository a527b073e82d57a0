"""Some pixels of a view, and which: shaded by the passes of a picture, side by side, so that the rest costs nothing."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import torch
from torch import Tensor
from torch.nn.functional import max_pool2d

from torchrender.buffers import GBuffer, RayHits, VisibilityBuffer
from torchrender.pipeline.history import RenderHistory
from torchrender.pipeline.options import RenderOptions
from torchrender.planning.plan import Plan
from torchrender.raster import surface_attributes
from torchrender.renderer import light_of_samples
from torchrender.scene.camera import Cameras
from torchrender.scene.mesh import Geometry
from torchrender.scene.model import Scene
from torchrender.shade import shade
from torchrender.shading.attributes import CastRays, hit_surface
from torchrender.wire.codec import Array

PACKED_WIDTH = 256
BUSY = 16
"""Codes of 255 between neighbours from which a pixel of a smooth picture is shaded in all its places."""
MOST_BUSY, FEW_BUSY = 0.1, 1 << 14
"""Share of the pixels that are, and how many always may be."""
PARTS = ("depth", "triangle", "object_id", "barycentric")
"""Of what cameras see."""
_EMPTY = {"triangle": -1, "object_id": -1, "material": -1, "depth": torch.inf}


@dataclass(frozen=True, eq=False)
class ShadedPixels:
    """Light of N pixels, in the order of the rows of the picture."""

    radiance: Tensor  # (N,3) linear
    plan: Plan | None  # None: there were none
    history: RenderHistory


def shade_pixels(
    scene: Scene, seen: VisibilityBuffer, wanted: Tensor, options: RenderOptions, past: RenderHistory
) -> ShadedPixels:
    """Light of some covered pixels of one eye, all at once: whatever few pixels cost of their own is paid but once.

    Args:
        scene: as it was given to the pictures that left ``past``.
        seen: (B,H,W) of perspective cameras that look from one place into one direction.
        wanted: (B,H,W) bool; pixels that see nothing are left out.
    """
    rows = (wanted & seen.covered).reshape(-1).nonzero()[:, 0]
    if not len(rows):
        return ShadedPixels(torch.zeros(0, 3), None, past)
    made = light_of_samples(scene, _packed(scene.geometry, seen, rows), options, past)
    return ShadedPixels(made.radiance.reshape(-1, 3)[: len(rows)], made.plan, made.history)


def joined(seen: Sequence[VisibilityBuffer]) -> VisibilityBuffer:
    """What several cameras see, as one; of a single one itself."""
    if len(seen) == 1:
        return seen[0]
    parts = {name: torch.cat([getattr(one, name) for one in seen]) for name in PARTS}
    return VisibilityBuffer(Cameras.cat([one.cameras for one in seen]), **parts)


def rays_to(seen: VisibilityBuffer, rows: Tensor) -> tuple[Tensor, Tensor]:
    """Origins and directions (N,3), of depth 1, of rays to flat places (N,) int64, in order, in what B cameras see."""
    cameras = seen.cameras
    size = cameras.width * cameras.height
    found = []
    for k, own in enumerate(rows.split((rows // size).bincount(minlength=len(cameras)).tolist())):
        pixels = torch.stack([own % cameras.width, own % size // cameras.width], dim=-1) + 0.5
        found.append(cameras[k].rays(pixels[None]))
    origins, directions = (torch.cat([value[0] for value in values]) for values in zip(*found, strict=True))
    return origins.contiguous(), directions.contiguous()


def busiest(codes: Array) -> Tensor:
    """(H,W) bool: where displayed colours (H,W,3) uint8 change so much from pixel to pixel that a view moved by a part
    of one shows others; of a busy picture the busiest part."""
    channels = torch.from_numpy(codes).permute(2, 0, 1)[None].float()
    span = (max_pool2d(channels, 3, 1, 1) + max_pool2d(-channels, 3, 1, 1)).amax(dim=1)[0]
    calm = span.numel() - max(FEW_BUSY, int(MOST_BUSY * span.numel()))
    least = float(span.flatten().kthvalue(calm).values) if calm > 0 else 0.0
    return span > max(BUSY, least)


def background_of(scene: Scene, seen: VisibilityBuffer, options: RenderOptions, past: RenderHistory) -> Tensor:
    """(H,W,3) what shows where one camera sees nothing, for all its pixels."""
    lit = past.of_scene(scene).scene or scene
    nothing = torch.full_like(seen.triangle, -1)
    empty = replace(seen, triangle=nothing, object_id=nothing)
    gbuffer = empty if isinstance(empty, GBuffer) else surface_attributes(scene, empty)
    if options.media and scene.media:
        return light_of_samples(scene, gbuffer, options, past).radiance[0]
    return shade(lit, gbuffer, background=options.background)[0]


def only(seen: VisibilityBuffer, kept: Tensor) -> VisibilityBuffer:
    """Without the samples (B,H,W) that are not kept."""
    return VisibilityBuffer(
        cameras=seen.cameras,
        depth=torch.where(kept, seen.depth, torch.inf),
        triangle=torch.where(kept, seen.triangle, -1),
        object_id=torch.where(kept, seen.object_id, -1),
        barycentric=torch.where(kept[..., None], seen.barycentric, 0.0),
    )


def _packed(geometry: Geometry, seen: VisibilityBuffer, rows: Tensor) -> GBuffer:
    """Pixels (N,) int64 of one eye's cameras, all covered, in rows of a small picture whose last one is filled up.

    Their attributes are those of the hits of their rays: the rest of the picture is not looked at.
    """
    count, camera = len(rows), seen.cameras[0]
    height = -(-count // PACKED_WIDTH)
    own = {name: getattr(seen, name).flatten(0, 2)[rows] for name in PARTS}
    origins, directions = rays_to(seen, rows)
    hits = RayHits(own["depth"].double(), own["triangle"], own["barycentric"])
    surface = hit_surface(geometry, CastRays(origins, directions, hits, camera.footprint(hits.t[None])[0]))

    def packed(name: str) -> Tensor | None:
        values = own[name] if name in own else getattr(surface, name)
        if values is None:
            return None
        room = torch.full((height * PACKED_WIDTH, *values.shape[1:]), _EMPTY.get(name, 0), dtype=values.dtype)
        room[:count] = values
        return room.reshape(1, height, PACKED_WIDTH, *values.shape[1:])

    made = {f.name: packed(f.name) for f in fields(GBuffer) if f.name != "cameras"}
    return GBuffer(cameras=camera.sub_camera(0, 0, PACKED_WIDTH, height), **made)  # type: ignore[arg-type]
