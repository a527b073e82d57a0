"""Which objects touch, and how much neighbouring materials differ."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from scipy.spatial import cKDTree
from torch import Tensor

from torchrender.photo.style.objects import StyleObjects
from torchrender.photo.style.views import object_boxes
from torchrender.scene.model import Scene

NEAR_SHARE = 0.01
"""Objects that come within this share of the scene's diagonal are neighbours."""
_FEWEST, _MOST = 200, 20_000  # sample points of one object
_WEAK = 0.05  # k_s below which the exponent counts less


def adjacency(scene: Scene, objects: StyleObjects, seed: int = 0) -> Tensor:
    """(m,m) bool symmetric, False on the diagonal: surfaces that come within 1 % of the scene's diagonal.

    Surfaces are sampled at about half that distance, and searched by a k-d tree.
    """
    reach = NEAR_SHARE * scene.diagonal
    rng = np.random.default_rng(seed)
    boxes = object_boxes(scene, objects).numpy()
    points = [_samples(scene, numbers, reach, rng) for numbers in objects.meshes]
    trees = [cKDTree(p) for p in points]
    near = torch.zeros(len(objects), len(objects), dtype=torch.bool)
    for i in range(len(objects)):
        low, high = boxes[i, 0] - reach, boxes[i, 1] + reach
        close = ((boxes[:, 0] <= high) & (boxes[:, 1] >= low)).all(axis=1)
        for k in np.flatnonzero(close):
            if k <= i:
                continue
            small, large = (i, int(k)) if len(points[i]) <= len(points[k]) else (int(k), i)
            distance, _ = trees[large].query(points[small], distance_upper_bound=reach)
            if bool(np.isfinite(distance).any()):
                near[i, k] = near[k, i] = True
    return near


def _samples(scene: Scene, numbers: tuple[int, ...], reach: float, rng: np.random.Generator) -> np.ndarray:
    """Points on the surface of an object: its corners (some of many) and random ones by area."""
    corners = []
    for number in numbers:
        mesh = scene.meshes[number]
        corners.append(mesh.vertices.double().numpy()[mesh.faces.numpy()])
    triangles = np.concatenate(corners)
    a, ab, ac = triangles[:, 0], triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
    area = np.linalg.norm(np.cross(ab, ac), axis=1) / 2
    total = float(area.sum())
    wanted = int(min(max(total / max(reach / 2, 1e-300) ** 2, _FEWEST), _MOST))
    points = triangles.reshape(-1, 3)
    points = points[:: max(1, len(points) // _MOST)]
    if not total > 0:
        return points
    chosen = rng.choice(len(area), wanted, p=area / total)
    u, v = rng.random((2, wanted, 1))
    over = u + v > 1
    u, v = np.where(over, 1 - u, u), np.where(over, 1 - v, v)
    return np.concatenate([points, a[chosen] + u * ab[chosen] + v * ac[chosen]])


def features(materials: Tensor) -> Tensor:
    """(..., 8|10) numbers that smoothness compares: the exponent over 100, less where there is hardly a highlight."""
    weight = (materials[..., 6:-1].amax(dim=-1) / _WEAK).clamp(max=1.0)
    return torch.cat([materials[..., :-1], (materials[..., -1] / 100.0 * weight)[..., None]], dim=-1)


@dataclass(frozen=True, eq=False)
class Smoothness:
    """``sum_i ||sum_t (k_i - k_t)||`` ("laplacian") or ``sum_i sum_t ||k_i - k_t||`` ("tv") over neighbours t of i."""

    features: np.ndarray  # (m,C,F) float64
    near: np.ndarray  # (m,m) float64, 1 for neighbours
    kind: str

    @classmethod
    def of(cls, materials: Tensor, near: Tensor, kind: str) -> Smoothness:
        return cls(features(materials).numpy(), near.double().numpy(), kind)

    def total(self, choice: np.ndarray) -> float:
        """Of one choice (m,) of candidates."""
        return float(self.totals(choice[None])[0])

    def totals(self, choices: np.ndarray) -> np.ndarray:
        """(B,) of many choices (B,m)."""
        k = self.features[np.arange(choices.shape[1]), choices]  # (B,m,F)
        if self.kind == "laplacian":
            gradient = self.near.sum(axis=1)[:, None] * k - self.near @ k
            return np.linalg.norm(gradient, axis=2).sum(axis=1)
        first, second = np.nonzero(self.near)
        return np.linalg.norm(k[:, first] - k[:, second], axis=2).sum(axis=1)

    def moves(self, choice: np.ndarray) -> np.ndarray:
        """(m,C) how much the total changes if one object takes another candidate."""
        count = len(choice)
        k = self.features[np.arange(count), choice]
        step = self.features - k[:, None]  # (m,C,F)
        degree = self.near.sum(axis=1)
        out = np.zeros(self.features.shape[:2])
        first, second = np.nonzero(self.near)
        if self.kind == "tv":
            moved = np.linalg.norm(self.features[first] - k[second][:, None], axis=2)
            before = np.linalg.norm(k[first] - k[second], axis=1)
            np.add.at(out, first, 2.0 * (moved - before[:, None]))
            return out
        gradient = degree[:, None] * k - self.near @ k
        out += np.linalg.norm(gradient[:, None] + degree[:, None, None] * step, axis=2)
        out -= np.linalg.norm(gradient, axis=1)[:, None]
        changed = np.linalg.norm(gradient[second][:, None] - step[first], axis=2)
        np.add.at(out, first, changed - np.linalg.norm(gradient[second], axis=1)[:, None])
        return out
