"""A meadow: thin curved blades in tufts on gently rolling ground, with flowers, stones and two mushrooms."""

from __future__ import annotations

import numpy as np

from torchrender.scene.light import DirectionalLight
from torchrender.scene.model import Scene
from torchrender.scene.procedural.parts.assembly import Assembly, as_tensor, sky, view
from torchrender.scene.procedural.parts.curves import blades, lathe, leaves, sphere, spline, tubes
from torchrender.scene.procedural.parts.shapes import Array, Part, merge, sheet, smooth_normals, unit
from torchrender.scene.procedural.parts.textures import blend, mottled

USUAL, FEWEST = 56_000, 3_000
HALF = 9.0  # half the side of the ground, metres
SUN = (0.66, 0.62, 0.28)


def height(x: Array, z: Array) -> Array:
    """Height of the ground, metres."""
    swell = 0.20 * np.sin(0.55 * x + 0.8) * np.cos(0.48 * z - 0.3) + 0.07 * np.sin(1.7 * x - 1.1 * z)
    return np.asarray(swell + 0.02 * np.sin(5.1 * x + 2.0 * z) * np.cos(4.3 * z) + 0.010 * z * z * (z < 0))


def _placed(rng: np.random.Generator, count: int, reach: float, spread: float) -> Array:
    """Positions (count,3) on the ground, in tufts, densest near the middle of the meadow."""
    tufts = max(count // 9, 8)
    centre = np.clip(rng.normal((0.0, 0.55), (1.2 * reach, reach), (tufts, 2)), -HALF * 0.96, HALF * 0.96)
    p = centre[rng.integers(0, tufts, count)] + rng.normal(0, spread, (count, 2))
    p = np.clip(p, -HALF * 0.98, HALF * 0.98)
    return np.stack([p[:, 0], height(p[:, 0], p[:, 1]) - 0.01, p[:, 1]], axis=1)


def _grass(rng: np.random.Generator, count: int, steps: int, size: tuple[float, float], reach: float) -> Part:
    base = _placed(rng, count, reach, 0.11)
    tall = rng.uniform(*size, count) * (1.0 + 0.25 * np.sin(base[:, 0] * 2.1) * np.cos(base[:, 2] * 1.7))
    angle = rng.uniform(0, 2 * np.pi, count)
    wind = np.array([0.35, 0.0, 0.12])
    lean = (np.stack([np.cos(angle), 0 * angle, np.sin(angle)], 1) * rng.uniform(0.15, 0.65, (count, 1)) + wind) * tall[
        :, None
    ]
    part = blades(base, lean, tall, rng.uniform(0.012, 0.024, count) * (0.6 + tall), steps)
    tone = blend((0.55, 0.8, 0.45), (1.45, 1.25, 0.75), rng.random(count) ** 1.5)
    level = np.concatenate([np.repeat(np.arange(steps) / steps, 3), [1.0]])
    shade = 0.28 + 0.72 * level**0.8
    return part.tinted((tone[:, None] * shade[None, :, None]).reshape(-1, 3))


def _ground(cells: int) -> Part:
    x = np.sign(t := np.linspace(-1, 1, cells + 1)) * np.abs(t) ** 1.4 * HALF
    px, pz = np.meshgrid(x, x, indexing="ij")
    points = np.stack([px, height(px, pz), pz], axis=-1).transpose(1, 0, 2)
    return sheet(points, uv=points[..., (0, 2)] * 0.35)


def _stone(rng: np.random.Generator, size: float, x: float, z: float, segments: int) -> Part:
    body = sphere((size, size * 0.62, size * 0.8), segments)
    v = body.vertices
    bumps = sum(
        rng.uniform(0.03, 0.09) * np.sin(v / size @ rng.normal(0, 2.2, 3) + rng.uniform(0, 6)) for _ in range(7)
    )
    shape = v * (1.0 + np.asarray(bumps)[:, None])
    moved = shape + np.array((x, float(height(np.array(x), np.array(z))) + 0.22 * size, z))
    return Part(moved, body.faces, smooth_normals(moved, body.faces), body.uv)


def _flowers(rng: np.random.Generator, count: int, petals: int, size: float, head: Part) -> dict[str, Part]:
    """Stems, petals and hearts of ``count`` flowers, by material."""
    foot = _placed(rng, count, 1.15, 0.25)
    foot[:, 2] -= 0.75
    foot[:, 1] = height(foot[:, 0], foot[:, 2]) - 0.01
    tall = rng.uniform(0.34, 0.60, count)
    t = np.linspace(0, 1, 5)[None, :, None]
    lean = rng.normal(0, 0.07, (count, 3)) * (1, 0, 1)
    path = foot[:, None] + np.array([0, 1.0, 0]) * tall[:, None, None] * t + lean[:, None] * t**2
    top, facing = path[:, -1], unit(lean * 2.0 + (0.12, 0.55, 0.35) + rng.normal(0, 0.12, (count, 3)))
    a = unit(np.cross(facing, (0.3, 0.1, 1.0)))
    b = np.cross(facing, a)
    turn = (np.arange(petals) / petals * 2 * np.pi)[None, :, None] + rng.uniform(0, 1, (count, 1, 1))
    along = (a[:, None] * np.cos(turn) + b[:, None] * np.sin(turn) + 0.22 * facing[:, None]).reshape(-1, 3)
    many = count * petals
    bloom = leaves(
        np.repeat(top, petals, 0) + along * size * 0.2,
        along,
        np.repeat(facing, petals, 0),
        np.full(many, size),
        np.full(many, size * 3.4 / petals**0.75),
    )
    hearts = []
    for k in range(count):
        basis = np.stack([a[k], facing[k], np.cross(a[k], facing[k])], axis=1)
        hearts.append(head.transformed(basis * size, top[k] + facing[k] * size * 0.04))
    return {"stem": tubes(path, np.full((count, 5), 0.0035), 3), "petal": bloom, "heart": merge(hearts)}


def _mushroom(detail: float) -> dict[str, Part]:
    seg = max(round(36 * detail), 8)
    cap = spline(
        [(0.0, 0.098), (0.03, 0.093), (0.072, 0.1), (0.083, 0.112), (0.066, 0.147), (0.03, 0.166), (0.0, 0.17)],
        seg // 2,
    )
    stalk = spline([(0.0, -0.03), (0.026, -0.03), (0.022, 0.03), (0.016, 0.09), (0.0, 0.11)], max(seg // 3, 6))
    cap[(0, -1), 0], stalk[(0, -1), 0] = 0.0, 0.0
    spots = []
    for k in range(13 if detail > 0.4 else 4):
        up, turn = 0.35 + 0.6 * ((k * 0.618) % 1), k * 2.4
        ring = np.array([np.cos(turn), 0, np.sin(turn)]) * 0.083 * np.sqrt(1 - up**2)
        spots.append(sphere((0.009, 0.006, 0.009), max(seg // 4, 5)).moved(ring + np.array((0, 0.112 + 0.056 * up, 0))))
    return {"red cap": lathe(cap, seg), "white": merge([lathe(stalk, max(seg // 2, 6)), *spots])}


def grass(triangles: int, seed: int) -> Scene:
    """Blades take about 85 % of the triangles: more triangles are more and narrower tufts, farther out."""
    rng = np.random.default_rng((seed, 2))
    made = Assembly()
    detail = float(np.clip((triangles / USUAL) ** 0.5, 0.1, 3.0))
    made.material("soil", (1, 1, 1), texture=mottled(rng, (0.06, 0.095, 0.02), (0.13, 0.20, 0.045)))
    made.material("stone", (1, 1, 1), texture=mottled(rng, (0.20, 0.20, 0.19), (0.42, 0.41, 0.38)))
    made.material("blade", (0.15, 0.30, 0.045), specular=0.03, shininess=20.0)
    made.material("stem", (0.13, 0.26, 0.06))
    for name, petal, heart in (
        ("daisy", (0.86, 0.86, 0.84), (0.85, 0.55, 0.04)),
        ("poppy", (0.75, 0.035, 0.02), (0.03, 0.02, 0.03)),
        ("cornflower", (0.09, 0.14, 0.68), (0.2, 0.08, 0.4)),
    ):
        made.material(f"{name} petal", petal)
        made.material(f"{name} heart", heart)
    made.material("red cap", (0.62, 0.035, 0.015), specular=0.05, shininess=60.0)
    made.material("white", (0.82, 0.78, 0.68))
    made.add("ground", ("soil", _ground(max(round(44 * detail), 8))))
    _details(made, rng, detail)
    left = triangles - made.count
    far = float(np.clip(detail**0.3, 0.8, 1.35))
    tall, low = round(0.36 * left / 16), round(0.22 * left / 10)
    made.add("tall grass", ("blade", _grass(rng, tall, 3, (0.30, 0.56), 0.95 * far)))
    made.add("far grass", ("blade", _grass(rng, low, 2, (0.3, 0.5), 3.2 * far)))
    made.add(
        "short grass",
        ("blade", _grass(rng, max(round((left - 16 * tall - 10 * low) / 10), 1), 2, (0.12, 0.30), 1.1 * far)),
    )
    cameras = {
        "default": view((0.2, 0.80, 3.3), (0.0, 0.32, 0.0), 38.0, 0.05, 60.0),
        "close": view((0.2, 0.36, 2.3), (0.3, 0.26, 1.2), 36.0, 0.02, 60.0),
        "above": view((1.3, 2.2, 2.6), (0.0, 0.15, 0.0), 40.0, 0.1, 60.0),
    }
    sun = DirectionalLight(direction=-as_tensor(SUN), irradiance=as_tensor((3.6, 3.1, 2.35)), name="sun")
    air = sky(rng, SUN, ground=(0.09, 0.11, 0.03))
    return made.scene("grass", lights=[sun], cameras=cameras, ambient=(0.03, 0.03, 0.03), environment=air)


def _details(made: Assembly, rng: np.random.Generator, detail: float) -> None:
    seg = max(round(26 * detail), 7)
    for k, (size, x, z) in enumerate(
        ((0.26, -0.95, 0.75), (0.13, -0.55, 1.05), (0.19, 1.35, -0.2), (0.10, 0.62, 1.35))
    ):
        made.add(f"stone {k + 1}", ("stone", _stone(rng, size, x, z, seg)))
    head = sphere((0.24, 0.16, 0.24), max(round(9 * detail), 5), max(round(5 * detail), 3))
    amount = float(np.clip(detail, 0.15, 3.0))
    for name, count, petals, size in (("daisy", 16, 12, 0.052), ("poppy", 12, 5, 0.062), ("cornflower", 10, 9, 0.042)):
        pieces = _flowers(rng, max(round(count * amount), 1), petals, size, head)
        made.add(
            f"{name} flowers",
            {"stem": pieces["stem"], f"{name} petal": pieces["petal"], f"{name} heart": pieces["heart"]},
        )
    for k, (x, z, scale) in enumerate(((0.28, 1.42, 1.0), (0.43, 1.30, 0.7))):
        place = (x, float(height(np.array(x), np.array(z))), z)
        pieces = {m: p.transformed(np.eye(3) * scale, place) for m, p in _mushroom(min(detail, 2.0)).items()}
        made.add(f"mushroom {k + 1}", pieces)
