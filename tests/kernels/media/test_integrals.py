"""Panels, the lamp's table, whole rays and steps against quadrature, and blocks against loops over pixels."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
import torch

from media_scenes import LAMP, SUN, eye, fog, quadrature, scattered, t1
from torchrender.effects.media.between import GRADIENTS
from torchrender.effects.media.eye_rays import eye_of, rays_of
from torchrender.effects.media.lattice import spacing
from torchrender.effects.media.light_images import NO_IMAGES, NO_SLICES
from torchrender.effects.media.options import ScatterOptions
from torchrender.effects.media.scatter import Illumination, scatter
from torchrender.effects.media.tables import NOTHING, LightTable, MediaTable
from torchrender.kernels.compile import kernel
from torchrender.kernels.media.airlight import airlight_row, airlight_to, fill_airlight
from torchrender.kernels.media.blocks import LSQ, fill_between, find_gradients, mark_blocks, mark_doubtful
from torchrender.kernels.media.integrate import EVERYWHERE, scatter_rays
from torchrender.kernels.media.march import EXACT_SEGMENT, march_rays
from torchrender.kernels.media.panels import WIDTH, fill_panel, integral_to
from torchrender.kernels.media.records import Media, Scattered, Source
from torchrender.scene.light import SpotLight


@kernel()
def _integral(panels, a, e, x):
    total = np.float32(0.0)
    for k in range(len(panels)):
        nodes = (a[2 * k], a[2 * k + 1], a[2 * k + 2])
        total = fill_panel(
            panels[k], np.float32(k), np.float32(1.0), total, nodes, (e[2 * k], e[2 * k + 1], e[2 * k + 2])
        )
    return integral_to(panels, len(panels), 0, x)[0]


@pytest.mark.parametrize("slope", [0.0, 1e-3, 0.3, 2.0, -2.0, 30.0, -30.0, 1e3])
def test_a_panel_is_exact_for_a_quadratic_times_an_exponential(slope: float) -> None:
    nodes = np.arange(5) / 2
    a = (1.0 + 0.5 * nodes + 0.25 * nodes**2).astype(np.float32)
    e = (0.1 + slope * nodes).astype(np.float32)
    panels = np.zeros((2, WIDTH), np.float32)
    whole = float(_integral(panels, a, e, np.float32(2.0)))
    for x in (0.0, 0.3, 1.0, 1.4, 2.0):
        t = (np.arange(400000) + 0.5) / 400000 * x
        wanted = np.sum((1.0 + 0.5 * t + 0.25 * t**2) * np.exp(-0.1 - slope * t)) * x / 400000
        assert _integral(panels, a, e, np.float32(x)) == pytest.approx(wanted, rel=3e-3, abs=1e-6 * whole)


@kernel()
def _airlight(table, share, a, b):
    row, weight = airlight_row(table, share)
    return airlight_to(table, 0, row, weight, b) - airlight_to(table, 0, row, weight, a)


@pytest.mark.parametrize("g", [0.0, 0.6, -0.9])
def test_the_lamps_table_is_the_integral_of_its_definition(g: float) -> None:
    table = np.zeros((1, 128, 1024), np.float32)
    fill_airlight(np.array([4.0], np.float32), g, table)
    for share, a, b in ((0.9, -1.2, 0.4), (0.2, -0.3, 1.5), (0.05, -1.5, -1.0)):
        x = a + (b - a) * (np.arange(20000) + 0.5) / 20000
        phase = (1 - g * g) / (4 * math.pi) / (1 + g * g + 2 * g * np.sin(x)) ** 1.5
        wanted = np.sum(np.exp(-4.0 * share * (np.tan(x) + 1 / np.cos(x))) * phase) * (b - a) / 20000
        assert _airlight(table, np.float32(share), np.float32(a), np.float32(b)) == pytest.approx(wanted, rel=1e-3)


def prepared(**medium):
    camera = eye(40, 30)
    table = MediaTable.of([fog(**medium)], eye_of(camera))
    rays = rays_of(camera, torch.full((30, 40), 7.5), table)
    return table, rays, LightTable.of(LAMP, table.origin, 1e-3, "inverse_square")


def light_of(table, rays, lamp, panels: int, airlight: np.ndarray = NOTHING, reach: float = 1.0) -> np.ndarray:
    count = len(rays.beams.direction)
    out = Scattered(np.zeros((count, 1), np.float32), np.zeros((count, 3), np.float32))
    settings = (lamp.kind, EVERYWHERE, panels, 16, np.float32(reach))
    source = Source(lamp.numbers, airlight)
    scatter_rays(table.arrays, source, NO_IMAGES, NO_SLICES, rays.beams, np.arange(count), settings, out)
    assert (out.told[:, 0] > 0.999).all()
    return out.radiance[:, 0]


def test_a_lamp_in_a_homogeneous_medium_is_the_analytic_case() -> None:
    table, rays, lamp = prepared()
    reach = float(np.linalg.norm(lamp.numbers[:3]))
    found = light_of(table, rays, lamp, 8, lamp.airlight(table, reach), reach)
    place = lamp.numbers[:3].astype(float)
    for row in range(0, 1200, 97):
        d, end = rays.beams.direction[row].astype(float), float(rays.beams.span[row, 1])
        wanted = quadrature(
            d, (0.0, end), place, lambda a, b: 0.4 * np.linalg.norm(b - a, axis=-1), lambda p: np.full(len(p), 0.3)
        )
        assert found[row] == pytest.approx(wanted, rel=1e-4)


@pytest.mark.parametrize("direction", [SUN.direction, torch.tensor([0.0, -1.0, 0.0]), torch.tensor([0.0, 0.6, 0.8])])
def test_the_sun_in_a_homogeneous_medium_is_an_integral(direction: torch.Tensor) -> None:
    table, rays, _ = prepared(asymmetry=0.4)
    lamp = LightTable.of(replace(SUN, direction=direction), table.origin, 1e-3, "inverse_square")
    found = light_of(table, rays, lamp, 8)
    low, high, travels = (v.double().numpy() for v in (table.media[0].low, table.media[0].high, direction))
    travels = travels / np.linalg.norm(travels)
    for row in range(0, 1200, 97):
        d, end = rays.beams.direction[row].astype(float), float(rays.beams.span[row, 1])
        t = end * (np.arange(20000) + 0.5) / 20000
        with np.errstate(divide="ignore", invalid="ignore"):
            sides = (d * t[:, None] - np.where(travels > 0, low, high)) / travels
        way = np.where(travels == 0, np.inf, sides).min(axis=1)
        phase = (1 - 0.16) / (4 * math.pi) / (1.16 + 0.8 * float(travels @ d)) ** 1.5
        wanted = 0.3 * phase * np.exp(-0.4 * (t + way)).sum() * end / 20000
        assert found[row] == pytest.approx(wanted, rel=1e-5)


def test_light_that_begins_within_the_medium_comes_through_what_lies_before() -> None:
    """A lamp's range is a ball, a spot's cone begins somewhere: quadrature with the same window, from the eye on."""
    table, rays, lamp = prepared()
    place, downward = lamp.numbers[:3].astype(float), torch.tensor([0.0, -1.0, 0.3])
    cone = SpotLight(
        position=LAMP.position, direction=downward, intensity=LAMP.intensity, inner_deg=5.0, outer_deg=40.0
    )
    ranged = LightTable.of(replace(LAMP, range=1.7), table.origin, 1e-3, "inverse_square")
    spot = LightTable.of(cone, table.origin, 1e-3, "inverse_square")
    assert ranged.airlight(table, float(np.linalg.norm(place))) is NOTHING
    axis = cone.axis.numpy()

    def in_range(p: np.ndarray) -> np.ndarray:
        return 0.3 * np.maximum(1.0 - (((p - place) ** 2).sum(axis=-1) / 1.7**2) ** 2, 0.0)

    def in_cone(p: np.ndarray) -> np.ndarray:
        toward = p - place
        return 0.3 * cone.cone(torch.from_numpy(toward @ axis / np.linalg.norm(toward, axis=-1))).numpy()

    for light, scattering in ((ranged, in_range), (spot, in_cone)):
        out = Scattered(np.zeros((1200, 1), np.float32), np.zeros((1200, 3), np.float32))
        settings = (light.kind, EVERYWHERE, 64, 16, np.float32(1.0))
        source = Source(light.numbers, NOTHING)
        scatter_rays(table.arrays, source, NO_IMAGES, NO_SLICES, rays.beams, np.arange(1200), settings, out)
        bright = 0
        for row in range(0, 1200, 37):
            d, end = rays.beams.direction[row].astype(float), float(rays.beams.span[row, 1])
            wanted = quadrature(d, (0.0, end), place, lambda a, b: 0.4 * np.linalg.norm(b - a, axis=-1), scattering)
            assert out.radiance[row, 0] == pytest.approx(wanted, rel=5e-3, abs=1e-7)
            bright += wanted > 1e-4
        assert 3 < bright < 30


@pytest.mark.parametrize("medium", [{}, {"density": 1.5, "falloff": 0.8}])
def test_rays_as_near_to_a_lamp_as_that_gets_no_brighter_are_as_exact(medium: dict[str, float]) -> None:
    """Eight panels beside 128, where light is cut off at a distance that rays pass within."""
    table, rays, _ = prepared(**medium)
    lamp = LightTable.of(LAMP, table.origin, 0.6, "inverse_square")
    few, many = light_of(table, rays, lamp, 8), light_of(table, rays, lamp, 128)
    d, place = rays.beams.direction.astype(float), lamp.numbers[:3].astype(float)
    close = np.linalg.norm(place - d * (d @ place)[:, None], axis=1) <= 0.6
    assert 20 < close.sum() < 200
    np.testing.assert_allclose(few[close], many[close], rtol=4e-3)


def test_a_lamp_in_a_medium_that_falls_off_meets_quadrature() -> None:
    table, rays, lamp = prepared(density=1.5, falloff=0.8)
    place = lamp.numbers[:3].astype(float)

    def optical(a: np.ndarray, b: np.ndarray) -> np.ndarray:
        h0, h1 = a[..., 1] + 1.0, b[..., 1] + 1.0
        length = np.linalg.norm(b - a, axis=-1)
        q = 0.8 * (h1 - h0)
        mean = np.exp(-0.8 * h0) * np.where(np.abs(q) < 1e-6, 1 - q / 2, -np.expm1(-q) / np.where(q == 0, 1, q))
        return 0.4 * 1.5 * length * mean

    def scattering(p: np.ndarray) -> np.ndarray:
        return 0.3 * 1.5 * np.exp(-0.8 * (p[:, 1] + 1.0))

    for panels, tolerance in ((8, 2e-2), (32, 1e-3)):
        found = light_of(table, rays, lamp, panels)
        for row in range(0, 1200, 97):
            d, end = rays.beams.direction[row].astype(float), float(rays.beams.span[row, 1])
            assert found[row] == pytest.approx(quadrature(d, (0.0, end), place, optical, scattering), rel=tolerance)


def test_thin_layers_in_a_tall_box_are_integrated_where_they_are() -> None:
    """Eight equal steps up to a ceiling 800 times as high as the layers would pass these over."""
    top = 1e3
    medium = fog(low=(-top, -1.0, -top), high=(top, top, top), density=1.5, falloff=0.8)
    camera = eye(40, 30)
    table = MediaTable.of([medium], eye_of(camera))
    rays = rays_of(camera, torch.full((30, 40), torch.inf), table)
    assert spacing(table, rays, ScatterOptions()) == 0
    travels = SUN.direction.double().numpy()

    def optical(y: np.ndarray, rise: float) -> np.ndarray:
        """Above y."""
        return 0.4 * 1.5 * np.exp(-0.8 * (y + 1.0)) / (0.8 * rise)

    lights = [LightTable.of(light, table.origin, 1e-3, "inverse_square") for light in (SUN, LAMP)]
    sunny, by_lamp, by_many = (light_of(table, rays, lights[k], panels) for k, panels in ((0, 8), (1, 8), (1, 64)))
    seen = 0
    for row in range(0, 1200, 97):
        d, end = rays.beams.direction[row].astype(float), float(rays.beams.span[row, 1])
        if 0.8 * abs(d[1]) * end < 16.0:
            continue  # it stays among few layers, where steps are as in any medium
        seen += 1
        t = min(end, 60.0 / (0.8 * abs(d[1]))) * (np.arange(20000) + 0.5) / 20000
        y = d[1] * t
        before = (optical(np.zeros(1), d[1]) - optical(y, d[1])) + optical(y, -travels[1] / np.linalg.norm(travels))
        wanted = 0.3 * 1.5 / (4 * math.pi) * np.exp(-0.8 * (y + 1.0) - before).sum() * (t[1] - t[0])
        assert sunny[row] == pytest.approx(wanted, rel=1e-2)
    assert seen > 5
    assert np.abs(by_lamp - by_many).mean() < 1e-2 * by_many.mean()


@pytest.mark.parametrize(("density", "low", "side"), [(6.0, -1.0, 50.0), (1.5, -0.2, 6.0)])
def test_rays_along_thin_layers_to_beyond_a_lamp_follow_them(density: float, low: float, side: float) -> None:
    """Steps of equal angle at a lamp are long far from it: layers changed within one of them fourfold and more."""
    medium = fog(low=(-side, low, -side), high=(side, 4.0, side), density=density, falloff=5.0)
    camera = eye(40, 60)
    table = MediaTable.of([medium], eye_of(camera))
    rays = rays_of(camera, torch.full((60, 40), torch.inf), table)
    lamp = LightTable.of(LAMP, table.origin, 1e-3, "inverse_square")
    few, many = light_of(table, rays, lamp, 8), light_of(table, rays, lamp, 256)
    apart = np.abs(few - many) / np.maximum(many, 1e-3 * many.max())
    assert apart.max() < 0.15


def test_pixels_between_others_look_through_thin_layers_in_a_tall_box_as_these_do() -> None:
    medium = fog(low=(-100.0, -1.0, -100.0), high=(100.0, 50.0, 100.0), falloff=1.0)
    lit, depth = Illumination(lights=(SUN,), size=10.0), torch.full((1, 24, 32), torch.inf)
    few, every = (
        scatter((medium,), eye(32, 24), depth, lit, ScatterOptions(block=block)).scattered[..., 0] for block in (2, 1)
    )
    assert float((few - every).abs().mean()) < 0.01 * float(every.mean())
    assert float((few - every).abs().max()) < 0.08 * float(every.max())


def test_steps_of_equal_angle_meet_quadrature() -> None:
    """32 of them to one per cent."""
    table, rays, lamp = prepared()
    count = len(rays.beams.direction)
    media = Media(*(a.astype(np.float64) if a.dtype == np.float32 else a for a in table.arrays))
    out = Scattered(np.zeros((count, 1), np.float32), np.zeros((count, 3), np.float32))
    seen = (np.zeros((1, 16)), np.zeros((0, 0), bool), np.full(count, 0.5))
    settings = (lamp.kind, 0, False, 32, EXACT_SEGMENT, True, 16)
    numbers = lamp.numbers.astype(np.float64)
    march_rays(media, numbers, np.zeros((1, 1, 1), np.float32), seen, rays.beams, np.arange(count), settings, out)
    place = lamp.numbers[:3].astype(float)
    for row in range(0, 1200, 61):
        d, end = rays.beams.direction[row].astype(float), float(rays.beams.span[row, 1])
        wanted = quadrature(
            d, (0.0, end), place, lambda a, b: 0.4 * np.linalg.norm(b - a, axis=-1), lambda p: np.full(len(p), 0.3)
        )
        assert out.radiance[row, 0] == pytest.approx(wanted, rel=1e-2)


# ---------------------------------------------------------------- blocks


def blocks(length: np.ndarray, block: int, guard=(0.0, 0.0, 0.0)):
    height, width = length.shape
    cells = (-(-height // block), -(-width // block))
    samples, marked = np.zeros((*cells, 2), np.int32), np.zeros(length.shape, bool)
    mark_blocks(length, block, np.float32(0.1), np.array(guard, np.float32), 3, marked, samples)
    return samples, marked


@pytest.mark.parametrize("block", [2, 3])
def test_every_block_has_one_sample_and_pixels_that_differ_are_marked(block: int) -> None:
    rng = np.random.default_rng(0)
    length = (3.0 + rng.random((17, 23)) * np.where(rng.random((17, 23)) < 0.2, 2.0, 0.01)).astype(np.float32)
    length[:5, :5] = 0.0
    samples, marked = blocks(length, block, (20.0, 12.0, 3.0))
    for by, bx in np.ndindex(*samples.shape[:2]):
        part = (slice(by * block, (by + 1) * block), slice(bx * block, (bx + 1) * block))
        y, x = samples[by, bx]
        inside = length[part] > 0
        if not inside.any():
            assert (y, x) == (-1, -1)
            continue
        assert y // block == by and x // block == bx and length[y, x] > 0 and marked[y, x]
        mean = length[part][inside].mean()
        for j, i in np.argwhere(inside) + np.array([by * block, bx * block]):
            near = math.hypot(i + 0.5 - 20.0, j + 0.5 - 12.0) < 3.0
            differs = abs(length[j, i] - mean) > 0.1 * length[j, i] * (1 + 1e-5)
            assert (
                marked[j, i] == (differs or near or (j, i) == (y, x))
                or abs(abs(length[j, i] - mean) / length[j, i] - 0.1) < 1e-5
            )
    assert not marked[length == 0].any()


def test_pixels_without_samples_or_between_light_and_shadow_are_doubtful() -> None:
    length = np.full((12, 12), 4.0, np.float32)
    length[5, 5] = 4.35  # within a tenth of its block's mean, so not marked, and of its samples
    samples, marked = blocks(length, 3)
    told = np.zeros((144, 3), np.float32)
    told.reshape(12, 12, 3)[:, 6:, 0] = 1.0
    more = np.zeros((12, 12), bool)
    mark_doubtful(length, marked, samples, told, (3, np.float32(0.1), np.float32(0.02)), more)
    for y, x in np.ndindex(12, 12):
        shares = [
            told[j * 12 + i, 0] for j, i in samples.reshape(-1, 2)
            if abs(j - y) <= 3 and abs(i - x) <= 3 and abs(length[j, i] - length[y, x]) < 0.1 * length[y, x]
        ]  # fmt: skip
        wanted = not marked[y, x] and (not shares or max(shares) - min(shares) > 0.02)
        assert more[y, x] == wanted
    assert more.any()


@pytest.mark.parametrize("gradient", GRADIENTS)
def test_what_is_even_is_given_back_and_what_is_affine_by_least_squares(gradient: str) -> None:
    rng = np.random.default_rng(1)
    y, x = np.mgrid[:30, :40].astype(np.float32)
    length = np.full((30, 40), 5.0, np.float32)
    norm = (1.0 + 0.3 * rng.random((30, 40))).astype(np.float32)
    for slope, kind in ((0.0, gradient), (0.01, "lsq")):
        if kind != gradient and slope:
            continue
        wanted = (2.0 + slope * x - 0.5 * slope * y) * norm
        samples, marked = blocks(length, 3)
        radiance = np.where(marked, wanted, 0.0).reshape(-1, 1).astype(np.float32)
        told = np.zeros((1200, 3), np.float32)
        limits = (3, np.float32(0.1), np.float32(0.02))
        found = np.zeros((10, 14, 3, 1), np.float32)
        find_gradients(length, norm, samples, told, limits, GRADIENTS[gradient], radiance, found)
        fill_between(length, norm, marked, samples, limits, found, radiance)
        inner = (slice(3, -3), slice(3, -3))
        np.testing.assert_allclose(radiance.reshape(30, 40)[inner], wanted[inner], rtol=2e-6 if not slope else 1e-5)


def test_blocks_of_one_pixel_are_all_rays() -> None:
    scene, camera = t1(), eye(50, 40)
    every = scattered(scene, camera, way="walk", block=1)
    assert bool((every.integrated == 1).all())
    some = scattered(scene, camera, way="walk", block=2)
    chosen = some.integrated[0] == 1
    assert 0.1 < float(chosen.float().mean()) < 0.9
    assert torch.equal(some.scattered[0][chosen], every.scattered[0][chosen]), "no integrated pixel changes its value"


def test_options_of_one_kind_only() -> None:
    assert ScatterOptions().way == "slices" and LSQ in GRADIENTS.values()
