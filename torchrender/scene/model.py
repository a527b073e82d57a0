"""The scene: everything a picture is made of, as one frozen value."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cache, cached_property
from typing import Any

import torch
from torch import Tensor

from torchrender.brief import brief, brief_html
from torchrender.checks import as_vector, check_flag, check_name, check_not_negative
from torchrender.errors import InputError
from torchrender.scene.camera import Cameras, framing_camera
from torchrender.scene.cameras.record import sides as sides
from torchrender.scene.cutout import Corners, build_cutout
from torchrender.scene.environment import Environment
from torchrender.scene.files.report import NOTHING, LoadReport
from torchrender.scene.light import DirectionalLight, Light, light_color
from torchrender.scene.material import Material
from torchrender.scene.material_table import MaterialTable, wants_gradient
from torchrender.scene.medium import Medium
from torchrender.scene.mesh import Geometry, Mesh, concatenate
from torchrender.scene.motion.records import Motion
from torchrender.scene.motion.update import Moving, at_time, moved_geometry
from torchrender.scene.parts.emission import emitted_mean
from torchrender.scene.parts.kinds import (
    KINDS,
    check_parts,
    check_unchanged,
    color_versions,
    nearest_names,
    several,
    versions,
)
from torchrender.scene.parts.tangents import normal_map_set, with_tangents

DEFAULT_SIZE = (1024, 768)
"""Of pictures whose size nobody says: width and height in pixels."""
FOUND: Mapping[str, frozenset[str]] = {
    "geometry": frozenset({"meshes", "materials"}),
    "_versions": frozenset({"meshes", "materials"}),  # of the meshes, when their triangles were gathered
    "_material_table": frozenset({"materials"}),
    "reflector_bounds": frozenset({"meshes", "materials"}),
}
"""What is found out about a scene on first use, and the fields that it depends on."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Scene:
    """Meshes, materials, lights, environment, media and named cameras.

    Raises:
        InputError: a mesh names a material that does not exist, ambient light that is not finite or negative, parts
            that are not what their name says.
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
    photo_light: bool = False  # colours are of photos, ambient light and its shadows in them: nothing hides it again
    report: LoadReport = NOTHING  # what a file was read as

    __repr__ = brief
    _repr_html_ = brief_html

    def __post_init__(self) -> None:
        check_name("name of a scene", self.name)
        check_flag("photometric", self.photometric)
        for name, kind in KINDS.items():
            object.__setattr__(self, name, several(name, getattr(self, name), kind))
        object.__setattr__(self, "ambient", check_not_negative("ambient", as_vector("ambient", self.ambient)))
        check_parts(self.meshes, len(self.materials), self.environment, self.cameras)

    def __getstate__(self) -> dict[str, Any]:
        # Copies count anew how often their arrays are written to.
        return {name: value for name, value in self.__dict__.items() if name not in ("_versions", "_material_table")}

    @cached_property
    def geometry(self) -> Geometry:
        """All triangles in one set of arrays, built on first use: meshes must stay as they are from then on."""
        self.__dict__["_versions"] = versions(self.meshes)
        geometry = self._tangential(concatenate(self.meshes))
        panes = torch.tensor([m.is_see_through for m in self.materials] or [False])[geometry.material]
        if bool(panes.any()):
            geometry = replace(geometry, see_through=panes)
        single = torch.tensor([not m.double_sided for m in self.materials] or [False])[geometry.material]
        if bool(single.any()):
            geometry = replace(geometry, single_sided=single)
        corners = Corners(geometry.faces, geometry.uv, geometry.uv1, geometry.alpha)
        cutout = build_cutout(self.materials, geometry.material, corners, len(geometry.vertices))
        return geometry if cutout is None else replace(geometry, cutout=cutout)

    def _tangential(self, geometry: Geometry) -> Geometry:
        """With tangents where triangles have normal maps."""
        sets = torch.tensor([normal_map_set(m) for m in self.materials] or [-1])
        return with_tangents(geometry, sets[geometry.material])

    @property
    def material_table(self) -> MaterialTable:
        """The materials' numbers side by side: built once, or anew in each call where a colour wants a gradient, and
        after colours were written to in place."""
        if wants_gradient(self.materials):
            return MaterialTable.of(self.materials)
        now = color_versions(self.materials)
        known: tuple[tuple[int, ...], MaterialTable] | None = self.__dict__.get("_material_table")
        if known is None or known[0] != now:
            with torch.inference_mode(False):  # whoever asks first must not decide what can be derived later
                known = self.__dict__["_material_table"] = now, MaterialTable.of(self.materials)
        return known[1]

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
    def is_lit(self) -> bool:
        """Something lights it: a light, an environment, ambient light, or surfaces that shine brightly on the whole.

        A lamp that merely glows lights nothing: light that surfaces emit counts by its mean over all surfaces. Where
        all surfaces are unlit nothing asks for light.
        """
        if self.meshes and all(self.materials[mesh.material].unlit for mesh in self.meshes):
            return True
        if any(bool((light_color(light) > 0).any()) for light in self.lights) or bool((self.ambient > 0).any()):
            return True
        if self.environment is not None and self.environment.intensity > 0:
            return bool((self.environment.radiance > 0).any())
        return emitted_mean(self.meshes, self.materials) >= BRIGHT

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
            animation: its name or number; None: the one that was named last, at first the first one of each file.

        Raises:
            InputError: no such animation, or a time that is not finite.
        """
        old = Moving(self.meshes, self.lights, self.cameras, self.motions)
        new = at_time(old, time, animation)
        return self._followed_by(self._with(**new._asdict()))

    def _followed_by(self, scene: Scene) -> Scene:
        """``scene``, whose meshes are these at other places, with what was found out about them."""
        geometry = moved_geometry(self.geometry, self.meshes, scene.meshes)
        if geometry is not None:
            scene.__dict__["geometry"] = scene._tangential(geometry)
            scene.__dict__["_versions"] = versions(scene.meshes)
        return scene

    def looped(self, seconds: float) -> float:
        """The time of :meth:`at` after so many seconds, if what plays there plays again and again."""
        playing = [m.animation(None) for m in self.motions]
        length = max((one.duration for one in playing if one is not None), default=0.0)
        return seconds % length if length > 0 else 0.0

    # --------------------------------------------------------------- editing

    def replace(self, **changes: Any) -> Scene:
        """A copy with other lights, meshes, cameras …, by the names of the fields; what was found out about the scene
        and depends on none of these is kept."""
        unknown = sorted(set(changes) - {one.name for one in fields(self)})
        if unknown:
            known = ", ".join(one.name for one in fields(self))
            raise InputError(f"a scene has no {', '.join(unknown)}; it has {known}")
        made = self._with(**changes)
        if made.__dict__.get("_versions") not in (None, versions(made.meshes)):  # a new scene shows what was written to
            for name in ("geometry", "_versions", "reflector_bounds"):
                made.__dict__.pop(name, None)
        return made

    def _with(self, **changes: Any) -> Scene:
        """:meth:`replace` of known fields; arrays that were written to are refused as they are here."""
        made = replace(self, **changes)
        changed = {name for name in changes if getattr(made, name) is not getattr(self, name)}
        for name, fields_of in FOUND.items():
            if name in self.__dict__ and not changed & fields_of:
                made.__dict__[name] = self.__dict__[name]
        return made

    def parts(self, name: str) -> tuple[Mesh, ...]:
        """The meshes of an object: those of that name, and its parts by material, ``"armchair/fabric"``.

        Raises:
            InputError: there is none; the message names the nearest ones.
        """
        check_name("name of an object", name)
        found = tuple(mesh for mesh in self.meshes if mesh.name == name or mesh.name.startswith(f"{name}/"))
        if not found:
            objects = list(dict.fromkeys(mesh.name.partition("/")[0] for mesh in self.meshes))
            raise InputError(f"scene {self.name!r} has no mesh {name!r}; there are {nearest_names(name, objects)}")
        return found

    def mesh(self, name: str) -> Mesh:
        """The mesh of that name; an object of several materials has :meth:`parts`.

        Raises:
            InputError: none or several.
        """
        found = self.parts(name)
        if len(found) > 1:
            raise InputError(f"{name!r} has {len(found)} parts: {', '.join(mesh.name for mesh in found)}; use parts()")
        return found[0]

    def moved(self, name: str, matrix: Tensor | Sequence[Sequence[float]]) -> Scene:
        """An object (:meth:`parts`) turned and moved by a (4,4) matrix from where it stands now.

        Everything else stays the same object, so that a sequence of pictures keeps what was made for it.

        Raises:
            InputError: no such object. MeshError: a matrix that is not affine or not invertible.
        """
        chosen = {id(mesh) for mesh in self.parts(name)}
        meshes = [mesh.transformed(matrix) if id(mesh) in chosen else mesh for mesh in self.meshes]
        return self.with_meshes(meshes)

    def with_meshes(self, meshes: Sequence[Mesh]) -> Scene:
        """This scene with other meshes; where only vertices moved, what was found out about the triangles is kept."""
        return self._followed_by(self._with(meshes=several("meshes", meshes, (Mesh,))))

    def with_default_light(self) -> Scene:
        """This scene, or if nothing really lights it (:attr:`is_lit`), a copy lit from the upper left."""
        if self.is_lit:
            return self
        sun, sky = _studio()
        return self._with(lights=(sun,), environment=sky)

    def with_sun_apart(self) -> Scene:
        """This scene, or if its environment shows a sun, a copy in which that is a light and casts shadows."""
        if self.environment is None:
            return self
        rest, sun = self.environment.split_sun()
        return self if sun is None else self._with(lights=(*self.lights, sun), environment=rest)

    def check_unchanged(self) -> None:
        """Refuse arrays of meshes that were written to after the triangles were gathered: nothing would show it.

        Raises:
            InputError: names the mesh and the array.
        """
        check_unchanged(self.name, self.meshes, self.__dict__.get("_versions"))


BRIGHT = 0.5
"""Mean radiance that surfaces emit, from which on a scene needs no other light."""


@cache
def _studio() -> tuple[DirectionalLight, Environment]:
    """What lights a scene without light: a sun, and a sky brighter from above. Kept: what is made of them lasts."""
    with torch.inference_mode(False):
        sun = DirectionalLight(direction=torch.tensor([0.5, -1.0, -0.4]), irradiance=torch.full((3,), 1.9))
        radiance = torch.linspace(0.55, 0.15, 16)[:, None, None].expand(16, 2, 3).contiguous()
        return sun, Environment(radiance=radiance, fill=True, name="studio")


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
