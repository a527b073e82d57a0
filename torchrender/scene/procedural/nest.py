"""A bird's nest of woven twigs in the fork of a branch: thin rods, many layers deep."""

from __future__ import annotations

import numpy as np

from torchrender.scene.environment import Environment
from torchrender.scene.light import DirectionalLight
from torchrender.scene.model import Scene
from torchrender.scene.procedural.parts.assembly import Assembly, as_tensor, sky, view
from torchrender.scene.procedural.parts.curves import leaves, sphere, spline, tube, tubes
from torchrender.scene.procedural.parts.shapes import Array, Part, merge, pitch_matrix, tilt_matrix, unit, yaw_matrix
from torchrender.scene.procedural.parts.textures import blend, mottled, noise, wood

USUAL, FEWEST = 67_000, 3_000
RIM, BOWL = 0.105, 0.075  # radius of the rim's middle and depth of the bowl, metres
SUN = (-0.55, 0.8, 0.42)


def _bowl(s: Array, phi: Array, lift: Array) -> Array:
    """Points at share ``s`` of the way from the bowl's bottom (0) to its rim (1), ``lift`` metres off the middle."""
    a = np.clip(s, 0.0, 1.25) * np.pi / 2
    radius = RIM * np.sin(a) ** 0.85 + lift * np.sin(a)
    return np.stack([radius * np.cos(phi), -BOWL * np.cos(a) - lift * np.cos(a), radius * np.sin(phi)], axis=-1)


def _woven(rng: np.random.Generator, count: int, points: int, thickness: float) -> Array:
    """Paths (count,points,3) that run round the bowl and weave in and out of it."""
    t = np.linspace(0.0, 1.0, points)[None]

    def draw(low: float, high: float) -> Array:
        return rng.uniform(low, high, (count, 1))

    start = 1.0 - 0.8 * np.abs(draw(0.0, 1.0)) ** 1.7
    s = start + draw(-0.22, 0.22) * (t - 0.5) + draw(0.0, 0.05) * np.sin(2 * np.pi * (draw(0.6, 1.6) * t + draw(0, 1)))
    turn = draw(0.9, 2.3) * np.sign(draw(-1.0, 1.0)) / np.clip(start, 0.35, 1.0)
    phi = draw(0.0, 2 * np.pi) + turn * (t - 0.5)
    body = thickness * (0.45 + 0.55 * np.clip(start, 0, 1))
    lift = body * (draw(-1.0, 1.0) + 0.35 * np.sin(2 * np.pi * (draw(1.0, 2.4) * t + draw(0, 1))))
    paths = _bowl(s, phi, lift)
    # The ends run straight on, so they stick out as real twigs do.
    stray = draw(0.0, 0.045) * np.clip(np.abs(2 * t - 1) - 0.6, 0, 1) / 0.4
    outward = unit(paths * np.array([1.0, 0.0, 1.0]))
    jitter = rng.normal(0.0, 0.0011, paths.shape)
    result: Array = (
        paths + outward * stray[..., None] + np.array([0, 1.0, 0]) * (stray * draw(-0.5, 0.7))[..., None] + jitter
    )
    return result


def _shaded(part: Part, tone: Array, depth: float) -> Part:
    """Vertex colours: a tone for each twig, darker deep inside the weave and low in the bowl."""
    p = part.vertices
    radius = np.hypot(p[:, 0], p[:, 2])
    level = np.clip(p[:, 1] / BOWL + 1.0, 0.0, 1.4)
    inside = np.clip((RIM - radius) / RIM, 0, 1) * np.clip(1.1 - level * 0.7, 0, 1)
    shade = np.clip(0.55 + 0.45 * level - depth * inside, 0.25, 1.0)
    return part.tinted(np.repeat(tone, len(p) // len(tone), axis=0) * shade[:, None])


def _twigs(
    rng: np.random.Generator, count: int, points: int, sides: int, radius: tuple[float, float], wide: float
) -> Part:
    paths = _woven(rng, count, points, wide)
    taper = 1.0 - 0.55 * np.linspace(0, 1, points)[None] ** 2
    tone = blend((0.55, 0.45, 0.33), (1.25, 1.12, 0.92), rng.random(count)) * rng.uniform(0.75, 1.1, (count, 1))
    return _shaded(tubes(paths, rng.uniform(*radius, (count, 1)) * taper, sides), tone, 0.35)


def _branches(rng: np.random.Generator, detail: float) -> Part:
    """A forked branch under the nest."""
    runs = (
        ([(-0.55, -0.20, 0.10), (-0.3, -0.165, 0.06), (-0.1, -0.15, 0.015), (0.06, -0.145, -0.01)], 0.040, 0.034),
        ([(-0.06, -0.15, 0.0), (0.1, -0.135, -0.05), (0.24, -0.07, -0.115), (0.46, 0.06, -0.2)], 0.032, 0.015),
        ([(-0.06, -0.15, 0.0), (0.09, -0.14, 0.06), (0.22, -0.115, 0.12), (0.5, -0.09, 0.17)], 0.030, 0.013),
        ([(-0.2, -0.155, 0.03), (-0.18, -0.11, -0.07), (-0.175, -0.04, -0.12), (-0.20, 0.045, -0.155)], 0.021, 0.009),
    )
    rows, sides = max(round(26 * detail), 5), max(round(16 * detail), 5)
    parts = []
    for points, thick, thin in runs:
        path = spline(points, rows) + rng.normal(0, 0.0016, (rows, 3))
        radius = np.linspace(thick, thin, rows) * rng.uniform(0.93, 1.07, rows)
        parts.append(tube(path, radius, sides).mapped((2.0, 8.0)))
    return merge(parts).moved((0, 0.018, 0))


def _foliage(rng: np.random.Generator, count: int) -> Part:
    """Leaves at the thin ends of the branches."""
    ends = np.array([(0.46, 0.06, -0.2), (0.5, -0.09, 0.17), (-0.20, 0.045, -0.155), (0.33, -0.01, -0.15)])
    base = ends[rng.integers(0, len(ends), count)] + rng.normal(0, 0.028, (count, 3))
    along = rng.normal(0, 0.6, (count, 3)) + np.array([0.1, -0.15, 0.1])
    part = leaves(
        base,
        along,
        rng.normal(0, 0.25, (count, 3)) + np.array((0, 1.0, 0)),
        rng.uniform(0.035, 0.07, count),
        rng.uniform(0.02, 0.034, count),
    )
    tone = blend((0.75, 0.85, 0.6), (1.3, 1.15, 0.9), rng.random(count))
    return part.tinted(np.repeat(tone, 4, axis=0))


def nest(triangles: int, seed: int) -> Scene:
    """Twigs take 85 % of the triangles: more triangles are more and finer twigs."""
    rng = np.random.default_rng((seed, 1))
    made = Assembly()
    detail = float(np.clip((triangles / USUAL) ** 0.5, 0.25, 4.0))
    made.material("bark", (1, 1, 1), texture=_bark(rng))
    made.material("twig", (0.33, 0.235, 0.145))
    made.material("straw", (0.60, 0.47, 0.25))
    made.material("egg", (1, 1, 1), texture=_shell(rng), specular=0.04, shininess=40.0)
    made.material("leaf", (0.12, 0.26, 0.045), specular=0.03, shininess=24.0)
    made.add("branch", ("bark", _branches(rng, detail)))
    rings = max(round(40 * detail), 8)
    for k, (x, z, yaw) in enumerate(((-0.026, 0.012, 20.0), (0.024, 0.018, 130.0), (0.003, -0.027, 250.0))):
        pose = yaw_matrix(yaw) @ tilt_matrix(68.0 + 6 * k) @ pitch_matrix(8.0)
        egg = sphere((0.0165, 0.0225, 0.0165), rings)
        round_end = 1.0 - 0.16 * egg.vertices[:, 1:2] / 0.0225
        egg = Part(
            egg.vertices * np.concatenate([round_end, np.ones_like(round_end), round_end], 1),
            egg.faces,
            egg.normals,
            egg.uv,
        )
        made.add(f"egg {k + 1}", ("egg", egg.transformed(pose, (x, -0.047 + 0.002 * k, z))))
    made.add("leaves", ("leaf", _foliage(rng, max(round(170 * detail), 12))))
    left = triangles - made.count
    # 45 % thick twigs of 100 triangles, the rest thin ones of 54 and a soft lining of 54.
    finer = float(np.clip((USUAL / triangles) ** 0.28, 0.3, 1.5))
    thick, thin = round(0.46 * left / 100), round(0.34 * left / 54)
    lining = max(round((left - 100 * thick - 54 * thin) / 54), 1)
    made.add("thick twigs", ("twig", _twigs(rng, thick, 10, 5, (0.0013 * finer, 0.0027 * finer), 0.024)))
    made.add("thin twigs", ("twig", _twigs(rng, thin, 9, 3, (0.0007 * finer, 0.0014 * finer), 0.03)))
    made.add("lining", ("straw", _lining(rng, lining, finer)))
    cameras = {
        "default": view((0.16, 0.235, 0.40), (0.01, -0.035, 0.0), 38.0, 0.02, 20.0),
        "close": view((-0.10, 0.16, 0.185), (0.0, -0.03, -0.005), 46.0, 0.01, 20.0),
        "low": view((-0.30, -0.02, 0.52), (0.03, -0.05, 0.0), 34.0, 0.02, 20.0),
    }
    sun = DirectionalLight(direction=-as_tensor(SUN), irradiance=as_tensor((3.3, 2.95, 2.4)), name="sun")
    return made.scene("nest", lights=[sun], cameras=cameras, ambient=(0.03, 0.03, 0.03), environment=_forest(rng))


def _lining(rng: np.random.Generator, count: int, finer: float) -> Part:
    """Fine straw pressed into the inside of the bowl."""
    t = np.linspace(-1.0, 1.0, 9)[None]
    turn = rng.uniform(0, 2 * np.pi, (count, 1))
    offset = rng.uniform(-0.07, 0.07, (count, 1))
    half = np.sqrt(0.083**2 - offset**2) * rng.uniform(0.55, 1.0, (count, 1))
    bend = rng.uniform(-0.25, 0.25, (count, 1))
    x, z = half * t, offset + bend * half * (t * t - 0.4)
    radius = np.hypot(x, z) / 0.09
    y = -BOWL * np.sqrt(np.clip(1 - np.clip(radius, 0, 1.1) ** 2, 0, 1)) + rng.uniform(0.001, 0.012, (count, 1))
    c, s = np.cos(turn), np.sin(turn)
    paths = np.stack([c * x + s * z, y, -s * x + c * z], axis=-1) + rng.normal(0, 0.0012, (count, 9, 3))
    tone = blend((0.7, 0.65, 0.55), (1.15, 1.08, 0.95), rng.random(count))
    part = tubes(paths, rng.uniform(0.0004, 0.0009, (count, 1)) * finer * np.ones((1, 9)), 3)
    return _shaded(part, tone, 0.3)


def _bark(rng: np.random.Generator) -> Array:
    grain = wood(rng, (0.10, 0.075, 0.05), (0.26, 0.205, 0.15))
    moss = np.clip(0.9 * noise(rng, 256, slope=1.5) - 0.35, 0, 1)[..., None]
    return grain * (1 - moss) + np.array([0.13, 0.17, 0.05]) * moss


def _shell(rng: np.random.Generator) -> Array:
    spots = np.clip(noise(rng, 256, slope=0.75) * 3.0 - 5.4, 0, 1)[..., None]
    base = mottled(rng, (0.34, 0.60, 0.62), (0.46, 0.72, 0.72))
    return base * (1 - 0.85 * spots) + np.array([0.16, 0.09, 0.05]) * 0.85 * spots


def _forest(rng: np.random.Generator) -> Environment:
    """Sky above, and all round the blurred light and dark greens of trees far out of focus."""
    air = sky(rng, SUN, clouds=0.3, height=256)
    rows = np.linspace(1.0, -1.0, 256)[:, None]
    soft, fine = noise(rng, 512, slope=2.2)[:256], noise(rng, 512, slope=1.7)[:256]
    green = blend(
        (0.035, 0.075, 0.02), (0.30, 0.40, 0.13), 0.42 + 0.26 * soft + 0.20 * fine + 0.3 * np.minimum(rows, 0)
    )
    cover = np.clip(0.75 + 0.5 * soft - 2.6 * rows, 0, 1)[..., None]
    mixed = air.radiance.numpy() * (1 - cover) + green * cover
    return Environment(radiance=as_tensor(mixed), name="forest")
