"""Spheres that follow a mesh as it bends. Source: specification 08, section 4, "animation"."""

from __future__ import annotations

import torch
from torch import Tensor

from torchrender.checks import check_tensor
from torchrender.effects.sky_shadows.fit import SphereSet

FEWEST = 4
"""Vertices that a sphere follows at least; one with fewer of its own follows the nearest ones as well."""

LEAST_SNUG = 0.75
"""Share of its radius that a snug sphere keeps at least."""


class Binding:
    """What a set of spheres follows."""

    def __init__(self, spheres: SphereSet, vertices: Tensor, faces: Tensor) -> None:
        """Bind a set to the mesh (V,3), (F,3) in the pose that it was fitted to."""
        check_tensor("vertices", vertices, (len(spheres.vertex_sphere), 3))
        self.set = spheres
        rest = vertices.detach().double()
        count = len(spheres.centres)
        used = torch.zeros(len(rest), dtype=torch.bool)
        used[faces.reshape(-1).long()] = True
        rows, labels = [used.nonzero().reshape(-1)], [spheres.vertex_sphere[used]]
        number = torch.bincount(labels[0], minlength=count)
        for k in (number < FEWEST).nonzero().reshape(-1).tolist():
            distance = (rest - spheres.centres[k]).square().sum(-1)
            distance[~used] = torch.inf
            near = distance.topk(min(FEWEST, int(used.sum())), largest=False).indices
            rows.append(near)
            labels.append(torch.full_like(near, k))
        self.rows, self.labels = torch.cat(rows), torch.cat(labels)
        self.faces = faces.long()
        self.number = torch.bincount(self.labels, minlength=count).clamp_min(1).double()
        self.middle = self._means(rest[self.rows])
        self.arms = rest[self.rows] - self.middle[self.labels]
        self.offset = spheres.centres - self.middle
        self.own = len(rows[0])

    def _means(self, values: Tensor) -> Tensor:
        return _sums(values, self.labels, len(self.set.centres)) / self.number[:, None]

    def at(self, vertices: Tensor, *, snug: bool = False) -> Tensor:
        """Spheres (S,4) float64 for the mesh's vertices (V,3) in another pose.

        They cover the mesh; ``snug`` ones are smaller, so that what stands out of it makes up for what they leave out.

        A centre moves as its cluster does: the rotation between the two poses that fits best, and the mean. A radius is
        the distance to the cluster's farthest point now; what lies inside the mesh keeps its distance.
        """
        check_tensor("vertices", vertices, (len(self.set.vertex_sphere), 3))
        now = vertices.detach().double()
        middle = self._means(now[self.rows])
        arms = now[self.rows] - middle[self.labels]
        count = len(self.set.centres)
        both = (arms[:, :, None] * self.arms[:, None, :]).reshape(-1, 9)
        turned = _rotations(_sums(both, self.labels, count).reshape(-1, 3, 3))
        size = _sums(arms.square().sum(-1, keepdim=True), self.labels, count)[:, 0]
        was = _sums(self.arms.square().sum(-1, keepdim=True), self.labels, count)[:, 0]
        scale = torch.where(was > 0, (size / was.clamp_min(1e-300)).sqrt(), 1.0)
        centres = middle + (turned @ self.offset[:, :, None])[:, :, 0] * scale[:, None]
        radii = self.set.inner_radii * scale
        mine = slice(0, self.own)
        radii = _farthest(radii, now[self.rows[mine]], centres, self.labels[mine])
        radii = _farthest(radii, now[self.faces].mean(dim=1), centres, self.set.face_sphere)
        if snug:
            radii = torch.maximum(radii - self.set.margin * scale, LEAST_SNUG * radii)
        return torch.cat([centres, radii[:, None]], dim=1)


def _sums(values: Tensor, labels: Tensor, count: int) -> Tensor:
    return torch.zeros(count, values.shape[1], dtype=torch.float64).index_add_(0, labels, values)


def _farthest(radii: Tensor, points: Tensor, centres: Tensor, labels: Tensor) -> Tensor:
    distance = (points - centres[labels]).norm(dim=-1)
    return radii.scatter_reduce(0, labels, distance, "amax")


def _rotations(products: Tensor) -> Tensor:
    """(S,3,3) that turn arms in rest to what they are now, of sums (S,3,3) of their outer products (Kabsch)."""
    u, _, v = torch.linalg.svd(products)
    flip = torch.det(u @ v)
    u = torch.cat([u[:, :, :2], u[:, :, 2:] * torch.where(flip < 0, -1.0, 1.0)[:, None, None]], dim=2)
    return u @ v
