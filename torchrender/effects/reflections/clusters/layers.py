"""Images with several layers for the curved clusters of a picture, drawn and asked together.

Beyond the thesis, whose one layer hides from a cluster's camera what its rays see behind the rim of something nearer:
that is most of the occlusion error of curved reflectors.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from torchrender.arrays import view
from torchrender.buffers import RayHits
from torchrender.effects.reflections.clusters.bundle import ClusterCameras
from torchrender.effects.reflections.clusters.images import ClusterAnswer
from torchrender.effects.reflections.reflectors import ReflectedRays, ReflectivePixels
from torchrender.kernels.reflections.layer_draw import Boxes, Layers, LayerViews, Seen, draw_layers
from torchrender.kernels.reflections.layer_march import GROUP, march_clusters, mark_blocks
from torchrender.rays import holes_of
from torchrender.scene.mesh import Geometry

TEXELS = 1 << 21
"""Texels that are drawn at a time: bounds the memory of their layers."""

BLOCK = 2
"""Texels a side of the blocks in which it is noted whether a ray passes."""

Sent = tuple[ReflectedRays, Tensor, tuple[Tensor, Tensor]]
"""Rays, the place of each one's cluster among those drawn together, and where it starts and ends."""


@dataclass(frozen=True, eq=False)
class LayerImages:
    """The layers that the cameras of some clusters see where rays pass."""

    geometry: Geometry
    views: LayerViews
    layers: Layers

    def ask(self, sent: Sent) -> ClusterAnswer:
        """The first hits of N rays."""
        rays, image, ends = sent
        count = len(rays.origin)
        state, t = np.empty(count, np.uint8), np.empty(count)
        triangle, weights = np.empty(count, np.int64), np.empty((count, 2), np.float32)
        steps = np.zeros(-(-count // GROUP) + 1, np.int64)
        found = (state, t, triangle, weights, steps)
        scene, holes = _scene(self.geometry), holes_of(self.geometry)
        march_clusters(scene, holes, self.views, self.layers, _rays(rays, image), _ends(ends), found)
        hits = RayHits(torch.from_numpy(t), torch.from_numpy(triangle), torch.from_numpy(weights))
        return ClusterAnswer(torch.from_numpy(state), hits, int(steps.sum()))


def batches(made: ClusterCameras, numbers: Tensor, rays_per_pixel: int, most: int) -> list[Tensor]:
    """Clusters ``numbers`` (C,) in groups that memory holds at a time: by texels, and by ``most`` rays."""
    share = made.size[numbers].prod(dim=1) / TEXELS + made.clusters.sizes[numbers] * (rays_per_pixel / most)
    batch = torch.cumsum(share, 0).long()
    return [numbers[batch == b] for b in batch.unique()]


def draw_images(
    geometry: Geometry,
    pixels: ReflectivePixels,
    made: ClusterCameras,
    numbers: Tensor,
    sent: Sequence[Sent],
    layers: int,
) -> LayerImages:
    """Draw what the cameras of clusters ``numbers`` (C,) see where the rays pass."""
    size = made.size[numbers]
    texels = size.prod(dim=1)
    total = int(texels.sum())
    views = LayerViews(
        view(made.eye[numbers], np.float64),
        view(made.look[numbers], np.float64),
        view(made.box[numbers], np.float64),
        view(size, np.int64),
        view(made.near[numbers], np.float64),
        view(torch.cumsum(texels, 0) - texels, np.int64),
    )
    blocks = ((size + BLOCK - 1) // BLOCK).prod(dim=1)
    places = view(torch.cumsum(blocks, 0) - blocks, np.int64)
    marked = np.zeros(int(blocks.sum()), np.uint8)
    for rays, image, ends in sent:
        mark_blocks(views, (BLOCK, places), marked, _rays(rays, image), _ends(ends))
    members = [made.clusters.members(int(n)) for n in numbers]
    starts = np.cumsum([0, *(len(m) for m in members)])
    seen = Seen(starts.astype(np.int64), view(torch.cat(members), np.int64), view(pixels.position, np.float64))
    found = Layers(np.full((total, layers), np.inf, np.float32), np.full((total, layers), -1, np.int32))
    boxes = Boxes(
        view(geometry.order, np.int32), view(geometry.clusters, np.int64), view(geometry.cluster_bounds, np.float64)
    )
    room = (np.empty(total, np.float32), np.empty(total, np.float32))
    draw_layers(_scene(geometry), holes_of(geometry), boxes, views, seen, (BLOCK, places, marked), room, found)
    return LayerImages(geometry, views, found)


def _scene(geometry: Geometry) -> tuple[np.ndarray, np.ndarray]:
    return view(geometry.vertices, np.float64), view(geometry.faces, np.int32)


def _rays(rays: ReflectedRays, image: Tensor) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    return view(rays.origin, np.float64), view(rays.direction, np.float64), view(image, np.int64)


def _ends(ends: tuple[Tensor, Tensor]) -> tuple[np.ndarray, np.ndarray]:
    return view(ends[0], np.float64), view(ends[1], np.float64)
