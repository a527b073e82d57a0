"""Closed forms along sliced rays beside the same rays by the kernel that takes them one by one, and beside steps."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from media_scenes import LAMP, SUN, eye, fog, t1
from torchrender.effects.media.eye_rays import eye_of, rays_of
from torchrender.effects.media.light_images import images_of, slices_of, views_of
from torchrender.effects.media.options import ScatterOptions
from torchrender.effects.media.tables import LightTable, MediaTable
from torchrender.effects.shadows.shadow_map import ShadowOptions, render_shadow_map
from torchrender.kernels.media.closed import CHUNK, piece_to, scatter_sliced
from torchrender.kernels.media.integrate import SLICED, scatter_rays
from torchrender.kernels.media.records import SUN as PARALLEL
from torchrender.kernels.media.records import Scattered, Source
from torchrender.raster import rasterize

F = np.float32
COLORED = fog(scattering=torch.tensor([0.3, 0.1, 0.2]), absorption=torch.tensor([0.0, 0.1, 0.05]), asymmetry=0.4)


@pytest.mark.parametrize("medium", [fog(), COLORED], ids=["grey", "colored"])
@pytest.mark.parametrize("light", [SUN, LAMP], ids=["sun", "lamp"])
def test_many_rays_at_once_are_the_same_as_one_by_one(light, medium) -> None:
    scene, camera = t1(light, medium=medium, grille=True), eye(97, 63)
    seen = rasterize(scene, camera)
    shadow_map = render_shadow_map(scene, light, ShadowOptions(size=256))
    table = MediaTable.of(scene.media, eye_of(camera))
    rays = rays_of(camera, seen.depth[0], table, seen.position[0])
    views = views_of(shadow_map, table.origin)
    lamp = LightTable.of(light, table.origin, 0.01, "inverse_square")
    reach = 10.0
    airlight = lamp.airlight(table, reach)
    slices = slices_of(shadow_map, views, lamp, rays.sight, ScatterOptions(slices=(512, 256)))
    assert slices is not None
    count, channels = len(rays.beams.direction), table.arrays.extinction.shape[1]
    rows = np.random.default_rng(0).permutation(count)[: count // 2]
    quick, slow = (Scattered(np.full((count, channels), -7.0, F), np.full((count, 3), -7.0, F)) for _ in range(2))
    missed = np.full(-(-len(rows) // CHUNK), -1)
    sun = lamp.kind == PARALLEL
    scatter_sliced(
        table.arrays, (lamp.numbers, airlight), slices, rays.beams, rows, (sun, F(reach)), quick, missed
    )  # fmt: skip
    images = images_of(shadow_map, views, pyramid=False)
    settings = (lamp.kind, SLICED, 8, 300, F(reach))
    scatter_rays(table.arrays, Source(lamp.numbers, airlight), images, slices, rays.beams, rows, settings, slow)
    assert not missed.any()
    mean = float(slow.radiance[rows].mean())
    assert mean > 0 and bool((slow.told[rows, 1] > 1).any()), "the case has shafts"
    off = np.abs(quick.radiance - slow.radiance)
    assert float(off.max()) < 2e-3 * mean, "a ray is another one"
    np.testing.assert_allclose(quick.told[:, 0], slow.told[:, 0], atol=2e-5)
    left = np.setdiff1d(np.arange(count), rows)
    assert bool((quick.radiance[left] == -7.0).all()) and bool((quick.told[left] == -7.0).all())


def test_rays_through_a_lamp_are_left_to_others() -> None:
    scene, camera = t1(LAMP), eye(60, 45)
    seen = rasterize(scene, camera)
    shadow_map = render_shadow_map(scene, LAMP, ShadowOptions(size=128))
    table = MediaTable.of(scene.media, eye_of(camera))
    rays = rays_of(camera, seen.depth[0], table, seen.position[0])
    lamp = LightTable.of(LAMP, table.origin, 0.3, "inverse_square")
    views = views_of(shadow_map, table.origin)
    slices = slices_of(shadow_map, views, lamp, rays.sight, ScatterOptions(slices=(64, 64)))
    assert slices is not None
    rows = np.arange(len(rays.beams.direction))
    out, missed = Scattered(np.zeros((len(rows), 1), F), np.zeros((len(rows), 3), F)), np.zeros(2, np.int64)
    source = lamp.numbers, lamp.airlight(table, 10.0)
    scatter_sliced(table.arrays, source, slices, rays.beams, rows, (False, F(10.0)), out, missed)
    d = rays.beams.direction.astype(np.float64)
    place = lamp.numbers[:3].astype(np.float64)
    away = np.linalg.norm(place - d * (d @ place)[:, None], axis=1)
    assert int(missed.sum()) == int((away <= 0.3).sum()) > 0
    np.testing.assert_array_equal(out.told[:, 1] < 0, away <= 0.3)


@pytest.mark.parametrize("rate", [-3.0, -0.02, 0.0, 1e-4, 0.03, 2.0])
def test_a_piece_is_the_integral_of_its_exponential(rate: float) -> None:
    t = (np.arange(100000) + 0.5) / 100000 * 1.5
    wanted = float(np.exp(-0.4 - rate * t).mean() * 1.5)
    assert float(piece_to(F(0.4), F(rate), F(np.exp(-0.4)), F(1.5))) == pytest.approx(wanted, rel=1e-5)
