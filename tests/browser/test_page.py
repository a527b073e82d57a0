"""The page in use: walking, settings, lost graphics, small screens, old browsers."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from browser_stage import ARRIVED, COMPLETE, JPEG_READY, REFINED, Service, Visit, says
from torchrender.wire.messages import CREDITS, Pose, Type

PHONE = {"viewport": {"width": 390, "height": 780}, "has_touch": True, "is_mobile": True, "device_scale_factor": 2}


def eye(visit: Visit) -> np.ndarray[Any, Any]:
    return np.array(visit.state("camera")["world_from_camera"]).reshape(4, 4)[:3, 3]


def axes(visit: Visit) -> np.ndarray[Any, Any]:
    """Columns: right, down, forward."""
    return np.array(visit.state("camera")["world_from_camera"]).reshape(4, 4)[:3, :3]


def test_keys_walk_and_look(visit: Callable[..., Visit]) -> None:
    page = visit()
    page.wait(COMPLETE)
    start, turned, before = eye(page), axes(page), page.capture()[0]
    page.hold("KeyW")
    step = eye(page) - start
    assert step @ turned[:, 2] > 0
    assert abs(step[1]) < 1e-9, "walking stays level"
    page.hold("Space")
    assert eye(page)[1] > start[1]
    page.hold("KeyD")
    assert (eye(page) - start - step) @ turned[:, 0] > 0
    page.hold("ArrowRight")
    assert axes(page)[:, 2] @ turned[:, 0] > 0.1
    shown, _ = page.capture()
    assert np.abs(shown.astype(int) - before).mean() > 3
    page.page.keyboard.press("Home")
    page.rest()
    assert np.abs(eye(page) - start).max() == 0
    assert not page.problems


def test_dragging_turns_as_if_it_held_the_scene(visit: Callable[..., Visit]) -> None:
    page = visit()
    page.wait(COMPLETE)
    view, before = page.state("camera"), axes(page)
    page.page.mouse.move(200, 90)
    page.page.mouse.down()
    page.page.mouse.move(140, 110, steps=4)
    page.page.mouse.up()
    page.rest()
    after = axes(page)
    # A pixel of the drag is a pixel of the picture: to the left means to look right, downwards to look up.
    pitch = math.asin(after[1, 2]) - math.asin(before[1, 2])
    assert pitch == pytest.approx(20 / view["fy"], rel=0.02)
    yaw = math.atan2(after[:, 2] @ before[:, 0], after[:, 2] @ before[:, 2])
    assert yaw == pytest.approx(60 / view["fx"], rel=0.05)
    assert np.abs(after.T @ after - np.eye(3)).max() < 1e-9


def test_new_keyframes_follow_the_view(visit: Callable[..., Visit]) -> None:
    page = visit()
    page.wait(COMPLETE)
    first = page.state("keyframes")[0]["id"]
    page.hold("KeyW", 0.6)
    page.wait(ARRIVED)
    newest = page.state("keyframes")[0]
    assert newest["id"] > first
    assert page.capture()[1].all(), "a refined keyframe of the view itself covers it"
    poses = page.messages(Type.POSE)
    assert [pose.seq for pose in poses if isinstance(pose, Pose)] == list(range(1, len(poses) + 1))
    times = np.diff([pose.time_ms for pose in poses if isinstance(pose, Pose)])
    assert times.min() > 30, "poses are sent at most twenty times a second"
    assert any(np.linalg.norm(pose.velocity) > 0 for pose in poses if isinstance(pose, Pose))
    page.wait_for_message(Type.ACK, lambda ack: ack.id == newest["id"])


def test_settings_reach_the_server(visit: Callable[..., Visit]) -> None:
    page = visit()
    page.wait(JPEG_READY)
    page.page.evaluate("() => { window.loaded = 1; document.querySelector('#toggle').click(); }")
    choose = "element => element.click()"
    page.page.locator("input[value=budget]").evaluate(choose)
    page.page.locator("#bound").fill("20")
    page.page.locator("#layers").fill("3")
    asked = 15 * (2000 / 15) ** 0.2
    page.wait_for_message(
        Type.SETTINGS, lambda it: it.layers == 3 and it.max_error is None and abs(it.budget_ms - asked) <= 1
    )
    page.page.locator("input[value=error]").evaluate(choose)
    page.wait_for_message(
        Type.SETTINGS, lambda it: it.layers == 3 and it.budget_ms is None and it.max_error is not None
    )
    page.wait("() => window.torchrender.keyframes[0].layers === 4")
    for place, text in (("0", "0.0 ×"), ("50", "1.0 ×"), ("100", "100 ×"), ("75", "10 ×")):
        page.page.locator("#density").fill(place)
        assert page.page.locator("#density-value").inner_text() == text
    page.wait_for_message(Type.SETTINGS, lambda it: it.density == pytest.approx(10) and it.asymmetry is None)
    page.page.locator("#asymmetry").fill("-40")
    page.wait_for_message(
        Type.SETTINGS, lambda it: it.density == pytest.approx(10) and it.asymmetry == pytest.approx(-0.4)
    )
    assert page.page.evaluate("() => window.loaded") == 1, "fog changes without another load of the page"
    rows = page.page.locator("#plan tr").all_inner_texts()
    assert len(rows) >= 2 and "together" in rows[-1]  # of known light, or pass by pass
    assert page.page.locator("#plan").inner_text().count("ms") >= 1


def test_another_scene(visit: Callable[..., Visit]) -> None:
    page = visit()
    page.wait(JPEG_READY)
    names = page.page.locator("#scene option").all_inner_texts()
    assert sorted(names) == ["cornell box", "living room"]
    page.page.locator("#scene").select_option("living_room")
    page.wait("() => window.torchrender.scene === 'living_room' && window.torchrender.keyframes.length > 0")
    assert page.state("state") == "live"
    assert not page.problems


def test_a_lost_context_comes_back(visit: Callable[..., Visit]) -> None:
    page = visit()
    page.wait(REFINED)
    before = page.capture()[0]
    page.page.evaluate("""() => {
        const gl = document.querySelector("#stage").getContext("webgl2");
        window.lose = gl.getExtension("WEBGL_lose_context");
        window.lose.loseContext();
    }""")
    page.wait("() => document.querySelector('#message').innerText.includes('graphics')")
    page.page.evaluate("() => window.lose.restoreContext()")
    page.wait("() => document.querySelector('#message').hidden")
    page.rest()
    assert (page.capture()[0] == before).all()


def test_a_browser_without_webgl2_is_told(browser: Any, service: Service) -> None:
    context = browser.new_context()
    context.add_init_script("""
        const get = HTMLCanvasElement.prototype.getContext;
        HTMLCanvasElement.prototype.getContext = function (kind, ...rest) {
            return kind.startsWith("webgl") ? null : get.call(this, kind, ...rest);
        };
    """)
    page = context.new_page()
    page.goto(service.url)
    page.wait_for_function("() => !document.querySelector('#message').hidden")
    says(page, "#message", "WebGL2")
    context.close()


def test_a_phone(visit: Callable[..., Visit]) -> None:
    page = visit(context=PHONE, width=180, height=320)
    page.wait(COMPLETE)
    assert page.page.evaluate("() => document.documentElement.scrollWidth <= window.innerWidth")
    assert page.page.locator("#stick").is_visible()
    for name in ("#scene", "#status", "#toggle"):
        box = page.page.locator(name).bounding_box()
        assert box and box["x"] >= 0 and box["x"] + box["width"] <= 390
    touch = page.page.context.new_cdp_session(page.page)

    def drag(start: tuple[float, float], end: tuple[float, float], rest: float = 0.0) -> None:
        touch.send("Input.dispatchTouchEvent", {"type": "touchStart", "touchPoints": [{"x": start[0], "y": start[1]}]})
        for k in range(1, 5):
            point = {"x": start[0] + (end[0] - start[0]) * k / 4, "y": start[1] + (end[1] - start[1]) * k / 4}
            touch.send("Input.dispatchTouchEvent", {"type": "touchMove", "touchPoints": [point]})
        page.page.wait_for_timeout(1000 * rest)
        touch.send("Input.dispatchTouchEvent", {"type": "touchEnd", "touchPoints": []})
        page.rest()

    before = axes(page)
    drag((200, 300), (120, 300))
    assert axes(page)[:, 2] @ before[:, 0] > 0.02, "a finger turns the view"
    start, forward = eye(page), axes(page)[:, 2]
    box = page.page.locator("#stick").bounding_box()
    assert box
    middle = (box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    drag(middle, (middle[0], middle[1] - 40), rest=0.4)
    assert (eye(page) - start) @ forward > 0, "the stick walks"
    page.page.locator("#toggle").tap()
    panel = page.page.locator("#panel").bounding_box()
    assert panel and panel["x"] == 0 and panel["width"] == 390 and panel["y"] > 200, (
        "the panel leaves room for the scene"
    )
    assert not page.problems


def test_frames_go_on_while_keyframes_are_made(visit: Callable[..., Visit], service: Service) -> None:
    """Walking is drawn at the browser's pace, not at the server's, which is held here."""
    page = visit(scene="living_room", layers=1)
    page.wait(COMPLETE)
    with service.held():
        page.page.keyboard.down("KeyW")
        before = page.state("stats")
        page.wait(f"() => window.torchrender.stats.drawn >= {before['drawn'] + 8}")
        page.page.keyboard.up("KeyW")
        page.rest()
        assert page.state("stats")["keyframes"] <= before["keyframes"] + CREDITS, "at most what was under way"
    page.wait(ARRIVED)
    assert page.state("stats")["keyframes"] > before["keyframes"]
    assert page.page.evaluate("() => window.torchrender.measure(3)") > 0


def test_shape_is_enhanced_without_a_new_keyframe(visit: Callable[..., Visit]) -> None:
    page = visit(layers=0)
    page.wait(REFINED)
    page.rest()
    asked = len(page.messages(Type.SETTINGS)), page.keyframe_count
    plain, covered = page.capture()
    made, still = page.capture(enhance=0.8)
    assert np.array_equal(covered, still)
    change = made.astype(int) - plain
    assert np.abs(change).mean() > 1, "it shows"
    assert (change > 3).any() and (change < -3).any(), "ridges get brighter, valleys darker"
    page.page.get_by_role("button", name="Details").click()
    page.page.locator("#enhance").fill("80")
    says(page.page, "#enhance-value", "80 %")
    page.rest()
    assert (len(page.messages(Type.SETTINGS)), page.keyframe_count) == asked, "the server hears nothing of it"
    again, _ = page.capture()
    assert np.array_equal(again, plain)
    assert not page.problems
