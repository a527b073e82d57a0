"""Light that is not sent because objects hide it, beside a slow twin."""

from __future__ import annotations

import numpy as np
import pytest

from torchrender.kernels.shading.records import IRRADIANCE_SIDE
from torchrender.kernels.shading.sky import octahedral
from torchrender.kernels.sky_shadows.lost import Known, Seen, take_away

COUNT = 2500  # more than two threads take at a time
F = np.float32


def unit(generator: np.random.Generator) -> np.ndarray:
    values = generator.normal(size=(COUNT, 3))
    return (values / np.linalg.norm(values, axis=1, keepdims=True)).astype(F)


def arriving(texels: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """Irradiance over pi about a direction, as the shading kernel looks it up."""
    across, down = octahedral.py_func(*(F(v) for v in direction))
    x, y = across * IRRADIANCE_SIDE + 0.5, down * IRRADIANCE_SIDE + 0.5  # an edge of one texel around
    i, j = min(int(x), IRRADIANCE_SIDE), min(int(y), IRRADIANCE_SIDE)
    u, v = x - i, y - j
    rows = texels.reshape(IRRADIANCE_SIDE + 2, IRRADIANCE_SIDE + 2, 3)
    above, below = ((1 - u) * rows[k, i] + u * rows[k, i + 1] for k in (j, j + 1))
    return (1 - v) * above + v * below


def lost(seen: Seen, known: Known, texels: np.ndarray, i: int) -> np.ndarray:
    """Light of one pixel: what it got less what the spheres and everything else leave of it."""
    left, normal, sent = (part[i].astype(float) for part in seen)
    if not len(known.taken):
        return arriving(texels, normal[:3]) * (1 - left[:3]) * sent
    others = min(max(known.sky[i] / max(left[3], 1e-6), 0.0), 1.0)
    toward, was = normal[:3], arriving(texels, normal[:3])
    if len(known.bent):
        was = arriving(texels, known.bent[i])
        share = min(max((1 - others) / max(1 - known.sky[i], 1e-6), 0.0), 1.0)
        toward = toward + share * (known.bent[i] - toward)
        toward = toward / max(np.linalg.norm(toward), 1e-12)
    return (was * known.taken[i] - arriving(texels, toward) * others * left[:3]) * sent


@pytest.mark.parametrize("around", ["nothing", "shares", "shares and directions"])
def test_it_is_what_the_slow_twin_says(around: str) -> None:
    generator = np.random.default_rng(len(around))
    texels = generator.uniform(0.1, 2.0, ((IRRADIANCE_SIDE + 2) ** 2, 3)).astype(F)
    normal = np.concatenate([unit(generator), np.zeros((COUNT, 1), F)], axis=1)
    sent = generator.uniform(0.1, 1.0, (COUNT, 3)).astype(F)
    sent[::5] = 0.0
    seen = Seen(generator.uniform(0.0, 1.0, (COUNT, 4)).astype(F), normal, sent)
    shares = [generator.uniform(0.0, 1.0, COUNT).astype(F) for _ in range(2)]
    none = np.zeros((0, 3), F)
    if around == "nothing":
        known = Known(none[:, 0], none[:, 0], none)
    else:
        known = Known(*shares, unit(generator) if around.endswith("directions") else none)
    out = np.zeros((COUNT, 3), F)
    take_away(seen, known, texels, out)
    assert (out[::5] == 0.0).all()
    rows = range(1, COUNT, 7)
    wanted = np.array([lost(seen, known, texels, i) for i in rows])
    # Directions at a border between texels may be read from either side of it.
    off = np.abs(out[list(rows)] - wanted).max(axis=1)
    assert np.quantile(off, 0.99) < 2e-5 and np.abs(wanted).max() > 0.5
