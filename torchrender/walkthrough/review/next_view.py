"""Where the next photo should be taken: the view that shows most of what is missing, made up or coarse."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch

from torchrender.checks import check_class
from torchrender.errors import InputError
from torchrender.scene.camera import Cameras
from torchrender.walkthrough.draw import FILLED, NOTHING, draw_walkthrough
from torchrender.walkthrough.model import Walkthrough

SIZE = (80, 60)
OVERLAP = 0.4
"""Share of a view that must be known, so that a photo taken there can be joined to the others; less counts less."""

COARSE = 2.0
"""Pixels per side that a sample fills from which on it counts as coarse."""


@dataclass(frozen=True, eq=False)
class NextView:
    """A view worth a photo."""

    camera: Cameras
    score: float  # share of its pixels that would be new
    missing: float  # share that shows nothing
    filled: float  # share that was made up
    near_photo: int  # the photo that it was taken from by turning and stepping


def next_views(walkthrough: Walkthrough, count: int = 1, *, seed: int = 0, candidates: int = 160) -> list[NextView]:
    """The ``count`` best views, best first.

    Candidates stand where photos were taken, or a step aside within what the photos looked through, and look in all
    directions. A pixel counts 1 if it shows nothing, 0.7 if it shows texels that were made up, up to 0.3 if its samples
    are coarse. Views of which little is known count less, because nothing would tell where the photo was taken; so do
    views that are close to a better one.

    Raises:
        InputError: the walkthrough has no cameras, or nothing in it.
    """
    check_class("walkthrough", walkthrough, Walkthrough)
    base = walkthrough.cameras
    if base is None or not len(base):
        raise InputError("the walkthrough does not know the cameras of its photos")
    if not walkthrough.planes and not len(walkthrough.points):
        raise InputError("the walkthrough is empty")
    rng = np.random.default_rng(seed)
    found = []
    fov = 2 * np.degrees(np.arctan(base.height / (2 * float(base.intrinsics[0, 1, 1]))))
    step = 0.05 * walkthrough.diagonal
    for _ in range(candidates):
        n = int(rng.integers(len(base)))
        eye = base.eye[n].numpy() + rng.normal(size=3) * step * np.array([1.0, 0.3, 1.0])
        if not _free(walkthrough, base, n, eye):
            eye = base.eye[n].numpy()
        yaw, pitch = rng.uniform(-np.pi, np.pi), rng.normal() * 0.35
        forward = np.array([np.sin(yaw) * np.cos(pitch), np.sin(pitch), np.cos(yaw) * np.cos(pitch)])
        camera = Cameras.look_at(
            eye, eye + forward, width=SIZE[0], height=SIZE[1], fov_deg=float(np.clip(fov, 20, 100)),
            near=1e-3 * walkthrough.diagonal,
        )  # fmt: skip
        found.append(_score(walkthrough, camera, n))
    chosen: list[NextView] = []
    while found and len(chosen) < count:
        best = max(found, key=lambda v: v.score * _apart(v, chosen, step))
        chosen.append(best)
        found.remove(best)
    return chosen


def _free(walkthrough: Walkthrough, base: Cameras, n: int, eye: np.ndarray) -> bool:
    """Whether nothing is between the photo's eye and the new one."""
    away = eye - base.eye[n].numpy()
    length = float(np.linalg.norm(away))
    if length < 1e-9:
        return True
    look = Cameras.look_at(base.eye[n], torch.from_numpy(eye), width=9, height=9, fov_deg=20, near=1e-3 * length)
    drawn = draw_walkthrough(walkthrough, look)
    return bool((drawn.depth[0] > 1.5 * length).all()) and bool(drawn.covered[0].all())


def _score(walkthrough: Walkthrough, camera: Cameras, n: int) -> NextView:
    drawn = draw_walkthrough(walkthrough, camera)
    kind, depth = drawn.kind[0], drawn.depth[0]
    missing, filled = kind == NOTHING, kind == FILLED
    # How much closer this view is than the photos were: their usual density against its own.
    assert walkthrough.cameras is not None
    steps = [p.step for p in walkthrough.planes]
    usual = float(np.median(steps)) if steps else float(np.median(walkthrough.points.footprint))
    own = depth / (float(camera.intrinsics[0, 0, 0]) * walkthrough.cameras.width / SIZE[0])
    coarse = torch.where(torch.isfinite(depth), (usual / own.clamp_min(1e-12) / COARSE).clamp(0, 1), 0.0)
    worth = missing.float() + 0.7 * filled.float() + 0.3 * torch.where(missing | filled, 0.0, coarse)
    # A wall in the face shows nothing of use.
    near = depth < 0.02 * walkthrough.diagonal
    known = float(((kind != NOTHING) & ~filled & ~near).float().mean())
    score = float(torch.where(near, 0.0, worth).mean()) * min(known / OVERLAP, 1.0) ** 2
    return NextView(camera, score, float(missing.float().mean()), float(filled.float().mean()), n)


def _apart(view: NextView, chosen: list[NextView], step: float) -> float:
    """1 for a view unlike all chosen ones, towards 0.2 for the same."""
    least = 1.0
    for other in chosen:
        turn = float((view.camera.forward[0] * other.camera.forward[0]).sum())
        move = float((view.camera.eye[0] - other.camera.eye[0]).norm()) / max(4 * step, 1e-12)
        least = min(least, max((1 - turn) / 0.6, move))
    return 0.2 + 0.8 * min(least, 1.0)
