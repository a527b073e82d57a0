"""A town: towers with setbacks and window bands as geometry along a street grid, a park, trees and cars."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from torchrender.scene.camera import Cameras
from torchrender.scene.light import DirectionalLight
from torchrender.scene.model import Scene
from torchrender.scene.procedural.parts.assembly import Assembly, as_tensor, sky, view
from torchrender.scene.procedural.parts.curves import cylinder, sphere, torus
from torchrender.scene.procedural.parts.shapes import Array, Part, box, boxes, merge, repeat_pattern
from torchrender.scene.procedural.parts.textures import blend, bricks, mottled

USUAL, FEWEST = 50_000, 2_000
BLOCK, STREET = 52.0, 16.0  # metres
PITCH = BLOCK + STREET
SUN = (-0.62, 0.62, 0.48)
FLOOR = 3.6

_WALLS = {  # facade colours
    "limestone": (0.56, 0.51, 0.43), "concrete": (0.42, 0.42, 0.42), "white render": (0.72, 0.71, 0.68),
    "sandstone": (0.55, 0.40, 0.27), "slate": (0.17, 0.20, 0.24), "terracotta": (0.47, 0.22, 0.14),
}  # fmt: skip


def _tiers(rng: np.random.Generator, size: Array, floors: int) -> list[tuple[Array, int, int]]:
    """(footprint (2,), first floor, floors) of a tower that steps back as it rises."""
    steps = 1 if floors < 7 else int(rng.integers(1, 4)) if floors < 16 else int(rng.integers(2, 5))
    shares = np.sort(rng.uniform(0.35, 0.92, steps - 1))
    edges = [0, *np.unique(np.maximum((shares * floors).astype(int), 2)), floors]
    return [(size * (1.0 - 0.17 * k), low, high - low) for k, (low, high) in enumerate(pairwise(edges)) if high > low]


def _building(
    rng: np.random.Generator, centre: Array, size: Array, floors: int, style: int
) -> tuple[Array, Array, Array, Array]:
    """Centres and sizes of the wall boxes, then of the glass boxes.

    Style 0: floor slabs before glass; 1: piers before glass; 2: plain walls (the texture has the windows) and a roof
    in place of the glass.
    """
    wall: list[tuple[float, ...]] = []
    glass: list[tuple[float, ...]] = []
    top, last = 0.2, size
    for foot, low, count in _tiers(rng, size, floors):
        base, tall, last = 0.2 + low * FLOOR, count * FLOOR, foot
        top = base + tall
        if style == 2:
            wall.append((0, base + tall / 2 - 0.1, 0, foot[0], tall + 0.2, foot[1]))
            glass.append((0, top + 0.2, 0, foot[0] + 0.5, 0.5, foot[1] + 0.5))
        else:
            glass.append((0, base + tall / 2 - 0.05, 0, foot[0] - 0.7, tall + 0.1, foot[1] - 0.7))
            wall.append((0, top - 0.3, 0, foot[0], 0.9, foot[1]))
        if style == 0:
            y = base + FLOOR * np.arange(count)
            wall.extend((0, v + 0.6, 0, foot[0], 1.3, foot[1]) for v in y)
        if style == 1:
            for axis in (0, 1):
                n = max(int(foot[axis] / 4.2), 2)
                along = (np.arange(n + 1) / n - 0.5) * (foot[axis] - 0.9)
                for v in along:
                    for side in (-1, 1):
                        at = side * (foot[1 - axis] / 2 - 0.28)
                        x, z = (v, at) if axis == 0 else (at, v)
                        w, d = (0.9, 0.5) if axis == 0 else (0.5, 0.9)
                        wall.append((x, base + tall / 2 - 0.32, z, w, tall - 0.6, d))
    wall.append((0.12 * last[0], top + 1.6, -0.1 * last[1], last[0] * 0.34, 3.1, last[1] * 0.3))
    shift = np.array([centre[0], 0, centre[1], 0, 0, 0])
    a, b = (np.array(v).reshape(-1, 6) + shift for v in (wall, glass))
    return a[:, :3], a[:, 3:], b[:, :3], b[:, 3:]


def _plots(rng: np.random.Generator, block: Array) -> list[tuple[Array, Array]]:
    """Centre and footprint of the buildings of one block: one, two or four of them."""
    kind = rng.choice(3, p=(0.2, 0.3, 0.5))
    inner = BLOCK - 8.0
    if kind == 0:
        return [(block, np.array([inner, inner]) * rng.uniform(0.62, 0.85))]
    half = (inner - 3.0) / 2
    if kind == 1:
        turn = rng.random() < 0.5
        foot = np.array([inner, half]) if turn else np.array([half, inner])
        step = np.array([0.0, 1.0]) if turn else np.array([1.0, 0.0])
        return [(block + s * step * (half + 3.0) / 2, foot * rng.uniform(0.78, 1.0, 2)) for s in (-1, 1)]
    corners = [np.array([i, j]) * (half + 3.0) / 2 for i in (-1, 1) for j in (-1, 1)]
    return [(block + c, np.array([half, half]) * rng.uniform(0.75, 1.0, 2)) for c in corners]


def _crowns(rng: np.random.Generator, foot: Array, segments: int) -> tuple[Part, Part]:
    """Trunks and round crowns of trees at ``foot`` (N,2)."""
    ball = sphere(1.0, segments, max(segments // 2, 3))
    size = rng.uniform(1.7, 2.8, (len(foot), 1))
    stretch = rng.uniform(0.85, 1.25, (len(foot), 3)) * size
    centre = np.stack([foot[:, 0], 2.0 + stretch[:, 1], foot[:, 1]], axis=1)
    v = ball.vertices * (1 + 0.10 * np.sin(ball.vertices @ np.array([[5.0], [7.0], [6.0]])))
    crown = Part(
        (v[None] * stretch[:, None] + centre[:, None]).reshape(-1, 3),
        repeat_pattern(ball.faces, len(v), len(foot)),
        np.tile(ball.normals if ball.normals is not None else v, (len(foot), 1)),
    )
    tone = blend((0.6, 0.8, 0.5), (1.35, 1.2, 0.9), rng.random(len(foot)))
    shade = 0.55 + 0.45 * (v[:, 1:2] + 1) / 2
    crown = crown.tinted((tone[:, None] * shade[None]).reshape(-1, 3))
    trunk = boxes(
        np.stack([foot[:, 0], np.full(len(foot), 1.6), foot[:, 1]], 1), np.tile((0.4, 3.2, 0.4), (len(foot), 1))
    )
    return trunk, crown


def _cars(rng: np.random.Generator, count: int, blocks: int) -> tuple[Part, Part]:
    """Bodies and cabins of cars that drive on the right-hand lane."""
    half = blocks * PITCH / 2
    street = (rng.integers(0, blocks + 1, count) - blocks / 2) * PITCH
    along = rng.uniform(-half, half, count)
    lane = rng.choice((-1.0, 1.0), count)
    parked = rng.random(count) < 0.5
    across = street + lane * np.where(parked, 4.3, 2.2)
    turned = rng.random(count) < 0.5
    yaw = np.where(turned, 90.0, 0.0)
    x, z = np.where(turned, along, across), np.where(turned, -across, along)
    place = np.stack([x, np.full(count, 0.72), z], axis=1)
    body = boxes(place, np.tile((1.8, 0.8, 4.4), (count, 1)), yaw)
    cabin = boxes(place + np.array((0, 0.66, 0)), np.tile((1.6, 0.6, 2.3), (count, 1)), yaw)
    paint = np.array(
        [
            (0.7, 0.7, 0.7),
            (0.5, 0.04, 0.03),
            (0.05, 0.05, 0.06),
            (0.06, 0.12, 0.4),
            (0.75, 0.5, 0.05),
            (0.3, 0.32, 0.34),
        ]
    )
    return body.tinted(np.repeat(paint[rng.integers(0, len(paint), count)], 24, axis=0)), cabin


def _streets(made: Assembly, blocks: int, park: Array) -> None:
    """Asphalt, raised blocks, lane marks and the park's lawn, paths and pond."""
    span = blocks * PITCH + STREET
    made.add(
        "ground",
        ("asphalt", box((-span / 2 - 60, -1.0, -span / 2 - 60), (span / 2 + 60, 0.0, span / 2 + 60)).mapped(0.02)),
    )
    line = (np.arange(blocks) - (blocks - 1) / 2) * PITCH
    centre = np.stack(np.meshgrid(line, line, indexing="ij"), -1).reshape(-1, 2)
    block = np.insert(centre, 1, 0.09, axis=1)
    made.add("pavements", ("pavement", boxes(block, np.tile((BLOCK, 0.22, BLOCK), (len(block), 1))).mapped(0.1)))
    road = (np.arange(blocks + 1) - blocks / 2) * PITCH
    dash = np.arange(-blocks * PITCH / 2, blocks * PITCH / 2, 11.33 * max(1, blocks // 8)) + 5.0
    a, b = (v.reshape(-1) for v in np.meshgrid(road, dash))
    keep = np.abs((b / PITCH + blocks / 2) % 1 - 0.5) < 0.37
    a, b = a[keep], b[keep]
    y = np.full(len(a), 0.01)
    one = boxes(np.stack([a, y, b], 1), np.tile((0.25, 0.02, 3.4), (len(a), 1)))
    two = boxes(np.stack([b, y, a], 1), np.tile((3.4, 0.02, 0.25), (len(a), 1)))
    made.add("lane marks", ("paint", merge([one, two])))
    x, z = park
    lawn = [
        box((x + i - 11.2, 0.1, z + j - 11.2), (x + i + 11.2, 0.32, z + j + 11.2))
        for i in (-12.6, 12.6)
        for j in (-12.6, 12.6)
    ]
    made.add("lawn", ("lawn", merge(lawn).mapped(0.08)))
    made.add("pond", ("water", cylinder(8.5, 0.12, 0.5, 48).moved((x, 0, z))))
    made.add("pond rim", ("limestone", torus(8.6, 0.45, 48, 8).moved((x, 0.45, z))))


def _towers(made: Assembly, rng: np.random.Generator, blocks: int, park: int, budget: float) -> None:
    """Fill blocks from the middle outwards until ``budget`` triangles are there."""
    line = (np.arange(blocks) - (blocks - 1) / 2) * PITCH
    centre = np.stack(np.meshgrid(line, line, indexing="ij"), -1).reshape(-1, 2)
    reach = max(blocks * PITCH / 2, PITCH)
    for index in np.argsort(np.abs(centre).max(axis=1) + 0.01 * np.arange(len(centre)), kind="stable"):
        if index == park:
            continue
        for place, foot in _plots(rng, centre[index]):
            far = np.hypot(*(place - (0.1 * reach, -0.25 * reach))) / reach
            floors = int(np.clip(rng.lognormal(2.75 - 1.25 * far, 0.42), 3, 44))
            style = 2 if floors < 7 and rng.random() < 0.5 else int(rng.choice(2, p=(0.68, 0.32)))
            wall = "brick" if style == 2 else list(_WALLS)[int(rng.integers(0, len(_WALLS)))]
            pane = "mirror glass" if floors > 15 and rng.random() < 0.3 else "glass"
            a, b, c, d = _building(rng, place, foot, floors, style)
            if made.count + 12 * (len(a) + len(c)) > budget:
                continue
            if style == 2:
                pane = "slate"
            made.add(f"building {made.objects}", {wall: boxes(a, b).mapped(0.5 / FLOOR), pane: boxes(c, d)})


def city(triangles: int, seed: int) -> Scene:
    """About 880 triangles a block; more triangles are more blocks, trees and cars."""
    rng = np.random.default_rng((seed, 3))
    made = Assembly()
    blocks = int(np.clip(round(np.sqrt(triangles / 880)), 2, 80))
    for name, color in _WALLS.items():
        made.material(name, color)
    made.material("brick", (1, 1, 1), texture=_facade(rng))
    made.material("glass", (0.035, 0.05, 0.065), specular=0.07, shininess=200.0)
    made.mirror("mirror glass", (0.03, 0.05, 0.07), 0.45, (0.8, 0.92, 1.0))
    made.mirror("water", (0.02, 0.05, 0.05), 0.5)
    made.material("asphalt", (1, 1, 1), texture=mottled(rng, (0.075, 0.075, 0.08), (0.105, 0.105, 0.11)))
    made.material("pavement", (0.36, 0.35, 0.33))
    made.material("paint", (0.75, 0.75, 0.7))
    made.material("lawn", (1, 1, 1), texture=mottled(rng, (0.06, 0.14, 0.025), (0.12, 0.22, 0.05)))
    made.material("trunk", (0.16, 0.10, 0.06))
    made.material("crown", (0.10, 0.20, 0.04))
    made.material("car", (1, 1, 1), specular=0.06, shininess=80.0)
    line = (np.arange(blocks) - (blocks - 1) / 2) * PITCH
    home = blocks // 2
    park = np.array([line[home], line[home]])
    _streets(made, blocks, park)
    _towers(made, rng, blocks, home * blocks + home, 0.86 * triangles)
    _greenery(made, rng, blocks, park, triangles - made.count)
    return made.scene(
        "city",
        lights=[DirectionalLight(direction=-as_tensor(SUN), irradiance=as_tensor((3.5, 3.05, 2.4)), name="sun")],
        cameras=_cameras(park),
        ambient=(0.02, 0.02, 0.025),
        environment=sky(rng, SUN, ground=(0.42, 0.46, 0.50)),
    )


def _facade(rng: np.random.Generator) -> Array:
    """Two by two windows in a brick wall; one tile is two floors high."""
    wall = bricks(rng, (0.30, 0.11, 0.06), (0.46, 0.19, 0.11), (0.40, 0.33, 0.28), rows=32, columns=12)
    y, x = (np.mgrid[0:256, 0:256] + 0.5) / 128 % 1 - 0.5
    stone = (np.abs(x) < 0.27) & (np.abs(y) < 0.33)
    pane = (np.abs(x) < 0.22) & (np.abs(y) < 0.28) & (np.abs(x) > 0.014) & (np.abs(y + 0.06) > 0.012)
    wall[stone] = (0.62, 0.58, 0.5)
    wall[pane] = (0.04, 0.06, 0.085)
    return wall


def _greenery(made: Assembly, rng: np.random.Generator, blocks: int, park: Array, left: int) -> None:
    """Trees in the park and along the streets for two thirds of what is left, cars for the rest."""
    segments = 7
    each = sphere(1.0, segments, 3).count + 12
    trees = max(int(left * 0.7 / each), 4)
    shady = min(trees // 2, 30)
    angle, radius = rng.uniform(0, 2 * np.pi, shady), rng.uniform(12.0, 23.0, shady)
    green = park + np.stack([np.cos(angle), np.sin(angle)], 1) * radius[:, None]
    count = trees - shady
    kerb = (rng.integers(0, blocks, count) - (blocks - 1) / 2) * PITCH + rng.choice((-1.0, 1.0), count) * (
        BLOCK / 2 - 1.8
    )
    slots = max(int(BLOCK // 6.5), 1)
    along = (rng.integers(0, blocks, count) - (blocks - 1) / 2) * PITCH + (
        rng.integers(0, slots, count) + 0.5 - slots / 2
    ) * 6.5
    turned = rng.random(count) < 0.5
    lined = np.stack([np.where(turned, along, kerb), np.where(turned, kerb, along)], axis=1)
    trunk, crown = _crowns(rng, np.concatenate([green, lined]), segments)
    made.add("trees", {"trunk": trunk, "crown": crown})
    body, cabin = _cars(rng, max(round((left - trees * each) / 24), 1), blocks)
    made.add("cars", {"car": body, "glass": cabin})


def _cameras(park: Array) -> dict[str, Cameras]:
    x, z = float(park[0]), float(park[1])
    return {
        "default": view((x - 150, 108, z + 215), (x + 12, 30, z - 20), 42.0, 1.0, 8000.0),
        "close": view((x - 38, 14, z + 42), (x + 8, 16, z - 12), 55.0, 0.5, 8000.0),
        "street": view((x + PITCH / 2 + 1.5, 2.2, z + 150), (x + PITCH / 2 - 1.0, 17, z), 52.0, 0.3, 8000.0),
    }
