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

LISTEN = """
    () => {
        const status = document.querySelector("#status");
        window.said = [];
        const note = () => window.said.push([status.textContent, status.dataset.state]);
        new MutationObserver(note).observe(status, {
            subtree: true, childList: true, characterData: true, attributes: true,
        });
    }
"""
"""Everything that the status says from now on, with its kind: a busy machine may skip what a test waits for."""


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
    page.wait(REFINED)
    says(page.page, "#cost-lights", "for others")  # what the surroundings light is shaded by the same pass
    assert page.capture()[0].mean() > 5, "a scene without its light is dim, not black"


def test_a_silent_server_and_a_waiting_change_are_told(visit: Callable[..., Visit], service: Service) -> None:
    page = visit(layers=0)
    page.wait(REFINED)
    page.page.locator("#toggle").click()
    page.page.evaluate(LISTEN)
    with service.held():
        page.page.locator("#tone").select_option("reinhard")
        page.wait("() => window.said.some(([text]) => text.includes('no answer'))")
    page.wait("() => window.torchrender.keyframes[0].tone_map === 'reinhard'")
    page.wait("() => document.querySelector('#status').dataset.state === 'live'")
    told = page.page.evaluate("() => window.said")
    assert any("waiting for the tone curve" in text for text, _ in told), told
    silence = [(text, kind) for text, kind in told if "no answer" in text]
    assert all(kind == "bad" and float(text.split()[-2]) >= 2.5 for text, kind in silence), silence


def test_stretched_pixels_are_counted(visit: Callable[..., Visit], service: Service) -> None:
    page = visit(layers=0)
    page.wait(REFINED)
    page.wait("() => window.torchrender.stats.stretched !== null")
    assert page.state("stats")["stretched"] < 0.01
    with service.held():
        page.hold("KeyD", 1.2)
        page.wait("() => window.torchrender.stats.holes > 0.001")
        page.wait("() => window.torchrender.stats.age_ms > 1000")
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
    for number, row in enumerate((98, 104, 109), 2):  # k / 180 * 180 is a little less than k
        page.page.mouse.click(100, row)
        page.wait(f"() => window.torchrender.picked.seq === {number}")
        off = np.array(page.state("picked")["point"]) - seen.position[0, row, 100].numpy()
        assert np.abs(off).max() < 1e-9, f"row {row}"


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
