"""A moving scene at another time: what moves is made anew, everything else stays the same object."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import fields, replace
from numbers import Real
from typing import NamedTuple

import numpy as np
import torch

from torchrender.errors import InputError
from torchrender.scene.camera import Cameras
from torchrender.scene.light import Light
from torchrender.scene.mesh import Geometry, Mesh
from torchrender.scene.motion.attach import camera_at, light_at
from torchrender.scene.motion.deform import placed
from torchrender.scene.motion.pose import posed
from torchrender.scene.motion.records import Array, Motion, Part
from torchrender.scene.motion.refit import refitted


class Moving(NamedTuple):
    """What a time changes in a scene."""

    meshes: tuple[Mesh, ...]
    lights: tuple[Light, ...]
    cameras: Mapping[str, Cameras]
    motions: tuple[Motion, ...]


def at_time(state: Moving, time: float | None, animation: str | int | None) -> Moving:
    """The state at a time in seconds of an animation, ``None``: in rest.

    Raises:
        InputError: no file of the scene has that animation; a time that is not finite.
        MeshError: vertices that are NaN or infinite in this pose.
    """
    if time is not None and not (isinstance(time, Real) and math.isfinite(time)):
        raise InputError(f"time must be a finite number of seconds, got {time!r}")
    having = [knows(m, animation) for m in state.motions]
    if animation is not None and not any(having):
        names = [repr(a.name) for m in state.motions for a in m.animations]
        raise InputError(f"there is no animation {animation!r}; known: {', '.join(names) or 'none'}")
    meshes, lights, cameras, motions = list(state.meshes), list(state.lights), dict(state.cameras), []
    for motion, known in zip(state.motions, having, strict=True):
        if not known:
            motions.append(motion)
            continue
        motion = motion.choosing(animation)
        worlds, weights = posed(motion.nodes, motion.animation(None), time, motion.root)
        for part in motion.parts:
            if moves(motion, part, worlds, weights):
                meshes[part.mesh] = bent(meshes[part.mesh], motion, part, worlds, weights)
        _attached(motion, worlds, lights, cameras)
        motions.append(replace(motion, worlds=worlds, weights=weights))
    return Moving(tuple(meshes), tuple(lights), cameras, tuple(motions))


def knows(motion: Motion, animation: str | int | None) -> bool:
    """The file that it came from has that animation, or nobody asks for a certain one."""
    if animation is None:
        return True
    with suppress(InputError):
        return motion.animation(animation) is not None
    return False


def moves(motion: Motion, part: Part, worlds: Array, weights: Mapping[int, Array]) -> bool:
    """Whether a part stands or looks otherwise than in the motion's present state."""
    if motion.worlds is None:
        return True
    nodes = np.array([part.node]) if part.skin is None else motion.skins[part.skin].joints
    if not np.array_equal(motion.worlds[nodes], worlds[nodes]):
        return True
    return not np.array_equal(motion.weights.get(part.node, 0.0), weights.get(part.node, 0.0))


def bent(mesh: Mesh, motion: Motion, part: Part, worlds: Array, weights: Mapping[int, Array]) -> Mesh:
    """The mesh of a part in a pose; its faces stay the same object unless it is turned inside out."""
    skin = None if part.skin is None else motion.skins[part.skin]
    now = placed(part.shape, worlds[part.node], weights.get(part.node), skin, worlds)
    faces = torch.from_numpy(now.faces)
    return replace(
        mesh,
        vertices=torch.from_numpy(now.vertices),
        faces=mesh.faces if torch.equal(mesh.faces, faces) else faces,
        normals=None if now.normals is None else torch.from_numpy(now.normals),
        tangents=None if now.tangents is None else torch.from_numpy(now.tangents),
    )


def _attached(motion: Motion, worlds: Array, lights: list[Light], cameras: dict[str, Cameras]) -> None:
    # A node that an animation shrinks to nothing leaves its light and camera where they were.
    for place, node, light in motion.lights:
        with suppress(InputError):
            lights[place] = light_at(light, worlds[node])
    for name, node, camera in motion.cameras:
        with suppress(InputError):
            cameras[name] = camera_at(camera, worlds[node])


def _merely_moved(was: Mesh, now: Mesh) -> bool:
    kept = (one.name for one in fields(Mesh) if one.name not in ("vertices", "normals", "tangents", "name"))
    pairs = [(getattr(was, name), getattr(now, name)) for name in kept]
    same = all(a is b or (type(a) is type(b) is int and a == b) for a, b in pairs)
    return same and len(was.vertices) == len(now.vertices)


def moved_geometry(old: Geometry, before: Sequence[Mesh], after: Sequence[Mesh]) -> Geometry | None:
    """The geometry of ``after`` where only vertices, normals and tangents differ; None where more does."""
    if len(before) != len(after):
        return None
    vertices = old.vertices.clone()
    normals = None if old.normals is None else old.normals.clone()
    tangents = None if old.tangents is None else old.tangents.clone()
    start = 0
    for was, now in zip(before, after, strict=True):
        end = start + len(was.vertices)
        if was is not now:
            if not _merely_moved(was, now):
                return None
            vertices[start:end] = now.vertices.detach()
            for whole, part in ((normals, now.normals), (tangents, now.tangents)):
                if whole is None and part is not None:
                    return None
                if whole is not None:
                    whole[start:end] = 0.0 if part is None else part.detach()
        start = end
    return refitted(old, vertices, normals=normals, tangents=tangents)
