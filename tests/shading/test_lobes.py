"""Laws of the material model: white furnaces, closed forms under a lamp, occlusion, coat, unlit, normal maps."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
import torch
from torch import Tensor

from shading_scenes import bumps
from torchrender.errors import OptionError
from torchrender.numerics.split_sum import directional_albedo
from torchrender.raster import rasterize
from torchrender.scene.camera import Cameras
from torchrender.scene.environment import Environment
from torchrender.scene.light import DirectionalLight, Light, PointLight, RectLight
from torchrender.scene.material import Material
from torchrender.scene.mesh import Mesh
from torchrender.scene.model import Scene
from torchrender.scene.shapes import sphere
from torchrender.shade import AmbientReach, sent_light, shade

WHITE = torch.ones(3)


def ball(material: Material, *lights: Light, environment: Environment | None = None, ambient: float = 0.0) -> Scene:
    made = sphere(segments=96)
    mesh = replace(made, normals=torch.nn.functional.normalize(made.vertices, dim=-1))
    return Scene(
        meshes=(mesh,), materials=(material,), lights=lights, environment=environment, ambient=torch.full((3,), ambient)
    )


def look(size: int = 48) -> Cameras:
    return Cameras.look_at([0.0, 0.0, 6.0], [0.0, 0.0, 0.0], width=size, height=size, fov_deg=20.0)


def seen(scene: Scene, kernel: bool, **rest: object) -> tuple[Tensor, Tensor]:
    """Radiance (N,3) and cosine to the eye (N,) of the covered pixels."""
    gbuffer = rasterize(scene, look())
    samples = gbuffer if kernel else replace(gbuffer)  # a copy has no source: torch
    image = shade(scene, samples, **rest)  # type: ignore[arg-type]
    chosen = gbuffer.covered
    toward = torch.nn.functional.normalize(gbuffer.cameras.eye[0] - gbuffer.position, dim=-1).float()
    return image[chosen], (gbuffer.normal * toward).sum(-1)[chosen]


@pytest.mark.parametrize("kernel", [True, False])
@pytest.mark.parametrize("roughness", [0.0, 0.1, 0.3, 0.55, 0.8, 1.0])
def test_a_white_metal_vanishes_in_a_white_furnace(roughness: float, kernel: bool) -> None:
    metal = Material(metallic=1.0, roughness=roughness, diffuse=WHITE)
    image, _ = seen(ball(metal, ambient=1.0), kernel)
    assert float(image.min()) > 0.99 and float(image.max()) <= 1.0 + 1e-5
    image, _ = seen(ball(metal, environment=Environment.constant(WHITE)), kernel)
    assert float(image.min()) > 0.99 and float(image.max()) <= 1.005


@pytest.mark.parametrize("roughness", [0.0, 0.3, 0.7, 1.0])
@pytest.mark.parametrize("metallic", [0.0, 0.35, 0.7])
def test_nothing_sends_back_more_than_it_gets(metallic: float, roughness: float) -> None:
    for more in ({}, {"clearcoat": 1.0}, {"ior": 3.0}, {"sheen_color": WHITE, "sheen_roughness": 0.5}):
        material = Material(metallic=metallic, roughness=roughness, diffuse=WHITE, **more)
        image, _ = seen(ball(material, ambient=1.0), True)
        assert float(image.max()) <= 1.0 + 1e-3 and float(image.min()) > 0.8, more


@pytest.mark.parametrize("roughness", [0.5, 0.75, 1.0])
def test_a_metal_under_parallel_light_sends_back_all_of_it_in_all(roughness: float) -> None:
    """By reciprocity the mirrored share is the integral over lights; the sum over many suns stands for it."""
    metal = Material(metallic=1.0, roughness=roughness, diffuse=WHITE)
    steps = 48
    t = (torch.arange(steps) + 0.5) / steps
    z, turn = torch.meshgrid(t, 2 * math.pi * t, indexing="ij")
    z, turn = z.reshape(-1), turn.reshape(-1)
    r = (1 - z * z).sqrt()
    suns = tuple(
        DirectionalLight(direction=-d, irradiance=WHITE * 2 * math.pi / len(z))
        for d in torch.stack([r * torch.cos(turn), r * torch.sin(turn), z], dim=-1)
    )
    flat = Mesh(
        vertices=torch.tensor([[-9.0, -9, 0], [9, -9, 0], [9, 9, 0], [-9, 9, 0]]),
        faces=torch.tensor([[0, 1, 2], [0, 2, 3]]),
    )
    scene = Scene(meshes=(flat,), materials=(metal,), lights=suns)
    for slope in (0.0, 1.0):
        camera = Cameras.look_at([6 * slope, 0.0, 6.0], [0.0, 0.0, 0.0], width=3, height=3, fov_deg=0.2, up=(0, 1, 0))
        assert float(shade(scene, rasterize(scene, camera)).mean()) == pytest.approx(1.0, abs=0.01)


@pytest.mark.parametrize(("roughness", "metallic"), [(0.25, 1.0), (0.5, 1.0), (0.2, 0.0), (0.5, 0.0)])
def test_a_lamp_on_a_ball_is_the_closed_form(roughness: float, metallic: float) -> None:
    """Walter's GGX with Smith's height-correlated term in float64, written out a second time."""
    lamp = PointLight(position=torch.tensor([3.0, 4.0, 5.0]), intensity=torch.tensor([40.0, 50.0, 60.0]))
    base = torch.tensor([0.9, 0.6, 0.3]) if metallic else torch.zeros(3)
    scene = ball(Material(metallic=metallic, roughness=roughness, diffuse=base), lamp)
    gbuffer = rasterize(scene, look())
    found = shade(scene, gbuffer)[gbuffer.covered].double()
    p, n = gbuffer.position[gbuffer.covered], gbuffer.normal[gbuffer.covered].double()
    to_lamp = lamp.position - p
    light, eye = (torch.nn.functional.normalize(v, dim=-1) for v in (to_lamp, gbuffer.cameras.eye[0] - p))
    half = torch.nn.functional.normalize(light + eye, dim=-1)
    nl, nv, nh, vh = ((a * b).sum(-1).clamp_min(1e-9) for a, b in ((n, light), (n, eye), (n, half), (eye, half)))
    a2 = roughness**4
    d = a2 / (math.pi * (nh * nh * (a2 - 1) + 1) ** 2)
    smith = [(-1 + (1 + a2 * (1 / c**2 - 1)).sqrt()) / 2 for c in (nl, nv)]
    f0 = base.double() if metallic else torch.full((3,), 0.04, dtype=torch.float64)
    fresnel = f0 + (1 - f0) * ((1 - vh) ** 5)[:, None]
    if metallic == 0.0:
        within = (1 - (1 - vh * vh) / 1.5**2).sqrt()
        across, along = (vh - 1.5 * within) / (vh + 1.5 * within), (1.5 * vh - within) / (1.5 * vh + within)
        fresnel = ((across.square() + along.square()) / 2)[:, None]
    once = fresnel * (d / (1 + smith[0] + smith[1]) / (4 * nl * nv) * nl / to_lamp.square().sum(-1))[:, None]
    a, b, _, _ = directional_albedo(nv.float(), torch.full_like(nv, roughness).float())
    again = 1 + f0 * (1 / (a + b).double() - 1)[:, None]
    wanted = torch.where(((n * light).sum(-1) > 0)[:, None], once * again * lamp.intensity.double(), 0.0)
    assert float(found.sum() / wanted.sum()) == pytest.approx(1.0, abs=2e-3)
    assert float((found - wanted).square().mean().sqrt()) < 0.003 * float(wanted.max())  # 50 dB


def test_a_black_rough_plastic_still_has_a_highlight_and_shows_the_sky() -> None:
    plastic = Material(metallic=0.0, roughness=0.3, diffuse=torch.zeros(3))
    image, cosine = seen(ball(plastic, environment=Environment.constant(WHITE)), True)
    assert float(image[cosine > 0.95].mean()) == pytest.approx(0.04, abs=0.004)
    assert float(image[cosine < 0.2].mean()) > 0.2


@pytest.mark.parametrize("kernel", [True, False])
@pytest.mark.parametrize("ior", [1.0, 1.33, 1.5, 2.0])
def test_a_smooth_dielectric_mirrors_fresnels_share(ior: float, kernel: bool) -> None:
    """And its coat that of an index of 1.5, over a black ground."""
    glass = Material(metallic=0.0, roughness=0.0, diffuse=torch.zeros(3), ior=ior)
    coated = replace(glass, ior=1.0, clearcoat=1.0, clearcoat_roughness=0.0)
    for material, index in ((glass, ior), (coated, 1.5)):
        image, cosine = seen(ball(material, environment=Environment.constant(WHITE)), kernel)
        c = cosine.double()
        within = (1 - (1 - c * c) / index**2).clamp_min(0).sqrt()
        across, along = (c - index * within) / (c + index * within), (index * c - within) / (index * c + within)
        wanted = (across.square() + along.square()) / 2
        clear = c > 0.05  # the table is coarse next to the silhouette
        assert float((image[clear, 0] - wanted[clear]).abs().max()) < 0.006
        assert float(image[:, 0].mean()) == pytest.approx(float(wanted.mean()), rel=0.01, abs=1e-6)


def test_metals_are_tinted_by_their_texture() -> None:
    red = torch.tensor([1.0, 0.0, 0.0]).expand(4, 4, 3).contiguous()
    mesh = Mesh(
        vertices=torch.tensor([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]),
        faces=torch.tensor([[0, 1, 2], [0, 2, 3]]),
        uv=torch.tensor([[0.0, 0], [1, 0], [1, 1], [0, 1]]),
    )
    metal = Material(metallic=1.0, roughness=1.0, diffuse=WHITE, diffuse_texture=red)
    scene = Scene(meshes=(mesh,), materials=(metal,), environment=Environment.constant(WHITE))
    camera = Cameras.look_at([0.0, 0.0, 3.0], [0.0, 0.0, 0.0], width=4, height=4, fov_deg=5.0)
    image = shade(scene, rasterize(scene, camera))
    assert float(image[..., 0].min()) > 0.99 and float(image[..., 1:].max()) < 0.02


def test_occlusion_and_ambient_visibility_darken_ambient_light_alone() -> None:
    dark = Material(metallic=0.0, roughness=0.9, occlusion_texture=torch.zeros(2, 2, 1))
    lit = replace(dark, occlusion_texture=None)
    sun = DirectionalLight(direction=torch.tensor([0.0, 0.0, -1.0]))
    for kernel in (True, False):
        assert float(seen(ball(dark, ambient=1.0), kernel)[0].max()) < 1e-6
        alone, under = (seen(ball(m, sun), kernel)[0] for m in (lit, dark))
        torch.testing.assert_close(alone, under)
        closed = AmbientReach(torch.zeros(1, 48, 48))
        assert (
            float(seen(ball(lit, ambient=1.0, environment=Environment.constant(WHITE)), kernel, around=closed)[0].max())
            < 1e-6
        )


def test_unlit_shows_its_colour_in_the_dark_and_in_the_sun() -> None:
    color = torch.tensor([0.5, 0.25, 0.1])
    sun = DirectionalLight(direction=torch.tensor([0.0, 0.0, -1.0]), irradiance=WHITE * 9)
    for lights in ((), (sun,)):
        image, _ = seen(ball(Material(unlit=True, diffuse=color), *lights, ambient=3.0), True)
        torch.testing.assert_close(image, color.expand_as(image))


def test_a_flat_normal_map_changes_nothing_and_a_tilted_one_tilts() -> None:
    mesh = Mesh(
        vertices=torch.tensor([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]),
        faces=torch.tensor([[0, 1, 2], [0, 2, 3]]),
        uv=torch.tensor([[0.0, 0], [1, 0], [1, 1], [0, 1]]),
    )
    sun = DirectionalLight(direction=torch.tensor([-1.0, 0.0, -1.0]))
    camera = Cameras.look_at([0.0, 0.0, 3.0], [0.0, 0.0, 0.0], width=4, height=4, fov_deg=5.0)

    def mean(normal: tuple[float, float, float] | None, **rest: float) -> float:
        told = None if normal is None else (torch.tensor(normal) * 0.5 + 0.5).expand(2, 2, 3).contiguous()
        material = Material(diffuse=WHITE, normal_texture=told, **rest)
        scene = Scene(meshes=(mesh,), materials=(material,), lights=(sun,))
        return float(shade(scene, rasterize(scene, camera)).mean())

    flat = 1 / math.pi / math.sqrt(2)
    assert mean(None) == pytest.approx(flat, rel=1e-5) and mean((0.0, 0.0, 1.0)) == pytest.approx(flat, rel=1e-5)
    s = math.sqrt(0.5)
    assert mean((s, 0.0, s)) == pytest.approx(1 / math.pi, rel=1e-4)  # towards u, where the sun stands
    assert mean((-s, 0.0, s)) < 0.01
    assert mean((s, 0.0, s), normal_scale=0.0) == pytest.approx(flat, rel=1e-4)


@pytest.mark.parametrize("kernel", [True, False])
def test_normal_maps_turn_the_sky_s_light_where_ambient_visibility_is_known(kernel: bool) -> None:
    """An open board: its mean open direction is its own normal, and a map counts as without ambient visibility."""
    mesh = Mesh(
        vertices=torch.tensor([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]),
        faces=torch.tensor([[0, 1, 2], [0, 2, 3]]),
        uv=torch.tensor([[0.0, 0], [1, 0], [1, 1], [0, 1]]),
    )
    rows = torch.linspace(2.0, 0.0, 32)[:, None, None].expand(32, 64, 3).contiguous()
    camera = Cameras.look_at([0.0, 0.0, 3.0], [0.0, 0.0, 0.0], width=4, height=4, fov_deg=5.0)
    told = (torch.tensor([0.0, math.sqrt(0.5), math.sqrt(0.5)]) * 0.5 + 0.5).expand(2, 2, 3).contiguous()
    found = {}
    for name, texture in (("flat", None), ("up", told)):
        for material in (
            Material(diffuse=WHITE, normal_texture=texture),
            Material(metallic=0.0, roughness=1.0, diffuse=WHITE, normal_texture=texture),
        ):
            scene = Scene(meshes=(mesh,), materials=(material,), environment=Environment(radiance=rows))
            gbuffer = rasterize(scene, camera)
            samples = gbuffer if kernel else replace(gbuffer)
            reach = AmbientReach(torch.ones(1, 4, 4), gbuffer.normal)
            alone, known = shade(scene, samples), shade(scene, samples, around=reach)
            torch.testing.assert_close(alone, known, rtol=1e-4, atol=1e-5)
            found[name, material.is_physical] = float(known.mean())
    assert all(found["up", kind] > 1.2 * found["flat", kind] for kind in (False, True))


def test_normal_maps_never_turn_the_surface_from_the_eye() -> None:
    scene = ball(
        Material(metallic=1.0, roughness=0.2, diffuse=WHITE, normal_texture=bumps(8, 8, 0), normal_scale=50.0),
        environment=Environment.constant(WHITE),
    )
    for kernel in (True, False):
        image, _ = seen(scene, kernel)
        assert float(image.min()) > 0.98 and float(image.max()) < 1.01


def test_highlights_stay_where_a_mirror_shows_its_picture() -> None:
    """Radiance - replaced is what lights alone send: the mirrored picture takes nothing of a highlight."""
    lamp = PointLight(position=torch.tensor([3.0, 4.0, 5.0]), intensity=WHITE * 50)
    for material in (
        Material(metallic=1.0, roughness=0.3, diffuse=torch.tensor([0.9, 0.6, 0.3])),
        Material(specular=0.8, diffuse=torch.zeros(3)),
    ):
        around = Environment.constant(WHITE * 0.5)
        scene, alone = ball(material, lamp, environment=around), ball(material, lamp)
        gbuffer = rasterize(scene, look())
        light = sent_light(scene, gbuffer)
        left = (light.radiance - light.share.replaced)[gbuffer.covered]
        dark = shade(alone, rasterize(alone, look()))[gbuffer.covered]
        torch.testing.assert_close(left, dark, atol=2e-6, rtol=1e-4)
        assert float(light.share.mirrored[gbuffer.covered].max()) <= 1.0 + 1e-5


def test_a_panel_lights_metals_and_plastics() -> None:
    panel = RectLight(
        corner=torch.tensor([-1.0, 3.0, 2.0]), edge_u=torch.tensor([2.0, 0, 0]), edge_v=torch.tensor([0, -0.5, 2.0])
    )
    for metallic in (0.0, 1.0):
        image, _ = seen(ball(Material(metallic=metallic, roughness=0.4), panel), True)
        assert float(image.max()) > 0.01 and bool(torch.isfinite(image).all())


def test_a_sum_of_lights_is_linear_for_metallic_roughness() -> None:
    suns = [DirectionalLight(direction=torch.tensor([x, -1.0, -1.0])) for x in (-0.5, 0.2, 0.8)]
    material = Material(metallic=0.4, roughness=0.4, clearcoat=0.5, sheen_color=WHITE * 0.3, sheen_roughness=0.6)
    alone = sum(seen(ball(material, sun), True)[0] for sun in suns)
    torch.testing.assert_close(seen(ball(material, *suns), True)[0], alone, rtol=1e-4, atol=1e-6)


def test_colours_of_metals_can_be_derived() -> None:
    base = torch.tensor([0.5, 0.4, 0.3], requires_grad=True)
    texture = torch.rand(4, 4, 3, generator=torch.Generator().manual_seed(0)).requires_grad_()
    material = Material(metallic=0.6, roughness=0.5, diffuse=base, diffuse_texture=texture)
    sun = DirectionalLight(direction=torch.tensor([-0.5, -1.0, -1.0]))
    image, _ = seen(ball(material, sun, ambient=0.2), True)
    image.sum().backward()
    assert base.grad is not None and float(base.grad.min()) > 0
    assert texture.grad is not None and bool(torch.isfinite(texture.grad).all())


def test_metallic_roughness_numbers_need_metallic() -> None:
    with pytest.raises(OptionError, match="needs metallic"):
        Material(clearcoat=0.5)


@pytest.mark.parametrize(
    ("phong", "instead"),
    [({"specular": 0.5}, "specular_weight"), ({"gloss": 0.2}, "roughness"), ({"shininess": 5.0}, "roughness")],
)
def test_phong_numbers_beside_metallic_are_refused(phong: dict[str, float], instead: str) -> None:
    with pytest.raises(OptionError, match=f"{next(iter(phong))} is of Phong materials.*give {instead}"):
        Material(metallic=1.0, **phong)
