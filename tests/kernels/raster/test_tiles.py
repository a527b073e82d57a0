"""Culling, binning, tiles and resolved images, against a loop over all pixels and triangles in exact integers."""

from __future__ import annotations

import dataclasses
import itertools

import numpy as np
import pytest

from torchrender.kernels.meshes import culling_clusters
from torchrender.kernels.raster import binning, draw_view, many_views, tiles
from torchrender.kernels.raster.chosen import NO_ATTRIBUTES
from torchrender.kernels.raster.draw_view import TriangleArrays, View
from torchrender.kernels.raster.project import SUBPIXEL, barycentric_planes, key_plane, snap
from torchrender.kernels.raster.records import (
    NO_EARLIER,
    NO_HOLES,
    NO_IDS,
    NO_LIMITS,
    Frame,
    Nearer,
    Refusals,
    Stored,
    Visible,
)

SIZE = (70, 37)  # columns and rows: four tiles, of which three are cut
BIG = 1e3


def arrays_of(vertices: np.ndarray, faces: np.ndarray) -> TriangleArrays:
    """In one cluster, which is always in view."""
    clusters = np.array([[0, len(faces)]], np.int64)
    order = culling_clusters.spatial_order(vertices, faces, np.array([0, len(faces)]))
    boxes = np.zeros((1, 2, 3))
    culling_clusters.cluster_boxes(vertices, faces, order, clusters, boxes)
    starts, blocks = culling_clusters.vertex_blocks(faces, order, clusters, len(vertices))
    objects = np.arange(len(faces), dtype=np.int64) * 3 % 5
    listed = np.ascontiguousarray(faces[order])
    backs = np.zeros(0, np.bool_)
    return TriangleArrays(vertices, faces, listed, objects, clusters, boxes, order, starts, blocks, backs)


def view_of(orthographic: bool) -> View:
    """At the origin, along z; one unit at depth one is a pixel."""
    width, height = SIZE
    planes = np.zeros((6, 4))
    planes[:, 3] = BIG
    planes[4] = (0, 0, 1, 0)
    return View(np.eye(3), np.zeros(3), planes, Frame(width, height, 0.25, 50.0, orthographic))


def drawn(
    vertices: np.ndarray, faces: np.ndarray, orthographic: bool, cull: str = "none", tests: Refusals | None = None
):
    width, height = SIZE
    out = Visible(
        np.zeros((height, width), np.float32),
        np.zeros((height, width), np.int64),
        np.zeros((height, width), np.int64),
        np.zeros((height, width, 2), np.float32),
    )
    tests = tests or Refusals(NO_LIMITS, NO_EARLIER, NO_HOLES)
    draw_view.draw_view(arrays_of(vertices, faces), view_of(orthographic), cull, tests, out)
    return out


def owns(a: tuple[int, int], b: tuple[int, int], p: tuple[int, int]) -> bool:
    dx, dy = b[0] - a[0], b[1] - a[1]
    value = dx * (p[1] - a[1]) - dy * (p[0] - a[0])
    return value > 0 or (value == 0 and (dy > 0 or (dy == 0 and dx < 0)))


def covered(corners: list[tuple[int, int]], p: tuple[int, int]) -> bool:
    a, b, c = corners
    area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
    if area < 0:
        b, c = c, b
    return area != 0 and owns(a, b, p) and owns(b, c, p) and owns(c, a, p)


def layers(vertices: np.ndarray, faces: np.ndarray, orthographic: bool, cull: str = "none"):
    """For each pixel of the image the (key, triangle, u, v) of everything that covers it, nearest first."""
    width, height = SIZE
    frame = view_of(orthographic).frame
    points = np.column_stack([vertices, np.zeros(len(vertices))])
    found: dict[tuple[int, int], list[tuple[float, int, float, float]]] = {}
    for t, face in enumerate(faces):
        flat = vertices[face, :2] / (1.0 if orthographic else vertices[face, 2:])
        corners = [(int(np.floor(x * SUBPIXEL + 0.5)), int(np.floor(y * SUBPIXEL + 0.5))) for x, y in flat]
        (ax, ay), (bx, by), (cx, cy) = corners
        area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
        if area == 0 or (cull == "back" and area > 0) or (cull == "front" and area < 0):
            continue
        kx, ky, kc, low, high = key_plane(points, faces, t, frame)
        ux, uy, uc, vx, vy, vc = barycentric_planes(points, faces, t, orthographic)
        left, top = width // 2, height // 2
        xs, ys = [c[0] / SUBPIXEL for c in corners], [c[1] / SUBPIXEL for c in corners]
        columns = range(max(int(min(xs)) + left - 2, 0), min(int(max(xs)) + left + 2, width))
        rows = range(max(int(min(ys)) + top - 2, 0), min(int(max(ys)) + top + 2, height))
        for y, x in itertools.product(rows, columns):
            px, py = x - left + 0.5, y - top + 0.5
            if not covered(corners, (int(px * SUBPIXEL), int(py * SUBPIXEL))):
                continue
            key = min(max(kc + kx * px + ky * py, low), high)
            weight = 1.0 if orthographic else 1.0 / key
            u = min(max((ux * px + uy * py + uc) * weight, 0.0), 1.0)
            v = min(max((vx * px + vy * py + vc) * weight, 0.0), 1.0 - u)
            depth = -key if orthographic else 1.0 / key
            if depth <= frame.far:
                found.setdefault((y, x), []).append((key, t, u, v))
    return {place: sorted(list_, key=lambda one: (-one[0], one[1])) for place, list_ in found.items()}


def soup(rng: np.random.Generator, count: int, spread: float) -> tuple[np.ndarray, np.ndarray]:
    """Triangles of all sizes, some a few pixels wide and some over several tiles."""
    z = rng.uniform(1, 40, (count, 1, 1))
    centre = np.concatenate([rng.uniform(-36, 36, (count, 1, 1)), rng.uniform(-19, 19, (count, 1, 1))], axis=2)
    size = np.exp(rng.uniform(-1, np.log(spread), (count, 1, 1)))
    flat = centre + size * rng.normal(size=(count, 3, 2))
    depth = z * (1 + 0.2 * rng.uniform(-1, 1, (count, 3, 1)))
    return np.concatenate([flat * depth, depth], axis=2).reshape(-1, 3), np.arange(3 * count, dtype=np.int32).reshape(
        -1, 3
    )


@pytest.mark.parametrize("cull", ["none", "back", "front"])
@pytest.mark.parametrize("orthographic", [False, True])
def test_images_of_soups_against_the_loop(orthographic: bool, cull: str) -> None:
    rng = np.random.default_rng(5)
    vertices, faces = soup(rng, 120, 25.0)
    if orthographic:
        vertices[:, :2] /= vertices[:, 2:]
    out = drawn(vertices, faces, orthographic, cull)
    found = layers(vertices, faces, orthographic, cull)
    objects = arrays_of(vertices, faces).objects
    for y, x in itertools.product(range(SIZE[1]), range(SIZE[0])):
        if (y, x) not in found:
            assert out.triangle[y, x] == -1 and out.depth[y, x] == np.inf and out.object_id[y, x] == -1
            continue
        key, t, u, v = found[y, x][0]
        depth = -key if orthographic else 1.0 / key
        assert out.triangle[y, x] == t and out.object_id[y, x] == objects[t]
        assert out.depth[y, x] == pytest.approx(depth, rel=2e-7)
        np.testing.assert_allclose(out.barycentric[y, x], [u, v], atol=2e-6)


@pytest.mark.parametrize("width", [1.3, 3.0, 30.0])
def test_of_coincident_triangles_the_lowest_id_wins_however_small_they_are(width: float) -> None:
    """Small ones are tested pixel by pixel, large ones row by row, and the order in a tile is not that of the ids."""
    rng = np.random.default_rng(6)
    for _ in range(20):
        corner = np.concatenate([rng.uniform(-15, 15, (1, 2)) + width * rng.normal(size=(3, 2)), np.ones((3, 1))], 1)
        one = corner * rng.uniform(2, 9, (3, 1))
        far = np.array([[-50, -50, 1.0], [50, -50, 1.0], [0, 60, 1.0]]) * 40
        vertices = np.concatenate([far, one])
        faces = np.array([[3, 4, 5], [0, 1, 2], [3, 4, 5], [3, 4, 5]], np.int32)
        out = drawn(vertices, faces, False)
        assert not np.isin(out.triangle, (2, 3)).any()
        assert ((out.triangle == 0) == (out.depth < 30)).all()


def test_peeling_gives_the_layers_in_order() -> None:
    rng = np.random.default_rng(7)
    vertices, faces = soup(rng, 60, 40.0)
    found = layers(vertices, faces, False)
    out = drawn(vertices, faces, False)
    for n in range(1, 5):
        beyond = out.depth.astype(np.float64)
        limits = (np.where(np.isfinite(beyond), 1.0 / np.maximum(beyond, 1e-9), -np.inf), out.triangle.copy())
        tests = Refusals(NO_LIMITS._replace(keys=limits[0], ids=limits[1]), NO_EARLIER, NO_HOLES)
        out = drawn(vertices, faces, False, tests=tests)
        for y, x in itertools.product(range(SIZE[1]), range(SIZE[0])):
            stack = found.get((y, x), [])
            assert out.triangle[y, x] == (stack[n][1] if len(stack) > n else -1)


@pytest.mark.parametrize(("count", "size"), [(60, 40.0), (500, 5.0)])
def test_surfaces_before_the_stored_ones_are_counted(count: int, size: float) -> None:
    """Of large triangles and of those that are listed by their pixels."""
    rng = np.random.default_rng(8)
    vertices, faces = soup(rng, count, size)
    found = layers(vertices, faces, False)
    width, height = SIZE
    depth, triangle = np.full((height, width), np.inf, np.float32), np.full((height, width), -1)
    wanted, touches = np.zeros((height, width), int), np.zeros((height, width), bool)
    relative = 0.2
    for (y, x), stack in found.items():
        n = int(rng.integers(0, len(stack) + 1))
        wanted[y, x] = n
        if n < len(stack):
            depth[y, x], triangle[y, x] = 1.0 / stack[n][0], stack[n][1]
            zs = [float(np.float32(1.0 / one[0])) for one in stack[:n]]
            touches[y, x] = any(z * (1 + relative) >= float(depth[y, x]) for z in zs)
    out = Nearer(np.zeros((height, width), np.int32), np.zeros((height, width), np.bool_), np.zeros(0, np.int32))
    arrays, view = arrays_of(vertices, faces), view_of(False)
    with draw_view.prepared_view(arrays, view, "none", NO_HOLES) as prepared:
        prepared.count(Stored(depth, triangle), np.array([relative, 0.0]), out)
    np.testing.assert_array_equal(out.number, wanted)
    np.testing.assert_array_equal(out.touching, touches)


def test_clipping_keeps_the_part_beyond_the_near_plane() -> None:
    """A floor that runs from behind the eye to the horizon: depth is that of the plane in every pixel below it."""
    vertices = np.array([[-400.0, 3.0, -5.0], [400.0, 3.0, -5.0], [400.0, 3.0, 30.0], [-400.0, 3.0, 30.0]])
    faces = np.array([[0, 1, 2], [2, 3, 0]], np.int32)
    out = drawn(vertices, faces, False)
    left, top = SIZE[0] // 2, SIZE[1] // 2
    for y, x in itertools.product(range(SIZE[1]), range(SIZE[0])):
        py = y - top + 0.5
        z = 3.0 / py if py > 0 else np.inf
        if z > 30.0:
            assert out.triangle[y, x] == -1
        elif z > 0.25 * 1.01:
            assert out.depth[y, x] == pytest.approx(z, rel=1e-5)
    assert left > 0 and (out.triangle >= 0).any()


def test_a_box_is_that_of_the_pixel_centres_within_its_bounds() -> None:
    rng = np.random.default_rng(9)
    for _ in range(500):
        places = rng.uniform(-9, 9, (3, 2))
        places = np.where(rng.random((3, 2)) < 0.3, np.round(places) + 0.5, places)  # on pixel centres
        bounds = tuple(rng.integers(-6, 3, 2)) + tuple(rng.integers(3, 8, 2))
        x0, y0, x1, y1 = binning.pixel_box(*(snap(*p) for p in places), bounds, 2, -1)
        exact = np.floor(places * SUBPIXEL + 0.5) / SUBPIXEL
        for axis, low, high, shift in ((0, x0, x1, 2), (1, y0, y1, -1)):
            first, last = exact[:, axis].min() + shift, exact[:, axis].max() + shift
            inside = [n for n in range(bounds[axis], bounds[axis + 2] + 1) if first <= n + 0.5 <= last]
            assert list(range(low, high + 1)) == inside


def test_the_least_keys_of_blocks_bound_what_can_be_seen() -> None:
    rng = np.random.default_rng(10)
    keys, lows = rng.uniform(0.1, 1, (32, 64)), np.zeros(tiles.BLOCKS)
    assert tiles.find_lows(keys.reshape(-1), lows) == keys.min()
    blocks = keys.reshape(4, 8, 4, 16).min(axis=(1, 3))
    np.testing.assert_array_equal(lows, blocks.reshape(-1))
    for x0, y0, x1, y1 in ((0, 0, 63, 31), (15, 7, 16, 8), (33, 9, 40, 15), (63, 31, 63, 31)):
        assert tiles.least_low(lows, 0, x0, y0, x1, y1) == blocks[y0 // 8 : y1 // 8 + 1, x0 // 16 : x1 // 16 + 1].min()


@pytest.mark.parametrize("cull", ["none", "sides"])
@pytest.mark.parametrize("orthographic", [False, True])
def test_whole_views_are_the_loop_over_views(orthographic: bool, cull: str) -> None:
    """Also where triangles are clipped, and with fewer views than threads, none in sight, or depth alone."""
    rng = np.random.default_rng(11)
    vertices, faces = soup(rng, 60, 25.0)
    if orthographic:
        vertices[:, :2] /= vertices[:, 2:]
    vertices = np.concatenate([vertices, [[-400.0, 3.0, -5.0], [400.0, 3.0, -5.0], [0.0, 30.0, 30.0]]])
    faces = np.concatenate([faces, [[180, 181, 182]]]).astype(np.int32)
    triangles = arrays_of(vertices, faces)
    triangles = dataclasses.replace(triangles, single_sided=rng.random(len(faces)) < 0.5)
    width, height = SIZE
    one = view_of(orthographic)
    away = dataclasses.replace(one, planes=np.tile([0.0, 0.0, 0.0, -1.0], (6, 1)))
    turned = dataclasses.replace(one, matrix=np.diag([-1.0, 0.7, 1.0]), reference=np.array([0.5, 0.2, 0.4]))
    views = [one, turned, away, one, turned]
    wanted = []
    for view in views:
        out = tuple(np.full((height, width), -7, kind) for kind in (np.float32, np.int64, np.int64))
        wanted.append(Visible(*out, np.full((height, width, 2), -7, np.float32)))
        draw_view.draw_view(triangles, view, cull, Refusals(NO_LIMITS, NO_EARLIER, NO_HOLES), wanted[-1])
    assert {field.name for field in dataclasses.fields(triangles)} >= set(many_views.Shape._fields)
    found = Visible(*(np.stack([np.zeros_like(a) for a in images]) for images in zip(*wanted, strict=True)))
    draw_view.draw_views(triangles, views, (cull, NO_HOLES), found, NO_ATTRIBUTES)
    depth = Visible(np.zeros_like(found.depth), *NO_IDS)
    draw_view.draw_views(triangles, views, (cull, NO_HOLES), depth, NO_ATTRIBUTES)
    np.testing.assert_array_equal(depth.depth, found.depth)
    for k, images in enumerate(wanted):
        for name in Visible._fields:
            np.testing.assert_array_equal(getattr(found, name)[k], getattr(images, name))
    # An orthographic camera looks at the back of the wide one.
    assert (found.triangle[0] == 60).any() == (cull == "none" or not orthographic)
    assert (found.triangle[2] == -1).all() and (found.triangle[1] >= 0).any()


@pytest.mark.parametrize("cull", ["none", "sides"])
@pytest.mark.parametrize("orthographic", [False, True])
def test_regions_are_the_whole(orthographic: bool, cull: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Also where triangles are clipped, lie in several regions or cover all of them, and where nothing is in sight."""
    rng = np.random.default_rng(12)
    vertices, faces = soup(rng, 400, 25.0)
    if orthographic:
        vertices[:, :2] /= vertices[:, 2:]
    vertices = np.concatenate([vertices, [[-400.0, 3.0, -5.0], [400.0, 3.0, -5.0], [0.0, 30.0, 30.0]]])
    faces = np.concatenate([faces, [[1200, 1201, 1202]]]).astype(np.int32)
    triangles = dataclasses.replace(arrays_of(vertices, faces), single_sided=rng.random(len(faces)) < 0.5)
    one = view_of(orthographic)
    width, height = 150, 70  # three tiles by three, of which some are cut
    view = dataclasses.replace(one, frame=one.frame._replace(width=width, height=height))
    away = dataclasses.replace(view, planes=np.tile([0.0, 0.0, 0.0, -1.0], (6, 1)))

    def drawn(view: draw_view.View) -> Visible:
        out = (np.full((height, width), -7, kind) for kind in (np.float32, np.int64, np.int64))
        images = Visible(*out, np.full((height, width, 2), -7, np.float32))
        draw_view.draw_view(triangles, view, cull, Refusals(NO_LIMITS, NO_EARLIER, NO_HOLES), images)
        return images

    wanted = [drawn(view), drawn(away)]
    monkeypatch.setattr(draw_view, "suits_regions", lambda *_: True)
    for region in ((1, 1), (2, 2), (4, 4)):
        monkeypatch.setattr(draw_view, "REGION", region)
        for pose, whole in zip((view, away), wanted, strict=True):
            for name, image in zip(Visible._fields, drawn(pose), strict=True):
                np.testing.assert_array_equal(image, getattr(whole, name))
    assert (wanted[0].triangle >= 0).sum() > 1000 and (wanted[1].triangle == -1).all()


def test_fine_large_pictures_are_drawn_by_regions() -> None:
    """One cluster at depth four, whose diagonal of five covers 1250 pixels."""
    frame = Frame(1024, 1024, 0.5, 100.0, False)
    triangles = arrays_of(np.zeros((3, 3)), np.zeros((1, 3), np.int32))
    bounds = np.array([[[0.0, 0.0, 2.0], [3.0, 4.0, 2.0]]])
    view = dataclasses.replace(view_of(False), matrix=np.diag([1000.0, 1000.0, 1.0]), frame=frame)
    seen = draw_view.InView(np.zeros(1, np.int64), np.array([1.0]), np.zeros((0, 4)), np.zeros((0, 4), np.int64))
    pixels = 1250**2

    def suits(count: int, camera: View) -> bool:
        made = dataclasses.replace(triangles, clusters=np.array([[0, count]]), cluster_bounds=bounds)
        return draw_view.suits_regions(made, camera, seen)

    fine = pixels // draw_view.FINE + 1
    assert suits(fine, view) and not suits(fine - 2, view)
    assert not suits(fine, dataclasses.replace(view, frame=frame._replace(width=64, height=64)))
    flat = dataclasses.replace(view, frame=frame._replace(orthographic=True))
    assert suits(16 * fine, flat) and not suits(15 * fine, flat)
