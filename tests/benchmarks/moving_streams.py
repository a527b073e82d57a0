"""What a viewer waits for and sees, by the Python client alone: docs/results/moving-streams.md.

``python tests/benchmarks/moving_streams.py [--scenes living_room,city] [--runs 5] [--write]``; ``--seconds 200`` ends a
run early, and the next goes on.
"""

from __future__ import annotations

import argparse
import os
import statistics
import sys
import time
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import NamedTuple

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import numpy as np
import torch

from browser_stage import Service, psnr
from torchrender.client import StreamClient
from torchrender.client.stream import StreamedKeyframe
from torchrender.quality.machine import machine_line
from torchrender.report.common.parts import Unfinished, parts_of
from torchrender.scene.camera import Cameras
from torchrender.wire.cameras import header_of
from torchrender_service.settings import BUILT_IN

PAGE = Path(__file__).resolve().parents[2] / "docs" / "results" / "moving-streams.md"
SIZE = (640, 360)
MOVED_S = 5.0
POSE_S = 0.05
SPEED = 0.05
"""Of the scene's diagonal per second."""
SWING_S = 3.0
"""There and back."""
FIRSTS = 5
"""Sessions whose first picture is timed."""
BREAK = 0.05
"""Share of inverse depth between two pixels from which an outline runs between them."""
STEP = 0.02
"""Of the diagonal, from the last pose of a movement to where the view stops."""


class Walk:
    """A client that swings to the right and back from where the scene's view begins."""

    def __init__(self, client: StreamClient) -> None:
        self.client, self.diagonal = client, float(client.scene["diagonal"])
        self.home = torch.linalg.inv(client.camera.camera_from_world[0].double())
        self.taken: list[StreamedKeyframe] = []

    def at(self, way: float) -> Cameras:
        """The view so far to the right, in diagonals."""
        place = self.home.clone()
        place[:3, 3] += way * self.diagonal * place[:3, 0]
        camera = self.client.camera
        return Cameras(
            camera_from_world=torch.linalg.inv(place)[None],
            intrinsics=camera.intrinsics,
            width=camera.width,
            height=camera.height,
            near=camera.near,
        )

    def receive(self, timeout_s: float) -> StreamedKeyframe | None:
        """The next keyframe, if there is one in time."""
        try:
            self.taken.append(self.client.receive(timeout_s))
        except TimeoutError:
            return None
        return self.taken[-1]

    def settle(self, camera: Cameras, told: Callable[[StreamedKeyframe], object] = id) -> list[StreamedKeyframe]:
        """Stand still there until the view is smooth; what came of exactly that view, and is told at once."""
        asked = self.client.send_pose(camera, moving=False)
        wanted = np.array(header_of(camera).world_from_camera)
        here: list[StreamedKeyframe] = []
        while not (here and here[-1].samples > 1):
            keyframe = self.client.receive(120.0, pose=asked)
            if np.abs(np.array(keyframe.images[0].header.camera.world_from_camera) - wanted).max() < 1e-9:
                here.append(keyframe)
                told(keyframe)
        return here

    def move(self, seconds: float) -> float:
        """Swing; where the view is at the end, in diagonals."""
        begin = sent = time.monotonic()
        way = 0.0
        while (now := time.monotonic()) < begin + seconds:
            if now >= sent:
                passed = (now - begin) % SWING_S
                sign = 1.0 if passed < SWING_S / 2 else -1.0
                way = SPEED * min(passed, SWING_S - passed)
                speed = (sign * SPEED * self.diagonal * self.home[:3, 0]).tolist()
                self.client.send_pose(self.at(way), velocity=speed, moving=True)
                sent = now + POSE_S
            self.receive(max(0.001, sent - now))
        return way


def first_ms(url: str, scene: str) -> float:
    """From asking for a session of a loaded scene to having the first picture."""
    begin = time.monotonic()
    with StreamClient.connect(url, scene, size=SIZE, layers=0, overscan=1.2, timeout_s=180.0) as client:
        client.send_pose(client.camera, moving=False)
        client.receive(120.0)
        return 1e3 * (time.monotonic() - begin)


def rate(url: str, scene: str) -> list[str]:
    """One table row: keyframes a second while the view moves, how late they are, and what comes after a stop."""
    with StreamClient.connect(url, scene, size=SIZE, layers=0, overscan=1.2, timeout_s=180.0) as client:
        walk = Walk(client)
        walk.settle(client.camera)
        walk.move(1.0)  # how many pixels there is time for is learnt
        walk.taken.clear()
        way = walk.move(MOVED_S)
        late = statistics.median(k.latency_ms for k in walk.taken)
        size = statistics.fmean(k.bytes for k in walk.taken) / 1000
        count = len(walk.taken)
        stopped, rested = time.monotonic(), []
        walk.settle(walk.at(way), lambda keyframe: rested.append((time.monotonic() - stopped, keyframe)))
        times = [next(t for t, k in rested if k.still), rested[-1][0]]
    first = statistics.median(first_ms(url, scene) for _ in range(FIRSTS))
    waits = [f"{t:.1f} s" for t in times]
    return [scene, f"{count / MOVED_S:.1f}", f"{late:.0f} ms", f"{size:.0f} kB", *waits, f"{first:.0f} ms"]


def _beside(count: int) -> tuple[range, range]:
    return range(count - 1), range(1, count)


class Likeness(NamedTuple):
    """PSNR in dB of the last picture of a movement and of what comes at rest."""

    first: float  # against the first picture at rest
    outlines: float  # the same, beside steps of depth alone
    mirrors: float  # the same, where something mirrors, alone
    smooth: float  # against the smooth picture at rest
    rest: float  # of the first picture at rest against the smooth one


def fidelity(url: str, scene: str) -> Likeness:
    """The last picture of a movement and those at rest of the same view."""
    with StreamClient.connect(url, scene, size=SIZE, layers=0, overscan=1.2, timeout_s=180.0) as client:
        walk = Walk(client)
        walk.settle(client.camera)
        way = walk.move(MOVED_S)
        here = walk.settle(walk.at(way + STEP))
        walk.settle(client.camera)  # another session begins with the light of the last view at rest: not with this one
    moving, still = next(k for k in here if not k.still), next(k for k in here if k.still)
    shown, first, smooth = (k.images[0].codes.numpy() for k in (moving, still, here[-1]))
    inverse = 1.0 / still.images[0].depth.numpy()
    steps = np.zeros(inverse.shape, dtype=bool)
    for axis in (0, 1):
        low, high = (np.take(inverse, rows, axis) for rows in _beside(inverse.shape[axis]))
        differs = np.abs(high - low) > BREAK * np.maximum(high, low)
        steps |= np.pad(differs, [(0, int(k == axis)) for k in (0, 1)])
        steps |= np.pad(differs, [(int(k == axis), 0) for k in (0, 1)])
    mirrors = np.zeros_like(steps) if still.mirror is None else still.mirror.known.numpy()
    everywhere = np.ones_like(steps)
    return Likeness(
        psnr(shown, first, everywhere),
        psnr(shown, first, steps),
        psnr(shown, first, mirrors) if mirrors.any() else 99.0,
        psnr(shown, smooth, everywhere),
        psnr(first, smooth, everywhere),
    )


def page(rows: Sequence[Sequence[str]], likeness: Sequence[Likeness]) -> str:
    """As Markdown."""
    rates = _table(
        ["scene", "keyframes/s", "pose to picture", "size", "first at rest", "smooth", "first of a session"], rows
    )
    names = ["", "whole picture", "beside outlines", "in mirrors", "against smooth", "first at rest against smooth"]
    runs = [[f"run {k + 1}", *(f"{value:.1f}" for value in one)] for k, one in enumerate(likeness)]
    worst = [["worst", *(f"{min(column):.1f}" for column in zip(*likeness, strict=True))]] if likeness else []
    return f"""# Streams while the view moves

Made by `python tests/benchmarks/moving_streams.py --write`: the Python client, {SIZE[0]} x {SIZE[1]} pixels, overscan
1.2, no extra layers (a keyframe counts when all its layers are there), nothing else set. {machine_line()}
The machine's load was {os.getloadavg()[0]:.1f} at the end.

## Keyframes a second, and what comes after a stop

The view swings aside by {SPEED:.0%} of the scene's diagonal a second, for {MOVED_S:g} s. Goals: 8 keyframes a second,
the smooth picture 1.5 s after stopping, the first picture of another session of a loaded scene in 800 ms
(the page's own start is not in it). The first picture at rest is made of known light; the smooth one is rendered
anew, five times, or once and four times aside of it behind panes and media.

{rates}

## Moving against still

Living room, PSNR in dB of the last picture of a movement against those at rest of the very same view, a new session
each run. Goal: 32 dB against the first one at rest. Outlines and mirrors are the hard part; the smooth
picture is the truth that both stand for.

{_table(names, [*runs, *worst])}
"""


def _table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    return "\n".join("| " + " | ".join(line) + " |" for line in [head, ["---"] * len(head), *rows])


def main() -> None:
    """See the module's description."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--scenes", default=",".join(BUILT_IN))
    parser.add_argument("--runs", type=int, default=5)
    parser.add_argument("--seconds", type=float, help="begin no part after so long; run it again to go on")
    parser.add_argument("--write", action="store_true", help="the page; else it is printed")
    given = parser.parse_args()
    scenes = [name for name in given.scenes.split(",") if name]
    parts = parts_of("moving-streams", given.seconds)
    service = Service(",".join(dict.fromkeys([*scenes, "living_room"])))
    service.start()
    try:
        rows = [parts.measured(f"rate, {scene}", partial(rate, service.url, scene)) for scene in scenes]
        runs = [
            parts.measured(f"likeness, run {k + 1}", partial(fidelity, service.url, "living_room"))
            for k in range(given.runs)
        ]
        text = page(rows, [Likeness(*run) for run in runs])
        parts.done()
    except Unfinished as early:
        sys.exit(f"unfinished: {early}")
    finally:
        service.stop()
    if given.write:
        PAGE.write_text(text)
    else:
        sys.stdout.write(text)


if __name__ == "__main__":
    main()
