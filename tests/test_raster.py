"""The rasteriser against a slow twin, closed forms and the ray caster."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from torchrender.errors import InputError, OptionError
from torchrender.kernels.raster.project import visible_clusters
from torchrender.raster import FragmentTests, rasterize, rasterize_depth, rasterize_visibility
from torchrender.rays import RayCaster
from torchrender.scene.camera import Cameras
from torchrender.scene.load import load
from torchrender.scene.material import Material
from torchrender.scene.mesh import Mesh, concatenate
from torchrender.scene.model import Scene


def flat_camera(width, height, near=-100.0, far=100.0):
    """World x, y are pixel coordinates, world z is depth."""
    eye = torch.eye(4, dtype=torch.float64)[None]
    return Cameras(eye, torch.eye(3, dtype=torch.float64)[None], width, height, near, far, orthographic=True)


def geometry_of(vertices, faces):
    return concatenate([Mesh(vertices=torch.as_tensor(vertices, dtype=torch.float64), faces=torch.as_tensor(faces))])


def soup(seed, count, spread=1.0, size=0.4):
    rng = np.random.default_rng(seed)
    centre = rng.uniform(-spread, spread, (count, 1, 3))
    corners = (centre + rng.normal(0, size, (count, 3, 3))).reshape(-1, 3)
    return geometry_of(corners, np.arange(3 * count).reshape(-1, 3))


def slow_visibility(geometry, cameras):
    """Every pixel against every triangle in float64; also how near the closest edge of any hit triangle is."""
    origins, directions = (a[0].reshape(-1, 3).numpy() for a in cameras.rays())
    best = np.full(len(origins), np.inf)
    ids = np.full(len(origins), -1)
    doubtful = np.zeros(len(origins), bool)
    near, far = float(cameras.near[0]), float(cameras.far[0])
    for t, face in enumerate(geometry.faces.numpy()):
        a, b, c = geometry.vertices.numpy()[face]
        cross = np.cross(directions, c - a)
        det = cross @ (b - a)
        with np.errstate(divide="ignore", invalid="ignore"):
            offset = origins - a
            u = (cross * offset).sum(1) / det
            q = np.cross(offset, b - a)
            v = (directions * q).sum(1) / det
            depth = (q @ (c - a)) / det
            least = np.minimum(np.minimum(u, v), 1 - u - v)
            hit = (least >= 0) & (depth >= near) & (depth <= far)
            doubtful |= (np.abs(least) < 2e-3) & (depth >= near) & (depth <= best)
            doubtful |= (least >= 0) & (np.minimum(np.abs(depth - near), np.abs(depth - far)) < 1e-4)
        nearer = hit & (depth < best)
        doubtful |= hit & (np.abs(depth - best) < 1e-6)
        best[nearer], ids[nearer] = depth[nearer], t
    shape = (cameras.height, cameras.width)
    return best.reshape(shape), ids.reshape(shape), doubtful.reshape(shape)


@settings(deadline=None, max_examples=25)
@given(st.integers(0, 10_000), st.sampled_from([(33, 27), (70, 40), (5, 90)]), st.booleans())
def test_agrees_with_the_slow_twin(seed, size, orthographic):
    geometry = soup(seed, 12)
    if orthographic:
        camera = Cameras.look_at((1, 2, 4), (0, 0, 0), width=size[0], height=size[1])
        k = torch.tensor([[[12.0, 0, size[0] / 2], [0, 12.0, size[1] / 2], [0, 0, 1]]], dtype=torch.float64)
        camera = Cameras(camera.camera_from_world, k, size[0], size[1], 1.0, 9.0, orthographic=True)
    else:  # close enough that triangles cross the near plane
        camera = Cameras.look_at((0.3, 0.5, 1.4), (0, 0, 0), width=size[0], height=size[1], near=0.05, far=3.0)
    got = rasterize_visibility(geometry, camera)
    depth, ids, doubtful = slow_visibility(geometry, camera)
    sure = ~doubtful
    assert sure.mean() > 0.3
    np.testing.assert_array_equal(got.triangle[0].numpy()[sure], ids[sure])
    covered = sure & (ids >= 0)
    np.testing.assert_allclose(got.depth[0].numpy()[covered], depth[covered], rtol=1e-6)
    assert np.isinf(got.depth[0].numpy()[sure & (ids < 0)]).all()


def grid_faces(n, flip):
    """Triangles of an n x n grid of vertices; ``flip`` (n-1, n-1) chooses the diagonal."""
    faces = []
    for j in range(n - 1):
        for i in range(n - 1):
            a, b, c, d = j * n + i, j * n + i + 1, (j + 1) * n + i, (j + 1) * n + i + 1
            faces += [[a, b, d], [a, d, c]] if flip[j, i] else [[a, b, c], [b, d, c]]
    return np.array(faces)


@settings(deadline=None, max_examples=9)
@given(st.integers(0, 10_000), st.sampled_from(["exact", "quarter", "free"]))
def test_every_interior_pixel_is_covered_exactly_once(seed, kind):
    rng = np.random.default_rng(seed)
    n, cell = 5, 7.0
    j, i = np.meshgrid(np.arange(n), np.arange(n), indexing="ij")
    x, y = i * cell + 3.5, j * cell + 3.5  # vertices on pixel centres, outline from 3.5 to 31.5
    inner = (i > 0) & (i < n - 1) & (j > 0) & (j < n - 1)
    if kind != "exact":
        step = 0.25 if kind == "quarter" else 1e-9
        x, y = (c + inner * np.round(rng.uniform(-1.5, 1.5, c.shape) / step) * step for c in (x, y))
    vertices = np.stack([x, y, np.full_like(x, 2.0)], -1).reshape(-1, 3)
    faces = grid_faces(n, rng.random((n - 1, n - 1)) < 0.5)
    camera = flat_camera(40, 40)
    hits = sum(
        (rasterize_visibility(geometry_of(vertices, faces[k : k + 1]), camera).triangle[0] >= 0).int()
        for k in range(len(faces))
    )
    assert bool((hits[4:31, 4:31] == 1).all())
    assert int(hits.max()) == 1  # the outline itself is given to one side as well


def test_ground_through_the_near_plane_has_the_analytic_depth():
    geometry = geometry_of([[-500.0, 0, -500], [500, 0, -500], [500, 0, 500], [-500, 0, 500]], [[0, 2, 1], [0, 3, 2]])
    camera = Cameras.look_at((0, 1, 0), (0, 0.2, -1), width=160, height=120, near=0.1)
    got = rasterize_visibility(geometry, camera)
    origins, directions = camera.rays()
    expected = -origins[..., 1] / directions[..., 1]
    inside = (expected > 0.1) & (expected < 100)
    assert float(inside.float().mean()) > 0.3
    torch.testing.assert_close(got.depth[inside].double(), expected[inside], rtol=1e-6, atol=0)
    assert bool(torch.isinf(got.depth[(expected < 0)]).all())


def test_attributes_are_perspective_correct():
    vertices = torch.tensor([[-1.0, -1, 0], [1, -1, -6], [1, 1, -6], [-1, 1, 0]])
    colors = torch.tensor([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    mesh = Mesh(vertices=vertices, faces=torch.tensor([[0, 1, 2], [0, 2, 3]]), uv=colors[:, :2], colors=colors)
    camera = Cameras.look_at((0, 0, 2), (0, 0, 0), width=64, height=64)
    g = rasterize(Scene(meshes=(mesh,)), camera)
    inside = g.covered
    u = (g.position[..., 0] + 1) / 2
    v = (g.position[..., 1] + 1) / 2
    torch.testing.assert_close(g.uv[inside].double(), torch.stack([u, v], -1)[inside], atol=1e-5, rtol=0)
    torch.testing.assert_close(g.color[inside][:, :2], g.uv[inside], atol=1e-6, rtol=0)
    weights = torch.cat([1 - g.barycentric.sum(-1, keepdim=True), g.barycentric], -1)[inside].double()
    corners = vertices.double()[mesh.faces[g.triangle[inside]]]
    torch.testing.assert_close((weights[..., None] * corners).sum(1), g.position[inside], atol=1e-5, rtol=0)
    assert bool(((g.geometric_normal[inside].double() * (camera.eye[0] - g.position[inside])).sum(-1) > 0).all())
    assert int((~inside).sum()) > 0
    for name in ("position", "normal", "uv", "uv_footprint", "color"):
        assert float(getattr(g, name)[~inside].abs().sum()) == 0
    assert bool((g.material[~inside] == -1).all())


def test_texture_footprint_matches_finite_differences_on_a_facing_plane():
    mesh = Mesh(
        vertices=torch.tensor([[-2.0, -2, 0], [2, -2, 0], [2, 2, 0], [-2, 2, 0]]),
        faces=torch.tensor([[0, 1, 2], [0, 2, 3]]),
        uv=torch.tensor([[0.0, 0], [3, 0], [3, 3], [0, 3]]),
    )
    g = rasterize(Scene(meshes=(mesh,)), Cameras.look_at((0, 0, 3), (0, 0, 0), width=50, height=50, fov_deg=30))
    step = (g.uv[:, :, 1:, 0] - g.uv[:, :, :-1, 0]).abs()
    torch.testing.assert_close(g.uv_footprint[:, :, 1:], step, rtol=0.05, atol=0)  # corners are seen at 20 degrees


def test_batch_equals_single_cameras():
    geometry = soup(3, 40)
    cameras = Cameras.look_at(
        torch.tensor([[0.0, 0, 4], [3, 1, 0], [0, 4, 0.1]]), (0, 0, 0), width=75, height=50, near=0.1
    )
    together = rasterize_visibility(geometry, cameras)
    for k in range(3):
        alone = rasterize_visibility(geometry, cameras[k])
        for name in ("depth", "triangle", "object_id", "barycentric"):
            assert torch.equal(getattr(together, name)[k], getattr(alone, name)[0])
    assert torch.equal(rasterize_depth(geometry, cameras), together.depth)


def test_a_window_of_the_view_equals_the_cut_out_picture():
    geometry, camera = soup(5, 60), Cameras.look_at((0, 0, 4), (0, 0, 0), width=200, height=150, near=0.1)
    whole = rasterize_visibility(geometry, camera)
    part = rasterize_visibility(geometry, camera.sub_camera(60, 30, 70, 50))
    assert torch.equal(part.triangle[0], whole.triangle[0, 30:80, 60:130])
    torch.testing.assert_close(part.depth[0], whole.depth[0, 30:80, 60:130], rtol=1e-6, atol=0)


@pytest.mark.parametrize("cull", ["back", "front"])
def test_culling_keeps_the_other_side(cull):
    quad = geometry_of([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], [[0, 1, 2], [0, 2, 3]])  # faces +z
    for side, expected in ((2.0, cull == "front"), (-2.0, cull == "back")):
        camera = Cameras.look_at((0, 0, side), (0, 0, 0), width=20, height=20)
        empty = not bool(rasterize_visibility(quad, camera, cull=cull).covered.any())
        assert empty == expected


def stack(count):
    """Parallel squares at z = 0, -1, -2 …, facing +z."""
    square = np.array([[-3.0, -3, 0], [3, -3, 0], [3, 3, 0], [-3, 3, 0]])
    vertices = np.concatenate([square - [0, 0, k] for k in range(count)])
    faces = np.concatenate([np.array([[0, 1, 2], [0, 2, 3]]) + 4 * k for k in range(count)])
    return geometry_of(vertices, faces)


def test_peeling_walks_through_the_layers_in_order():
    geometry, camera = stack(4), Cameras.look_at((0, 0, 2), (0, 0, 0), width=30, height=30, fov_deg=40)
    tests = None
    for layer in range(4):
        got = rasterize_visibility(geometry, camera, tests=tests)
        assert bool((got.triangle // 2 == layer).all())
        torch.testing.assert_close(got.depth, torch.full_like(got.depth, 2.0 + layer))
        tests = FragmentTests(beyond=got.depth, skip=got.triangle)
    assert not bool(rasterize_visibility(geometry, camera, tests=tests).covered.any())


def test_earlier_images_take_their_triangles_away():
    geometry, camera = stack(3), Cameras.look_at((0, 0, 2), (0, 0, 0), width=30, height=30, fov_deg=40)
    first = rasterize_visibility(geometry, camera)
    beside = Cameras.look_at((0.3, 0, 2), (0.3, 0, 0), width=30, height=30, fov_deg=40)
    second = rasterize_visibility(geometry, beside, tests=FragmentTests(earlier=first))
    u, z = beside.unproject(beside.pixel_centres()[None], torch.full((1, 30, 30), 2.0)), camera.near
    seen_before, depth = camera.project(u)
    inside = (seen_before >= 0).all(-1) & (seen_before < 30).all(-1) & (depth >= z[0])
    same = inside & (first.triangle[0, 0, 0] // 2 == 0)
    assert bool((second.triangle[~same] // 2 == 0).all())  # outside the earlier image nothing is redundant
    # Inside, the pixel there may hold the square's other triangle: only then is the fragment new.
    assert float((second.triangle[same] // 2 >= 1).double().mean()) > 0.9
    assert bool((second.depth[same] >= 2.0).all())


def test_holes_let_the_surface_behind_show():
    texture = torch.ones(2, 2, 4)
    texture[0, :, 3] = 0.0  # the upper half is a hole
    uv = torch.tensor([[0.0, 0], [1, 0], [1, 1], [0, 1]])
    square = torch.tensor([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
    faces = torch.tensor([[0, 1, 2], [0, 2, 3]])
    scene = Scene(
        meshes=(
            Mesh(vertices=square, faces=faces, uv=uv, material=1),
            Mesh(vertices=square - torch.tensor([0.0, 0, 1]), faces=faces, uv=uv),
        ),
        materials=(Material(), Material(diffuse_texture=texture, alpha_cutoff=0.5)),
    )
    g = rasterize(scene, Cameras.look_at((0, 0, 4), (0, 0, 0), width=40, height=40, fov_deg=20))
    upper = g.position[..., 1] > 0.02
    lower = (g.position[..., 1] < -0.02) & g.covered
    assert bool((g.object_id[upper & g.covered] == 1).all())
    assert bool((g.object_id[lower] == 0).all())
    assert int(upper.sum()) > 100 and int(lower.sum()) > 100
    # Rays go through the same holes, whatever casts them.
    for backend in ("embree", "bvh"):
        caster = RayCaster(scene.geometry, backend)
        origins, directions = (a.reshape(-1, 3) for a in g.cameras.rays())
        hits = caster.first_hit(origins, directions)
        inner = torch.minimum(g.barycentric.amin(-1), 1 - g.barycentric.sum(-1)).reshape(-1) > 1e-4
        same = (hits.triangle == g.triangle.reshape(-1))[inner]
        assert float(same.double().mean()) > 0.99
        between = caster.occluded(origins, directions, t_max=4.5)
        assert torch.equal(between, hits.hit & (hits.t < 4.5))


def test_agrees_with_the_ray_caster_on_a_scene():
    rng = np.random.default_rng(0)
    n = 120
    j, i = np.meshgrid(np.linspace(-4, 4, n), np.linspace(-4, 4, n), indexing="ij")
    height = 0.5 * np.sin(3 * i) * np.cos(2 * j) + rng.normal(0, 0.02, i.shape)
    geometry = geometry_of(np.stack([i, height, j], -1).reshape(-1, 3), grid_faces(n, np.ones((n, n), bool)))
    camera = Cameras.look_at((0, 2.5, 5), (0, 0, 0), width=256, height=256, near=0.1)
    got = rasterize_visibility(geometry, camera)
    origins, directions = camera.rays()
    hits = RayCaster(geometry).first_hit(origins.reshape(-1, 3), directions.reshape(-1, 3))
    ids, t = hits.triangle.reshape(256, 256), hits.t.reshape(256, 256)
    inner = torch.minimum(got.barycentric.amin(-1), 1 - got.barycentric.sum(-1))[0] > 1e-3
    both = (got.triangle[0] >= 0) & inner
    same = (ids == got.triangle[0])[both]
    assert float(same.double().mean()) >= 0.999
    agree = both & (ids == got.triangle[0])
    torch.testing.assert_close(got.depth[0][agree].double(), t[agree], rtol=1e-6, atol=0)


def test_clusters_out_of_view_are_never_touched():
    boxes = torch.rand(500, 1, 3, dtype=torch.float64, generator=torch.Generator().manual_seed(1)) * 20 - 10
    bounds = torch.cat([boxes, boxes + 0.5], 1)
    camera = Cameras.look_at((0, 0, 0), (1, 0.2, 0.5), width=64, height=48, near=0.5, far=9.0)
    planes = camera.frustum_planes()[0]
    kept, distance = visible_clusters(bounds.numpy(), planes.numpy())
    corners = torch.stack([bounds[:, (a, b, c), (0, 1, 2)] for a in (0, 1) for b in (0, 1) for c in (0, 1)], 1)
    outside = (corners @ planes[:, :3].T + planes[:, 3] < 0).all(1).any(1)
    np.testing.assert_array_equal(kept, (~outside).nonzero().reshape(-1).numpy())
    assert 0 < len(kept) < 250
    nearest = (camera.transform(corners.reshape(-1, 3))[0, :, 2].reshape(-1, 8).amin(1) - 0.5)[kept]
    np.testing.assert_allclose(distance, nearest.numpy(), atol=1e-9)


def test_bad_arguments_are_named():
    geometry, camera = soup(0, 3), Cameras.look_at((0, 0, 4), (0, 0, 0), width=8, height=8)
    with pytest.raises(OptionError, match="cull"):
        rasterize_depth(geometry, camera, cull="both")
    with pytest.raises(InputError, match=r"tests\.beyond"):
        rasterize_visibility(geometry, camera, tests=FragmentTests(beyond=torch.zeros(1, 3, 3)))
    with pytest.raises(InputError, match="perspective"):
        flat = flat_camera(8, 8)
        rasterize_visibility(geometry, flat, tests=FragmentTests(earlier=rasterize_visibility(geometry, flat)))


def test_runs_repeat_bit_for_bit():
    geometry, camera = soup(9, 3000, size=0.1), Cameras.look_at((0, 0, 3), (0, 0, 0), width=300, height=200)
    first = rasterize_visibility(geometry, camera)
    for _ in range(3):
        again = rasterize_visibility(geometry, camera)
        assert torch.equal(first.triangle, again.triangle)
        assert torch.equal(first.depth, again.depth)
        assert torch.equal(first.barycentric, again.barycentric)
    assert math.isfinite(float(first.depth[first.covered].sum()))


@pytest.mark.parametrize("distance", [3.0, 0.3])
def test_backs_of_single_sided_materials_are_not_seen(distance: float) -> None:
    """Near ones, too, which are clipped."""
    quad = torch.tensor([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
    faces = torch.tensor([[0, 1, 2], [0, 2, 3]])
    meshes = (Mesh(vertices=quad, faces=faces, material=0), Mesh(vertices=quad, faces=faces, material=1))
    scene = Scene(
        meshes=(meshes[0], replace(meshes[1], vertices=quad - torch.tensor([0.0, 0, 0.1]))),
        materials=(Material(double_sided=False), Material()),
    )
    for side, seen in ((1.0, 0), (-1.0, 1)):
        eye = torch.tensor([[0.0, 0.0, side * distance]])
        camera = Cameras.look_at(eye, torch.zeros(1, 3), near=0.01, width=16, height=16, fov_deg=20.0)
        made = rasterize(scene, camera, cull="sides")
        assert set(made.material.unique().tolist()) == {seen}
        assert int(rasterize(scene, camera).material[0, 8, 8]) == (0 if side > 0 else 1)
    behind = Cameras.look_at(torch.tensor([[0.0, 0.0, -3.0]]), torch.zeros(1, 3), width=16, height=16)
    alone = replace(scene, meshes=scene.meshes[:1])
    assert not bool(rasterize(alone, behind, cull="sides").covered.any())
    assert bool(rasterize(alone, behind).covered.any())


# ------------------------------------------------------------------ some attributes of many views


def test_chosen_outputs_are_those_of_the_whole_in_chunks(monkeypatch) -> None:
    scene = load("cornell_box")
    views = Cameras.cat([Cameras.look_at([x, 1.0, 3.0], [0.0, 1.0, 0.0], width=20, height=16) for x in (-1, 0, 0.5, 1)])
    whole = rasterize(scene, views)
    monkeypatch.setattr("torchrender.raster.CHUNK", 3 * 20 * 16)
    names = ("depth", "normal", "object_id", "position")
    found = rasterize(scene, views, outputs=names)
    assert list(found) == list(names)
    for name in names:
        wanted = getattr(whole, name)
        assert torch.equal(found[name], wanted.float() if wanted.is_floating_point() else wanted)
        assert found[name].dtype in (torch.float32, torch.int64)
    peeled = FragmentTests(beyond=whole.depth.double(), skip=whole.triangle)
    layers = rasterize(scene, views, tests=peeled, outputs=("depth",))["depth"]
    assert torch.equal(layers, rasterize(scene, views, tests=peeled).depth)
    assert rasterize(scene, views[[]], outputs="depth")["depth"].shape == (0, 16, 20)
    with pytest.raises(OptionError, match="outputs must be one of depth, triangle"):
        rasterize(scene, views, outputs=("colour",))
    with pytest.raises(OptionError, match="no mesh of the scene has uv1"):
        rasterize(scene, views, outputs=("uv1",))
