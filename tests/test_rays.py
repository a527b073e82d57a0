"""The ray caster's public behaviour, with both backends."""

from __future__ import annotations

import gc
import math
import pickle
import sys
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from torchrender.errors import InputError, OptionError
from torchrender.kernels.rays.embree_library import embree
from torchrender.rays import RayCaster
from torchrender.scene.cutout import Cutout
from torchrender.scene.mesh import Geometry, Mesh, concatenate

BOTH = pytest.mark.parametrize("backend", ["embree", "bvh"])


@pytest.fixture(autouse=True)
def _needs_embree(request: pytest.FixtureRequest) -> None:
    if "backend" in request.fixturenames and request.getfixturevalue("backend") == "embree":
        pytest.importorskip("embreex")


def geometry(vertices: np.ndarray | list, faces: np.ndarray | list) -> Geometry:
    return concatenate([Mesh(vertices=torch.as_tensor(np.asarray(vertices, float)), faces=torch.as_tensor(faces))])


def soup(count: int, seed: int, size: float = 0.2) -> Geometry:
    rng = np.random.default_rng(seed)
    corners = rng.random((count, 1, 3)) + size * rng.standard_normal((count, 3, 3))
    return geometry(corners.reshape(-1, 3), np.arange(3 * count).reshape(-1, 3))


def quads(depths: list[float]) -> Geometry:
    """Squares [-1,1]² facing -z, two triangles each."""
    corners = np.array([[[-1.0, -1, z], [-1, 1, z], [1, 1, z], [1, -1, z]] for z in depths]).reshape(-1, 3)
    return geometry(corners, [[4 * k + i for i in f] for k in range(len(depths)) for f in ([0, 1, 2], [0, 2, 3])])


def random_rays(count: int, seed: int) -> tuple[torch.Tensor, torch.Tensor]:
    rng = np.random.default_rng(seed)
    return torch.from_numpy(rng.random((count, 3))), torch.from_numpy(rng.standard_normal((count, 3)))


def loop(
    g: Geometry, o: torch.Tensor, d: torch.Tensor, t_min: float, t_max: float, cull: bool
) -> list[tuple[float, int]]:
    """First hits from the plane equation and three same-side tests, triangle by triangle."""
    out = []
    corners = g.vertices.numpy()[g.faces.numpy()]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    for origin, direction in zip(o.numpy(), d.numpy(), strict=True):
        facing = normals @ direction
        t = ((corners[:, 0] - origin) * normals).sum(1) / facing
        p = origin + t[:, None] * direction
        inside = (t > t_min) & (t < t_max) & ((facing < 0) | (not cull))
        for k in range(3):
            a, b = corners[:, k], corners[:, (k + 1) % 3]
            inside &= (np.cross(b - a, p - a) * normals).sum(1) >= 0
        t = np.where(inside, t, np.inf)
        out.append((t.min(), int(t.argmin()) if inside.any() else -1))
    return out


@settings(deadline=None, max_examples=15)
@given(seed=st.integers(0, 2**31), count=st.integers(1, 200), cull=st.booleans(), t_min=st.sampled_from([0.0, 0.3]))
def test_both_backends_equal_the_loop(seed: int, count: int, cull: bool, t_min: float) -> None:
    g = soup(count, seed)
    o, d = random_rays(50, seed + 1)
    t, triangle = zip(*loop(g, o, d, t_min, 2.0, cull), strict=True)
    for backend in ("auto", "bvh"):
        caster = RayCaster(g, backend)
        hits = caster.first_hit(o, d, t_min=t_min, t_max=2.0, cull_backfaces=cull)
        assert hits.triangle.tolist() == list(triangle)
        torch.testing.assert_close(hits.t, torch.tensor(t, dtype=torch.float64), rtol=1e-10, atol=0)
        assert (caster.occluded(o, d, t_min=t_min, t_max=2.0, cull_backfaces=cull) == hits.hit).all()


@BOTH
def test_types_shapes_and_weights(backend: str) -> None:
    caster = RayCaster(quads([1.0]), backend)
    o = torch.zeros(2, 3, 3)
    o[0, 0] = torch.tensor([5.0, 0, 0])
    o[..., 0] += 0.25
    hits = caster.first_hit(o, torch.tensor([0.0, 0, 2.0]).expand(2, 3, 3))
    assert hits.t.dtype == torch.float64 and hits.triangle.dtype == torch.int64
    assert hits.barycentric.dtype == torch.float32 and hits.barycentric.shape == (2, 3, 2)
    assert hits.t[0, 0] == math.inf and hits.triangle[0, 0] == -1 and (hits.barycentric[0, 0] == 0).all()
    assert (hits.t.reshape(-1)[1:] == 0.5).all()
    corners = caster.geometry.vertices[caster.geometry.faces[hits.triangle[1, 1]].long()]
    b = hits.barycentric[1, 1].double()
    point = corners[0] * (1 - b.sum()) + corners[1] * b[0] + corners[2] * b[1]
    torch.testing.assert_close(point, torch.tensor([0.25, 0, 1], dtype=torch.float64))
    assert caster.occluded(o, torch.ones_like(o)).shape == (2, 3)


@BOTH
def test_limits_are_open_and_per_ray(backend: str) -> None:
    caster = RayCaster(quads([1.0, 2.0]), backend)
    o = torch.tensor([[0.3, 0.1, 0.0]]).expand(6, 3)
    d = torch.tensor([[0.0, 0, 1]]).expand(6, 3)
    low = torch.tensor([0.0, 1.0, 0.0, 1.5, 2.0, -math.inf])
    high = torch.tensor([math.inf, math.inf, 1.0, 2.0, math.inf, 1.5])
    hits = caster.first_hit(o, d, t_min=low, t_max=high)
    assert hits.t.tolist() == [1.0, 2.0, math.inf, math.inf, math.inf, 1.0]
    assert caster.occluded(o, d, t_min=low, t_max=high).tolist() == hits.hit.tolist()
    behind = caster.first_hit(o[:1], -d[:1], t_min=-1.5)
    assert behind.t.tolist() == [-1.0]


@BOTH
def test_culling_ignores_triangles_seen_from_behind(backend: str) -> None:
    """The squares face -z: seen along +z they are fronts, along -z backs."""
    caster = RayCaster(quads([1.0]), backend)
    o, d = torch.tensor([[0.3, 0.1, 0.0], [0.3, 0.1, 2.0]]), torch.tensor([[0.0, 0, 1], [0, 0, -1]])
    assert caster.first_hit(o, d).hit.tolist() == [True, True]
    assert caster.first_hit(o, d, cull_backfaces=True).hit.tolist() == [True, False]
    assert caster.occluded(o, d, cull_backfaces=True).tolist() == [True, False]


@BOTH
@pytest.mark.parametrize("x", [0.0, 0.3, -0.7])
def test_next_hit_walks_through_every_layer_once(backend: str, x: float) -> None:
    """On the diagonal (x = 0) two triangles share each hit; they are one surface."""
    depths = [1 + 0.37 * k for k in range(12)]
    caster = RayCaster(quads(depths), backend)
    o, d = torch.tensor([[x, 0.0, -1.0]]), torch.tensor([[0.0, 0, 0.5]])
    hits, seen = caster.first_hit(o, d), []
    while bool(hits.hit):
        seen.append(float(hits.t) * 0.5 - 1)
        hits = caster.next_hit(o, d, hits.t, hits.triangle)
    np.testing.assert_allclose(seen, depths, rtol=1e-14)
    assert not bool(caster.next_hit(o, d, torch.tensor([math.inf]), torch.tensor([-1])).hit)


@BOTH
def test_next_hit_with_culling_sees_fronts_only(backend: str) -> None:
    """Closed boxes in a row: the walk meets one front face of each."""
    from itertools import product

    corners = np.array(list(product((-1, 1), (-1, 1), (0, 1))), float)
    sides = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    faces = np.array([f for a, b, c, e in sides for f in ([a, b, c], [a, c, e])])
    g = geometry(
        np.concatenate([corners + np.array([0, 0, 2 * k]) for k in range(5)]),
        np.concatenate([faces + 8 * k for k in range(5)]),
    )
    caster = RayCaster(g, backend)
    o, d = torch.tensor([[0.2, 0.3, -1.0]]), torch.tensor([[0.0, 0, 1]])
    hits, seen = caster.first_hit(o, d, cull_backfaces=True), []
    while bool(hits.hit):
        seen.append(float(hits.t))
        hits = caster.next_hit(o, d, hits.t, hits.triangle, cull_backfaces=True)
    assert seen == [1.0, 3.0, 5.0, 7.0, 9.0]


@BOTH
def test_rays_that_start_on_a_surface(backend: str) -> None:
    caster = RayCaster(quads([1.0, 2.0]), backend)
    o, d = torch.tensor([[0.3, 0.1, 1.0], [0.3, 0.1, 2.0]]), torch.tensor([[0.0, 0, 1], [0, 0, -1]])
    assert caster.first_hit(o, d).t.tolist() == [1.0, 1.0]
    assert caster.first_hit(o, d, t_min=-1e-9).t.tolist() == [0.0, 0.0]


@BOTH
def test_moved_vertices(backend: str) -> None:
    first = RayCaster(quads([1.0]), backend)
    o, d = torch.tensor([[0.3, 0.1, 0.0]]), torch.tensor([[0.0, 0, 1]])
    for move in (first.rebuilt, first.moved):
        other = move(first.geometry.vertices + torch.tensor([0.0, 0, 4]))
        assert (float(first.first_hit(o, d).t), float(other.first_hit(o, d).t)) == (1.0, 5.0)
        assert other.backend == first.backend
        with pytest.raises(InputError, match="vertices"):
            move(torch.zeros(3, 3))
        with pytest.raises(InputError, match="vertices must be finite"):
            move(first.geometry.vertices * math.nan)


@BOTH
def test_empty_scene_and_zero_rays(backend: str) -> None:
    nothing = RayCaster(concatenate([]), backend)
    o, d = random_rays(4, 1)
    assert nothing.first_hit(o, d).triangle.tolist() == [-1] * 4
    assert not nothing.occluded(o, d).any()
    caster = RayCaster(quads([1.0]), backend)
    hits = caster.first_hit(torch.zeros(0, 3), torch.zeros(0, 3))
    assert hits.t.shape == (0,) and hits.barycentric.shape == (0, 2)
    assert caster.occluded(torch.zeros(0, 3), torch.zeros(0, 3)).shape == (0,)


@pytest.mark.parametrize(
    ("change", "name"),
    [
        ({"origins": torch.tensor([[math.nan, 0, 0]])}, "origins"),
        ({"origins": torch.zeros(1, 2)}, "origins"),
        ({"origins": torch.zeros(1, 3, dtype=torch.int64)}, "origins"),
        ({"directions": torch.tensor([[math.inf, 0, 0]])}, "directions"),
        ({"directions": torch.zeros(1, 3)}, "directions must not be zero"),
        ({"directions": torch.ones(2, 3)}, "directions"),
        ({"t_min": math.nan}, "t_min"),
        ({"t_max": torch.tensor([math.nan])}, "t_max"),
        ({"t_max": torch.ones(3)}, "t_max"),
    ],
)
def test_bad_rays_are_named(change: dict, name: str) -> None:
    caster = RayCaster(quads([1.0]), "bvh")
    arguments = {"origins": torch.zeros(1, 3), "directions": torch.ones(1, 3)} | change
    with pytest.raises(InputError, match=name):
        caster.first_hit(**arguments)
    with pytest.raises(InputError, match=name):
        caster.occluded(**arguments)


def test_bad_next_hit_arguments_are_named() -> None:
    caster = RayCaster(quads([1.0]), "bvh")
    o, d = torch.zeros(1, 3), torch.ones(1, 3)
    with pytest.raises(InputError, match="hits_t"):
        caster.next_hit(o, d, torch.tensor([math.nan]), torch.tensor([-1]))
    with pytest.raises(InputError, match="ignore_triangle"):
        caster.next_hit(o, d, torch.tensor([0.0]), torch.tensor([0.5]))


def test_backends(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(OptionError, match="backend"):
        RayCaster(quads([1.0]), "optix")
    embree.cache_clear()
    monkeypatch.setitem(sys.modules, "embreex", None)
    try:
        assert RayCaster(quads([1.0])).backend == "bvh"
        with pytest.raises(OptionError, match="embreex"):
            RayCaster(quads([1.0]), "embree")
    finally:
        embree.cache_clear()


@BOTH
def test_casts_from_several_threads_repeat_bit_for_bit(backend: str) -> None:
    g = soup(3000, 4, 0.05)
    o, d = random_rays(20000, 5)
    caster = RayCaster(g, backend)
    first = caster.first_hit(o, d)
    with ThreadPoolExecutor(4) as pool:
        again = list(pool.map(lambda _: caster.first_hit(o, d), range(12)))
    for hits in (*again, RayCaster(g, backend).first_hit(o, d)):
        for name in ("t", "triangle", "barycentric"):
            assert torch.equal(getattr(first, name), getattr(hits, name))


@BOTH
def test_a_pickled_caster_builds_its_tree_anew(backend: str) -> None:
    caster = RayCaster(soup(200, 2), backend)
    o, d = random_rays(100, 3)
    copy = pickle.loads(pickle.dumps(caster))
    assert copy.backend == backend
    assert torch.equal(copy.first_hit(o, d).triangle, caster.first_hit(o, d).triangle)


@BOTH
def test_a_tree_outlives_what_it_was_built_from(backend: str) -> None:
    o, d = random_rays(500, 3)
    expected = RayCaster(soup(500, 7), backend).first_hit(o, d).triangle
    casters = [RayCaster(soup(500, 7), backend).moved(soup(500, 7).vertices) for _ in range(20)]
    gc.collect()
    assert all(torch.equal(c.first_hit(o, d).triangle, expected) for c in casters)


def leaf_and_wall() -> Geometry:
    """A square at z = 1 whose left half is missing, twice, and a wall at z = 2."""
    g = quads([1.0, 1.0, 2.0])
    uv = torch.tensor([[0.0, 0], [0, 1], [1, 1], [1, 0]]).repeat(3, 1)
    mask = torch.tensor([0, 0, 0, 0, -1, -1], dtype=torch.int32)
    placed = torch.cat([uv, torch.ones(len(uv), 1)], dim=1)
    cutout = Cutout(mask, torch.tensor([[0, 1, 2, 0]]), torch.tensor([0, 255], dtype=torch.uint8), placed)
    return replace(g, uv=uv, cutout=cutout)


@BOTH
def test_rays_pass_through_cut_outs(backend: str) -> None:
    caster = RayCaster(leaf_and_wall(), backend)
    x = torch.linspace(-0.93, 0.93, 40, dtype=torch.float64)
    o, d = torch.stack([x, 0.3 * x, torch.zeros_like(x)], 1), torch.tensor([[0.0, 0, 1]]).double().expand(40, 3)
    hits = caster.first_hit(o, d)
    torch.testing.assert_close(hits.t, torch.where(x > 0, 1.0, 2.0).double(), rtol=1e-12, atol=0)
    assert (hits.triangle[x > 0] < 2).all() and (hits.triangle[x < 0] >= 4).all()
    assert (caster.occluded(o, d, t_max=1.5) == (x > 0)).all()
    assert (caster.next_hit(o, d, hits.t, hits.triangle).hit == (x > 0)).all()
