"""What counts as redundant: figure 10 of the thesis, and the kernels beside slow, obvious twins."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from sampling_scenes import front, ring, soup, triangle, wall
from torchrender.depth.options import SamplingOptions
from torchrender.depth.probes import Probes, pixel_redundant
from torchrender.depth.ray_visibility import RayVisibility
from torchrender.fragment_tests import PIXEL_TESTS
from torchrender.raster import SEEN, FragmentTests, camera_passes, rasterize_visibility
from torchrender.scene.camera import Cameras
from torchrender.scene.mesh import Mesh, concatenate
from torchrender.scene.model import Scene
from torchrender.scene.procedural import build

OPTIONS = SamplingOptions(redundancy="visibility")
FINE = 64  # eight by eight fine pixels in each pixel of the coarse camera


def verdicts(scene: Scene, probes: Probes, camera: Cameras) -> tuple[bool, bool]:
    """Redundant by (pixel, visibility)?"""
    image = rasterize_visibility(scene.geometry, camera, cull="back")
    pixel = pixel_redundant(probes, FragmentTests(earlier=image), scene.geometry)
    seen = RayVisibility(scene, OPTIONS).captured(probes.points(), probes.triangle, camera, 1)
    return bool(pixel[0]), bool(seen[0])


def probe(camera: Cameras, column: int, row: int, depth: float, triangle_id: int) -> Probes:
    return Probes(camera, torch.tensor([[column, row]]), torch.tensor([depth]), torch.tensor([triangle_id]))


BIG = triangle(2.0, (-20.0, -20.0), (60.0, -20.0), (-20.0, 60.0))
OVER_CENTRE = triangle(1.0, (4.25, 4.25), (4.95, 4.3), (4.3, 4.95))  # covers (4.5, 4.5), not (4.0625, 4.0625)
BESIDE_CENTRE = triangle(1.0, (4.05, 4.05), (4.4, 4.06), (4.06, 4.4))  # covers (4.1875, 4.1875), not (4.5, 4.5)


def test_figure_10_a_same_point_sampled() -> None:
    assert verdicts(soup(BIG), probe(front(8), 4, 4, 2.0, 0), front(8)) == (True, True)


def test_figure_10_b_same_triangle_sampled_elsewhere() -> None:
    assert verdicts(soup(BIG), probe(front(FINE), 32, 32, 2.0, 0), front(8)) == (True, True)


@pytest.mark.parametrize("column", [32, 39], ids=["c", "f"])
def test_figure_10_c_f_visible_but_another_triangle_sampled(column: int) -> None:
    assert verdicts(soup(BIG, OVER_CENTRE), probe(front(FINE), column, column, 2.0, 0), front(8)) == (False, True)


def test_figure_10_d_hidden_but_its_triangle_sampled() -> None:
    assert verdicts(soup(BIG, BESIDE_CENTRE), probe(front(FINE), 33, 33, 2.0, 0), front(8)) == (True, False)


def test_outside_the_frustum_is_not_seen() -> None:
    # The wall lies in clear view of the eye, but beyond the image's right border.
    scene = soup(wall(2.0))
    inside, outside = front(8), front(8, eye=(2.0, 0.0, 0.0))
    assert verdicts(scene, probe(outside, 4, 4, 2.0, 0), inside) == (False, False)
    assert verdicts(scene, probe(outside, 4, 4, 2.0, 0), outside)[1]


def test_points_turned_away_are_seen_only_without_culling() -> None:
    turned = list(reversed(wall(2.0)))
    scene, camera = soup(turned), front(8)
    points, ids = torch.tensor([[0.1, 0.15, -2.0]], dtype=torch.float64), torch.tensor([0])
    assert not bool(RayVisibility(scene, OPTIONS).seen(points, ids, camera).any())
    two_sided = SamplingOptions(redundancy="visibility", cull_backfaces=False)
    assert bool(RayVisibility(scene, two_sided).seen(points, ids, camera).all())


def test_captured_looks_behind_what_earlier_views_know() -> None:
    # Two walls, two identical views: the first captures the near wall, the second the far one, a third nothing.
    scene, cameras = soup(wall(1.0), wall(2.0)), front(8)[[0, 0, 0]]
    near, far = probe(front(8), 5, 2, 1.0, 0), probe(front(8), 5, 2, 2.0, 2)
    rays, plain = RayVisibility(scene, OPTIONS), RayVisibility(scene, SamplingOptions(visibility_test="plain"))
    for count, wanted in ((1, (True, False)), (2, (True, True)), (3, (True, True))):
        got = tuple(bool(rays.captured(p.points(), p.triangle, cameras, count)) for p in (near, far))
        assert got == wanted
        assert not bool(plain.captured(far.points(), far.triangle, cameras, count))
    assert [bool(rays.peeled(far.points(), far.triangle, cameras[0], n)) for n in (1, 2)] == [False, True]


def slow_redundant(probes: Probes, tests: FragmentTests, scene: Scene) -> torch.Tensor:
    """One sample at a time, in world space."""
    image, out = tests.earlier, []
    assert image is not None
    corners = scene.geometry.vertices[scene.geometry.faces.long()]
    for point, t, depth in zip(probes.points(), probes.triangle.tolist(), probes.depth.double(), strict=True):
        a, b, c = corners[t]
        normal = torch.linalg.cross(b - a, c - a)
        normal = normal / normal.norm()
        found = False
        for j in range(len(image.cameras)):
            camera = image.cameras[j]
            (u, v), z = (x[0, 0] for x in camera.project(point[None]))
            if not (z >= camera.near[0] and 0 <= u < camera.width and 0 <= v < camera.height):
                continue
            ray = point - camera.eye[0]
            cosine = float((normal @ ray).abs() / ray.norm())
            same = int(image.triangle[j, int(v), int(u)]) == t
            size = float(camera.footprint(z.reshape(1, 1)))
            behind = float(z) - float(image.depth[j, int(v), int(u)])
            if tests.test == "captured":
                same = behind <= 2.0 * size / max(cosine, 0.1)
            if tests.test == "depth_identity":
                same = abs(behind) <= 2.0 * size / max(cosine, 0.1)
                for y in (math.floor(v - 0.5), math.floor(v - 0.5) + 1):
                    for x in (math.floor(u - 0.5), math.floor(u - 0.5) + 1):
                        if 0 <= y < camera.height and 0 <= x < camera.width:
                            same = same or int(image.triangle[j, y, x]) == t
            own_ray = point - probes.camera.eye[0]
            own_cosine = float((normal @ own_ray).abs() / own_ray.norm())
            coarse = float(camera.footprint(z.reshape(1, 1))) / max(cosine, 1e-12)
            fine = float(probes.camera.footprint(depth.reshape(1, 1))) / max(own_cosine, 1e-12)
            found = found or (same and coarse <= tests.quality_ratio * fine)
        out.append(found)
    return torch.tensor(out)


@pytest.mark.parametrize("test", PIXEL_TESTS)
@pytest.mark.parametrize("ratio", [math.inf, 1.5])
def test_pixel_test_equals_its_slow_twin(test: str, ratio: float) -> None:
    scene = build("nest", triangles=3000)
    cameras = ring(scene, 48)
    cameras = Cameras.cat([cameras[0], cameras[1], cameras[2].scaled(1.0)])
    images = rasterize_visibility(scene.geometry, cameras, cull="back")
    earlier = rasterize_visibility(scene.geometry, cameras[:2].scaled(0.75), cull="back")
    tests = FragmentTests(earlier=earlier, test=test, quality_ratio=ratio)
    probes = Probes.of(images, 2, 2)
    fast = pixel_redundant(probes, tests, scene.geometry)
    assert torch.equal(fast, slow_redundant(probes, tests, scene))
    assert 0 < int(fast.sum()) < len(probes)


def test_rasterised_test_is_the_test_on_stored_samples() -> None:
    scene = build("city", triangles=2000)
    cameras = ring(scene, 64)
    earlier = rasterize_visibility(scene.geometry, cameras[:2], cull="back")
    for test, ratio in (
        ("identity", math.inf),
        ("depth_identity", math.inf),
        ("captured", math.inf),
        ("identity", 2.0),
    ):
        tests = FragmentTests(earlier=earlier, test=test, quality_ratio=ratio)
        image = rasterize_visibility(scene.geometry, cameras[2], cull="back", tests=tests)
        again = pixel_redundant(Probes.of(image, 0), tests, scene.geometry)
        assert len(again) > 100
        # The plain test repeats the same float64 arithmetic; the others rebuild the plane from the vertices.
        assert int(again.sum()) <= (0 if test == "identity" and ratio == math.inf else 1)


@settings(deadline=None, max_examples=25)
@given(
    st.lists(st.floats(0.5, 4.0), min_size=1, max_size=6, unique=True), st.floats(0.5, 5.0), st.integers(0, 2**31 - 1)
)
def test_layers_are_counted(depths: list[float], stored: float, seed: int) -> None:
    gaps = [abs(a - b) for i, a in enumerate([*depths, stored]) for b in [*depths, stored][:i]]
    if min(gaps) < 1e-3:
        return
    order = np.random.default_rng(seed).permutation(len(depths))
    scene, camera = soup(*(wall(depths[k]) for k in order)), front(8)
    seen = rasterize_visibility(scene.geometry, camera)
    seen.depth[:] = stored
    seen.triangle[:] = 10**6
    with camera_passes(scene.geometry, camera, "none") as passes:
        count, touching = passes.count_nearer(seen, (1e-5, 1e-6))
    assert bool((count == sum(d < stored for d in depths)).all())
    assert not bool(touching.any())


def test_layer_count_equals_peeling_one_by_one() -> None:
    scene = build("nest", triangles=3000)
    camera = ring(scene, 96)[1]
    tests, layers = None, []
    while not layers or bool(layers[-1].covered.any()):
        layers.append(rasterize_visibility(scene.geometry, camera, cull="back", tests=tests))
        tests = FragmentTests(beyond=layers[-1].depth, skip=layers[-1].triangle)
    assert len(layers) > 4
    for number, layer in enumerate(layers[:-1]):
        with camera_passes(scene.geometry, camera, "back") as passes:
            count, _ = passes.count_nearer(layer, (0.0, 0.0))
        # Peeling compares float32 depths: surfaces that meet within one rounding step may trade places.
        wrong = (count[layer.covered] != number).double().mean()
        assert float(wrong) < 1e-3


def test_passes_of_one_camera_share_their_triangles_and_leave_others_alone() -> None:
    """What is drawn between them, of more triangles, neither changes nor is changed by what they keep."""
    small, large = concatenate([Mesh.box(1.0)]), concatenate([Mesh.sphere(0.9, segments=64), Mesh.box(0.5)])
    camera = Cameras.look_at([1.0, 1.5, 4.0], [0.0, 0.0, 0.0], width=40, height=30, fov_deg=40.0)
    wanted, other = rasterize_visibility(small, camera), rasterize_visibility(large, camera)
    with camera_passes(small, camera, "none") as passes:
        for _ in range(2):
            between = rasterize_visibility(large, camera)
            seen = passes.rasterize(FragmentTests(skip=torch.full_like(wanted.triangle, -1)))
            assert torch.equal(seen.triangle, wanted.triangle) and torch.equal(seen.depth, wanted.depth)
            assert torch.equal(between.triangle, other.triangle)
            count, _ = passes.count_nearer(replace(seen, depth=torch.where(seen.covered, 99.0, 0.0)), (0.0, 0.0))
            assert bool((count[seen.covered] >= 1).all()) and bool((count[~seen.covered] == 0).all())


def test_a_second_look_at_some_pixels_is_the_look_at_all_of_them_there() -> None:
    """Behind what is seen, in tiles of 64 x 32 pixels of which some are asked for; the other pixels stay."""
    scene = build("nest", triangles=3000)
    camera = replace(ring(scene, 150)[1], height=80)
    seen = rasterize_visibility(scene.geometry, camera, cull="back")
    asked = torch.nonzero(
        seen.covered[0] & (torch.arange(150) < 70) & (torch.arange(80) % 7 == 3)[:, None], as_tuple=True
    )
    assert 20 < len(asked[0]) < 400
    with camera_passes(scene.geometry, camera, "back") as passes:
        behind = passes.rasterize(FragmentTests(beyond=seen.depth.double(), skip=seen.triangle))
        found = replace(seen, **{name: getattr(seen, name).clone() for name in SEEN})
        passes.rasterize_behind(FragmentTests(), found, seen.depth[0][asked].double(), asked)
        counts = passes.count_nearer(behind, (1e-5, 1e-6)), passes.count_nearer(behind, (1e-5, 1e-6), asked)
    for name in SEEN:
        wanted = getattr(seen, name).clone()
        wanted[0][asked] = getattr(behind, name)[0][asked]
        assert torch.equal(getattr(found, name), wanted)
    assert bool((behind.covered[0][asked]).any()) and not bool((behind.covered[0][asked]).all())
    for every, some in zip(*counts, strict=True):
        assert torch.equal(every[0][asked], some)
