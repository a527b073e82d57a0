"""Moving about: walls, orbit, the wheel, named cameras, going home, and views that travel as text."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import torchrender as tr
from browser_stage import COMPLETE, JPEG_READY, Visit, camera_of, says
from torchrender.cli.arguments import camera_of as camera_of_words

WALLS = "() => window.torchrender?.walls"
FOLLOW = """
    () => {
        window.eyes = [];
        const note = () => {
            const { world_from_camera: m } = window.torchrender.camera;
            window.eyes.push([m[3], m[7], m[11]]);
            requestAnimationFrame(note);
        };
        note();
    }
"""
"""Where the eye is, in every frame from now on."""


def eye(visit: Visit) -> np.ndarray[Any, Any]:
    return np.array(visit.state("camera")["world_from_camera"]).reshape(4, 4)[:3, 3]


def forward(visit: Visit) -> np.ndarray[Any, Any]:
    return np.array(visit.state("camera")["world_from_camera"]).reshape(4, 4)[:3, 2]


def test_no_flick_of_the_wheel_leaves_the_room(visit: Callable[..., Visit]) -> None:
    page = visit(scene="living_room", layers=0)
    page.wait(JPEG_READY)
    page.wait(WALLS)
    low, high = tr.load("living_room").bounds.numpy()
    page.page.mouse.move(160, 90)
    for way in (-1, 1):
        for _ in range(4):
            page.page.mouse.wheel(0, way * 6750)
        page.rest()
        assert (eye(page) > low).all() and (eye(page) < high).all()
        assert page.capture()[1].mean() > 0.02, "something of what was there is still seen"
    page.page.keyboard.press("Home")
    page.rest()
    shown, covered = page.capture()
    assert covered.mean() > 0.99, "the start is shown at once"
    assert shown.std() > 20
    assert not page.problems


def test_the_wheel_glides(visit: Callable[..., Visit]) -> None:
    page = visit()
    page.wait(COMPLETE)
    page.page.mouse.move(160, 90)
    page.page.evaluate(FOLLOW)
    page.page.mouse.wheel(0, -300)
    page.wait("() => window.eyes.some((eye) => String(eye) !== String(window.eyes[0]))")
    page.rest()
    places = np.array(page.page.evaluate("() => window.eyes"))
    steps = np.linalg.norm(np.diff(places, axis=0), axis=1)
    assert (steps > 0).sum() >= 2, "in several frames"
    assert (places[-1] - places[0]) @ forward(page) > 0


def test_an_object_is_orbited(visit: Callable[..., Visit]) -> None:
    page = visit(controls="orbit", layers=0)
    page.wait(COMPLETE)
    assert page.state("controls") == "orbit"
    before, way = eye(page), forward(page)
    page.page.mouse.move(160, 90)
    page.page.mouse.down()
    page.page.mouse.move(220, 90, steps=4)
    page.page.mouse.up()
    page.rest()
    # Both central rays meet where the middle of the scene is as far ahead as it was.
    normals = np.stack([way, -forward(page)], axis=1)
    along, *_ = np.linalg.lstsq(normals, eye(page) - before, rcond=None)
    gap = before + along[0] * way - (eye(page) + along[1] * forward(page))
    assert np.linalg.norm(gap) < 1e-6 * along[0]
    assert along[0] == pytest.approx(along[1], rel=1e-6), "as far away as before"
    assert np.degrees(np.arccos(way @ forward(page))) == pytest.approx(60, abs=2), "60 of 180 pixels: a third of a turn"
    page.hold("KeyW")
    assert np.linalg.norm(eye(page) - (before + along[0] * way)) < 0.95 * along[0], "nearer"
    page.page.keyboard.press("Home")
    page.rest()
    assert (eye(page) == before).all()


def test_named_cameras_and_keyboard_alone(visit: Callable[..., Visit]) -> None:
    page = visit(layers=0)
    page.wait(COMPLETE)
    page.wait(WALLS)
    start = eye(page)
    page.page.locator("#toggle").focus()
    page.page.keyboard.press("Enter")
    page.page.locator("#cameras").focus()
    page.page.keyboard.press("ArrowDown")
    page.wait("() => document.querySelector('#cameras').value === 'close'")
    scene = tr.load("cornell_box")
    expected = scene.camera("close", width=320, height=180)
    found = camera_of(page.state("camera"))
    assert np.abs((found.camera_from_world - expected.camera_from_world).numpy()).max() < 1e-6
    page.page.locator("#home").focus()
    page.page.keyboard.press("Space")
    page.rest()
    assert (eye(page) == start).all()
    page.page.keyboard.press("Escape")
    assert page.page.locator("#panel").is_hidden()
    assert page.page.evaluate("() => document.activeElement.id") == "toggle"


def same_address(one: str, other: str) -> bool:
    """But for the last digits of numbers, which go through the camera and back."""
    number = re.compile(r"-?\d+\.\d+")
    ours, theirs = (np.array([float(v) for v in number.findall(url)]) for url in (one, other))
    return number.sub("#", one) == number.sub("#", other) and bool(np.allclose(ours, theirs, atol=1e-5))


def test_a_reload_shows_what_was_shown(visit: Callable[..., Visit]) -> None:
    page = visit(layers=1)
    page.wait(JPEG_READY)
    page.hold("KeyW")
    page.page.locator("#toggle").click()
    page.page.locator("#enhance").fill("40")
    page.page.locator("#tone").select_option("aces")
    page.page.locator("#effect-shadows").uncheck()
    page.wait("() => location.search.includes('off=shadows') && location.search.includes('view=')")
    before, address = page.state("camera"), page.page.url
    page.page.reload()
    page.wait(JPEG_READY)
    after = page.state("camera")
    assert np.abs(np.subtract(before["world_from_camera"], after["world_from_camera"])).max() < 1e-5
    assert page.page.locator("#enhance").input_value() == "40"
    assert page.page.locator("#tone").input_value() == "aces"
    assert not page.page.locator("#effect-shadows").is_checked()
    assert page.state("keyframes")[0]["tone_map"] == "aces", "the first picture has it already"
    page.page.wait_for_timeout(600)
    assert same_address(page.page.url, address)


def test_a_view_as_python_and_as_a_command(visit: Callable[..., Visit]) -> None:
    page = visit(context={"permissions": ["clipboard-read", "clipboard-write"]}, layers=0)
    page.wait(JPEG_READY)
    page.hold("KeyD")
    page.page.locator("#toggle").click()
    copied = {}
    for name in ("link", "python", "command"):
        page.page.locator(f"#copy-{name}").click()
        says(page.page, f"#copy-{name}", "copied")
        copied[name] = page.page.evaluate("() => navigator.clipboard.readText()")
    seen = camera_of(page.state("camera"))
    lines = copied["python"].splitlines()
    assert lines[-1].startswith("tr.render(scene, camera)")
    made: dict[str, Any] = {}
    exec("\n".join(lines[:-1]), made)
    assert made["scene"].name == tr.load("cornell_box").name
    words = copied["command"].split()
    assert words[:3] == ["torchrender", "render", "cornell_box"]
    at = words.index("--camera")
    named = camera_of_words(made["scene"], words[at + 1 : at + 4], 320, 180)
    for camera in (made["camera"], named):
        assert np.abs((camera.camera_from_world - seen.camera_from_world).numpy()).max() < 1e-5
        assert np.abs((camera.intrinsics - seen.intrinsics).numpy()).max() < 1e-3
    other = visit()
    other.page.goto(copied["link"])
    other.wait(JPEG_READY)
    assert np.abs(eye(other) - eye(page)).max() < 1e-5
