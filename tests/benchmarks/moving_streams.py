"""Streams while the view moves, by the Python client alone: docs/results/moving-streams.md.

``python tests/benchmarks/moving_streams.py [--scenes living_room,city] [--runs 5] [--write]``
"""

from __future__ import annotations

import argparse
import logging
import os
import statistics
import sys
import time
from collections.abc import Sequence
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import numpy as np
import torch

from browser_stage import Service, psnr
from torchrender.client import StreamClient
from torchrender.client.stream import StreamedKeyframe
from torchrender.quality.machine import machine_line
from torchrender.scene.camera import Cameras
from torchrender.wire.cameras import header_of
from torchrender_service.settings import BUILT_IN

LOG = logging.getLogger("moving_streams")
PAGE = Path(__file__).resolve().parents[2] / "docs" / "results" / "moving-streams.md"
SIZE = (640, 360)
MOVED_S = 5.0
POSE_S = 0.05
SPEED = 0.05
"""Of the scene's diagonal per second."""
SWING_S = 3.0
"""There and back."""
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

    def settle(self, camera: Cameras) -> list[StreamedKeyframe]:
        """Stand still there until the view is smooth; what came of exactly that view."""
        asked = self.client.send_pose(camera, moving=False)
        wanted = np.array(header_of(camera).world_from_camera)
        here: list[StreamedKeyframe] = []
        while not (here and here[-1].samples > 1):
            keyframe = self.client.receive(120.0, pose=asked)
            if np.abs(np.array(keyframe.images[0].header.camera.world_from_camera) - wanted).max() < 1e-9:
                here.append(keyframe)
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


def rate(url: str, scene: str) -> list[str]:
    """One table row: keyframes a second while the view moves, and how late they are."""
    with StreamClient.connect(url, scene, size=SIZE, layers=0, overscan=1.2, timeout_s=180.0) as client:
        walk = Walk(client)
        walk.settle(client.camera)
        walk.move(1.0)  # how many pixels there is time for is learnt
        walk.taken.clear()
        walk.move(MOVED_S)
        late = statistics.median(k.latency_ms for k in walk.taken)
        size = statistics.fmean(k.bytes for k in walk.taken) / 1000
        return [scene, f"{len(walk.taken) / MOVED_S:.1f}", f"{late:.0f} ms", f"{size:.0f} kB"]


def fidelity(url: str, scene: str) -> float:
    """PSNR in dB of the last picture of a movement against the first at rest of the same view."""
    with StreamClient.connect(url, scene, size=SIZE, layers=0, overscan=1.2, timeout_s=180.0) as client:
        walk = Walk(client)
        walk.settle(client.camera)
        way = walk.move(MOVED_S)
        here = walk.settle(walk.at(way + STEP))
        walk.settle(client.camera)  # another session begins with the light of the last view at rest: not with this one
        moving = next(k for k in here if not k.still)
        still = next(k for k in here if k.still)
        shown, wanted = (k.images[0].codes.numpy() for k in (moving, still))
        return psnr(shown, wanted, np.ones(shown.shape[:2], dtype=bool))


def page(rows: Sequence[Sequence[str]], decibels: Sequence[float]) -> str:
    """As Markdown."""
    head = ["scene", "keyframes/s", "pose to picture", "size"]
    lines = "\n".join("| " + " | ".join(line) + " |" for line in [head, ["---"] * len(head), *rows])
    runs = ", ".join(f"{value:.1f}" for value in decibels)
    return f"""# Streams while the view moves

Made by `python tests/benchmarks/moving_streams.py --write`: the Python client, {SIZE[0]} x {SIZE[1]} pixels, overscan
1.2, no extra layers (a keyframe counts when all its layers are there), nothing else set. {machine_line()}
The machine's load was {os.getloadavg()[0]:.1f} at the end.

## Keyframes a second

The view swings aside by {SPEED:.0%} of the scene's diagonal a second, for {MOVED_S:g} s. Goal: 8.

{lines}

## Moving against still

Living room, PSNR of the last picture of a movement against the first one at rest of the very same view, in
{len(decibels)} runs, a new session each. Goal: 32 dB.

{runs} dB
"""


def main() -> None:
    """See the module's description."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--scenes", default=",".join(BUILT_IN))
    parser.add_argument("--runs", type=int, default=5)
    parser.add_argument("--write", action="store_true", help="the page; else it is printed")
    given = parser.parse_args()
    logging.basicConfig(level=logging.INFO, format="%(message)s")
    scenes = [name for name in given.scenes.split(",") if name]
    service = Service(",".join(dict.fromkeys([*scenes, "living_room"])))
    service.start()
    try:
        rows = []
        for scene in scenes:
            rows.append(rate(service.url, scene))
            LOG.info("%s", rows[-1])
        decibels = []
        for _ in range(given.runs):
            decibels.append(fidelity(service.url, "living_room"))
            LOG.info("%.1f dB", decibels[-1])
        text = page(rows, decibels)
    finally:
        service.stop()
    if given.write:
        PAGE.write_text(text)
    else:
        sys.stdout.write(text)


if __name__ == "__main__":
    main()
