"""Marks and photos that fog must survive: swapped, reversed, crossing, outside, empty, cut off by the camera."""

from __future__ import annotations

import warnings
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from PIL import Image
from torch import Tensor

from torchrender.errors import InputError, SceneFileError
from torchrender.images.files import read_image
from torchrender.photo.fog import FogMedium, FogOptions, FogPhoto, FogWarning, parse_marks
from torchrender.photo.fog.marks.file import marks_of
from torchrender.photo.fog.marks.records import CameraMark, RoomMark, crosses_itself
from torchrender.photo.fog.room.calibrate import calibrate, lift
from torchrender.photo.fog.room.sun import cast

W, H = 160, 120
QUICK = FogOptions(paths=4, bounces=1, columns=8, steps=8)
THIN = FogMedium.of(visibility=12.0, asymmetry=0.3)
ROOM = {
    "camera": {"focal": 140.0, "height": 1.5},
    "room": {"corners": {"back_left_floor": [40, 90], "back_right_floor": [120, 90], "back_left_ceiling": [40, 40],
                         "back_right_ceiling": [120, 40]}},
}  # fmt: skip
LIGHT = {"polygon": [[70, 20], [90, 20], [85, 30], [75, 30]], "wall": "ceiling"}
FRAME = [[5, 40], [25, 46], [25, 70], [5, 76]]
SUN = torch.nn.functional.normalize(torch.tensor([0.8, -0.9, -0.2], dtype=torch.float64), dim=0)
SKY = {"region": [{"label": "sky", "polygon": [[0, 0], [W, 0], [W, 50], [0, 50]]}]}


def _window() -> dict[str, Any]:
    """A window on the left, and where the sun through it meets the floor."""
    found = calibrate(RoomMark(**ROOM["room"]), CameraMark(**ROOM["camera"]), W, H)  # type: ignore[arg-type]
    lit = cast(lift(found, FRAME, "left", "window"), SUN, 0.0)  # type: ignore[arg-type]
    return {"polygon": FRAME, "wall": "left", "lit": found.camera.project(lit)[0][0].tolist()}


WINDOW = _window()


def photo() -> Tensor:
    return 0.2 + 0.3 * torch.rand(H, W, 3, generator=torch.Generator().manual_seed(0))


def room(options: FogOptions = QUICK, picture: Tensor | None = None, **more: Any) -> FogPhoto:
    return FogPhoto(photo() if picture is None else picture, marks_of({**ROOM, **more}), options)


def holds(fog: FogPhoto, medium: FogMedium = THIN) -> Tensor:
    """The composite, after what must hold for every photo in every medium."""
    made = fog.foggy(medium)
    for name, low, high in (("transmittance", 0.0, 1.0), ("scattered", 0.0, 1e4), ("composite", 0.0, 1e4)):
        value = getattr(made, name)
        assert bool(torch.isfinite(value).all()) and low <= float(value.min()) and float(value.max()) <= high, name
    return made.composite


def test_lit_corners_in_any_order_give_one_shaft() -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        truth = room(window=[WINDOW])
    assert truth.room is not None and truth.room.sun_fit is not None and truth.room.shafts is not None
    shown = holds(truth)
    lit = WINDOW["lit"]
    orders = {"reversed": lit[::-1], "shifted": lit[1:] + lit[:1], "crossing": [lit[1], lit[0], lit[2], lit[3]]}
    for name, order in orders.items():
        with pytest.warns(FogWarning, match="another order"):
            found = room(window=[{**WINDOW, "lit": order}])
        assert torch.allclose(holds(found), shown, atol=1e-5), name


def test_outlines_that_cross_themselves_are_named() -> None:
    bow = [[5, 40], [25, 70], [25, 46], [5, 76]]
    for key, mark in (
        ("light", {"polygon": bow}),
        ("window", {"polygon": bow}),
        ("cuboid", {"base": bow, "height": 1}),
    ):
        with pytest.raises(SceneFileError, match=rf"{key}\[0\].*crosses itself"):
            marks_of({**ROOM, key: [mark]})
    assert crosses_itself(tuple(map(tuple, bow))) and not crosses_itself(tuple(map(tuple, WINDOW["polygon"])))
    # Where only pixels are meant an outline may cross itself: what strokes leave does.
    region = marks_of({"region": [{"label": "sky", "polygon": bow}]})
    holds(FogPhoto(photo(), region, QUICK))


def test_swapped_sides_fit_no_room_or_are_put_right() -> None:
    corners = ROOM["room"]["corners"]
    swapped = {
        k.replace("floor", "x").replace("ceiling", "floor").replace("x", "ceiling"): v for k, v in corners.items()
    }
    with pytest.raises(InputError, match="corners"):
        room(room={"corners": swapped})
    above = {**WINDOW, "lit": [[60, 20], [75, 24], [70, 28], [58, 24]]}
    with pytest.raises(InputError, match=r"window\[0\] lit does not lie on the floor"):
        room(window=[above])


@pytest.mark.parametrize("side", [(-70, 0), (0, -200), (4000, 10)])
def test_lights_outside_the_photo_shine_into_it(side: tuple[int, int]) -> None:
    moved = [[x + side[0], y + side[1]] for x, y in LIGHT["polygon"]]
    try:
        fog = room(light=[{"polygon": moved, "wall": "ceiling"}])
    except InputError as error:
        assert "light[0]" in str(error)
        return
    holds(fog)


def test_empty_marks_are_named() -> None:
    for table, text in (
        ({"light": [{"polygon": []}], **ROOM}, "at least 3 points"),
        ({"light": [{}], **ROOM}, "light"),
        ({"room": {"corners": {}}}, "at least 4 marked corners"),
        ({"light": [LIGHT]}, "need a room"),
        ({"region": [{"label": "sky", "polygon": [[1, 1], [2, 2], [3, 3]]}]}, "no area"),
    ):
        with pytest.raises(SceneFileError, match=text):
            marks_of(table)
    assert parse_marks(b"", "empty.toml") == parse_marks(b"{}", "empty.json")
    with pytest.raises(InputError, match="needs labels or regions"):
        FogPhoto(photo(), parse_marks(b"", "empty.toml"))
    with pytest.warns(FogWarning, match=r"region\[0\] lies outside"):
        holds(
            FogPhoto(
                photo(), marks_of({"region": [{"label": "sky", "polygon": [[900, 1], [990, 1], [990, 50]]}]}), QUICK
            )
        )


def test_a_room_without_any_light_is_lit_from_everywhere() -> None:
    made = room().foggy(THIN)
    assert float(made.scattered.mean()) > 0.01
    dark = room(replace(QUICK, ambient=False)).foggy(THIN)
    assert float(dark.scattered.max()) == 0.0 and bool((dark.transmittance < 1).all())


def test_saturated_lamps_stay_lamps() -> None:
    picture = photo()
    picture[20:31, 70:91] = 1.0
    lamp = {"at": [80, 60], "radius": 5.0, "distance": 2.0}
    picture[55:65, 75:85] = 1.0
    plain = room(light=[LIGHT], lamp=[lamp], picture=picture)
    made = plain.foggy(THIN)
    assert float(made.composite[25, 80].min()) > 0.5, "it is dimmed on its way to the eye alone"
    brighter = room(replace(QUICK, highlights=2.0), light=[LIGHT], lamp=[lamp], picture=picture).foggy(THIN)
    eye = torch.exp(-THIN.extinction[0] * 2.0)
    assert float(made.transmittance[59, 79, 0]) == pytest.approx(float(eye), rel=0.02), "of the lamp, not of the wall"
    change = (brighter.composite - made.composite)[..., 0]
    assert float(change[24, 80]) > 0.2 and float(change[59, 79]) > 0.2
    assert float(change[100:, :40].abs().max()) == 0.0, "what was not cut off stays"
    holds(plain)


def test_white_and_black_photos() -> None:
    for value in (0.0, 1.0):
        flat = torch.full((H, W, 3), value)
        holds(room(light=[LIGHT], window=[WINDOW], picture=flat))
        holds(FogPhoto(flat, marks_of(SKY), QUICK))


def test_a_light_seen_edge_on_is_named_or_shines() -> None:
    thin = {"polygon": [[70, 39.9], [90, 39.9], [90, 40.0], [70, 40.0]], "wall": "ceiling"}
    try:
        holds(room(light=[thin]))
    except InputError as error:
        assert "light[0]" in str(error)


def test_the_camera_may_stand_in_a_shaft() -> None:
    wide = {**WINDOW, "lit": [[20, 400], [150, 400], [110, 95], [60, 94]]}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", FogWarning)
        fog = room(window=[wide])
    holds(fog)
    assert fog.room is not None and fog.room.shafts is not None


@pytest.mark.parametrize("medium", [FogMedium.of(scattering=20.0), FogMedium.of(visibility=1e6),
                                    FogMedium.of(scattering=[0.0, 0.1, 2.0], absorption=[1.0, 0.0, 0.0]),
                                    FogMedium.of(scattering=0.5, asymmetry=0.9)])  # fmt: skip
def test_media_of_every_kind(medium: FogMedium) -> None:
    holds(room(light=[LIGHT], window=[WINDOW]), medium)
    holds(
        FogPhoto(photo(), marks_of(SKY)),
        medium,
    )


@pytest.mark.parametrize("kind", ["grey", "grey 16", "alpha", "turned", "colour"])
def test_files_of_every_kind(kind: str, tmp_path: Path) -> None:
    """8 and 16 bits, grey, alpha, and a camera that was held upright: the same fog on the same scene."""
    codes = (np.indices((H, W)).sum(0) % 200 + 20).astype(np.uint8)
    path = tmp_path / "photo.png"
    if kind == "grey 16":
        Image.fromarray(codes.astype(np.uint16) * 257).save(path)
    elif kind == "alpha":
        Image.fromarray(np.dstack([codes] * 3 + [np.full_like(codes, 90)])).save(path)
    elif kind == "turned":
        exif = Image.Exif()
        exif[0x0112] = 6  # turn by 90 degrees, clockwise, to look at it
        Image.fromarray(np.dstack([np.rot90(codes)] * 3)).save(path, exif=exif)
    else:
        Image.fromarray(codes if kind == "grey" else np.dstack([codes] * 3)).save(path)
    picture = read_image(path)
    assert picture.shape[:2] == (H, W)
    made = room(light=[LIGHT], picture=picture).foggy(THIN).composite
    plain = torch.from_numpy(codes).float()[..., None] / 255
    wanted = room(light=[LIGHT], picture=torch.where(plain <= 0.04045, plain / 12.92, ((plain + 0.055) / 1.055) ** 2.4))
    assert torch.allclose(made[..., :3], wanted.foggy(THIN).composite[..., :3], atol=2e-3)
    if kind == "alpha":
        assert made.shape[2] == 4 and torch.allclose(made[..., 3], torch.tensor(90 / 255), atol=1e-6)


def test_gains_and_heights_are_adjusted_as_if_made_anew() -> None:
    base = room(light=[LIGHT], window=[WINDOW])
    base.foggy(THIN)
    for changes in ({"light_gain": 2.0}, {"shaft_gain": 3.0}, {"light_gain": 0.5, "shaft_gain": 0.0}):
        options = replace(QUICK, **changes)
        wanted = room(options, light=[LIGHT], window=[WINDOW]).foggy(THIN)
        found = base.adjusted(options).foggy(THIN)
        assert torch.allclose(found.composite, wanted.composite, atol=2e-4), changes
    sky = marks_of(SKY)
    outdoors = FogPhoto(photo(), sky, QUICK)
    low = replace(QUICK, top=5.0, loss="single")
    assert torch.equal(outdoors.adjusted(low).foggy(THIN).composite, FogPhoto(photo(), sky, low).foggy(THIN).composite)
    with pytest.raises(InputError, match="only top"):
        base.adjusted(replace(QUICK, steps=16))
    with pytest.raises(InputError, match="from 0"):
        base.adjusted(replace(QUICK, shaft_gain=0.0)).adjusted(QUICK)
