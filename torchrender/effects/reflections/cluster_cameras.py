"""A pinhole camera for each cluster of reflective pixels, that sees about what their reflected rays see.

Specification 03, section 6. Planar clusters need no such camera: their rays all come from the mirrored eye. Curved ones
look along the normal of their fitting plane. The centre of projection is the mirrored eye drawn towards the reflector
(thesis), or the point nearest to all rays (least squares, specification 03, section 12.1); "best" takes for each
cluster the one whose camera rays deviate least from the reflected rays.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import torch
from torch import Tensor

from torchrender.arrays import view
from torchrender.effects.reflections.pixel_clusters import PixelClusters, split
from torchrender.effects.reflections.reflectors import ReflectivePixels
from torchrender.kernels.reflections import cluster_fit

AIMS = ("rays", "normal")
CENTRES = ("best", "thesis", "least_squares")
SHIFT_RANGE = (0.05, 8.0)
STEEPEST = math.cos(math.radians(80.0))  # smaller cosines to the fitting plane's normal do not count for the shift
HALF_ANGLE_DEG = 75.0
SIDES = (8, 2048)
FLAT_RESIDUAL = 1e-3  # of the extent
FLAT_COSINE = math.cos(math.radians(0.1))
SPREAD_NORMALS = 0.2  # mean normals shorter than this belong to clusters that face everywhere
SPLITS = 2
TEXELS_PER_PIXEL = (4.0, 16.0)  # fewer lose what rays could see, more than rays can tell apart would be wasted
MIN_TEXELS = 64.0**2
NO_CONDITION = 1e8

Array = np.ndarray[Any, Any]


@dataclass(frozen=True, eq=False)
class ClusterCameras:
    """C cameras, one per cluster. Planar clusters hold only ``eye``, ``frame`` and ``planar``."""

    clusters: PixelClusters
    frame: Tensor  # (C,4,3) float64: centre of the fitting plane, its right and down axes, its normal
    look: Tensor  # (C,3,3) right and down axis of the image, and view axis
    planar: Tensor  # (C,) bool: rays come from the mirrored eye, exactly
    usable: Tensor  # (C,) bool: False where the eye lies in the reflector's plane
    eye: Tensor  # (C,3) float64 centre of projection
    shift: Tensor  # (C,) factor that draws the mirrored eye to the plane; 1 for planar ones
    reach: Tensor  # (C,) distance of the far plane from the fitting plane
    near: Tensor  # (C,) camera depth
    relief: Tensor  # (C,) largest height of its pixels above or below the fitting plane
    box: Tensor  # (C,4) low x, low y, high x, high y of the image, in tangents
    size: Tensor  # (C,2) int64 width and height in pixels
    outside: Tensor  # (C,) rays beyond the half angle
    pixel_box: Tensor  # (C,4) int64 first column, first row, last column, last row of its pixels in the pictures

    def __len__(self) -> int:
        return len(self.planar)


@dataclass(frozen=True, eq=False)
class _Bundle:
    """The rays of all clusters as the kernels read them."""

    clusters: PixelClusters
    rays: tuple[Array, ...]  # position, normal, direction
    origin: Tensor  # (3,) reference of the positions
    chunks: Array
    owner: Array
    order: Array

    @classmethod
    def of(cls, pixels: ReflectivePixels, clusters: PixelClusters) -> _Bundle:
        origin = pixels.position.mean(dim=0)
        rays = (pixels.position - origin, pixels.normal, pixels.direction)
        return cls(
            clusters, tuple(view(r, np.float64) for r in rays), origin, *clusters.chunks(), clusters.order.numpy()
        )

    def regroup(self, clusters: PixelClusters) -> _Bundle:
        chunks, owner = clusters.chunks()
        return replace(self, clusters=clusters, chunks=chunks, owner=owner, order=clusters.order.numpy())

    def gather(self, kernel: Any, arguments: tuple[Any, ...], columns: str, skip: Tensor | None = None) -> Tensor:
        """Run a chunk kernel and join its columns per cluster: "+" added up, "<" smallest, ">" largest.

        Clusters to ``skip`` (C,) get zeros, and cost nothing.
        """
        chosen = np.arange(len(self.chunks)) if skip is None else np.flatnonzero(~skip.numpy()[self.owner])
        joined = np.zeros((len(self.clusters), len(columns)))
        if not len(chosen):
            return torch.from_numpy(joined)
        owner = self.owner[chosen]
        out = np.zeros((len(chosen), len(columns)))
        kernel(cluster_fit.Bundle(self.chunks[chosen], owner, self.order, *self.rays), *arguments, out)
        first = np.flatnonzero(np.concatenate([[True], owner[1:] != owner[:-1]]))
        for sign, join in (("+", np.add), ("<", np.minimum), (">", np.maximum)):
            own = [k for k, c in enumerate(columns) if c == sign]
            if own:
                joined[np.ix_(owner[first], np.array(own))] = join.reduceat(out[:, own], first, axis=0)
        return torch.from_numpy(joined)


def build_cluster_cameras(
    pixels: ReflectivePixels,
    clusters: PixelClusters,
    diagonal: float,
    *,
    centre: str = "best",
    scale: float = 1.0,
    shorten: bool = True,
    aim: str = "rays",
) -> ClusterCameras:
    """Cameras of all clusters. Clusters that face everywhere, or whose rays cross before the mirror, are split.

    Args:
        diagonal: of the scene's bounding box; rays are followed that far.
        centre: "thesis", "least_squares", or "best".
        scale: of the image sides.
        shorten: bring the far plane of glossy clusters nearer.
        aim: view axis: "normal" of the fitting plane (thesis), or the mean direction of the "rays", which at grazing
            angles lie far off the normal.
    """
    bundle = _Bundle.of(pixels, clusters)
    for attempt in range(SPLITS + 1):
        made, side = _fit(pixels, bundle, diagonal, centre, shorten, aim)
        if attempt == SPLITS or not bool(side.any()):
            break
        bundle = bundle.regroup(split(bundle.clusters, _sides(bundle, made, side)))
    return _images(pixels, bundle, made, diagonal, scale)


def _sides(bundle: _Bundle, made: ClusterCameras, chosen: Tensor) -> Tensor:
    """(N,) 0 or 1: in the chosen clusters (1 by place, 2 by normal, 3 by height), the side of the fitting plane's
    centre along the widest direction."""
    cluster = bundle.clusters.cluster
    offset = torch.from_numpy(bundle.rays[0]) + bundle.origin - made.frame[cluster, 0]
    normal = torch.from_numpy(bundle.rays[1])
    # Where normals point everywhere, part them by direction, else by place.
    value = torch.where((chosen[cluster] == 2)[:, None], normal, offset)
    spread = torch.zeros(len(made), 3, dtype=torch.float64).index_add(0, cluster, value.square())
    along = value.gather(1, spread.argmax(dim=1)[cluster][:, None])[:, 0]
    along = torch.where(chosen[cluster] == 3, (offset * made.frame[cluster, 3]).sum(-1), along)
    return torch.where(chosen[cluster] > 0, along > 0, False).long()


def _fit(
    pixels: ReflectivePixels, bundle: _Bundle, diagonal: float, centre: str, shorten: bool, aim: str
) -> tuple[ClusterCameras, Tensor]:
    """Frames and centres; and (C,) 0 where a cluster may stay, else how it must be split (see ``_sides``)."""
    width = pixels.shape[2]
    column, row = pixels.pixel % width, pixels.pixel // width % pixels.shape[1]
    places = (view(column, np.float64), view(row, np.float64))
    sums = bundle.gather(cluster_fit.moments, places, "+" * cluster_fit.SUMS + "<<>>")
    count = sums[:, :1]
    middle, facing = sums[:, 1:4] / count, sums[:, 4:7] / count
    axis = torch.nn.functional.normalize(facing, dim=-1, eps=1e-300)
    spread = bundle.gather(
        cluster_fit.plane_spread,
        (middle.numpy(), axis.numpy()),
        ">>>>",
    )
    extent = spread[:, 3].sqrt()
    residual = torch.maximum(spread[:, 0], spread[:, 1])
    planar = (residual <= FLAT_RESIDUAL * extent) & (-spread[:, 2] > FLAT_COSINE)
    gloss = torch.zeros(len(count), dtype=torch.float64)
    gloss = gloss.scatter_reduce(0, bundle.clusters.cluster, pixels.gloss, "amax")
    planar &= gloss <= 0
    reach = diagonal * (1.0 - gloss * shorten).clamp_min(0.05)
    eye = _eyes(pixels, bundle, diagonal) - bundle.origin
    height = ((eye - middle) * axis).sum(-1)
    mirrored = eye - 2.0 * height[:, None] * axis
    frame = torch.stack([middle, *_image_axes(pixels, bundle, axis), axis], dim=1)
    boxes = _eye_boxes(bundle, frame, mirrored, reach, diagonal, planar)
    shift, crossing = _shift(boxes)
    shift = torch.where(planar, 1.0, shift)
    chosen = _centre(bundle, centre, frame, mirrored, shift, sums, planar)
    chosen = torch.where(planar[:, None], mirrored, chosen)
    toward = sums[:, 7:10] / count
    many = count[:, 0] > 1
    side = (many & crossing & ~planar).long()
    side = torch.where(many & (facing.norm(dim=-1) < SPREAD_NORMALS), 2, side)
    side = torch.where(many & (-spread[:, 2] > FLAT_COSINE) & (residual > FLAT_RESIDUAL * extent), 3, side)
    clear = ((middle - chosen) * axis).sum(-1)
    frame[:, 0] += bundle.origin
    straight = (toward.norm(dim=-1, keepdim=True) > SPREAD_NORMALS) & (aim == "rays")
    view_axis = torch.where(straight, torch.nn.functional.normalize(toward, dim=-1, eps=1e-300), axis)
    made = ClusterCameras(
        clusters=bundle.clusters,
        frame=frame,
        look=torch.stack([*_image_axes(pixels, bundle, view_axis), view_axis], dim=1),
        planar=planar,
        usable=(clear > 1e-4 * diagonal) & (height > 1e-4 * diagonal),
        eye=chosen + bundle.origin,
        shift=shift,
        reach=reach,
        near=torch.zeros(len(count), dtype=torch.float64),
        relief=residual,
        box=torch.zeros(len(count), 4, dtype=torch.float64),
        size=torch.ones(len(count), 2, dtype=torch.int64),
        outside=torch.zeros(len(count), dtype=torch.float64),
        pixel_box=sums[:, cluster_fit.SUMS :].long(),
    )
    return made, side


def _eyes(pixels: ReflectivePixels, bundle: _Bundle, diagonal: float) -> Tensor:
    """(C,3) eye that sees each cluster; for parallel projection a very far one."""
    cameras = pixels.cameras
    some = bundle.clusters.order[bundle.clusters.starts[:-1]]
    camera = pixels.pixel[some] // (pixels.shape[1] * pixels.shape[2])
    if cameras.orthographic:
        return pixels.position[some] - 1e3 * diagonal * cameras.forward[camera]
    return cameras.eye[camera]


def _image_axes(pixels: ReflectivePixels, bundle: _Bundle, axis: Tensor) -> tuple[Tensor, Tensor]:
    """Right and down axes (C,3) of images that look along ``axis``, turned like the eye's picture."""
    some = bundle.clusters.order[bundle.clusters.starts[:-1]]
    camera = pixels.pixel[some] // (pixels.shape[1] * pixels.shape[2])
    rotation = torch.nn.functional.normalize(pixels.cameras.rotation[camera], dim=-1)
    flat = rotation - (rotation * axis[:, None]).sum(-1, keepdim=True) * axis[:, None]
    degenerate = flat[:, :1].norm(dim=-1, keepdim=True) < 1e-6
    right = torch.nn.functional.normalize(torch.where(degenerate, flat[:, 1:2], flat[:, :1])[:, 0], dim=-1, eps=1e-300)
    return right, torch.linalg.cross(axis, right)


def _eye_boxes(
    bundle: _Bundle, frame: Tensor, mirrored: Tensor, reach: Tensor, diagonal: float, skip: Tensor
) -> Tensor:
    limits = torch.cat(
        [mirrored, reach[:, None], torch.tensor([[diagonal, STEEPEST]], dtype=torch.float64).expand(len(reach), 2)], 1
    )
    arguments = (view(frame, np.float64), view(limits, np.float64))
    return bundle.gather(cluster_fit.eye_boxes, arguments, "<<>><<>>" + "+" * 7, skip)


def _shift(boxes: Tensor) -> tuple[Tensor, Tensor]:
    """Factor f = d_n / d_f of the box diagonals, and whether the bundle crosses before the mirror."""
    near, far = ((boxes[:, k + 2 : k + 4] - boxes[:, k : k + 2]) for k in (0, 4))
    count = boxes[:, 8].clamp_min(1.0)
    start, end = boxes[:, 9:11], boxes[:, 11:13]
    together = boxes[:, 13] - (start * end).sum(-1) / count
    spread = (boxes[:, 14] - start.square().sum(-1) / count).clamp_min(0.0)
    f = near.norm(dim=-1) / far.norm(dim=-1)
    crossing = (together < -1e-9 * spread) & (boxes[:, 8] > 1)
    f = torch.where(crossing, SHIFT_RANGE[1], torch.where(torch.isfinite(f), f, 1.0))
    return f.clamp(*SHIFT_RANGE), crossing


def _centre(
    bundle: _Bundle, centre: str, frame: Tensor, mirrored: Tensor, shift: Tensor, sums: Tensor, skip: Tensor
) -> Tensor:
    """(C,3) centres of projection, about the bundle's origin."""
    thesis = frame[:, 0] + shift[:, None] * (mirrored - frame[:, 0])
    if centre == "thesis":
        return thesis
    nearest, sound = _nearest_point(sums, frame)
    nearest = torch.where(sound[:, None], nearest, thesis)
    if centre == "least_squares":
        return nearest
    eyes = torch.stack([thesis, nearest, mirrored], dim=1).contiguous()
    deviation = bundle.gather(cluster_fit.ray_deviation, (eyes.numpy(),), "+++", skip)
    return eyes[torch.arange(len(eyes)), deviation.argmin(dim=1)]


def _nearest_point(sums: Tensor, frame: Tensor) -> tuple[Tensor, Tensor]:
    """Point (C,3) nearest to all rays of a cluster, and whether it is well defined and behind the reflector."""
    k = cluster_fit
    matrix = sums[:, 10:16][:, [0, 1, 2, 1, 3, 4, 2, 4, 5]].reshape(-1, 3, 3) / sums[:, :1, None]
    value = sums[:, 16 : k.SUMS] / sums[:, :1]
    eigen = torch.linalg.eigvalsh(matrix)
    sound = eigen[:, 0] > eigen[:, 2] / NO_CONDITION
    safe = torch.where(sound[:, None, None], matrix, torch.eye(3, dtype=torch.float64))
    point = torch.linalg.solve(safe, value)
    behind = ((point - frame[:, 0]) * frame[:, 3]).sum(-1) < 0
    return point, sound & behind


def _images(
    pixels: ReflectivePixels, bundle: _Bundle, made: ClusterCameras, diagonal: float, scale: float
) -> ClusterCameras:
    """The cameras with the extent and resolution of their images."""
    count, height, width = pixels.shape
    place = np.full(count * height * width, -1, np.int32)
    place[pixels.pixel.numpy()] = np.arange(len(pixels), dtype=np.int32)
    slope = math.tan(math.radians(HALF_ANGLE_DEG))
    gloss = torch.zeros(len(made), dtype=torch.float64)
    gloss = gloss.scatter_reduce(0, made.clusters.cluster, pixels.gloss, "amax")
    angle = gloss * math.pi / 6
    lens = torch.stack([angle.sin(), angle.cos()], dim=1)
    frame = torch.cat([made.frame[:, :1] - bundle.origin, made.look, made.frame[:, 3:]], dim=1)
    tail = torch.tensor([[diagonal, slope]], dtype=torch.float64).expand(len(made), 2)
    limits = torch.cat([made.eye - bundle.origin, made.reach[:, None], tail], dim=1)
    images = cluster_fit.Pictures(place, view(pixels.pixel, np.int64), view(made.clusters.cluster, np.int64), width)
    arguments = (view(lens, np.float64), view(frame, np.float64), view(limits, np.float64), images)
    found = bundle.gather(cluster_fit.image_boxes, arguments, "<<>>+++<", made.planar)
    box = torch.where(torch.isfinite(found[:, :4]), found[:, :4], 0.0)
    clear = ((frame[:, 0] - limits[:, :3]) * frame[:, 3]).sum(-1).clamp_min(1e-4 * diagonal)
    single = _single_pitch(pixels, made.clusters) / clear
    pitch = torch.where(found[:, 6] > 0, found[:, 5] / found[:, 6].clamp_min(1.0), single).clamp_min(1e-12)
    middle, half = (box[:, :2] + box[:, 2:]) / 2, (box[:, 2:] - box[:, :2]) / 2
    half = torch.maximum(half + pitch[:, None], 4.0 * pitch[:, None])  # a pixel to spare, eight at least
    half = half.clamp_max(slope)
    size = (2.0 * half / pitch[:, None]).ceil().clamp(*SIDES)
    pixels_of = made.clusters.sizes.double()
    least, most = (n * pixels_of for n in TEXELS_PER_PIXEL)
    texels = (size[:, 0] * size[:, 1]).clamp(least, most).clamp(MIN_TEXELS, max(MIN_TEXELS, 4.0 * height * width))
    size = (size * (scale * scale * texels / (size[:, 0] * size[:, 1])).sqrt()[:, None]).ceil().clamp(*SIDES)
    return replace(
        made,
        box=torch.cat([middle - half, middle + half], dim=1),
        size=size.long(),
        outside=found[:, 4],
        near=found[:, 7].clamp_min(1e-4 * diagonal),
    )


def _single_pitch(pixels: ReflectivePixels, clusters: PixelClusters) -> Tensor:
    """Width on the surface of one pixel of each cluster, for clusters without neighbouring pixels."""
    some = clusters.order[clusters.starts[:-1]]
    facing = (pixels.view[some] * pixels.normal[some]).sum(-1).abs().clamp_min(1e-3)
    return pixels.pixel_angle[some] * pixels.length[some] / facing
