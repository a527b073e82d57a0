"""Histories of pictures: what is used again, and what a change takes away."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch

from reuse_scenes import rectangle
from torchrender.effects.reflections.reuse_options import ReuseOptions
from torchrender.effects.shadows.shadow_map import ShadowOptions
from torchrender.errors import ExposureWarning, InputError
from torchrender.image import Image
from torchrender.passes.light.shadow_map import SCENE_SHADOW_MAP, SHADOW_MAP
from torchrender.passes.mirrors.hit_shader import HIT_SHADER
from torchrender.passes.mirrors.key_frame import KEY_FRAME, reuse_report
from torchrender.passes.seen.ray_caster import RAY_CASTER
from torchrender.pipeline.buffer import Buffer, Lasting
from torchrender.pipeline.history import RenderHistory
from torchrender.pipeline.options import RenderOptions
from torchrender.pipeline.pace import Pace
from torchrender.renderer import render
from torchrender.scene.camera import Cameras
from torchrender.scene.environment import Environment
from torchrender.scene.light import DirectionalLight, PointLight
from torchrender.scene.material import Material
from torchrender.scene.mesh import Mesh
from torchrender.scene.model import Scene

TRACED = RenderOptions(reflections="traced")


def mirror_room() -> Scene:
    board = (torch.arange(4)[:, None] + torch.arange(4)) % 2
    checks = (0.2 + 0.6 * board.float())[..., None].expand(4, 4, 3).contiguous()
    return Scene(
        meshes=(
            rectangle([-2.0, -1.5, 0.0], [4.0, 0.0, 0.0], [0.0, 3.0, 0.0], 0),
            rectangle([4.0, -3.0, 5.0], [-8.0, 0.0, 0.0], [0.0, 6.0, 0.0], 1),
        ),
        materials=(
            Material(name="mirror", specular=0.9, diffuse=torch.zeros(3)),
            Material(name="wall", diffuse=torch.ones(3), diffuse_texture=checks),
        ),
        lights=(PointLight(position=torch.tensor([0.0, 0.0, 2.0]), intensity=torch.full((3,), 12.0)),),
        ambient=torch.full((3,), 0.1),
    )


def camera(x: float = 0.3, size: int = 48) -> Cameras:
    return Cameras.look_at([x, 0.1, 3.0], [0.1, 0.0, 0.0], width=size, height=size, fov_deg=50.0)


def started(scene: Scene, options: RenderOptions = TRACED) -> RenderHistory:
    history = render(scene, camera(), options=options, history=RenderHistory()).history
    assert history is not None and reuse_report(history).key_frame
    return history


def was_key_frame(image: Image) -> bool:
    report = reuse_report(image.history)
    assert report is not None
    return report.key_frame


def following(scene: Scene, history: RenderHistory, options: RenderOptions = TRACED) -> Image:
    return render(scene, camera(0.33), options=options, history=history)


def test_a_sequence_is_close_to_single_pictures() -> None:
    scene = mirror_room()
    history = started(scene)
    image = following(scene, history)
    report = reuse_report(image.history)
    assert report is not None and not report.key_frame and report.traced_share < 0.4
    alone = render(scene, camera(0.33), options=TRACED)
    assert alone.history is None
    difference = (image.radiance - alone.radiance).abs()
    assert float(difference.max()) > 0.0 and float(difference.mean()) < 0.5 / 255


def test_a_history_is_a_value() -> None:
    """Going on twice from one history gives the same picture twice; the history itself stays what it was."""
    scene = mirror_room()
    history = started(scene)
    before = dict(vars(history))
    first, second = following(scene, history), following(scene, history)
    assert torch.equal(first.radiance, second.radiance)
    assert all(before[name] is getattr(history, name) for name in before)


def test_what_stands_still_is_kept() -> None:
    scene = mirror_room()
    history = started(scene)
    after = following(scene, history).history
    assert after is not None
    assert after.scene is history.scene is not None
    for buffer in (SHADOW_MAP, HIT_SHADER):
        assert after.get(buffer) is history.get(buffer) is not None, buffer.name
    assert after.get(KEY_FRAME).state.key is history.get(KEY_FRAME).state.key  # type: ignore[union-attr]
    caster = after.get(RAY_CASTER)
    assert caster is not None and following(scene, after).history.get(RAY_CASTER) is caster  # type: ignore[union-attr]


def moved(scene: Scene) -> Scene:
    wall = scene.meshes[1]
    vertices = wall.vertices + torch.tensor([0.2, 0.0, 0.0], dtype=wall.vertices.dtype)
    return replace(scene, meshes=(scene.meshes[0], replace(wall, vertices=vertices)))


def relit(scene: Scene) -> Scene:
    return replace(scene, lights=(replace(scene.lights[0], intensity=torch.full((3,), 20.0)),))


def repainted(scene: Scene) -> Scene:
    return replace(scene, materials=(scene.materials[0], replace(scene.materials[1], diffuse=torch.full((3,), 0.4))))


def dimmed(scene: Scene) -> Scene:
    return replace(scene, ambient=torch.full((3,), 0.3))


def surrounded(scene: Scene) -> Scene:
    return replace(scene, environment=Environment(radiance=torch.full((4, 8, 3), 0.3)))


@pytest.mark.parametrize(
    ("change", "keeps"),
    [
        (moved, ()),
        (relit, (RAY_CASTER,)),
        (repainted, (RAY_CASTER, SHADOW_MAP)),
        (dimmed, (RAY_CASTER, SHADOW_MAP)),
        (surrounded, (RAY_CASTER, SHADOW_MAP)),
    ],
)
def test_a_change_takes_away_what_it_could_show_in(change, keeps: tuple[Buffer, ...]) -> None:
    scene = mirror_room()
    history = started(scene)
    other = change(scene)
    image = following(other, history)
    # What moves moves on: nobody keeps reflections then.
    assert image.plan is not None and image.plan.row("reflections").runs
    assert reuse_report(image.history) is None if change is moved else was_key_frame(image)
    for buffer in (RAY_CASTER, SHADOW_MAP):
        assert (image.history.get(buffer) is history.get(buffer)) == (buffer in keeps), buffer.name
    alone = render(other, camera(0.33), options=TRACED)
    assert torch.allclose(image.radiance, alone.radiance, atol=1e-6)


def test_options_that_change_start_anew() -> None:
    scene = mirror_room()
    history = started(scene)
    for options, maps_kept in (
        (replace(TRACED, reuse=ReuseOptions(contrast=0.5)), True),
        (replace(TRACED, background=(1.0, 0.0, 0.0)), True),
        (replace(TRACED, shadow=ShadowOptions(filter="pcf")), False),
        (replace(TRACED, shadows=False), False),
    ):
        image = following(scene, history, options)
        assert was_key_frame(image)
        assert (image.history.get(SHADOW_MAP, options) is history.get(SHADOW_MAP)) == maps_kept
        alone = render(scene, camera(0.33), options=options)
        assert torch.allclose(image.radiance, alone.radiance, atol=1e-6)


def test_scenes_without_mirrors_light_or_triangles_have_histories_too() -> None:
    plain = replace(mirror_room(), materials=(Material(name="a"), Material(name="b")))
    dark = replace(plain, lights=(), ambient=torch.zeros(3))
    for scene in (plain, dark, Scene()):
        image = render(scene, camera(), history=RenderHistory())
        again = render(scene, camera(0.33), history=image.history)
        assert again.history is not None and reuse_report(again.history) is None
        assert again.history.scene is image.history.scene  # type: ignore[union-attr]
        alone = render(scene, camera(0.33))
        assert torch.equal(again.radiance, alone.radiance)


def test_supersampling_batches_and_orthographic_cameras() -> None:
    scene = mirror_room()
    options = replace(TRACED, supersample=2)
    history = started(scene, options)
    assert not was_key_frame(following(scene, history, options))
    pair = Cameras.cat([camera(0.3), camera(0.4)])
    image = render(scene, pair, options=TRACED, history=RenderHistory())
    assert not was_key_frame(render(scene, pair, options=TRACED, history=image.history))
    flat = replace(camera(), orthographic=True, far=torch.tensor([20.0], dtype=torch.float64))
    flat = replace(flat, intrinsics=flat.intrinsics / torch.tensor([[8.0], [8.0], [1.0]], dtype=torch.float64))
    again = render(scene, flat, options=TRACED, history=RenderHistory())
    assert torch.equal(again.radiance, render(scene, flat, options=TRACED).radiance)


def test_every_source_of_reflections_works_with_a_history() -> None:
    scene = mirror_room()
    for name in ("clustered", "environment", "off"):
        options = RenderOptions(reflections=name)
        first = render(scene, camera(), options=options, history=RenderHistory())
        second = render(scene, camera(0.33), options=options, history=first.history)
        alone = render(scene, camera(0.33), options=options)
        assert float((second.radiance - alone.radiance).abs().mean()) < 2 / 255


def test_a_camera_cut_gives_a_whole_picture_and_then_a_key_frame() -> None:
    scene = mirror_room()
    history = started(scene)
    cut = Cameras.look_at([-1.5, 1.0, 0.6], [0.8, -0.4, 0.0], width=48, height=48, fov_deg=50.0)
    image = render(scene, cut, options=TRACED, history=history)
    alone = render(scene, cut, options=TRACED)
    assert float((image.radiance - alone.radiance).abs().mean()) < 1 / 255
    report = reuse_report(image.history)
    assert report is not None and report.next_key_frame
    after = render(scene, cut, options=TRACED, history=image.history)
    assert was_key_frame(after)
    assert torch.allclose(after.radiance, alone.radiance, atol=1e-6)


def test_another_picture_size_is_served_by_the_same_key_frame() -> None:
    scene = mirror_room()
    image = render(scene, camera(0.32, 64), options=TRACED, history=started(scene))
    assert not was_key_frame(image)
    alone = render(scene, camera(0.32, 64), options=TRACED)
    assert float((image.radiance - alone.radiance).abs().mean()) < 1 / 255


def test_a_camera_of_no_scene_is_still_an_error() -> None:
    with pytest.raises(InputError, match="no camera"):
        render(mirror_room(), "nowhere", history=RenderHistory())


def test_maps_that_follow_the_eye_are_never_kept() -> None:
    """Those of an earlier view would be wrong from the next one on."""
    scene = replace(mirror_room(), lights=(DirectionalLight(direction=torch.tensor([0.3, -1.0, -0.5])),))
    options = replace(TRACED, reflections="off", shadow=ShadowOptions(size=256, cascades=2))
    first = render(scene, camera(), options=options, history=RenderHistory())
    second = render(scene, camera(1.4), options=options, history=first.history)
    assert torch.equal(second.radiance, render(scene, camera(1.4), options=options).radiance)


def test_what_is_shared_between_sequences_holds_no_reflections_of_one() -> None:
    history = started(mirror_room())
    shared = history.shared()
    assert history.get(KEY_FRAME) is not None and shared.get(KEY_FRAME) is None
    assert shared.get(SCENE_SHADOW_MAP) is history.get(SCENE_SHADOW_MAP) is not None
    assert shared.get(SHADOW_MAP) is None is not history.get(SHADOW_MAP), "it was fitted to a view"


def test_what_is_kept_goes_by_the_buffer_itself_and_tells_the_newest() -> None:
    """Two passes may call what they make alike; only what the last picture made is the newest."""
    scene, options = mirror_room(), RenderOptions()
    own, other = (Buffer("thing", str, lasting=Lasting(lambda s: (s.meshes,))) for _ in range(2))
    first = RenderHistory().of_scene(scene).with_picture([(own, "made")], options)
    assert first.get(own) == first.newest(own) == first.last(own) == "made"
    assert first.get(other) is None and first.last(other) is None
    second = first.with_picture([], options)
    assert second.get(own) == "made" and second.newest(own) is None


def test_only_what_may_be_shared_goes_to_another_sequence() -> None:
    scene = mirror_room()
    own = Buffer("own", str, lasting=Lasting(lambda s: (s.meshes,), shared=False))
    shared = Buffer("shared", str, lasting=Lasting(lambda s: (s.meshes,)))
    made = RenderHistory().of_scene(scene).with_picture([(own, "a"), (shared, "b")], RenderOptions()).shared()
    assert made.get(own) is None and made.get(shared) == "b"


def test_options_that_a_part_depends_on_take_it_away() -> None:
    part = Buffer("part", str, lasting=Lasting(lambda s: (s.meshes,), lambda o: (o.shadows,)))
    made = RenderHistory().of_scene(mirror_room()).with_picture([(part, "lit")], RenderOptions())
    assert made.get(part, RenderOptions()) == "lit" and made.get(part, RenderOptions(shadows=False)) is None


def test_other_triangles_take_the_pace_away_and_another_lamp_does_not() -> None:
    """What pictures took says nothing of another scene, and the same of the same meshes in another light."""
    scene = mirror_room()
    began = replace(RenderHistory().of_scene(scene), pace=Pace().learned("gbuffer", "1", 20.0, 10.0))
    lamp = PointLight(position=torch.tensor([1.0, 0.0, 2.0]), intensity=torch.ones(3))
    assert began.of_scene(scene.replace(lights=(lamp,))).pace is began.pace
    assert began.of_scene(scene.replace(meshes=scene.meshes[:1])).pace is None


def test_what_no_light_depends_on_is_of_the_scene_that_came() -> None:
    """Name, cameras and unit of light are those of this picture's scene, and what was made is still kept."""
    scene = mirror_room()
    history = started(scene)
    other = scene.replace(name="other", cameras={"there": camera()}, photometric=True)
    with pytest.warns(ExposureWarning, match="other"):
        image = following(other, history)
    assert image.scene.name == "other" and list(image.scene.cameras) == ["there"] and image.exposure is None
    assert following(scene, history).exposure is not None
    assert image.history is not None and image.history.get(HIT_SHADER) is history.get(HIT_SHADER) is not None
    assert "geometry" in vars(image.history.scene) and image.history.scene.geometry is history.scene.geometry  # type: ignore[union-attr]


def test_light_of_photos_is_hidden_no_more() -> None:
    """``photo_light`` takes ambient visibility away, in the middle of a sequence as well."""
    scene = mirror_room().replace(ambient=torch.ones(3))
    history = started(scene)
    photo = scene.replace(photo_light=True)
    found, alone = following(photo, history), render(photo, camera(0.33), options=TRACED)
    assert float((found.radiance - following(scene, history).radiance).abs().max()) > 0.01
    torch.testing.assert_close(found.radiance, alone.radiance)


@pytest.mark.parametrize("change", ["material", "colors"])
def test_mirrors_show_the_new_look_of_a_mesh(change: str) -> None:
    """No light moves and nothing hides any, but what the mirror shows has another colour."""
    scene = replace(mirror_room(), lights=())
    scene = scene.replace(materials=(*scene.materials, Material(diffuse=torch.tensor([0.1, 0.8, 0.1]))))
    options = replace(TRACED, ambient_visibility="off")
    wall = scene.meshes[1]
    changed = {
        "material": replace(wall, material=2),
        "colors": replace(wall, colors=torch.full((len(wall.vertices), 3), 0.1)),
    }[change]
    history = started(scene, options)
    for edited in (scene.replace(meshes=(scene.meshes[0], changed)), scene.with_meshes([scene.meshes[0], changed])):
        found, alone = (render(edited, camera(), options=options, history=h) for h in (history, None))
        torch.testing.assert_close(found.radiance, alone.radiance, rtol=0, atol=1e-5)
        before = render(scene, camera(), options=options)
        assert float((alone.radiance - before.radiance).abs().mean()) > 0.02


def test_the_pace_of_meshes_that_move_is_kept() -> None:
    """An animation is one sequence: what its pictures took tells the next one's times."""
    scene = mirror_room()
    began = replace(RenderHistory().of_scene(scene), pace=Pace().learned("gbuffer", "1", 20.0, 10.0))
    assert began.of_scene(moved(scene)).pace is began.pace
    assert began.of_scene(scene.replace(meshes=scene.meshes[::-1])).pace is None


def test_views_leap_or_follow() -> None:
    history = started(mirror_room())
    assert not RenderHistory().leaps_to(camera()) and not history.leaps_to(camera(0.6))
    turned = Cameras.look_at([0.3, 0.1, 3.0], [2.5, 0.0, 1.0], width=48, height=48, fov_deg=50.0)
    assert history.leaps_to(camera(4.0)) and history.leaps_to(turned) and history.leaps_to(camera()[[0, 0]])


def sky_with_sun(turn: float) -> Environment:
    radiance = torch.full((32, 64, 3), 0.2)
    radiance[8, 16:18] = 900.0
    return Environment(radiance=radiance, rotation_deg=turn)


def test_shadows_follow_the_sun_of_an_environment() -> None:
    """It is no light of the scene as it is given; maps of the sun before it left its shadow where it was."""
    ball = Mesh.sphere(0.4, [0.0, 0.6, 0.0])
    given = Scene(meshes=[Mesh.plane(6.0), ball], materials=[Material()], environment=sky_with_sun(0.0))
    view = Cameras.look_at([0.0, 4.0, 3.0], [0.0, 0.0, 0.0], width=48, height=48, fov_deg=50.0)
    history = RenderHistory()
    environments = (*(sky_with_sun(turn) for turn in (0.0, 60.0, 150.0)), Environment.constant(torch.ones(3)))
    seen = []
    for environment in environments:
        scene = given.replace(environment=environment)
        image = render(scene, view, history=history)
        assert image.history is not None
        history = image.history
        torch.testing.assert_close(image.radiance, render(scene, view).radiance, rtol=1e-3, atol=1e-3)
        seen.append(image.radiance)
    assert float((seen[0] - seen[1]).abs().max()) > 0.2, "the shadow went elsewhere"


def test_shadows_follow_a_light_that_a_scene_gets_and_loses() -> None:
    """The default light is none of the scene as it is given either; where it stays, its maps do."""
    dark = Scene(meshes=[Mesh.plane(6.0), Mesh.sphere(0.4, [0.0, 0.6, 0.0])], materials=[Material()])
    view = Cameras.look_at([0.0, 4.0, 3.0], [0.0, 0.0, 0.0], width=48, height=48, fov_deg=50.0)
    first = render(dark, view, history=RenderHistory()).history
    assert first is not None and first.scene is not None
    held = first.of_scene(dark.replace(materials=[Material(diffuse=torch.full((3,), 0.3))]))
    assert held.scene is not first.scene and held.get(SHADOW_MAP) is first.get(SHADOW_MAP) is not None
    lit = dark.replace(environment=sky_with_sun(150.0))
    image = render(lit, view, history=first)
    torch.testing.assert_close(image.radiance, render(lit, view).radiance, rtol=1e-3, atol=1e-3)
