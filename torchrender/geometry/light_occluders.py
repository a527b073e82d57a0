"""The scene as a rectangular light sees it, rebuilt from a few depth images: what casts its soft shadows."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import torch
from torch import Tensor

from torchrender.checks import check_choice, check_range
from torchrender.depth.options import METHODS, SamplingOptions
from torchrender.depth.sample import sample_depth_images, sample_offset_images
from torchrender.geometry.corners import ReconstructOptions
from torchrender.geometry.reconstruct import Reconstruction, reconstruct_grid, reconstruct_hybrid
from torchrender.geometry.splat import reconstruct_splat
from torchrender.scene.camera import Cameras
from torchrender.scene.light import RectLight
from torchrender.scene.light_grid import corner_grid
from torchrender.scene.mesh import Geometry
from torchrender.scene.model import Scene

MESHES = ("hybrid", "grid", "splat")


@dataclass(frozen=True, kw_only=True)
class OccluderOptions:
    """How a light's view of the scene is sampled and rebuilt.

    Raises:
        OptionError: a value outside its range or choices; names it.
    """

    method: str = "nonredundant"  # "nonredundant", "conventional" or "depth_peeling"
    mesh: str = "hybrid"  # "hybrid", "grid" or "splat"
    size: int = 1024  # pixels of an image's side
    layers: int = 4  # of depth peeling, all seen from the light's centre
    redundancy: str = (
        "pixel"  # "visibility" finds repeats of thin surfaces that "pixel" misses, at several times the cost
    )
    pixel_test: str = "depth_identity"  # of redundancy "pixel"
    rho: float = 1.01  # guessed corners: spikes of edge-on surfaces would cast shadows of their own

    def __post_init__(self) -> None:
        check_choice("method", self.method, METHODS)
        check_choice("mesh", self.mesh, MESHES)
        check_range("size", self.size, 16, 8192)
        check_range("layers", self.layers, 1, 64)


def approximate_occluders(scene: Scene, light: RectLight, options: OccluderOptions | None = None) -> Geometry:
    """A mesh of what the four corners of a light see of the scene (depth peeling: of its layers below the centre).

    Surfaces are kept whichever side the light sees. A corner from which the scene spans more than 150 degrees takes the
    six faces of a cube. Lights without area have fewer corners: two, or one.
    """
    options = options or OccluderOptions()
    if not scene.geometry.triangle_count:
        return scene.geometry
    return rebuild(scene, light_viewpoints(light, scene.bounds, options), options).geometry


def light_viewpoints(light: RectLight, bounds: Tensor, options: OccluderOptions) -> Cameras:
    """The cameras of the depth images: at the light's corners; for depth peeling at its centre."""
    if options.method == "depth_peeling":
        nothing = torch.zeros(3)
        light = RectLight(corner=light.centre, edge_u=nothing, edge_v=nothing)
    grid = corner_grid(light, bounds, size=options.size)
    return Cameras.cat([grid.cameras(sample) for sample in range(len(grid.samples))])


def rebuild(scene: Scene, cameras: Cameras, options: OccluderOptions) -> Reconstruction:
    """Sample the scene from ``cameras`` and rebuild a mesh from every image."""
    sampling = SamplingOptions(
        method=options.method,
        redundancy=options.redundancy,
        pixel_test=options.pixel_test,
        cull_backfaces=False,
        layers=options.layers,
    )
    images = sample_depth_images(scene, cameras, sampling)
    if options.mesh == "hybrid":
        return reconstruct_hybrid(
            images, sample_offset_images(scene, images), ReconstructOptions(rho=options.rho), colors=False
        )
    makers: dict[str, Callable[..., Reconstruction]] = {"grid": reconstruct_grid, "splat": reconstruct_splat}
    return makers[options.mesh](images, colors=False)
