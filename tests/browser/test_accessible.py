"""Both pages for everybody: axe-core finds nothing, and what stands over a scene can be read whatever the scene is."""

from __future__ import annotations

import io
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from PIL import Image as PilImage

from browser_stage import FRAME_MS, JPEG_READY, Service, Visit, says

SIZES = [(390, 844), (1280, 720)]
Violations = Callable[[Any], list[str]]
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


"""Over a canvas axe-core does not know what is behind: here it is the worst that a scene can be, white."""


@pytest.mark.parametrize("size", SIZES)
def test_the_viewer_is_accessible(visit: Callable[..., Visit], violations: Violations, size: tuple[int, int]) -> None:
    page = visit(context={"viewport": {"width": size[0], "height": size[1]}, "reduced_motion": "reduce"}, layers=0)
    page.wait(JPEG_READY)
    page.wait("() => !document.querySelector('#scene').disabled && window.torchrender.walls")
    says(page.page, "#brief", "filled")
    assert violations(page.page) == []
    page.page.locator("#toggle").click()
    page.wait("() => document.querySelector('#s-drawn').textContent.includes('images')")
    assert violations(page.page) == []
    assert page.page.evaluate(CONTRAST) == []
    for name in ("#scene", "#status", "#add", "#toggle", "#panel"):
        box = page.page.locator(name).bounding_box()
        assert box and box["x"] >= 0 and box["x"] + box["width"] <= size[0]
    assert page.page.evaluate("() => document.documentElement.scrollWidth <= window.innerWidth")
    assert page.page.evaluate("() => getComputedStyle(document.querySelector('#status i')).animationName") == "none"
    page.page.locator("#add").click()
    page.wait("() => document.querySelector('#upload').open")
    assert violations(page.page) == []


@pytest.mark.parametrize("size", SIZES)
def test_the_page_of_photos_is_accessible(
    browser: Any, service: Service, violations: Violations, size: tuple[int, int]
) -> None:
    context = browser.new_context(viewport={"width": size[0], "height": size[1]})
    page = context.new_page()
    page.goto(service.url + "fog.html")
    page.wait_for_function("() => window.torchrenderFog")
    assert violations(page) == []
    file = io.BytesIO()
    PilImage.fromarray(np.full((60, 80, 3), 128, np.uint8)).save(file, "PNG")
    page.set_input_files("#photo-file", {"name": "grey.png", "mimeType": "image/png", "buffer": file.getvalue()})
    page.wait_for_function("() => window.torchrenderFog.photo", timeout=FRAME_MS)
    page.locator("button[data-make=room]").click()
    assert violations(page) == []
    context.close()
