"""A room in the style of a photo: from views to the scene that comes out."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch

import torchrender as tr
from photo_scenes import around, placed, room, striped_photo
from torchrender.errors import InputError, OptionError
from torchrender.photo.lab import lab_from_linear
from torchrender.photo.style.adjacency import adjacency
from torchrender.photo.style.finish import albedo, as_material, exponent_roughness
from torchrender.photo.style.objects import cut_scene
from torchrender.photo.style.options import NEUTRAL, FitOptions, SearchOptions, StyleOptions, StyleWarning
from torchrender.photo.style.prior import CEILING, FLOOR, FURNITURE, WALL, roles
from torchrender.photo.style.session import Style
from torchrender.photo.style.statistics import rendered_distance
from torchrender.photo.style.terms import default_light
from torchrender.photo.style.transfer import style_scene
from torchrender.photo.style.views import look, make_views
from torchrender.raster import rasterize
from torchrender.scene.material import Material, Sampler
from torchrender.scene.shapes import box, sphere

QUICK = StyleOptions(views=8, width=80, height=60)


@pytest.fixture(scope="module")
def style() -> Style:
    return style_scene(room(), striped_photo(), QUICK)


# --------------------------------------------------------------------- views


def test_views_of_a_room_stand_inside_and_show_everything() -> None:
    scene = room()
    objects = cut_scene(scene)
    cameras = make_views(scene, objects, QUICK)
    assert 8 <= len(cameras) <= 15 and bool((cameras.eye[:, (0, 2)].abs() < 1.96).all())
    assert torch.allclose(cameras.eye[:8, 1], torch.full((8,), 1.4, dtype=torch.float64), atol=0.15)
    assert bool(look(scene, objects, cameras).visible.any(dim=1).all())


def test_a_thing_is_seen_from_outside() -> None:
    scene = tr.Scene(meshes=(sphere(1.0, 32),), materials=(Material(),))
    cup = sphere(1.0, 32)
    low = cup.vertices[cup.faces][..., 1].amax(dim=1) < 0.7
    open_thing = tr.Scene(meshes=(replace(cup, faces=cup.faces[low]),), materials=(Material(),))
    eyes = make_views(open_thing, cut_scene(open_thing), QUICK).eye
    assert bool((eyes.norm(dim=1) > 1.2).all())
    cameras = make_views(scene, cut_scene(scene), QUICK)
    assert bool((cameras.eye.norm(dim=1) > 1.2).all())
    assert float(default_light(scene, cameras).norm()) > 2.0 > float(default_light(scene).norm())
    seen = look(scene, cut_scene(scene), cameras)
    assert bool(seen.visible.all()) and bool((seen.pixels.sum(dim=0) < 80 * 60).all())


def test_an_object_that_no_view_shows_gets_one_of_its_own() -> None:
    scene = room()
    small = placed(box(torch.full((3,), 0.12, dtype=torch.float64)), (1.85, 0.06, 1.85), "mouse", 0)
    scene = replace(scene, meshes=(*scene.meshes, small))
    objects = cut_scene(scene)
    cameras = make_views(scene, objects, QUICK)
    assert bool(look(scene, objects, cameras).visible[objects.one("mouse")].any())


def test_a_hidden_object_gets_the_neutral_material_and_a_warning() -> None:
    inside = placed(box(torch.full((3,), 0.2, dtype=torch.float64)), (-0.9, 0.35, -1.3), "in the sofa", 0)
    scene = room()
    scene = replace(scene, meshes=(*scene.meshes, inside))
    with pytest.warns(StyleWarning, match="'in the sofa'"):
        made = style_scene(scene, striped_photo(), QUICK)
    assert made.unseen == ("in the sofa",)
    assert made.materials[-1].tolist() == list(NEUTRAL)
    locked = style_scene(scene, striped_photo(), QUICK, keep=["in the sofa"]).scene
    assert locked.materials[locked.meshes[-1].material].name == scene.materials[0].name, "it may be locked all the same"


# -------------------------------------------------------------------- result


def test_it_runs_as_the_tables_say_and_ends_below_the_start(style: Style) -> None:
    assert style.after.total <= style.before.total and style.history[0] >= style.after.total
    parts = rendered_distance(style.problem.terms, style.materials, style.wanted()).sum(dim=0)
    assert style.after.mean + style.after.deviation + style.after.histogram == pytest.approx(
        float(parts.sum()), abs=1e-6
    )
    assert style.pictures().shape == (len(style.problem.views), 60, 80, 3)
    assert style.candidates.materials.shape == (10, len(style.problem.views), 8)
    assert set(style.timings_ms) == {"photo", "views", "neighbours", "fit", "tables", "search"}


def test_colours_come_from_the_photo_and_walls_are_light(style: Style) -> None:
    """Every mean colour is near one of the photo's four in hue; the prior keeps ceiling and walls light."""
    lab = lab_from_linear(albedo(style.materials, style.problem.cosine))
    lightness = dict(zip(style.names, lab[:, 0].tolist(), strict=True))
    assert min(lightness["ceiling"], lightness["back wall"], lightness["left wall"]) > 60
    assert lightness["floor"] < 75
    photo = lab_from_linear(torch.tensor([[0.7, 0.66, 0.58], [0.3, 0.14, 0.06], [0.05, 0.1, 0.45], [0.5, 0.03, 0.03]]))
    colourful = lab[:, 1:].norm(dim=1) > 15
    turn = torch.nn.functional.cosine_similarity(lab[colourful, None, 1:], photo[None, :, 1:].double(), dim=2)
    assert bool((turn.amax(dim=1) > 0.9).all())


def test_walls_do_not_shine(style: Style) -> None:
    """A lamp beside a wall of the photo is no gloss of it; whoever wants gloss says so."""
    flat = torch.isin(style.problem.role, torch.tensor([CEILING, WALL]))
    assert int(flat.sum()) >= 3 and float(style.candidates.materials[flat][:, :, 6].abs().max()) == 0.0
    rows = torch.arange(48)[:, None].expand(48, 64)
    lamp = torch.exp(-((rows - 10.0) ** 2 + (torch.arange(64) - 40.0) ** 2) / 60.0)[..., None]
    photo = (0.3 + 0.6 * lamp).expand(48, 64, 3)
    glossy = style_scene(room(), photo, replace(QUICK, fit=FitOptions(glossy_walls=True)))
    assert float(glossy.candidates.materials[flat][:, :, 6].max()) > 0.05
    matt = style_scene(room(), photo, QUICK)
    assert float(matt.candidates.materials[flat][:, :, 6].max()) == 0.0


def test_same_seed_same_result() -> None:
    first, second = (style_scene(room(), striped_photo(), QUICK) for _ in range(2))
    assert first.result.visited == second.result.visited
    assert torch.equal(first.materials, second.materials) and first.after == second.after


def test_the_scene_file_has_the_same_look(style: Style, tmp_path) -> None:
    scene = style.scene
    for name in ("styled.glb", "styled.toml"):
        files = style.save(tmp_path / name)
        assert all(f.is_file() for f in files)
        loaded = tr.load(tmp_path / name)
        assert [m.name for m in loaded.meshes] == [m.name for m in scene.meshes]
        camera = style.problem.views.cameras[0]
        for options, limit in ((tr.RenderOptions(ambient_visibility="off"), 1e-3), (tr.RenderOptions(), 0.02)):
            ours, theirs = (tr.render(s, camera, options=options).radiance for s in (scene, loaded))
            assert float((ours - theirs).abs().mean()) < limit * float(ours.mean()), "but for noise of rays"
        for a, b in zip(scene.materials, loaded.materials, strict=True):
            assert torch.allclose(a.diffuse, b.diffuse, atol=1e-6)
            assert a.specular == pytest.approx(b.specular, abs=1e-6)
            assert a.shininess == pytest.approx(b.shininess, rel=1e-5)


# ------------------------------------------------------------------- changes


def test_locks_hold_and_nothing_gets_worse(style: Style) -> None:
    locked = style.lock("sofa", "*wall")
    index = [style.names.index(n) for n in ("sofa", "back wall", "left wall", "right wall", "front wall")]
    assert locked.choice[index].tolist() == style.choice[index].tolist()
    assert locked.after.total <= style.after.total + 1e-9
    free = torch.from_numpy(locked.free())
    assert free[index].sum(dim=1).tolist() == [1] * 5
    neighbours = locked.cost().start(locked.result.choice).neighbours()
    assert neighbours[locked.free()].min() >= locked.after.total - 1e-9
    other = locked.choose("sofa", int(style.candidates.valid[index[0]].nonzero()[0]))
    assert other.locked[index[0]] == int(style.candidates.valid[index[0]].nonzero()[0])
    assert not locked.unlock("sofa").locked.keys() & {index[0]} and locked.unlock().locked == {}


def test_a_picked_region_gives_its_colour(style: Style) -> None:
    picked = style.pick("table", (62, 22, 79, 43))  # the red thing
    index = style.names.index("table")
    red = albedo(picked.materials, picked.problem.cosine)[index]
    assert float(red[0]) > 5 * float(red[2]) and index in picked.locked
    assert torch.equal(picked.materials[index], picked.lock("ball").materials[index])
    with pytest.raises(InputError, match="within the photo"):
        style.pick("table", (0, 0, 81, 10))
    with pytest.raises(InputError, match="fits 4 objects"):
        style.pick("*wall", (0, 0, 10, 10))
    with pytest.raises(InputError, match="photo must be"):
        style.pick("table", (0, 0, 10, 10), photo=1)


def test_kept_materials_stay_in_the_scene() -> None:
    scene = room({"sofa": (0.1, 0.6, 0.2)})
    made = style_scene(scene, striped_photo(), QUICK, keep=["sofa"], pick={"ball": (0, 22, 18, 43)})
    index = made.names.index("sofa")
    old, new = scene.materials[scene.meshes[index].material], made.scene.materials[made.scene.meshes[index].material]
    assert new is old
    shown = albedo(made.materials, made.problem.cosine)[index]
    assert torch.allclose(shown, old.diffuse.double(), atol=1e-6)
    assert made.unlock("sofa").kept == frozenset()
    assert made.adjusted(lightness=-0.5).scene.materials[new_index(made, "sofa")].diffuse.tolist() == pytest.approx(
        old.diffuse.tolist()
    )
    later = style_scene(scene, striped_photo(), QUICK).keep("sofa")
    assert torch.allclose(later.materials[index], made.materials[index])
    with pytest.raises(InputError, match="cannot both"):
        style_scene(scene, striped_photo(), QUICK, keep=["sofa"], pick={"sofa": (0, 0, 9, 9)})


def new_index(style: Style, name: str) -> int:
    return style.scene.meshes[style.names.index(name)].material


def test_sliders_move_all_materials_one_way(style: Style) -> None:
    def lab(made: Style) -> torch.Tensor:
        return lab_from_linear(albedo(made.materials, made.problem.cosine))

    plain = lab(style)
    assert bool((lab(style.adjusted(lightness=-0.4))[:, 0] <= plain[:, 0] + 1e-6).all())
    assert float((lab(style.adjusted(lightness=0.4))[:, 0] - plain[:, 0]).mean()) > 3
    assert float((lab(style.adjusted(warmth=0.5))[:, 2] - plain[:, 2]).mean()) > 3
    grey = lab(style.adjusted(saturation=-1.0))
    assert float(grey[:, 1:].abs().max()) < 3
    assert torch.equal(style.adjusted().materials, style.materials)
    with pytest.raises(OptionError, match="warmth"):
        style.adjusted(warmth=1.5)


def test_palette_weights_pull_towards_their_colours(style: Style) -> None:
    colors, share = style.palette(4)
    assert len(colors) == 4 and float(share.sum()) == pytest.approx(1.0)
    blue = int(colors[:, 2].argmin())
    weights = [0.02] * 4
    weights[blue] = 5.0
    bluer = style.with_palette(weights)

    def mean_b(made: Style) -> float:
        return float(lab_from_linear(made.pictures().reshape(-1, 3).double())[:, 2].mean())

    assert float(bluer.wanted().mean[1]) < float(style.wanted().mean[1]) - 10
    assert mean_b(bluer) < mean_b(style)
    with pytest.raises(OptionError, match="weights"):
        style.with_palette([1.0] * 17)
    with pytest.raises(InputError, match="candidate of 'table'"):
        style.choose("table", 99)
    for wrong in ([], [0.0, 0.0]):
        with pytest.raises(InputError, match="weights"):
            style.with_palette(wrong)


def test_highlights_by_hand(style: Style) -> None:
    shiny = style.add_highlight("ball", 0.6, 50.0)
    index = style.names.index("ball")
    assert shiny.materials[index, 6:].tolist() == [0.6, 50.0]
    before, after = (s.scene.materials[s.scene.meshes[index].material].shininess for s in (style, shiny))
    assert after > before
    with pytest.raises(OptionError, match="specular"):
        style.add_highlight("ball", 2.0)


def test_several_photos_count_alike() -> None:
    red = torch.tensor([0.5, 0.02, 0.02]).expand(40, 40, 3)
    blue = torch.tensor([0.02, 0.02, 0.5]).expand(10, 10, 3)
    both = style_scene(room(), [red, blue], QUICK)
    assert both.candidates.materials.shape[1] == 2 * len(both.problem.views)
    assert float(both.wanted().histogram.max()) == pytest.approx(0.5)
    colors = albedo(both.materials, both.problem.cosine)
    assert bool((colors[:, 0] > 5 * colors[:, 2]).any()) and bool((colors[:, 2] > 5 * colors[:, 0]).any())


def test_textures_keep_their_pattern_and_take_the_new_colour() -> None:
    board = torch.full((8, 8, 3), 0.1)
    board[::2, ::2] = 0.8
    scene = room()
    table = next(k for k, m in enumerate(scene.meshes) if m.name == "table")
    materials = list(scene.materials)
    lies = Sampler(wrap_u="clamp", transform=torch.tensor([[2.0, 0.0, 0.0], [0.0, 3.0, 0.0]]))
    materials[table] = replace(materials[table], diffuse_texture=board, samplers={"diffuse_texture": lies})
    scene = replace(scene, materials=tuple(materials))
    dropped = style_scene(scene, striped_photo(), QUICK).scene
    assert dropped.materials[dropped.meshes[table].material].diffuse_texture is None
    kept = style_scene(scene, striped_photo(), replace(QUICK, keep_textures=True))
    made = kept.scene.materials[kept.scene.meshes[table].material]
    assert made.diffuse_texture is not None and float(made.diffuse.max()) <= 1.0
    assert made.sampler("diffuse_texture") is lies, "it lies on the table as it did"
    shown = (made.diffuse_texture * made.diffuse).reshape(-1, 3)
    assert float(shown.amax(dim=0)[0] / shown.amin(dim=0)[0]) > 2
    mean = albedo(kept.materials, kept.problem.cosine)[table]
    if float(mean.max()) < 0.3:
        assert torch.allclose(shown.double().mean(dim=0), mean, rtol=0.3)


def test_leaves_keep_their_holes_when_textures_are_dropped(tmp_path) -> None:
    leaf = torch.rand(8, 8, 4, generator=torch.Generator().manual_seed(0))
    leaf[..., 3] = 0.0
    leaf[2:6, 2:6, 3] = 1.0
    scene = room()
    table = next(k for k, m in enumerate(scene.meshes) if m.name == "table")
    materials = list(scene.materials)
    materials[table] = replace(materials[table], diffuse_texture=leaf, alpha_cutoff=0.5)
    scene = replace(scene, materials=tuple(materials))
    style = style_scene(scene, striped_photo(), QUICK)
    style.save(tmp_path / "leaves.glb")
    camera = around(1, 160, 120)

    def shown(made: tr.Scene) -> int:
        return int((rasterize(made, camera).object_id == table).sum())

    solid = replace(scene, materials=tuple(replace(m, alpha_cutoff=None) for m in scene.materials))
    assert shown(solid) > 2 * shown(scene) > 0
    for made in (style.scene, tr.load(tmp_path / "leaves.glb")):
        new = made.materials[made.meshes[table].material]
        assert new.diffuse_texture is not None and bool((new.diffuse_texture[..., :3] == 1.0).all())
        # The table stands on the floor: which of the two is seen through its holes is a matter of rounding.
        assert shown(made) == pytest.approx(shown(scene), rel=0.3)


# ------------------------------------------------------------------- parts


def test_prior_roles_and_neighbours() -> None:
    scene = room()
    objects = cut_scene(scene)
    role = dict(zip(objects.names, roles(scene, objects).tolist(), strict=True))
    assert role["ceiling"] == CEILING and role["floor"] == FLOOR and role["left wall"] == WALL
    assert {role[n] for n in ("sofa", "table", "shelf", "ball")} == {FURNITURE}
    near = adjacency(scene, objects)
    index = {name: k for k, name in enumerate(objects.names)}
    assert bool(near[index["ball"], index["table"]]) and bool(near[index["floor"], index["sofa"]])
    assert not bool(near[index["ball"], index["floor"]]) and not bool(near.diagonal().any())
    assert torch.equal(near, near.T)


def test_a_prior_of_zero_lets_a_dark_photo_have_dark_walls() -> None:
    dark = torch.tensor([0.03, 0.02, 0.02]).expand(40, 60, 3)
    made = style_scene(room(), dark, replace(QUICK, search=SearchOptions(prior_weight=0.0)))
    assert made.after.prior == 0.0 and float(albedo(made.materials, made.problem.cosine).max()) < 0.3


def test_names_and_cuts() -> None:
    scene = room()
    meshes = [
        replace(m, name="sofa/legs" if k == 6 else m.name, object_id=min(k, 7)) for k, m in enumerate(scene.meshes)
    ]
    meshes[7] = replace(meshes[7], name="chair/seat")
    meshes[8] = replace(meshes[8], name="chair/back")
    meshes[9] = replace(meshes[9], name="chair/back")
    scene = replace(scene, meshes=tuple(meshes))
    objects = cut_scene(scene)
    assert objects.names[-1] == "chair" and len(objects) == 8 and objects.meshes[-1] == (7, 8, 9)
    apart = cut_scene(scene, "mesh")
    assert apart.names[-2:] == ("chair/back", "chair/back (2)")
    assert len(cut_scene(scene, "material")) == 10
    assert objects.find(["#0", "*wall"]) == [0, 2, 3, 4, 5] and objects.one("chair") == 7
    with pytest.raises(InputError, match="no object is named 'lamp'"):
        objects.find(["lamp"])
    with pytest.raises(OptionError, match="cut"):
        cut_scene(scene, "face")


def test_candidates_may_be_thinned() -> None:
    few = style_scene(room(), striped_photo(), replace(QUICK, search=SearchOptions(cluster=2)))
    assert int(few.usable.sum(dim=1).max()) <= 2 and bool((few.usable <= few.candidates.valid).all())


def test_coloured_highlights_and_matt_fits() -> None:
    made = style_scene(room(), striped_photo(), replace(QUICK, fit=FitOptions(spec_color=True)), cameras=around())
    assert made.candidates.materials.shape == (10, 4, 10) and len(made.scene.materials) == 10
    matt = style_scene(room(), striped_photo(), replace(QUICK, fit=FitOptions(specular=False)), cameras=around())
    assert float(matt.materials[:, 6].max()) == 0.0


def test_the_mapping_keeps_the_height_of_highlights() -> None:
    color = torch.tensor([0.4, 0.3, 0.2])
    for exponent in (1.0, 5.0, 20.0, 200.0):
        made = as_material("a", color, 0.02 * 8.0, max(exponent, 6.0))
        height = made.specular * (made.shininess + 2) / 2
        assert height == pytest.approx(0.16, rel=0.02) and made.shininess <= max(exponent, 6.0) * 1.01
        assert torch.allclose(made.diffuse, color, atol=1e-6)
    matt = as_material("b", color, 0.0, 20.0)
    assert matt.gloss == 1.0 and matt.shininess == 1.0
    assert as_material("c", torch.ones(3), 1.0, 12.0).specular <= 0.08
    assert exponent_roughness(0.0) == 1.0


@pytest.mark.parametrize(
    ("change", "error", "text"),
    [
        ({"photos": []}, InputError, "at least one photo"),
        ({"keep": ["piano"]}, InputError, "no object is named"),
        ({"pick": {"sofa": (0, 0, 1000, 2)}}, InputError, "within the photo"),
        ({"light": [0.0, 1.0]}, InputError, "light"),
        ({"light": [0.0, float("nan"), 1.0]}, InputError, "light"),
        ({"cameras": around(4)[:0]}, InputError, "1 to 15"),
        ({"scene": tr.Scene()}, InputError, "no object"),
        ({"pick": ["sofa"]}, InputError, "pick must map"),
        ({"pick": {"sofa": None}}, InputError, "a region must be"),
        ({"options": {"views": 8}}, OptionError, "must be StyleOptions"),
        ({"photos": torch.rand(4, 4, 3, requires_grad=True)}, InputError, "gradients"),
        ({"photos": ["photo.png"]}, InputError, "floating-point"),
    ],
)
def test_wrong_use(change, error, text) -> None:
    given = {"scene": room(), "photos": striped_photo(), "options": QUICK, **change}
    with pytest.raises(error, match=text):
        style_scene(**given)


def test_options_check_themselves() -> None:
    for wrong in ({"views": 7}, {"views": 16}, {"visible_share": 0.5}, {"place": "tile"}, {"cut": "x"}, {"seed": -1}):
        with pytest.raises(OptionError, match=next(iter(wrong))):
            StyleOptions(**wrong)
    with pytest.raises(OptionError, match="views must be an integer"):
        StyleOptions(views=8.5)
    with pytest.raises(OptionError, match="ridge"):
        FitOptions(ridge=1.0)
