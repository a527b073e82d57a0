"""A broad-leaved tree: five generations of branches that end in leaves, on a grassy mound."""

from __future__ import annotations

import numpy as np

from torchrender.scene.light import DirectionalLight
from torchrender.scene.model import Scene
from torchrender.scene.procedural.parts.assembly import Assembly, as_tensor, sky, view
from torchrender.scene.procedural.parts.curves import UP, blades, leaves, sphere, tubes
from torchrender.scene.procedural.parts.shapes import Array, Part, sheet, unit
from torchrender.scene.procedural.parts.textures import blend, mottled, wood

USUAL, FEWEST = 113_000, 3_000
SUN = (-0.58, 0.68, 0.46)
HALF = 9.0


def _mound(x: Array, z: Array) -> Array:
    return np.asarray(0.55 * np.exp(-(x * x + z * z) / 14.0) - 0.45 + 0.05 * np.sin(1.3 * x + 0.4) * np.cos(1.1 * z))


def _grow(
    rng: np.random.Generator, start: Array, direction: Array, length: Array, points: int, wild: float, rise: float
) -> Array:
    """Paths (N,points,3): each step turns a little at random and towards the light."""
    paths = np.zeros((len(start), points, 3))
    paths[:, 0] = start
    d = unit(direction)
    for k in range(1, points):
        d = unit(d + rng.normal(0, wild, d.shape) + UP * rise)
        paths[:, k] = paths[:, k - 1] + d * (length / (points - 1))[:, None]
    return paths


def _shoots(
    rng: np.random.Generator, paths: Array, radii: Array, each: int, first: float, angle: tuple[float, float]
) -> tuple[Array, Array, Array]:
    """Starts, directions, and radii of ``each`` side shoots per path, in a spiral along it."""
    n, k, _ = paths.shape
    share = first + (1.0 - first) * (np.arange(each) + rng.uniform(0.1, 0.9, (n, each))) / each
    at = np.clip(share * (k - 1), 0, k - 1 - 1e-6)
    low = at.astype(int)
    row, part = np.arange(n)[:, None], (at - low)[..., None]
    start = paths[row, low] * (1 - part) + paths[row, low + 1] * part
    axis = unit(paths[row, low + 1] - paths[row, low])
    a = unit(np.cross(axis, unit(rng.normal(0, 0.1, axis.shape) + np.array([0.3, 0.2, 1.0]))))
    turn = (np.arange(each) * 2.39996 + rng.uniform(0, 6.28, (n, 1)))[..., None] + rng.normal(0, 0.3, (n, each, 1))
    out = a * np.cos(turn) + np.cross(axis, a) * np.sin(turn)
    lean = np.radians(rng.uniform(*angle, (n, each, 1))) * (1.15 - 0.7 * share[..., None] ** 2)
    direction = axis * np.cos(lean) + out * np.sin(lean)
    thick = radii[row, low] * (1 - part[..., 0]) + radii[row, low + 1] * part[..., 0]
    return start.reshape(-1, 3), direction.reshape(-1, 3), thick.reshape(-1)


def _skeleton(rng: np.random.Generator, detail: float) -> list[tuple[Array, Array, int]]:
    """Paths, radii and sides of each generation, trunk first."""
    more = float(np.clip(detail, 0.45, 2.2))
    paths = _grow(
        rng,
        np.array([[0.0, -0.15, 0.0]]),
        np.array([[0.05, 1.0, 0.02]]),
        np.array([4.5]),
        max(round(16 * more), 6),
        0.05,
        0.05,
    )
    t = np.linspace(0, 1, paths.shape[1])[None]
    radii = 0.17 * (1 - 0.72 * t) + 0.16 * np.exp(-t * 11)
    out = [(paths, radii, max(round(18 * more), 6))]
    plan = (  # shoots, first share, angles, length, points, sides, wildness, rise
        (9, 0.33, (42, 72), 1.85, 10, 10, 0.12, 0.07),
        (6, 0.25, (32, 62), 1.0, 8, 7, 0.15, 0.07),
        (5, 0.22, (28, 60), 0.55, 6, 5, 0.17, 0.04),
        (4, 0.25, (28, 62), 0.30, 4, 3, 0.18, 0.0),
    )
    for k, (each, first, angle, length, points, sides, wild, rise) in enumerate(plan):
        number = max(round(each * float(np.clip(detail, 0.5, 1.9)) ** 0.5), 2)
        start, direction, thick = _shoots(rng, paths, radii, number, first, angle)
        reach = length * rng.uniform(0.7, 1.15, len(start))
        if k == 0:  # the lower limbs are the longer ones: a round crown
            reach *= np.clip(1.35 - 0.22 * np.clip(start[:, 1] - 1.3, 0, 4.0), 0.45, 1.3)
        paths = _grow(rng, start, direction, reach, max(round(points * min(more, 1.5)), 3), wild, rise)
        root = np.minimum(thick * 0.72, 0.03 * reach + 0.003)
        t = np.linspace(0, 1, paths.shape[1])[None]
        radii = np.maximum(root[:, None] * (1 - 0.75 * t), 0.0016)
        out.append((paths, radii, max(round(sides * min(more, 1.5)), 3)))
    return out


def _leaves(rng: np.random.Generator, count: int, twigs: Array, size: float) -> Part:
    """Leaves along the twigs; colours darken towards the inside of the crown and differ from twig to twig."""
    n, k, _ = twigs.shape
    pick = rng.integers(0, n, count)
    at = rng.uniform(0.15, 1.0, count) * (k - 1 - 1e-6)
    low, part = at.astype(int), (at % 1)[:, None]
    base = twigs[pick, low] * (1 - part) + twigs[pick, low + 1] * part
    axis = unit(twigs[pick, low + 1] - twigs[pick, low])
    out = unit(np.cross(axis, rng.normal(0, 1, (count, 3))))
    along = axis * 0.6 + out - UP * 0.25
    up = UP + rng.normal(0, 0.45, (count, 3))
    length = size * rng.uniform(0.75, 1.25, count)
    leaf = leaves(base + out * 0.006, along, up, length, length * rng.uniform(0.55, 0.75, count), 0.25)
    centre = twigs.reshape(-1, 3).mean(axis=0)
    spread = np.abs(twigs.reshape(-1, 3) - centre).max(axis=0)
    depth = np.asarray(np.linalg.norm((base - centre) / spread, axis=1))
    shade: Array = np.clip(0.30 + 0.85 * depth**1.3, 0.25, 1.1) * np.clip(
        0.85 + 0.3 * (base - centre)[:, 1] / spread[1], 0.5, 1.15
    )
    tone = blend((0.75, 0.9, 0.6), (1.45, 1.15, 0.7), rng.random((n,))[pick] * 0.7 + 0.3 * rng.random(count))
    return leaf.tinted(np.repeat(tone * shade[:, None], 4, axis=0))


def _lawn(rng: np.random.Generator, count: int) -> Part:
    p = rng.normal(0, 2.0, (count, 2)).clip(-HALF * 0.95, HALF * 0.95)
    base = np.stack([p[:, 0], _mound(p[:, 0], p[:, 1]) - 0.01, p[:, 1]], axis=1)
    tall = rng.uniform(0.08, 0.22, count)
    angle = rng.uniform(0, 2 * np.pi, count)
    lean = np.stack([np.cos(angle), 0 * angle, np.sin(angle)], 1) * (tall * rng.uniform(0.2, 0.7, count))[:, None]
    part = blades(base, lean, tall, rng.uniform(0.010, 0.022, count), 2)
    tone = blend((0.7, 0.85, 0.5), (1.4, 1.25, 0.8), rng.random(count))
    level = np.array([0.45] * 3 + [0.8] * 3 + [1.1])
    return part.tinted((tone[:, None] * level[None, :, None]).reshape(-1, 3))


def tree(triangles: int, seed: int) -> Scene:
    """Leaves take what the wood leaves over (about 60 %): more triangles are more twigs and more, smaller leaves."""
    rng = np.random.default_rng((seed, 4))
    made = Assembly()
    detail = float(np.clip((triangles / USUAL) ** 0.5, 0.12, 6.0))
    made.material("bark", (1, 1, 1), texture=wood(rng, (0.085, 0.062, 0.045), (0.23, 0.175, 0.125)))
    made.material("leaf", (0.13, 0.28, 0.04), specular=0.04, shininess=30.0)
    made.material("lawn", (1, 1, 1), texture=mottled(rng, (0.07, 0.115, 0.025), (0.14, 0.215, 0.05)))
    made.material("blade", (0.14, 0.27, 0.05))
    made.material("stone", (1, 1, 1), texture=mottled(rng, (0.22, 0.22, 0.21), (0.44, 0.43, 0.4)))
    t = np.linspace(-1, 1, max(round(40 * min(detail, 3.0)), 8) + 1)
    x = np.sign(t) * np.abs(t) ** 1.3 * HALF
    px, pz = np.meshgrid(x, x, indexing="xy")
    points = np.stack([px, _mound(px, pz), pz], axis=-1)
    made.add("ground", ("lawn", sheet(points, uv=points[..., (0, 2)] * 0.3)))
    wooden = _skeleton(rng, detail)
    for name, (paths, radii, sides) in zip(("trunk", "limbs", "branches", "boughs", "twigs"), wooden):
        if made.count + 2 * sides * paths.shape[0] * paths.shape[1] < 0.62 * triangles:
            made.add(name, ("bark", tubes(paths, radii, sides).mapped((2.0, 0.8))))
    for k, (size, a, b) in enumerate(((0.34, 1.9, 1.6), (0.2, 2.35, 1.35), (0.26, -2.4, 0.9))):
        rock = sphere((size, size * 0.6, size * 0.8), max(round(20 * min(detail, 3.0)), 6))
        place = (a, float(_mound(np.array(a), np.array(b))) + size * 0.15, b)
        made.add(f"stone {k + 1}", ("stone", rock.moved(place, yaw_deg=50.0 * k, tilt_deg=8.0)))
    left = triangles - made.count
    lawn = round(0.16 * left / 10)
    made.add("grass", ("blade", _lawn(rng, lawn)))
    count = max((left - 10 * lawn) // 4, 1)
    size = 0.145 * float(np.clip((16_000 / count) ** 0.35, 0.2, 2.4))
    made.add("leaves", ("leaf", _leaves(rng, count, wooden[-1][0], size)))
    cameras = {
        "default": view((3.7, 1.5, 10.4), (0.45, 3.0, 0.0), 37.0, 0.1, 80.0),
        "close": view((1.5, 0.5, 3.4), (-0.1, 3.0, 0.0), 55.0, 0.05, 80.0),
        "crown": view((-3.2, 4.4, 4.0), (0.0, 3.6, 0.0), 42.0, 0.05, 80.0),
    }
    sun = DirectionalLight(direction=-as_tensor(SUN), irradiance=as_tensor((3.7, 3.2, 2.5)), name="sun")
    air = sky(rng, SUN, ground=(0.10, 0.13, 0.04))
    return made.scene("tree", lights=[sun], cameras=cameras, ambient=(0.03, 0.03, 0.03), environment=air)
