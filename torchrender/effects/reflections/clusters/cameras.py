"""A pinhole camera for each cluster of reflective pixels, that sees about what their reflected rays see.

Specification 03, section 6. Planar clusters need no such camera: their rays all come from the mirrored eye. Curved ones
look along the normal of their fitting plane. The centre of projection is the mirrored eye drawn towards the reflector
(thesis), or the point nearest to all rays (least squares, specification 03, section 12.1); "best" takes for each
cluster the one whose camera rays deviate least from the reflected rays.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from torchrender.arrays import view
from torchrender.checks import check_choice, check_range, checked_fields, options_of
from torchrender.effects.reflections.clusters.bundle import Bundle, ClusterCameras
from torchrender.effects.reflections.clusters.extents import with_images
from torchrender.effects.reflections.clusters.grouping import PixelClusters, split
from torchrender.effects.reflections.reflectors import LOBES, ReflectivePixels
from torchrender.kernels.reflections import cluster_fit

AIMS = ("rays", "normal")
CENTRES = ("best", "thesis", "least_squares")
SHIFT_RANGE = (0.05, 8.0)
STEEPEST = math.cos(math.radians(80.0))  # smaller cosines to the fitting plane's normal do not count for the shift
FLAT_RESIDUAL = 1e-3  # of the extent
FLAT_COSINE = math.cos(math.radians(0.1))
SPREAD_NORMALS = 0.2  # mean normals shorter than this belong to clusters that face everywhere
SPLITS = 2
ROUNDS = 6  # of splitting by deviation
LEAST_SPLIT = 8  # pixels of a cluster that is parted for its deviation
NO_CONDITION = 1e8


@dataclass(frozen=True, kw_only=True)
@checked_fields
class CameraOptions:
    """How cameras are placed.

    Raises:
        OptionError: a value outside its range; names it.
    """

    centre: str = "best"  # "thesis", "least_squares", or "best"
    scale: float = 1.0  # of the image sides
    shorten: bool = True  # bring the far plane of glossy clusters nearer
    aim: str = "rays"  # view axis: "normal" of the fitting plane (thesis), or the mean direction of the "rays", which
    # at grazing angles lie far off the normal
    deviation_deg: float = 180.0  # mean angle between a cluster's rays and its camera's above which it is parted
    most: int = 512  # clusters from which on none is parted for its deviation
    lobe: str = "cone"  # of glossy clusters
    planes: bool = True  # planar clusters look with the mirrored eye, pixel for pixel

    def __post_init__(self) -> None:
        check_choice("centre", self.centre, CENTRES)
        check_choice("aim", self.aim, AIMS)
        check_choice("lobe", self.lobe, LOBES)
        check_range("scale", self.scale, 1e-3, 64.0)
        check_range("deviation_deg", self.deviation_deg, 0.1, 180.0)
        check_range("most", self.most, 1, 1 << 20)


def build_cluster_cameras(
    pixels: ReflectivePixels, clusters: PixelClusters, diagonal: float, options: CameraOptions | None = None
) -> ClusterCameras:
    """Cameras of all clusters. Clusters that face everywhere, whose rays cross before the mirror, or whose camera would
    not see what its rays see, are split.

    Args:
        diagonal: of the scene's bounding box; rays are followed that far.
    """
    options = options_of(options, CameraOptions)
    bundle = Bundle.of(pixels, clusters)
    rounds = SPLITS if options.deviation_deg >= 180.0 else ROUNDS
    for attempt in range(rounds + 1):
        made, side = _fit(pixels, bundle, diagonal, options)
        if len(made) >= options.most:
            side = torch.where(side == 4, 0, side)
        if attempt == rounds or not bool(side.any()):
            break
        bundle = bundle.regroup(split(bundle.clusters, _sides(bundle, made, side)))
    return with_images(pixels, bundle, made, diagonal, options.scale, options.lobe)


def _sides(bundle: Bundle, made: ClusterCameras, chosen: Tensor) -> Tensor:
    """(N,) 0 or 1: in the chosen clusters (1 by place, 2 by normal, 3 by height, 4 by direction), the side of the
    mean along the widest axis."""
    cluster = bundle.clusters.cluster
    offset = torch.from_numpy(bundle.rays[0]) + bundle.origin - made.frame[cluster, 0]
    normal = torch.from_numpy(bundle.rays[1])
    # Where normals point everywhere, part them by direction, else by place.
    value = torch.where((chosen[cluster] == 2)[:, None], normal, offset)
    toward = torch.from_numpy(bundle.rays[2])
    value = torch.where((chosen[cluster] == 4)[:, None], toward - mean_of(toward, cluster, len(made)), value)
    spread = torch.zeros(len(made), 3, dtype=torch.float64).index_add(0, cluster, value.square())
    along = value.gather(1, spread.argmax(dim=1)[cluster][:, None])[:, 0]
    along = torch.where(chosen[cluster] == 3, (offset * made.frame[cluster, 3]).sum(-1), along)
    return torch.where(chosen[cluster] > 0, along > 0, False).long()


def mean_of(value: Tensor, cluster: Tensor, count: int) -> Tensor:
    """(N,3) mean of its cluster for each row of values (N,3)."""
    total = torch.zeros(count, 3, dtype=torch.float64).index_add(0, cluster, value)
    return (total / torch.bincount(cluster, minlength=count).clamp_min(1)[:, None])[cluster]


def _fit(
    pixels: ReflectivePixels, bundle: Bundle, diagonal: float, options: CameraOptions
) -> tuple[ClusterCameras, Tensor]:
    """Frames and centres; and (C,) 0 where a cluster may stay, else how it must be split (see ``_sides``)."""
    sums = bundle.gather(cluster_fit.moments, _places(pixels), "+" * cluster_fit.SUMS + "<<>>")
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
    planar &= (gloss <= 0) & options.planes
    reach = diagonal * (1.0 - gloss * options.shorten).clamp_min(0.05)
    eye = _eyes(pixels, bundle, diagonal, options.planes) - bundle.origin
    height = ((eye - middle) * axis).sum(-1)
    mirrored = eye - 2.0 * height[:, None] * axis
    frame = torch.stack([middle, *_image_axes(pixels, bundle, axis), axis], dim=1)
    boxes = _eye_boxes(bundle, frame, mirrored, reach, diagonal, planar)
    shift, crossing = _shift(boxes)
    shift = torch.where(planar, 1.0, shift)
    chosen = _centre(bundle, options.centre, frame, mirrored, shift, sums, planar)
    chosen = torch.where(planar[:, None], mirrored, chosen)
    toward = sums[:, 7:10] / count
    many = count[:, 0] > 1
    side = (many & crossing & ~planar).long()
    off = bundle.gather(cluster_fit.ray_deviation, (view(chosen[:, None], np.float64),), "+", planar) / count
    wide = (off[:, 0] > 1.0 - math.cos(math.radians(options.deviation_deg))) & (count[:, 0] >= LEAST_SPLIT) & ~planar
    side = torch.where(wide & (side == 0), 4, side)
    side = torch.where(many & (facing.norm(dim=-1) < SPREAD_NORMALS), 2, side)
    side = torch.where(many & (-spread[:, 2] > FLAT_COSINE) & (residual > FLAT_RESIDUAL * extent), 3, side)
    clear = ((middle - chosen) * axis).sum(-1)
    frame[:, 0] += bundle.origin
    straight = (toward.norm(dim=-1, keepdim=True) > SPREAD_NORMALS) & (options.aim == "rays")
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


def _places(pixels: ReflectivePixels) -> tuple[np.ndarray, np.ndarray]:
    """Column and row (N,) of each pixel."""
    width = pixels.shape[2]
    column, row = pixels.pixel % width, pixels.pixel // width % pixels.shape[1]
    return view(column, np.float64), view(row, np.float64)


def _eyes(pixels: ReflectivePixels, bundle: Bundle, diagonal: float, of_picture: bool) -> Tensor:
    """(C,3) eye that sees each cluster; for parallel projection a very far one; else where a ray to it began."""
    cameras = pixels.cameras
    some = bundle.clusters.order[bundle.clusters.starts[:-1]]
    if not of_picture:
        return pixels.position[some] - pixels.length[some, None] * pixels.view[some]
    camera = pixels.pixel[some] // (pixels.shape[1] * pixels.shape[2])
    if cameras.orthographic:
        return pixels.position[some] - 1e3 * diagonal * cameras.forward[camera]
    return cameras.eye[camera]


def _image_axes(pixels: ReflectivePixels, bundle: Bundle, axis: Tensor) -> tuple[Tensor, Tensor]:
    """Right and down axes (C,3) of images that look along ``axis``, turned like the eye's picture."""
    some = bundle.clusters.order[bundle.clusters.starts[:-1]]
    camera = pixels.pixel[some] // (pixels.shape[1] * pixels.shape[2])
    rotation = torch.nn.functional.normalize(pixels.cameras.rotation[camera], dim=-1)
    flat = rotation - (rotation * axis[:, None]).sum(-1, keepdim=True) * axis[:, None]
    degenerate = flat[:, :1].norm(dim=-1, keepdim=True) < 1e-6
    right = torch.nn.functional.normalize(torch.where(degenerate, flat[:, 1:2], flat[:, :1])[:, 0], dim=-1, eps=1e-300)
    return right, torch.linalg.cross(axis, right)


def _eye_boxes(bundle: Bundle, frame: Tensor, mirrored: Tensor, reach: Tensor, diagonal: float, skip: Tensor) -> Tensor:
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
    bundle: Bundle, centre: str, frame: Tensor, mirrored: Tensor, shift: Tensor, sums: Tensor, skip: Tensor
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
