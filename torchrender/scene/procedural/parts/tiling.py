"""The washroom's measures, and its tiles as real geometry."""

from __future__ import annotations

import numpy as np

from torchrender.scene.procedural.parts.assembly import Assembly
from torchrender.scene.procedural.parts.shapes import Array, Part, merge, pitch_matrix, repeat_pattern

X, Z, H = 1.7, 1.5, 2.5  # half width, half depth and height, metres
WINDOW = ((-0.35, 0.45), (1.35, 2.15))  # low and high corner (z, y)
TILED = 2.06  # height of the wall tiles


def tiles(
    rng: np.random.Generator, width: float, height: float, wish: tuple[float, float], colors: Array, lift: float = 0.006
) -> Part:
    """Bevelled tiles (12 triangles each) on z = 0 from (0, 0) to (width, height), 3 mm of grout between."""
    n, m = max(round(width / wish[0]), 1), max(round(height / wish[1]), 1)
    i, j = (v.reshape(-1) for v in np.meshgrid(np.arange(n), np.arange(m), indexing="ij"))
    a, b, g, e = width / n, height / m, 0.0015, 0.0035
    x0, x1, y0, y1 = i * a + g, (i + 1) * a - g, j * b + g, (j + 1) * b - g
    rise = lift * rng.uniform(0.92, 1.08, len(i))

    def ring(inset: float, z: Array) -> Array:
        return np.stack(
            [
                np.stack([x, y, z], -1)
                for x, y in (
                    (x0 + inset, y0 + inset),
                    (x1 - inset, y0 + inset),
                    (x1 - inset, y1 - inset),
                    (x0 + inset, y1 - inset),
                )
            ],
            1,
        )

    v = np.concatenate([ring(0.0, 0 * rise - 0.002), ring(e, rise)], axis=1)
    side = [[k, (k + 1) % 4, 4 + (k + 1) % 4] for k in range(4)] + [[k, 4 + (k + 1) % 4, 4 + k] for k in range(4)]
    pattern = np.array([[4, 5, 6], [4, 6, 7], [0, 2, 1], [0, 3, 2], *side])
    tone = colors[rng.integers(0, len(colors), len(i))] if len(colors) > 2 else colors[(i + j) % len(colors)]
    tone = tone * rng.uniform(0.93, 1.05, (len(i), 1))
    return Part(v.reshape(-1, 3), repeat_pattern(pattern, 8, len(i))).tinted(np.repeat(tone, 8, axis=0))


def tiled_room(made: Assembly, rng: np.random.Generator, d: float) -> None:
    """Tiles on the four walls, around window and door, and on the floor."""
    step = float(np.clip(0.17 / d**0.5, 0.05, 0.7))
    pale = np.array([(0.50, 0.60, 0.58), (0.54, 0.64, 0.61), (0.47, 0.57, 0.56)])
    deep = np.array([(0.05, 0.20, 0.22), (0.06, 0.24, 0.25), (0.04, 0.17, 0.20)])
    floor = np.array([(0.62, 0.60, 0.56), (0.14, 0.15, 0.16)])
    spans = {  # name: yaw, origin, width, gaps
        "back": (0.0, (-X, 0, -Z), 2 * X),
        "left": (90.0, (-X, 0, Z), 2 * Z),
        "right": (-90.0, (X, 0, -Z), 2 * Z),
        "front": (180.0, (X, 0, Z), 2 * X),
    }
    (z0, y0), (z1, _) = WINDOW
    for name, (yaw, origin, width) in spans.items():
        areas = [(0.0, width)]
        if name == "front":  # the door
            areas = [(0.0, X - 0.55 - 0.56), (X - 0.55 + 0.56, width)]
        parts = []
        for low, high in areas:
            if name == "left":  # below, beside and above the window
                b0, b1 = Z - z1 - 0.06, Z - z0 + 0.06
                cells = [(0.0, b0, 0, TILED), (b0, b1, 0, y0 - 0.04), (b1, width, 0, TILED)]
            else:
                cells = [(low, high, 0, TILED)]
            parts += [
                tiles(rng, q - p, t - s, (step * 1.5, step * 0.75), pale).moved((p, s, 0)) for p, q, s, t in cells
            ]
        band = tiles(rng, width, 0.055, (step * 0.6, 0.055), deep, 0.009).moved((0, TILED + 0.003, 0))
        if name not in ("left", "front"):
            parts.append(band)
        made.add(f"{name} wall tiles", ("wall tile", merge(parts).moved(origin, yaw_deg=yaw)))
    ground = tiles(rng, 2 * X, 2 * Z, (step * 1.9, step * 1.9), floor, 0.004)
    made.add("floor tiles", ("floor tile", ground.transformed(pitch_matrix(-90.0), (-X, 0.0, Z))))
