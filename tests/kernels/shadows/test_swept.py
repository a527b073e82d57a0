"""Ways that a box may be on, against points along them."""

from __future__ import annotations

import numpy as np

from torchrender.kernels.shadows.swept import Sources, untouched


def meets_by_points(start: np.ndarray, end: np.ndarray, extent: np.ndarray, box: np.ndarray, margin: float) -> bool:
    """Some of many points on the way, with what is about them there, is in the box."""
    for t in np.linspace(0.0, 1.0, 2001):
        at, about = start + t * (end - start), margin + t * extent
        if np.all(at + about >= box[0]) and np.all(at - about <= box[1]):
            return True
    return False


def test_ways_meet_a_box_where_points_on_them_do() -> None:
    random = np.random.default_rng(3)
    box = np.array([[-0.3, -0.2, -0.4], [0.2, 0.3, 0.1]])
    points = random.uniform(-1.5, 1.5, (150, 3))
    places = np.concatenate([random.uniform(-2, 2, (4, 3)), np.array([[1.0], [1.0], [0.0], [0.0]])], axis=1)
    places[3, :3] = [0.0, 1.0, 0.0]
    extents = np.array([[0.0, 0.0, 0.0], [0.0, 0.5, 0.7], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
    out = np.zeros((150, 4), np.bool_)
    margin, far = 0.05, 8.0
    untouched(points, Sources(places, extents), box, (margin, far), out)
    wanted = np.empty_like(out)
    for n, point in enumerate(points):
        for number, place in enumerate(places):
            end = place[:3] if place[3] == 1.0 else point + far * place[:3]
            wanted[n, number] = not meets_by_points(point, end, extents[number], box, margin)
    assert 0.1 < out.mean() < 0.95
    assert not (out & ~wanted).any()  # what points meet, ways do
    assert (out != wanted).mean() < 0.01  # points are apart
