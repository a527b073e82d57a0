"""Furniture and textiles. Pieces stand on y = 0, are centred in x and z, and face +z."""

from __future__ import annotations

import numpy as np

from torchrender.scene.procedural.parts.curves import UP, blades, cylinder, leaves, sphere, spline, tube, tubes
from torchrender.scene.procedural.parts.shapes import (
    Array,
    Part,
    box,
    boxes,
    extruded,
    frame,
    merge,
    pitch_matrix,
    repeat_pattern,
    rounded_box,
    thick_sheet,
    unit,
    yaw_matrix,
)  # fmt: skip
from torchrender.scene.procedural.parts.vessels import cut


def cushion(size: tuple[float, float, float], puff: float, detail: float) -> Part:
    """A stuffed cushion about the origin."""
    return rounded_box(size, 0.45 * min(size), steps=cut(4, detail, 0), cells=cut(7, detail, 1), puff=puff)


def block(low: tuple[float, float, float], high: tuple[float, float, float], radius: float, detail: float) -> Part:
    """A box with rounded edges between two corners."""
    a, b = np.array(low), np.array(high)
    return rounded_box(b - a, radius, steps=cut(3, detail, 0)).moved((a + b) / 2)


def sofa(width: float, seats: int, detail: float) -> dict[str, Part]:
    """Frame, seat and back cushions in fabric, feet in dark wood; 0.95 m deep."""
    half, arm = width / 2, 0.2
    body = [
        block((-half + 0.01, 0.12, -0.44), (half - 0.01, 0.30, 0.42), 0.04, detail),
        block((-half + 0.02, 0.14, -0.47), (half - 0.02, 0.80, -0.24), 0.08, detail),
        block((-half, 0.13, -0.46), (-half + arm, 0.62, 0.46), 0.07, detail),
        block((half - arm, 0.13, -0.46), (half, 0.62, 0.46), 0.07, detail),
    ]
    seat = (width - 2 * arm) / seats
    soft = []
    for k in range(seats):
        x = -half + arm + seat * (k + 0.5)
        soft.append(cushion((seat * 0.985, 0.17, 0.70), 0.03, detail).moved((x, 0.37, 0.10)))
        lean = cushion((seat * 0.97, 0.46, 0.18), 0.045, detail).transformed(pitch_matrix(-12.0), (x, 0.66, -0.17))
        soft.append(lean)
    feet = [
        cylinder(0.025, 0.0, 0.14, cut(20, detail, 4)).moved((x, 0, z))
        for x in (-half + 0.1, half - 0.1)
        for z in (-0.38, 0.36)
    ]
    return {"sofa frame": merge(body), "sofa fabric": merge(soft), "dark wood": merge(feet)}


def table(width: float, depth: float, height: float, detail: float, *, top: str, legs: str) -> dict[str, Part]:
    """A table with round tapered legs."""
    plate = block((-width / 2, height - 0.03, -depth / 2), (width / 2, height, depth / 2), 0.012, detail)
    rows = cut(8, detail, 3)
    foot = [
        np.linspace((x * 1.04, 0.0, z * 1.04), (x, height - 0.025, z), rows)
        for x in (-width / 2 + 0.09, width / 2 - 0.09)
        for z in (-depth / 2 + 0.09, depth / 2 - 0.09)
    ]
    radii = np.broadcast_to(np.linspace(0.014, 0.024, rows), (4, rows))
    rods = tubes(np.array(foot), radii, cut(24, detail, 4))
    return {top: merge([plate, rods])} if top == legs else {top: plate, legs: rods}


def chair(detail: float) -> dict[str, Part]:
    """A wooden chair with a curved back rest and a padded seat."""
    legs = [((-0.19, 0, 0.19), (-0.18, 0.44, 0.17)), ((0.19, 0, 0.19), (0.18, 0.44, 0.17))]
    legs += [((-0.19, 0, -0.2), (-0.18, 0.9, -0.24)), ((0.19, 0, -0.2), (0.18, 0.9, -0.24))]
    rods = [tube(np.linspace(a, b, cut(9, detail, 3)), 0.017, cut(16, detail, 3)) for a, b in legs]
    arc = spline(((-0.18, 0, -0.235), (0.0, 0, -0.275), (0.18, 0, -0.235)), cut(16, detail, 4))
    for y in (0.62, 0.72, 0.82):
        rods.append(tube(arc + np.array((0, y, 0)), 0.013, cut(14, detail, 3)))
    rods.append(block((-0.21, 0.415, -0.215), (0.21, 0.44, 0.215), 0.01, detail))
    return {"light wood": merge(rods), "seat fabric": cushion((0.40, 0.06, 0.40), 0.012, detail).moved((0, 0.465, 0.0))}


def bookshelf(rng: np.random.Generator, width: float, height: float, shelves: int, books: int) -> dict[str, Part]:
    """Case with shelves, and rows of books: covers with vertex colours, bands on the spines, page blocks."""
    t, depth = 0.025, 0.30
    ys = np.concatenate([[0.0, 0.06]] + [[y, y + t] for y in np.linspace(0.06, height - t, shelves + 1)[1:]])
    xs = (-width / 2, -width / 2 + t, width / 2 - t, width / 2)
    mask = [[1, 1, 1]] + [[1, 0, 1] if k % 2 == 0 else [1, 1, 1] for k in range(len(ys) - 2)]
    case = extruded(xs, ys, mask, depth).moved((0, 0, -depth / 2))
    back = box((-width / 2 + 0.003, 0.004, -depth / 2 - 0.008), (width / 2 - 0.003, height - 0.003, -depth / 2 + 0.006))
    space = (height - t - 0.06) / shelves - t
    levels = 0.06 + np.arange(shelves) * (space + t) + np.where(np.arange(shelves) > 0, t, 0.0)
    rows = _books(rng, width - 2 * t - 0.02, levels.astype(np.float64), space, books)
    return {"white wood": merge([case, back]), **rows}


_COVERS = (
    (0.42, 0.05, 0.04), (0.05, 0.12, 0.28), (0.06, 0.22, 0.12), (0.62, 0.42, 0.12), (0.7, 0.66, 0.56),
    (0.10, 0.09, 0.10), (0.30, 0.13, 0.32), (0.13, 0.32, 0.36), (0.5, 0.2, 0.06), (0.33, 0.34, 0.36),
)  # fmt: skip


def _books(rng: np.random.Generator, width: float, levels: Array, space: float, books: int) -> dict[str, Part]:
    covers = np.array(_COVERS)
    each = max(books // len(levels), 3)
    low, size, tone = [], [], []
    for level, y in enumerate(levels):
        thick = rng.uniform(0.6, 1.6, each)
        thick *= width * rng.uniform(0.72, 0.97) / thick.sum()
        x = -width / 2 + 0.01 + np.concatenate([[0], np.cumsum(thick)[:-1]])
        if level % 2:
            x = -x - thick
        tall = space * rng.uniform(0.66, 0.93, each)
        low.append(np.stack([x, np.full(each, y + 0.0005), np.full(each, -0.135)], axis=1))
        size.append(np.stack([thick * 0.94, tall, rng.uniform(0.17, 0.24, each)], axis=1))
        tone.append(covers[rng.integers(0, len(covers), each)] * rng.uniform(0.7, 1.25, (each, 1)))
    a, s, c = np.concatenate(low), np.concatenate(size), np.concatenate(tone)
    left, right = a.copy(), a.copy()
    board = np.minimum(s[:, 0] * 0.14, 0.004)
    right[:, 0] += s[:, 0] - board
    cover = np.stack([board, s[:, 1], s[:, 2]], axis=1)
    spine_low = a + np.stack([0 * board, 0 * board, s[:, 2] - 0.004], axis=1)
    spine = np.stack([s[:, 0], s[:, 1], np.full(len(s), 0.006)], axis=1)
    hard = [
        boxes(p + q / 2, q).tinted(np.repeat(c, 24, axis=0))
        for p, q in ((left, cover), (right, cover), (spine_low, spine))
    ]
    pages_low = a + np.stack([board * 0.9, 0.004 + 0 * board, 0.004 + 0 * board], axis=1)
    pages = np.stack([s[:, 0] - board * 1.8, s[:, 1] - 0.009, s[:, 2] - 0.0065], axis=1)
    band = [
        spine_low + np.stack([0.1 * s[:, 0], share * s[:, 1], np.full(len(s), 0.0052)], axis=1)
        for share in (0.16, 0.74)
    ]
    strip = np.stack([0.8 * s[:, 0], 0.045 * s[:, 1], np.full(len(s), 0.0016)], axis=1)
    return {
        "book": merge(hard),
        "paper": boxes(pages_low + pages / 2, pages),
        "gilt": merge([boxes(b + strip / 2, strip) for b in band]),
    }


def curtain(rng: np.random.Generator, width: float, height: float, folds: int, detail: float) -> Part:
    """Hanging folds, 4 mm thick, from y = 0 to ``height``, facing +z; the folds open towards the hem."""
    x = np.linspace(-width / 2, width / 2, cut(13 * folds, detail, 3 * folds))
    y = np.linspace(0.0, height, cut(44, detail, 4))
    px, py = np.meshgrid(x, y, indexing="ij")
    drop = 1.0 - py / height
    phase = 2 * np.pi * folds * (px / width + 0.5) + 0.7 * np.sin(rng.uniform(0, 6) + 3.0 * px / width + 1.2 * drop)
    pz = (0.028 + 0.024 * drop) * np.sin(phase) + 0.010 * np.sin(2.3 * phase + 4.0 * drop) * drop
    return thick_sheet(np.stack([px + 0.012 * np.cos(phase) * drop, py, pz], axis=-1), 0.004)


def carpet(width: float, depth: float, detail: float) -> Part:
    """A closed, slightly wavy pad, 12 mm high, with texture coordinates that fit one picture."""
    x, z = (
        np.linspace(-width / 2, width / 2, cut(105, detail, 4)),
        np.linspace(-depth / 2, depth / 2, cut(75, detail, 3)),
    )
    px, pz = np.meshgrid(x, z, indexing="xy")
    edge = np.minimum(width / 2 - np.abs(px), depth / 2 - np.abs(pz))
    py = (
        0.004
        + 0.009 * np.clip(edge / 0.02, 0, 1)
        + 0.0022 * np.sin(41 * px) * np.sin(37 * pz)
        + 0.0015 * np.sin(9 * px + 5 * pz)
    )
    part = thick_sheet(np.stack([px, py, pz], axis=-1), 0.003)
    v = part.vertices
    uv = np.stack([v[:, 0] / width + 0.5, 0.5 - v[:, 2] / depth], axis=1)
    return Part(np.maximum(v, (-np.inf, 0.001, -np.inf)), part.faces, part.normals, uv)


def pile(rng: np.random.Generator, width: float, depth: float, count: int, tall: float) -> Part:
    """``count`` tufts on a carpet: closed, upright three-sided pyramids of 4 triangles."""
    foot = rng.uniform(-0.5, 0.5, (count, 2)) * (width - 0.03, depth - 0.03)
    size = float(np.sqrt(width * depth / max(count, 1))) * 0.62
    angle = rng.uniform(0, 2 * np.pi, (count, 1)) + np.array([0, 2, 4]) * np.pi / 3
    base = np.stack(
        [foot[:, :1] + size * np.cos(angle), np.full((count, 3), 0.011), foot[:, 1:] - size * np.sin(angle)], -1
    )
    tip = np.stack([foot[:, 0], 0.013 + tall * rng.uniform(0.6, 1.2, count), foot[:, 1]], 1) + rng.normal(
        0, 0.3 * size, (count, 3)
    ) * (1, 0, 1)
    v = np.concatenate([base, tip[:, None]], axis=1).reshape(-1, 3)
    v[:, 0], v[:, 2] = v[:, 0].clip(-width / 2, width / 2), v[:, 2].clip(-depth / 2, depth / 2)
    pattern = np.array([[0, 1, 3], [1, 2, 3], [2, 0, 3], [0, 2, 1]])
    uv = np.repeat(np.stack([foot[:, 0] / width + 0.5, 0.5 - foot[:, 1] / depth], axis=1), 4, axis=0)
    tone = np.repeat(rng.uniform(0.9, 1.12, (count, 1)), 4, axis=0) * np.tile([[0.9], [0.9], [0.9], [1.08]], (count, 1))
    # Normals near the pad's own: wool scatters light, facets would look like chips.
    normals = unit(np.repeat(rng.normal(0, 0.22, (count, 3)), 4, axis=0) + UP)
    return Part(v, repeat_pattern(pattern, 4, count), normals, uv).tinted(np.repeat(tone, 3, axis=1))


def picture(width: float, height: float) -> dict[str, Part]:
    """A framed picture that hangs with its back at z = 0: frame, canvas and, 2 mm before it, nothing else."""
    canvas = box((-width / 2 + 0.02, -height / 2 + 0.02, 0.002), (width / 2 - 0.02, height / 2 - 0.02, 0.014))
    v = canvas.vertices
    uv = np.stack([v[:, 0] / (width - 0.04) + 0.5, v[:, 1] / (height - 0.04) + 0.5], axis=1)
    return {"frame": frame(width, height, 0.035, 0.028), "canvas": Part(canvas.vertices, canvas.faces, uv=uv)}


def snake_plant(rng: np.random.Generator, count: int) -> Part:
    """Stiff upright leaves from one root."""
    angle = rng.uniform(0, 2 * np.pi, count)
    out = np.stack([np.cos(angle), 0 * angle, np.sin(angle)], axis=1)
    tall = rng.uniform(0.35, 0.75, count)
    part = blades(
        out * rng.uniform(0.01, 0.07, (count, 1)),
        out * rng.uniform(0.04, 0.2, (count, 1)),
        tall,
        rng.uniform(0.05, 0.08, count),
        8,
    )
    band = 0.75 + 0.35 * (np.arange(25) // 3 % 2)
    return part.tinted((rng.uniform(0.8, 1.2, (count, 1, 1)) * band[None, :, None] * np.ones(3)).reshape(-1, 3))


def bush(rng: np.random.Generator, stems: int, each: int, height: float) -> dict[str, Part]:
    """A house plant: bent stems with folded leaves."""
    t = np.linspace(0, 1, 7)[None, :, None]
    lean = rng.normal(0, 0.24, (stems, 3)) * (1, 0, 1)
    tall = height * rng.uniform(0.55, 1.0, (stems, 1, 1))
    paths = lean[:, None] * t**1.6 + np.array([0, 1.0, 0]) * tall * t + rng.normal(0, 0.006, (stems, 7, 3))
    pick, at = rng.integers(0, stems, stems * each), rng.integers(2, 7, stems * each)
    angle = rng.uniform(0, 2 * np.pi, stems * each)
    along = np.stack([np.cos(angle), rng.uniform(-0.25, 0.5, len(angle)), np.sin(angle)], axis=1)
    length = rng.uniform(0.09, 0.17, len(angle))
    foliage = leaves(paths[pick, at], along, np.tile((0.0, 1.0, 0.0), (len(angle), 1)), length, length * 0.55, 0.2)
    tone = rng.uniform(0.7, 1.3, (len(angle), 1)) * np.array([1.0, 1.0, 0.9])
    return {"stem": tubes(paths, np.full((stems, 7), 0.005), 5), "leaf": foliage.tinted(np.repeat(tone, 4, axis=0))}


def towel(width: float, drop: float, detail: float) -> Part:
    """A folded towel over a rail at the origin that runs along x."""
    r = 0.016
    arc = np.linspace(0.0, np.pi, cut(10, detail, 4))
    front = np.stack([np.linspace(-drop, 0.0, cut(22, detail, 4)), np.full(cut(22, detail, 4), r)], axis=1)
    back = np.stack([np.linspace(0.0, -0.82 * drop, cut(18, detail, 4)), np.full(cut(18, detail, 4), -r)], axis=1)
    path = np.concatenate([front[:-1], np.stack([r * np.sin(arc), r * np.cos(arc)], axis=1), back[1:]])
    x = np.linspace(-width / 2, width / 2, cut(36, detail, 4))
    px, py = np.meshgrid(x, path[:, 0], indexing="ij")
    wave = 0.006 * np.sin(19 * px) * np.clip(-py / 0.3, 0, 1) * np.sign(path[:, 1])
    return thick_sheet(np.stack([px, py, path[:, 1] + wave], axis=-1), 0.007)


def apples(rng: np.random.Generator, count: int, detail: float) -> Part:
    """A small heap of fruit in a circle of 8 cm, lowest point at y = 0."""
    out = []
    for k in range(count):
        layer = 0 if k < 5 else 1
        r, a = (0.075, k * 2 * np.pi / 5) if layer == 0 else (0.03, k * 2.4)
        place = (r * np.cos(a), 0.036 + 0.055 * layer, r * np.sin(a))
        tone = np.array([0.55, 0.06, 0.03]) if rng.random() < 0.6 else np.array([0.35, 0.45, 0.06])
        out.append(
            sphere((0.037, 0.034, 0.037), cut(28, detail, 4)).transformed(yaw_matrix(40 * k), place).tinted(tone)
        )
    return merge(out)
