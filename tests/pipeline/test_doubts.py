"""Warnings about what can be drawn but hardly was meant so, and none where everything is as it should be."""

from __future__ import annotations

import warnings
from dataclasses import replace
from pathlib import Path

import pytest
import torch

import torchrender as tr
from torchrender.effects.shadows.light_cameras import wide_lights
from torchrender.errors import (
    ColorWarning,
    EmptyWarning,
    LightWarning,
    NormalsWarning,
    NotUsedWarning,
    SceneWarning,
    TorchRenderWarning,
    UnitsWarning,
    ViewWarning,
)
from torchrender.pipeline.doubts import scene_doubts
from torchrender.pipeline.view_doubts import view_doubts
from torchrender.raster import rasterize_visibility
from torchrender.scene.procedural import SCENES

BALL = tr.Mesh.sphere(0.5, segments=16)
CAMERA = tr.Cameras.look_at([0, 0, 3], [0, 0, 0], width=24, height=18)
DOWN = {"edge_u": [1, 0, 0], "edge_v": [0, 0, 1]}
UP = {"edge_u": [0, 0, 1], "edge_v": [1, 0, 0]}
SUN = tr.DirectionalLight(direction=[0, -1, -1])


def scene(*meshes: tr.Mesh, **changes: object) -> tr.Scene:
    return tr.Scene(meshes=meshes or (BALL,), lights=[SUN], name="test").replace(**changes)


def spot(*direction: float) -> tr.SpotLight:
    return tr.SpotLight(position=[0, 2, 0], direction=direction, outer_deg=20, inner_deg=10, name="spot")


@pytest.mark.parametrize("light", [
    tr.RectLight(corner=[0, 2, 0], **UP, name="lamp"), spot(0, 1, 0), spot(1, 0, 0),
], ids=["area", "spot up", "spot aside"])  # fmt: skip
def test_a_light_that_faces_away_is_named(light) -> None:
    with pytest.warns(LightWarning, match=f"test: light '{light.name}' faces away from everything"):
        tr.render(scene(lights=[light]), CAMERA)


@pytest.mark.parametrize("light", [
    tr.RectLight(corner=[0, 2, 0], **DOWN), spot(0, -1, 0), spot(0.5, -1, 0), tr.PointLight(position=[0, 2, 0]), SUN,
    tr.RectLight(corner=[0, 0.2, 0], **UP),  # within what it lights
    tr.SpotLight(position=[0, 0.1, 0], direction=[0, 1, 0]),
])  # fmt: skip
def test_lights_that_light_something_are_not(light) -> None:
    assert scene_doubts(scene(lights=[light])) == []


def test_a_camera_that_sees_nothing_is_told_where_things_are() -> None:
    away = tr.Cameras.look_at([0, 0, 3], [0, 0, 6], width=24, height=18)
    told = r"camera 1 sees nothing: it stands at \(0, 0, 3\) and looks along \(0, 0, 1\); the scene lies between \(-0.5"
    with pytest.warns(ViewWarning, match=told):
        tr.render(scene(), tr.Cameras.cat([CAMERA, away]))


def test_something_small_that_no_asked_pixel_shows_is_no_nothing() -> None:
    camera = tr.Cameras.look_at([0.113, 0.117, 90], [0.113, 0.117, 0], width=200, height=200)
    seen = rasterize_visibility(scene().geometry, camera)
    assert 0 < int(seen.covered.sum()) < 20 and view_doubts(scene(), seen) == []


def test_a_camera_inside_a_solid_is_told_of_which() -> None:
    inside = tr.Cameras.look_at([0, 0, 0.1], [0, 0, -1], width=24, height=18)
    with pytest.warns(ViewWarning, match="camera 0 stands inside 'sphere': all it sees are backs"):
        tr.render(scene(), inside)


def test_a_room_seen_from_inside_is_no_solid() -> None:
    room = replace(BALL, faces=BALL.faces.flip(1), normals=None)
    inside = tr.Cameras.look_at([0, 0, 0.1], [0, 0, -1], width=24, height=18)
    assert view_doubts(scene(room), rasterize_visibility(scene(room).geometry, inside)) == []


def test_normals_that_point_inwards_are_named() -> None:
    assert BALL.normals is not None
    turned = replace(BALL, normals=-BALL.normals, name="ball")
    with pytest.warns(NormalsWarning, match="normals of 'ball' point to the inside"):
        tr.render(scene(turned), CAMERA)


def test_a_few_odd_normals_are_not() -> None:
    assert BALL.normals is not None
    normals = torch.where(BALL.vertices[:, :1] > 0.1, -BALL.normals, BALL.normals)
    odd = scene(replace(BALL, normals=normals))
    assert view_doubts(odd, rasterize_visibility(odd.geometry, CAMERA)) == []


@pytest.mark.parametrize(
    ("scale", "photometric", "intensity", "told"),
    [
        *[(2000.0, True, 1.0, True), (2.0, True, 1.0, False)],
        *[(1000.0, False, 20.0, True), (2.0, False, 20.0, False), (1000.0, False, 2e7, False)],
    ],
)
def test_millimetres_are_doubted_where_metres_are_meant(
    scale: float, photometric: bool, intensity: float, told: bool
) -> None:
    lamp = tr.PointLight(position=[0, 2 * scale, 0], intensity=intensity)
    large = scene(tr.Mesh.box(scale), lights=[lamp], photometric=photometric)
    kinds = [kind for kind, _ in scene_doubts(large)]
    assert kinds == ([UnitsWarning] if told else [])


def test_lamps_of_a_large_scene_that_has_other_light_are_not_doubted() -> None:
    lamp = tr.PointLight(position=[0, 2000, 0], intensity=20)
    assert scene_doubts(scene(tr.Mesh.box(1000.0), lights=[lamp, SUN])) == []
    assert scene_doubts(scene(tr.Mesh.box(1000.0), lights=[lamp], ambient=0.3)) == []


def test_what_lies_before_the_near_plane_is_told() -> None:
    tiny = scene(tr.Mesh.box(1e-4))
    camera = tr.Cameras.look_at([2e-4, 2e-4, 3e-4], [0, 0, 0], width=32, height=32)
    told = r"camera 0 sees nothing: all of it ends .* before the near plane: give the camera near=.*, not 0.01"
    with pytest.warns(ViewWarning, match=told):
        tr.render(tiny, camera)
    above = {"eye": [1e-4, 3e-3, 1e-4], "target": [0, 0, 0], "width": 32, "height": 32}
    for view in (tr.Cameras.look_at(**above), tr.Cameras.orthographic_view(**above, view_height=1e-2)):
        with pytest.warns(ViewWarning, match=told):
            tr.render(scene(tr.Mesh.plane(1.0)), view)  # fills the picture: its corners lie beside it
    far = replace(CAMERA, near=torch.tensor(0.5), far=torch.tensor(1.0))
    with pytest.warns(ViewWarning, match=r"begins 2.5 ahead, behind the far plane: give the camera far=.*, not 1"):
        tr.render(scene(), far)


def test_textures_of_8_bits_are_doubted() -> None:
    texture = torch.full((4, 4, 3), 200.0)
    painted = scene(materials=[tr.Material(name="wood", diffuse_texture=texture)])
    ((kind, told),) = scene_doubts(painted)
    assert kind is ColorWarning and "diffuse_texture of material 'wood' reach 200" in told


def test_it_is_said_once_and_can_be_filtered() -> None:
    dark = scene(lights=[tr.RectLight(corner=[0, 2, 0], **UP)])
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("default")
        for _ in range(3):
            tr.render(dark, CAMERA)
    assert len([w for w in said if issubclass(w.category, LightWarning)]) == 1
    assert issubclass(LightWarning, SceneWarning) and issubclass(SceneWarning, TorchRenderWarning)


def doubts_of(known: tr.Scene) -> list[str]:
    camera = known.camera(width=64, height=48)
    return [
        text for _, text in (*scene_doubts(known), *view_doubts(known, rasterize_visibility(known.geometry, camera)))
    ]


def test_built_in_scenes_are_as_they_should_be() -> None:
    for name, builder in SCENES.items():
        assert doubts_of(tr.load(name, size=builder.fewest)) == [], name


def test_files_of_others_are_as_they_should_be(data_dir: Path) -> None:
    found = {}
    for path in (*data_dir.glob("meshes/*"), *data_dir.glob("gltf/*.glb"), *data_dir.glob("scenes/*.glb")):
        if path.stat().st_size < 500_000:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", TorchRenderWarning)
                known = tr.load(path)
            found |= {path.name: told} if (told := doubts_of(known)) else {}
    assert found == {}


def test_a_light_whose_edges_are_parallel_lights_nothing() -> None:
    flat = tr.RectLight(corner=[0, 2, 0], edge_u=[1, 0, 0], edge_v=[2, 0, 0], name="panel")
    with pytest.warns(LightWarning, match="'panel' has no area and lights nothing: edge_u and edge_v are parallel"):
        tr.render(scene(lights=[flat]), CAMERA)


@pytest.mark.parametrize("built", [
    scene(BALL, tr.Mesh.box(0.2, [0, 3, 0], name="shade"), lights=[tr.PointLight(position=[0, 3, 0], name="lamp")]),
    scene(tr.Mesh.plane(8.0), lights=[tr.DirectionalLight(direction=[0, 1, 0], name="lamp")]),
], ids=["lamp in a box", "sun under the floor"])  # fmt: skip
def test_a_black_picture_is_told_why(built) -> None:
    above = tr.Cameras.look_at([0, 1.5, 3], [0, 0, 0], width=24, height=18)
    with pytest.warns(LightWarning, match="test: camera 0 sees only black: light of 'lamp' does not arrive"):
        image = tr.render(built, above)
    assert float(image.radiance.max()) == 0.0


def test_colours_of_eight_bits_are_told() -> None:
    red = tr.Material(name="red", diffuse=[200, 30, 30])
    with pytest.warns(ColorWarning, match="diffuse of material 'red' reach 200: colours are linear"):
        tr.render(scene(materials=[red]), CAMERA)
    painted = replace(BALL, colors=torch.full((len(BALL.vertices), 3), 255.0))
    with pytest.warns(ColorWarning, match="colors of mesh 'sphere' reach 255"):
        tr.render(scene(painted), CAMERA)


GLASS = tr.Material(name="glass", opacity=0.4, blend=True)
HOLES = tr.Material(name="leaf", opacity=0.2, alpha_cutoff=0.5)


def test_a_pane_that_fills_the_view_is_something() -> None:
    pane = scene(tr.Mesh.box([1.0, 1.0, 0.1]), materials=[GLASS])
    assert view_doubts(pane, rasterize_visibility(pane.geometry.solid, CAMERA)) == []
    away = tr.Cameras.look_at([0, 0, 3], [0, 0, 6], width=24, height=18)
    ((_, told),) = view_doubts(pane, rasterize_visibility(pane.geometry.solid, away))
    assert "camera 0 sees nothing: it stands at" in told


def test_a_view_that_holes_alone_fill_is_told_of_them() -> None:
    with pytest.warns(ViewWarning, match="camera 0 sees nothing: all that is before it is cut out by the alpha of 'l"):
        tr.render(scene(materials=[HOLES]), CAMERA)


def test_an_open_plane_from_below_is_nothing_to_stand_inside_of() -> None:
    plane = scene(tr.Mesh.plane(40.0))
    below = tr.Cameras.look_at([0, -2, 0.1], [0, 0, 0], width=24, height=18)
    assert view_doubts(plane, rasterize_visibility(plane.geometry, below)) == []


@pytest.mark.parametrize("glass", [GLASS, tr.Material(name="glass", metallic=0.0, roughness=0.1, transmission=0.9)])
def test_a_camera_inside_glass_sees_through_it(glass: tr.Material) -> None:
    inside = tr.Cameras.look_at([0, 0, 0.1], [0, 0, -1], width=24, height=18)
    built = scene(tr.Mesh.box(1.0), materials=[glass])
    assert view_doubts(built, rasterize_visibility(built.geometry.solid, inside)) == []


def test_black_surfaces_are_told_as_such() -> None:
    with pytest.warns(LightWarning, match="sees only black: diffuse of material 'soot' is black, and mirrors nothing"):
        tr.render(scene(materials=[tr.Material(name="soot", diffuse=[0, 0, 0])]), CAMERA)


def test_opacity_that_is_not_used_is_told_once() -> None:
    ((kind, told),) = scene_doubts(scene(materials=[tr.Material(name="pane", opacity=0.4)]))
    assert kind is NotUsedWarning and "opacity 0.4 of material 'pane' is not used: give it blend=True" in told
    assert scene_doubts(scene(materials=[GLASS])) == [] == scene_doubts(scene(materials=[HOLES]))


def test_media_that_would_glow_if_they_absorbed_are_told() -> None:
    room = {"low": [-1, -1, -1], "high": [1, 1, 1], "emission": [5, 5, 5], "name": "flame"}
    ((kind, told),) = scene_doubts(scene(media=[tr.Medium(**room)]))
    assert kind is NotUsedWarning and "emission of medium 'flame' is not used, as it absorbs nothing" in told
    assert scene_doubts(scene(media=[tr.Medium(**room, absorption=[0.1, 0, 0])])) == []


def test_a_scene_without_anything_is_told_of() -> None:
    with pytest.warns(EmptyWarning, match="nobody: it has no meshes, no media and no environment"):
        tr.render(tr.Scene(meshes=[], name="nobody"), width=8, height=8)
    sky = tr.Environment.constant([0.5, 0.6, 0.8])
    air = tr.Medium(low=[-1, -1, -1], high=[1, 1, 1])
    assert scene_doubts(tr.Scene(environment=sky)) == [] == scene_doubts(tr.Scene(media=[air]))


def test_a_beam_that_may_fall_between_pixels_is_named() -> None:
    """From four units above a floor: a beam as wide as 0.07 is seen by pixels of 0.02 and not by those of 0.24."""
    floor = tr.Mesh.plane(4.0)
    beam = tr.SpotLight(position=[0.03, 2, 0.01], direction=[0, -1, 0], outer_deg=1.0 - 1e-6, name="pointer")
    aside = replace(beam, position=torch.tensor([1.9, 2, 1.9]), name="elsewhere")
    coarse, fine = (tr.Cameras.look_at([0, 4, 0.1], [0, 0, 0], width=n, height=n, fov_deg=30) for n in (9, 96))
    told = r"test: the beam of light 'pointer' is 0\.29 pixels wide where it ends: it may fall between them"
    with pytest.warns(LightWarning, match=told):
        tr.render(scene(floor, lights=[beam, SUN]), coarse)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        tr.render(scene(floor, lights=[beam, SUN]), fine)
        tr.render(scene(floor, lights=[aside, SUN]), coarse)


def under_a_panel(width: float, height: float, top: float = 1.0) -> tr.Scene:
    half = width / 2
    panel = tr.RectLight(corner=[-half, height, -half], edge_u=[width, 0, 0], edge_v=[0, 0, width], name="panel")
    return scene(tr.Mesh.plane(4.0), tr.Mesh.box([1.0, top, 1.0], [0.0, top / 2, 0.0]), lights=[panel])


BESIDE_IT = tr.Cameras.look_at([2, 1.6, 3], [0, 0.3, 0], width=48, height=36)


@pytest.mark.parametrize(("width", "height"), [(6.0, 1.0001), (6.0, 1.3), (6.0, 1.6), (2.0, 1.3)])
def test_a_panel_close_above_things_is_sampled_and_named_where_it_is_not(width: float, height: float) -> None:
    """One map from its middle sees the box and nothing around it: the floor would be black."""
    built = under_a_panel(width, height)
    usual = tr.render(built, BESIDE_IT)
    assert "light 'panel' is too large for one map" in str(usual.plan)
    assert usual.plan.options.area_shadows == "sampled" and scene_doubts(built) == []
    exact = tr.render(built, BESIDE_IT, options=tr.RenderOptions(area_shadows="sampled")).radiance
    assert float((usual.radiance - exact).abs().mean()) < 0.03 * float(exact.mean())
    told = "test: light 'panel' is large beside what stands close by: maps from the middle see little"
    with pytest.warns(LightWarning, match=told):
        pinned = tr.render(built, BESIDE_IT, options=tr.RenderOptions(fixed=("soft_shadow",)))
    assert float((pinned.radiance - exact).abs().mean()) > 0.2 * float(exact.mean())


@pytest.mark.parametrize(
    ("width", "height", "top"), [(6.0, 3.5, 1.0), (1.0, 2.0, 1.0), (0.5, 1.5, 1.0), (6.0, 1.0, 0.01)]
)
def test_lamps_far_enough_above_things_keep_their_map(width: float, height: float, top: float) -> None:
    """Also those that light nothing but a floor close by, on which nothing stands."""
    built = under_a_panel(width, height, top)
    image = tr.render(built, BESIDE_IT)
    assert image.plan.options.area_shadows == "pcss" and "one map" not in str(image.plan)


def test_lamps_of_built_in_scenes_keep_their_maps() -> None:
    for name, builder in SCENES.items():
        assert wide_lights(tr.load(name, size=builder.fewest)) == (), name
