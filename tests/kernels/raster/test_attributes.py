"""Surface attributes at pixels and at the hits of rays, vertex by vertex."""

from __future__ import annotations

import numpy as np
import pytest

from torchrender.kernels.raster.attributes import (
    MIN_COSINE,
    Eye,
    Hits,
    Mesh,
    Rays,
    Surface,
    interpolate,
    interpolate_hits,
)


def random_mesh(rng: np.random.Generator, present: bool) -> Mesh:
    vertices = rng.normal(size=(12, 3))
    faces = rng.permutation(12).reshape(4, 3).astype(np.int32)
    normals = rng.normal(size=(12, 3)).astype(np.float32)
    normals[0] = 0
    rows = 12 if present else 0
    uv, colors = rng.random((12, 2)).astype(np.float32), rng.random((12, 3)).astype(np.float32)
    return Mesh(vertices, faces, rng.integers(0, 5, 4), normals[:rows], uv[:rows], colors[:rows])


def room(n: int) -> Surface:
    widths = {"position": 3, "normal": 3, "geometric": 3, "uv": 2, "footprint": 0, "color": 3}
    made = [
        np.zeros((n, w) if w else n, np.float64 if name == "position" else np.float32) for name, w in widths.items()
    ]
    return Surface(*made, np.full(n, -1, np.int64))


def wanted(mesh: Mesh, t: int, weights: np.ndarray, d: np.ndarray, size: float) -> dict[str, np.ndarray | float]:
    a, b, c = mesh.vertices[mesh.faces[t]]
    shares = np.array([1 - weights.sum(), *weights])
    normal = np.cross(b - a, c - a)
    area = np.linalg.norm(normal)
    towards = normal / area * (-1.0 if normal @ d > 0 else 1.0)
    shade, footprint = towards, 0.0
    if len(mesh.normals):
        blended = shares @ mesh.normals[mesh.faces[t]].astype(float)
        if np.linalg.norm(blended) > 0:
            shade = blended / np.linalg.norm(blended)
            shade = -shade if shade @ towards < 0 else shade
        p, q, r = mesh.uv[mesh.faces[t]].astype(float)
        density = np.sqrt(abs(np.cross(q - p, r - p)) / area)
        cosine = max(abs(towards @ d) / np.linalg.norm(d), MIN_COSINE)
        footprint = density * size / np.sqrt(cosine)
    return {
        "normal": shade,
        "geometric": towards,
        "uv": shares @ mesh.uv[mesh.faces[t]] if len(mesh.uv) else np.zeros(2),
        "footprint": footprint,
        "color": shares @ mesh.colors[mesh.faces[t]] if len(mesh.colors) else np.ones(3),
        "material": mesh.material[t],
    }


def compare(out: Surface, row: int, position: np.ndarray, values: dict[str, np.ndarray | float]) -> None:
    np.testing.assert_allclose(out.position[row], position, rtol=1e-12, atol=1e-12)
    for name, value in values.items():
        np.testing.assert_allclose(getattr(out, name)[row], value, rtol=1e-5, atol=1e-6, err_msg=name)


@pytest.mark.filterwarnings("ignore:Arrays of 2-dimensional vectors:DeprecationWarning")
@pytest.mark.parametrize("present", [False, True])
@pytest.mark.parametrize("orthographic", [False, True])
def test_pixels_against_a_loop(orthographic: bool, present: bool) -> None:
    rng = np.random.default_rng(0)
    mesh = random_mesh(rng, present)
    eye = Eye(rng.normal(size=(3, 3)), rng.normal(size=3), np.array([0.6, 0.0, 0.8]), 0.3, orthographic)
    triangle = np.sort(rng.integers(-1, 4, (6, 7)), axis=1)
    weights = rng.dirichlet(np.ones(3), (6, 7))[..., 1:].astype(np.float32)
    depth = np.where(triangle >= 0, rng.uniform(1, 9, (6, 7)), np.inf).astype(np.float32)
    out = room(42)
    interpolate(mesh, eye, Hits(depth, triangle, weights), out)
    for y in range(6):
        for x in range(7):
            row, t, z = 7 * y + x, triangle[y, x], float(depth[y, x])
            if t < 0:
                assert out.material[row] == -1 and not out.normal[row].any()
                continue
            ray = eye.rays @ [x + 0.5, y + 0.5, 1.0]
            position = eye.origin + (ray + z * eye.forward if orthographic else z * ray)
            direction = eye.forward if orthographic else ray
            size = eye.footprint * (1.0 if orthographic else z)
            compare(out, row, position, wanted(mesh, t, weights[y, x].astype(float), direction, size))


@pytest.mark.filterwarnings("ignore:Arrays of 2-dimensional vectors:DeprecationWarning")
@pytest.mark.parametrize("present", [False, True])
def test_hits_against_a_loop(present: bool) -> None:
    rng = np.random.default_rng(1)
    mesh, n = random_mesh(rng, present), 40
    rays = Rays(rng.normal(size=(n, 3)), rng.normal(size=(n, 3)), rng.uniform(0, 1, n))
    weights = rng.dirichlet(np.ones(3), n)[:, 1:].astype(np.float32)
    hits = Hits(rng.uniform(0.1, 5, n), rng.integers(-1, 4, n), weights)
    out = room(n)
    interpolate_hits(mesh, rays, hits, out)
    for k in range(n):
        if hits.triangle[k] < 0:
            assert out.material[k] == -1 and not out.position[k].any()
            continue
        position = rays.origins[k] + hits.depth[k] * rays.directions[k]
        values = wanted(mesh, hits.triangle[k], weights[k].astype(float), rays.directions[k], rays.widths[k])
        compare(out, k, position, values)
