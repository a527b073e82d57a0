"""Rooms of photos: marks, calibration, sun, shafts, light and fog."""

from __future__ import annotations

import math
import warnings

import numpy as np
import pytest
import torch

from torchrender.errors import InputError, SceneFileError
from torchrender.photo.fog import FogMedium, FogOptions, FogPhoto, FogWarning, Marks
from torchrender.photo.fog.air import Air, held_back
from torchrender.photo.fog.indoor import known_room, with_lights
from torchrender.photo.fog.marks.file import marks_of, read_marks, table_of, write_marks
from torchrender.photo.fog.marks.records import CameraMark, RoomMark
from torchrender.photo.fog.room.calibrate import calibrate, find_focal, focal_of
from torchrender.photo.fog.room.emitters import emitter_of
from torchrender.photo.fog.room.lights import fit_lights
from torchrender.photo.fog.room.shafts import build_shafts, shaft_light, spans
from torchrender.photo.fog.room.sun import angle, cast, fit_sun, iou, mask_of, same_order
from torchrender.photo.fog.room_fog import RoomFog
from torchrender.report.fog.cornell import cornell, method, psnr, reference, wavy_grid
from torchrender.report.fog.measures import centroid_errors, halo, indirect, sun_errors
from torchrender.scene.camera import Cameras

WINDOW = torch.tensor([[0, 0.9, 0.2], [0, 0.9, 1.2], [0, 2.1, 1.2], [0, 2.1, 0.2]], dtype=torch.float64)
INTO = torch.tensor([1.0, 0.0, 0.0], dtype=torch.float64)
SUN = torch.nn.functional.normalize(torch.tensor([0.75, -0.6, 0.3], dtype=torch.float64), dim=0)
CAMERA = Cameras.look_at((2.5, 1.6, 4.5), (1.2, 0.6, 0.0), width=160, height=120, fov_deg=65.0)
ROOM = {
    "camera": {"focal": 140.0, "height": 1.5},
    "room": {"corners": {"back_left_floor": [40, 90], "back_right_floor": [120, 90], "back_left_ceiling": [40, 40],
                         "back_right_ceiling": [120, 40]}},
    "light": [{"polygon": [[70, 20], [90, 20], [85, 30], [75, 30]], "wall": "ceiling"}],
}  # fmt: skip


def room_photo(**more: object) -> tuple[torch.Tensor, Marks]:
    photo = 0.2 + 0.3 * torch.rand(120, 160, 3, generator=torch.Generator().manual_seed(0))
    return photo, marks_of({**ROOM, **more})


def test_marks_survive_their_files(tmp_path) -> None:
    _, marks = room_photo(lamp=[{"at": [3, 4], "distance": 2.0, "kind": "cone"}])
    for name in ("a.toml", "a.json"):
        write_marks(tmp_path / name, marks)
        assert table_of(read_marks(tmp_path / name)) == table_of(marks)


@pytest.mark.parametrize(
    ("table", "text"),
    [
        ({"rooms": {}}, "unknown key 'rooms'"),
        ({"light": [{"polygon": [[0, 0], [1, 0], [1, 1]]}]}, "need a room"),
        ({**ROOM, "light": [{"polygon": []}]}, "at least 3 points"),
        ({**ROOM, "light": [{"polygon": [[0, 0], [1, 1], [2, 2]]}]}, "no area"),
        ({**ROOM, "window": [{"polygon": [[0, 0], [1, 0], [1, 1]], "lit": [[0, 0], [5, 0], [5, 5], [0, 5]]}]},
         "as many"),
        ({**ROOM, "cuboid": [{"base": [[0, 0], [9, 0], [9, 9]]}]}, "either height or top"),
        ({"room": {"corners": {"somewhere": [0, 0]}}}, "room corner must be one of"),
        ({"lamp": [{"at": ["a", 1]}]}, "x, y in pixels"),
        ({"outdoor": {"near": 9.0, "far": 3.0}}, "far must be at least near"),
    ],
)  # fmt: skip
def test_bad_marks_are_named(table: dict, text: str) -> None:
    with pytest.raises(SceneFileError, match=text):
        marks_of(table)


def test_room_is_found_again_from_its_corners() -> None:
    camera = Cameras.look_at((0, 1.6, 0), (0.5, 1.3, -3.0), width=640, height=480, fov_deg=62.0)
    focal = float(camera.intrinsics[0, 0, 0])
    low, high = torch.tensor([-1.8, 0, -4.2]), torch.tensor([2.1, 2.6, -1.4])
    corners = {}
    for a, z in (("back", low[2]), ("front", high[2])):
        for b, x in (("left", low[0]), ("right", high[0])):
            for c, y in (("floor", 0.0), ("ceiling", high[1])):
                uv, _ = camera.project(torch.tensor([[float(x), float(y), float(z)]], dtype=torch.float64))
                corners[f"{a}_{b}_{c}"] = (float(uv[0, 0, 0]), float(uv[0, 0, 1]))
    found = find_focal(RoomMark(corners=corners), 640, 480, (320, 240))
    assert found == pytest.approx(focal, rel=0.01)
    room = calibrate(RoomMark(corners=corners), CameraMark(), 640, 480)
    # The world turns with the room, which is not turned here.
    assert room.error_px < 0.05
    assert torch.allclose(room.size[:2], torch.tensor([3.9, 2.6], dtype=torch.float64), atol=0.02)
    assert float(room.camera.intrinsics[0, 0, 0]) == pytest.approx(focal, rel=0.01)


def test_focal_needs_two_finite_points() -> None:
    assert focal_of(np.array([1.0, 0, 0]), np.array([0, 0, 1.0]), (0, 0)) is None
    assert focal_of(np.array([300.0, 0, 1]), np.array([-300.0, 0, 1]), (0, 0)) == pytest.approx(300.0)


def test_confused_corners_fit_no_room() -> None:
    corners = {"back_left_floor": (120, 90), "back_right_floor": (40, 30), "back_left_ceiling": (130, 95),
               "back_right_ceiling": (10, 80), "front_left_floor": (80, 10)}  # fmt: skip
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", FogWarning)
        with pytest.raises(InputError, match=r"corners"):
            calibrate(RoomMark(corners=corners), CameraMark(focal=140.0), 160, 120)


def test_angle_has_a_derivative_at_zero() -> None:
    a = torch.tensor([[0.0, -1.0, 0.0]], dtype=torch.float64, requires_grad=True)
    value = angle(a, torch.tensor([0.0, -1.0, 0.0], dtype=torch.float64))
    value.sum().backward()
    assert float(value.detach()) == 0.0 and bool(torch.isfinite(a.grad).all())


def test_exact_marks_give_the_sun() -> None:
    fit = fit_sun([(WINDOW, cast(WINDOW, SUN, 0.0))], CAMERA)
    assert math.degrees(float(angle(fit.direction[None], SUN)[0])) < 0.1
    assert fit.iou >= 0.97
    noisy = sun_errors(3)
    assert noisy["deg"] <= 2.0 and noisy["iou"] >= noisy["start_iou"] - 1e-9


def test_reversed_lit_corners_are_put_right() -> None:
    lit = cast(WINDOW, SUN, 0.0)
    with pytest.warns(FogWarning, match="another order"):
        assert torch.equal(same_order(WINDOW, lit.flip(0), "window"), lit)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert torch.equal(same_order(WINDOW, lit, "window"), lit)


def test_overlap_of_nothing_is_zero() -> None:
    behind = WINDOW + torch.tensor([0.0, 0.0, 50.0], dtype=torch.float64)
    empty = mask_of(behind, CAMERA)
    assert not empty.any() and iou(empty, empty) == 0.0


def test_flat_window_and_floor_are_no_shaft() -> None:
    flat = torch.tensor([[0, 0, 0], [1, 0, 0], [1, 0, 1]], dtype=torch.float64)
    with pytest.warns(FogWarning, match="one plane"):
        assert (
            build_shafts([(flat, flat + 0.5 * INTO, torch.tensor([0, 1.0, 0], dtype=torch.float64), "w")], SUN) is None
        )


def test_light_of_a_shaft_beside_steps() -> None:
    shafts = build_shafts([(WINDOW, cast(WINDOW, SUN, 0.0), INTO, "window")], SUN)
    assert shafts is not None
    eye = torch.tensor([2.5, 1.4, 4.0], dtype=torch.float64)
    aim = torch.tensor([[0.6, 0.8, 0.9], [1.0, 0.6, 1.0], [2.4, 1.4, 0.0], [0.9, 3.5, 0.9]], dtype=torch.float64) - eye
    way = torch.nn.functional.normalize(aim, dim=1)
    length = aim.norm(dim=1) + 1.0
    medium = FogMedium.of(scattering=0.4, absorption=0.1, asymmetry=0.3)
    room = torch.tensor([-0.5, -0.5, -1.0]), torch.tensor([4.0, 4.0, 5.0])
    found = shaft_light(shafts, eye, way, length, medium, Air(None, *room), 32)
    even = Air(torch.ones(2, 2, 2), *room)
    stepped = shaft_light(shafts, eye, way, length, medium, even, 400)
    assert torch.allclose(found, stepped, rtol=2e-3, atol=1e-6)
    assert float(found[0].min()) > 0 and float(found[3].max()) == 0.0
    inside = eye + way[:1] * 2.6
    begin, end, _ = spans(shafts, inside[0], way[:1], length[:1])
    assert float((end - begin).sum()) >= 0.0  # the eye may be within a shaft
    moved = build_shafts(
        [(WINDOW, cast(WINDOW, SUN, 0.0) + torch.tensor([0.3, 0, 0], dtype=torch.float64), INTO, "w")], SUN
    )
    assert moved is not None and moved.hulls[0].volume != shafts.hulls[0].volume


def test_concave_windows_are_unions_of_hulls() -> None:
    corner = torch.tensor([[0, 1, 0], [0, 1, 2], [0, 2, 2], [0, 2, 1], [0, 3, 1], [0, 3, 0]], dtype=torch.float64)
    whole = build_shafts([(corner, cast(corner, SUN, 0.0), INTO, "l")], SUN)
    assert whole is not None and len(whole.hulls) == 4
    notch = torch.tensor([[0.02, 2.7, 1.7]], dtype=torch.float64)
    assert not bool(whole.reach(notch, 0.0)[1].any())


def test_held_back_is_exact_near_zero() -> None:
    rate = torch.tensor([0.0, 1e-12, 1e-5, 0.3, -0.3], dtype=torch.float64)
    expected = torch.where(rate == 0, 2.0, -torch.expm1(-rate * 2.0) / torch.where(rate == 0, 1.0, rate))
    assert torch.allclose(held_back(rate, torch.tensor(2.0, dtype=torch.float64)), expected, rtol=1e-9)


def test_small_light_is_a_point_light() -> None:
    box = cornell(24, 18, half=1e-3, boxes=False)
    place, lamp, eye = box.seen.place, box.light.centre, box.room.camera.eye[0]
    through, _ = method(box, 0.3, False, "centroid")
    expected = torch.exp(-0.3 * ((lamp - place).norm(dim=-1) + (place - eye).norm(dim=-1)))
    lit = ~box.scene().glowing
    assert float((through[..., 0] - expected)[lit].abs().max()) < 1e-6


def test_box_beside_the_reference() -> None:
    box = cornell(32, 24)
    for varied, mean, decibel in ((False, 0.01, 45.0), (True, 0.02, 40.0)):
        truth = reference(box, 0.1, varied, samples=64, steps=32, lights=6)
        for way in ("centroid", "ratio"):
            through, added = method(box, 0.1, varied, way, columns=48, steps=40)
            error = ((through[..., 0] - truth.transmittance).abs() / truth.transmittance)[truth.lit]
            assert float(error.mean()) <= mean, (varied, way)
            assert psnr(truth.clear * through + added, truth.foggy) >= decibel
            assert bool((through >= 0).all() & (through <= 1).all() & (added >= 0).all())


def test_centroid_table_and_patches() -> None:
    rows = {
        (r["half"], r["kappa"], r["patches"]): r["mean"] for r in centroid_errors(400, (1, 2, 3)) if not r["varied"]
    }
    asked = {(0.5, 0.1): 0.002, (0.5, 0.4): 0.01, (1.0, 0.1): 0.008, (1.5, 0.4): 0.078, (2.5, 0.4): 0.16}
    for key, mean in asked.items():
        assert rows[(*key, 1)] == pytest.approx(mean, rel=0.2)
        assert rows[(*key, 1)] > rows[(*key, 2)] > rows[(*key, 3)]


def test_bounced_light_needs_the_ratio() -> None:
    for row in indirect(16, 12, 32):
        assert row["ratio"] <= 0.05 and row["centroid_bias"] > 0.1


def test_one_of_two_lights_off_is_one_light() -> None:
    box = cornell(24, 18, boxes=False)
    other = emitter_of(box.light.corners + torch.tensor([1.5, 0.0, 1.0]), "ceiling", "other", box.light.pixels)
    two = known_room(box.room, box.proxy, (box.light, other), torch.tensor([[5.0] * 3, [0.0] * 3]), box.albedo[:, 0])
    one = known_room(box.room, box.proxy, (box.light,), torch.tensor([[5.0] * 3]), box.albedo[:, 0])
    medium = FogMedium.of(scattering=0.2)
    for way in ("centroid", "patches", "ratio"):
        options = FogOptions(transmittance=way, paths=16, bounces=1)
        a, b = (RoomFog(s, options).transmittance(medium) for s in (two, one))
        assert torch.allclose(a, b, atol=1e-6), way
    both = with_lights(two, torch.tensor([[5.0] * 3, [5.0] * 3]))
    assert not torch.allclose(RoomFog(both, options).transmittance(medium), a, atol=1e-4)


def test_light_sources_lose_nothing_on_their_way() -> None:
    box = cornell(24, 18)
    scene = box.scene()
    object.__setattr__(scene, "glowing", torch.ones(18, 24, dtype=torch.bool))
    through = RoomFog(scene, FogOptions(transmittance="centroid")).transmittance(FogMedium.of(scattering=0.2))
    assert torch.allclose(through[..., 0], torch.exp(-0.2 * scene.ray_length.float()), atol=1e-6)


def test_lamp_has_a_halo() -> None:
    assert halo() >= 1.5


def test_strengths_are_found_again() -> None:
    random = torch.Generator().manual_seed(1)
    lit = torch.rand(500, 2, generator=random) * 0.8
    part = torch.randint(0, 4, (500,), generator=random)
    photo = (lit @ torch.tensor([2.0, 0.5]) * 0.6 / math.pi)[:, None].expand(-1, 3)
    found = fit_lights(lit, photo, part, 4)
    assert torch.allclose(found.strength, torch.tensor([2.0, 0.5]), rtol=0.02)


def test_no_fog_changes_nothing_and_thick_fog_hides_all() -> None:
    photo, marks = room_photo()
    fog = FogPhoto(photo, marks, FogOptions(paths=8, bounces=1))
    assert torch.equal(fog.foggy(FogMedium.of(scattering=0.0)).composite, photo)
    thick = fog.foggy(FogMedium.of(scattering=20.0))
    assert bool(torch.isfinite(thick.composite).all()) and float(thick.transmittance.max()) < 1e-3
    assert torch.allclose(thick.composite, thick.scattered, atol=1e-3)


def test_other_medium_after_a_grid_is_not_the_old_one() -> None:
    box = cornell(16, 12)
    fog = RoomFog(box.scene(), FogOptions(paths=8, bounces=0))
    even = fog.transmittance(FogMedium.of(scattering=0.1))
    uneven = fog.transmittance(FogMedium.of(scattering=0.1, density=wavy_grid(box)))
    assert not torch.allclose(even, uneven, atol=1e-3)
    assert torch.equal(fog.transmittance(FogMedium.of(scattering=0.1)), even)
