"""Lobes as transformed cosines: the kept table is what the fit gives, polygons against sums, whole skies, mirrors."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
import torch
from torch import Tensor

from torchrender.numerics.ggx import ggx_lobe
from torchrender.numerics.lobe_albedo import look_up
from torchrender.raster import rasterize
from torchrender.scene.camera import Cameras
from torchrender.scene.light import PointLight, RectLight
from torchrender.scene.material import Material
from torchrender.scene.mesh import Mesh
from torchrender.scene.model import Scene
from torchrender.shade import shade
from torchrender.shading.linear_cosines import SIZE, linear_cosines, mirrored_share, nearest_point
from torchrender.tuning.linear_cosines import cosines, density, fit, lobe_of, smoother, transform_of

UP = torch.tensor([0.0, 0.0, 1.0])


def eye_at(degrees: float) -> Tensor:
    return torch.tensor([math.sin(math.radians(degrees)), 0.0, math.cos(math.radians(degrees))])


def share(corners: Tensor, eye: Tensor, roughness: float) -> float:
    """Of a point at the origin whose normal is z."""
    return float(mirrored_share(corners[:, :, None], UP[:, None], eye[:, None], torch.tensor([roughness])))


def panel(about: Tensor, away: float, half: float) -> Tensor:
    """(4,3) corners of a square that faces the origin from a unit direction."""
    across = torch.nn.functional.normalize(torch.linalg.cross(about, torch.tensor([0.31, 0.93, 0.2])), dim=0)
    other = torch.linalg.cross(about, across)
    return torch.stack(
        [away * about + half * (i * across + j * other) for i, j in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
    )


@pytest.mark.parametrize("row", [4, 15, 28])
def test_the_kept_table_is_what_the_fit_gives(row: int) -> None:
    columns = np.array([3, 12, 20, 31])
    cosine, kept = cosines()[columns], linear_cosines().numpy()
    lobe = lobe_of(cosine, row / (SIZE - 1))
    start = smoother(transform_of(kept[row + 1, columns], cosine), (row + 1) / (SIZE - 1), row / (SIZE - 1))
    again, own = density(fit(lobe, start), lobe), density(transform_of(kept[row, columns], cosine), lobe)
    for one in (again, own):  # half of the integral of the difference: what is in another place
        assert float((np.abs(one - lobe.value) * lobe.weight).mean(1).max()) / 2 < 0.25
    assert float((np.abs(again - own) * lobe.weight).mean(1).max()) / 2 < 0.01


@pytest.mark.parametrize("roughness", [0.0, 0.1, 0.3, 0.6, 1.0])
def test_a_whole_sky_fills_the_lobe(roughness: float) -> None:
    sky = torch.tensor([[-1e4, -1e4, 1.0], [1e4, -1e4, 1.0], [1e4, 1e4, 1.0], [-1e4, 1e4, 1.0]])
    for degrees in (0.0, 20.0, 45.0, 70.0, 85.0):
        assert share(sky, eye_at(degrees), roughness) == pytest.approx(1.0, abs=3e-3), degrees


def test_a_mirror_shows_the_rectangle_or_not() -> None:
    for degrees in (0.0, 30.0, 60.0):
        toward = eye_at(-degrees)
        assert share(panel(toward, 2.0, 0.5), eye_at(degrees), 0.0) > 0.98
        beside = eye_at(20.0 - degrees)
        assert share(panel(beside, 2.0, 0.4), eye_at(degrees), 0.0) < 0.01


def lobe_sum(corners: Tensor, eye: Tensor, roughness: float, steps: int = 400) -> float:
    """The lobe's integral over a square, over that above the surface: midpoints, in float64."""
    alpha = torch.tensor(roughness**2, dtype=torch.float64)

    def lobe(light: Tensor) -> Tensor:
        half = torch.nn.functional.normalize(light + eye.double(), dim=-1)
        sine = half[..., :2].square().sum(-1)
        return ggx_lobe(sine, light[..., 2], eye[2].double().expand(sine.shape), alpha) * light[..., 2].clamp_min(0.0)

    t = (torch.arange(steps, dtype=torch.float64) + 0.5) / steps
    a, u, v = corners[0].double(), (corners[1] - corners[0]).double(), (corners[3] - corners[0]).double()
    place = a + t[:, None, None] * u + t[None, :, None] * v
    square = place.square().sum(-1)
    light = place / square.sqrt()[..., None]
    facing = (light @ torch.linalg.cross(u, v)).abs() / steps**2  # cosine times area
    part = (torch.where(light[..., 2] > 0, lobe(light), 0.0) * facing / square).sum()
    z, turn = torch.meshgrid(t, 2 * math.pi * t, indexing="ij")
    wide = (1 - z * z).sqrt()
    whole = lobe(torch.stack([wide * turn.cos(), wide * turn.sin(), z], dim=-1)).mean() * 2 * math.pi
    return float(part / whole)


@pytest.mark.parametrize("roughness", [0.3, 0.5, 0.75, 1.0])
def test_agrees_with_a_sum_over_the_rectangle(roughness: float) -> None:
    errors = []
    for degrees in (0.0, 30.0, 60.0):
        for about in ((0.0, 0.0, 1.0), (-0.5, 0.1, 0.8), (-0.8, 0.3, 0.4), (0.4, 0.7, 0.5), (-0.6, 0.6, 0.02)):
            corners = panel(torch.nn.functional.normalize(torch.tensor(about), dim=0), 2.0, 1.1)
            errors.append(share(corners, eye_at(degrees), roughness) - lobe_sum(corners, eye_at(degrees), roughness))
    assert float(np.abs(errors).max()) < 0.04 and float(np.square(errors).mean()) ** 0.5 < 0.017


def slow_share(corners: Tensor, normal: Tensor, eye: Tensor, roughness: float) -> float:
    """The same with matrices that are inverted, a polygon that is clipped corner by corner, and arccosines."""
    n, v = normal.double().numpy(), eye.double().numpy()
    cosine = float(n @ v)
    sine = math.sqrt(1 - cosine**2)
    numbers = look_up(linear_cosines(), torch.tensor([cosine]).float(), torch.tensor([roughness]))[0].double().tolist()
    a, b, c, d, e = numbers
    level = (v - cosine * n) / sine
    axes = np.stack([sine * n + cosine * level, np.cross(n, level), cosine * n - sine * level])
    matrix = axes.T @ np.array([[a, 0, sine * b], [0, c, 0], [sine * d, 0, e]])
    inverse = np.linalg.inv(matrix)
    points = [inverse @ p for p in corners.double().numpy()]
    clipped = []
    for p, q in zip(points, points[1:] + points[:1]):
        if p[2] > 0:
            clipped.append(p)
        if (p[2] > 0) != (q[2] > 0):
            clipped.append(p + (q - p) * p[2] / (p[2] - q[2]))
    total = 0.0
    for p, q in zip(clipped, clipped[1:] + clipped[:1]):
        p, q = p / np.linalg.norm(p), q / np.linalg.norm(q)
        side = np.cross(p, q)
        if np.linalg.norm(side) > 1e-12:
            total += math.acos(min(max(p @ q, -1.0), 1.0)) * side[2] / np.linalg.norm(side)
    edge = matrix.T @ n  # the surface's plane, where the lobe is a cosine
    return min(abs(total) / (2 * math.pi) / (0.5 * (1 + edge[2] / np.linalg.norm(edge))), 1.0)


def test_against_a_loop() -> None:
    generator = torch.Generator().manual_seed(0)
    for _ in range(60):
        normal, eye, corner, u, v = torch.nn.functional.normalize(torch.randn(5, 3, generator=generator), dim=-1)
        eye = torch.nn.functional.normalize(eye if float(eye @ normal) > 0.05 else normal + 0.8 * eye, dim=0)
        corners = torch.stack([corner, corner + u, corner + u + v, corner + v]) + 0.5 * normal
        roughness = 0.1 + 0.9 * float(torch.rand((), generator=generator))
        found = mirrored_share(corners[:, :, None], normal[:, None], eye[:, None], torch.tensor([roughness]))
        assert float(found) == pytest.approx(slow_share(corners, normal, eye, roughness), abs=2e-4)


def test_rays_that_hit_a_panel_see_the_point_there_and_others_its_edge() -> None:
    generator = torch.Generator().manual_seed(2)
    for _ in range(60):
        corner, u, v = torch.randn(3, 3, generator=generator, dtype=torch.float64)
        middle = corner + (u + v) / 2
        if float(torch.linalg.cross(u, v) @ middle) > 0:  # the other side is dark
            u, v = v, u
        inside, beyond = (torch.rand(2, generator=generator, dtype=torch.float64) - 0.5), torch.tensor([1.7, 0.1])
        corners = torch.stack([corner, corner + u, corner + u + v, corner + v])[:, :, None]
        for (p, q), (r, s) in ((inside, inside), (beyond, (0.5, 0.1)), (-beyond.flip(0), (-0.1, -0.5))):
            ray = torch.nn.functional.normalize(middle + p * u + q * v, dim=0)
            if float(torch.linalg.cross(u, v) @ ray) > -0.05 * float(torch.linalg.cross(u, v).norm()):
                continue
            wanted = torch.nn.functional.normalize(middle + r * u + s * v, dim=0)
            torch.testing.assert_close(nearest_point(corners, ray[:, None])[:, 0], wanted, rtol=1e-6, atol=1e-6)


@pytest.mark.parametrize("kernel", [True, False])
@pytest.mark.parametrize("along", [0.2, 0.6])
def test_a_small_panel_shines_on_plastic_as_a_lamp_does(along: float, kernel: bool) -> None:
    """Of rough facets, those that face halfway to it mirror it: by their own angle, not by that of the whole lobe."""
    flat = Mesh(
        vertices=torch.tensor([[-9.0, -9, 0], [9, -9, 0], [9, 9, 0], [-9, 9, 0]]),
        faces=torch.tensor([[0, 1, 2], [0, 2, 3]]),
    )
    side, far = 0.05, torch.tensor([3.0 * along, 0.0, 3.0])
    panel = RectLight(
        corner=far - torch.tensor([side / 2, -side / 2, 0.0]), edge_u=torch.tensor([side, 0.0, 0.0]),
        edge_v=torch.tensor([0.0, -side, 0.0]), radiance=torch.ones(3) / side**2,
    )  # fmt: skip
    facing = far[2] / far.norm()
    lamp = PointLight(position=far, intensity=torch.ones(3) * facing)
    plastic = Material(metallic=0.0, roughness=0.8, diffuse=torch.zeros(3))
    camera = Cameras.look_at([-6.0, 0.0, 1.2], [0.0, 0.0, 0.0], width=3, height=3, fov_deg=0.1, up=(0, 0, 1))
    found = []
    for light in (panel, lamp):
        scene = Scene(meshes=(flat,), materials=(plastic,), lights=(light,))
        gbuffer = rasterize(scene, camera)
        found.append(float(shade(scene, gbuffer if kernel else replace(gbuffer)).mean()))
    assert found[0] == pytest.approx(
        found[1], rel=0.15
    )  # by the mean of the whole lobe it would be four times too bright


def test_derivatives_agree_with_finite_differences() -> None:
    corners = panel(torch.nn.functional.normalize(torch.tensor([-0.5, 0.2, 0.8]), dim=0), 2.0, 0.7).double()[:, :, None]
    eye, rough = eye_at(35.0).double()[:, None], torch.tensor([0.43], dtype=torch.float64)
    inputs = tuple(v.clone().requires_grad_() for v in (corners, eye, rough))
    assert torch.autograd.gradcheck(lambda p, v, r: mirrored_share(p, UP.double()[:, None], v, r), inputs, atol=1e-5)


def test_a_panel_over_everything_is_a_white_furnace() -> None:
    """A white metal, with a coat or without, under a white panel as wide as the sky sends back nearly all of it."""
    flat = Mesh(
        vertices=torch.tensor([[-9.0, -9, 0], [9, -9, 0], [9, 9, 0], [-9, 9, 0]]),
        faces=torch.tensor([[0, 1, 2], [0, 2, 3]]),
    )
    sky = RectLight(
        corner=torch.tensor([-1e4, 1e4, 8.0]), edge_u=torch.tensor([2e4, 0.0, 0.0]),
        edge_v=torch.tensor([0.0, -2e4, 0.0]), radiance=torch.ones(3),
    )  # fmt: skip
    camera = Cameras.look_at([0.0, 4.0, 6.0], [0.0, 0.0, 0.0], width=5, height=5, fov_deg=20.0)
    for roughness in (0.0, 0.3, 0.6, 1.0):
        for coat in (0.0, 1.0):
            white = Material(metallic=1.0, roughness=roughness, diffuse=torch.ones(3), clearcoat=coat)
            scene = Scene(meshes=(flat,), materials=(white,), lights=(sky,))
            image = shade(scene, rasterize(scene, camera))
            assert float(image.min()) > 0.985 and float(image.max()) < 1.006, (roughness, coat)
