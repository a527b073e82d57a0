"""Extra layers of a keyframe: what cameras around the first one see and its depth image does not hold.

Of the non-redundant samples (specification 01, section 5) only those are kept that an extra camera sees first: they are
what moving a little brings to light. Few pixels are shaded and sent for them.

Extra cameras keep the orientation and intrinsics of the first, so a pixel of theirs and the same pixel of the first
image look at the same point of the sky: no sky is sent twice.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from torchrender.buffers import GBuffer, RayHits, ReflectionLayer, VisibilityBuffer
from torchrender.clock import StepClock
from torchrender.effects.reflections.virtual import virtual_images
from torchrender.effects.transparency.layers import deepest_layers, transparency
from torchrender.image import Image
from torchrender.kernels.warp.known_samples import find_known
from torchrender.passes.mirrors.reflections import REFLECTIONS
from torchrender.passes.seen.gbuffer import GBUFFER
from torchrender.pipeline.history import RenderHistory
from torchrender.pipeline.options import RenderOptions
from torchrender.raster import rasterize_visibility, surface_attributes
from torchrender.reconstruct.reproject import pixel_matrices
from torchrender.scene.camera import Cameras
from torchrender.scene.model import Scene
from torchrender_service.renderers.streaming.samples import background_of, only, shade_pixels

BASELINE = 0.09  # distance of the extra cameras in median depths of the first image
MAX_BASELINE = 0.25
MANY_PIXELS = 2**14  # a median of all of them would take longer than packing their depths
FEWEST = 3
"""New samples of the nine around a pixel below which its own is left out."""
CONTINUES = 0.02
"""Share of its depth by which a neighbour of a new sample may be nearer and still continue its surface."""
ELSEWHERE = 0.4
"""Share of new samples from which an extra camera stands inside or behind something: nothing of it is sent."""
ALIKE = 0.9
"""Cosine above which two ways to go bring the same to light."""
TOLERANCE = 2e-3
"""Share of its depth that a sample may be off and still be the same surface."""

MIRRORS_NEED = (GBUFFER.name, REFLECTIONS.name)
"""Buffers that the picture must carry."""

FEWEST_MIRRORS = 64
"""Pixels that must mirror for their picture to be worth a message."""


@dataclass(frozen=True, eq=False)
class Layer:
    """One extra depth image with its colours."""

    camera: Cameras
    depth: Tensor  # (H,W); +inf where there is no surface
    radiance: Tensor  # (H,W,3) linear
    known: Tensor  # (H,W) bool: a sample, or sky that no earlier layer shows


def extra_layers(
    scene: Scene,
    first: VisibilityBuffer,
    cameras: Sequence[Cameras],
    options: RenderOptions,
    past: RenderHistory,
) -> list[Layer]:
    """What each of ``cameras`` sees and none before it holds, shaded like a picture.

    Every new sample is continued by a pixel to all sides, so that the layer overlaps what is beside it.

    Args:
        scene: as it was given to the picture of layer 0.
        first: what that picture's one camera sees.
        cameras: single cameras from :func:`cameras_around`.
        past: what that picture left.
    """
    known = [first]
    sky_shown = ~first.covered[0]
    layers = []
    clock = StepClock()  # whoever asked may have gone on: that is looked at between its steps
    for camera in cameras:
        with clock.measure("seen"):
            seen = rasterize_visibility(scene.geometry, camera)
        new, new_sky = _new_pixels(seen, known), ~seen.covered[0] & ~sky_shown
        if float((new[0] | new_sky).float().mean()) > ELSEWHERE:
            new, new_sky = torch.zeros_like(new), torch.zeros_like(new_sky)
        kept, nearest = _grown(new, seen.depth)
        sky_shown = sky_shown | new_sky
        gbuffer = surface_attributes(scene, only(seen, kept))
        with clock.measure("shaded"):
            radiance = _shade_few(scene, gbuffer, options, past)
        layers.append(_extended(Layer(camera, gbuffer.depth[0], radiance, kept[0] | new_sky), seen, nearest))
        known.append(gbuffer)
    return layers


def _new_pixels(seen: VisibilityBuffer, earlier: Sequence[VisibilityBuffer]) -> Tensor:
    """(1,H,W) bool: no earlier image holds the sample."""
    known = ~seen.covered
    for image in earlier:
        matrix = pixel_matrices(seen.cameras, image.cameras)[0]
        arrays = [t[0].numpy() for t in (image.depth, image.triangle)]
        find_known(seen.depth[0].numpy(), seen.triangle[0].numpy(), matrix, *arrays, TOLERANCE, known[0].numpy())
    new = ~known
    # Single pixels are cracks between samples, which clients close themselves.
    beside = torch.nn.functional.avg_pool2d(new.float()[None], 3, stride=1, padding=1)[0] * 9.0
    return new & (beside > FEWEST - 0.5)


def _grown(new: Tensor, depth: Tensor) -> tuple[Tensor, Tensor]:
    """Which samples are sent, and what continues behind the rest.

    Returns:
        (1,H,W) bool: new samples and those of their eight neighbours that do not lie in front of them.
        (H,W) int64: flat index of the nearest new sample among the nine around a pixel, -1 where there is none.
    """
    far = torch.where(new, depth, torch.inf)
    negative, where = torch.nn.functional.max_pool2d(-far, 3, stride=1, padding=1, return_indices=True)
    beside = torch.isfinite(negative)
    kept = new | (beside & (depth >= -(1.0 - CONTINUES) * negative) & torch.isfinite(depth))
    return kept, torch.where(beside, where, -1)[0]


def _extended(layer: Layer, seen: VisibilityBuffer, nearest: Tensor) -> Layer:
    """With new samples continued by a pixel behind what hides them, where otherwise a crack would open.

    What lies in front is known already; sent again, it would hide what is beside its outline once the eye moves.
    """
    hidden = (nearest >= 0) & seen.covered[0] & ~layer.known
    source = nearest[hidden]
    depth, radiance = layer.depth.clone(), layer.radiance.clone()
    depth[hidden] = layer.depth.reshape(-1)[source]
    radiance[hidden] = layer.radiance.reshape(-1, 3)[source]
    return replace(layer, depth=depth, radiance=radiance, known=layer.known | hidden)


def typical_depth(depth: Tensor) -> float:
    """Median of finite depths (H,W), in large images of one in sixteen; 0 where there is none."""
    step = 4 if depth.numel() >= MANY_PIXELS else 1
    sparse = depth[::step, ::step]
    finite = sparse[torch.isfinite(sparse)]
    return float(finite.median()) if len(finite) else 0.0


def cameras_around(
    camera: Cameras, depth: Tensor, count: int, *, direction: Sequence[float] = (0, 0, 0), baseline: float = 0.0
) -> list[Cameras]:
    """``count`` cameras beside a single one: first where it is going, then to both sides, up and down.

    Args:
        depth: (H,W) what the camera sees.
        direction: where it is going, world axes; zero where it stands.
        baseline: how far, scene units; kept between ``BASELINE`` and ``MAX_BASELINE`` median depths.
    """
    if not count:
        return []
    typical = typical_depth(depth) or 10.0 * float(camera.near[0])
    reach = min(max(baseline, BASELINE * typical), MAX_BASELINE * typical)
    right, down = camera.rotation[0, 0], camera.rotation[0, 1]
    ways = [right, -right, -down, down]
    ahead = torch.as_tensor(direction, dtype=torch.float64)
    if float(ahead.norm()) > 0.0:
        ahead = ahead / ahead.norm()
        ways.sort(key=lambda way: -float(way @ ahead))
        ways = [ahead, *(way for way in ways if float(way @ ahead) < ALIKE), *ways]
    moved = []
    for way in ways[:count]:
        matrix = camera.camera_from_world.clone()
        matrix[0, :3, 3] -= camera.rotation[0] @ (reach * way)
        moved.append(replace(camera, camera_from_world=matrix))
    return moved


def _shade_few(scene: Scene, seen: GBuffer, options: RenderOptions, past: RenderHistory) -> Tensor:
    """Radiance (H,W,3) of one image with few samples; empty pixels get the background."""
    radiance = background_of(scene, seen, options, past).clone()
    radiance[seen.covered[0]] = shade_pixels(scene, seen, seen.covered, options, past).radiance
    return radiance if options.transparency == "off" else _through_panes(scene, seen, radiance)


def _through_panes(scene: Scene, seen: GBuffer, radiance: Tensor) -> Tensor:
    """The light (H,W,3) of one image as panes before it tint it; what these send themselves is left out."""
    if scene.geometry.see_through is None or not deepest_layers(scene, seen.cameras, most=1):
        return radiance
    return radiance * transparency(scene, seen, _dark).passing[0]


def _dark(origins: Tensor, directions: Tensor, width: Tensor, hits: RayHits) -> Tensor:
    del directions, width, hits
    return torch.zeros(origins.shape, dtype=torch.float32)


def mirror_layer(image: Image, camera: Cameras) -> Layer | None:
    """The layer of a picture that carries its reflections; None where it does not."""
    layer, seen = image.buffers.get(REFLECTIONS.name), image.buffers.get(GBUFFER.name)
    if not isinstance(layer, ReflectionLayer) or not isinstance(seen, GBuffer):
        return None
    made = virtual_images(image.scene, seen, layer)
    parts = (_sized(part, camera) for part in (made.depth[0], made.light[0], made.known[0]))
    return Layer(camera, *parts)


def worth_sending(mirrors: Layer | None) -> bool:
    """Whether a layer of mirrors shows enough."""
    return mirrors is not None and int(mirrors.known.sum()) >= FEWEST_MIRRORS


def _sized(picture: Tensor, camera: Cameras) -> Tensor:
    """The nearest pixels of a picture (h,w,...) at the camera's size."""
    rows = (torch.arange(camera.height) * picture.shape[0]) // camera.height
    columns = (torch.arange(camera.width) * picture.shape[1]) // camera.width
    return picture[rows][:, columns].contiguous()
