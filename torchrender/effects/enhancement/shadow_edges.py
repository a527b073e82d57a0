"""Edges of shadows as smooth steps: how visibility changes over the picture.

Source: specification 10, section 3, "Visibility"; the direction cosines themselves are used, not their reciprocals.
"""

from __future__ import annotations

import torch
from torch import Tensor

from torchrender.effects.enhancement.derivatives import row_times, visibility_gradient
from torchrender.effects.enhancement.options import EnhanceOptions
from torchrender.effects.enhancement.surface_image import SurfaceImage

JUMP = 0.05
"""Pixels whose depths differ by more than this share are not of one surface."""

USUAL_SHARPNESS = 1.5
"""Sharpness times the median width of an edge, where none is given: near the strongest response, at 1.543."""

_AROUND = [(j, i) for j in (-1, 0, 1) for i in (-1, 0, 1) if (j, i) != (0, 0)]


def shadow_edges(surface: SurfaceImage, visibility: Tensor, options: EnhanceOptions) -> Tensor:
    """(B,L,H,W,2) float64 derivative of visibility over the picture, steps in focal lengths.

    Args:
        visibility: (B,L,H,W) in [0,1]; half is the edge.
    """
    from kornia.filters import gaussian_blur2d  # a second to import: not for those who do not ask for it

    out = torch.zeros(*visibility.shape, 2, dtype=torch.float64)
    if not visibility.numel():
        return out
    moves = surface.projection(options.grazing)
    for number in range(visibility.shape[1]):
        into, distance = edge_pixels(surface, visibility[:, number])
        for b in range(len(distance)):
            edge = distance[b] != 0
            if not bool(edge.any()):
                continue
            sharpness = options.shadow_sharpness
            if sharpness is None:
                sharpness = USUAL_SHARPNESS / float(2.0 * distance[b][edge].abs().median())
            across = visibility_gradient(into[b][edge], distance[b][edge], distance.new_tensor(sharpness))
            out[b, number][edge] = row_times(across, moves[b][edge])
    if options.shadow_blur > 0:
        flat = out.permute(0, 1, 4, 2, 3).reshape(out.shape[0], -1, *out.shape[2:4])
        size = 2 * int(3.0 * options.shadow_blur + 0.5) + 1
        sigma = (options.shadow_blur, options.shadow_blur)
        flat = gaussian_blur2d(flat, (size, size), sigma, border_type="replicate")
        out = flat.reshape(*out.shape[:2], 2, *out.shape[2:4]).permute(0, 1, 3, 4, 2)
    return out * surface.covered[:, None, ..., None]


def edge_pixels(surface: SurfaceImage, visibility: Tensor) -> tuple[Tensor, Tensor]:
    """Direction into the shadow (B,H,W,3) and signed distance from its edge (B,H,W), 0 where no edge is.

    A lit pixel with shadowed neighbours lies half their distance before the edge (negative), a shadowed one with lit
    neighbours as far behind it.
    """
    lit = visibility > 0.5
    height, width = lit.shape[1:]

    def padded(image: Tensor) -> Tensor:
        pad = (1, 1, 1, 1) if image.dim() == 3 else (0, 0, 1, 1, 1, 1)
        return torch.nn.functional.pad(image, pad)

    lit_around, seen_around = padded(lit), padded(surface.covered)
    depth_around = padded(torch.where(surface.covered, surface.depth, 0.0))
    position_around = padded(surface.position)
    total, count = torch.zeros_like(surface.position), torch.zeros(lit.shape, dtype=torch.float64)
    for j, i in _AROUND:
        window = (slice(None), slice(1 + j, 1 + j + height), slice(1 + i, 1 + i + width))
        other = seen_around[window] & (lit_around[window] != lit)
        other &= (depth_around[window] - surface.depth).abs() <= JUMP * surface.depth
        total += torch.where(other[..., None], position_around[window], 0.0)
        count += other
    found = (count > 0) & surface.covered
    offset = torch.where(found[..., None], total / count.clamp_min(1.0)[..., None] - surface.position, 0.0)
    length = offset.norm(dim=-1)
    found &= length > 0
    sign = torch.where(lit, 1.0, -1.0).double()
    into = sign[..., None] * offset / length.clamp_min(1e-300)[..., None]
    return torch.where(found[..., None], into, 0.0), torch.where(found, -0.5 * sign * length, 0.0)
