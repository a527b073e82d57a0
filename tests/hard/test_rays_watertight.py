"""Rays where float32 casters fail: shared vertices and edges, far coordinates, extreme scales, ties."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest
import torch

from torchrender.rays import RayCaster
from torchrender.report.foundation.rays import grazing_rays
from torchrender.scene.mesh import Geometry, Mesh, concatenate

BOTH = pytest.mark.parametrize("backend", ["embree", "bvh"])


@pytest.fixture(autouse=True)
def _needs_embree(request: pytest.FixtureRequest) -> None:
    if "backend" in request.fixturenames and request.getfixturevalue("backend") == "embree":
        pytest.importorskip("embreex")


def geometry(vertices: np.ndarray, faces: np.ndarray) -> Geometry:
    return concatenate([Mesh(vertices=torch.from_numpy(np.asarray(vertices, float)), faces=torch.from_numpy(faces))])


def heightfield(n: int) -> tuple[np.ndarray, np.ndarray]:
    """(n,n) vertices over [-1,1]², height y."""
    x, z = np.meshgrid(np.linspace(-1, 1, n), np.linspace(-1, 1, n), indexing="ij")
    y = 0.2 * np.sin(5 * x) * np.cos(4 * z)
    i = np.arange(n * n).reshape(n, n)
    a, b, c, d = i[:-1, :-1], i[1:, :-1], i[1:, 1:], i[:-1, 1:]
    faces = np.concatenate([np.stack([a, c, b], -1).reshape(-1, 3), np.stack([a, d, c], -1).reshape(-1, 3)])
    return np.stack([x, y, z], -1).reshape(-1, 3), faces


def sphere(rings: int, sectors: int) -> tuple[np.ndarray, np.ndarray]:
    """Closed unit sphere."""
    polar, around = np.linspace(0, np.pi, rings + 1)[1:-1], np.arange(sectors) * 2 * np.pi / sectors
    p, a = np.meshgrid(polar, around, indexing="ij")
    body = np.stack([np.sin(p) * np.cos(a), np.cos(p), np.sin(p) * np.sin(a)], -1).reshape(-1, 3)
    v = np.concatenate([body, [[0, 1, 0], [0, -1, 0]]])
    i = np.arange((rings - 1) * sectors).reshape(rings - 1, sectors)
    j = np.roll(i, -1, axis=1)
    a, b, c, d = i[:-1], j[:-1], j[1:], i[1:]
    top, bottom = np.full(sectors, len(body)), np.full(sectors, len(body) + 1)
    parts = [np.stack(x, -1).reshape(-1, 3) for x in ([a, b, c], [a, c, d], [top, j[0], i[0]], [i[-1], j[-1], bottom])]
    return v, np.concatenate(parts)


def toward(points: np.ndarray, eye: np.ndarray) -> tuple[torch.Tensor, torch.Tensor]:
    return torch.from_numpy(np.broadcast_to(eye, points.shape).copy()), torch.from_numpy(points - eye)


@BOTH
@pytest.mark.parametrize("eye", [[0.0, 3, 0], [0.3, 7, -0.2], [11.0, 40, -13], [0.017, 1e4, 0.03]])
def test_no_ray_slips_through_an_interior_vertex(backend: str, eye: list[float]) -> None:
    """3,969 vertices inside a 65 x 65 grid; the hit is the vertex itself or a fold of the surface before it."""
    v, f = heightfield(65)
    inner = v.reshape(65, 65, 3)[1:-1, 1:-1].reshape(-1, 3)
    assert len(inner) == 3969
    hits = RayCaster(geometry(v, f), backend).first_hit(*toward(inner, np.array(eye)))
    assert bool(hits.hit.all())
    assert float(hits.t.max()) <= 1 + 1e-9


@BOTH
def test_no_ray_slips_through_an_edge(backend: str) -> None:
    v, f = heightfield(65)
    rng = np.random.default_rng(0)
    edges = np.concatenate([f[:, [0, 1]], f[:, [1, 2]], f[:, [2, 0]]])
    edges = edges[(np.abs(v[edges][..., [0, 2]]) < 0.999).all(axis=(1, 2))]
    s = rng.random((len(edges), 1))
    points = v[edges[:, 0]] * s + v[edges[:, 1]] * (1 - s)
    caster = RayCaster(geometry(v, f), backend)
    hits = caster.first_hit(*toward(points, np.array([0.1, 5, 0.2])))
    assert bool(hits.hit.all()) and float(hits.t.max()) <= 1 + 1e-9
    assert bool(caster.occluded(*toward(points, np.array([0.1, 5, 0.2]))).all())


@BOTH
@pytest.mark.parametrize("offset", [0.0, 1e4])
def test_rays_at_vertices_of_a_closed_sphere_stop_at_the_front(backend: str, offset: float) -> None:
    """A ray that slipped through a front vertex would hit the far side, and nothing would look wrong."""
    v, f = sphere(64, 64)
    v = v + offset
    eye = np.array([3.0, 1.3, 2.1]) + offset
    front = ((v - offset) * (eye - v)).sum(1) > 0.3
    hits = RayCaster(geometry(v, f), backend).first_hit(*toward(v[front], eye))
    assert int(front.sum()) > 1000
    torch.testing.assert_close(hits.t, torch.ones_like(hits.t), rtol=1e-9, atol=0)


@BOTH
def test_rays_from_the_centre_of_a_sphere_never_escape(backend: str) -> None:
    v, f = sphere(48, 96)
    caster = RayCaster(geometry(v, f), backend)
    hits = caster.first_hit(*toward(v, np.zeros(3)))
    torch.testing.assert_close(hits.t, torch.ones_like(hits.t), rtol=1e-9, atol=0)
    assert bool(caster.occluded(*toward(v, np.array([0.1, -0.2, 0.3]))).all())


@pytest.mark.parametrize("offset", [0.0, 1e4, 1e5, 1e6])
@pytest.mark.parametrize("far", [1.0, 1e3, 1e6])
def test_far_from_zero_ids_equal_a_float64_loop(offset: float, far: float) -> None:
    """Moeller and Trumbore in float64 over all triangles, coordinates and ray origins far away."""
    rng = np.random.default_rng(7)
    corners = rng.random((600, 1, 3)) + 0.03 * rng.standard_normal((600, 3, 3)) + offset
    aim = rng.random((2000, 3)) + offset
    d = rng.standard_normal((2000, 3))
    o = aim - far * d / np.linalg.norm(d, axis=1, keepdims=True)
    a, ab, ac = corners[:, 0], corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    p = np.cross(d[:, None], ac[None])
    det = (ab * p).sum(-1)
    s = o[:, None] - a[None]
    u = (s * p).sum(-1) / det
    q = np.cross(s, ab[None])
    w = np.einsum("ntk,nk->nt", q, d) / det
    t = np.where((u >= 0) & (w >= 0) & (u + w <= 1), (q * ac).sum(-1) / det, np.inf)
    t = np.where(t > 0, t, np.inf)
    expected = np.where(np.isinf(t.min(1)), -1, t.argmin(1))
    g = geometry(corners.reshape(-1, 3), np.arange(1800).reshape(-1, 3))
    for backend in ("auto", "bvh"):
        hits = RayCaster(g, backend).first_hit(torch.from_numpy(o), torch.from_numpy(d))
        np.testing.assert_array_equal(hits.triangle.numpy(), expected)
        np.testing.assert_allclose(hits.t.numpy(), t.min(1), rtol=1e-9)


@BOTH
def test_coordinates_of_all_sizes_stay_watertight(backend: str) -> None:
    """pbrt's watertight test: a closed mesh with coordinates ±10^U(-8,8); rays from inside hit, also at vertices."""
    rng = np.random.default_rng(3)
    v, f = sphere(16, 24)
    scale = 10.0 ** rng.uniform(-8, 8, (len(v), 1))
    mesh = v * scale  # moved along rays from the centre: still closed around it
    caster = RayCaster(geometry(mesh, f), backend)
    zero = np.zeros((4000, 3))
    d = rng.standard_normal((4000, 3)) * 10.0 ** rng.uniform(-8, 8, (4000, 1))
    assert bool(caster.first_hit(torch.from_numpy(zero), torch.from_numpy(d)).hit.all())
    hits = caster.first_hit(torch.zeros(len(mesh), 3, dtype=torch.float64), torch.from_numpy(mesh))
    assert bool(hits.hit.all())


def test_backends_agree_on_triangles_of_all_sizes() -> None:
    rng = np.random.default_rng(4)
    corners = 10.0 ** rng.uniform(-8, 8, (300, 3, 3)) * rng.choice([-1, 1], (300, 3, 3))
    g = geometry(corners.reshape(-1, 3), np.arange(900).reshape(-1, 3))
    inside = np.einsum("nk,nkj->nj", rng.dirichlet([1, 1, 1], 300), corners)
    o = torch.from_numpy(10.0 ** rng.uniform(-8, 8, (300, 3)) * rng.choice([-1, 1], (300, 3)))
    d = torch.from_numpy(inside) - o
    one, other = RayCaster(g, "auto").first_hit(o, d), RayCaster(g, "bvh").first_hit(o, d)
    assert torch.equal(one.triangle, other.triangle) and torch.equal(one.t, other.t)
    assert int(one.hit.sum()) > 250


@pytest.mark.parametrize(("size", "seed"), [(0.2, 1), (0.02, 2), (0.002, 3)])
def test_backends_agree_on_every_one_of_many_rays(size: float, seed: int) -> None:
    """Slivers included: a third of the triangles is squeezed to a thousandth of its width."""
    rng = np.random.default_rng(seed)
    count = 1500 if size > 0.1 else 20000
    shape = rng.standard_normal((count, 3, 3))
    shape[::3, 2] = shape[::3, 0] + 0.4 * (shape[::3, 1] - shape[::3, 0]) + 1e-3 * shape[::3, 2]
    corners = rng.random((count, 1, 3)) + size * shape
    g = geometry(corners.reshape(-1, 3), np.arange(3 * count).reshape(-1, 3))
    o = torch.from_numpy(rng.random((30000, 3)))
    d = torch.from_numpy(rng.standard_normal((30000, 3)))
    one, two = RayCaster(g, "auto"), RayCaster(g, "bvh")
    first, other = one.first_hit(o, d), two.first_hit(o, d)
    assert torch.equal(first.triangle, other.triangle) and torch.equal(first.t, other.t)
    assert torch.equal(one.occluded(o, d, t_max=0.05), two.occluded(o, d, t_max=0.05))
    after, after_two = one.next_hit(o, d, first.t, first.triangle), two.next_hit(o, d, first.t, first.triangle)
    assert torch.equal(after.triangle, after_two.triangle)


@BOTH
def test_the_lowest_id_wins_among_coincident_triangles(backend: str) -> None:
    rng = np.random.default_rng(8)
    v, f = heightfield(20)
    copies = np.concatenate([f, f[:, [1, 2, 0]], f])[rng.permutation(3 * len(f))]
    key = np.sort(copies, axis=1)
    lowest = {tuple(row): k for k, row in reversed(list(enumerate(key)))}
    o = np.concatenate(
        [rng.uniform(-0.9, 0.9, (3000, 1)), np.full((3000, 1), 2.0), rng.uniform(-0.9, 0.9, (3000, 1))], 1
    )
    hits = RayCaster(geometry(v, copies), backend).first_hit(
        torch.from_numpy(o), torch.tensor([[0.0, -1, 0]]).expand(3000, 3)
    )
    assert all(lowest[tuple(key[k])] == k for k in hits.triangle.tolist())


@BOTH
def test_sheets_a_float32_rounding_apart_keep_their_order(backend: str) -> None:
    """Two large sheets 1e-9 apart: float32 sees one plane."""
    square = np.array([[-1.0, 0, -1], [-1, 0, 1], [1, 0, 1], [1, 0, -1]])
    v = np.concatenate([square - [0, 1e-9, 0], square])
    f = np.array([[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]])
    rng = np.random.default_rng(2)
    o = torch.from_numpy(np.stack([rng.uniform(-1, 1, 2000), np.full(2000, 0.7), rng.uniform(-1, 1, 2000)], 1))
    down = torch.tensor([[0.0, -1, 0]], dtype=torch.float64).expand(2000, 3)
    caster = RayCaster(geometry(v, f), backend)
    first = caster.first_hit(o, down)
    assert bool((first.triangle >= 2).all())
    after = caster.next_hit(o, down, first.t, first.triangle)
    assert bool(((after.triangle >= 0) & (after.triangle < 2)).all())


@BOTH
def test_ray_parameter_is_exact_to_twelve_digits(backend: str) -> None:
    """Slanted plane at offset 1e3, closed form."""
    v = np.array([[-50.0, 0, -50], [50, 20, -50], [50, 40, 50], [-50, 20, 50]]) + 1e3
    n = np.cross(v[1] - v[0], v[3] - v[0])
    rng = np.random.default_rng(5)
    o = np.array([1e3, 1.2e3, 1e3]) + rng.uniform(-20, 20, (1000, 3))
    d = rng.normal(0, 0.05, (1000, 3)) + np.array([0, -3, 0])
    hits = RayCaster(geometry(v, np.array([[0, 2, 1], [0, 3, 2]])), backend).first_hit(
        torch.from_numpy(o), torch.from_numpy(d)
    )
    np.testing.assert_allclose(hits.t.numpy(), ((v[0] - o) @ n) / (d @ n), rtol=1e-12)


@BOTH
def test_degenerate_triangles_are_never_hit(backend: str) -> None:
    v = np.array([[0.0, 0, 0], [1, 0, 0], [2, 0, 0], [0, 0, 1], [0, 0, -1], [5, 0, 0]])
    f = np.array([[0, 1, 2], [0, 0, 0], [1, 1, 2]])
    x = torch.linspace(0, 2, 101)
    o = torch.stack([x, torch.ones_like(x), torch.zeros_like(x)], 1)
    down = torch.tensor([[0.0, -1, 0]]).expand(101, 3)
    assert not RayCaster(geometry(v, f), backend).first_hit(o, down).hit.any()
    mixed = RayCaster(geometry(v, np.concatenate([f, [[3, 4, 5]]])), backend).first_hit(o, down)
    assert (mixed.triangle == 3).all()


def soup_of(count: int, size: float, seed: int) -> Geometry:
    rng = np.random.default_rng(seed)
    corners = rng.random((count, 1, 3)) + size * rng.standard_normal((count, 3, 3))
    return geometry(corners.reshape(-1, 3), np.arange(3 * count).reshape(-1, 3))


@pytest.mark.parametrize("angle", [0.5, 0.05, 0.005])
@pytest.mark.parametrize("inset", [1e-3, 1e-9, 0.0])
@pytest.mark.parametrize(("count", "size"), [(1500, 0.2), (20000, 0.02)])
def test_grazing_rays_at_edges_equal_the_tree(angle: float, inset: float, count: int, size: float) -> None:
    """Float32 loses a ray over the sine of its angle to a surface, whatever the triangles are grown by."""
    g = soup_of(count, size, 9)
    rays = grazing_rays(g.vertices.numpy(), g.faces.numpy(), 8000, angle, inset, 10)
    o, d = torch.from_numpy(rays.origins), torch.from_numpy(rays.directions)
    one, two = RayCaster(g, "auto"), RayCaster(g, "bvh")
    first, other = one.first_hit(o, d), two.first_hit(o, d)
    assert torch.equal(first.triangle, other.triangle) and torch.equal(first.t, other.t)
    assert torch.equal(one.occluded(o, d), first.hit) and float(first.hit.double().mean()) > 0.5


@BOTH
def test_first_hits_equal_rational_arithmetic(backend: str) -> None:
    """Nearest triangle in exact arithmetic, for grazing rays and any; ties to 1e-9 are left out."""
    g = soup_of(40, 0.3, 11)
    v, f = g.vertices.numpy(), g.faces.numpy()
    grazing = grazing_rays(v, f, 60, 0.01, 1e-6, 12)
    rng = np.random.default_rng(13)
    o = np.concatenate([grazing.origins, rng.random((60, 3))])
    d = np.concatenate([grazing.directions, rng.standard_normal((60, 3))])
    hits = RayCaster(g, backend).first_hit(torch.from_numpy(o), torch.from_numpy(d))
    compared = 0
    for k in range(len(o)):
        t = sorted((t, i) for i in range(len(f)) if (t := exact_hit(v[f[i]], o[k], d[k])) is not None)
        if len(t) > 1 and t[1][0] - t[0][0] < 1e-9 * abs(t[0][0]):
            continue
        compared += 1
        assert int(hits.triangle[k]) == (t[0][1] if t else -1)
    assert compared > 110


def exact_hit(corners: np.ndarray, o: np.ndarray, d: np.ndarray) -> Fraction | None:
    """Ray parameter by Cramer's rule in fractions; None: no hit in front of the origin."""
    a, b, c = ([Fraction(float(x)) - Fraction(float(y)) for x, y in zip(p, o, strict=True)] for p in corners)
    ray = [Fraction(float(x)) for x in d]
    volumes = [volume(ray, b, c), volume(ray, c, a), volume(ray, a, b)]
    if min(volumes) < 0 < max(volumes) or sum(volumes) == 0:
        return None
    t = volume(a, b, c) / sum(volumes)
    return t if t > 0 else None


def volume(a: list[Fraction], b: list[Fraction], c: list[Fraction]) -> Fraction:
    cross = (b[1] * c[2] - b[2] * c[1], b[2] * c[0] - b[0] * c[2], b[0] * c[1] - b[1] * c[0])
    return sum((x * y for x, y in zip(a, cross, strict=True)), Fraction(0))


def test_detail_far_below_float32_is_left_to_the_tree() -> None:
    """A ball of a millionth of the ground's size: all its boxes would be one in float32."""
    v, f = sphere(40, 60)
    ground = np.array([[-1e6, -1, -1e6], [-1e6, -1, 1e6], [1e6, -1, 0]])
    g = geometry(np.concatenate([v, ground]), np.concatenate([f, [[len(v), len(v) + 1, len(v) + 2]]]))
    caster = RayCaster(g)
    assert caster._tree is not None
    rng = np.random.default_rng(14)
    d = torch.from_numpy(rng.standard_normal((5000, 3)))
    hits = caster.first_hit(torch.zeros(5000, 3, dtype=torch.float64), d)
    assert bool(hits.hit.all()) and float((hits.t * d.norm(dim=1)).max()) <= 1 + 1e-9


@BOTH
def test_one_triangle_and_rays_of_all_kinds(backend: str) -> None:
    g = geometry(np.array([[0.0, 0, 1], [1, 0, 1], [0, 1, 1]]), np.array([[0, 1, 2]]))
    o = torch.tensor([[0.2, 0.2, 0], [0, 0, 0], [0.5, 0.5, 0], [0.6, 0.6, 0], [0.2, 0.2, 1], [-5, 0.2, 1]]).double()
    d = torch.tensor([[0.0, 0, 1], [0, 0, 1], [0, 0, 1], [0, 0, 1], [1, 0, 0], [1, 0, 0]]).double()
    # Corner and edge count as hit; a ray in the triangle's plane does not.
    assert RayCaster(g, backend).first_hit(o, d).hit.tolist() == [True, True, True, False, False, False]
