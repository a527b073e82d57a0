"""Pyramids, walks and slices against loops over texels and small steps."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from media_scenes import LAMP, SUN, eye, rmse, scattered, t1
from torchrender.effects.media.eye_rays import eye_of, rays_of
from torchrender.effects.media.light_images import angle_range, images_of, slices_of, views_of
from torchrender.effects.media.options import ScatterOptions
from torchrender.effects.media.tables import LightTable, MediaTable
from torchrender.effects.shadows.shadow_map import ShadowOptions, render_shadow_map
from torchrender.kernels.media.march import looked_up
from torchrender.kernels.media.slices import RUN
from torchrender.kernels.media.spans import light_span, slice_ray
from torchrender.kernels.media.walk import build_pyramid, walk_ray
from torchrender.raster import rasterize
from torchrender.scene.light import Light, RectLight, SpotLight

SPOT = SpotLight(
    position=torch.tensor([1.0, 1.5, -4.5]), direction=torch.tensor([0.0, -1.0, 0.1]), inner_deg=15.0, outer_deg=30.0
)
RECT = RectLight(
    corner=torch.tensor([0.8, 1.5, -4.7]), edge_u=torch.tensor([0.4, 0.0, 0.0]), edge_v=torch.tensor([0.0, 0.0, 0.4])
)
LIGHTS = {"sun": SUN, "lamp": LAMP, "spot": SPOT, "rectangle": RECT}


def test_levels_hold_the_least_and_the_greatest_of_their_texels() -> None:
    depth = np.random.default_rng(0).random((2, 13, 21)).astype(np.float32) + 0.5
    depth[0, 3, 4] = np.inf
    levels = [[0, 13, 21]]
    while levels[-1][1] > 1 or levels[-1][2] > 1:
        first, rows, columns = levels[-1]
        levels.append([first + rows * columns, (rows + 1) // 2, (columns + 1) // 2])
    table = np.array(levels)
    made = np.zeros((2, levels[-1][0] + 1, 2), np.float32)
    build_pyramid(depth, False, table, made)
    value = -1.0 / depth
    for level, (first, rows, columns) in enumerate(levels):
        size = 1 << level
        for view, r, c in np.ndindex(2, rows, columns):
            block = value[view, r * size : (r + 1) * size, c * size : (c + 1) * size]
            assert made[view, first + r * columns + c].tolist() == [block.min(), block.max()]


def prepared(light: Light, camera, size: int = 256):
    scene = t1(light, grille=True)
    seen = rasterize(scene, camera)
    shadow_map = render_shadow_map(scene, light, ShadowOptions(size=size))
    table = MediaTable.of(scene.media, eye_of(camera))
    rays = rays_of(camera, seen.depth[0], table, seen.position[0])
    views = views_of(shadow_map, table.origin)
    lamp = LightTable.of(light, table.origin, 0.01, "inverse_square")
    return shadow_map, views, rays, lamp


def steps_lit(shadow_map, views, direction, ends: tuple[float, float], count: int) -> tuple[np.ndarray, np.ndarray]:
    """Midpoints of many steps along a ray, and whether the nearest texel says that they are lit."""
    t = ends[0] + (ends[1] - ends[0]) * (np.arange(count) + 0.5) / count
    d, depth = direction.astype(float), shadow_map.depth.numpy()
    parallel = shadow_map.cameras.orthographic
    return t, np.array([looked_up(depth, views.astype(float), parallel, *(d * x)) for x in t])


@pytest.mark.parametrize("name", LIGHTS)
def test_a_walk_finds_what_small_steps_find(name: str) -> None:
    camera = eye(20, 15)
    shadow_map, views, rays, lamp = prepared(LIGHTS[name], camera)
    images = images_of(shadow_map, views, pyramid=True)
    spans = np.zeros((4096, 2), np.float32)
    wrong = total = 0
    for row in range(0, 300, 7):
        begin, end = light_span(
            lamp.kind, lamp.numbers, np.zeros(3, np.float32), rays.beams.direction[row], *rays.beams.span[row]
        )
        if not end > begin:
            continue
        count, looks = walk_ray(images, np.zeros(3, np.float32), rays.beams.direction[row], begin, end, spans)
        t, lit = steps_lit(shadow_map, views, rays.beams.direction[row], (float(begin), float(end)), 400)
        inside = np.zeros(len(t), bool)
        for a, b in spans[:count]:
            inside |= (t > a) & (t < b)
        wrong += int((inside != lit).sum())
        total += len(t)
        assert looks < 600
    assert wrong / total < 0.003


@pytest.mark.parametrize("name", LIGHTS)
def test_slices_find_nearly_what_the_walk_finds(name: str) -> None:
    camera = eye(200, 150)
    shadow_map, views, rays, lamp = prepared(LIGHTS[name], camera)
    images = images_of(shadow_map, views, pyramid=True)
    slices = slices_of(shadow_map, views, lamp, rays.sight, ScatterOptions(slices=(2048, 1024)))
    assert slices is not None
    a, b = np.zeros((4096, 2), np.float32), np.zeros((4096, 2), np.float32)
    found = np.zeros(slices.rows.shape[1], np.int64)
    shares = []
    for row in range(0, 30000, 277):
        begin, end = rays.beams.span[row]
        d = rays.beams.direction[row]
        walked, _ = walk_ray(images, np.zeros(3, np.float32), d, begin, end, a)
        sliced, _ = slice_ray(slices, shadow_map.cameras.orthographic, False, d, (begin, end), b, found)
        lengths = [float((s[:n, 1] - s[:n, 0]).sum() / (end - begin)) for s, n in ((a, walked), (b, sliced))]
        shares.append(lengths)
    pairs = np.array(shares)
    assert np.abs(pairs[:, 0] - pairs[:, 1]).mean() < (0.005 if name == "sun" else 0.01)
    assert pairs[:, 0].std() > 0.02, "the case has something to find"


def test_edges_between_samples_are_where_the_image_has_them() -> None:
    """Few samples of a fine image: with the places of edges, rays are lit where the walk says, nearly twice as well."""
    camera = eye(200, 150)
    shadow_map, views, rays, lamp = prepared(SUN, camera, size=2048)
    images = images_of(shadow_map, views, pyramid=True)
    slices = slices_of(shadow_map, views, lamp, rays.sight, ScatterOptions(slices=(2048, 256)))
    assert slices is not None and bool(slices.edges.any())
    plain = slices._replace(edges=np.zeros_like(slices.edges))
    a, b = np.zeros((4096, 2), np.float32), np.zeros((4096, 2), np.float32)
    scratch, errors = np.zeros(slices.rows.shape[1], np.int64), []
    for row in range(0, 30000, 277):
        begin, end = rays.beams.span[row]
        d = rays.beams.direction[row]
        walked, _ = walk_ray(images, np.zeros(3, np.float32), d, begin, end, a)
        lengths = []
        for how in (slices, plain):
            count, _ = slice_ray(how, True, False, d, (begin, end), b, scratch)
            lengths.append(abs(float((b[:count, 1] - b[:count, 0]).sum() - (a[:walked, 1] - a[:walked, 0]).sum())))
        errors.append(lengths)
    exact, rough = np.array(errors).mean(0)
    assert exact < 0.6 * rough


def test_pictures_of_few_pixels_have_few_slices() -> None:
    """In proportion to their side, up to what was asked for; less than a pixel apart."""
    found = []
    for width in (20, 40, 400):
        camera = eye(width, width * 3 // 4)
        shadow_map, views, rays, lamp = prepared(SUN, camera)
        slices = slices_of(shadow_map, views, lamp, rays.sight, ScatterOptions(slices=(512, 64)))
        assert slices is not None
        found.append(len(slices.rows))
    assert found[1] == pytest.approx(2 * found[0], rel=0.1) and found[2] == 512 and 32 <= found[0] < 80


def test_a_tree_of_thresholds_holds_the_least_and_the_greatest() -> None:
    camera = eye(20, 15)
    shadow_map, views, rays, lamp = prepared(SUN, camera)
    slices = slices_of(shadow_map, views, lamp, rays.sight, ScatterOptions(slices=(64, 32)))
    assert slices is not None
    assert slices.rows.shape[1] >= 2 * RUN
    count, first, size = slices.rows.shape[1] // RUN, 0, RUN
    while count >= 1:
        for k in range(count):
            part = slices.rows[:, k * size : (k + 1) * size]
            np.testing.assert_array_equal(slices.tree[:, first + k, 0], part.min(1))
            np.testing.assert_array_equal(slices.tree[:, first + k, 1], part.max(1))
        first, count, size = first + count, count // 2, size * 2


def test_a_view_along_the_light_needs_all_angles_and_one_beside_it_few() -> None:
    corners = torch.tensor([[-0.5, 0.4, 1.0], [0.5, 0.4, 1.0], [0.5, -0.4, 1.0], [-0.5, -0.4, 1.0]]).double()
    x, y, z = corners.unbind(1)
    low, high = angle_range(x, y, z)
    assert high - low == pytest.approx(2 * np.pi)
    low, high = angle_range(z, y, x)  # the axis lies beside the view
    assert high - low < 1.0
    assert low < float(torch.atan2(y, z).min()) and high > float(torch.atan2(y, z).max())


@pytest.mark.parametrize("name", ["sun", "lamp"])
def test_pictures_by_slices_are_near_those_by_walks(name: str) -> None:
    scene, camera = t1(LIGHTS[name], grille=True), eye(100, 75)
    walked = scattered(scene, camera, way="walk", block=1).scattered
    sliced = scattered(scene, camera, way="slices", block=1).scattered
    assert rmse(sliced, walked) < (0.02 if name == "sun" else 0.01)
