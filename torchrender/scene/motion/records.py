"""What a moving scene is made of, as it came from its file."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from torchrender.checks import is_whole
from torchrender.errors import InputError
from torchrender.scene.camera import Cameras
from torchrender.scene.light import Light

Array = np.ndarray[Any, Any]

STEP, LINEAR, CUBIC = "STEP", "LINEAR", "CUBICSPLINE"
PATHS = ("translation", "rotation", "scale", "weights")


@dataclass(frozen=True, eq=False, kw_only=True)
class Channel:
    """One property of one node over time."""

    node: int
    path: str  # one of PATHS
    times: Array  # (K,) float64 seconds, not falling
    values: Array  # (K,W) float64; CUBICSPLINE: (K,3,W) in-tangent, value, out-tangent
    interpolation: str  # STEP, LINEAR or CUBICSPLINE


@dataclass(frozen=True, eq=False, kw_only=True)
class Animation:
    """Channels that play together."""

    name: str
    channels: tuple[Channel, ...]

    @property
    def duration(self) -> float:
        """Time of the last key frame, seconds."""
        return max((float(c.times[-1]) for c in self.channels), default=0.0)

    def beyond(self, time: float) -> str:
        """What to say of a time, in seconds, before the start or after the end: it stands still there; else nothing."""
        if 0.0 <= time <= self.duration:
            return ""
        end = "start" if time < 0.0 else "end"
        return f"time {time:g}: {self.name or 'the animation'} goes from 0 to {self.duration:g} s, its {end} is shown"


@dataclass(frozen=True, eq=False)
class Nodes:
    """N nodes of a forest, in their rest pose."""

    parents: Array  # (N,) int64, -1: a root
    translation: Array  # (N,3) float64
    rotation: Array  # (N,4) float64 quaternions x, y, z, w
    scale: Array  # (N,3) float64
    matrices: Mapping[int, Array] = field(default_factory=dict)  # (4,4) of nodes that have one in place of the three
    weights: Mapping[int, Array] = field(default_factory=dict)  # (T,) of nodes with morph targets

    @cached_property
    def ancestors(self) -> tuple[Array, ...]:
        """(N+1,) ancestor of each node 1, 2, 4, 8 ... steps up; N stands above all roots, and above itself."""
        count = len(self.parents)
        up = np.append(np.where(self.parents < 0, count, self.parents), count)
        found = []
        while (up != count).any():
            found.append(up)
            up = up[up]
        return tuple(found)


@dataclass(frozen=True, eq=False)
class Skin:
    """Joints, and the pose that a mesh was bound to them in."""

    joints: Array  # (J,) int64 nodes
    inverse_bind: Array  # (J,4,4) float64 joint from mesh


@dataclass(frozen=True, eq=False, kw_only=True)
class Shape:
    """A mesh in its own frame, and what bends it."""

    vertices: Array  # (V,3) float64
    faces: Array  # (F,3) int64
    normals: Array  # (V,3) float32
    own_normals: bool = True  # False: derived from the faces, and derived again where morph targets move them
    tangents: Array | None = None  # (V,4) float32
    joints: Array | None = None  # (V,J) int64
    weights: Array | None = None  # (V,J) float64
    target_positions: Array | None = None  # (T,V,3) float32
    target_normals: Array | None = None  # (T,V,3) float32
    target_tangents: Array | None = None  # (T,V,3) float32

    @property
    def bends(self) -> bool:
        """More moves it than its node."""
        return self.joints is not None or self.target_positions is not None

    @cached_property
    def skinning(self) -> Any:
        """(V,joints) sparse weights."""
        assert self.joints is not None and self.weights is not None
        count, width = self.joints.shape
        starts = np.arange(0, count * width + 1, width)
        most = int(self.joints.max(initial=0)) + 1
        from scipy.sparse import csr_matrix  # slow to import, and only skins need it

        return csr_matrix((self.weights.reshape(-1), self.joints.reshape(-1), starts), shape=(count, most))

    @cached_property
    def smooth_groups(self) -> Array:
        """(V,) label of vertices that share position and normal in rest: they keep sharing their normal."""
        rows = np.concatenate([self.vertices, self.normals.astype(np.float64)], axis=1) + 0.0
        keys = np.ascontiguousarray(rows).view(np.dtype((np.void, rows.shape[1] * 8))).reshape(-1)
        labels: Array = np.unique(keys, return_inverse=True)[1].reshape(-1)
        return labels


@dataclass(frozen=True, eq=False)
class Part:
    """A mesh of the scene that may move: where it hangs, and what it looks like in its own frame."""

    mesh: int  # place in Scene.meshes
    node: int
    shape: Shape
    skin: int | None = None


@dataclass(frozen=True, eq=False, kw_only=True)
class Motion:
    """Everything that may move in what one file brought, and where it stands now.

    A scene holds one for each file that has something to move. ``worlds`` and ``weights`` tell the state that the
    scene's meshes are in.
    """

    nodes: Nodes
    animations: tuple[Animation, ...] = ()
    skins: tuple[Skin, ...] = ()
    parts: tuple[Part, ...] = ()
    lights: tuple[tuple[int, int, Light], ...] = ()  # place in Scene.lights, node, light in the node's frame
    cameras: tuple[tuple[str, int, Cameras], ...] = ()  # name, node, camera in the node's frame
    root: Array = field(default_factory=lambda: np.eye(4))  # world from file
    worlds: Array | None = None  # (N,4,4) world from node; None: nothing is placed yet
    weights: Mapping[int, Array] = field(default_factory=dict)
    chosen: int = 0  # the animation that plays where none is named: the one that was named last

    def animation(self, name: str | int | None) -> Animation | None:
        """The animation of that name or number, the chosen one where none is named; None where there is none.

        Raises:
            InputError: there is no such animation; the message lists those there are.
        """
        if name is None:
            return self.animations[self.chosen] if self.animations else None
        if is_whole(name):
            if 0 <= name < len(self.animations):
                return self.animations[name]
        else:
            found = [a for a in self.animations if a.name == name]
            if found:
                return found[0]
        known = ", ".join(repr(a.name) for a in self.animations) or "none"
        raise InputError(f"there is no animation {name!r}; known: {known}")

    def choosing(self, name: str | int | None) -> Motion:
        """The same, whose animation of that name or number plays from now on where none is named.

        Raises:
            InputError: as of :meth:`animation`.
        """
        animation = self.animation(name)
        return self if animation is None else replace(self, chosen=self.animations.index(animation))

    def shifted(self, meshes: int, lights: int) -> Motion:
        """The same where the scene's meshes and lights come behind others."""
        return replace(
            self,
            parts=tuple(replace(p, mesh=p.mesh + meshes) for p in self.parts),
            lights=tuple((place + lights, node, light) for place, node, light in self.lights),
        )
