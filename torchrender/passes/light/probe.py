"""A probe of direct light: a few pixels shaded at two settings, beside each other.

What the picture would lose by the cheaper one is measured, not guessed from what is seen.
"""

from __future__ import annotations

import torch
from torch import Tensor

from torchrender.buffers import GBuffer, RayHits, RaySurface
from torchrender.passes.senses import closely, difference, few
from torchrender.pipeline.frame import Frame
from torchrender.scene.light import RectLight
from torchrender.shade import AmbientReach, sent_light
from torchrender.shading.attributes import CastRays, hit_surface

SIDE = 48
"""Pixels along each side, at most."""

MOST_LIGHTS = 16
"""With more, a few pixels shaded by all of them take too long."""


def probe(
    frame: Frame, gbuffer: GBuffer, visibility: Tensor | None, around: AmbientReach | None, radiance: Tensor
) -> dict[str, float]:
    """Mean differences of display values, by pass; of the whole picture, which is exposed as ``radiance``.

    Args:
        visibility: (B,L,H,W) of all lights; None: nothing hides any.
    """
    lights = frame.scene.lights
    rows, part = few_rows(gbuffer)
    if not lights or len(lights) > MOST_LIGHTS or not len(rows):
        return {}
    surface = surface_of(frame, gbuffer, rows).image
    reach = None if around is None else _reach(around, rows)

    def shaded(shadows: Tensor | None, area_light: str = "polygon") -> Tensor:
        return sent_light(
            frame.scene, surface, shadows, area_light=area_light, around=reach, mirrors=False
        ).radiance  # fmt: skip

    def changed(shadows: Tensor | None, area_light: str = "polygon") -> float:
        return part * difference(frame, usual, shaded(shadows, area_light), radiance)

    found = {}
    here = None if visibility is None else _rows_of(visibility, rows)
    usual = shaded(here)
    areas = [n for n, light in enumerate(lights) if isinstance(light, RectLight)]
    points = [n for n in range(len(lights)) if n not in areas]
    if areas:
        found[closely("direct_light")] = changed(here, "centre")
    if visibility is None or here is None:
        return found
    if points:  # borders of shadows in the next pixel
        moved = here.clone()
        moved[:, points] = _rows_of(visibility.roll((1, 1), (2, 3)), rows)[:, points]
        moved_by = changed(moved) * frame.options.supersample
        found[closely("point_shadow")] = found[closely("shadow_map")] = moved_by
    if areas and frame.options.area_shadows != "hard":  # shadows without penumbrae, where there are some
        hard = here.clone()
        hard[:, areas] = (hard[:, areas] > 0.5).to(hard.dtype)
        found[closely("soft_shadow")] = changed(hard)
        found.setdefault(closely("shadow_map"), found[closely("soft_shadow")])
    return found


def few_rows(gbuffer: GBuffer) -> tuple[Tensor, float]:
    """Rows (N,) of a few covered pixels of a G-buffer (B,H,W), and the share of the picture that is covered."""
    places = torch.arange(gbuffer.covered.numel()).reshape(gbuffer.covered.shape)
    covered = few(gbuffer.covered, SIDE)
    return few(places, SIDE)[covered], float(covered.float().mean())


def surface_of(frame: Frame, gbuffer: GBuffer, rows: Tensor) -> RaySurface:
    """What a few pixels see, as hits of rays from the eye."""
    cameras, geometry = gbuffer.cameras, frame.scene.geometry
    image = rows // (gbuffer.covered[0].numel())
    position, depth = gbuffer.position.reshape(-1, 3)[rows], gbuffer.depth.reshape(-1)[rows].double()
    forward = cameras.forward.double()[image]
    origins = position - depth[:, None] * forward if cameras.orthographic else cameras.eye.double()[image]
    hits = RayHits(
        t=torch.ones(len(rows), dtype=torch.float64),
        triangle=gbuffer.triangle.reshape(-1)[rows],
        barycentric=gbuffer.barycentric.reshape(-1, 2)[rows],
    )
    width = cameras.footprint(gbuffer.depth.double()).reshape(-1)[rows]
    return hit_surface(geometry, CastRays(origins=origins, directions=position - origins, hits=hits, width=width))


def _reach(around: AmbientReach, rows: Tensor) -> AmbientReach:
    bent = around.bent_normal
    return AmbientReach(
        around.visibility.reshape(-1)[rows][None, None],
        None if bent is None else bent.reshape(-1, 3)[rows][None, None],
    )


def _rows_of(visibility: Tensor, rows: Tensor) -> Tensor:
    """(1,L,1,N) of images (B,L,H,W)."""
    return visibility.transpose(0, 1).flatten(1)[:, rows][None, :, None]
