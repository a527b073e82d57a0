"""Degenerate, huge, empty and coincident input to the rasteriser."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from torchrender.errors import CameraError, MeshError
from torchrender.raster import FragmentTests, rasterize, rasterize_depth, rasterize_visibility
from torchrender.scene.camera import Cameras
from torchrender.scene.mesh import Mesh, concatenate
from torchrender.scene.model import Scene

SQUARE = np.array([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
SQUARE_FACES = np.array([[0, 1, 2], [0, 2, 3]])


def geometry_of(vertices, faces=None):
    vertices = torch.as_tensor(np.asarray(vertices))
    faces = np.arange(len(vertices)).reshape(-1, 3) if faces is None else faces
    return concatenate([Mesh(vertices=vertices, faces=torch.as_tensor(np.asarray(faces)))])


def front(width=32, height=32, **options):
    return Cameras.look_at((0, 0, 3), (0, 0, 0), width=width, height=height, **options)


def assert_clean(buffer):
    """No NaN, ids and depths agree, barycentrics inside the triangle."""
    covered = buffer.covered
    assert bool((torch.isfinite(buffer.depth) == covered).all())
    assert not bool(torch.isnan(buffer.depth).any())
    assert bool((buffer.object_id >= 0).eq(covered).all())
    assert bool((buffer.barycentric >= 0).all())
    assert bool((buffer.barycentric.sum(-1) <= 1 + 1e-6).all())


def icosphere(levels):
    t = (1 + 5**0.5) / 2
    v = [[-1, t, 0], [1, t, 0], [-1, -t, 0], [1, -t, 0], [0, -1, t], [0, 1, t]]
    v += [[0, -1, -t], [0, 1, -t], [t, 0, -1], [t, 0, 1], [-t, 0, -1], [-t, 0, 1]]
    f = [[0, 11, 5], [0, 5, 1], [0, 1, 7], [0, 7, 10], [0, 10, 11], [1, 5, 9], [5, 11, 4], [11, 10, 2], [10, 7, 6]]
    f += [[7, 1, 8], [3, 9, 4], [3, 4, 2], [3, 2, 6], [3, 6, 8], [3, 8, 9], [4, 9, 5], [2, 4, 11], [6, 2, 10]]
    f += [[8, 6, 7], [9, 8, 1]]
    v, f = [np.array(p, float) for p in v], [tuple(x) for x in f]
    for _ in range(levels):
        middle, fine = {}, []
        for a, b, c in f:
            m = []
            for i, j in ((a, b), (b, c), (c, a)):
                key = (min(i, j), max(i, j))
                if key not in middle:
                    middle[key] = len(v)
                    v.append((v[i] + v[j]) / 2)
                m.append(middle[key])
            fine += [(a, m[0], m[2]), (b, m[1], m[0]), (c, m[2], m[1]), tuple(m)]
        f = fine
    v = np.array(v)
    return v / np.linalg.norm(v, axis=1, keepdims=True), np.array(f)


@pytest.mark.parametrize("scale", [0.45, 0.05, 0.004])
def test_a_closed_mesh_has_no_cracks_from_outside_or_inside(scale):
    vertices, faces = icosphere(4)
    geometry = geometry_of(vertices, faces)
    inside = Cameras.look_at((0.1, 0.2, -0.1), (1, 0.3, 0.2), width=97, height=61, fov_deg=100, near=1e-3)
    assert bool(rasterize_visibility(geometry, inside).covered.all())
    size = 64
    k = torch.tensor([[[scale * size, 0, size / 2], [0, scale * size, size / 2], [0, 0, 1]]], dtype=torch.float64)
    outside = Cameras.look_at((0, 0, 3), (0, 0, 0), width=size, height=size)
    outside = Cameras(outside.camera_from_world, k, size, size, 0.5, 9.0, orthographic=True)
    # Every pixel that a front face covers is covered by a back face too: the silhouette is one and the same.
    seen = [rasterize_visibility(geometry, outside, cull=c).covered for c in ("back", "front")]
    assert torch.equal(*seen)
    assert int(seen[0].sum()) > 0 or scale < 0.01
    centre = outside.pixel_centres()
    radius = ((centre - size / 2) ** 2).sum(-1).sqrt() / (scale * size)
    assert bool(seen[0][0][radius < 0.99].all())


def test_vertices_exactly_on_pixel_centres_leave_no_hole():
    n = 33
    j, i = np.meshgrid(np.arange(n), np.arange(n), indexing="ij")
    vertices = np.stack([i + 0.5, j + 0.5, np.ones_like(i)], -1).reshape(-1, 3).astype(float)
    a = (j[:-1, :-1] * n + i[:-1, :-1]).ravel()
    faces = np.concatenate([np.stack([a, a + 1, a + n + 1], 1), np.stack([a, a + n + 1, a + n], 1)])
    eye = torch.eye(4, dtype=torch.float64)[None]
    camera = Cameras(eye, torch.eye(3, dtype=torch.float64)[None], n, n, 0.0, 2.0, orthographic=True)
    covered = rasterize_visibility(geometry_of(vertices, faces), camera).covered[0]
    assert bool(covered[1:-1, 1:-1].all())


@pytest.mark.parametrize("offset", [1e4, 1e5, 1e6])
def test_large_offsets_in_float32(offset):
    vertices, faces = icosphere(3)
    shift = np.array([offset, -offset, 0.5 * offset])
    moved = (vertices * 10 + shift).astype(np.float32)
    camera = Cameras.look_at(shift + np.array([0, 0, 40]), shift, width=80, height=80)
    got = rasterize_visibility(geometry_of(moved, faces), camera)
    exact = (moved.astype(np.float64) - shift).astype(np.float64)
    near = Cameras.look_at((0, 0, 40), (0, 0, 0), width=80, height=80)
    expected = rasterize_visibility(geometry_of(exact, faces), near)
    same = got.triangle == expected.triangle
    assert float(same.double().mean()) > 0.999  # only pixels on an edge may change hands
    both = same & got.covered
    torch.testing.assert_close(got.depth[both], expected.depth[both], rtol=1e-6, atol=0)
    assert_clean(got)


def test_degenerate_sliver_and_duplicated_triangles():
    rng = np.random.default_rng(4)
    line = np.linspace([-1, -1, 0], [1, 1, 0], 3)
    point = np.repeat([[0.2, 0.1, 0.0]], 3, 0)
    sliver = np.array([[-1, 0, 0], [1, 1e-9, 0], [1, 2e-9, 0]])
    edge_on = np.array([[0, 0, 0], [0, 0, -1], [0, 0.5, -1]])  # contains the eye's axis
    soup = np.concatenate([line, point, sliver, edge_on, SQUARE[SQUARE_FACES].reshape(-1, 3) - [0, 0, 0.5]])
    soup = np.concatenate([soup, soup, rng.permutation(soup)[:0]])
    got = rasterize_visibility(geometry_of(soup), front())
    assert_clean(got)
    twins = got.triangle[got.covered]
    assert bool((twins < len(soup) // 6).all())  # of two equal triangles the lower id wins everywhere
    assert bool((got.depth[got.covered] <= 3.5 + 1e-6).all())


@settings(deadline=None, max_examples=40)
@given(st.integers(0, 2**31), st.integers(1, 30))
def test_coordinates_of_any_size(seed, count):
    rng = np.random.default_rng(seed)
    vertices = rng.choice([-1.0, 1.0], (3 * count, 3)) * 10 ** rng.uniform(-8, 8, (3 * count, 3))
    eye = rng.choice([-1.0, 1.0], 3) * 10 ** rng.uniform(-8, 8, 3)
    camera = Cameras.look_at(eye, eye + rng.normal(size=3), width=37, height=23, near=1e-6)
    got = rasterize(
        Scene(meshes=(Mesh(vertices=torch.as_tensor(vertices), faces=torch.arange(3 * count).reshape(-1, 3)),)), camera
    )
    assert_clean(got)
    for name in ("position", "normal", "geometric_normal", "uv", "uv_footprint", "color"):
        assert bool(torch.isfinite(getattr(got, name)).all()), name


def test_behind_the_camera_and_across_the_near_plane():
    behind = geometry_of(SQUARE + np.array([0, 0, 10]), SQUARE_FACES)
    assert not bool(rasterize_visibility(behind, front()).covered.any())
    across = geometry_of([[0.0, -1, 5], [5, -1, -5], [-5, -1, -5]])
    got = rasterize_visibility(across, front(64, 64, near=0.5))
    assert_clean(got)
    assert bool(got.covered.any())
    assert float(got.depth.min()) >= 0.5
    touching = geometry_of([[0.0, -1, 3], [5, -1, -5], [-5, -1, -5]])  # one vertex in the plane of the eye
    assert_clean(rasterize_visibility(touching, front(64, 64)))


def test_camera_in_the_plane_of_a_triangle_and_on_a_vertex():
    for eye in ((0, 0, 3), (0, 0, 0), (-1, -1, 0)):
        camera = Cameras.look_at(eye, (eye[0] + 1, eye[1] + 0.3, eye[2]), width=33, height=33)
        assert_clean(rasterize_visibility(geometry_of(SQUARE, SQUARE_FACES), camera))


@pytest.mark.parametrize("direction", [1.0, -1.0])
def test_looking_exactly_along_up(direction):
    camera = Cameras.look_at((0, 3 * direction, 0), (0, 0, 0), width=32, height=32)
    floor = geometry_of(SQUARE[:, [0, 2, 1]], SQUARE_FACES)
    got = rasterize_visibility(floor, camera)
    assert bool(got.covered[0, 16, 16])
    assert_clean(got)


def test_empty_scene_empty_mesh_and_no_cameras():
    nothing = Mesh(vertices=torch.zeros(0, 3), faces=torch.zeros(0, 3, dtype=torch.int64))
    unused = Mesh(vertices=torch.zeros(5, 3), faces=torch.zeros(0, 3, dtype=torch.int64))
    for scene in (Scene(), Scene(meshes=(nothing,)), Scene(meshes=(unused, nothing))):
        got = rasterize(scene, front())
        assert not bool(got.covered.any())
        assert bool(torch.isinf(got.depth).all())
        assert_clean(got)
    none = front()[[]]
    assert rasterize(Scene(), none).depth.shape == (0, 32, 32)


@pytest.mark.parametrize("size", [(1, 1), (4097, 3), (3, 4097), (64, 32), (65, 33)])
def test_odd_image_sizes(size):
    camera = front(*size)
    got = rasterize_visibility(geometry_of(SQUARE * 1e4, SQUARE_FACES), camera)
    assert bool(got.covered.all())
    torch.testing.assert_close(got.depth, torch.full_like(got.depth, 3.0))


def test_a_million_triangles_in_one_pixel():
    rng = np.random.default_rng(0)
    count = 1_000_000
    corners = rng.uniform(-1e-4, 1e-4, (3 * count, 3))
    corners[:3] = [[-1, -1, 1e-3], [1, -1, 1e-3], [0, 2, 1e-3]]
    got = rasterize_visibility(geometry_of(corners), front(9, 9))
    assert int(got.triangle[0, 4, 4]) == 0
    behind = corners.copy()
    behind[:3, 2] = -1.0
    got = rasterize_visibility(geometry_of(behind), front(9, 9))
    assert int(got.triangle[0, 4, 4]) > 0
    assert_clean(got)


def test_bad_vertices_are_refused_by_name():
    bad = torch.zeros(3, 3)
    bad[1, 2] = float("nan")
    with pytest.raises(MeshError, match=r"'statue'.*1 of 3"):
        Mesh(name="statue", vertices=bad, faces=torch.tensor([[0, 1, 2]]))
    with pytest.raises(MeshError, match=r"'statue'.*index"):
        Mesh(name="statue", vertices=torch.zeros(3, 3), faces=torch.tensor([[0, 1, 3]]))


def test_cameras_that_cannot_see_are_refused():
    with pytest.raises(CameraError, match="eye and target"):
        Cameras.look_at((1, 1, 1), (1, 1, 1), width=8, height=8)
    for options, name in (({"near": 0.0}, "near"), ({"near": 2.0, "far": 1.0}, "far"), ({"fov_deg": 180.0}, "fov_deg")):
        with pytest.raises(CameraError, match=name):
            front(**options)
    with pytest.raises(CameraError, match="width"):
        front(width=0)
    with pytest.raises(CameraError, match="finite"):
        Cameras.look_at((float("nan"), 0, 0), (0, 0, 0), width=8, height=8)


def test_peeling_beyond_nothing_and_everything():
    geometry, camera = geometry_of(SQUARE, SQUARE_FACES), front()
    everything = FragmentTests(beyond=torch.zeros(1, 32, 32))
    assert torch.equal(
        rasterize_visibility(geometry, camera, tests=everything).triangle,
        rasterize_visibility(geometry, camera).triangle,
    )
    nothing = FragmentTests(beyond=torch.full((1, 32, 32), float("inf")))
    assert not bool(rasterize_visibility(geometry, camera, tests=nothing).covered.any())


def test_far_plane_and_extreme_depth_range():
    tilted = geometry_of(SQUARE * 1e6, SQUARE_FACES)
    camera = Cameras.look_at((0, 0, 1e-3), (1, 0.1, -1e-4), width=64, height=48, near=1e-6, far=1e5)
    depth = rasterize_depth(tilted, camera)
    seen = torch.isfinite(depth)
    assert bool(seen.any())
    assert float(depth[seen].max()) <= 1e5 * (1 + 1e-6)
    assert not bool(torch.isnan(depth).any())


def tiny_soup(count: int, pixel: tuple[float, float], spread: float, nearer: bool) -> Mesh:
    """Triangles of 1e-3 pixels in a 16 x 16 image of :func:`small_view`, one behind the other in the order of ids."""
    generator = torch.Generator().manual_seed(3)
    rank = torch.arange(count, dtype=torch.float64)
    z = 2.0 + (rank if nearer else count - rank) / count
    centre = torch.tensor(pixel, dtype=torch.float64) - 8.0 + spread * (torch.rand(count, 2, generator=generator) - 0.5)
    corners = 1e-3 * (torch.rand(count, 3, 2, generator=generator, dtype=torch.float64) - 0.5)
    flat = (centre[:, None] + corners) / 16.0
    vertices = torch.cat([flat * z[:, None, None], z[:, None, None].expand(-1, 3, 1)], 2).reshape(-1, 3)
    return Mesh(vertices=vertices, faces=torch.arange(3 * count).reshape(-1, 3))


def small_view(count: int = 1, width: int = 16, height: int = 16) -> Cameras:
    """At the origin along z; a unit at depth one is 16 pixels."""
    k = torch.tensor([[16.0, 0, width / 2], [0, 16.0, height / 2], [0, 0, 1]], dtype=torch.float64)
    matrices = torch.eye(4, dtype=torch.float64).repeat(count, 1, 1)
    matrices[:, 0, 3] = torch.linspace(0, 0.4, count, dtype=torch.float64)
    near, far = torch.full((count,), 0.1, dtype=torch.float64), torch.full((count,), 99.0, dtype=torch.float64)
    return Cameras(matrices, k.expand(count, 3, 3).contiguous(), width, height, near, far)


@pytest.mark.parametrize("nearer", [False, True])
def test_triangles_far_below_a_pixel_are_seen_where_they_hold_a_centre(nearer: bool) -> None:
    """All at one pixel centre, one behind the other, in order and in reverse; and elsewhere in that pixel: nothing."""
    mesh = tiny_soup(1_000_000, (5.5, 9.5), 0.0, nearer)
    seen = rasterize_visibility(mesh, small_view())
    x, y = (mesh.vertices.reshape(-1, 3, 3)[..., a] / mesh.vertices.reshape(-1, 3, 3)[..., 2] * 16 for a in (0, 1))
    px, py = 5.5 - 8, 9.5 - 8
    side = (x.roll(-1, 1) - x) * (py - y) - (y.roll(-1, 1) - y) * (px - x)
    side = side * side.sum(1, keepdim=True).sign()
    found, snap = int(seen.triangle[0, 9, 5]), 5e-8  # corners move by up to 1/65536 pixel
    clear = (side > snap).all(1).nonzero().reshape(-1)
    assert len(clear) > 100 and bool((side[found] > -snap).all())
    assert found <= int(clear[0]) if nearer else found >= int(clear[-1])
    assert int(seen.covered.sum()) == 1 and bool(torch.isfinite(seen.depth[0, 9, 5]))
    beside = rasterize_visibility(tiny_soup(20_000, (5.3, 9.3), 0.2, nearer), small_view())
    assert not bool(beside.covered.any())


def test_many_tiny_pictures_equal_one_at_a_time() -> None:
    mesh = tiny_soup(300, (5.5, 5.5), 9.0, True)
    floor = Mesh(vertices=torch.tensor([[-9.0, 0.1, -1], [9, 0.1, -1], [0, 0.1, 30]]), faces=torch.tensor([[0, 1, 2]]))
    geometry = concatenate([mesh, floor])
    cameras = small_view(60, 8, 8)
    every = rasterize_visibility(geometry, cameras)
    for k in range(0, 60, 7):
        one = rasterize_visibility(geometry, cameras[k])
        for name in ("depth", "triangle", "object_id", "barycentric"):
            assert torch.equal(getattr(every, name)[k], getattr(one, name)[0])
    assert bool(every.covered.any()) and not bool(every.covered.all())


def test_a_picture_of_sixteen_thousand_columns() -> None:
    """A wall across it: every pixel, at its depth."""
    wall = Mesh(
        vertices=torch.tensor([[-1e4, -9.0, 5.0], [1e4, -9, 5], [1e4, 9, 5], [-1e4, 9, 5]]),
        faces=torch.tensor([[0, 1, 2], [0, 2, 3]]),
    )
    seen = rasterize_visibility(wall, small_view(1, 16_384, 16))
    assert bool(seen.covered.all()) and float((seen.depth - 5.0).abs().max()) < 1e-5
    tall = rasterize_visibility(wall, small_view(1, 16, 16_384))
    assert 0 < int(tall.covered.sum()) < tall.covered.numel(), "the wall ends above and below"


@pytest.mark.parametrize("nearer", [False, True])
def test_a_million_triangles_of_a_thousandth_of_a_pixel(nearer: bool) -> None:
    """Spread over the picture, in order of depth and in reverse: those that hold a pixel centre, and no others."""
    count, size = 1_000_000, 0.5e-3
    rng = np.random.default_rng(7)
    depth = np.linspace(2.0, 8.0, count)[:: -1 if nearer else 1]
    middle = rng.uniform(0, 16, (count, 2))
    on = rng.permutation(count)[:1500]  # on centres: of each pixel several
    middle[on] = np.floor(middle[on]) + 0.5
    at = middle[:, None] + size * np.array([[-0.5, -0.5], [0.5, -0.5], [0.0, 0.6]])
    corners = np.concatenate([(at - 8.0) / 16.0 * depth[:, None, None], np.repeat(depth[:, None, None], 3, 1)], 2)
    seen = rasterize_visibility(geometry_of(corners.reshape(-1, 3)), small_view())
    rows, columns = np.floor(middle[on])[:, 1].astype(int), np.floor(middle[on])[:, 0].astype(int)
    for j in range(16):
        for i in range(16):
            own = on[(rows == j) & (columns == i)]
            least = depth[own].min() if len(own) else np.inf
            found = int(seen.triangle[0, j, i])
            if found >= 0:  # of those by chance the centre is within a triangle's reach
                assert (np.abs(middle[found] - [i + 0.5, j + 0.5]) <= size).all()
                assert depth[found] <= least
            else:
                assert not len(own)
    assert_clean(seen)


def test_ten_thousand_cameras_of_eight_pixels() -> None:
    """All in one call: each as if drawn alone, of depth the same numbers."""
    geometry = geometry_of([[-9.0, 0.1, -1], [9, 0.1, -1], [0, 0.1, 30], [-1, -1, 4], [1, -1, 4], [0, 1, 4]])
    cameras = small_view(10_000, 8, 8)
    every = rasterize_visibility(geometry, cameras)
    assert torch.equal(rasterize_depth(geometry, cameras), every.depth)
    for k in (0, 1, 4_999, 9_998, 9_999):
        one = rasterize_visibility(geometry, cameras[k])
        for name in ("depth", "triangle", "object_id", "barycentric"):
            assert torch.equal(getattr(every, name)[k], getattr(one, name)[0])
    assert bool(every.covered.any((1, 2)).all())


def test_a_picture_of_sixteen_thousand_squared_has_its_parts() -> None:
    """Depth of 16,384 x 16,384 pixels: the same in a window as the camera of that window alone sees."""
    side = 16_384
    wall = geometry_of([[-7.0, -5, 8], [6, -6, 8], [0, 7, 12], [-7, -5, 9], [0, 7, 5], [6, -6, 9]])
    whole = small_view(1, side, side)
    whole = Cameras(
        whole.camera_from_world,
        torch.tensor([[[16_000.0, 0, side / 2], [0, 16_000, side / 2], [0, 0, 1]]], dtype=torch.float64),
        side,
        side,
        whole.near,
        whole.far,
    )
    depth = rasterize_depth(wall, whole)
    assert 0.1 < float(torch.isfinite(depth[0, ::64, ::64]).double().mean()) < 0.9
    for x, y in ((0, 0), (side // 2, side // 2), (side - 256, side - 256), (5000, 9000)):
        window = rasterize_depth(wall, whole.sub_camera(float(x), float(y), 256, 256))
        found = depth[:, y : y + 256, x : x + 256]
        assert torch.equal(torch.isfinite(found), torch.isfinite(window))
        torch.testing.assert_close(found, window, rtol=1e-6, atol=0.0)
