"""A camera and sessions as the service keeps them, for tests without a server."""

from __future__ import annotations

import time
from typing import Any

from torchrender.wire.messages import CameraHeader
from torchrender_service.renderers.jobs import Bounds, SceneSource
from torchrender_service.streams.sessions import Session

IDENTITY = tuple(float(i % 5 == 0) for i in range(16))
CAMERA = CameraHeader(world_from_camera=IDENTITY, fx=50.0, fy=50.0, cx=32.0, cy=24.0, width=64, height=48, near=0.1)


def make_session(name: str, lasts_s: float = 60.0, **rest: Any) -> Session:
    given = {
        "id": name,
        "scene": SceneSource(id="cornell_box"),
        "facts": {},
        "camera": CAMERA,
        "layers": 0,
        "overscan": 1.0,
        "bounds": Bounds(),
        "renderer": 0,
        "expires": time.monotonic() + lasts_s,
    }
    return Session(**given | rest)
