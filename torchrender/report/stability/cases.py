"""The catalogue of hard scenes and cameras that every effect is run over, as data.

A new case is one more record. Every case has two cameras, so that batches are always in play.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import torch
from torch import Tensor

from torchrender.buffers import GBuffer
from torchrender.effects.reflections.reflectors import ReflectivePixels, reflective_pixels
from torchrender.passes.hard import SMALL_SHADOW
from torchrender.pipeline.hit_shader import HitShader
from torchrender.pipeline.options import RenderOptions
from torchrender.raster import rasterize
from torchrender.rays import RayCaster
from torchrender.report.common.hits import hit_shader
from torchrender.report.stability import scenes as make
from torchrender.scene.camera import Cameras
from torchrender.scene.light import DirectionalLight, Light, PointLight, RectLight, SpotLight
from torchrender.scene.model import Scene
from torchrender.shading.lights import NEAREST_SQUARE

BASE = "studio"
TINY, HUGE = 2.0**-20, 2.0**20  # about a millionth and a million; powers of two scale without rounding
FAR = (786432.0, -655360.0, 917504.0)  # float32 steps there are 1/16
ODD, ASIDE = 100.0 * math.sqrt(3.0), (math.sqrt(2.0) * 10.0, -math.pi * 3.0, math.e * 5.0)  # nothing stays exact


@dataclass(frozen=True, eq=False, kw_only=True)
class Case:
    """A scene and its cameras, with what several effects take from them, made on first use."""

    scene: Scene
    cameras: Cameras
    unit: float = 1.0  # scene units per unit of the case that must look the same

    @cached_property
    def gbuffer(self) -> GBuffer:
        """What the cameras see."""
        return rasterize(self.scene, self.cameras)

    @cached_property
    def caster(self) -> RayCaster:
        """Rays into the scene."""
        return RayCaster(self.scene.geometry)

    @cached_property
    def pixels(self) -> ReflectivePixels:
        """Pixels that mirror."""
        return reflective_pixels(self.scene, self.gbuffer)

    @cached_property
    def shader(self) -> HitShader:
        """Colours of what rays hit."""
        return hit_shader(self.scene, RenderOptions(shadow=SMALL_SHADOW, area_shadows="hard"))

    @property
    def area_lights(self) -> list[RectLight]:
        """The rectangular lights."""
        return [light for light in self.scene.lights if isinstance(light, RectLight)]

    @cached_property
    def radiance_limit(self) -> float:
        """No surface can send more than this: all lights at once, as near and as straight as the shader allows.

        ``emission + surroundings + albedo/pi E + specular (n + 2)/(2 pi) E``, E the irradiance of all lights.
        """
        arriving = sum(_irradiance_limit(light, self.scene) for light in self.scene.lights)
        surrounding = float(self.scene.ambient.max())
        if self.scene.environment is not None:
            surrounding += float(self.scene.environment.radiance.max()) * self.scene.environment.intensity
        most = 0.0
        for material in self.scene.materials:
            lobe = material.specular * float(material.specular_color.max()) * (material.shininess + 2.0)
            sent = float(material.diffuse.max()) * (surrounding + arriving / math.pi)
            most = max(most, float(material.emission.max()) + sent + lobe * arriving / (2.0 * math.pi))
        return 1.001 * (most + surrounding)

    def with_cameras(self, cameras: Cameras) -> Case:
        """The same scene, seen by others."""
        return replace(self, cameras=cameras)

    def stored(self, dtype: torch.dtype, *, rounded: bool) -> Case:
        """With vertices of this type; ``rounded``: after they went through float32."""

        def vertices(value: Tensor) -> Tensor:
            return (value.float() if rounded else value).to(dtype)

        meshes = tuple(replace(mesh, vertices=vertices(mesh.vertices)) for mesh in self.scene.meshes)
        return replace(self, scene=replace(self.scene, meshes=meshes))


def _irradiance_limit(light: object, scene: Scene) -> float:
    if isinstance(light, RectLight):
        return math.pi * float(light.radiance.max())
    if isinstance(light, DirectionalLight):
        return float(light.irradiance.max())
    # No nearer than the nearest corner, and a margin for what lies between corners.
    corners = scene.geometry.vertices[scene.geometry.faces.reshape(-1).long().unique()]
    nearest = float((corners - light.position).norm(dim=-1).min()) / 10 if len(corners) else 1.0  # type: ignore[attr-defined]
    return float(light.intensity.max()) / max(nearest**2, NEAREST_SQUARE)  # type: ignore[attr-defined]


@dataclass(frozen=True, kw_only=True)
class HardCase:
    """One scene with its cameras."""

    name: str
    why: str  # what is difficult
    scene: Callable[[], Scene] = make.studio
    views: Callable[[], Cameras] = make.views
    twin: str | None = None  # name of the case that must look the same
    matrix: Callable[[], Tensor] | None = None  # similarity (4,4) that everything goes through
    unit: float = 1.0  # scale of the matrix
    rounds: bool = False  # no coordinate stays exact
    turned: bool = False  # the axes of the world are other ones than the twin's
    about: str = "scene"  # where it differs from the first case: "scene", only "view", or only "light"

    def subject(self) -> Case:
        """Built anew at each call."""
        scene, cameras = self.scene(), self.views()
        if self.matrix is not None:
            scene, cameras = make.placed(scene, cameras, self.matrix())
        return Case(scene=scene, cameras=cameras, unit=self.unit)


def _point(*position: float) -> PointLight:
    return PointLight(position=torch.tensor(position), intensity=torch.full((3,), 15.0))


def _seen(name: str, why: str, **options: Any) -> HardCase:
    """The studio, seen in another way."""
    return HardCase(name=name, why=why, about="view", views=lambda: make.views(**options))


def _through(name: str, why: str, **changes: Any) -> HardCase:
    """The studio, seen by other cameras at the usual places."""
    return HardCase(name=name, why=why, about="view", views=lambda: replace(make.views(), **changes))


def _lit(name: str, why: str, *lights: Light | None) -> HardCase:
    """The studio under other lights."""
    return HardCase(name=name, why=why, about="light", scene=lambda: make.studio(*lights))


def _spot(intensity: float = 60.0) -> SpotLight:
    towards = torch.tensor([-0.5, -1.0, -0.7])
    return SpotLight(position=torch.tensor([1.5, 4.5, 2.0]), direction=towards, intensity=torch.full((3,), intensity))


def _sun(irradiance: float = 3.0) -> DirectionalLight:
    return DirectionalLight(direction=torch.tensor([0.4, -1.0, -0.3]), irradiance=torch.full((3,), irradiance))


SKEWED = torch.tensor([[23.0, 1.7, 14.3], [0.0, 17.0, 7.1], [0.0, 0.0, 1.0]], dtype=torch.float64)
PARALLEL = torch.tensor([[3.3, 0.2, 12.7], [0.0, 2.7, 9.4], [0.0, 0.0, 1.0]], dtype=torch.float64)


def _triangle() -> Scene:
    return make.lit(make.soup(torch.tensor([[[-2.0, 0.0, 0.0], [2.0, 0.0, 0.0], [0.0, 3.0, 0.0]]]), make.MIRROR))


def _in_a_ball() -> Scene:
    return make.lit(make.ball(2.0, (0.0, 1.0, 0.0), make.CHROME, 14), make.floor())


CASES = (
    HardCase(name=BASE, why="nothing: the scene that others are compared with"),
    HardCase(name="empty", why="no triangles", scene=lambda: make.lit()),
    HardCase(name="one triangle", why="a single mirror triangle", scene=_triangle),
    HardCase(name="degenerate", why="points, lines, needles, edge-on triangles", scene=make.degenerate),
    HardCase(name="coincident", why="2000 copies of one triangle and one of another material", scene=make.coincident),
    HardCase(name="coplanar", why="sheets that overlap in one plane", scene=make.coplanar),
    HardCase(name="far away", why="a million units from the origin", matrix=lambda: make.shifted(*FAR), twin=BASE),
    HardCase(name="tiny", why="scale 1e-6", matrix=lambda: make.scaled(TINY), unit=TINY, twin=BASE),
    HardCase(name="huge", why="scale 1e6", matrix=lambda: make.scaled(HUGE), unit=HUGE, twin=BASE),
    HardCase(name="turned", why="no axis and no coordinate is round", matrix=make.turned, twin=BASE, turned=True),
    HardCase(name="odd scale", why="a factor that rounds every coordinate", matrix=lambda: make.scaled(ODD), unit=ODD,
             twin=BASE, rounds=True),
    HardCase(name="odd place", why="a shift that rounds every coordinate", matrix=lambda: make.shifted(*ASIDE),
             twin=BASE, rounds=True),
    HardCase(name="all sizes", why="coordinates from 1e-8 to 1e8 in one scene", scene=make.all_sizes),
    HardCase(name="facing mirrors", why="mirrors that mirror each other", scene=make.facing_mirrors,
             views=lambda: make.views((0.5, 2.0, 3.0), (0.0, 1.0, -3.0))),
    HardCase(name="touching", why="a reflector that touches a mirror and the floor", scene=make.touching),
    HardCase(name="broken balls", why="missing and inverted faces", scene=make.broken_balls),
    HardCase(name="inside out", why="all faces inverted", scene=make.inside_out),
    HardCase(name="fan", why="pixel centres exactly on the vertices of a wall", scene=make.fan, views=make.fan_views),
    HardCase(name="grazing", why="a plane seen at less than a thousandth of a degree", scene=make.plain,
             views=lambda: make.views((0.5, 1e-2, 900.0), (0.0, 1e-2, 0.0))),
    HardCase(name="inside geometry", why="the eye in a closed glossy ball cut by the floor", scene=_in_a_ball,
             views=lambda: make.views((0.25, 1.0, 0.5), (-1.0, 0.5, 0.0), near=1e-6)),
    _seen("eye on a vertex", "the eye on a corner of the block",
          eye=(-1.0, 1.5, 0.0), target=(0.0, 0.5, -2.0), near=1e-6),
    _seen("eye on mirror plane", "the eye exactly in the plane of the mirror",
          eye=(-6.0, 2.0, -3.0), target=(0.0, 1.0, -2.0)),
    _seen("along an edge", "the view runs along an edge of the block, in the plane of a side",
          eye=(-1.0, 1.5, 6.0), target=(-1.0, 1.5, 0.0)),
    _seen("one pixel", "1 x 1", size=(1, 1)),
    _seen("one row", "97 x 1", size=(97, 1)),
    _seen("one column", "1 x 97", size=(1, 97)),
    _seen("75 x 64", "sides that are no powers of two, nor equal", size=(75, 64)),
    _seen("96 x 72", "as many pixels as tiles, lattices and filters go over into each other", size=(96, 72)),
    _through("skewed", "no square pixels, a skew, a principal point aside", intrinsics=SKEWED.expand(2, 3, 3)),
    _through("parallel", "an orthographic view, skewed", intrinsics=PARALLEL.expand(2, 3, 3), orthographic=True,
             far=torch.tensor(60.0, dtype=torch.float64)),
    _seen("narrow view", "an opening angle of 0.001 degrees", fov_deg=1e-3),
    _seen("wide view", "an opening angle of 178 degrees", fov_deg=178.0, eye=(0.0, 1.0, 2.0)),
    _seen("near plane tiny", "near 1e-12", near=1e-12),
    _seen("near plane in scene", "the near plane cuts the block", near=6.5),
    _seen("near plane beyond", "nothing lies behind the near plane", near=1e9),
    _lit("light in geometry", "both lights inside the block",
         make.rect((-1.75, 0.5, -0.75), (0.5, 0.0, 0.0), (0.0, 0.0, 0.5)), _point(-1.5, 0.75, -0.5)),
    _lit("light on surface", "area light in the floor, point light on the block",
         make.rect((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, -1.0)), _point(-1.5, 1.5, -0.5)),
    _lit("light behind", "lights below the floor and behind the wall",
         make.rect((-1.0, -2.0, -1.0), (2.0, 0.0, 0.0), (0.0, 0.0, 2.0)), _point(0.0, 2.0, -5.0)),
    _lit("zero-size light", "area lights that are a point and a line",
         make.rect((0.0, 4.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)),
         make.rect((-1.0, 4.0, 0.0), (2.0, 0.0, 0.0), (0.0, 0.0, 0.0))),
    _lit("spot and sun", "a cone of light and parallel light", _spot(), _sun()),
    _lit("a million", "lights a million times as bright", _spot(6e7), _sun(3e6)),
    _lit("one place", "three lamps in one place", *[_point(2.0, 4.0, 3.0)] * 3),
    _lit("no light", "a scene with ambient light alone", None),
)  # fmt: skip

BY_NAME = {case.name: case for case in CASES}
