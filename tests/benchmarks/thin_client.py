"""Figures and pictures of the thin client in headless Chromium: docs/results/thin-client.md and docs/client-*.png.

``python tests/benchmarks/thin_client.py [--pictures | --figures] [--scenes living_room,city] [--budget 500]``;
``--seconds 200`` ends a run early, and the next goes on.
"""

from __future__ import annotations

import argparse
import logging
import os
import statistics
import sys
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import numpy as np
import python_views

from browser_stage import (
    ARRIVED,
    COMPLETE,
    FLAGS,
    REFINED,
    Relay,
    Service,
    Visit,
    camera_of,
    find_chromium,
    grown,
    moved,
    pictures_of,
    psnr,
    reprojected,
)
from browser_surface import drawn_exactly, page_image
from torchrender.quality.machine import machine_line
from torchrender.report.common.parts import Parts, Unfinished, parts_of
from torchrender_service.settings import BUILT_IN

LOG = logging.getLogger("thin_client")
DOCS = Path(__file__).resolve().parents[2] / "docs"
SIZE = (320, 180)
BASELINES = (0.02, 0.05)
STEP = 0.041  # of the typical depth; a round share puts outlines of the Cornell box exactly on centres of pixels
WAYS = {"right": (1, 0, 0), "left": (-1, 0, 0), "up": (0, -1, 0), "ahead": (0, 0, 1)}
DESKTOP = {"viewport": {"width": 1280, "height": 720}}
PHONE = {"viewport": {"width": 390, "height": 844}, "has_touch": True, "is_mobile": True, "device_scale_factor": 2}
SHOT_MS = 280_000
"""For what a picture waits for: software draws both sides of it."""
DEVICES: dict[str, dict[str, Any]] = {"desktop": DESKTOP, "phone": PHONE}


AGREEMENT = ["scene", "still", "keyframe alone, SwiftShader", "unrounded", "two extra layers, SwiftShader", "unrounded"]


def open_scene(browser: Any, url: str, scene: str, size: tuple[int, int], layers: int) -> Visit:
    """A page that shows a scene, refined and complete."""
    context = browser.new_context(viewport={"width": size[0], "height": size[1]})
    visit = Visit.begin(context, url, scene=scene, layers=layers, width=size[0], height=size[1])
    visit.wait(REFINED)
    return visit


def agreement(browser: Any, service: Service, scene: str) -> list[str]:
    """One table row: identity, and the Python reprojection with layer 0 alone and with all layers, each drawn twice."""
    visit = open_scene(browser, service.url, scene, SIZE, 2)
    messages = visit.layers(visit.state("keyframes")[0]["id"])
    pictures = pictures_of(messages)
    images = [page_image(visit.page, *pair) for pair in zip(messages, pictures, strict=True)]
    view, depth = visit.state("camera"), pictures[0].depth
    codes = pictures[0].codes.numpy()
    shown, covered = visit.capture(earlier=False, layers=False, fill=False, direct=False)
    top, left = (codes.shape[0] - shown.shape[0]) // 2, (codes.shape[1] - shown.shape[1]) // 2
    picture = codes[top : top + shown.shape[0], left : left + shown.shape[1]]
    row = [scene, f"{psnr(shown, picture, covered):.1f}"]
    step = STEP * float(depth[depth.isfinite()].median())
    for count in (1, len(pictures)):
        values: list[list[float]] = [[], []]
        for way in WAYS.values():
            there = moved(view, *(step * w for w in way))
            expected, valid = reprojected(pictures[:count], camera_of(there))
            shown = visit.capture(camera=there, earlier=False, layers=count > 1, fill=False)
            for k, (color, covered) in enumerate((shown, drawn_exactly(images[:count], camera_of(there)))):
                values[k].append(psnr(color, expected, ~grown(~(covered & valid))))
        row += [f"{min(drawn):.1f} to {max(drawn):.1f}" for drawn in values]
    visit.page.context.close()
    return row


def holes(browser: Any, service: Service, scene: str) -> list[list[str]]:
    """Table rows: hole shares of the mean over directions, by baseline and number of layers."""
    shares: dict[float, list[float]] = {baseline: [] for baseline in BASELINES}
    for layers in (0, 1, 2, 4):
        visit = open_scene(browser, service.url, scene, SIZE, layers)
        depth = pictures_of(visit.layers(visit.state("keyframes")[0]["id"]))[0].depth
        typical, view = float(depth[depth.isfinite()].median()), visit.state("camera")
        for baseline in BASELINES:
            views = [moved(view, *(baseline * typical * w for w in way)) for way in WAYS.values()]
            open_ = [1 - visit.capture(camera=there, earlier=False)[1].mean() for there in views]
            shares[baseline].append(float(np.mean(open_)))
        visit.page.context.close()
    rows = []
    for baseline, values in shares.items():
        ratio = values[0] / values[-1] if values[-1] > 0 else float("inf")
        rows.append([scene, f"{baseline:.0%}", *(f"{100 * v:.2f} %" for v in values), f"{ratio:.1f}"])
    return rows


def costs(browser: Any, service: Service) -> list[list[str]]:
    """Table rows: what a frame costs, by size."""
    rows = []
    for size in ((320, 180), (640, 360), (1280, 720)):
        visit = open_scene(browser, service.url, "living_room", size, 2)
        one = [visit.page.evaluate("() => window.torchrender.measure(5, {layers: false})") for _ in range(5)]
        every = [visit.page.evaluate("() => window.torchrender.measure(5)") for _ in range(5)]
        stats = visit.state("stats")
        row = [f"{size[0]} x {size[1]}", str(stats["quads"]), f"{statistics.median(one):.1f} ms"]
        rows.append([*row, f"{statistics.median(every):.1f} ms", f"{stats['decode_ms']:.0f} ms"])
        visit.page.context.close()
    return rows


def delays(browser: Any, service: Service) -> list[list[str]]:
    """Table rows: frames per second while walking, by round trip."""
    rows = []
    for trip in (0, 20, 100, 250):
        relay = Relay(service.port, trip / 2000)
        visit = open_scene(browser, relay.url, "cornell_box", SIZE, 1)
        before = visit.state("stats")
        visit.page.keyboard.down("ArrowRight")
        visit.page.wait_for_timeout(4000)
        after = visit.state("stats")
        visit.page.keyboard.up("ArrowRight")
        counts = [(after[name] - before[name]) / 4 for name in ("drawn", "keyframes")]
        rows.append([f"{trip} ms", f"{counts[0]:.0f}", f"{counts[1]:.1f}", f"{after['latency_ms']:.0f} ms"])
        visit.page.context.close()
        relay.close()
    return rows


def table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """As Markdown."""
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines) + "\n"


def figures(browser: Any, service: Service, scenes: Sequence[str], parts: Parts) -> str:
    """The page."""
    agreed, open_ = [], []
    for scene in scenes:
        agreed.append(parts.measured(f"{scene}, agreement", partial(agreement, browser, service, scene)))
        open_ += parts.measured(f"{scene}, holes", partial(holes, browser, service, scene))
    frames = parts.measured("what a frame costs", partial(costs, browser, service))
    rates = parts.measured("frame rate against delay", partial(delays, browser, service))
    programs = parts.measured("views of programs", partial(python_views.rows, browser))
    load = os.getloadavg()[0]
    return f"""# The thin client, measured

Made by `python tests/benchmarks/thin_client.py --figures` in headless Chromium with software rendering (SwiftShader),
{SIZE[0]} x {SIZE[1]} pixels unless stated, overscan 1.2, refined keyframes. {machine_line()}
The machine's load was {load:.1f} at the end.

## Against the source picture and the Python reprojection

PSNR in dB over display colours. *Still*: the view of the keyframe itself, goal 50. The others: steps of
{STEP:.1%} of the typical depth to the right, left, up and ahead against the Python client's reprojection of the same
depth images, off holes (pixels beside a hole of either are left out), goal 40. *SwiftShader* is what Chromium shows
here: it places corners on a grid of 1/16 pixel (SUBPIXEL_BITS = 4), which shifts outlines by up to 1/32 pixel, and
where a picture consists of outlines (grass, tree) that alone costs more than the goal allows. *Unrounded* are the same
quads of the page, drawn without that rounding; graphics cards round to 1/256.

{table(AGREEMENT, agreed)}
## Holes

Share of pixels that no sample reaches, mean of the four steps, by length of the step (share of the typical depth) and
number of non-redundant extra layers, before earlier keyframes and filling help. Goal: halved.

{table(["scene", "step", "no layer", "1", "2", "4", "none / 4"], open_)}
## What a frame costs

Living room, warp and filling, drawn and waited for; the machine renders with two cores and no graphics card. Decoding
runs in a worker and includes checksum, zstd, prediction, quads and colour.

{table(["picture", "quads", "keyframe alone", "two extra layers", "decoding, each image"], frames)}
## Frame rate against delay

Turning in the Cornell box for four seconds while the server renders on the same cores.

{table(["round trip", "frames/s drawn", "keyframes/s", "pose to picture"], rates)}
## Views of programs

`tr.show` in a program, and its page in a browser that runs already, on the same cores, {python_views.SIZE[0]} x
{python_views.SIZE[1]} pixels; a grid of hills for the update, timed by the page. The last row: wrong clicks of those in
the page, and how far the points of the right ones lay from where a ray meets the triangle. By itself:
`python tests/benchmarks/python_views.py`.

{table(python_views.ROWS, programs)}"""


def _walked(visit: Visit) -> None:
    """There and on: keyframes of the way have come."""
    for _ in range(2):
        visit.hold("KeyW", 0.5)
        visit.page.wait_for_timeout(2500)


def _moving(visit: Visit, path: Path) -> None:
    visit.page.keyboard.down("KeyD")
    visit.page.wait_for_timeout(350)
    visit.page.screenshot(path=path)
    visit.page.keyboard.up("KeyD")


def _still(visit: Visit, path: Path) -> None:
    visit.rest()
    visit.wait(ARRIVED, SHOT_MS)
    if visit.page.locator("#panel").is_visible():
        visit.page.evaluate("() => document.querySelector('#toggle').click()")
    visit.page.wait_for_timeout(1500)
    visit.page.screenshot(path=path)


def _panel(visit: Visit, path: Path) -> None:
    if not visit.page.locator("#panel").is_visible():
        visit.page.evaluate("() => document.querySelector('#toggle').click()")
    visit.page.wait_for_timeout(1500)
    visit.page.screenshot(path=path)


def screenshots(browser: Any, service: Service, devices: Sequence[str], shots: Sequence[str], **wishes: Any) -> None:
    """A session in the living room on each device: moving, still, and with the panel."""
    for name in devices:
        context = browser.new_context(**DEVICES[name])
        visit = Visit.begin(context, service.url, scene="living_room", **wishes)
        visit.page.set_default_timeout(SHOT_MS)
        visit.wait(COMPLETE, SHOT_MS)
        LOG.info("%s: the first picture is there", name)
        _walked(visit)
        for shot in shots:
            SHOTS[shot](visit, DOCS / f"client-{name}{'' if shot == 'still' else '-' + shot}.png")
            LOG.info("%s, %s: %s", name, shot, visit.state("stats"))
        context.close()


SHOTS = {"moving": _moving, "still": _still, "panel": _panel}


def main() -> None:
    """See the module's description."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--pictures", action="store_true", help="screenshots only")
    parser.add_argument("--figures", action="store_true", help="figures only")
    parser.add_argument("--devices", default=",".join(DEVICES), help="of which there are pictures")
    parser.add_argument("--shots", default=",".join(SHOTS), help="which pictures, in this order")
    parser.add_argument("--layers", type=int, default=2, help="extra layers in the pictures")
    parser.add_argument("--scenes", default=",".join(BUILT_IN))
    parser.add_argument("--seconds", type=float, help="begin no part after so long; run it again to go on")
    parser.add_argument("--budget", type=float, help="milliseconds of a keyframe in the pictures; default: automatic")
    given = parser.parse_args()
    logging.basicConfig(level=logging.INFO, format="%(message)s")
    from playwright.sync_api import sync_playwright

    parts = parts_of("thin-client", given.seconds)
    service = Service(",".join(BUILT_IN))
    service.start()
    unfinished = ""
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=find_chromium(), args=list(FLAGS))
        if not given.figures:
            wishes = {"layers": given.layers} | ({} if given.budget is None else {"budget_ms": given.budget})
            screenshots(browser, service, given.devices.split(","), given.shots.split(","), **wishes)
        if not given.pictures:
            try:
                text = figures(browser, service, given.scenes.split(","), parts)
                (DOCS / "results" / "thin-client.md").write_text(text)
                parts.done()
            except Unfinished as early:
                unfinished = f"unfinished: {early}"
        browser.close()
    service.stop()
    if unfinished:
        sys.exit(unfinished)


if __name__ == "__main__":
    main()
