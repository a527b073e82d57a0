"""The page on which photos are marked: mouse, touch, strokes, sliders, files."""

from __future__ import annotations

import io
import json
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image as PilImage

from browser_stage import Service, says
from torchrender.photo.fog import parse_marks

PHONE = {"viewport": {"width": 390, "height": 780}, "has_touch": True, "is_mobile": True, "device_scale_factor": 2}
DESKTOP = {"viewport": {"width": 1100, "height": 720}, "accept_downloads": True}
AT_REST = """() => window.torchrenderFog.idle
    && (window.torchrenderFog.facts || document.querySelector("#message").dataset.kind === "error")"""
WAIT_MS = 90_000
Open = Callable[..., "Marking"]


class Marking:
    """The page with a photo of some size: sky, a house, ground."""

    def __init__(self, context: Any, url: str, size: tuple[int, int]) -> None:
        self.page, self.context, self.problems = context.new_page(), context, []
        self.page.on("pageerror", lambda error: self.problems.append(str(error)))
        self.page.on("console", lambda line: line.type in ("error", "warning") and self.problems.append(line.text))
        self.page.goto(url + "fog.html")
        self.size = size
        self.give("#photo-file", "holiday.png", picture(*size))
        self.page.wait_for_function("() => window.torchrenderFog?.photo", timeout=WAIT_MS)

    def give(self, field: str, name: str, data: bytes) -> None:
        """Choose a file."""
        self.page.set_input_files(field, {"name": name, "mimeType": "", "buffer": data} | _kind(name))

    def press(self, text: str) -> None:
        self.page.get_by_role("button", name=text, exact=True).click()

    def at(self, name: str) -> Any:
        """A property of ``window.torchrenderFog``."""
        return self.page.evaluate(f"() => window.torchrenderFog.{name}")

    def place(self, pixel: list[float]) -> tuple[float, float]:
        """Where a pixel of the photo is on the screen."""
        x, y = self.page.evaluate("(p) => window.torchrenderFog.toClient(p)", pixel)
        return x, y

    def drag(self, pixels: list[list[float]]) -> None:
        """With the mouse, from pixel to pixel of the photo."""
        first, *rest = map(self.place, pixels)
        self.page.mouse.move(*first)
        self.page.mouse.down()
        for place in rest:
            self.page.mouse.move(*place, steps=4)
        self.page.mouse.up()

    def settle(self) -> None:
        """Until a picture of all changes is there."""
        self.page.wait_for_function(AT_REST, timeout=WAIT_MS)
        assert self.at("facts"), self.page.locator("#message").inner_text()

    def shown(self) -> np.ndarray[Any, Any]:
        """The preview (H,W,3) uint8."""
        return np.array(
            self.page.evaluate("""() => {
            const image = document.querySelector("#picture");
            const [w, h] = [image.naturalWidth, image.naturalHeight];
            const draw = Object.assign(document.createElement("canvas"), { width: w, height: h }).getContext("2d");
            draw.drawImage(image, 0, 0);
            const data = draw.getImageData(0, 0, w, h).data;
            return Array.from({ length: h }, (_, y) => Array.from({ length: w }, (_, x) =>
                Array.from(data.subarray(4 * (y * w + x), 4 * (y * w + x) + 3))));
        }""")
        )

    def saved(self, button: str) -> tuple[str, bytes]:
        """What a button downloads: name and content."""
        with self.page.expect_download(timeout=WAIT_MS) as waiting:
            self.press(button)
        return waiting.value.suggested_filename, Path(waiting.value.path()).read_bytes()


def _kind(name: str) -> dict[str, str]:
    return {"mimeType": "image/png" if name.endswith(".png") else "application/octet-stream"}


def picture(width: int, height: int) -> bytes:
    """A sky, a house and a meadow, with a little grain."""
    pixels = np.full((height, width, 3), (150, 180, 225), np.uint8)
    pixels[height // 2 :] = (70, 110, 60)
    pixels[height // 4 : 3 * height // 5, width // 3 : 2 * width // 3] = (120, 60, 45)
    pixels += np.random.default_rng(1).integers(0, 9, pixels.shape, np.uint8)
    file = io.BytesIO()
    PilImage.fromarray(pixels).save(file, "PNG")
    return file.getvalue()


@pytest.fixture
def marking(browser: Any, service: Service) -> Iterator[Open]:
    contexts = []

    def begin(size: tuple[int, int] = (160, 120), context: dict[str, Any] | None = None) -> Marking:
        contexts.append(browser.new_context(**(context or DESKTOP)))
        return Marking(contexts[-1], service.url, size)

    yield begin
    for made in contexts:
        made.close()


def test_a_room_is_marked_with_the_mouse_and_saved(marking: Open) -> None:
    page = marking()
    says(page.page, "#message", "Mark the room")
    page.press("Room")
    before = page.at("marks")["room"]["corners"]
    start = before["back_left_floor"]
    page.drag([start, [start[0] - 6, start[1] + 4]])
    corners = page.at("marks")["room"]["corners"]
    assert corners["back_left_floor"] == pytest.approx([start[0] - 6, start[1] + 4], abs=0.2)
    assert {k: v for k, v in corners.items() if k != "back_left_floor"} == {
        k: v for k, v in before.items() if k != "back_left_floor"
    }
    page.press("Undo")
    assert page.at("marks")["room"]["corners"] == before
    page.press("Redo")
    page.press("Light")
    page.settle()
    assert list(page.at("facts")["lights"]) == ["light[0]"]
    assert page.page.locator(".fitted").count() >= 4, "the box that was found is drawn"
    foggy = page.shown()
    name, data = page.saved("Save marks")
    marks = parse_marks(data, name)
    assert (
        name == "holiday.toml" and marks.indoor and len(marks.lights) == 1 and (marks.width, marks.height) == (160, 120)
    )
    # Fewer metres of sight: paler, and the same again when the file comes back.
    page.page.locator("#visibility").fill("20")
    page.settle()
    assert np.abs(page.shown().astype(int) - foggy).mean() > 3
    page.give("#photo-file", "holiday.png", picture(160, 120))
    page.page.wait_for_function("() => !window.torchrenderFog.marks?.room")
    page.give("#marks-file", name, data)
    page.page.wait_for_function("() => window.torchrenderFog.marks.light")
    page.page.locator("#visibility").fill("50")
    page.settle()
    assert np.abs(page.shown().astype(int) - foggy).mean() < 0.5
    assert not page.problems


def test_outlines_are_changed_corner_by_corner(marking: Open) -> None:
    page = marking()
    page.press("Room")
    page.press("Window")
    mark = page.at("marks")["window"][0]
    (x0, y0), (x1, y1) = mark["polygon"][:2]
    page.drag([[(x0 + x1) / 2, (y0 + y1) / 2], [(x0 + x1) / 2, y0 - 5]])
    grown = page.at("marks")["window"][0]
    assert len(grown["polygon"]) == len(grown["lit"]) == 5, "a window and its lit floor keep the same corners"
    assert grown["polygon"][1] == pytest.approx([(x0 + x1) / 2, y0 - 5], abs=0.3)
    page.page.keyboard.press("ArrowRight")
    assert page.at("marks")["window"][0]["polygon"][1][0] == pytest.approx(grown["polygon"][1][0] + 1)
    page.press("Remove corner")
    assert page.at("marks")["window"][0]["polygon"] == mark["polygon"]
    x, y = np.mean(mark["polygon"], axis=0).tolist()
    page.drag([[x, y], [x + 7, y + 3]])
    moved = np.array(page.at("marks")["window"][0]["polygon"])
    assert moved - np.array(mark["polygon"]) == pytest.approx(np.tile([7, 3], (4, 1)), abs=0.3)
    page.page.locator('[data-field="sun"]').uncheck()
    assert "lit" not in page.at("marks")["window"][0]
    page.page.keyboard.press("Shift+Delete")
    assert "window" not in page.at("marks")
    # What the service refuses is said, and the page goes on.
    page.press("Light")
    page.page.locator('[data-field="wall"]').select_option("front")
    page.page.wait_for_function("() => document.querySelector('#message').dataset.kind === 'error'", timeout=WAIT_MS)
    says(page.page, "#message", "front of the room")
    page.press("Undo")
    page.settle()
    assert page.page.locator("#message").get_attribute("data-kind") == "note"


def test_a_few_strokes_label_a_photo(marking: Open) -> None:
    page = marking((240, 160))
    page.page.locator("#kind button[value=outdoors]").click()
    page.press("Paint")
    parts = {"ground": [[20, 140], [220, 140]], "thing 1": [[100, 60], [140, 80]], "sky": [[30, 20], [210, 30]]}
    for name, line in parts.items():
        page.press(name)
        page.drag(line)
    page.page.wait_for_function(
        "() => window.torchrenderFog.marks.region?.some((r) => r.label === 'sky')", timeout=WAIT_MS
    )
    page.settle()
    regions = page.at("marks")["region"]
    assert sorted({r["label"] for r in regions}) == ["ground", "sky", "vertical"]
    house = np.array(next(r for r in regions if r["label"] == "vertical")["polygon"])
    assert [*house.min(axis=0), *house.max(axis=0)] == pytest.approx([80, 40, 160, 96], abs=4)
    name, data = page.saved("Save picture")
    assert name == "holiday-fog.png"
    full = np.array(PilImage.open(io.BytesIO(data))).astype(int)
    assert full.shape == (160, 240, 3) and np.abs(full - page.shown()).mean() < 3, "the preview shows what is saved"
    page.page.locator("#marks-kind").select_option("json")
    assert len(json.loads(page.saved("Save marks")[1])["region"]) == len(regions)
    assert not page.problems


def test_sliders_are_followed_live(marking: Open) -> None:
    page = marking((640, 480))
    page.press("Room")
    page.press("Window")
    page.settle()
    for k in range(8):
        count = page.at("stats")["shown"]
        page.page.locator("#visibility").fill(str(30 + 5 * k))
        page.page.wait_for_function(f"() => window.torchrenderFog.stats.shown > {count}", timeout=WAIT_MS)
    # Many moves at once are not all computed, and the last one is shown.
    asked = page.at("stats")["asked"]
    for k in range(20):
        page.page.locator("#asymmetry").fill(str(4 * k))
    page.settle()
    assert page.at("stats")["asked"] - asked < 20 and page.at("stats")["errors"] == 0


def test_fingers_mark_on_a_phone(marking: Open) -> None:
    page = marking(context=PHONE)
    assert page.page.evaluate("() => document.documentElement.scrollWidth <= window.innerWidth")
    page.page.locator("button[data-make=room]").tap()
    touch = page.context.new_cdp_session(page.page)

    def fingers(kind: str, *places: tuple[float, float]) -> None:
        points = [{"x": x, "y": y, "id": k} for k, (x, y) in enumerate(places)]
        touch.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": points})

    start = page.at("marks")["room"]["corners"]["back_right_floor"]
    x, y = page.place(start)
    fingers("touchStart", (x, y))
    for k in range(1, 5):
        fingers("touchMove", (x + 5 * k, y + 2 * k))
    assert page.page.locator("#loupe").is_visible(), "what the finger hides is shown beside it"
    fingers("touchEnd")
    assert page.page.locator("#loupe").is_hidden()
    moved = page.at("marks")["room"]["corners"]["back_right_floor"]
    assert page.place(moved) == pytest.approx((x + 20, y + 8), abs=1.0)
    a, b = page.place([40, 60]), page.place([120, 60])
    fingers("touchStart", a, b)
    for k in range(1, 5):
        fingers("touchMove", (a[0] - 10 * k, a[1]), (b[0] + 10 * k, b[1]))
    fingers("touchEnd")
    wider = page.place([120, 60])[0] - page.place([40, 60])[0]
    assert wider == pytest.approx(b[0] - a[0] + 80, rel=0.05), "two fingers zoom"
    assert page.at("marks")["room"]["corners"]["back_right_floor"] == moved
    for name in ("#tools", "#stage", "#panel"):
        box = page.page.locator(name).bounding_box()
        assert box and box["x"] >= 0 and box["x"] + box["width"] <= 390 and box["height"] > 30
    page.settle()
    assert not page.problems
