"""Depth images with layers, and marches through them, against loops over every triangle in plain Python."""

from __future__ import annotations

import math

import numpy as np
import pytest

from torchrender.kernels.raster.records import NO_HOLES, Holes
from torchrender.kernels.rays.depth_march import CLEAR, HIT, UNKNOWN
from torchrender.kernels.reflections.layer_draw import Boxes, Layers, LayerViews, Seen, draw_layers
from torchrender.kernels.reflections.layer_march import GROUP, UNSURE, march_clusters, mark_blocks
from torchrender.kernels.reflections.secant import BISECTIONS, Painted, Painting, search_rays

SIZE = (24, 18)  # columns, rows
BLOCK = 2


def soup(seed: int, count: int = 40) -> tuple[np.ndarray, np.ndarray]:
    """Random triangles before and behind a camera at the origin that looks along z."""
    rng = np.random.default_rng(seed)
    middle = rng.uniform([-2.5, -2.5, -1.0], [2.5, 2.5, 6.0], (count, 1, 3))
    corners = middle + rng.normal(0.0, 0.6, (count, 3, 3))
    return corners.reshape(-1, 3), np.arange(3 * count, dtype=np.int32).reshape(-1, 3)


def crossing(corners: np.ndarray, p: np.ndarray, d: np.ndarray) -> tuple[float, float, float]:
    """Parameter and weights where a ray meets the plane of a triangle."""
    a, b, c = corners
    matrix = np.stack([-d, b - a, c - a], axis=1)
    if abs(np.linalg.det(matrix)) < 1e-14:
        return math.inf, 0.0, 0.0
    t, u, v = np.linalg.solve(matrix, p - a)
    return float(t), float(u), float(v)


def inside(u: float, v: float, slack: float = 0.0) -> bool:
    return u >= -slack and v >= -slack and u + v <= 1.0 + slack


def views(near: float = 0.2) -> LayerViews:
    """Two cameras, the second one turned about its axis and moved."""
    turned = np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    texels = SIZE[0] * SIZE[1]
    return LayerViews(
        eye=np.array([[0.0, 0.0, 0.0], [0.3, -0.2, -0.5]]),
        look=np.stack([np.eye(3), turned]),
        box=np.array([[-0.8, -0.7, 0.9, 0.6]] * 2),
        size=np.array([SIZE, SIZE], np.int64),
        near=np.full(2, near),
        first=np.array([0, texels], np.int64),
    )


def boxes_of(vertices: np.ndarray, faces: np.ndarray, size: int = 4) -> Boxes:
    runs = np.array([(k, min(k + size, len(faces))) for k in range(0, len(faces), size)], np.int64)
    bounds = np.stack([np.stack([vertices[faces[a:b]].min((0, 1)), vertices[faces[a:b]].max((0, 1))]) for a, b in runs])
    return Boxes(np.arange(len(faces), dtype=np.int32), runs, bounds)


def drawn(
    vertices: np.ndarray, faces: np.ndarray, count: int, holes: Holes = NO_HOLES, marked: np.ndarray | None = None
) -> Layers:
    """Both images, with nothing before them that they look from behind."""
    total = 2 * SIZE[0] * SIZE[1]
    layers = Layers(np.full((total, count), np.inf, np.float32), np.full((total, count), -1, np.int32))
    blocks = (SIZE[0] // BLOCK) * (SIZE[1] // BLOCK)
    marks = (BLOCK, np.array([0, blocks]), np.ones(2 * blocks, np.uint8) if marked is None else marked)
    nobody = Seen(np.zeros(3, np.int64), np.zeros(0, np.int64), np.zeros((0, 3)))
    room = (np.empty(total, np.float32), np.empty(total, np.float32))
    draw_layers((vertices, faces), holes, boxes_of(vertices, faces), views(), nobody, marks, room, layers)
    return layers


def texel_ray(c: int, x: int, y: int) -> tuple[np.ndarray, np.ndarray]:
    """Eye, and the direction of depth 1 through a texel's centre."""
    view = views()
    low, high = view.box[c, :2], view.box[c, 2:]
    u, v = low + (high - low) * (np.array([x, y]) + 0.5) / SIZE
    return view.eye[c], u * view.look[c, 0] + v * view.look[c, 1] + view.look[c, 2]


@pytest.mark.parametrize("seed", range(3))
def test_texels_keep_the_nearest_surfaces_in_order(seed: int) -> None:
    vertices, faces = soup(seed)
    layers = drawn(vertices, faces, 3)
    behind = 0
    for c in range(2):
        for y in range(SIZE[1]):
            for x in range(SIZE[0]):
                p, d = texel_ray(c, x, y)
                hits = [(crossing(vertices[face], p, d), k) for k, face in enumerate(faces)]
                found = sorted((t, k) for (t, u, v), k in hits if t > 0.2 and inside(u, v))[:3]
                at = views().first[c] + y * SIZE[0] + x
                assert layers.triangle[at, : len(found)].tolist() == [k for _, k in found]
                np.testing.assert_allclose(layers.depth[at, : len(found)], [t for t, _ in found], rtol=1e-5)
                assert np.isinf(layers.depth[at, len(found) :]).all()
                behind += len(found) > 1
    assert behind > 5


def test_what_the_pixels_lie_before_is_left_out() -> None:
    """A reflector at depth 3 hides what lies between it and the camera behind it, where it has pixels."""
    vertices = np.array([[-40.0, -9, 1], [40, -9, 1], [0, 40, 1], [-40, -9, 5], [40, -9, 5], [0, 40, 5]])
    faces = np.arange(6, dtype=np.int32).reshape(2, 3)
    total = 2 * SIZE[0] * SIZE[1]
    rows = np.stack([texel_ray(0, x, y)[1] * 3.0 for y in range(SIZE[1]) for x in range(SIZE[0] // 2)])
    seen = Seen(np.array([0, len(rows), len(rows)]), np.arange(len(rows)), rows)
    layers = Layers(np.full((total, 2), np.inf, np.float32), np.full((total, 2), -1, np.int32))
    blocks = (SIZE[0] // BLOCK) * (SIZE[1] // BLOCK)
    marks = (BLOCK, np.array([0, blocks]), np.ones(2 * blocks, np.uint8))
    room = (np.empty(total, np.float32), np.empty(total, np.float32))
    draw_layers((vertices, faces), NO_HOLES, boxes_of(vertices, faces), views(), seen, marks, room, layers)
    first = layers.depth[: total // 2, 0].reshape(SIZE[1], SIZE[0])
    assert (first[:, : SIZE[0] // 2] == 5.0).all() and (first[:, -4:] == 1.0).all()


def test_holes_let_through_what_lies_behind() -> None:
    vertices, faces = soup(5, 6)
    uv = np.tile(np.array([[0.25, 0.75]], np.float32), (len(vertices), 1))
    holes = Holes(np.array([0, -1, -1, -1, -1, -1], np.int32), np.array([[0, 1, 1]]), np.zeros(1, np.uint8), uv)
    plain, holed = drawn(vertices, faces, 4), drawn(vertices, faces, 4, holes)
    assert (plain.triangle == 0).any() and not (holed.triangle == 0).any()
    assert (holed.triangle == 1).sum() == (plain.triangle == 1).sum()


def rays(seed: int, count: int = 300) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    origin = rng.uniform([-0.4, -0.4, 0.8], [0.4, 0.4, 1.0], (count, 3))
    toward = rng.normal([0.0, 0.0, 1.0], [0.35, 0.35, 0.2], (count, 3))
    return origin, toward / np.linalg.norm(toward, axis=1, keepdims=True), rng.integers(0, 2, count)


def marched(
    vertices: np.ndarray, faces: np.ndarray, layers: Layers, sent: tuple[np.ndarray, ...]
) -> tuple[np.ndarray, ...]:
    count = len(sent[0])
    found = (
        np.empty(count, np.uint8), np.empty(count), np.empty(count, np.int64), np.empty((count, 2), np.float32),
        np.zeros(-(-count // GROUP), np.int64),
    )  # fmt: skip
    ends = (np.full(count, 1e-6), np.full(count, 8.0))
    march_clusters((vertices, faces), NO_HOLES, views(), layers, sent, ends, found)
    return found


@pytest.mark.parametrize("seed", range(4))
def test_sure_answers_are_the_first_hits(seed: int) -> None:
    """Triangles of many texels, all layers kept: what is said to be sure is what a loop over all triangles finds."""
    vertices, faces = soup(seed, 14)
    sent = rays(seed)
    state, t, triangle, weights, steps = marched(vertices, faces, drawn(vertices, faces, 14), sent)
    assert (steps > 0).all()
    sure = wrong = 0
    for i in range(len(t)):
        hits = [(crossing(vertices[face], sent[0][i], sent[1][i]), k) for k, face in enumerate(faces)]
        found = sorted((h, k) for h, k in hits if 1e-6 < h[0] < 8.0 and inside(h[1], h[2]))
        if state[i] == HIT:
            sure += 1
            wrong += not found or found[0][1] != triangle[i]
            if found and found[0][1] == triangle[i]:
                assert t[i] == pytest.approx(found[0][0][0], rel=1e-9)
                assert weights[i].tolist() == pytest.approx(found[0][0][1:], abs=1e-5)
        elif state[i] == CLEAR:
            sure += 1
            wrong += bool(found)
        else:
            assert state[i] in (UNKNOWN, UNSURE)
    assert sure > 60 and wrong <= 0.03 * sure  # slivers that no texel holds


def test_a_ray_behind_the_last_layer_is_not_sure() -> None:
    """One layer: a wall hides what the ray meets behind it."""
    vertices = np.array([[-9.0, -9, 2], [0.2, -9, 2], [0.2, 9, 2], [-9, 9, 2], [-9, -9, 5], [9, -9, 5], [0, 19, 5]])
    faces = np.array([[0, 1, 2], [0, 2, 3], [4, 5, 6]], np.int32)
    origin = np.array([[1.0, 0.0, 1.0]])
    toward = np.array([[-0.5, 0.0, 1.2]]) / np.linalg.norm([-0.5, 0.0, 1.2])
    sent = (origin, toward, np.zeros(1, np.int64))
    one, many = (marched(vertices, faces, drawn(vertices, faces, n), sent) for n in (1, 4))
    assert one[0][0] in (UNSURE, UNKNOWN)
    assert many[2][0] == 2 and many[0][0] in (HIT, UNSURE)


@pytest.mark.parametrize("seed", range(3))
def test_marked_blocks_lose_nothing_that_rays_meet(seed: int) -> None:
    vertices, faces = soup(seed)
    sent = rays(seed, 40)
    blocks = (SIZE[0] // BLOCK) * (SIZE[1] // BLOCK)
    marked, places = np.zeros(2 * blocks, np.uint8), np.array([0, blocks])
    ends = (np.full(40, 1e-6), np.full(40, 8.0))
    mark_blocks(views(), (BLOCK, places), marked, sent, ends)
    view = views()
    for i in range(40):  # every place along the ray that has an image lies in a marked block
        c = sent[2][i]
        for t in np.linspace(1e-6, 8.0, 200):
            own = view.look[c] @ (sent[0][i] + t * sent[1][i] - view.eye[c])
            if own[2] <= view.near[c]:
                continue
            x, y = (own[:2] / own[2] - view.box[c, :2]) / (view.box[c, 2:] - view.box[c, :2]) * SIZE
            if 0 <= x < SIZE[0] and 0 <= y < SIZE[1]:
                assert marked[places[c] + int(y) // BLOCK * (SIZE[0] // BLOCK) + int(x) // BLOCK]
    whole, part = drawn(vertices, faces, 4), drawn(vertices, faces, 4, marked=marked)
    first, second = marched(vertices, faces, whole, sent), marched(vertices, faces, part, sent)
    same = (first[2] == second[2]) & (first[0] == second[0])
    assert same.mean() > 0.95  # guesses may look at texels beside the blocks


def test_the_literal_search_finds_the_first_step_behind_the_image() -> None:
    """A slope seen from the origin: the loop over steps and bisections of the text, with numbers of its own."""
    width, height = 40, 24
    k = np.array([[20.0, 0.0, 20.0], [0.0, 22.0, 12.0], [0.0, 0.0, 1.0]])
    columns = np.arange(width) + 0.5
    depth = np.tile((3.0 + 0.05 * columns).astype(np.float32), (height, 1))
    color = np.random.default_rng(0).uniform(size=(height, width, 3)).astype(np.float32)
    image = Painting(
        depth, np.arange(height * width).reshape(height, width), color,
        np.concatenate([k, np.zeros((3, 1))], axis=1), 0.1, 1.0 / 20.0,
    )  # fmt: skip
    origin, toward, _ = rays(3, 60)
    found = Painted(np.empty(60, np.uint8), np.empty(60), np.empty(60, np.int64), np.zeros((60, 3), np.float32))
    search_rays(image, 1e-4, (origin, toward), (1e-6, np.full(60, 9.0)), found)

    def place(i: int, t: float) -> tuple[np.ndarray, float]:
        at = k @ (origin[i] + t * toward[i])
        return at[:2] / at[2], float(at[2])

    def behind(uv: np.ndarray, z: float) -> bool:
        x, y = np.floor(uv).astype(int)
        return bool(0 <= x < width and 0 <= y < height and z >= depth[y, x] * (1.0 + 1e-4))

    hits = 0
    for i in range(60):
        (start, z0), (end, z1) = place(i, 1e-6), place(i, 9.0)
        if z1 <= 0.1:
            continue
        count = max(1, math.ceil(max(abs(end - start))))
        share = None
        for m in range(1, count + 1):
            if behind(start + (end - start) * m / count, 1.0 / (1.0 / z0 + (1.0 / z1 - 1.0 / z0) * m / count)):
                low, share = (m - 1) / count, m / count
                for _ in range(BISECTIONS):
                    middle = 0.5 * (low + share)
                    if behind(start + (end - start) * middle, 1.0 / (1.0 / z0 + (1.0 / z1 - 1.0 / z0) * middle)):
                        share = middle
                    else:
                        low = middle
                break
        assert (found.state[i] == HIT) == (share is not None)
        if share is not None:
            hits += 1
            t = 1e-6 + (9.0 - 1e-6) * share * z0 / (z1 + share * (z0 - z1))
            assert found.t[i] == pytest.approx(t, rel=1e-9)
            x, y = np.floor(start + (end - start) * share).astype(int)
            assert found.triangle[i] == y * width + x
            around = color[max(y - 1, 0) : y + 2, max(x - 1, 0) : x + 2].reshape(-1, 3)
            assert (found.color[i] >= around.min(0) - 1e-6).all() and (found.color[i] <= around.max(0) + 1e-6).all()
    assert hits > 30
