"""What casts shadows under the sky: meshes that move or were chosen, and the spheres that stand for them."""

from __future__ import annotations

import hashlib
import logging
from collections.abc import Iterator, Sequence
from dataclasses import astuple, dataclass
from pathlib import Path
from time import perf_counter

import numpy as np
import torch
from torch import Tensor
from torch.utils.weak import WeakIdKeyDictionary

from torchrender.effects.sky_shadows.fit import Progress, SphereSet, fit_spheres
from torchrender.effects.sky_shadows.loosened import loosened
from torchrender.effects.sky_shadows.moving import Binding
from torchrender.effects.sky_shadows.options import SphereOptions
from torchrender.errors import InputError, SceneFileError
from torchrender.images.files import write_npz
from torchrender.kernels.keys import cache_folder
from torchrender.scene.mesh import Mesh
from torchrender.scene.model import Scene
from torchrender.scene.motion.records import Motion, Part

LOG = logging.getLogger("torchrender.sky_shadows")
_KEPT: WeakIdKeyDictionary = WeakIdKeyDictionary()
_ARRAYS = ("centres", "radii", "vertex_sphere", "face_sphere", "inner_radii")
VERSION = 3
POSES, MOST_ANIMATIONS = 8, 4


@dataclass(frozen=True, eq=False)
class Occluder:
    """Meshes of a scene as one set of spheres."""

    meshes: tuple[int, ...]  # places in Scene.meshes
    binding: Binding
    bodies: Tensor  # (S,) int64 number of the body that most of a sphere's triangles belong to

    def spheres(self, scene: Scene) -> Tensor:
        """(S,4) float64 centre and radius, where the scene's meshes are now: together they hold their volume."""
        vertices = torch.cat([scene.meshes[m].vertices.detach().double() for m in self.meshes])
        return self.binding.at(vertices, snug=True)

    def face_spheres(self, scene: Scene) -> Tensor:
        """(F,) int64 by triangle of the scene's geometry: the sphere that it belongs to, -1 for other meshes."""
        runs = scene.geometry.runs
        found = torch.full((scene.geometry.triangle_count,), -1, dtype=torch.int64)
        start = 0
        for m in self.meshes:
            first, end = int(runs[m]), int(runs[m + 1])
            found[first:end] = self.binding.set.face_sphere[start : start + end - first]
            start += end - first
        return found


def moving_meshes(scene: Scene) -> tuple[int, ...]:
    """Places of the meshes that an animation of the scene moves or bends."""
    return tuple(sorted({p.mesh for m in scene.motions if m.animations for p in m.parts if _is_moved(m, p)}))


def _is_moved(motion: Motion, part: Part) -> bool:
    driven = {channel.node for animation in motion.animations for channel in animation.channels}
    nodes = {part.node}
    if part.skin is not None:
        nodes |= {int(j) for j in motion.skins[part.skin].joints}
    while nodes:
        if nodes & driven:
            return True
        nodes = {int(motion.nodes.parents[n]) for n in nodes} - {-1}
    return False


def chosen_meshes(scene: Scene, occluders: str | Sequence[str]) -> tuple[int, ...]:
    """Places of the meshes that shall cast shadows: "moving", "none", or names.

    Raises:
        InputError: no mesh has one of the names; it lists those there are.
    """
    if isinstance(occluders, str):
        return moving_meshes(scene) if occluders == "moving" else ()
    places = []
    for name in occluders:
        found = [k for k, mesh in enumerate(scene.meshes) if mesh.name == name]
        if not found:
            known = ", ".join(sorted({m.name for m in scene.meshes})) or "none"
            raise InputError(f"occluders: the scene has no mesh {name!r}; known meshes: {known}")
        places += found
    return tuple(sorted(set(places)))


def occluder_of(
    scene: Scene, meshes: tuple[int, ...], options: SphereOptions, progress: Progress | None = None
) -> Occluder | None:
    """Spheres for some meshes of a scene, fitted in the pose that their file stands in; None without triangles.

    They are kept: in memory as long as the meshes, and by the meshes' content in the user's cache.
    """
    meshes = tuple(m for m in meshes if len(scene.meshes[m].faces))
    if not meshes:
        return None
    origin = _origin(scene, meshes[0])
    known = _KEPT.setdefault(origin, {})
    key = (meshes, options)
    if key not in known:
        rest = [(scene.at(None) if scene.motions else scene).meshes[m] for m in meshes]
        vertices, faces = joined(rest)
        with torch.inference_mode(False), torch.no_grad():
            fitted = kept_spheres(vertices, faces, options, progress)
            spheres = loosened(
                fitted, vertices, faces, [joined([s.meshes[m] for m in meshes])[0] for s in _poses(scene)]
            )
            known[key] = Occluder(meshes, Binding(spheres, vertices, faces), _bodies(scene, meshes, spheres))
    made: Occluder = known[key]
    return made


def _bodies(scene: Scene, meshes: tuple[int, ...], spheres: SphereSet) -> Tensor:
    """Meshes that hang from one node are a body, such as a figure of limbs; every other mesh is one of its own."""
    above: dict[int, tuple[int, int]] = {}
    for number, motion in enumerate(scene.motions):
        for part in motion.parts:
            node = part.node if part.skin is None else int(motion.skins[part.skin].joints[0])
            while int(motion.nodes.parents[node]) >= 0:
                node = int(motion.nodes.parents[node])
            above[part.mesh] = (number, node)
    names = [above.get(mesh, (-1, mesh)) for mesh in meshes]
    known = {name: number for number, name in enumerate(dict.fromkeys(names))}
    sizes = torch.tensor([len(scene.meshes[mesh].faces) for mesh in meshes])
    body = torch.tensor([known[name] for name in names]).repeat_interleave(sizes)
    count = len(spheres.radii)
    triangles = torch.zeros(count, len(known), dtype=torch.int64)
    triangles.index_put_((spheres.face_sphere, body), torch.ones_like(body), accumulate=True)
    return triangles.argmax(dim=1)


def _poses(scene: Scene) -> Iterator[Scene]:
    """The scene at times of its animations, as many as tell which parts go together."""
    for name, duration in list(scene.animations.items())[:MOST_ANIMATIONS]:
        for number in range(POSES):
            yield scene.at(duration * (number + 0.5) / POSES, name)


def _origin(scene: Scene, mesh: int) -> object:
    """What stays the same object while a mesh moves."""
    for motion in scene.motions:
        for part in motion.parts:
            if part.mesh == mesh:
                return part.shape
    return scene.meshes[mesh]


def joined(meshes: Sequence[Mesh]) -> tuple[Tensor, Tensor]:
    """Vertices (V,3) float64 and faces (F,3) of several meshes as one."""
    starts = np.cumsum([0] + [len(m.vertices) for m in meshes])
    vertices = torch.cat([m.vertices.detach().double() for m in meshes])
    return vertices, torch.cat([m.faces.long() + int(s) for m, s in zip(meshes, starts)])


def kept_spheres(
    vertices: Tensor, faces: Tensor, options: SphereOptions, progress: Progress | None = None
) -> SphereSet:
    """Spheres of a mesh from the user's cache, by content; else fitted, and kept there where it can be written."""
    folder = cache_folder() / "sky_shadows"
    file = folder / f"spheres_{content_key(vertices, faces, options)}.npz"
    try:
        found = read_spheres(file)
        if len(found.vertex_sphere) == len(vertices) and len(found.face_sphere) == len(faces):
            return found
    except SceneFileError:
        pass  # none yet, or a damaged one: fitted anew
    begin = perf_counter()
    made = fit_spheres(vertices, faces, options, progress)
    LOG.info("fitted %d spheres to %d triangles in %.1f s, once", len(made.radii), len(faces), perf_counter() - begin)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        write_spheres(file, made)
    except (OSError, SceneFileError) as error:
        LOG.info("they are not kept: %s", error)
    return made


def content_key(vertices: Tensor, faces: Tensor, options: SphereOptions) -> str:
    """Of a mesh and of how spheres are fitted to it."""
    told = hashlib.sha256(repr((VERSION, astuple(options), vertices.shape, faces.shape)).encode())
    told.update(vertices.detach().double().contiguous().numpy().tobytes())
    told.update(faces.long().contiguous().numpy().tobytes())
    return told.hexdigest()[:32]


def write_spheres(path: str | Path, spheres: SphereSet) -> None:
    """Write a set to an NPZ file: centres, radii, the sphere of every vertex and triangle."""
    numbers = {
        "error": np.array(spheres.error), "volume": np.array(spheres.volume), "margin": np.array(spheres.margin),
        "history": np.array(spheres.history),
    }  # fmt: skip
    write_npz(path, {**{name: getattr(spheres, name) for name in _ARRAYS}, **numbers})


def read_spheres(path: str | Path) -> SphereSet:
    """Read a set that :func:`write_spheres` wrote.

    Raises:
        SceneFileError: no such file, or one that holds something else.
    """
    try:
        with np.load(path, allow_pickle=False) as data:
            arrays = {name: torch.from_numpy(np.array(data[name])) for name in _ARRAYS}
            error, volume, margin = (float(data[name]) for name in ("error", "volume", "margin"))
            history = tuple(data["history"].tolist())
    except FileNotFoundError:
        raise SceneFileError(path, "there is no such file") from None
    except (OSError, ValueError, KeyError, EOFError, TypeError) as reason:
        raise SceneFileError(path, f"no set of spheres: {reason}") from None
    count = len(arrays["radii"])
    labels = torch.cat([arrays["vertex_sphere"], arrays["face_sphere"]])
    if arrays["centres"].shape != (count, 3) or (
        len(labels) and not 0 <= int(labels.min()) <= int(labels.max()) < count
    ):
        raise SceneFileError(path, "no set of spheres: its arrays do not belong together")
    return SphereSet(**arrays, error=error, volume=volume, margin=margin, history=history)
