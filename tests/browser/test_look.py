"""Exposure, tone curve and effects; what the page says about itself; what a click shows; files that are dropped."""

from __future__ import annotations

import struct
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import torchrender as tr
from browser_stage import COMPLETE, FRAME_MS, JPEG_READY, REFINED, Service, Visit, camera_of, says
from torchrender.wire.messages import Settings, Type

AXE = """
    () => {
        const shown = (e) => e.getClientRects().length > 0;
        const words = (e) => e.getAttribute("aria-label") || e.innerText || e.title || e.labels?.[0]?.innerText || "";
        const named = (e) => words(e).trim();
        const controls = [...document.querySelectorAll("button, select, input, a[href], [role=application]")];
        return controls.filter((e) => shown(e) && !named(e)).map((e) => e.outerHTML);
    }
"""
CONTRAST = """
    () => {
        const light = (c) => {
            const [r, g, b] = c.map((v) => (v / 255 <= 0.04045 ? v / 255 / 12.92 : ((v / 255 + 0.055) / 1.055) ** 2.4));
            return 0.2126 * r + 0.7152 * g + 0.0722 * b;
        };
        const parse = (text) => text.match(/[0-9.]+/g).map(Number);
        const over = ([r, g, b, a = 1], [R, G, B]) => [r * a + R * (1 - a), g * a + G * (1 - a), b * a + B * (1 - a)];
        const ground = (e) => {
            const stack = [];
            for (let at = e; at; at = at.parentElement) stack.unshift(parse(getComputedStyle(at).backgroundColor));
            // The worst that a scene can be behind a card: white.
            return stack.reduce((below, c) => (c.length === 4 && c[3] === 0 ? below : over(c, below)), [255, 255, 255]);
        };
        const found = [];
        for (const e of document.querySelectorAll("header *, #panel *, #brief, #help *")) {
            const own = [...e.childNodes].some((n) => n.nodeType === 3 && n.textContent.trim());
            if (!own || e.getClientRects().length === 0 || e.closest(":disabled") || e.tagName === "OPTION") continue;
            const back = ground(e);
            const [a, b] = [light(over(parse(getComputedStyle(e).color), back)), light(back)];
            const ratio = (Math.max(a, b) + 0.05) / (Math.min(a, b) + 0.05);
            if (ratio < 4.5) found.push([e.outerHTML.slice(0, 80), ratio]);
        }
        return found;
    }
"""


def brightness(visit: Visit) -> float:
    shown, covered = visit.capture()
    return float(shown[covered].mean())


def test_exposure_takes_effect_at_once_and_then_from_the_server(visit: Callable[..., Visit], service: Service) -> None:
    page = visit(layers=0)
    page.wait(REFINED)
    page.page.locator("#toggle").click()
    plain = brightness(page)
    with service.held():
        page.page.locator("#exposure").fill("-20")
        page.rest()
        assert brightness(page) < 0.75 * plain, "without a new keyframe"
    page.wait("() => window.torchrender.keyframes[0].exposure === -2")
    sent = brightness(page)
    assert sent < 0.75 * plain
    shot = tr.load("cornell_box").camera(width=320, height=180)
    image = tr.render(tr.load("cornell_box"), shot, options=tr.RenderOptions(exposure=-2.0))
    assert sent == pytest.approx(float(image.to_srgb().mean() * 255), rel=0.1)
    page.page.locator("input[value=auto][name=exposure-mode]").check(force=True)
    page.wait("() => window.torchrender.keyframes[0].exposure !== -2 && window.torchrender.keyframes[0].still")
    page.wait("() => Math.abs(window.torchrender.stats.exposure - window.torchrender.keyframes[0].exposure) < 0.01")
    assert brightness(page) > 1.2 * sent
    assert not page.problems


def test_effects_are_left_out_and_cost_nothing_then(visit: Callable[..., Visit]) -> None:
    page = visit(layers=0)
    page.wait(REFINED)
    page.page.locator("#toggle").click()
    before = page.capture()[0].astype(int)
    says(page.page, "#cost-shadows", "ms")
    page.page.locator("#effect-shadows").uncheck()
    page.wait_for_message(Type.SETTINGS, lambda it: isinstance(it, Settings) and it.off == ("shadows",))
    asked = page.messages(Type.SETTINGS)[-1].seq
    page.wait(f"() => window.torchrender.keyframes[0].settings >= {asked}")
    page.wait(REFINED)
    says(page.page, "#cost-shadows", "nothing")
    assert np.abs(page.capture()[0].astype(int) - before).mean() > 1
    page.page.locator("#effect-lights").uncheck()
    asked = asked + 1
    page.wait(f"() => window.torchrender.keyframes[0].settings >= {asked}")
    assert page.capture()[0].mean() > 5, "a scene without its light is dim, not black"


def test_a_silent_server_and_a_waiting_change_are_told(visit: Callable[..., Visit], service: Service) -> None:
    page = visit(layers=0)
    page.wait(REFINED)
    page.page.locator("#toggle").click()
    with service.held():
        page.page.locator("#tone").select_option("reinhard")
        said = "() => document.querySelector('#status').innerText"
        page.wait(f"{said}.includes('waiting for the tone curve')", 4000)
        page.wait(f"{said}.includes('no answer')", 6000)
        assert page.page.locator("#status").get_attribute("data-state") == "bad"
        assert float(page.page.locator("#status-time").inner_text().split()[-2]) >= 2.5
    page.wait("() => window.torchrender.keyframes[0].tone_map === 'reinhard'")
    page.wait("() => document.querySelector('#status').dataset.state === 'live'", 20_000)


def test_stretched_pixels_are_counted(visit: Callable[..., Visit], service: Service) -> None:
    page = visit(layers=0)
    page.wait(REFINED)
    page.page.wait_for_timeout(400)
    assert page.state("stats")["stretched"] < 0.01
    with service.held():
        page.hold("KeyD", 1.2)
        page.page.wait_for_timeout(500)
        stats = page.state("stats")
        assert stats["holes"] > 0.001
        assert page.state("stats")["age_ms"] > 1000
        says(page.page, "#brief", "stretched")


def test_a_click_names_what_is_there(visit: Callable[..., Visit]) -> None:
    page = visit(layers=0)
    page.wait(REFINED)
    page.page.mouse.click(100, 110)
    page.wait("() => window.torchrender.picked")
    picked = page.state("picked")
    scene = tr.load("cornell_box")
    seen = tr.rasterize(scene, camera_of(page.state("camera")))
    assert picked["triangle"] == int(seen.triangle[0, 110, 100])
    assert np.abs(np.array(picked["point"]) - seen.position[0, 110, 100].numpy()).max() < 1e-9
    assert page.page.locator("#picked").inner_text().startswith(picked["name"])


def text_files() -> list[dict[str, Any]]:
    obj = b"mtllib look.mtl\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nusemtl red\nf 1 2 3\nf 1 3 4\n"
    mtl = b"newmtl red\nKd 0.8 0.1 0.1\n"
    return [
        {"name": "square.obj", "mimeType": "text/plain", "buffer": obj},
        {"name": "look.mtl", "mimeType": "text/plain", "buffer": mtl},
        {"name": "notes.txt", "mimeType": "text/plain", "buffer": b"not of the scene"},
    ]


def points_file() -> dict[str, Any]:
    head = b"ply\nformat binary_little_endian 1.0\nelement vertex 500\nproperty float x\nproperty float y\n"
    head += b"property float z\nproperty uchar red\nproperty uchar green\nproperty uchar blue\nend_header\n"
    rows = np.random.default_rng(1).normal(size=(500, 3))
    rows /= np.linalg.norm(rows, axis=1, keepdims=True)
    body = b"".join(struct.pack("<3f3B", *row, 40, 200, 90) for row in rows)
    return {"name": "ball.ply", "mimeType": "application/octet-stream", "buffer": head + body}


def test_files_become_scenes_and_go_again(visit: Callable[..., Visit]) -> None:
    page = visit(layers=0)
    page.wait(JPEG_READY)
    for files, name, channel in ((text_files(), "square", 0), ([points_file()], "ball", 1)):
        page.page.locator("#add").click()
        page.page.locator("#upload-files").set_input_files(files)
        page.wait(f"() => document.querySelector('#upload-text').innerText.startsWith('{name}')", FRAME_MS)
        page.wait("() => !document.querySelector('#upload').open")  # the scene is what was asked for
        if name == "square":
            says(page.page, "#upload-report", "not used: file notes.txt")
            says(page.page, "#notice", "not used: file notes.txt")
        else:
            says(page.page, "#notice", "points")
        page.wait(COMPLETE)
        page.wait("() => window.torchrender.scene === document.querySelector('#scene').value")
        page.wait("() => window.torchrender.controls === 'orbit' && window.torchrender.keyframes.length > 0")
        shown, covered = page.capture()
        tint = shown[covered].astype(int)
        assert (tint[:, channel] > tint[:, 2 - 2 * (channel == 1)] + 20).mean() > 0.02, f"{name} in its colour"
        page.page.locator("#add").click()
        page.page.locator("#upload-delete").click()
        page.wait("() => document.querySelector('#upload-text').innerText === 'deleted'")
        page.page.locator("#upload-close").click()
    names = page.page.locator("#scene option").all_inner_texts()
    assert sorted(names) == ["cornell box", "living room"]
    page.page.locator("#add").click()
    page.page.locator("#upload-files").set_input_files([text_files()[1]])
    page.wait("() => document.querySelector('#upload-text').innerText.includes('None of these files')")
    # A picture may be asked for while its scene is being deleted.
    assert not [p for p in page.problems if "404" not in p and "the scene was deleted" not in p]


@pytest.mark.parametrize("size", [(390, 844), (1280, 720)])
def test_everything_has_a_name_and_can_be_read(visit: Callable[..., Visit], size: tuple[int, int]) -> None:
    page = visit(context={"viewport": {"width": size[0], "height": size[1]}, "reduced_motion": "reduce"}, layers=0)
    page.wait(JPEG_READY)
    page.page.locator("#toggle").click()
    page.page.wait_for_timeout(300)
    assert page.page.evaluate(AXE) == []
    assert page.page.evaluate(CONTRAST) == []
    for name in ("#scene", "#status", "#add", "#toggle", "#panel"):
        box = page.page.locator(name).bounding_box()
        assert box and box["x"] >= 0 and box["x"] + box["width"] <= size[0]
    assert page.page.evaluate("() => document.documentElement.scrollWidth <= window.innerWidth")
    assert page.page.evaluate("() => getComputedStyle(document.querySelector('#status i')).animationName") == "none"
