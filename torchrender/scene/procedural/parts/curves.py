"""Curved pieces: surfaces of revolution, spheres, tubes along paths, leaves and grass blades."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from torchrender.scene.procedural.parts.shapes import Array, Index, Part, quads, repeat_pattern, unit

UP = np.array([0.0, 1.0, 0.0])


def spline(points: Sequence[Sequence[float]] | Array, count: int) -> Array:
    """``count`` points (count,D) along a smooth curve without overshoot through ``points`` (K,D)."""
    p = np.asarray(points, dtype=float)
    t = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(p, axis=0), axis=1))])
    from scipy.interpolate import PchipInterpolator  # slow to import, and only branches need it

    curve: Array = PchipInterpolator(t, p, axis=0)(np.linspace(0.0, t[-1], count))
    return curve


def polyline(points: Sequence[Sequence[float]] | Array, count: int) -> Array:
    """About ``count`` points along straight segments; every corner is kept, and kept sharp by being there twice."""
    p = np.asarray(points, dtype=float)
    length = np.linalg.norm(np.diff(p, axis=0), axis=1)
    cells = np.maximum(np.round(length / length.sum() * count), 1).astype(int)
    parts = [np.linspace(a, b, n + 1) for a, b, n in zip(p[:-1], p[1:], cells)]
    return np.concatenate(parts)


def lathe(profile: Array, segments: int) -> Part:
    """The surface that ``profile`` (K,2: radius, height) sweeps about the y axis.

    Going along the profile the body lies on the left, so run it from the bottom up the outside; it is closed when both
    ends lie on the axis or coincide. Two equal neighbouring points make a sharp edge.
    """
    r, y = profile[:, 0].clip(0.0), profile[:, 1]
    step = np.diff(profile, axis=0)
    real = np.linalg.norm(step, axis=1) > 1e-12
    side = unit(np.stack([step[:, 1], -step[:, 0]], axis=1)) * real[:, None]
    before, after = np.concatenate([side[:1] * 0, side]), np.concatenate([side, side[:1] * 0])
    if np.allclose(profile[0], profile[-1]) and r[0] > 0:
        before[0], after[-1] = side[-1], side[0]
    slope = unit(before + after)
    pole = (r == 0) & (np.abs(slope[:, 1]) > 0.5)
    slope[pole] = np.stack([np.zeros(pole.sum()), np.sign(slope[pole, 1])], axis=1)
    angle = np.arange(segments + 1) / segments * 2 * np.pi
    angle[-1] = 0.0  # the seam closes exactly
    c, s = np.cos(angle), -np.sin(angle)
    vertices = np.stack([r[:, None] * c, np.broadcast_to(y[:, None], (len(r), len(c))), r[:, None] * s], axis=-1)
    normals = np.stack([slope[:, :1] * c, slope[:, 1:] * np.ones_like(c), slope[:, :1] * s], axis=-1)
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(step, axis=1))])
    u, v = np.meshgrid(np.arange(segments + 1) / segments, along / along[-1], indexing="xy")
    index = np.arange(vertices[..., 0].size).reshape(vertices.shape[:2])
    faces = quads(index.T).reshape(segments, len(r) - 1, 2, 3)
    keep = np.stack([real & (r[:-1] > 0), real & (r[1:] > 0)], axis=1)
    faces = faces[:, keep]
    return Part(
        vertices.reshape(-1, 3), faces.reshape(-1, 3), normals.reshape(-1, 3), np.stack([u, v], axis=-1).reshape(-1, 2)
    )


def sphere(radius: float | Sequence[float], segments: int, rings: int | None = None) -> Part:
    """A closed sphere or ellipsoid about the origin: about ``2 segments rings`` triangles."""
    t = np.linspace(-np.pi / 2, np.pi / 2, (rings or max(segments // 2, 3)) + 1)
    profile = np.stack([np.cos(t), np.sin(t)], axis=1)
    profile[(0, -1), 0] = 0.0
    scale = np.broadcast_to(np.asarray(radius, dtype=float), (3,))
    return lathe(profile, segments).transformed(np.diag(scale))


def torus(radius: float, thickness: float, segments: int, sides: int) -> Part:
    """A closed ring about the y axis; ``thickness`` is the radius of its cross-section."""
    t = np.arange(sides + 1) / sides * 2 * np.pi
    t[-1] = 0.0
    return lathe(np.stack([radius + thickness * np.cos(t), thickness * np.sin(t)], axis=1), segments)


def cylinder(radius: float, low: float, high: float, segments: int, *, bevel: float = 0.0, rows: int = 1) -> Part:
    """A closed upright cylinder, its edges cut by ``bevel``; ``rows`` rings along its side."""
    b = min(bevel, radius * 0.5, (high - low) * 0.5)
    side = [(radius, y) for y in np.linspace(low + b, high - b, rows + 1)]
    if b > 0:
        t = np.linspace(0.0, np.pi / 2, 4)[1:-1]
        lower = [(radius - b + b * np.sin(a), low + b - b * np.cos(a)) for a in t]
        upper = [(radius - b + b * np.cos(a), high - b + b * np.sin(a)) for a in t]
        ends: list[tuple[float, float]] = [(0.0, low), (radius - b, low), (radius - b, low)]
        tops: list[tuple[float, float]] = [(radius - b, high), (radius - b, high), (0.0, high)]
        profile = [*ends, *lower, *side, *upper, *tops]
    else:
        profile = [(0.0, low), (radius, low), *side, (radius, high), (0.0, high)]
    return lathe(np.array(profile), segments)


def frames(paths: Array) -> tuple[Array, Array, Array]:
    """Tangents and two normals (N,K,3) along the paths (N,K,3), turned as little as possible from point to point."""
    tangent = unit(np.gradient(paths, axis=1))
    axis = np.eye(3)[np.abs(tangent[:, 0]).argmin(axis=1)]
    first = np.zeros_like(paths)
    first[:, 0] = unit(np.cross(tangent[:, 0], axis))
    for k in range(1, paths.shape[1]):
        t = tangent[:, k]
        flat = first[:, k - 1] - t * (first[:, k - 1] * t).sum(axis=1, keepdims=True)
        first[:, k] = unit(flat)
    return tangent, first, np.cross(tangent, first)


def tubes(paths: Array, radii: Array, sides: int) -> Part:
    """N closed round tubes along ``paths`` (N,K,3) with ``radii`` (N,K): 2 sides K triangles each.

    Texture coordinates: once round, and metres along.
    """
    n, k, _ = paths.shape
    tangent, a, b = frames(paths)
    angle = np.arange(sides + 1) / sides * 2 * np.pi
    angle[-1] = 0.0
    out = a[:, :, None] * np.cos(angle)[:, None] + b[:, :, None] * np.sin(angle)[:, None]
    ring = paths[:, :, None] + out * radii[:, :, None, None]
    length = np.linalg.norm(np.diff(paths, axis=1), axis=2).cumsum(axis=1)
    v = np.concatenate([np.zeros((n, 1)), length], axis=1)
    uv = np.stack(np.broadcast_arrays(np.arange(sides + 1) / sides, v[:, :, None]), axis=-1)
    body = k * (sides + 1)
    vertices = np.concatenate([ring.reshape(n, body, 3), paths[:, (0, -1)]], axis=1)
    normals = np.concatenate([out.reshape(n, body, 3), np.stack([-tangent[:, 0], tangent[:, -1]], axis=1)], axis=1)
    uv = np.concatenate([uv.reshape(n, body, 2), np.stack([uv[:, 0, 0], uv[:, -1, 0]], axis=1)], axis=1)
    pattern = _tube_pattern(k, sides)
    return Part(
        vertices.reshape(-1, 3), repeat_pattern(pattern, body + 2, n), normals.reshape(-1, 3), uv.reshape(-1, 2)
    )


def _tube_pattern(rings: int, sides: int) -> Index:
    index = np.arange(rings * (sides + 1)).reshape(rings, sides + 1)
    start, end = np.full(sides, index.size), np.full(sides, index.size + 1)
    low = np.stack([start, index[0, 1:], index[0, :-1]], axis=1)
    high = np.stack([end, index[-1, :-1], index[-1, 1:]], axis=1)
    return np.concatenate([quads(index.T), low, high])


def tube(path: Array, radius: float | Array, sides: int) -> Part:
    """One closed tube along ``path`` (K,3)."""
    return tubes(path[None], np.broadcast_to(np.asarray(radius, dtype=float), (1, len(path))), sides)


def leaves(base: Array, along: Array, up: Array, length: Array, width: Array, fold: float = 0.22) -> Part:
    """N leaves, each a closed flat tetrahedron (4 triangles) folded along its middle rib.

    ``base`` (N,3) is the stalk end, ``along`` (N,3) points to the tip, ``up`` (N,3) to the upper side.
    """
    t = unit(along)
    side = unit(np.cross(t, up))
    top = np.cross(side, t)
    size, half = length[:, None], width[:, None] / 2
    wing = base + t * size * 0.45 - top * half * fold * 2
    v = np.stack([base, wing + side * half, base + t * size, wing - side * half], axis=1)
    pattern = np.array([[0, 1, 2], [0, 2, 3], [0, 3, 1], [1, 3, 2]])
    return Part(v.reshape(-1, 3), repeat_pattern(pattern, 4, len(base)))


def blades(base: Array, lean: Array, height: Array, width: Array, steps: int) -> Part:
    """N curved grass blades: closed, flat triangular cross-section, 6 steps + 4 - 6 = 6 steps - 2 triangles each.

    ``lean`` (N,3) is horizontal and gives direction and reach of the bend; ``steps`` segments, the last one a tip.
    """
    n = len(base)
    t = np.arange(steps) / steps
    reach = np.linalg.norm(lean, axis=1)
    direction = unit(lean)
    side = np.stack([direction[:, 2], np.zeros(n), -direction[:, 0]], axis=1)

    def spine(s: float) -> Array:
        drop = 1.0 - 0.35 * (reach / height.clip(1e-9)).clip(0, 1) * s * s
        return base + UP * (height * s * drop)[:, None] + lean * (s * s)

    rings = []
    for s in t:
        half = (width * (1.0 - 0.55 * s) / 2)[:, None]
        p = spine(float(s))
        rings.append(np.stack([p - side * half, p + side * half, p - direction * half * 0.45], axis=1))
    v = np.concatenate([np.stack(rings, axis=1).reshape(n, -1, 3), spine(1.0)[:, None]], axis=1)
    ring = np.arange(3 * steps).reshape(steps, 3)[:, [0, 1, 2, 0]]
    tip = np.stack([ring[-1, :-1], ring[-1, 1:], np.full(3, 3 * steps)], axis=1)
    pattern = np.concatenate([quads(ring.T), tip, [[0, 2, 1]]])
    return Part(v.reshape(-1, 3), repeat_pattern(pattern, 3 * steps + 1, n))
