"""Small procedural textures (H,W,3), linear RGB in [0,1], that repeat without a seam; row 0 is the top."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from torchrender.scene.procedural.parts.shapes import Array

Color = Sequence[float]


def noise(rng: np.random.Generator, size: int, *, slope: float = 1.6, stretch: float = 1.0) -> Array:
    """Periodic fractal noise (size,size), mean 0, deviation 1; ``stretch`` > 1 draws it out vertically."""
    from scipy.fft import irfft2, rfft2  # imports a tenth of what torch does

    f = np.fft.fftfreq(size).astype(np.float32)[:, None] * np.float32(stretch)
    g = np.fft.rfftfreq(size).astype(np.float32)[None, :]
    square = f * f + g * g
    square[0, 0] = 1.0
    spectrum = rfft2(rng.standard_normal((size, size), dtype=np.float32)) / square ** np.float32(slope / 2)
    spectrum[0, 0] = 0.0
    field = irfft2(spectrum, s=(size, size))
    return np.asarray(field / field.std(), dtype=np.float64)


def blend(low: Color, high: Color, share: Array) -> Array:
    """Colours (..., 3) between two, by a share (...) that is clamped to [0,1]."""
    s = np.clip(share, 0.0, 1.0)[..., None]
    return np.asarray(low) * (1 - s) + np.asarray(high) * s


def mottled(rng: np.random.Generator, low: Color, high: Color, *, size: int = 256, slope: float = 1.4) -> Array:
    """Blotches of two colours: earth, stone, moss, plaster."""
    return blend(low, high, 0.5 + 0.28 * noise(rng, size, slope=slope))


def wood(rng: np.random.Generator, low: Color, high: Color, *, size: int = 256) -> Array:
    """Grain that runs vertically (along v)."""
    wide, fine = noise(rng, size, slope=1.5, stretch=10.0), noise(rng, size, slope=0.7, stretch=22.0)
    rings = 0.5 + 0.5 * np.sin(2 * np.pi * (0.9 * wide + np.arange(size)[None, :] / size * 6))
    return blend(low, high, 0.25 + 0.5 * rings + 0.12 * fine)


def planks(rng: np.random.Generator, low: Color, high: Color, *, columns: int = 6, rows: int = 2) -> Array:
    """Floor boards with staggered ends, boards along v."""
    size = 512
    grain = wood(rng, low, high, size=size)
    y, x = np.mgrid[0:size, 0:size]
    column = x * columns // size
    shift = (column * 0.37 % 1.0 * size).astype(int)
    row = ((y + shift) % size) * rows // size
    tone = 0.78 + 0.3 * rng.random((columns, rows))
    roll = rng.integers(0, size, columns)
    out = grain[(y + roll[column]) % size, x] * tone[column, row][..., None]
    edge_x = np.minimum(x % (size / columns), size / columns - x % (size / columns))
    edge_y = np.minimum((y + shift) % (size / rows), size / rows - (y + shift) % (size / rows))
    groove = np.clip(np.minimum(edge_x, edge_y) / 2.0, 0.35, 1.0)
    return np.clip(out * groove[..., None], 0, 1)


def bricks(
    rng: np.random.Generator, low: Color, high: Color, mortar: Color, *, rows: int = 16, columns: int = 8
) -> Array:
    """Running bond."""
    size = 256
    y, x = np.mgrid[0:size, 0:size] + 0.5
    row = (y * rows / size).astype(int)
    shifted = (x + (row % 2) * size / columns / 2) % size
    column = (shifted * columns / size).astype(int)
    tone = rng.random((rows, columns))[row, column] + 0.15 * noise(rng, size, slope=0.8)
    dy = np.abs((y * rows / size) % 1 - 0.5)
    dx = np.abs((shifted * columns / size) % 1 - 0.5)
    joint = (dy > 0.43) | (dx > 0.465)
    return np.where(joint[..., None], np.asarray(mortar), blend(low, high, tone))


def stripes(colors: Sequence[Color], widths: Sequence[float], *, size: int = 128) -> Array:
    """Vertical stripes (along v) of the given shares of the width."""
    edges = np.cumsum(np.asarray(widths, dtype=float)) / np.sum(widths)
    index = np.searchsorted(edges, (np.arange(size) + 0.5) / size)
    return np.broadcast_to(np.asarray(colors, dtype=float)[index][None], (size, size, 3)).copy()


def rug(rng: np.random.Generator, ground: Color, border: Color, accent: Color) -> Array:
    """A woven carpet: borders, a lattice of diamonds, and a centre medallion."""
    size = 512
    y, x = (np.mgrid[0:size, 0:size] + 0.5) / size
    edge = np.minimum(np.minimum(x, 1 - x) * 1.4, np.minimum(y, 1 - y))
    lattice = np.abs((x * 8) % 1 - 0.5) + np.abs((y * 6) % 1 - 0.5)
    medallion = np.hypot((x - 0.5) * 1.45, y - 0.5) + 0.025 * np.cos(8 * np.arctan2(y - 0.5, (x - 0.5) * 1.45))
    out = blend(ground, accent, ((lattice < 0.16) | ((lattice > 0.42) & (lattice < 0.47))).astype(float) * 0.8)
    for limit, color in ((0.26, border), (0.235, accent), (0.215, ground), (0.13, border), (0.10, accent)):
        out = np.where((medallion < limit)[..., None], np.asarray(color), out)
    zigzag = (np.abs((x * 24) % 1 - 0.5) * 0.05 + np.abs((y * 18) % 1 - 0.5) * 0.05) > 0.026
    out = np.where((edge < 0.105)[..., None], blend(border, accent, zigzag * 0.75), out)
    for limit, color in ((0.03, accent), (0.02, border)):
        out = np.where((edge < limit)[..., None], np.asarray(color), out)
    weave = 1.0 + 0.05 * noise(rng, size, slope=0.4)
    return np.clip(out * weave[..., None], 0, 1)


def landscape(rng: np.random.Generator, *, warm: bool = True) -> Array:
    """A painting: sky, a sun, and ranges of hills that darken towards the front."""
    size = 256
    y, x = (np.mgrid[0:size, 0:size] + 0.5) / size
    sky = ((0.95, 0.55, 0.22), (0.22, 0.24, 0.5)) if warm else ((0.85, 0.86, 0.75), (0.2, 0.42, 0.62))
    out = blend(sky[0], sky[1], 1.15 - 1.7 * y + 0.05 * noise(rng, size, stretch=0.25))
    disc = np.clip((0.085 - np.hypot(x - 0.66, y - 0.4)) * 60, 0, 1)
    out = out * (1 - disc[..., None]) + np.array([1.0, 0.86, 0.5]) * disc[..., None]
    front, back = ((0.03, 0.03, 0.07), (0.5, 0.2, 0.22)) if warm else ((0.03, 0.1, 0.07), (0.3, 0.46, 0.45))
    for k in range(5):
        phase = rng.uniform(0, 6.28, 4)
        ridge = sum(np.sin(2 * np.pi * (f + k % 2) * x + p) / (f + 1) for f, p in enumerate(phase, 1))
        level = 0.5 + 0.105 * k + 0.05 * ridge * (1.2 - 0.15 * k)
        hill = blend(back, front, np.full_like(x, k / 4)) * (0.9 + 0.1 * noise(rng, size, slope=1.0)[..., None])
        out = np.where((y > level)[..., None], hill, out)
    return np.clip(out, 0, 1)


def abstract(rng: np.random.Generator, colors: Sequence[Color]) -> Array:
    """A modern painting: overlapping rectangles of flat colour on a light ground."""
    size = 256
    y, x = (np.mgrid[0:size, 0:size] + 0.5) / size
    out = np.full((size, size, 3), 0.78)
    for k in range(14):
        cx, cy, w, h = *rng.uniform(0.1, 0.9, 2), *rng.uniform(0.06, 0.3, 2)
        inside = (np.abs(x - cx) < w) & (np.abs(y - cy) < h)
        out = np.where(inside[..., None], 0.25 * out + 0.75 * np.asarray(colors[k % len(colors)]), out)
    return np.clip(out * (1 + 0.05 * noise(rng, size, slope=0.7))[..., None], 0, 1)
