"""Light that surfaces send to the eye: Lambert and Phong, or GGX metallic-roughness, textures, emission, background.

Shadow factors are an input: they never darken ambient light, so that a fully shadowed pixel of a Phong material is
exactly its colour times the ambient light plus emission.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from torchrender.buffers import GBuffer, MirrorShare, RaySurface
from torchrender.checks import ArrayLike, as_vector, check_choice, check_tensor
from torchrender.scene.camera import Cameras
from torchrender.scene.model import Scene
from torchrender.shading.fused import is_of, send_fused
from torchrender.shading.lights import LightLists
from torchrender.shading.lobes import Around
from torchrender.shading.plain import CHUNK, send
from torchrender.shading.surface import Reader
from torchrender.shading.variables import wants_gradient

AREA_LIGHTS = ("polygon", "centre")


@dataclass(frozen=True, eq=False)
class AmbientReach:
    """How much of the light from all around reaches the samples of B pictures."""

    visibility: Tensor  # (B,H,W) share in [0,1]
    bent_normal: Tensor | None = None  # (B,H,W,3) unit mean direction that it comes from; None: the shading normal


@dataclass(frozen=True, eq=False)
class SentLight:
    """Light that surfaces send, and what of it mirrors change."""

    radiance: Tensor  # (B,H,W,3)
    share: MirrorShare


def shade(
    scene: Scene,
    samples: GBuffer | RaySurface,
    visibility: Tensor | None = None,
    *,
    background: ArrayLike | None = None,
    area_light: str = "polygon",
    around: AmbientReach | None = None,
) -> Tensor:
    """Linear radiance (B,H,W,3) of a scene's G-buffer under its own lights, or of what rays hit (as an image).

    Args:
        samples: what cameras see; or :attr:`RaySurface.image`, whose light goes back along its rays.
        visibility: shadow factors (B,L,H,W) in [0,1], one image per scene light; None: every light reaches everything.
        background: colour (3,) of empty pixels; None: the environment in that direction, or where there is none the
            scene's ambient light, which is the radiance of a surrounding of one colour. Rays that hit nothing give 0.
        area_light: irradiance of rectangles: "polygon", the exact one, or "centre", as if all came from their centre,
            which is quicker and too bright close by.
        around: how much of the ambient light arrives, times the occlusion maps; None: all of it.

    Phong materials: the diffuse part is Lambert's; the specular part is a lobe about the mirrored eye direction with
    the factor (n + 2) / (2 pi): so normalised, a surface that faces the eye mirrors exactly its specular degree
    whatever the exponent n, and never more at other angles (Lafortune and Willems, *Using the modified Phong
    reflectance model for physically based rendering*, 1994). Metallic-roughness: see :mod:`torchrender.shading.lobes`.
    Unlit materials show their colour. Point and spot lights fall off with the squared distance; area lights use the
    exact irradiance of the rectangle; metallic-roughness mirrors the rectangle as it is (linearly transformed cosines,
    :mod:`torchrender.shading.linear_cosines`), Phong's and sheen's highlights are centred on its centre. A light behind
    the geometric surface gives nothing; cosines use the shading normal. Differentiable in colours, textures and
    intensities.

    Raises:
        InputError: ``visibility``, ``around`` or ``background`` of a wrong shape, or samples that are no image.
        OptionError: another ``area_light``.
    """
    ways = {"background": background, "area_light": area_light, "around": around}
    return sent_light(scene, samples, visibility, mirrors=False, **ways).radiance  # type: ignore[arg-type]


def sent_light(
    scene: Scene,
    samples: GBuffer | RaySurface,
    visibility: Tensor | None = None,
    *,
    background: ArrayLike | None = None,
    area_light: str = "polygon",
    around: AmbientReach | None = None,
    mirrors: bool = True,
    lists: LightLists | None = None,
) -> SentLight:
    """The same with what mirrors need; arguments and errors as of :func:`shade`.

    Samples whose attributes are those of the scene's own triangles go through the compiled kernel, unless an input
    asks for derivatives; others through torch.

    Args:
        mirrors: False leaves the parts that mirrors need without pixels.
        lists: lights that may reach each block of pixels, and for which of them ``visibility`` has images, in their
            order; None: any light any pixel, one image for each.
    """
    check_choice("area_light", area_light, AREA_LIGHTS)
    seen = samples.triangle if isinstance(samples, GBuffer) else samples.covered
    check_tensor("samples.covered", seen, ("B", "H", "W"))
    count, height, width = seen.shape
    if visibility is not None:
        given = len(scene.lights) if lists is None or lists.shaded is None else len(lists.shaded)
        check_tensor("visibility", visibility, (count, given, height, width))
        visibility = visibility.permute(1, 0, 2, 3).reshape(given, count * height * width)
    reach = _flat(around, (count, height, width))
    shape = (count, height, width, 3)
    if is_of(samples, scene) and not wants_gradient(scene, visibility, reach.visibility):
        color = None if background is None else as_vector("background", background)
        sent = send_fused(scene, samples, visibility, reach, (area_light, color, mirrors), lists)
        radiance = sent.radiance.T
    else:
        sent = send(scene, samples, _of_all(scene, visibility, lists), reach, area_light)
        radiance = sent.radiance.T
        covered = samples.covered.reshape(-1)
        if isinstance(samples, GBuffer) and not bool(covered.all()):
            empty = _background(scene, samples.cameras, ~covered, background)
            radiance = torch.where(covered[:, None], radiance, empty)
    if not mirrors:
        none = torch.zeros(0, height, width, 3)
        return SentLight(radiance.reshape(shape), MirrorShare(none, none))
    share = MirrorShare(sent.replaced.T.reshape(shape), sent.mirrored.T.reshape(shape))
    return SentLight(radiance.reshape(shape), share)


def _of_all(scene: Scene, visibility: Tensor | None, lists: LightLists | None) -> Tensor | None:
    """Shadow factors (L,N) of all lights."""
    if visibility is None or lists is None or lists.shaded is None:
        return visibility
    rows = torch.tensor(lists.shaded, dtype=torch.int64)
    return torch.ones(len(scene.lights), visibility.shape[1]).index_copy(0, rows, visibility)


def diffuse_color(scene: Scene, gbuffer: GBuffer) -> Tensor:
    """Diffuse reflectance or base colour (B,H,W,3), textures and vertex colours included; 0 where empty."""
    rows = gbuffer.covered.reshape(-1).nonzero().reshape(-1)
    image = torch.zeros(gbuffer.triangle.numel(), 3)
    if len(rows):
        reader = Reader(scene, gbuffer, torch.zeros(3, dtype=torch.float64))
        image = image.index_copy(0, rows, torch.cat([reader.albedo(chunk).T for chunk in rows.split(CHUNK)]))
    return image.reshape(*gbuffer.triangle.shape, 3)


def _flat(around: AmbientReach | None, shape: tuple[int, int, int]) -> Around:
    if around is None:
        return Around()
    share = check_tensor("around.visibility", around.visibility, shape).reshape(-1)
    if around.bent_normal is None:
        return Around(share)
    return Around(share, check_tensor("around.bent_normal", around.bent_normal, (*shape, 3)).reshape(-1, 3).T)


def _background(scene: Scene, cameras: Cameras, empty: Tensor, color: ArrayLike | None) -> Tensor:
    """An image (B*H*W,3) that holds the background wherever ``empty`` (B*H*W,)."""
    size = cameras.width * cameras.height
    if color is not None or scene.environment is None:
        value = scene.ambient.float() if color is None else as_vector("background", color)
        return value.expand(len(cameras) * size, 3)
    image = torch.zeros(len(cameras) * size, 3)
    for number in range(len(cameras)):
        rows = empty[number * size : (number + 1) * size].nonzero().reshape(-1)
        pixels = torch.stack([rows % cameras.width, rows // cameras.width], dim=-1) + 0.5
        for chunk, part in zip(rows.split(CHUNK), pixels.split(CHUNK)):
            _, direction = cameras[number].rays(part[None])
            unit = torch.nn.functional.normalize(direction[0], dim=-1).float()
            image[number * size + chunk] = scene.environment.background(unit)
    return image
