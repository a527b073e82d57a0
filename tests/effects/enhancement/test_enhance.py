"""Enhanced pictures: laws, the specification's test object, and pictures of everything that has depth."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
import torch
import trimesh
from scipy.ndimage import binary_erosion, gaussian_filter
from torch import Tensor

import torchrender as tr
from torchrender.effects.enhancement.creases import FADE, REACH, crease_distance
from torchrender.effects.enhancement.curvature import mesh_curvature
from torchrender.effects.enhancement.enhance import WINDOW, enhance_picture, enhanced, enhancement, magnitude
from torchrender.effects.enhancement.gradient import Gloss, Lighting, shading_gradient
from torchrender.effects.enhancement.options import EnhanceOptions
from torchrender.effects.enhancement.shadow_edges import edge_pixels, shadow_edges
from torchrender.effects.enhancement.surface_image import SurfaceImage, curvature_of
from torchrender.errors import InputError, OptionError
from torchrender.pipeline.options import RenderOptions
from torchrender.raster import rasterize
from torchrender.scene.camera import Cameras
from torchrender.scene.environment import Environment
from torchrender.scene.light import DirectionalLight, PointLight
from torchrender.scene.material import Material
from torchrender.scene.mesh import Mesh
from torchrender.scene.model import Scene


def bumpy(subdivisions: int = 6) -> Mesh:
    """Section 8's test object: a sphere of radius 1.3 with bumps of 2 %."""
    made = trimesh.creation.icosphere(subdivisions=subdivisions)
    d = torch.nn.functional.normalize(torch.tensor(made.vertices, dtype=torch.float64), dim=-1)
    bumps = torch.sin(14 * d[:, 0]) * torch.sin(14 * d[:, 1]) * torch.sin(14 * d[:, 2] + 1)
    v = d * (1.3 * (1 + 0.02 * bumps))[:, None] + torch.tensor([0, 0, 4.0], dtype=torch.float64)
    f = torch.tensor(made.faces.copy())
    face = torch.linalg.cross(v[f[:, 1]] - v[f[:, 0]], v[f[:, 2]] - v[f[:, 0]])
    n = torch.zeros_like(v).index_add(0, f.reshape(-1), face.repeat_interleave(3, 0))
    return Mesh(vertices=v, faces=f, normals=torch.nn.functional.normalize(n, dim=-1).float())


class Bumps:
    """The test object as its camera sees it, with its published shading: no fall-off, white."""

    def __init__(self) -> None:
        mesh = bumpy()
        self.scene = Scene(meshes=(mesh,), materials=(Material(diffuse=torch.ones(3)),))
        k = torch.tensor([[[396.0, 0, 180], [0, 396, 180], [0, 0, 1]]])
        eye = torch.eye(4, dtype=torch.float64)[None]
        self.seen = rasterize(self.scene, Cameras(eye, k, 360, 360, torch.tensor(0.1), torch.tensor(100.0)))
        self.surface = SurfaceImage.of(self.seen)
        self.curvature = curvature_of(self.seen, self.scene.geometry, mesh_curvature(self.scene.geometry))

    def pictures(self, light: tuple[float, float, float], options: EnhanceOptions) -> tuple[Tensor, Tensor]:
        """Plain and enhanced cosine (H,W)."""
        lamp = PointLight(position=torch.tensor(light), intensity=torch.full((3,), torch.pi))
        away = lamp.position.double() - self.seen.position
        square = away.square().sum(-1)
        plain = ((away * self.seen.normal).sum(-1) / square.sqrt().clamp_min(1e-9)).clamp_min(0)
        size = enhancement(self.surface, self.curvature, Lighting((lamp,)), options)[..., 0] * square
        return plain[0], (0.8 * plain + 0.4 * size)[0]

    def gains(self, light: tuple[float, float, float], options: EnhanceOptions) -> tuple[float, float]:
        """Contrast gain where the surface is grazing, and where it faces the eye."""
        mask = self.seen.covered[0].numpy()
        inner = binary_erosion(mask, iterations=6)
        toward = -torch.nn.functional.normalize(self.seen.position[0], dim=-1)
        cosine = (toward * self.seen.normal[0]).sum(-1).numpy()
        plain, made = (_high_pass(p.numpy(), mask) for p in self.pictures(light, options))
        regions = ((cosine > 0.15) & (cosine < 0.4) & inner, (cosine > 0.7) & inner)
        return tuple(float(made[r].std() / plain[r].std()) for r in regions)  # type: ignore[return-value]


def _high_pass(image: np.ndarray, mask: np.ndarray) -> np.ndarray:
    smooth = gaussian_filter(image * mask, 3) / np.maximum(gaussian_filter(mask.astype(float), 3), 1e-9)
    return np.where(mask, image - smooth, 0.0)


@pytest.fixture(scope="module")
def bumps() -> Bumps:
    return Bumps()


LIGHTS = ((0.0, 0.0, 0.0), (-3.0, -3.0, 0.0), (3.0, -3.0, 0.0))


@pytest.mark.parametrize("light", LIGHTS)
@pytest.mark.parametrize("mag", ["sum", "signed_l2"])
def test_projection_helps_where_the_surface_is_grazing(
    bumps: Bumps, light: tuple[float, float, float], mag: str
) -> None:
    without = bumps.gains(light, EnhanceOptions(magnitude=mag, terms=("geometry",)))
    with_it = bumps.gains(light, EnhanceOptions(magnitude=mag))
    assert with_it[0] >= 1.2 * without[0]


@pytest.mark.parametrize(
    ("mag", "published"), [("sum", (1.15, 2.00)), ("signed_l2", (0.98, 1.72))],
)  # fmt: skip
def test_the_published_rows_with_the_light_at_the_eye(bumps: Bumps, mag: str, published: tuple[float, float]) -> None:
    """Frontal gains without and with projection, within 15 %."""
    for terms, wanted in zip((("geometry",), ("geometry", "projection")), published, strict=True):
        found = bumps.gains(LIGHTS[0], EnhanceOptions(magnitude=mag, terms=terms))[1]
        assert found == pytest.approx(wanted, rel=0.15)


def test_signed_size_does_not_know_left_from_right() -> None:
    """Light and object mirrored: the enhanced picture is mirrored."""
    mesh = bumpy(4)
    flip = torch.tensor([-1.0, 1.0, 1.0])
    twin = replace(mesh, vertices=mesh.vertices * flip, normals=mesh.normals * flip, faces=mesh.faces.flip(-1))  # type: ignore[operator]
    k = torch.tensor([[[80.0, 0, 40], [0, 80, 40], [0, 0, 1]]])
    camera = Cameras(torch.eye(4, dtype=torch.float64)[None], k, 80, 80, torch.tensor(0.1), torch.tensor(100.0))
    made = []
    for one, light in ((mesh, [-3.0, -2.0, 0.0]), (twin, [3.0, -2.0, 0.0])):
        scene = Scene(meshes=(one,))
        seen = rasterize(scene, camera)
        bent = curvature_of(seen, scene.geometry, mesh_curvature(scene.geometry))
        made.append(enhancement(SurfaceImage.of(seen), bent, Lighting((PointLight(position=torch.tensor(light)),))))
    apart = (made[0] - made[1].flip(2)).abs()
    assert float(apart.mean()) < 0.05 * float(made[0].abs().mean())


def test_magnitudes_of_known_gradients() -> None:
    gradient = torch.tensor([[[1.0, -1.0]] * 3, [[1.0, 1.0]] * 3])
    signed = torch.tensor([[5.0] * 3, [-7.0] * 3])
    for name, values in (("sum", (0, 2)), ("l1", (2, 2)), ("l2", (2**0.5, 2**0.5)), ("signed_l2", (5, -7))):
        found = magnitude(gradient, signed, EnhanceOptions(magnitude=name))
        torch.testing.assert_close(found[:, 0], torch.tensor(values, dtype=torch.float32))


def test_without_weight_the_picture_is_the_plain_one_and_the_background_always() -> None:
    scene = tr.load("cornell_box")
    camera = scene.camera(width=64, height=64)
    plain = tr.render(scene, camera)
    same = tr.render(
        scene, camera, options=RenderOptions(enhance=EnhanceOptions(plain_weight=1.0, gradient_weight=0.0))
    )
    assert torch.equal(plain.radiance, same.radiance)
    made = tr.render(scene, camera, options=RenderOptions(enhance=EnhanceOptions()))
    empty = ~plain.gbuffer.covered
    assert torch.equal(made.radiance[empty], plain.radiance[empty])
    assert float((made.radiance - 0.8 * plain.radiance).abs().max()) > 0.01


def test_it_is_planned_and_said() -> None:
    scene = tr.load("cornell_box")
    camera = scene.camera(width=32, height=32)
    assert tr.plan(scene, camera).row("enhancement").reason == "no enhancement was asked for"
    row = tr.plan(scene, camera, options=RenderOptions(enhance=EnhanceOptions(gradient_weight=0.5))).row("enhancement")
    assert row.runs and row.reason == "gradients by 0.5, the plain picture by 0.8"


def test_edges_of_textures_are_no_shape() -> None:
    """A flat card gains nothing at all, whatever is painted on it."""
    checks = ((torch.arange(8)[:, None] + torch.arange(8)) % 2).float()[..., None].expand(8, 8, 3).contiguous()
    quad = torch.tensor([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
    up = torch.tensor([[0.0, 0, 1]]).expand(4, 3)
    uv = torch.tensor([[0.0, 0], [1, 0], [1, 1], [0, 1]])
    card = Mesh(vertices=quad, faces=torch.tensor([[0, 1, 2], [0, 2, 3]]), normals=up, uv=uv)
    far = PointLight(position=torch.tensor([0.0, 0.0, 1e6]), intensity=torch.full((3,), 1e12))
    scene = Scene(meshes=(card,), materials=(Material(diffuse_texture=checks),), lights=(far,))
    camera = Cameras.look_at(torch.tensor([[1.0, 0.5, 2.0]]), torch.zeros(1, 3), width=64, height=64)
    options = RenderOptions(enhance=EnhanceOptions(plain_weight=1.0), shadows=False)
    plain = tr.render(scene, camera, options=RenderOptions(shadows=False)).radiance
    made = tr.render(scene, camera, options=options).radiance
    assert float(plain.std()) > 0.05
    assert float((made - plain).abs().max()) < 1e-3


def test_reflectance_scales_what_is_added() -> None:
    mesh = bumpy(3)
    light = PointLight(position=torch.tensor([-3.0, -3.0, 0.0]), intensity=torch.full((3,), 9.0))
    k = torch.tensor([[[80.0, 0, 40], [0, 80, 40], [0, 0, 1]]])
    camera = Cameras(torch.eye(4, dtype=torch.float64)[None], k, 80, 80, torch.tensor(0.1), torch.tensor(100.0))
    made = []
    for value in (0.2, 0.8):
        scene = Scene(meshes=(mesh,), materials=(Material(diffuse=torch.full((3,), value)),), lights=(light,))
        made.append(tr.render(scene, camera, options=RenderOptions(enhance=EnhanceOptions())).radiance)
    torch.testing.assert_close(made[0] * 4, made[1], rtol=1e-4, atol=1e-6)


def wall(side: int) -> SurfaceImage:
    """A plane across the whole view."""
    quad = torch.tensor([[-9.0, -9, 0], [9, -9, 0], [9, 9, 0], [-9, 9, 0]])
    scene = Scene(meshes=(Mesh(vertices=quad, faces=torch.tensor([[0, 1, 2], [0, 2, 3]])),))
    camera = Cameras.look_at(torch.tensor([[0.0, 0.0, 2.0]]), torch.zeros(1, 3), width=side, height=side)
    return SurfaceImage.of(rasterize(scene, camera))


def test_range_limit_keeps_within_the_neighbourhood() -> None:
    g = torch.Generator().manual_seed(0)
    picture = torch.rand(1, 20, 20, 3, generator=g)
    size = torch.randn(1, 20, 20, 3, generator=g) * 5
    options = EnhanceOptions(plain_weight=1.0, gradient_weight=1.0, range_limit=0.25)
    made = enhanced(picture, size, wall(20), options)
    reach = WINDOW // 2
    for j, i in ((0, 0), (10, 10), (19, 3)):
        window = picture[0, max(j - reach, 0) : j + reach + 1, max(i - reach, 0) : i + reach + 1].reshape(-1, 3)
        room = 0.25 * (window.amax(0) - window.amin(0))
        assert bool((made[0, j, i] <= window.amax(0) + room + 1e-6).all())
        assert bool((made[0, j, i] >= (window.amin(0) - room).clamp_min(0) - 1e-6).all())


def ridges(side: int) -> SurfaceImage:
    """Steep roofs side by side, seen from above: creases across the whole view."""
    x = torch.linspace(-3.0, 3.0, 9)
    z = 0.5 * (torch.arange(9) % 2)
    strip = torch.stack([torch.stack([x, torch.full((9,), y), z], dim=1) for y in (-3.0, 3.0)]).reshape(-1, 3)
    faces = [[k, k + 1, k + 10] for k in range(8)] + [[k, k + 10, k + 9] for k in range(8)]
    scene = Scene(meshes=(Mesh(vertices=strip, faces=torch.tensor(faces)),))
    camera = Cameras.look_at(torch.tensor([[0.0, 0.0, 3.0]]), torch.zeros(1, 3), width=side, height=side)
    return SurfaceImage.of(rasterize(scene, camera))


@pytest.mark.parametrize("share", [0.0, 1 / 3, 0.8])
def test_overshoot_beside_creases_is_bounded_and_nothing_else_changes(share: float) -> None:
    surface = ridges(96)
    distance = crease_distance(surface)
    near, far = distance <= REACH, distance > REACH + FADE
    assert bool(near.any()) and bool(far.any())
    g = torch.Generator().manual_seed(0)
    picture, size = torch.rand(1, 96, 96, 3, generator=g) + 3, torch.randn(1, 96, 96, 3, generator=g)
    free, held = (
        enhanced(picture, size, surface, EnhanceOptions(plain_weight=1.0, overshoot_limit=limit)) - picture
        for limit in (None, share)
    )
    assert float(held[near].abs().max()) <= share * float(free[near].abs().max()) + 1e-6
    assert bool((held.abs() <= free.abs() + 1e-6).all()) and bool((held * free >= -1e-6).all())
    torch.testing.assert_close(held[far], free[far])
    small = near[..., None] & (free.abs() <= share * free[near].abs().quantile(0.99))
    torch.testing.assert_close(held[small], free[small], atol=1e-6, rtol=0)


def test_a_plane_without_creases_is_not_bounded() -> None:
    g = torch.Generator().manual_seed(0)
    picture, size = torch.rand(1, 20, 20, 3, generator=g), torch.randn(1, 20, 20, 3, generator=g)
    free, held = (enhanced(picture, size, wall(20), EnhanceOptions(overshoot_limit=limit)) for limit in (None, 0.1))
    torch.testing.assert_close(held, free)


def test_shadow_edges_point_into_the_shadow_and_lie_on_both_sides() -> None:
    quad = torch.tensor([[-2.0, -2, 0], [2, -2, 0], [2, 2, 0], [-2, 2, 0]])
    scene = Scene(meshes=(Mesh(vertices=quad, faces=torch.tensor([[0, 1, 2], [0, 2, 3]])),))
    camera = Cameras.look_at(torch.tensor([[0.0, 0.0, 2.0]]), torch.zeros(1, 3), width=32, height=32)
    surface = SurfaceImage.of(rasterize(scene, camera))
    lit = torch.ones(1, 1, 32, 32)
    lit[..., 20:] = 0.0
    into, distance = edge_pixels(surface, lit[:, 0])
    assert set(torch.nonzero(distance[0, 16]).reshape(-1).tolist()) == {19, 20}
    torch.testing.assert_close(into[0, 16, 19], torch.tensor([1.0, 0, 0], dtype=torch.float64), atol=1e-6, rtol=0)
    torch.testing.assert_close(into[0, 16, 20], torch.tensor([1.0, 0, 0], dtype=torch.float64), atol=1e-6, rtol=0)
    assert float(distance[0, 16, 19]) == pytest.approx(-float(distance[0, 16, 20]))
    sharp = shadow_edges(surface, lit, EnhanceOptions(shadow_blur=0.0))
    assert float(sharp[0, 0, 16, 19, 0]) < 0 and not bool(sharp[0, 0, :, :18].any())
    soft = shadow_edges(surface, lit, EnhanceOptions(shadow_blur=1.5))
    assert 0 < float(soft[0, 0, 16, 17, 0].abs()) < float(sharp[0, 0, 16, 19, 0].abs())
    none = shadow_edges(surface, torch.ones(1, 1, 32, 32), EnhanceOptions())
    assert not bool(none.any())


def test_borders_of_shadows_count_by_the_light_that_they_take() -> None:
    """A floor in parallel light: radiance is its cosine times what arrives, and so is the slope of what arrives."""
    camera = Cameras.look_at((0.0, 0.0, 3.0), (0.0, 0.0, 0.0), width=4, height=3)
    surface = SurfaceImage.from_depth(camera, torch.full((1, 3, 4), 3.0))
    edges = torch.randn(1, 1, 3, 4, 2, generator=torch.Generator().manual_seed(0), dtype=torch.float64)
    options = EnhanceOptions(magnitude="sum", terms=("visibility",))
    color = torch.tensor([3.0, 2.0, 1.0])
    flat = torch.zeros(1, 3, 4, dtype=torch.float64)
    for degrees in (0.0, 60.0, 89.0, 120.0):
        angle = math.radians(degrees)
        sun = DirectionalLight(direction=torch.tensor([math.sin(angle), 0.0, -math.cos(angle)]), irradiance=color)
        found, _ = shading_gradient(surface, flat, Lighting((sun,)), options, shadow_edges=edges)
        slope = color.double()[:, None] / torch.pi * max(math.cos(angle), 0.0) * edges[:, 0, ..., None, :]
        torch.testing.assert_close(found, options.step * slope, rtol=1e-5, atol=1e-7)


@pytest.mark.parametrize("terms", [("geometry", "projection"), ("specular", "projection")])
def test_true_derivatives_count_by_the_step_and_others_are_a_matter_of_curvature(terms: tuple[str, ...]) -> None:
    camera = Cameras.look_at((0.0, 0.0, 3.0), (0.0, 0.0, 0.0), width=4, height=3)
    surface = SurfaceImage.from_depth(camera, 3.0 + 0.1 * torch.arange(4.0).expand(1, 3, 4))
    random = torch.Generator().manual_seed(1)
    normals = torch.randn(1, 3, 4, 3, 3, generator=random, dtype=torch.float64)
    curvature = torch.rand(1, 3, 4, generator=random, dtype=torch.float64)
    ones = torch.ones(1, 3, 4, 3)
    lit = Lighting(
        (PointLight(position=torch.tensor([1.0, 1.0, 3.0])),),
        environment=Environment(radiance=torch.rand(4, 8, 3, generator=random)),
    )
    gloss = Gloss(color=ones, exponent=torch.full((1, 3, 4), 9.0), relative_to=ones)
    for kind, factor in (("full", 2.0), ("scaled", 1.0)):
        found = []
        for step in (0.02, 0.04):
            options = EnhanceOptions(magnitude="sum", terms=terms, curvature=kind, step=step)
            full = normals if kind == "full" else None
            found.append(shading_gradient(surface, curvature, lit, options, gloss=gloss, normals=full)[0])
        assert float(found[0].abs().max()) > 0
        torch.testing.assert_close(found[1], factor * found[0])


@pytest.mark.parametrize("terms", [("geometry", "projection", "visibility"), ("geometry", "projection", "specular")])
@pytest.mark.parametrize("kind", ["scaled", "full"])
def test_every_term_runs_on_a_scene(terms: tuple[str, ...], kind: str) -> None:
    scene = tr.load("nest", size=3000)
    options = EnhanceOptions(terms=terms, curvature=kind, magnitude="sum")
    made = tr.render(scene, width=48, height=36, options=RenderOptions(enhance=options))
    usual = replace(options, terms=("geometry", "projection"))
    base = tr.render(scene, width=48, height=36, options=RenderOptions(enhance=usual))
    assert bool(torch.isfinite(made.radiance).all())
    assert float((made.radiance - base.radiance).abs().max()) > 0, "the term does something"


def test_full_curvature_follows_the_shading_itself(bumps: Bumps) -> None:
    """Against differences of the shaded picture, where the surface is smooth and faces the eye."""
    from torchrender.effects.enhancement.gradient import mesh_normal_gradient, shading_gradient

    lamp = PointLight(position=torch.tensor([-3.0, -3.0, 0.0]), intensity=torch.full((3,), torch.pi))
    normals = mesh_normal_gradient(bumps.surface, bumps.scene.geometry, bumps.seen.triangle, bumps.seen.barycentric)
    options = EnhanceOptions(curvature="full", magnitude="sum", step=1.0)
    gradient, _ = shading_gradient(bumps.surface, bumps.curvature, Lighting((lamp,)), options, normals=normals)
    away = lamp.position.double() - bumps.seen.position
    plain = ((away * bumps.seen.normal).sum(-1) / away.norm(dim=-1)).clamp_min(0)[0]
    square = away.square().sum(-1)[0]
    wanted = (plain[:, 2:] - plain[:, :-2])[1:-1] / 2 * 396
    found = (gradient[0, ..., 0, 0] * square)[1:-1, 1:-1]
    facing = (bumps.seen.normal[0, ..., 2] < -0.7)[1:-1, 1:-1] & (plain[1:-1, 1:-1] > 0.1)
    error = (found - wanted)[facing].abs()
    assert float(error.median()) < 0.05 * float(wanted[facing].abs().mean())


def test_any_picture_with_depth_is_enhanced() -> None:
    scene = tr.load("nest", size=3000)
    image = tr.render(scene, width=64, height=48)
    depth = image.gbuffer.depth
    made = enhance_picture(image.cameras, image.radiance, depth)
    assert made.shape == image.radiance.shape and bool(torch.isfinite(made).all())
    empty = ~torch.isfinite(depth)
    assert torch.equal(made[empty], image.radiance[empty])
    assert float((made - 0.8 * image.radiance)[~empty].abs().max()) > 1e-3
    none = Cameras(torch.zeros(0, 4, 4), torch.zeros(0, 3, 3), 8, 8, torch.zeros(0), torch.zeros(0))
    assert enhance_picture(none, torch.zeros(0, 8, 8, 3), torch.zeros(0, 8, 8)).shape == (0, 8, 8, 3)


def test_lights_and_strength_can_be_learnt() -> None:
    scene = tr.load("nest", size=3000)
    seen = rasterize(scene, scene.camera(width=24, height=16))
    surface = SurfaceImage.of(seen)
    bent = surface.curvature().requires_grad_()
    power = torch.ones(3, requires_grad=True)
    lamp = PointLight(position=torch.tensor([0.0, 3.0, 3.0]), intensity=power)
    enhancement(surface, bent, Lighting((lamp,))).square().sum().backward()
    assert bent.grad is not None and bool(torch.isfinite(bent.grad).all()) and bool(bent.grad.any())
    assert power.grad is not None and bool((power.grad > 0).any())


def test_bad_wishes_are_named() -> None:
    for wish, text in (
        ({"gradient_weight": 3.0}, "gradient_weight"),
        ({"grazing": 0.5}, "grazing"),
        ({"magnitude": "l3"}, "magnitude"),
        ({"terms": ("shape",)}, "terms"),
        ({"limit": -1.0}, "limit"),
        ({"curvature": "full"}, "signed_l2"),
    ):
        with pytest.raises(OptionError, match=text):
            EnhanceOptions(**wish)  # type: ignore[arg-type]
    camera = Cameras.look_at(torch.zeros(1, 3), torch.ones(1, 3), width=4, height=4)
    with pytest.raises(InputError, match="radiance must be finite"):
        enhance_picture(camera, torch.full((1, 4, 4, 3), math.nan), torch.ones(1, 4, 4))
    with pytest.raises(InputError, match="depth must have shape"):
        enhance_picture(camera, torch.zeros(1, 4, 4, 3), torch.zeros(1, 4, 5))
