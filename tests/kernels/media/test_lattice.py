"""Pixels between the rays of a lattice against the same pixels each by itself."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from media_scenes import LAMP, SUN, eye, fog, t1
from torchrender.effects.media.eye_rays import eye_of, rays_of
from torchrender.effects.media.lattice import lattice_of, spacing, ways_by_lattice
from torchrender.effects.media.light_images import NO_IMAGES, NO_SLICES, images_of, views_of
from torchrender.effects.media.options import ScatterOptions
from torchrender.effects.media.tables import NOTHING, LightTable, MediaTable
from torchrender.effects.shadows.shadow_map import ShadowOptions, render_shadow_map
from torchrender.kernels.media.integrate import EVERYWHERE, WALKED, scatter_rays
from torchrender.kernels.media.lattice import UNKNOWN
from torchrender.kernels.media.records import NO_LATTICE, Scattered, Source
from torchrender.kernels.media.ways import ways_through

SIZE = (160, 120)


def smoke(side: int = 12) -> torch.Tensor:
    at = torch.linspace(0, 3, side)
    return 1.0 + 0.5 * torch.sin(at)[:, None, None] * torch.cos(at)[:, None] + 0.3 * at


def prepared(depth: torch.Tensor | None = None, **medium):
    camera = eye(*SIZE)
    table = MediaTable.of([fog(**medium)], eye_of(camera))
    return table, rays_of(camera, torch.full((SIZE[1], SIZE[0]), 7.5) if depth is None else depth, table)


def light_of(media, rays, lamp, lattice, images=None) -> np.ndarray:
    count = len(rays.beams.direction)
    out = Scattered(np.zeros((count, 1), np.float32), np.zeros((count, 3), np.float32))
    settings = (lamp.kind, EVERYWHERE if images is None else WALKED, 48, 16, np.float32(1.0))
    source = Source(lamp.numbers, NOTHING, *lattice)
    scatter_rays(media, source, images or NO_IMAGES, NO_SLICES, rays.beams, np.arange(count), settings, out)
    return out.radiance[:, 0]


@pytest.mark.parametrize("light", [LAMP, SUN])
@pytest.mark.parametrize("medium", [{"density": 1.5, "falloff": 0.8}, {"density": smoke()}, {"asymmetry": 0.6}])
def test_light_between_nodes_is_that_of_the_pixels_themselves(light, medium) -> None:
    """A surface that ends half of the rays early is none of the lattice's business: rays end where they end."""
    depth = torch.full((SIZE[1], SIZE[0]), 7.5)
    depth[:, 70:] = 3.1
    table, rays = prepared(depth, **medium)
    lamp = LightTable.of(light, table.origin, 1e-3, "inverse_square")
    options = ScatterOptions(lattice=4)
    media = table.towards(lamp.kind, lamp.numbers, options)
    lattice = lattice_of(media, lamp, table, rays, options)
    if light is SUN and "density" not in medium:
        assert lattice is NO_LATTICE, "there is a closed form"
        return
    assert (lattice.widths[..., 0] > 0).mean() > 0.9
    wanted, found = (light_of(media, rays, lamp, kept) for kept in (NO_LATTICE, lattice))
    assert not np.array_equal(wanted, found), "the lattice is used"
    off = np.abs(found - wanted) / np.maximum(wanted, wanted.mean())
    assert np.sqrt((off**2).mean()) < 5e-3 and np.quantile(off, 0.99) < 1.5e-2


@pytest.mark.parametrize("light", [LAMP, SUN])
def test_light_in_parts_is_that_of_the_pixels_themselves(light) -> None:
    """Bars before the light: of what reaches an end of a lit part, what reached its begin is taken off."""
    camera = eye(*SIZE)
    scene = t1(light, medium=fog(density=1.5, falloff=0.8), grille=True)
    table = MediaTable.of(scene.media, eye_of(camera))
    rays = rays_of(camera, torch.full((SIZE[1], SIZE[0]), 7.5), table)
    lamp = LightTable.of(light, table.origin, 1e-3, "inverse_square")
    options = ScatterOptions(lattice=4)
    media = table.towards(lamp.kind, lamp.numbers, options)
    shadow_map = render_shadow_map(scene, light, ShadowOptions(size=256))
    images = images_of(shadow_map, views_of(shadow_map, table.origin), pyramid=True)
    lattice = lattice_of(media, lamp, table, rays, options)
    wanted, found = (light_of(media, rays, lamp, kept, images) for kept in (NO_LATTICE, lattice))
    whole = light_of(media, rays, lamp, NO_LATTICE)
    assert not np.array_equal(wanted, found) and wanted.mean() < 0.98 * whole.mean(), "there is shadow"
    off = np.abs(found - wanted) / np.maximum(wanted, wanted.mean())
    assert np.sqrt((off**2).mean()) < 5e-3


def test_thick_media_are_integrated_ray_by_ray() -> None:
    """Where the exponent changes too much between nodes a quadratic will not do: such nodes know nothing."""
    table, rays = prepared(density=400.0, falloff=0.5)
    lamp = LightTable.of(SUN, table.origin, 1e-3, "inverse_square")
    lattice = lattice_of(table.arrays, lamp, table, rays, ScatterOptions())
    assert (lattice.widths[..., 0] == UNKNOWN).any()
    wanted, found = (light_of(table.arrays, rays, lamp, kept) for kept in (NO_LATTICE, lattice))
    np.testing.assert_allclose(found, wanted, rtol=0.02, atol=1e-3 * wanted.mean())


@pytest.mark.parametrize("beside", [False, True])
def test_ways_between_nodes_are_those_of_the_pixels_themselves(beside: bool) -> None:
    """With a box that fills the picture, and one whose sides are seen: there, rays are taken one by one."""
    medium = fog(density=smoke())
    if beside:
        medium = replace(medium, low=torch.tensor([-0.5, -0.5, -5.0]), high=torch.tensor([0.6, 0.7, -3.0]))
    camera = eye(*SIZE)
    table = MediaTable.of([medium, fog(density=0.5, falloff=0.3)], eye_of(camera))
    rays = rays_of(camera, torch.full((SIZE[1], SIZE[0]), 7.0), table)
    wanted, found = np.zeros((2, SIZE[0] * SIZE[1], 2), np.float32)
    ways_through(table.arrays, rays.beams, 48, wanted)
    assert ways_by_lattice(table, rays, 48, ScatterOptions(), found)
    scale = wanted.max(axis=0)
    assert (scale > 0).all() and np.array_equal(found[:, 1], wanted[:, 1])
    assert np.abs(found - wanted).max() < 0.02 * scale[0] and np.abs(found - wanted).mean() < 1e-3 * scale[0]
    assert np.array_equal(found[:, 0] == 0, wanted[:, 0] == 0)


def test_fine_grids_and_single_pixels_have_no_lattice() -> None:
    table, rays = prepared(density=smoke(128))
    assert spacing(table, rays, ScatterOptions(block=1)) == 0, "every pixel by itself"
    assert spacing(table, rays, ScatterOptions(lattice=0)) == 0, "none is asked for"
    assert spacing(table, rays, ScatterOptions()) == 0, "cells are finer than pixels"
    assert 0 < spacing(*prepared(density=1.0, falloff=0.8), ScatterOptions()) <= 8
    assert spacing(*prepared(density=1.0, falloff=20.0), ScatterOptions()) == 0, "so are layers"
    assert spacing(*prepared(asymmetry=0.99), ScatterOptions()) == 0, "light turns within less"
    table, rays = prepared(density=smoke(8))
    assert spacing(table, rays, ScatterOptions(lattice=6)) == 6
    assert not ways_by_lattice(table, rays, 48, ScatterOptions(block=1), np.zeros((len(rays.beams.span), 1)))
