"""A jointed figure that walks in a circle on a court at dusk, under a sky with a few bright windows: a moving scene."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from torchrender.scene.environment import Environment
from torchrender.scene.model import Scene
from torchrender.scene.motion.records import LINEAR, Animation, Array, Channel, Motion, Nodes, Shape
from torchrender.scene.motion.records import Part as MovingPart
from torchrender.scene.procedural.parts.assembly import Assembly, as_tensor, fitted, view
from torchrender.scene.procedural.parts.curves import cylinder, sphere
from torchrender.scene.procedural.parts.shapes import Part, box, boxes, merge
from torchrender.scene.procedural.parts.textures import mottled

USUAL, FEWEST = 14_000, 3_000
FULL = 15_000
RADIUS = 1.1  # of the circle
ROUND_S, STEPS = 8.0, 6  # seconds of a round, and double steps in it
KEYS = 12  # key frames of a double step
HIPS = 0.96


class _Limb(NamedTuple):
    """A node of the figure."""

    name: str
    parent: int
    place: tuple[float, float, float]  # of its joint, in the parent's frame
    part: Part | None  # in its own frame
    material: str = "wood"


def _bone(length: float, width: float, segments: int) -> Part:
    """From its joint at the origin down."""
    middle = sphere((width, 0.5 * length, width), segments).moved((0.0, -0.5 * length, 0.0))
    return merge([sphere((0.8 * width,) * 3, max(segments // 2, 5)), middle])


def _limbs(detail: float) -> list[_Limb]:
    """The round first, then the figure, which looks along -z."""
    n = max(round(18 * detail), 6)
    torso = merge(
        [
            sphere((0.15, 0.13, 0.11), n),
            sphere((0.12, 0.16, 0.09), n).moved((0.0, 0.17, 0.0)),
            sphere((0.19, 0.17, 0.12), n).moved((0.0, 0.4, 0.0)),
        ]
    )
    head = merge([cylinder(0.05, -0.08, 0.06, n), sphere((0.1, 0.14, 0.11), n).moved((0.0, 0.17, 0.0))])
    foot = sphere((0.05, 0.045, 0.13), n).moved((0.0, -0.43, -0.06))
    made = [_Limb("round", -1, (0.0, 0.0, 0.0), None), _Limb("hips", 0, (RADIUS, HIPS, 0.0), torso)]
    made.append(_Limb("head", 1, (0.0, 0.58, 0.0), head, "light wood"))
    for side, name in ((-1.0, "left"), (1.0, "right")):
        thigh = len(made)
        made.append(_Limb(f"{name} thigh", 1, (0.1 * side, -0.03, 0.0), _bone(0.46, 0.075, n)))
        made.append(_Limb(f"{name} shin", thigh, (0.0, -0.45, 0.0), merge([_bone(0.44, 0.055, n), foot]), "light wood"))
        made.append(_Limb(f"{name} arm", 1, (0.22 * side, 0.48, 0.0), _bone(0.31, 0.05, n)))
        lower = merge([_bone(0.27, 0.04, n), sphere((0.035, 0.07, 0.05), n).moved((0.0, -0.31, 0.0))])
        made.append(_Limb(f"{name} forearm", thigh + 2, (0.0, -0.3, 0.0), lower, "light wood"))
    return made


def _turn(axis: int, angle: Array) -> Array:
    """(K,4) quaternions about an axis."""
    made = np.zeros((len(angle), 4))
    made[:, axis], made[:, 3] = np.sin(angle / 2), np.cos(angle / 2)
    return made


def _walk(limbs: list[_Limb]) -> Animation:
    t = np.linspace(0.0, 1.0, STEPS * KEYS + 1)
    times, phase = ROUND_S * t, 2 * math.pi * STEPS * t
    bob = np.stack([np.full_like(t, RADIUS), HIPS + 0.025 * np.cos(2 * phase), np.zeros_like(t)], axis=1)
    turns = {"round": _turn(1, 2 * math.pi * t), "head": _turn(1, 0.35 * np.sin(2 * math.pi * t))}
    for name, own in (("left", phase), ("right", phase + math.pi)):
        turns[f"{name} thigh"] = _turn(0, 0.5 * np.sin(own))
        turns[f"{name} shin"] = _turn(0, -0.15 - 0.7 * np.maximum(np.cos(own), 0.0))
        turns[f"{name} arm"] = _turn(0, -0.55 * np.sin(own))
        turns[f"{name} forearm"] = _turn(0, 0.5 - 0.25 * np.sin(own))
    node = {limb.name: number for number, limb in enumerate(limbs)}
    channels = [
        Channel(node=node[name], path="rotation", times=times, values=value, interpolation=LINEAR)
        for name, value in turns.items()
    ]
    channels.append(Channel(node=node["hips"], path="translation", times=times, values=bob, interpolation=LINEAR))
    return Animation(name="walk", channels=tuple(channels))


def _motion(limbs: list[_Limb], made: Assembly) -> Motion:
    count = len(limbs)
    nodes = Nodes(
        parents=np.array([limb.parent for limb in limbs]),
        translation=np.array([limb.place for limb in limbs], dtype=float),
        rotation=np.tile((0.0, 0.0, 0.0, 1.0), (count, 1)),
        scale=np.ones((count, 3)),
    )
    places = {mesh.name: number for number, mesh in enumerate(made.meshes)}
    parts = []
    for number, limb in enumerate(limbs):
        if limb.part is None:
            continue
        mesh = made.meshes[places[limb.name]]
        assert mesh.normals is not None
        shape = Shape(
            vertices=mesh.vertices.double().numpy(), faces=mesh.faces.numpy(), normals=mesh.normals.numpy()
        )  # fmt: skip
        parts.append(MovingPart(places[limb.name], number, shape))
    return Motion(nodes=nodes, animations=(_walk(limbs),), parts=tuple(parts))


def _furnished(detail: float, seed: int) -> Assembly:
    rng = np.random.default_rng((seed, 17))
    made = Assembly()
    made.material("wood", (0.5, 0.29, 0.15))
    made.material("light wood", (0.66, 0.48, 0.3))
    made.material("stone", (1.0, 1.0, 1.0), texture=mottled(rng, (0.46, 0.44, 0.41), (0.6, 0.58, 0.55)))
    made.material("plinth", (0.62, 0.6, 0.58))
    for limb in _limbs(detail):
        if limb.part is not None:
            made.add(limb.name, (limb.material, limb.part))
    cell = float(np.clip(0.5 / detail, 0.1, 4.0))
    made.add("court", ("stone", box((-3.5, -0.3, -3.5), (3.5, 0.0, 3.5), cell=cell).mapped(0.4)))
    segments = max(round(24 * detail), 6)
    for number, angle in enumerate(np.radians((150.0, 235.0, 330.0))):
        place = (2.5 * math.cos(angle), 0.0, 2.5 * math.sin(angle))
        column = merge([cylinder(0.2, 0.0, 2.0, segments, bevel=0.03), box((-0.3, 2.0, -0.3), (0.3, 2.15, 0.3))])
        made.add(f"column {number}", ("plinth", column.moved(place)))
    made.add("plinth", ("plinth", cylinder(0.4, 0.0, 0.35, segments, bevel=0.03)))
    return made


def _dusk() -> Environment:
    """A dim sky, a broad glow low in the west, and three bright windows."""
    height = 64
    polar = (np.arange(height) + 0.5)[:, None] * math.pi / height
    azimuth = ((np.arange(2 * height) + 0.5)[None] / (2 * height) - 0.5) * 2 * math.pi
    up = np.cos(polar) + 0.0 * azimuth
    color = np.array([0.03, 0.05, 0.1]) + np.array([0.07, 0.07, 0.09]) * np.exp(-4 * np.abs(up))[..., None]
    glow = np.exp(-((azimuth - 2.3) ** 2) / 0.25 - (up - 0.15) ** 2 / 0.02)[..., None]
    color = np.where(up[..., None] < 0, 0.35 * color, color + glow * np.array([1.3, 0.55, 0.22]))
    for turn, high, wide, light in (
        (-0.7, 0.55, 0.12, (60.0, 46.0, 30.0)),
        (0.9, 0.5, 0.09, (34.0, 32.0, 30.0)),
        (-2.3, 0.75, 0.09, (16.0, 20.0, 27.0)),
    ):
        window = (np.abs(azimuth - turn) < 1.4 * wide) & (np.abs(up - high) < wide)
        color = np.where(window[..., None], np.array(light), color)
    return Environment(radiance=as_tensor(color), name="dusk")


def walker(triangles: int, seed: int) -> Scene:
    """Everything gets finer with the count; gravel along the edge of the court fills up what is left."""
    made, left = fitted(lambda detail: _furnished(detail, seed), triangles, usual=FULL)
    rng = np.random.default_rng((seed, 18))
    count = max(left // 12, 1)
    turn, away = rng.uniform(0.0, 2 * math.pi, count), rng.uniform(3.0, 3.4, count)
    place = np.stack([away * np.cos(turn), rng.uniform(-0.01, 0.03, count), away * np.sin(turn)], axis=1)
    made.add("gravel", ("plinth", boxes(place, rng.uniform(0.03, 0.09, (count, 3)), rng.uniform(0, 360, count))))
    cameras = {
        "default": view((2.6, 2.3, 3.6), (0.0, 0.6, 0.0), 42.0, 0.05, 60.0),
        "above": view((0.3, 5.2, 2.2), (0.0, 0.2, 0.0), 45.0, 0.05, 60.0),
        "close": view((1.9, 0.9, 1.7), (0.7, 0.7, -0.2), 50.0, 0.05, 60.0),
    }
    scene = made.scene("walker", lights=(), cameras=cameras, ambient=(0.004, 0.005, 0.008), environment=_dusk())
    limbs = _limbs(math.sqrt(triangles / FULL))  # their places: what they look like is in the meshes
    return replace(scene, motions=(_motion(limbs, made),)).at(0.0)
