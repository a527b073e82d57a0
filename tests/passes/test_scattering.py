"""The pass ``scattering``: when it applies, what it does to surfaces, mirrors and streams."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
import torch

import torchrender as tr
from media_scenes import LAMP, SUN, eye, fog, t1
from torchrender.effects.media.options import ScatterOptions
from torchrender.effects.shadows.options import ShadowOptions
from torchrender.passes.light.shadow_map import SCENE_SHADOW_MAP
from torchrender.pipeline.history import RenderHistory
from torchrender.pipeline.options import RenderOptions
from torchrender.scene.camera import Cameras
from torchrender.scene.material import Material
from torchrender.scene.model import Scene

SMALL = eye(60, 45)
ALL = ScatterOptions(block=1)


def reason(scene: Scene, camera: Cameras = SMALL, options: RenderOptions | None = None) -> str:
    row = tr.plan(scene, camera, options=options or RenderOptions()).row("scattering")
    return f"{'+' if row.runs else '-'} {row.reason}"


def test_it_says_why_it_does_not_run() -> None:
    scene = t1()
    assert reason(scene) == "+ 1 medium in view"
    assert reason(replace(scene, media=(fog(), fog()))) == "+ 2 media in view"
    assert reason(replace(scene, media=())) == "- no medium"
    assert reason(replace(scene, media=(fog(density=0.0),))) == "- every medium is empty"
    assert reason(scene, options=RenderOptions(media=False)) == "- media are turned off"
    behind = fog(low=torch.tensor([-1.0, -1.0, 3.0]), high=torch.tensor([1.0, 1.0, 4.0]))
    dark = replace(scene, media=(behind,), lights=(replace(LAMP, position=torch.tensor([0.0, 0.0, 2.0])),))
    assert reason(dark).startswith("- no medium in view: behind the camera")
    above = fog(low=torch.tensor([-4.0, 20.0, -8.0]), high=torch.tensor([4.0, 21.0, 0.0]))
    overhead = replace(SUN, direction=torch.tensor([0.0, -1.0, 0.0]))
    assert reason(replace(scene, media=(above,), lights=(overhead,))) == "+ a medium may shadow what is in view"


def test_clear_air_is_the_picture_without_media() -> None:
    scene = t1()
    clear = tr.render(replace(scene, media=()), SMALL).radiance
    assert torch.equal(tr.render(scene, SMALL, options=RenderOptions(media=False)).radiance, clear)
    empty = replace(scene, media=(fog(scattering=torch.zeros(3), absorption=torch.zeros(3)),))
    assert torch.equal(tr.render(empty, SMALL).radiance, clear)
    assert not torch.equal(tr.render(scene, SMALL).radiance, clear)


@pytest.mark.parametrize("outer_deg", [0.5, 0.05, 0.01])
def test_the_light_of_a_beam_in_thin_air_is_that_of_its_cone(outer_deg: float) -> None:
    """Seen from the side, 5 units below the lamp: the cone's share over its disc, of which cosines have no digits."""
    beam = tr.SpotLight(
        position=[0, 5, 0], direction=[0, -1, 0], intensity=outer_deg**-2.0, inner_deg=0.0, outer_deg=outer_deg
    )
    air = fog(low=[-50, -50, -50], high=[50, 50, 50], scattering=1e-4, absorption=0.0)
    width = 12.0 * math.tan(math.radians(outer_deg))
    camera = Cameras.orthographic_view([0, 0, 10], [0, 0, 0], width=41, height=3, view_height=3 / 41 * width)
    image = tr.render(Scene(lights=(beam,), media=(air,)), camera, options=RenderOptions(scattering=ALL))
    # The mean over a disc of the square of 1 - (r / R)^2 is 1/3; E = I / 25, and 1 / 4 pi of it goes to the eye.
    disc = math.pi * (5 * math.tan(math.radians(outer_deg))) ** 2
    wanted = 1e-4 / (4 * math.pi) * outer_deg**-2.0 / 25 * disc / 3
    found = float(image.radiance[0, 1, :, 0].double().sum()) * width / 41
    assert found == pytest.approx(wanted, rel=0.02)


@pytest.mark.parametrize("way", ["traced", "clustered"])
def test_mirrors_in_a_medium_show_what_it_leaves_and_not_less(way: str) -> None:
    """A periscope of two mirrors under light from everywhere, which the medium keeps from them, and they replace.

    All of the way counts: to the first mirror, from there to the second, and on to what that shows.
    """

    def square(middle: tuple[float, ...], up: tuple[float, ...], material: int) -> tr.Mesh:
        along, up, middle = (torch.tensor(v, dtype=torch.float64) for v in ((1.0, 0, 0), up, middle))
        corners = [middle + x * along + y * up for x, y in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
        return tr.Mesh(vertices=torch.stack(corners), faces=[[0, 1, 2], [0, 2, 3]], material=material)

    mirror = Material(metallic=1.0, roughness=0.0, diffuse=[1.0, 1.0, 1.0])
    shining = Material(diffuse=[0.0, 0.0, 0.0], emission=[1.0, 0.5, 0.25])
    scene = Scene(
        meshes=[square((0, 0, 0), (0, 1, -1), 0), square((0, 4, 0), (0, 1, -1), 0), square((0, 4, -6), (0, 1, 0), 1)],
        materials=[mirror, shining],
        ambient=torch.full((3,), 0.35),
        media=[fog(low=[-50] * 3, high=[50] * 3, scattering=0.0, absorption=0.1)],
    )
    camera = Cameras.look_at([0, 0, 5], [0, 0, 0], width=5, height=5, fov_deg=1.0)
    image = tr.render(scene, camera, options=RenderOptions(reflections=way))
    wanted = math.exp(-0.1 * (5 + 4 + 6)) * torch.tensor([1.0, 0.5, 0.25])
    torch.testing.assert_close(image.radiance[0, 2, 2], wanted, rtol=2e-3, atol=1e-5)


def test_what_mirrors_of_phong_keep_of_lamps_is_darkened_by_the_medium_once() -> None:
    """A mirror that shows nothing: all that is left is what the lamp gives it."""
    scene = Scene(
        meshes=[tr.Mesh.plane(2.0)],
        materials=[Material(diffuse=[0.6, 0.6, 0.6], specular=0.5)],
        lights=[tr.PointLight(position=[0, 4, 0], intensity=10)],
    )
    camera = Cameras.look_at([1, 3, 0], [0, 0, 0], width=5, height=5, fov_deg=1.0)
    air = fog(low=[-50] * 3, high=[50] * 3, scattering=0.0, absorption=0.1)
    clear, image = (tr.render(replace(scene, media=media), camera).radiance[0, 2, 2] for media in ((), (air,)))
    assert float(clear.min()) > 0.01
    torch.testing.assert_close(image, math.exp(-0.1 * (4 + 10**0.5)) * clear, rtol=5e-3, atol=1e-5)


@pytest.mark.parametrize("half", [1e7, 1e12])
def test_air_without_end_is_air_that_ends_where_nothing_is_seen_any_more(half: float) -> None:
    lamp = tr.PointLight(position=[1, 3, 2], intensity=10)
    scene = Scene(meshes=[tr.Mesh.plane(6), tr.Mesh.box(1.0)], lights=[lamp])
    camera = Cameras.look_at([2, 1.5, 3], [0, 0.3, 0], width=32, height=24)
    for way in ("walk", "slices"):
        options = RenderOptions(scattering=ScatterOptions(way=way, block=1))
        near, far = (
            tr.render(replace(scene, media=(fog(low=[-h] * 3, high=[h] * 3),)), camera, options=options).radiance
            for h in (300.0, half)
        )
        assert float((near - far).abs().mean()) < 5e-3 * float(near.mean()), way


def test_surfaces_are_lit_and_seen_through_the_medium() -> None:
    """Absorption alone: direct light loses on both ways, exactly."""
    medium = fog(scattering=torch.zeros(3), absorption=torch.tensor([0.1, 0.2, 0.4]))
    scene = replace(t1(medium=medium), ambient=torch.zeros(3))
    image = tr.render(scene, SMALL, options=RenderOptions(scattering=ALL))
    clear = tr.render(replace(scene, media=()), SMALL)
    seen = image.gbuffer
    to_light = (LAMP.position.double() - seen.position).norm(dim=-1, keepdim=True)
    to_eye = seen.position.norm(dim=-1, keepdim=True)
    wanted = clear.radiance * torch.exp(-(to_light + to_eye) * medium.absorption)
    inside = seen.covered & (seen.position[..., 2] > -7.99) & (seen.position[..., 1] > -1.0001)
    torch.testing.assert_close(image.radiance[inside], wanted[inside].float(), rtol=2e-3, atol=1e-5)


def test_without_the_air_before_the_eye_only_other_ways_dim_the_light() -> None:
    scene = mirror_scene(fog(scattering=torch.full((3,), 0.1), absorption=torch.full((3,), 0.1)))
    seen = tr.render(scene, SMALL, options=RenderOptions(scattering=ALL, buffers=("scattering",)))
    clear = tr.render(replace(scene, media=()), SMALL).radiance
    near = tr.render(scene, SMALL, options=RenderOptions(scattering=replace(ALL, air=False))).radiance
    layer = seen.buffers["scattering"].layer
    assert layer is not None
    torch.testing.assert_close(layer.scattered + layer.transmittance * near, seen.radiance, rtol=1e-5, atol=1e-6)
    assert float((clear - near).mean()) > 0.05 * float(clear.mean()), "lamps and mirrors are seen through it"


def test_without_the_air_before_the_eye_panes_are_as_clear_as_what_lies_behind() -> None:
    glass = Material(name="glass", diffuse=[0.2, 0.4, 0.6], opacity=0.5, blend=True)
    room = t1(LAMP)
    panes = (*room.meshes, tr.Mesh.box([1.0, 1.0, 0.02], [0.0, 0.0, -2.0], material=len(room.materials)))
    clear = replace(room, meshes=panes, materials=(*room.materials, glass), media=())
    options = RenderOptions(scattering=replace(ALL, air=False, surfaces=False))
    near = tr.render(replace(clear, media=(fog(),)), SMALL, options=options).radiance
    torch.testing.assert_close(near, tr.render(clear, SMALL).radiance, rtol=1e-5, atol=1e-6)


def mirror_scene(medium) -> Scene:
    """A mirror on the left shows the wall behind the eye."""
    scene = t1(LAMP, medium=medium)
    mirror = Material(name="mirror", diffuse=torch.zeros(3), specular=1.0, shininess=1000.0)
    meshes = list(scene.meshes)
    meshes[1] = replace(meshes[1], material=1)
    return replace(scene, meshes=tuple(meshes), materials=(*scene.materials, mirror), ambient=torch.ones(3))


def test_a_mirror_in_fog_shows_what_both_ways_leave() -> None:
    low, high = torch.full((3,), -30.0), torch.full((3,), 30.0)
    medium = fog(low=low, high=high, scattering=torch.zeros(3), absorption=torch.full((3,), 0.2))
    scene = replace(mirror_scene(medium), lights=(replace(LAMP, intensity=torch.zeros(3)),))
    ways = replace(ALL, surfaces=False)  # to the eye alone: light from everywhere arrives undimmed
    options = RenderOptions(reflections="traced", scattering=ways, buffers=("reflections",))
    image = tr.render(scene, SMALL, options=options)
    clear = tr.render(replace(scene, media=()), SMALL, options=options)
    layer = clear.buffers["reflections"]
    chosen = (layer.state != 0) & torch.isfinite(layer.distance)
    assert int(chosen.sum()) > 20
    way = image.gbuffer.position.norm(dim=-1)[chosen] + layer.distance[chosen].double()
    wanted = clear.radiance[chosen] * torch.exp(-0.2 * way)[:, None]
    torch.testing.assert_close(image.radiance[chosen], wanted.float(), rtol=1e-2, atol=1e-4)


def test_settings_go_from_fast_to_exact_and_errors_fall() -> None:
    scene = t1(SUN, grille=True)
    from torchrender.passes.table import find_pass

    step = find_pass("scattering")
    wanted = tr.render(scene, SMALL, options=step.settings.named("walked").applied(RenderOptions())).radiance
    errors = []
    for name in ("3 x 3", "2 x 2", "all", "walked"):
        made = tr.render(scene, SMALL, options=step.settings.named(name).applied(RenderOptions()))
        assert made.plan is not None and made.plan.row("scattering").setting == name
        errors.append(float((made.radiance - wanted).abs().mean()))
    assert errors[-1] == 0.0 and max(errors) < 0.02


def test_the_reference_casts_rays() -> None:
    scene = t1(LAMP, grille=True)
    way = ScatterOptions(way="march", shadows="rays", block=1, steps=128)
    rays = tr.render(scene, SMALL, options=RenderOptions(scattering=way)).radiance
    maps = tr.render(scene, SMALL, options=RenderOptions(scattering=ALL)).radiance
    assert float((rays - maps).abs().mean() / rays.mean()) < 0.02


def test_any_edit_costs_no_preparation() -> None:
    """What lasts is what does without media: maps and rays, nothing of the media themselves."""
    scene = t1()
    first = tr.render(scene, SMALL, history=RenderHistory())
    assert first.history is not None
    other = replace(scene, media=(fog(asymmetry=0.5),))
    edited = tr.render(other, SMALL, history=first.history)
    assert torch.equal(edited.radiance, tr.render(other, SMALL).radiance)
    assert first.history.get(_shadow_map(), RenderOptions()) is not None
    assert "scattering" not in first.history.kept


def _shadow_map():
    from torchrender.passes.light.shadow_map import SHADOW_MAP

    return SHADOW_MAP


def test_samples_of_streams_get_their_own_haze() -> None:
    from torchrender_service.renderers.streaming.layers import cameras_around, extra_layers

    scene = t1(LAMP)
    image = tr.render(scene, SMALL, history=RenderHistory())
    assert image.history is not None and image.plan is not None
    around = cameras_around(SMALL, image.visibility.depth[0], 1)
    layer = extra_layers(scene, image.visibility, around, image.plan.options, image.history)[0]
    direct = tr.render(scene, around[0], options=RenderOptions(scattering=ALL)).radiance[0]
    known = layer.known & torch.isfinite(layer.depth)
    known[:2], known[-2:], known[:, :2], known[:, -2:] = False, False, False, False
    assert int(known.sum()) > 10
    difference = (layer.radiance[known] - direct[known]).abs().mean() / direct[known].mean()
    assert float(difference) < 0.2  # the layer's rim continues what lies behind


@pytest.mark.parametrize("supersample", [0.5, 2.0])
def test_fewer_and_more_pixels(supersample: float) -> None:
    made = tr.render(t1(), SMALL, options=RenderOptions(supersample=supersample)).radiance
    wanted = tr.render(t1(), SMALL).radiance
    assert float((made - wanted).abs().mean() / wanted.mean()) < 0.1


def test_a_sun_in_media_has_a_finer_image_than_shadows_need() -> None:
    """And a lamp has not."""
    options = RenderOptions(shadow=ShadowOptions(size=128), scattering=ScatterOptions(sun_texels=256))
    history = tr.render(t1(SUN, LAMP), SMALL, options=options, history=RenderHistory()).history
    assert history is not None
    maps = history.get(SCENE_SHADOW_MAP)
    assert maps is not None
    assert [one.depth.shape[-1] for one in maps if one is not None] == [256, 128]


def lit_from_everywhere(absorption: float, scattering: float, *, environment: bool) -> torch.Tensor:
    """A grey floor far inside a wide slab of a medium that ends 2 above it, seen from its upper side."""
    wide = {"low": [-1e4, -1, -1e4], "high": [1e4, 2, 1e4]}
    sky = tr.Environment.constant([1, 1, 1]) if environment else None
    scene = Scene(
        meshes=(tr.Mesh.plane(1.0),),
        materials=(Material(diffuse=torch.full((3,), 0.5)),),
        ambient=torch.zeros(3) if environment else torch.ones(3),
        environment=sky,
        media=(tr.Medium(absorption=absorption, scattering=scattering, **wide),),
    )
    above = Cameras.look_at([0.001, 2, 0], [0, 0, 0], width=17, height=17, fov_deg=20, up=[0, 0, -1])
    options = RenderOptions(scattering=replace(ALL, environment=scattering > 0))
    return tr.render(scene, above, options=options).radiance[0, 8, 8]


@pytest.mark.parametrize("environment", (False, True))
@pytest.mark.parametrize("absorption", (0.05, 0.2, 0.5))
def test_light_from_everywhere_is_dimmed_on_its_way_to_surfaces(absorption: float, environment: bool) -> None:
    """Below a slab of optical depth t arrives 2 E3(t) of it, and the eye's way takes exp(-t) once more."""
    t = 2.0 * absorption
    cosine = (torch.arange(100000, dtype=torch.float64) + 0.5) / 100000
    wanted = float((2.0 * cosine * torch.exp(-t / cosine)).mean()) * 0.5 * float(torch.exp(torch.tensor(-t)))
    found = lit_from_everywhere(absorption, 0.0, environment=environment)
    assert torch.allclose(found, torch.full((3,), wanted), rtol=0.03), (found, wanted)


def test_media_that_absorb_nothing_leave_even_light_even() -> None:
    """What they scatter away they scatter back: a white floor in fog under a white sky is as white as the sky."""
    floor = 0.5 * math.exp(-0.6) + (1.0 - math.exp(-0.6))
    assert torch.allclose(lit_from_everywhere(0.0, 0.3, environment=False), torch.full((3,), floor), rtol=0.01)


def corridor(**changes: object) -> Scene:
    """Two mirrors that face each other, four units apart, and grey air that scatters light from everywhere."""
    mirror = Material(metallic=1.0, roughness=0.0, diffuse=[1.0, 1.0, 1.0])
    corners = torch.tensor([[-9.0, -9.0, 0.0], [9.0, -9.0, 0.0], [9.0, 9.0, 0.0], [-9.0, 9.0, 0.0]])
    faces = torch.tensor([[0, 1, 2], [0, 2, 3]])
    far = tr.Mesh(vertices=corners + torch.tensor([0.0, 0.0, 4.0]), faces=faces.flip(1))
    near = tr.Mesh(vertices=corners, faces=faces)
    return Scene(meshes=[near, far], materials=[mirror], **changes)  # type: ignore[arg-type]


@pytest.mark.parametrize("way", ["traced", "clustered"])
@pytest.mark.parametrize("bounces", [1, 2, 3])
def test_each_way_between_mirrors_adds_the_light_of_its_air(way: str, bounces: int) -> None:
    """Beyond the last mirror nothing shines: what is seen is the light of so much air, up to where that ends."""
    air = fog(low=[-99, -99, 0.0], high=[99, 99, 4.0], scattering=0.2, absorption=0.0)
    scene = corridor(ambient=torch.full((3,), 1.0), media=[air])
    camera = Cameras.look_at([0.0, 0.0, 2.0], [0.4, 0.0, 0.0], width=3, height=3, fov_deg=0.5)
    options = RenderOptions(
        reflections=way,
        tracing=tr.TraceOptions(bounces=bounces),
        ambient_visibility="off",
        background=[0.0, 0.0, 0.0],
        scattering=ScatterOptions(surfaces=False),
    )
    seen = tr.render(scene, camera, options=options).radiance[0, 1, 1]
    slant = math.hypot(2.0, 0.4) / 2.0
    wanted = 1.0 - math.exp(-0.2 * slant * (2.0 + 4.0 * bounces + 4.0))
    assert float(seen.mean()) == pytest.approx(wanted, abs=2e-3)


@pytest.mark.parametrize("way", ["traced", "clustered"])
def test_a_mirror_shows_fog_that_lies_behind_the_eye(way: str) -> None:
    """Two units of it before a wall that shines, with nothing of it in view."""

    def wall(z: float, material: int) -> tr.Mesh:
        corners = torch.tensor([[-9.0, -9.0, z], [9.0, -9.0, z], [9.0, 9.0, z], [-9.0, 9.0, z]])
        faces = torch.tensor([[0, 1, 2], [0, 2, 3]])
        return tr.Mesh(vertices=corners, faces=faces if material == 0 else faces.flip(1), material=material)

    mirror = Material(metallic=1.0, roughness=0.0, diffuse=[1.0, 1.0, 1.0])
    shining = Material(diffuse=[0.0, 0.0, 0.0], emission=[4.0, 2.0, 1.0])  # bright enough that no sun is added
    air = fog(low=[-50, -50, 3.0], high=[50, 50, 5.0], scattering=0.0, absorption=0.5)
    scene = Scene(meshes=[wall(0.0, 0), wall(6.0, 1)], materials=[mirror, shining], media=[air])
    camera = Cameras.look_at([0, 0, 2], [0, 0, 0], width=5, height=5, fov_deg=1.0)
    options = RenderOptions(reflections=way)
    assert reason(scene, camera, options) == "+ a mirror may show a medium"
    assert reason(scene, camera, RenderOptions(reflections="off")).startswith("- no medium in view")
    seen = tr.render(scene, camera, options=options).radiance[0, 2, 2]
    torch.testing.assert_close(seen, math.exp(-1.0) * torch.tensor([4.0, 2.0, 1.0]), rtol=2e-3, atol=1e-5)
