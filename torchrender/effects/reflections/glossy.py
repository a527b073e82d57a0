"""Neighbouring glossy pixels share their rays: few rays a pixel, turned against those of its neighbours, blurred."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from torchrender.arrays import view
from torchrender.buffers import ReflectionLayer
from torchrender.effects.reflections.reflectors import ReflectivePixels, reflection_layer
from torchrender.kernels.reflections.share import Lobes, share_around

SHARE = 0.35
"""Of a lobe's width: how far the mirrored directions of pixels may differ that share their rays (one deviation)."""

LEAST = 1e-6
"""Widths of lobes below which nothing is shared."""

WIDE = 0.1
"""Alpha of lobes from which on pixels farther apart share, too."""


def share_rays(pixels: ReflectivePixels, color: Tensor) -> Tensor:
    """Colours (N,3) of glossy pixels, averaged with those of the pixels around on the same reflector.

    A neighbour counts by how much of its lobe falls into the pixel's own: what is mirrored is blurred by less than the
    lobe blurs it. Mirrors stay as they are. The rays of neighbours are turned against each other, so nine pixels see as
    much of a lobe as nine times as many rays; of wide lobes the means of nine times nine do.
    """
    if not bool((pixels.gloss > 0).any()):
        return color
    width = SHARE * pixels.gloss.square().float()
    none = torch.full((len(pixels),), torch.inf)
    layer = reflection_layer(pixels, color, none, torch.ones(len(pixels)), pixels.object_id)
    widths = torch.zeros(layer.cluster.numel()).index_copy(0, pixels.pixel, width).reshape(layer.cluster.shape)
    wide = bool((width > SHARE * WIDE).any())
    variables = (color, pixels.gloss, pixels.direction)
    if torch.is_grad_enabled() and any(value.requires_grad for value in variables):
        shared = in_torch(layer, widths, wide)
    else:
        shared = _compiled(layer, widths, wide)
    return shared.reshape(-1, 3)[pixels.pixel]


def _compiled(layer: ReflectionLayer, width: Tensor, wide: bool) -> Tensor:
    """(B,H,W,3) by compiled loops: a tenth of the time of tensors for each of eight neighbours."""
    own, widths = view(layer.color, np.float32), view(width, np.float32)
    direction, reflector = view(layer.direction, np.float32), view(layer.cluster, np.int64)
    for apart, least in ((1, LEAST), (3, SHARE * WIDE))[: 2 if wide else 1]:
        out = np.empty_like(own)
        for k in range(len(out)):
            share_around(Lobes(own[k], direction[k], widths[k], reflector[k]), apart, (least, LEAST), out[k])
        own = out
    return torch.from_numpy(own)


def in_torch(layer: ReflectionLayer, width: Tensor, wide: bool) -> Tensor:
    """The same (B,H,W,3) with gradients.

    Args:
        width: (B,H,W) by which directions may differ that share.
        wide: some share over more than the pixels beside them.
    """
    shared = _around(layer, layer.color, width, 1)
    if wide:
        shared = torch.where((width > SHARE * WIDE)[..., None], _around(layer, shared, width, 3), shared)
    return shared


def _around(layer: ReflectionLayer, color: Tensor, width: Tensor, apart: int) -> Tensor:
    """Weighted means (B,H,W,3) of a pixel's colour and those of the eight that are so many pixels apart from it."""
    total, weight = color.clone(), torch.ones_like(width)
    height, columns = width.shape[1:]
    for dy in (-apart, 0, apart):
        for dx in (-apart, 0, apart):
            if (dy, dx) == (0, 0) or height <= abs(dy) or columns <= abs(dx):
                continue
            here = (slice(None), slice(max(-dy, 0), height - max(dy, 0)), slice(max(-dx, 0), columns - max(dx, 0)))
            there = (slice(None), slice(max(dy, 0), height - max(-dy, 0)), slice(max(dx, 0), columns - max(-dx, 0)))
            between = (layer.direction[here] - layer.direction[there]).square().sum(-1)
            alike = torch.exp(-between / (2.0 * width[here].square()).clamp_min(1e-30))
            shared = (width[here] > LEAST) & (width[there] > LEAST) & (layer.cluster[here] == layer.cluster[there])
            part = torch.where(shared & (layer.state[here] > 0), alike, 0.0)
            weight[here] += part
            total[here] += part[..., None] * color[there]
    return total / weight[..., None]


def mean_distance(lengths: Tensor) -> Tensor:
    """Mean (N,) float32 of the finite ones of (N,K) lengths; +inf where there is none."""
    finite = torch.isfinite(lengths)
    total = torch.where(finite, lengths, 0.0).sum(dim=1)
    return torch.where(finite.any(dim=1), total / finite.sum(dim=1).clamp_min(1), torch.inf).float()
