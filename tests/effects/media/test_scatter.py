"""Laws of scattering: specification 09, sections 3, 9 and 11, item by item."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from media_scenes import LAMP, SUN, eye, fog, rmse, scattered, t1
from torchrender.effects.media.options import ScatterOptions
from torchrender.effects.media.phase import henyey_greenstein, scattered_surroundings
from torchrender.effects.media.scatter import Illumination, scatter
from torchrender.effects.media.surfaces import light_transmittance
from torchrender.effects.media.surroundings import Surroundings
from torchrender.errors import InputError, OptionError
from torchrender.numerics.media import height_optical_depth
from torchrender.scene.camera import Cameras
from torchrender.scene.environment import Environment
from torchrender.scene.light import DirectionalLight, PointLight, RectLight, SpotLight
from torchrender.scene.sky.harmonics import harmonics_2

CAMERA = eye(48, 36)
WALL = torch.full((1, 36, 48), 7.0)


def before_a_wall(medium, *lights, camera: Cameras = CAMERA, surroundings=None, **options):
    lit = Illumination(lights=lights, surroundings=surroundings, size=10.0)
    media = medium if isinstance(medium, tuple) else (medium,)
    depth = WALL.expand(len(camera), camera.height, camera.width)
    return scatter(media, camera, depth, lit, ScatterOptions(**{"block": 1, **options}))


# ---------------------------------------------------------------- closed forms


@pytest.mark.parametrize("g", [-0.9, -0.3, 0.0, 0.5, 0.9])
def test_the_phase_function_spreads_all_light_about_its_mean_cosine(g: float) -> None:
    x, w = np.polynomial.legendre.leggauss(400)
    p = henyey_greenstein(torch.from_numpy(x), g).numpy() * 2 * math.pi
    assert (p * w).sum() == pytest.approx(1.0, abs=1e-6)
    assert (p * x * w).sum() == pytest.approx(g, abs=1e-6)


def test_a_phase_function_beyond_its_range_is_refused() -> None:
    with pytest.raises(OptionError, match="asymmetry"):
        henyey_greenstein(torch.zeros(1), 1.0)


@settings(deadline=None, max_examples=40)
@given(st.floats(0, 3), st.floats(-3, 3), st.floats(0.1, 5), st.floats(0, 3))
def test_optical_depth_of_heights_is_an_integral(h0: float, rise: float, length: float, falloff: float) -> None:
    x, w = np.polynomial.legendre.leggauss(60)
    wanted = (np.exp(-falloff * (h0 + rise * (x + 1) / 2)) * w).sum() * length / 2
    found = height_optical_depth(*(torch.tensor(v, dtype=torch.float64) for v in (h0, h0 + rise, length)), falloff)
    assert float(found) == pytest.approx(wanted, rel=1e-8)


def test_optical_depth_of_a_level_way_is_no_quotient_of_nothing() -> None:
    h = torch.tensor([1.0, 1.0], dtype=torch.float64)
    found = height_optical_depth(h, h + torch.tensor([1e-9, 0.0]), torch.full_like(h, 2.0), 0.7)
    torch.testing.assert_close(found, 2.0 * torch.exp(-0.7 * h), rtol=1e-8, atol=0)


def test_even_light_gives_albedo_times_what_is_held_back() -> None:
    """Constant in-scattered light: surroundings of one colour."""
    medium = fog(absorption=torch.tensor([0.1, 0.0, 0.4]), scattering=torch.tensor([0.3, 0.2, 0.1]))
    around = Surroundings.of(torch.tensor([1.0, 2.0, 3.0]), None)
    made = before_a_wall(medium, surroundings=around)
    albedo = medium.scattering / medium.extinction
    wanted = albedo * torch.tensor([1.0, 2.0, 3.0]) * (1 - made.transmittance)
    torch.testing.assert_close(made.scattered, wanted, rtol=1e-5, atol=1e-7)


@pytest.mark.parametrize(("steps", "excess"), [(8, 0.107), (32, 0.026), (64, 0.013)])
def test_the_printed_recurrence_is_too_bright_by_what_steps_hold_back(steps: int, excess: float) -> None:
    """Parallel light across a wide slab: constant along every ray, optical depth 1.65."""
    slab = fog(low=torch.tensor([-1e4, -1e4, -6.6]), high=torch.tensor([1e4, 1e4, 0.0]), absorption=torch.zeros(3),
               scattering=torch.full((3,), 0.25))  # fmt: skip
    camera = Cameras.look_at((0, 0, 0), (0, 0, -1), width=4, height=3, fov_deg=1.0)
    sun = DirectionalLight(direction=torch.tensor([0.0, 0.0, 1.0]))  # every way through the slab is as long
    lit = Illumination(lights=(sun,), size=1.0)
    depth = torch.full((1, 3, 4), 6.6)
    light = {
        scheme: scatter((slab,), camera, depth, lit, ScatterOptions(
            way="march", scheme=scheme, steps=steps, jitter=False, block=1)).scattered.mean()
        for scheme in ("source", "exact_segment")
    }  # fmt: skip
    thick = 0.25 * 6.6
    bias = (thick / steps) / -math.expm1(-thick / steps) - 1
    assert float(light["source"] / light["exact_segment"]) - 1 == pytest.approx(bias, rel=1e-3)
    assert bias == pytest.approx(excess, rel=0.05)


@pytest.mark.parametrize("light", [LAMP, SUN], ids=["lamp", "sun"])
def test_a_grid_of_one_density_is_a_homogeneous_medium(light) -> None:
    grid = before_a_wall(fog(density=torch.full((6, 5, 7), 1.0)), light, panels=64)
    even = before_a_wall(fog(), light, panels=64)
    torch.testing.assert_close(grid.transmittance, even.transmittance, rtol=1e-5, atol=1e-6)
    tolerance = 1e-5 if light is SUN else 2e-4  # a lamp's own table, which grids do not have, is coarser
    assert rmse(grid.scattered, even.scattered) < tolerance


def test_without_falloff_heights_are_a_homogeneous_medium() -> None:
    for light in (LAMP, SUN):
        even, fall = (before_a_wall(fog(density=1.5, falloff=b), light, panels=32) for b in (0.0, 1e-7))
        torch.testing.assert_close(fall.scattered, even.scattered, rtol=2e-3, atol=1e-6)


# ---------------------------------------------------------------- laws


def test_a_medium_cut_in_two_is_the_same_medium() -> None:
    """Overlapping, beside each other, and inside each other: what is in boxes adds up."""
    whole = fog()
    half = fog(scattering=whole.scattering / 2, absorption=whole.absorption / 2)
    left, right = fog(high=torch.tensor([0.3, 4.0, 0.5])), fog(low=torch.tensor([0.3, -1.0, -8.0]))
    wanted = before_a_wall(whole, LAMP, SUN, panels=32)
    for parts in ((half, half), (left, right)):
        found = before_a_wall(parts, LAMP, SUN, panels=32)
        torch.testing.assert_close(found.transmittance, wanted.transmittance, rtol=1e-4, atol=1e-5)
        assert rmse(found.scattered, wanted.scattered) < 2e-3


def test_ten_overlapping_media_hold_back_what_each_does() -> None:
    media = tuple(
        fog(high=torch.tensor([4.8 - 0.3 * k, 4.0, 0.5]), scattering=torch.full((3,), 0.03)) for k in range(10)
    )
    made = before_a_wall(media, LAMP, SUN)
    product = torch.ones_like(made.transmittance)
    for medium in media:
        product = product * before_a_wall(medium).transmittance
    torch.testing.assert_close(made.transmittance, product, rtol=1e-4, atol=1e-6)
    assert bool(torch.isfinite(made.scattered).all()) and bool((made.scattered > 0).all())


def test_density_that_scales_absorption_alone_leaves_scattering_even() -> None:
    twice = before_a_wall(fog(density=2.0, density_scales="absorption"), SUN, panels=32)
    wanted = before_a_wall(fog(absorption=torch.full((3,), 0.2)), SUN, panels=32)
    torch.testing.assert_close(twice.transmittance, wanted.transmittance, rtol=1e-5, atol=1e-6)
    assert rmse(twice.scattered, wanted.scattered) < 2e-3


def test_colours_are_integrated_apart() -> None:
    medium = fog(scattering=torch.tensor([0.5, 0.2, 0.05]), absorption=torch.tensor([0.0, 0.1, 0.3]))
    made = before_a_wall(medium, LAMP, SUN, panels=32)
    for c in range(3):
        alone = fog(scattering=medium.scattering[c].expand(3), absorption=medium.absorption[c].expand(3))
        wanted = before_a_wall(alone, LAMP, SUN, panels=32)
        assert rmse(made.scattered[..., c], wanted.scattered[..., c]) < 1e-4


def test_what_a_medium_gives_off_is_absorption_times_its_own_radiance() -> None:
    medium = fog(emission=torch.tensor([1.0, 0.5, 0.0]), scattering=torch.zeros(3))
    made = before_a_wall(medium)
    torch.testing.assert_close(made.scattered, medium.emission * (1 - made.transmittance), rtol=1e-5, atol=1e-7)
    both = before_a_wall((medium, fog(absorption=torch.full((3,), 0.05))), panels=32)
    assert bool((both.scattered[..., 0] < made.scattered[..., 0]).all()), "another medium holds some of it back"


def test_surroundings_are_bent_by_the_phase_function() -> None:
    sky = Environment(radiance=torch.linspace(2.0, 0.0, 16)[:, None, None].expand(16, 32, 3).contiguous())
    bands = Surroundings.of(torch.zeros(3), sky)
    assert bands is not None
    up = torch.tensor([[0.0, 1.0, 0.0], [0.0, -1.0, 0.0]])
    even, ahead = (scattered_surroundings(bands.coefficients, up, g) for g in (0.0, 0.8))
    torch.testing.assert_close(even[0], even[1], rtol=1e-4, atol=1e-4)
    assert float(ahead[0, 0]) > float(even[0, 0]) > float(ahead[1, 0])


def test_clear_air_changes_nothing() -> None:
    made = before_a_wall(fog(scattering=torch.zeros(3), absorption=torch.zeros(3)), LAMP)
    assert bool((made.transmittance == 1).all()) and bool((made.scattered == 0).all())


def test_the_same_seed_gives_the_same_picture_and_another_one_does_not() -> None:
    scene, camera = t1(), eye(60, 45)
    first, again = (scattered(scene, camera, way="walk", seed=5).scattered for _ in range(2))
    assert torch.equal(first, again)
    assert not torch.equal(first, scattered(scene, camera, way="walk", seed=6).scattered)
    steps = [scattered(scene, camera, way="march", steps=16, seed=s, block=1).scattered for s in (1, 1, 2)]
    assert torch.equal(steps[0], steps[1]) and not torch.equal(steps[0], steps[2])


def test_means_follow_the_published_trends() -> None:
    def mean(**medium) -> float:
        return float(before_a_wall(fog(**medium), LAMP).scattered.mean())

    more = [mean(scattering=torch.full((3,), s), absorption=torch.zeros(3)) for s in (0.02, 0.04, 0.06, 0.08, 0.1)]
    assert more == sorted(more)
    darker = [mean(absorption=torch.full((3,), a)) for a in (0.0, 0.2, 0.4, 0.6, 0.8)]
    assert darker == sorted(darker, reverse=True)
    ahead = replace(LAMP, position=torch.tensor([0.0, 0.0, -7.5]))  # behind all that is seen
    forward = [float(before_a_wall(fog(asymmetry=g), ahead).scattered.mean()) for g in (-0.6, -0.3, 0.0, 0.3, 0.6)]
    assert forward == sorted(forward)
    behind = replace(LAMP, position=torch.tensor([0.0, 0.0, 0.3]))
    backward = [float(before_a_wall(fog(asymmetry=g), behind).scattered.mean()) for g in (-0.6, -0.3, 0.0, 0.3, 0.6)]
    assert backward == sorted(backward, reverse=True)


def test_light_on_surfaces_scales_with_what_the_way_to_it_lets_through() -> None:
    medium = fog()
    places = torch.tensor([[[[0.0, -1.0, -4.0], [2.0, -1.0, -5.0], [0.0, 9.0, 0.0]]]], dtype=torch.float64)
    found = light_transmittance((medium,), (LAMP,), places, torch.tensor([[[True, True, False]]]))
    assert found is not None
    length = (places[0, 0, :2] - LAMP.position.double()).norm(dim=-1)
    torch.testing.assert_close(found[0, 0, 0, :2, 0], torch.exp(-0.4 * length).float(), rtol=1e-5, atol=0)
    assert float(found[0, 0, 0, 2, 0]) == 1.0


# ---------------------------------------------------------------- published figures: test scene T1


@pytest.mark.parametrize(("block", "limit"), [(2, 0.005), (3, 0.015)])
def test_blocks_reach_the_published_error(block: int, limit: float) -> None:
    scene, camera = t1(), eye()
    every = scattered(scene, camera, shadows=False, block=1).scattered
    made = scattered(scene, camera, shadows=False, block=block)
    assert rmse(made.scattered, every) < limit
    assert float(made.integrated.mean()) < (0.45 if block == 2 else 0.3)
    assert bool((made.scattered > 0).all()), "every pixel has a value"


def test_printed_gradients_are_worse_than_least_squares() -> None:
    scene, camera = t1(), eye()
    every = scattered(scene, camera, shadows=False, block=1).scattered
    errors = {
        gradient: rmse(scattered(scene, camera, shadows=False, block=3, gradient=gradient).scattered, every)
        for gradient in ("lsq", "nearest", "none")
    }
    assert errors["lsq"] < errors["none"] < errors["nearest"]


@pytest.mark.parametrize("light", [LAMP, SUN], ids=["lamp", "sun"])
def test_shafts_are_not_interpolated_over(light) -> None:
    """Marks by length alone would miss the edges of light and shadow along the rays."""
    scene, camera = t1(light, grille=True), eye()
    every = scattered(scene, camera, way="walk", block=1).scattered
    careful, careless = (
        rmse(scattered(scene, camera, way="walk", block=3, share_tolerance=t).scattered, every) for t in (0.02, 1.0)
    )
    assert careful < 0.04 and careful < careless


# ---------------------------------------------------------------- hard cases

POINT = {
    "inside": (1.0, 1.0, -4.5),
    "on the border": (4.8, 1.0, -4.5),
    "outside": (6.5, 3.0, -3.0),
    "eye": (0.0, 0.0, 0.0),
}


def healthy(made) -> bool:
    values = torch.cat([made.scattered.reshape(-1), made.transmittance.reshape(-1)])
    return bool(torch.isfinite(values).all()) and bool((values >= 0).all()) and bool((made.transmittance <= 1).all())


@pytest.mark.parametrize("place", POINT)
@pytest.mark.parametrize("kind", ["flat", "height", "grid"])
@pytest.mark.parametrize("way", ["slices", "march"])
def test_lights_anywhere(place: str, kind: str, way: str) -> None:
    density = {"flat": {}, "height": {"density": 1.5, "falloff": 0.8}, "grid": {"density": torch.rand(4, 5, 6)}}[kind]
    lamp = replace(LAMP, position=torch.tensor(POINT[place]))
    assert healthy(before_a_wall(fog(**density), lamp, way=way, steps=32))


@pytest.mark.parametrize("amount", [1e6, 1e3, 1e-6, 1e-12])
@pytest.mark.parametrize("kind", ["flat", "height", "grid"])
def test_densities_of_any_size(amount: float, kind: str) -> None:
    density = torch.full((3, 3, 3), amount) if kind == "grid" else amount
    medium = fog(density=density, falloff=0.5 if kind == "height" else 0.0)
    for way in ("slices", "march"):
        made = before_a_wall(medium, LAMP, SUN, way=way, steps=16, surroundings=Surroundings.of(torch.ones(3), None))
        assert healthy(made)
        if amount < 1e-3:  # light is what one scattering of unweakened light gives: it grows as the density does
            twice = before_a_wall(fog(density=density * 2, falloff=medium.falloff), LAMP, SUN, way=way, steps=16)
            once = before_a_wall(medium, LAMP, SUN, way=way, steps=16)
            torch.testing.assert_close(twice.scattered, 2 * once.scattered, rtol=1e-3, atol=0)


@pytest.mark.parametrize("g", [-0.99, 0.99])
def test_light_that_hardly_turns(g: float) -> None:
    for way in ("slices", "march"):
        assert healthy(before_a_wall(fog(asymmetry=g), LAMP, SUN, way=way, steps=16))


def test_rays_along_the_sides_of_a_box_and_eyes_in_its_plane() -> None:
    plane = fog(low=torch.tensor([0.0, 0.0, -8.0]), high=torch.tensor([4.8, 4.0, 0.0]))  # the eye is its corner
    odd = Cameras.look_at((0, 0, 0), (0, 0, -1), width=49, height=37)  # the middle ray lies in two of its planes
    made = scatter((plane,), odd, torch.full((1, 37, 49), 7.0), Illumination(lights=(LAMP, SUN), size=10.0))
    assert healthy(made)
    assert bool((made.transmittance[0, :, :20] == 1).all()) and bool((made.transmittance[0, 5:15, 40:] < 1).all())


def test_a_box_before_the_eye_a_thin_box_and_nothing_behind() -> None:
    ahead = fog(low=torch.tensor([-1.0, -1.0, -6.0]), high=torch.tensor([1.0, 1.0, -5.0]))
    thin = fog(low=torch.tensor([-1.0, -1.0, -5.0001]), high=torch.tensor([1.0, 1.0, -5.0]))
    sky = torch.full((1, 36, 48), torch.inf)
    for medium in (ahead, thin, fog()):
        made = scatter((medium,), CAMERA, sky, Illumination(lights=(LAMP, SUN), size=10.0))
        assert healthy(made) and bool((made.transmittance < 1).any())


def test_spots_and_rectangles_light_their_side_only() -> None:
    spot = SpotLight(position=torch.tensor([0.0, 0.5, -4.0]), direction=torch.tensor([0.0, 1.0, 0.0]), outer_deg=20.0)
    up = before_a_wall(fog(), spot).scattered
    assert bool((up[0, 20:] == 0).all()) and bool((up[0, :8] > 0).any())
    corner = torch.tensor([-0.5, 2.0, -4.5])
    below = RectLight(corner=corner, edge_u=torch.tensor([1.0, 0, 0]), edge_v=torch.tensor([0, 0, 1.0]))
    above = RectLight(corner=corner, edge_u=torch.tensor([0, 0, 1.0]), edge_v=torch.tensor([1.0, 0, 0]))
    down, up = (before_a_wall(fog(), light).scattered for light in (below, above))
    assert bool((down[0, 20:] > 0).all()) and bool((up[0, 20:] == 0).all())


def test_a_small_rectangle_is_a_lamp_of_its_power() -> None:
    small = RectLight(
        corner=torch.tensor([0.995, 1.0, -4.505]), edge_u=torch.tensor([0.01, 0, 0]), edge_v=torch.tensor([0, 0, 0.01])
    )
    made = before_a_wall(fog(), small, panels=32).scattered
    spot = before_a_wall(
        fog(), PointLight(position=small.centre, intensity=torch.full((3,), 1e-4)), panels=32
    ).scattered
    assert bool((made <= spot * 1.01 + 1e-12).all()) and float(made.max()) > 0.2 * float(spot.max())


def test_orthographic_cameras_and_batches() -> None:
    flat = Cameras(
        CAMERA.camera_from_world, torch.tensor([[[6.0, 0, 24], [0, 6.0, 18], [0, 0, 1]]]), 48, 36,
        torch.tensor(0.0), torch.tensor(100.0), orthographic=True,
    )  # fmt: skip
    made = scatter((fog(),), flat, WALL, Illumination(lights=(LAMP, SUN), size=10.0))
    assert healthy(made) and bool((made.scattered[0, :20] > 0).all())
    two = Cameras.cat([CAMERA, Cameras.look_at((0.5, 0, 0), (0, 0, -1), width=48, height=36)])
    pair = scatter((fog(),), two, WALL.expand(2, 36, 48), Illumination(lights=(LAMP,), size=10.0))
    first = scatter((fog(),), two[0], WALL, Illumination(lights=(LAMP,), size=10.0))
    assert torch.equal(pair.scattered[0], first.scattered[0])
    none = scatter((fog(),), CAMERA[[]], WALL[:0], Illumination(lights=(LAMP,)))
    assert none.scattered.shape == (0, 36, 48, 3)


def test_far_from_the_worlds_origin_nothing_changes() -> None:
    shift = torch.tensor([1e5, -3e5, 2e5])
    medium = fog(low=torch.tensor([-4.0, -1.0, -8.0]) + shift, high=torch.tensor([4.0, 4.0, 0.0]) + shift)
    eyes = Cameras.look_at(shift.double(), shift.double() + torch.tensor([0, 0, -1.0]), width=48, height=36)
    lamp = replace(LAMP, position=LAMP.position + shift)
    far = scatter((medium,), eyes, WALL, Illumination(lights=(lamp,), size=10.0)).scattered
    near_eyes = Cameras.look_at((0, 0, 0), (0, 0, -1), width=48, height=36)
    near_box = fog(low=torch.tensor([-4.0, -1.0, -8.0]), high=torch.tensor([4.0, 4.0, 0.0]))
    near = scatter((near_box,), near_eyes, WALL, Illumination(lights=(LAMP,), size=10.0)).scattered
    assert rmse(far, near) < 0.05  # float32 places of boxes and lights are that coarse there


def test_bad_input_is_named() -> None:
    with pytest.raises(OptionError, match="block"):
        ScatterOptions(block=4)
    with pytest.raises(OptionError, match="way"):
        ScatterOptions(shadows="rays")
    with pytest.raises(InputError, match="shadow_maps must have 2 entries"):
        Illumination(lights=(LAMP, SUN), shadow_maps=(None,))
    with pytest.raises(InputError, match="depth"):
        scatter((fog(),), CAMERA, torch.zeros(1, 2, 2), Illumination())


def test_each_band_of_the_surroundings_is_damped_as_the_phase_function_has_it() -> None:
    """Against the sum over directions of phase function times radiance."""
    rng = torch.Generator().manual_seed(4)
    coefficients = 0.1 * torch.rand(9, 3, generator=rng, dtype=torch.float64)
    coefficients[0] = 3.0  # bright enough to be positive everywhere
    n = torch.arange(20000, dtype=torch.float64) + 0.5
    z, turn = 1 - 2 * n / 20000, math.pi * (3 - math.sqrt(5)) * n
    across = (1 - z * z).sqrt()
    sphere = torch.stack([across * torch.cos(turn), across * torch.sin(turn), z], dim=-1)
    arriving = harmonics_2(sphere) @ coefficients
    for g in (-0.6, 0.0, 0.7):
        for out in torch.nn.functional.normalize(torch.tensor([[1.0, 0.2, -0.4], [0.1, -1.0, 0.3]]).double(), dim=1):
            wanted = (henyey_greenstein(sphere @ out, g)[:, None] * arriving).sum(0) * 4 * math.pi / 20000
            torch.testing.assert_close(scattered_surroundings(coefficients, out, g), wanted, rtol=2e-3, atol=0)
