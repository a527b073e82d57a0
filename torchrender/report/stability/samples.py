"""Records of the stability suite: depth images, what is drawn from them, voxels, volumes and points."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

import torch
from torch import Tensor

from torchrender.buffers import DepthImages
from torchrender.depth.options import SamplingOptions
from torchrender.depth.sample import sample_depth_images
from torchrender.errors import InputError
from torchrender.passes.hard import SHAPE, VIEW, HardEffect, Law, Outputs, Subject, difference, mean_over
from torchrender.points.cloud import PointCloud
from torchrender.points.draw import render_points
from torchrender.points.load import sample_points
from torchrender.points.options import SplatOptions
from torchrender.raster import rasterize
from torchrender.reconstruct.reproject import METHODS, reproject
from torchrender.voxels.attributes import voxelize_scene
from torchrender.voxels.grid import VoxelGrid, make_grid
from torchrender.voxels.solid import SolidOptions, voxelize_solid
from torchrender.voxels.surface import SurfaceOptions, voxelize_surface
from torchrender.voxels.volume import VolumeLayer, render_volume, surface_layer, voxel_layer

CELLS = 24
POINTS = 2000
FINITE = torch.finfo(torch.float32).max

Bounds = Mapping[str, tuple[float, float]]


# -------------------------------------------------------------- depth images

WAYS = {
    "conventional": SamplingOptions(method="conventional"),
    "depth_peeling": SamplingOptions(method="depth_peeling", layers=3),
    "nonredundant": SamplingOptions(),
    "by visibility": SamplingOptions(redundancy="visibility"),
}


def _sampled(subject: Subject) -> Outputs:
    found: dict[str, Tensor] = {}
    for name, options in WAYS.items():
        images = sample_depth_images(subject.scene, subject.cameras, options)
        found[f"{name}: depth"] = images.depth / subject.unit
        found[f"{name}: triangle"] = images.triangle
    return found


def _ordered(subject: Subject, outputs: Outputs) -> float:
    """Pixels of the first images that are not what the rasteriser draws, and peeled layers before the one above."""
    plain = rasterize(subject.scene, subject.cameras, cull="back").depth / subject.unit
    firsts = (("conventional", 2), ("nonredundant", 1), ("by visibility", 1))
    off = [
        difference({"depth": outputs[f"{name}: depth"][:count].double()}, {"depth": plain[:count].double()}, 1e-5)
        for name, count in firsts
    ]
    layers = outputs["depth_peeling: depth"]
    return max(*off, float((layers[1:] < layers[:-1]).double().mean()))


DEPTH_SAMPLING = HardEffect(
    name="depth_sampling",
    parallel=False,
    about=VIEW,
    modules=("depth.sample",),
    run=_sampled,
    bounds=lambda _: {f"{name}: depth": (0.0, math.inf) for name in WAYS},
    law=Law(
        text="the first image is what the rasteriser draws, and peeled layers follow one another: share of pixels "
        "where not",
        deviation=_ordered,
        limit=0.01,
    ),
)


# -------------------------------------------------------------- reprojection


def _images(subject: Subject) -> DepthImages:
    return sample_depth_images(subject.scene, subject.cameras, SamplingOptions(method="conventional", shade=True))


def _between(subject: Subject) -> Outputs:
    images = _images(subject)
    found: dict[str, Tensor] = {}
    for method in METHODS:
        drawn = reproject(images, subject.cameras, method=method)
        found[f"{method}: color"], found[f"{method}: depth"] = drawn.color, drawn.depth / subject.unit
    return found


def _own_view(subject: Subject, _: Outputs) -> float:
    """The first image drawn for its own camera."""
    image = _images(subject)[0]
    wanted = image.depth.double()
    off = (reproject(image, image.cameras).depth.double() - wanted).abs()
    return mean_over((~(off <= 2 * image.cameras.footprint(wanted))).float(), image.covered)


REPROJECTION = HardEffect(
    name="reconstruct.reproject",
    parallel=False,
    about=VIEW,
    modules=("reconstruct.reproject",),
    run=_between,
    bounds=lambda _: {
        f"{method}: {part}": limits
        for method in METHODS
        for part, limits in (("color", (0.0, 1.0 + 1e-5)), ("depth", (0.0, math.inf)))
    },
    law=Law(
        text="an image drawn for its own camera keeps its depths within two pixels (hybrid): share of pixels where not",
        deviation=_own_view,
        limit=0.01,
    ),
)


# -------------------------------------------------------------------- voxels


def _grid(subject: Subject) -> VoxelGrid:
    return make_grid(subject.scene.bounds[None], CELLS)


def _mesh(subject: Subject) -> tuple[Tensor, Tensor]:
    geometry = subject.scene.geometry
    return geometry.vertices[None], geometry.faces.long()


def _surface(subject: Subject) -> Outputs:
    grid = _grid(subject)
    return {
        mode: voxelize_surface(*_mesh(subject), grid, SurfaceOptions(mode=mode)).dense()
        for mode in ("conservative", "thin")
    }


SURFACE_VOXELS = HardEffect(
    name="surface_voxels",
    borders=True,
    about=SHAPE,
    modules=("voxels.surface",),
    run=_surface,
    bounds=lambda _: {},
    law=Law(
        text="thin voxels are among the conservative ones: share of cells where not",
        deviation=lambda _, found: float((found["thin"] & ~found["conservative"]).double().mean()),
        limit=0.0,
    ),
    turns=False,
)


def _solid(subject: Subject, order: Tensor | None = None) -> Outputs:
    vertices, faces = _mesh(subject)
    faces = faces if order is None else faces[order]
    grid = _grid(subject)
    return {
        method: voxelize_solid(vertices, faces, grid, SolidOptions(method=method, warn=False))[0].dense()
        for method in ("winding", "parity", "vote")
    }


def _any_order(subject: Subject, outputs: Outputs) -> float:
    count = subject.scene.geometry.triangle_count
    order = torch.randperm(count, generator=torch.Generator().manual_seed(0))
    return difference(_solid(subject, order), outputs)


SOLID_VOXELS = HardEffect(
    name="solid_voxels",
    borders=True,
    about=SHAPE,
    modules=("voxels.solid",),
    run=_solid,
    bounds=lambda _: {},
    law=Law(
        text="the order of the triangles does not matter: share of cells that differ", deviation=_any_order, limit=0.0
    ),
    turns=False,
)


def _layers(subject: Subject) -> list[VolumeLayer]:
    grid = _grid(subject)
    surface = voxelize_scene(subject.scene, grid)
    solid, _ = voxelize_solid(*_mesh(subject), grid, SolidOptions(warn=False))
    return [surface_layer(surface), voxel_layer(solid, (0.8, 0.4, 0.2), 0.1)]


def _volume(subject: Subject) -> Outputs:
    image = render_volume(_layers(subject), subject.cameras)
    return {"color": image[..., :3], "coverage": image[..., 3]}


def _other_way_round(subject: Subject, outputs: Outputs) -> float:
    image = render_volume(_layers(subject)[::-1], subject.cameras)
    return float((image[..., :3] - outputs["color"]).abs().max())


VOXEL_VOLUME = HardEffect(
    name="voxel_volume",
    borders=True,
    about=VIEW,
    modules=("voxels.volume", "voxels.attributes"),
    run=_volume,
    bounds=lambda _: {"color": (0.0, 1.0 + 1e-4), "coverage": (0.0, 1.0)},
    law=Law(
        text="the order of two layers in one place does not matter: largest difference in colour",
        deviation=_other_way_round,
        limit=1e-4,
    ),
    turns=False,
    twins=0.1,  # samples exactly between two cells fall to either
)


# -------------------------------------------------------------------- points


def _cloud(subject: Subject) -> PointCloud:
    return sample_points(subject.scene, POINTS)


def _no_surface(subject: Subject) -> str | None:
    try:
        sample_points(subject.scene, 1)
    except InputError as error:
        return str(error)
    return None


def _points(subject: Subject) -> Outputs:
    cloud, found = _cloud(subject), {}
    for name in ("adaptive", "full", "squares"):
        drawn = render_points(cloud, subject.cameras, SplatOptions(filter=name))
        found[f"{name}: image"], found[f"{name}: weight"] = drawn.image, drawn.weight
        found[f"{name}: depth"] = drawn.depth / subject.unit
    return found


def _white_stays_white(subject: Subject, _: Outputs) -> float:
    cloud = _cloud(subject)
    white = replace(cloud, color=torch.ones(len(cloud.position), 3))
    drawn = render_points(white, subject.cameras, SplatOptions(shading="none"))
    return mean_over((drawn.image - 1.0).abs().amax(dim=-1), drawn.mask)


SPLAT = HardEffect(
    name="splat",
    parallel=False,
    about=VIEW,
    modules=("points.draw",),
    run=_points,
    bounds=lambda _: {
        f"{name}: {part}": limits
        for name in ("adaptive", "full", "squares")
        for part, limits in (("image", (0.0, 1.0 + 1e-4)), ("weight", (0.0, FINITE)), ("depth", (0.0, math.inf)))
    },
    law=Law(
        text="unlit white points give white wherever they cover: mean difference",
        deviation=_white_stays_white,
        limit=1e-4,
    ),
    skip=_no_surface,
    turns=False,  # patches are cut along the axes
)

SAMPLES = (DEPTH_SAMPLING, REPROJECTION, SURFACE_VOXELS, SOLID_VOXELS, VOXEL_VOLUME, SPLAT)
