"""Shading in torch: the twin of the compiled kernel, and the way for derivatives and for samples made by hand."""

from __future__ import annotations

import torch
from torch import Tensor

from torchrender.buffers import GBuffer, RaySurface
from torchrender.scene.model import Scene
from torchrender.shading.lights import Lit, arrival
from torchrender.shading.lobes import Around, Sent, metallic_roughness, phong, unlit
from torchrender.shading.origin import origin_of
from torchrender.shading.sky import Sky
from torchrender.shading.surface import METALLIC, PHONG, UNLIT, Reader, Surface

CHUNK = 1 << 15
"""Points shaded at a time: their intermediate values stay in the processor's cache."""


def send(
    scene: Scene,
    samples: GBuffer | RaySurface,
    visibility: Tensor | None,
    around: Around,
    area_light: str,
) -> Sent:
    """Light of all samples, (3,B*H*W) each, 0 where nothing is seen; ``visibility`` (L,B*H*W), ``around`` of all."""
    rows = samples.covered.reshape(-1).nonzero().reshape(-1)
    count = samples.covered.numel()
    if not len(rows):
        return Sent(*(torch.zeros(3, count) for _ in range(3)))
    reader, sky = Reader(scene, samples, origin_of(scene, samples)), Sky(scene)
    parts = [_chunk(reader, sky, visibility, (around, chunk), area_light) for chunk in rows.split(CHUNK)]

    def whole(name: str) -> Tensor:
        value = torch.cat([getattr(part, name) for part in parts], dim=1)
        return torch.zeros(3, count).index_copy(1, rows, value)

    return Sent(whole("radiance"), whole("replaced"), whole("mirrored"))


def _chunk(reader: Reader, sky: Sky, visibility: Tensor | None, place: tuple[Around, Tensor], area_light: str) -> Sent:
    """Light of the samples in some flat rows."""
    around, rows = place
    surface = reader.surface(rows)
    near = Around(*(None if value is None else value[..., rows] for value in around))
    lights = []
    for number, light in enumerate(reader.scene.lights):
        found = arrival(light, surface, reader.origin, area_light)
        lights.append(Lit(found, None if visibility is None else visibility[number, rows]))
    kinds = torch.bincount(surface.kind, minlength=3).nonzero().reshape(-1).tolist()
    if kinds == [PHONG]:
        return phong(surface, sky, near, lights)
    if kinds == [METALLIC]:
        return metallic_roughness(surface, sky, near, lights)
    return _mixed(surface, sky, near, lights)


def _mixed(surface: Surface, sky: Sky, around: Around, lights: list[Lit]) -> Sent:
    """Of points of several kinds of material."""
    whole = [torch.zeros_like(surface.base) for _ in range(3)]
    for kind in (PHONG, METALLIC, UNLIT):
        rows = (surface.kind == kind).nonzero().reshape(-1)
        if not len(rows):
            continue
        part = surface.select(rows)
        near = Around(*(None if value is None else value[..., rows] for value in around))
        some = [one.select(rows) for one in lights]
        if kind == UNLIT:
            sent = unlit(part)
        else:
            sent = (phong if kind == PHONG else metallic_roughness)(part, sky, near, some)
        values = (sent.radiance, sent.replaced, sent.mirrored)
        whole = [image.index_copy(1, rows, value) for image, value in zip(whole, values)]
    return Sent(*whole)
