"""What programs wait for that show scenes with ``tr.show``: rows of docs/results/thin-client.md.

``python tests/benchmarks/python_views.py`` prints them.
"""

from __future__ import annotations

import statistics
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import numpy as np
import torch

import torchrender as tr
from browser_stage import FLAGS, JPEG_READY, camera_of, find_chromium
from torchrender.rays import RayCaster

SIZE = (640, 360)
RUNS = 7
SIDE = 316
"""Of a grid of vertices: 99,856."""
CLICKS = 200
ROWS = ["what", "goal", "median", "worst"]
REVISION = "() => window.torchrender?.keyframes[0]?.revision ?? 0"
SHOWN = """(before) => {
    const frame = () => new Promise(requestAnimationFrame);
    const newer = () => (window.torchrender.keyframes[0].revision ?? 0) > before;
    window.shown = (async () => {
        while (!newer()) await frame();
        await frame();
        await frame();
        return performance.timeOrigin + performance.now();
    })();
}"""
"""Note when a newer picture is seen: the frame that it came in was drawn, and the next one is begun. In milliseconds
since 1970 by the page's clock: the program is busy with the next picture, and hears of it later."""


def hills(height: float) -> torch.Tensor:
    """(V,3) vertices of a grid of hills."""
    x, z = torch.meshgrid(*[torch.linspace(-1.0, 1.0, SIDE, dtype=torch.float64)] * 2, indexing="ij")
    return torch.stack([x, height * torch.sin(9.0 * x) * torch.cos(7.0 * z), z], dim=-1).reshape(-1, 3)


def land() -> tr.Scene:
    """A scene of that grid."""
    corner = torch.arange(SIDE * SIDE).reshape(SIDE, SIDE)
    a, b, c, d = (part.reshape(-1) for part in (corner[:-1, :-1], corner[:-1, 1:], corner[1:, 1:], corner[1:, :-1]))
    faces = torch.cat([torch.stack([a, b, c], dim=1), torch.stack([a, c, d], dim=1)])
    sun = tr.DirectionalLight(direction=(0.3, -1.0, 0.2))
    return tr.Scene(meshes=(tr.Mesh(vertices=hills(0.1), faces=faces, name="land"),), lights=(sun,), name="land")


def _opened(context: Any, scene: tr.Scene) -> tuple[Any, Any, float]:
    begin = time.monotonic()
    view = tr.show(scene, browser=False)
    page = context.new_page()
    page.goto(view.url)
    page.wait_for_function(JPEG_READY, timeout=90_000)
    return view, page, 1e3 * (time.monotonic() - begin)


def first_pixels(context: Any, scene: tr.Scene) -> list[float]:
    """Milliseconds from ``tr.show`` to the picture in a page that it opens."""
    times = []
    for _ in range(1 + RUNS):
        view, page, took = _opened(context, scene)
        times.append(took)
        page.close()
        view.close()
    return times[1:]  # the first one starts the service


def updates(context: Any) -> list[float]:
    """Milliseconds from ``view.update`` of all vertices to the picture with them in the page."""
    view, page, _ = _opened(context, land())
    times = []
    for k in range(2 + RUNS):
        page.wait_for_timeout(600)
        vertices = hills(0.1 + 0.02 * k)
        page.evaluate(SHOWN, page.evaluate(REVISION))
        begin = time.time()
        view.update(vertices=vertices)
        times.append(page.evaluate("() => window.shown") - 1e3 * begin)
    page.close()
    view.close()
    return times[2:]


def clicks(context: Any) -> tuple[int, int, float]:
    """How many random clicks there were, how many came back with something else than a ray meets, which may be nothing,
    and how far off the points of the others were at most, as a share of the depth."""
    scene = tr.load("cornell_box")
    view, page, _ = _opened(context, scene)
    heard: list[Any] = []
    view.on_pick(heard.append)
    page.wait_for_timeout(1500)
    rays = RayCaster(scene.geometry)
    random, wrong, off = np.random.default_rng(3), 0, 0.0
    for asked in range(1, CLICKS + 1):
        x, y = (int(v) for v in random.uniform((0.05 * SIZE[0], 0.15 * SIZE[1]), (0.95 * SIZE[0], 0.85 * SIZE[1])))
        camera = camera_of(page.evaluate("() => window.torchrender.camera"))
        count = len(heard)
        page.mouse.click(x, y)
        page.wait_for_function(f"() => window.torchrender.picked?.seq === {asked}")
        told = page.evaluate("() => window.torchrender.picked.triangle")
        origins, directions = (v[0] for v in camera.rays())
        row, column = y * camera.height // SIZE[1], x * camera.width // SIZE[0]
        hit = rays.first_hit(origins[row, column][None], directions[row, column][None])
        triangle = int(hit.triangle[0])
        if triangle >= 0:
            _until(lambda count=count: len(heard) > count)
        found = heard[-1] if len(heard) > count else None
        if told != triangle or (-1 if found is None else found.triangle) != triangle:
            wrong += 1
        elif found is not None:
            point = origins[row, column].double() + float(hit.t[0]) * directions[row, column].double()
            off = max(off, float((point - found.point).norm()) / found.depth)
    page.close()
    view.close()
    return CLICKS, wrong, off


def _until(holds: Callable[[], bool], seconds: float = 3.0) -> None:
    end = time.monotonic() + seconds
    while not holds() and time.monotonic() < end:
        time.sleep(0.005)


def _row(what: str, goal: str, times: list[float]) -> list[str]:
    return [what, goal, f"{statistics.median(times):.0f} ms", f"{max(times):.0f} ms"]


def rows(browser: Any) -> list[list[str]]:
    """Of the page's table."""
    context = browser.new_context(viewport={"width": SIZE[0], "height": SIZE[1]})
    made = [
        _row(f"`tr.show` to the first picture, {name}", "2000 ms", first_pixels(context, tr.load(name)))
        for name in ("cornell_box", "living_room")
    ]
    made += [
        _row("`view.update` of 99,856 vertices to the picture", "150 ms", updates(context)),
    ]
    asked, wrong, off = clicks(context)
    context.close()
    return [
        *made,
        [f"{asked} random clicks that met another triangle than a ray", "0", f"{wrong}", f"{off:.0e} of depth"],
    ]


def main() -> None:
    """See the module's description."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=find_chromium(), args=list(FLAGS))
        for row in rows(browser):
            sys.stdout.write(" | ".join(row) + "\n")
        browser.close()


if __name__ == "__main__":
    main()
