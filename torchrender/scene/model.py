"""The scene: everything a picture is made of, as one frozen value."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property

import torch
from torch import Tensor

from torchrender.errors import InputError
from torchrender.scene.camera import Cameras, framing_camera
from torchrender.scene.cutout import build_cutout
from torchrender.scene.environment import Environment
from torchrender.scene.files.report import NOTHING, LoadReport
from torchrender.scene.light import DirectionalLight, Light
from torchrender.scene.material import Material
from torchrender.scene.material_table import MaterialTable, wants_gradient
from torchrender.scene.medium import Medium
from torchrender.scene.mesh import Geometry, Mesh, concatenate
from torchrender.scene.motion.records import Motion
from torchrender.scene.motion.update import Moving, at_time, moved_geometry


@dataclass(frozen=True, eq=False, kw_only=True)
class Scene:
    """Meshes, materials, lights, environment, media and named cameras.

    Raises:
        InputError: a mesh names a material that does not exist.
    """

    meshes: tuple[Mesh, ...] = ()
    materials: tuple[Material, ...] = field(default_factory=lambda: (Material(name="default"),))
    lights: tuple[Light, ...] = ()
    environment: Environment | None = None
    ambient: Tensor = field(default_factory=lambda: torch.zeros(3))  # (3,) constant irradiance/pi from everywhere
    media: tuple[Medium, ...] = ()
    cameras: Mapping[str, Cameras] = field(default_factory=dict)  # the first is the default one
    name: str = "scene"
    motions: tuple[Motion, ...] = ()  # what may move: see at()
    photometric: bool = False  # lights are in candela and lux: a picture needs an exposure to match
    report: LoadReport = NOTHING  # what a file was read as

    def __post_init__(self) -> None:
        for name in ("meshes", "materials", "lights", "media", "motions"):
            object.__setattr__(self, name, tuple(getattr(self, name)))
        for mesh in self.meshes:
            if not 0 <= mesh.material < len(self.materials):
                raise InputError(
                    f"mesh {mesh.name!r}: material must be in [0, {len(self.materials) - 1}], got {mesh.material}"
                )

    @cached_property
    def geometry(self) -> Geometry:
        """All triangles in one set of arrays, built on first use."""
        geometry = concatenate(self.meshes)
        if geometry.uv is None:
            return geometry
        return replace(geometry, cutout=build_cutout(self.materials, geometry.material))

    @property
    def material_table(self) -> MaterialTable:
        """The materials' numbers side by side: built once, or anew in each call where a colour wants a gradient."""
        return MaterialTable.of(self.materials) if wants_gradient(self.materials) else self._material_table

    @cached_property
    def _material_table(self) -> MaterialTable:
        with torch.inference_mode(False):  # whoever asks first must not decide what can be derived later
            return MaterialTable.of(self.materials)

    @cached_property
    def reflector_bounds(self) -> Tensor:
        """(N,2,3) float64 bounding boxes of the meshes that mirror."""
        boxes = [
            torch.stack([mesh.vertices.double().amin(0), mesh.vertices.double().amax(0)])
            for mesh in self.meshes
            if self.materials[mesh.material].is_reflector and len(mesh.vertices)
        ]
        return torch.stack(boxes) if boxes else torch.zeros(0, 2, 3, dtype=torch.float64)

    @property
    def bounds(self) -> Tensor:
        """(2,3) float64 bounding box."""
        return self.geometry.bounds

    @property
    def diagonal(self) -> float:
        """Length of the bounding-box diagonal, scene units."""
        low, high = self.bounds
        return float((high - low).norm())

    def camera(self, name: str | None = None, *, width: int, height: int) -> Cameras:
        """The named camera (default: the first one, else one that frames the scene) at the given image size.

        A camera with another aspect ratio keeps its vertical opening angle.

        Raises:
            InputError: no camera of that name; the message lists those there are.
        """
        if name is not None and name not in self.cameras:
            known = ", ".join(self.cameras) or "none"
            raise InputError(f"scene {self.name!r} has no camera {name!r}; known cameras: {known}")
        if not self.cameras:
            return framing_camera(self.geometry.cluster_bounds, width=width, height=height)
        camera = self.cameras[name] if name is not None else next(iter(self.cameras.values()))
        return resized(camera, width, height)

    @property
    def animations(self) -> dict[str, float]:
        """Names of the animations and their durations, seconds."""
        return {a.name: a.duration for m in self.motions for a in m.animations}

    def at(self, time: float | None, animation: str | int | None = None) -> Scene:
        """The scene at a time of an animation, which stands still before its start and after its end.

        Meshes, lights and cameras that do not move stay the same objects, and what was found out about the triangles
        (their order in space, for instance) is kept.

        Args:
            time: seconds; None: the pose that the file stands in.
            animation: its name or number; None: the first one of each file.

        Raises:
            InputError: no such animation, or a time that is not finite.
        """
        old = Moving(self.meshes, self.lights, self.cameras, self.motions)
        new = at_time(old, time, animation)
        scene = replace(self, **new._asdict())
        geometry = moved_geometry(self.geometry, self.meshes, scene.meshes)
        if geometry is not None:
            scene.__dict__["geometry"] = geometry
        if "_material_table" in self.__dict__:
            scene.__dict__["_material_table"] = self._material_table
        return scene

    def with_default_light(self) -> Scene:
        """This scene, or if it has neither lights, environment nor ambient light, a copy lit from the upper left."""
        if self.lights or self.environment is not None or bool((self.ambient > 0).any()):
            return self
        if any(bool((m.emission > 0).any()) for m in self.materials):
            return self
        sun = DirectionalLight(direction=torch.tensor([0.5, -1.0, -0.4]), irradiance=torch.full((3,), 1.9))
        studio = torch.linspace(0.55, 0.15, 16)[:, None, None].expand(16, 2, 3).contiguous()
        lit = replace(self, lights=(sun,), environment=Environment(radiance=studio, name="studio"))
        if "geometry" in self.__dict__:  # the same triangles: nothing to build again
            lit.__dict__["geometry"] = self.geometry
        return lit


def resized(camera: Cameras, width: int, height: int) -> Cameras:
    """The same view at another image size; the vertical opening angle stays, the centre stays in place."""
    if (camera.width, camera.height) == (width, height):
        return camera
    scale = height / camera.height
    k = camera.intrinsics.clone()
    k[:, :2, :2] *= scale
    k[:, 0, 2] = width / 2 + (k[:, 0, 2] - camera.width / 2) * scale
    k[:, 1, 2] = height / 2 + (k[:, 1, 2] - camera.height / 2) * scale
    return replace(camera, intrinsics=k, width=width, height=height)
