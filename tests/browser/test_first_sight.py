"""What somebody sees who comes by an old link, or with a small window: a scene, and nothing upon something else."""

from __future__ import annotations

import urllib.request
from collections.abc import Callable

import pytest

from browser_stage import JPEG_READY, Service, Visit, says

APART = """([names, mode]) => {
    document.body.dataset.controls = mode;
    document.querySelector('#brief').textContent = '60 fps · 1,234 ms old · 12.3 % filled · 12.3 % stretched';
    document.querySelector('#status-text').textContent = 'waiting for the renderer, 3 before';
    const boxes = names.map((name) => document.querySelector(name).getBoundingClientRect());
    const found = [];
    boxes.forEach((a, i) => boxes.slice(0, i).forEach((b, j) => {
        const beside = a.left >= b.right || b.left >= a.right;
        if (!beside && a.top < b.bottom && b.top < a.bottom) found.push([names[i], names[j]]);
    }));
    boxes.forEach((a, i) => (a.left < 0 || a.right > innerWidth) && found.push([names[i], 'the edge']));
    return found;
}"""


@pytest.mark.parametrize("wrong", [
    {"scene": "nonsense", "budget_ms": "-3", "tone": "x", "layers": "9", "controls": "fly", "off": "sun", "ev": "99"},
    {"view": "a,b"},
], ids=["settings", "view"])  # fmt: skip
def test_words_of_a_link_that_mean_nothing_are_left_out(visit: Callable[..., Visit], wrong: dict[str, str]) -> None:
    page = visit(**wrong)
    page.wait(JPEG_READY)
    assert page.state("scene") == "cornell_box"
    assert page.state("state") == "live"
    for name, value in wrong.items():
        says(page.page, "#notice", f"{name}={value}")
    page.wait("() => !['nonsense', 'budget_ms', 'view'].some((word) => location.search.includes(word))")
    # The browser notes that there is no such scene to stream.
    assert not [p for p in page.problems if "404" not in p]


def test_a_link_that_is_right_says_nothing(visit: Callable[..., Visit]) -> None:
    page = visit(budget_ms=300, tone="aces", off="shadows", ev=-1, controls="orbit", view="0.3,0.3,-0.7,0.3,0.3,0")
    page.wait(JPEG_READY)
    assert page.page.locator("#notice").is_hidden()
    assert page.state("controls") == "orbit" and page.page.locator("#tone").input_value() == "aces"


@pytest.mark.parametrize("width", [390, 620, 900, 1280])
@pytest.mark.parametrize("mode", ["walk", "orbit"])
def test_nothing_stands_on_top_of_something_else(visit: Callable[..., Visit], width: int, mode: str) -> None:
    page = visit(context={"viewport": {"width": width, "height": 700}}, layers=0)
    page.wait(JPEG_READY)
    head = [".brand", "#scene", "#status", "#add", "#toggle"]
    assert page.page.evaluate(APART, [head, mode]) == []
    assert page.page.evaluate(APART, [["#help", "#brief"], mode]) == []


@pytest.mark.parametrize(("width", "height"), [(640, 360), (390, 844), (1280, 720)])
@pytest.mark.parametrize("mode", ["walk", "orbit"])
def test_what_is_said_has_room(visit: Callable[..., Visit], width: int, height: int, mode: str) -> None:
    page = visit(context={"viewport": {"width": width, "height": height}}, layers=0)
    page.wait(JPEG_READY)
    page.page.evaluate(BUSY)
    assert page.page.evaluate(APART, [["#help", "#brief", "#picked"], mode]) == []
    inside = """() => {
      const e = document.getElementById("message"), box = e.getBoundingClientRect();
      e.hidden = false;
      e.textContent = "there is no scene '" + "d7b1b447".repeat(8) + "'";
      return e.scrollWidth <= e.clientWidth;
    }"""
    assert page.page.evaluate(inside)


@pytest.mark.parametrize("touch", [False, True], ids=["mouse", "touch"])
@pytest.mark.parametrize("mode", ["walk", "orbit"])
def test_a_frame_of_320_by_240_has_room(visit: Callable[..., Visit], touch: bool, mode: str) -> None:
    context = {"viewport": {"width": 320, "height": 240}, "has_touch": touch, "is_mobile": touch}
    page = visit(context=context, layers=0)
    page.wait(JPEG_READY)
    page.page.evaluate(BUSY)
    names = [".brand", "#scene", "#status", "#add", "#toggle", "#picked", "#notice"]
    names += ["#stick"] if touch and mode == "walk" else []
    say = """([name, text]) => {
      const e = document.querySelector(name);
      e.hidden = false;
      e.textContent = text;
    }"""
    page.page.evaluate(say, ["#notice", "The server refuses: the pose lies outside of what can be shown"])
    assert page.page.evaluate(APART, [names, mode]) == []
    page.page.evaluate(say, ["#message", "The scene living room, as it was shown, was deleted."])
    assert page.page.evaluate(APART, [[*names, "#message"], mode]) == []


def test_a_scene_that_is_deleted_goes_by_its_name(visit: Callable[..., Visit], service: Service) -> None:
    body = b'name = "crate"\n[[geometry]]\nshape = "box"\nsize = 1.0\n'
    asked = urllib.request.Request(f"{service.url}v1/scenes?name=old_crate", body, {"content-type": "application/toml"})
    with urllib.request.urlopen(asked) as answer:
        place = answer.headers["location"]
    page = visit(scene=place.rpartition("/")[2], layers=0)
    page.wait(JPEG_READY)
    page.page.wait_for_function("() => document.querySelectorAll('#scene option').length === 3")
    urllib.request.urlopen(urllib.request.Request(f"{service.url.rstrip('/')}{place}", method="DELETE"))
    says(page.page, "#message", "The scene old crate was deleted.")
    assert page.page.locator("#message").inner_text() == "The scene old crate was deleted."
    assert page.page.locator("#notice").is_hidden(), "once is enough"


PHONE = {"viewport": {"width": 390, "height": 844}, "has_touch": True, "is_mobile": True}
BUSY = """() => {
  const put = (id, text) => { const e = document.getElementById(id); e.hidden = false; e.textContent = text; };
  put("status-text", "making the refined picture");
  put("status-time", " 4.2 s");
  put("picked", "wall, 3.42 away, material 'white tiles'");
  put("brief", "60 fps, 12 ms, 1.2 MB/s, 0.3 % holes, picture 4.2 s old");
}"""


def test_a_busy_phone_has_room_for_all(visit: Callable[..., Visit]) -> None:
    page = visit(context=PHONE, layers=0)
    page.wait(JPEG_READY)
    page.page.evaluate(BUSY)
    assert page.page.evaluate(APART, [["#stick", "#picked", "#brief"], "walk"]) == []
    scene = page.page.locator("#scene").bounding_box()
    assert scene and scene["width"] > 100
    cut = "() => { const e = document.getElementById('status-text'); return e.scrollWidth > e.clientWidth; }"
    assert not page.page.evaluate(cut)


@pytest.mark.parametrize("query", [{"view": "1e30,0,0,0,0,0"}, {"scene": "nosuch", "view": "a,b"}])
def test_a_view_that_cannot_be_is_said_and_left_out(visit: Callable[..., Visit], query: dict[str, str]) -> None:
    page = visit(**query)
    page.wait(JPEG_READY)
    page.wait("() => !document.querySelector('#notice').hidden")
    assert f"view={query['view']}" in page.page.locator("#notice").inner_text()
