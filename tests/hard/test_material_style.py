"""Material style where it is hard: photos that say little, scenes of one and of many objects, names as they come."""

from __future__ import annotations

import math
import time
import warnings
from dataclasses import replace

import pytest
import torch

import torchrender as tr
from photo_scenes import around, placed, room, striped_photo
from torchrender.numerics.color import linear_from_srgb
from torchrender.photo.lab import lab_from_linear
from torchrender.photo.style.candidates import Candidates, fit_pixels, without_doubles
from torchrender.photo.style.finish import albedo
from torchrender.photo.style.options import FitOptions, SearchOptions, StyleOptions, StyleWarning
from torchrender.photo.style.session import Style
from torchrender.photo.style.transfer import style_scene
from torchrender.scene.material import Material
from torchrender.scene.mesh import Mesh
from torchrender.scene.shapes import box, sphere

QUICK = StyleOptions(views=8, width=80, height=60)


def sound(style: Style) -> None:
    """Every number is finite and within its bounds, and the search made nothing worse."""
    rows = style.materials
    assert bool(torch.isfinite(style.candidates.materials).all()) and bool(torch.isfinite(rows).all())
    assert bool((rows[:, :7] >= 0).all()) and bool((rows[:, :7] <= 1).all())
    assert bool((rows[:, 7] >= 1).all()) and bool((rows[:, 7] <= 200).all())
    assert all(math.isfinite(v) for v in vars(style.after).values()) and style.after.total <= style.before.total
    assert bool(torch.isfinite(style.pictures()).all())
    for material in style.scene.materials:
        assert float(material.diffuse.max()) <= 1.0 + 1e-6 and float(material.diffuse.min()) >= 0.0


def colors(style: Style) -> torch.Tensor:
    return lab_from_linear(albedo(style.materials, style.problem.cosine))


def test_a_photo_of_one_colour() -> None:
    style = style_scene(room(), torch.tensor([0.2, 0.05, 0.4]).expand(50, 70, 3), QUICK)
    sound(style)
    lab, wanted = colors(style), lab_from_linear(torch.tensor([[0.2, 0.05, 0.4]], dtype=torch.float64))
    hue = torch.atan2(lab[:, 2], lab[:, 1]) - torch.atan2(wanted[:, 2], wanted[:, 1])
    assert float(hue.abs().max()) < 0.15


@pytest.mark.parametrize("value", [0.0, 0.2, 1.0])
def test_grey_black_and_blown_out_photos(value: float) -> None:
    style = style_scene(room(), torch.full((40, 40, 1), value), QUICK)
    sound(style)
    assert float(colors(style)[:, 1:].abs().max()) < 1.0
    assert int((style.wanted().histogram > 0).sum()) == 1
    if value == 1.0:
        assert bool(style.candidates.valid.any()) and float(colors(style)[:, 0].min()) > 70


def test_a_scene_of_one_object() -> None:
    scene = tr.Scene(meshes=(sphere(1.0, 24),), materials=(Material(),))
    style = style_scene(scene, striped_photo(), QUICK)
    sound(style)
    assert len(style.names) == 1 and not style.unseen
    assert style.lock(style.names[0]).choice.tolist() == style.choice.tolist()


def many(count: int) -> tr.Scene:
    """A room full of small boxes in rows."""
    meshes = list(room().meshes)
    side = math.ceil(math.sqrt(count - len(meshes)))
    for k in range(count - len(meshes)):
        place = (-1.6 + 3.2 * (k % side) / side, 0.08, -1.6 + 3.2 * (k // side) / side)
        meshes.append(placed(box(torch.full((3,), 0.16)), place, f"box {k}", 0))
    return replace(room(), meshes=tuple(meshes))


def test_a_scene_of_300_objects_is_done_in_seconds() -> None:
    scene = many(300)
    options = replace(QUICK, visible_share=0.0005, width=160, height=120)
    begin = time.perf_counter()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", StyleWarning)
        style = style_scene(scene, striped_photo(), options)
    assert time.perf_counter() - begin < 30.0
    sound(style)
    assert len(style.names) == 300 and int(style.candidates.valid.any(dim=1).sum()) > 30


def test_a_photo_of_more_than_20_megapixels() -> None:
    small = striped_photo(44, 60)
    large = small.repeat_interleave(90, 0).repeat_interleave(95, 1)
    assert large.shape[0] * large.shape[1] > 20e6
    style = style_scene(room(), large, QUICK)
    sound(style)
    assert style.problem.photos[0].pixels.shape[0] * style.problem.photos[0].pixels.shape[1] <= 2**20
    reference = style_scene(room(), small, QUICK)
    assert float((style.wanted().mean - reference.wanted().mean).abs().max()) < 1.0
    picked = style.pick("table", (62 / 80 * 5700, 22 / 60 * 3960, 79 / 80 * 5700, 43 / 60 * 3960))
    chosen = albedo(picked.materials, picked.problem.cosine)[picked.names.index("table")]
    assert float(chosen[0]) > 5 * float(chosen[2])


NAMES = ("", "a=b=c", "[x]*?", "#3", "椅子 🪑", "line\nbreak", 'q"uote\\', "x" * 500, "same", "same")


def test_odd_names(tmp_path) -> None:
    scene = room()
    scene = replace(scene, meshes=tuple(replace(m, name=n) for m, n in zip(scene.meshes, NAMES, strict=True)))
    style = style_scene(scene, striped_photo(), QUICK, keep=["[x]*?", "椅子 🪑"], pick={"a=b=c": (0, 0, 30, 20)})
    sound(style)
    assert len(set(style.names)) == 10 and "same (2)" in style.names and style.names[0] == "object"
    # A name that looks like a number is a name first.
    assert style.problem.objects.one("#3") == 3 and sorted(style.kept) == [2, 4]
    for suffix in ("glb", "toml"):
        style.save(tmp_path / f"odd.{suffix}")
        assert [m.name for m in tr.load(tmp_path / f"odd.{suffix}").meshes] == list(NAMES)


def test_a_wide_and_a_tiny_photo() -> None:
    for shape in ((1, 1), (2, 900), (900, 2)):
        sound(style_scene(room(), torch.rand(*shape, 3, generator=torch.Generator().manual_seed(0)), QUICK))


def test_a_region_without_a_main_colour() -> None:
    noise = torch.rand(200, 300, 3, generator=torch.Generator().manual_seed(0))
    sound(style_scene(room(), noise, QUICK))


def test_equal_candidates_leave_no_move() -> None:
    """With a flat photo and matt fits every view gives an object the same material."""
    options = replace(QUICK, fit=FitOptions(specular=False, seeds=1), search=SearchOptions(prior_weight=0.0))
    style = style_scene(room(), torch.zeros(30, 40, 3), options, cameras=around(4))
    assert int(style.usable.sum(dim=1).max()) == 1 and style.result.iterations == 0
    same = torch.zeros(2, 3, 8, dtype=torch.float64)
    same[1, 2, 0] = 0.5
    valid = torch.tensor([[True, True, True], [False, True, True]])
    kept = without_doubles(Candidates(same, valid, torch.zeros(2, 3)))
    assert kept.tolist() == [[True, False, False], [False, True, True]]


def test_saturated_pixels_are_left_out_of_the_fit() -> None:
    d = torch.linspace(0.2, 1.0, 400, dtype=torch.float64)
    color = (0.05 + 0.6 * d)[:, None].expand(400, 3).clone()
    blown = color.clone()
    blown[::3] = 1.0
    mirror = torch.zeros(400, dtype=torch.float64)
    options = FitOptions(seeds=1)
    found = [fit_pixels(c.float(), (d, mirror), options) for c in (color, blown, torch.ones(400, 3))]
    assert None not in found
    (clean, good), (burnt, bad), (white, _) = found
    assert torch.allclose(clean, burnt, atol=0.02) and good < 0.01 < bad
    assert float(white[0]) > 0.2
    limit = float(linear_from_srgb(torch.tensor(0.98)))
    assert float(clean[0] + clean[3]) < limit
    assert fit_pixels(torch.ones(49, 3), (d[:49], mirror[:49]), options) is None


def test_lit_from_behind_only_ambient_is_seen() -> None:
    style = style_scene(room(), striped_photo(), QUICK, light=[0.0, 500.0, 0.0])
    sound(style)
    inside = style_scene(room(), striped_photo(), QUICK, light=[-0.9, 0.35, -1.3])
    sound(inside)


def test_empty_and_degenerate_meshes_do_not_disturb() -> None:
    scene = room()
    nothing = Mesh(vertices=torch.zeros(0, 3), faces=torch.zeros(0, 3, dtype=torch.int64), name="empty")
    line = Mesh(vertices=torch.zeros(3, 3), faces=torch.tensor([[0, 1, 2]]), name="dot")
    with pytest.warns(StyleWarning, match="'dot'"):
        style = style_scene(replace(scene, meshes=(*scene.meshes, nothing, line)), striped_photo(), QUICK)
    sound(style)
    assert "empty" not in style.names


def test_far_from_the_origin_and_in_millimetres() -> None:
    plain = style_scene(room(), striped_photo(), QUICK)
    for scale, shift in ((1000.0, 0.0), (1.0, 1e5)):
        scene = room()
        moved = tuple(replace(m, vertices=m.vertices.double() * scale + shift) for m in scene.meshes)
        style = style_scene(replace(scene, meshes=moved), striped_photo(), QUICK)
        sound(style)
        if scale == 1.0:
            assert torch.allclose(style.materials[:, :6], plain.materials[:, :6], atol=0.05)


def test_lamps_keep_their_light() -> None:
    scene = room()
    materials = (*scene.materials[:-1], replace(scene.materials[-1], emission=torch.tensor([3.0, 2.0, 1.0])))
    style = style_scene(replace(scene, materials=materials), striped_photo(), QUICK)
    assert style.problem.objects.kept == ("ball",) and "ball" not in style.names
    assert [m.name for m in style.scene.materials if float(m.emission.max()) > 0] == ["ball"]
    glimmer = (*scene.materials[:-1], replace(scene.materials[-1], emission=torch.full((3,), 0.01)))
    style = style_scene(replace(scene, materials=glimmer), striped_photo(), QUICK)
    new = style.scene.materials[style.scene.meshes[-1].material]
    assert "ball" in style.names and new.emission.tolist() == pytest.approx([0.01] * 3)
    assert new.diffuse.tolist() != scene.materials[-1].diffuse.tolist()
