"""The scene as a rectangular light sees it in a few depth images: what casts its soft shadows.

Two ways from samples to triangles. ``mesh="triangles"`` takes the scene's own triangles that some pixel stores: every
sample names one, so nothing has to be guessed, blades thinner than a pixel keep their width, and there are never more
triangles than the scene has. The others rebuild surfaces from the samples alone (specification 02, section 3).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import torch
from torch import Tensor

from torchrender.buffers import DepthImages
from torchrender.checks import check_choice, check_class, check_range, checked_fields, options_of
from torchrender.depth.options import METHODS, REDUNDANCY, SamplingOptions
from torchrender.depth.sample import sample_depth_images, sample_offset_images
from torchrender.effects.shadows.light_samples import corner_grid
from torchrender.fragment_tests import PIXEL_TESTS
from torchrender.reconstruct.corners import ReconstructOptions
from torchrender.reconstruct.discs import reconstruct_discs
from torchrender.reconstruct.hybrid import Reconstruction, reconstruct_grid, reconstruct_hybrid
from torchrender.scene.camera import Cameras
from torchrender.scene.light import RectLight
from torchrender.scene.mesh import Geometry
from torchrender.scene.model import Scene

MESHES = ("triangles", "hybrid", "grid", "splat")
_TESTS = {"triangles": "identity", "hybrid": "captured", "grid": "captured", "splat": "captured"}


@dataclass(frozen=True, kw_only=True)
@checked_fields
class OccluderOptions:
    """How a light's view of the scene is sampled and rebuilt.

    Raises:
        OptionError: a value outside its range or choices; names it.
    """

    method: str = "nonredundant"  # "nonredundant", "conventional" or "depth_peeling"
    mesh: str = "triangles"  # the scene's that the images show; or rebuilt: "hybrid", "grid" or "splat"
    size: int = 1024  # pixels of an image's side
    layers: int = 4  # of depth peeling, all seen from the light's centre
    redundancy: str = "pixel"  # or "visibility": by rays, at many times the cost
    pixel_test: str | None = None  # of redundancy "pixel"; None: "identity" for triangles, else "captured"
    guess_ratio: float = 1.01  # rho of guessed corners: spikes of edge-on surfaces would cast shadows of their own
    merge_guesses: bool = True  # "hybrid": beyond the source, as in ReconstructOptions
    adaptive_split: bool = True  # the same

    def __post_init__(self) -> None:
        check_choice("method", self.method, METHODS)
        check_choice("mesh", self.mesh, MESHES)
        if self.pixel_test is not None:
            check_choice("pixel_test", self.pixel_test, PIXEL_TESTS)
        check_choice("redundancy", self.redundancy, REDUNDANCY)
        check_range("guess_ratio", self.guess_ratio, 1.01, 2.0)
        check_range("size", self.size, 16, 8192)
        check_range("layers", self.layers, 1, 64)


def approximate_occluders(
    scene: Scene, light: RectLight, options: OccluderOptions | None = None, *, bounds: Tensor | None = None
) -> Geometry:
    """Triangles for what the four corners of a light see of the scene (depth peeling: of its layers below the centre).

    Surfaces are kept whichever side the light sees. A corner from which the box spans more than 150 degrees takes the
    six faces of a cube. Lights without area have fewer corners: two, or one.

    Args:
        bounds: (2,3) box that the images frame, where that is not the whole scene's: the part whose shadows matter,
            when a wide backdrop would take most pixels. What lies outside the images casts no shadow.
    """
    check_class("scene", scene, Scene)
    check_class("light", light, RectLight)
    options = options_of(options, OccluderOptions)
    if not scene.geometry.triangle_count:
        return scene.geometry.solid
    cameras = light_viewpoints(light, scene.bounds if bounds is None else bounds, options)
    images = sample_depth_images(scene, cameras, sampling_options(options))
    if options.mesh == "triangles":
        shown = torch.zeros(scene.geometry.triangle_count, dtype=torch.bool)
        shown[images.triangle[images.covered]] = True
        return scene.geometry.solid.part(shown)
    return rebuild(scene, images, options).geometry


def light_viewpoints(light: RectLight, bounds: Tensor, options: OccluderOptions) -> Cameras:
    """The cameras of the depth images: at the light's corners; for depth peeling at its centre."""
    if options.method == "depth_peeling":
        nothing = torch.zeros(3)
        light = RectLight(corner=light.centre, edge_u=nothing, edge_v=nothing)
    grid = corner_grid(light, bounds, size=options.size)
    return Cameras.cat([grid.cameras(sample) for sample in range(len(grid.samples))])


def sampling_options(options: OccluderOptions) -> SamplingOptions:
    """How the depth images are sampled."""
    return SamplingOptions(
        method=options.method,
        redundancy=options.redundancy,
        pixel_test=options.pixel_test or _TESTS[options.mesh],
        cull_backfaces=False,
        layers=options.layers,
        count_layers=False,  # shadows ask what is there, not how many surfaces lie before it
    )


def rebuild(scene: Scene, images: DepthImages, options: OccluderOptions) -> Reconstruction:
    """A mesh of every image."""
    if options.mesh == "hybrid":
        return reconstruct_hybrid(
            images,
            sample_offset_images(scene, images),
            ReconstructOptions(
                guess_ratio=options.guess_ratio,
                merge_guesses=options.merge_guesses,
                adaptive_split=options.adaptive_split,
            ),
            colors=False,
        )
    makers: dict[str, Callable[..., Reconstruction]] = {"grid": reconstruct_grid, "splat": reconstruct_discs}
    return makers[options.mesh](images, colors=False)
