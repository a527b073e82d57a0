"""Views through panes: their light over the pixels of a picture that are shaded one by one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from torchrender.buffers import VisibilityBuffer
from torchrender.effects.transparency.before import told_apart
from torchrender.effects.transparency.layers import LayerShader, Rays, deepest_layers, layers_along
from torchrender.effects.upsampling.carried import LitPicture, MirroredLight
from torchrender.image import Image
from torchrender.passes.mirrors.hit_shader import HIT_SHADER
from torchrender.passes.picture.scattering import SCATTERING
from torchrender.passes.picture.transparency import layer_shader
from torchrender.pipeline.history import RenderHistory
from torchrender.pipeline.options import RenderOptions
from torchrender.raster import rasterize_visibility
from torchrender.rays import RayCaster
from torchrender.scene.camera import Cameras
from torchrender.scene.model import Scene
from torchrender_service.renderers.streaming.haze import Haze, is_hazy
from torchrender_service.renderers.streaming.layers import MIRRORS_NEED, Layer
from torchrender_service.renderers.streaming.samples import joined, rays_to

CARRYING_NEEDS = (*MIRRORS_NEED, SCATTERING.name)
"""Buffers that a picture must carry whose light is carried."""
HIDDEN = -2
"""Object that no pixel shows."""
VARYING = ("diffuse_texture", "transmission_texture", "normal_texture", "metallic_roughness_texture")


@dataclass(frozen=True, eq=False)
class Glass:
    """The panes of a scene, and who tells their own light."""

    panes: RayCaster
    shader: LayerShader
    layers: int  # that count before each other

    @classmethod
    def of(cls, scene: Scene, past: RenderHistory, options: RenderOptions) -> Glass | None:
        """None where there are no panes, or no picture of the scene has left what tells the light of hits."""
        if options.transparency == "off" or scene.geometry.see_through is None:
            return None
        shader = past.of_scene(scene).get(HIT_SHADER)
        if shader is None:
            return None
        return cls(RayCaster(scene.geometry.panes), layer_shader(shader), options.transparent_layers)

    def over(self, scene: Scene, seen: VisibilityBuffer, rows: Tensor, light: Tensor) -> Tensor:
        """The light (N,3) of some pixels of one eye through the panes before them.

        Args:
            seen: (B,H,W) of perspective cameras that look from one place into one direction.
            rows: (N,) int64 flat places of the pixels, in order.
            light: (N,3) of what these pixels see without panes.
        """
        origins, directions = rays_to(seen, rows)
        camera = seen.cameras[0]
        lengths = directions.norm(dim=-1)
        width = camera.footprint(torch.ones(1, 1, dtype=torch.float64)).reshape(-1).expand(len(rows)) / lengths
        rays = Rays(origins, directions / lengths[:, None], torch.zeros_like(lengths), width, len(rows))
        limit = seen.depth.reshape(-1)[rows].double() * lengths
        added, passing = layers_along(scene, self.panes, rays, limit, self.shader, layers=self.layers)
        return light * passing + added


@dataclass(frozen=True, eq=False)
class Base:
    """The first of several pictures of a view at rest. The others are of what is shown of it, H x W pixels."""

    picture: LitPicture  # all of it
    seen: VisibilityBuffer  # (1,H,W)
    haze: Haze | None  # (H,W)
    busy: Tensor  # (H,W) bool: its neighbours do not tell what lies between them


@dataclass(frozen=True, eq=False)
class View:
    """What one camera sees."""

    seen: VisibilityBuffer  # (1,H,W)
    apart: VisibilityBuffer  # the same, parts of objects named by the panes before them, too
    glass: Glass | None
    haze: Haze | None

    @classmethod
    def of(
        cls,
        scene: Scene,
        camera: Cameras,
        options: RenderOptions,
        past: RenderHistory,
        near: Base | None = None,
        *,
        moving: bool = False,
    ) -> View | None:
        """Drawn now. None where no picture before left what its panes or media need.

        Args:
            near: a picture less than a pixel aside, whose media serve.
            moving: another picture follows soon.
        """
        glass = Glass.of(scene, past, options)
        haze: Haze | None = None
        if glass is None and looks_through(scene, camera, options):
            return None
        seen = rasterize_visibility(scene.geometry, camera)
        if is_hazy(scene, camera, options):
            if near is not None and near.haze is not None:
                haze = near.haze.spread(scene, near.seen, seen)
            else:
                haze = Haze.of(scene, seen, options, past, moving=moving)
            if haze is None:
                return None
        return cls(seen, seen if glass is None else told_apart(scene, seen), glass, haze)

    def bare(self, light: Tensor, chosen: Tensor) -> Tensor:
        """The light (N,3) of chosen pixels (H,W) without what media put before them."""
        return light if self.haze is None else self.haze.behind(light, chosen)

    def hazed(self, light: Tensor) -> Tensor:
        """The light (H,W,3) of all that is seen, with what media put before it."""
        return light if self.haze is None else self.haze.before(light)

    @property
    def filled(self) -> Tensor:
        """(H,W) bool: a surface, or a pane, is there."""
        return self.seen.covered[0] | self.behind

    @property
    def behind(self) -> Tensor:
        """(H,W) bool: something is seen through panes."""
        return (self.apart.object_id != self.seen.object_id)[0]


def through_panes(scene: Scene, views: Sequence[View], chosen: Sequence[Tensor], light: Sequence[Tensor]) -> None:
    """Let the light (H,W,3) of chosen pixels (H,W) of one eye's views pass the panes before these, and add theirs."""
    glass = views[0].glass
    if glass is None:
        return
    places = [own & view.behind for own, view in zip(chosen, views, strict=True)]
    rows = torch.cat([own.reshape(-1) for own in places]).nonzero()[:, 0]
    if not len(rows):
        return
    own = torch.cat([image[at] for image, at in zip(light, places, strict=True)])
    made = glass.over(scene, joined([view.seen for view in views]), rows, own)
    for image, at, part in zip(light, places, made.split([int(at.sum()) for at in places]), strict=True):
        image[at] = part


def lit_picture(image: Image, light: Tensor, mirrors: Layer | None) -> LitPicture:
    """A picture whose light (H,W,3) may be carried, without what media put before it.

    What mirrors show through panes stays painted on the mirrors.
    """
    seen, haze = image.visibility, Haze.of_image(image)
    apart, shown = told_apart(image.scene, seen), None
    if haze is not None:
        light = haze.behind(light)
        apart = replace(apart, object_id=torch.where(haze.thick, HIDDEN, apart.object_id))
    if mirrors is not None:
        clear = (apart.object_id == seen.object_id)[0]  # of what is hidden none is looked for
        known = mirrors.known & clear
        shown = MirroredLight(mirrors.depth, torch.where(clear[..., None], mirrors.radiance, 0.0), known)
    return LitPicture(apart, light, shown)


def looks_through(scene: Scene, camera: Cameras, options: RenderOptions) -> bool:
    """Whether something that shows what lies behind is in view."""
    through = options.transparency != "off" and scene.geometry.see_through is not None
    return through and deepest_layers(scene, camera, most=1) > 0


def veiled(scene: Scene, camera: Cameras, options: RenderOptions) -> bool:
    """Whether a view looks through what is nobody's surface and differs from ray to ray: panes with a texture, or panes
    in media. Light behind these cannot be carried."""
    return looks_through(scene, camera, options) and (not _is_even(scene) or is_hazy(scene, camera, options))


def _is_even(scene: Scene) -> bool:
    """Whether panes are alike all over: what lies behind may then keep its light while it is behind the same ones."""
    panes = [material for material in scene.materials if material.is_see_through]
    return not any(getattr(material, name) is not None for material in panes for name in VARYING)
