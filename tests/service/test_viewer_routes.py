"""All that the page of a shown scene may ask of the program: its renderer answers as one behind a pipe does."""

from __future__ import annotations

import asyncio
import io
from collections.abc import Iterator
from typing import Any, cast

import numpy as np
import pytest
from PIL import Image as PilImage

import torchrender as tr
from service_server import Answer, RunningServer
from torchrender.client import StreamClient
from torchrender_service.renderers import jobs
from torchrender_service.viewer.live_scenes import LiveScenes
from torchrender_service.viewer.thread_pool import ThreadPool

VIEW = {"width": 64, "height": 48}
MARKS = {
    "region": [{"label": "sky", "polygon": [[0, 0], [80, 0], [80, 25], [0, 25]]}],
    "outdoor": {"near": 3.0, "far": 90.0},
}
BOX = b'name = "box"\n\n[[geometry]]\nshape = "box"\nsize = 1.0\n'
PARTS = [{"label": "sky"}, {"label": "vertical", "depth": 30.0}]
STROKES = [{"part": 0, "points": [[5, 8], [75, 8]]}, {"part": 1, "points": [[5, 50], [75, 50]], "width": 5}]


def photo() -> bytes:
    pixels = np.full((60, 80, 3), 60, np.uint8)
    pixels[:25] = (150, 170, 210)
    file = io.BytesIO()
    PilImage.fromarray(pixels).save(file, "PNG")
    return file.getvalue()


def scene() -> tr.Scene:
    """With all that surveys tell of: two cameras, surfaces, a light."""
    ball, floor = tr.Mesh.sphere(0.5, (0, 0.5, 0), segments=12, name="ball"), tr.Mesh.box((4.0, 0.1, 4.0), name="floor")
    cameras = {
        name: tr.Cameras.look_at((2.0, 1.5, side), (0.0, 0.4, 0.0), **VIEW)
        for name, side in (("left", 2.5), ("right", -2.5))
    }
    light = tr.PointLight(position=(2.0, 3.0, 1.0), intensity=(9.0, 9.0, 9.0))
    return tr.Scene(meshes=(ball, floor), lights=(light,), cameras=cameras, name="routes")


@pytest.fixture(scope="module")
def shown() -> Iterator[tuple[str, RunningServer]]:
    """The id of a scene that this program shows, and where."""
    with tr.show(scene(), browser=False) as view:
        yield view.id, RunningServer(process=cast("Any", None), url=view.url.partition("/?")[0], log=[])


def answers(name: str, server: RunningServer) -> dict[tuple[str, str], Answer]:
    """Of every route that is described, each asked for something that it does."""
    found: dict[tuple[str, str], Answer] = {}

    def ask(method: str, route: str, body: Any = None, *, of: str = "", query: str = "", **headers: str) -> Answer:
        path = route.partition("{")[0] + of + route.partition("}")[2] if of else route
        found[method.lower(), route] = server.ask(method, path + query, body, **headers)
        return found[method.lower(), route]

    for path in ("/health", "/ready", "/metrics", "/v1/scenes"):
        ask("GET", path)
    ask("GET", "/v1/scenes/{scene}", of=name)
    ask("GET", "/v1/scenes/{scene}/survey", of=name)
    ask("POST", "/v1/render", {"scene": name, **VIEW})
    kept = ask("POST", "/v1/depth-images", {"scene": name, **VIEW}, accept="application/vnd.torchrender.keyframes")
    keyframes = ask("POST", "/v1/keyframes", kept.body, content_type="application/vnd.torchrender.keyframes").json()
    camera = {"eye": [2.0, 1.5, 2.4], "target": [0.0, 0.4, 0.0]}
    ask("POST", "/v1/reproject", {"keyframes": keyframes["id"], "camera": camera, **VIEW})
    ask("POST", "/v1/style", photo(), query=f"?scene={name}&views=8", content_type="image/png", accept="image/png")
    picture = ask("POST", "/v1/photos", photo(), content_type="image/png").json()["id"]
    ask("POST", "/v1/photos/{photo}/regions", {"parts": PARTS, "strokes": STROKES}, of=picture)
    ask("POST", "/v1/fog", {"photo_id": picture, "marks": MARKS, "visibility": 60.0})
    ask("POST", "/v1/marks", MARKS, accept="application/toml")
    ask("GET", "/v1/plan", query=f"?scene={name}")
    ask("GET", "/v1/tradeoff/{name}", of="soft_shadow")
    ask("POST", "/v1/sessions", {"scene": name, **VIEW})
    uploaded = ask("POST", "/v1/scenes", BOX, content_type="application/toml").json()["id"]
    ask("DELETE", "/v1/scenes/{scene}", of=uploaded)
    return found


def test_every_route_answers_for_a_shown_scene(shown: tuple[str, RunningServer]) -> None:
    name, server = shown
    found = answers(name, server)
    description = server.ask("GET", "/v1/openapi.json").json()
    described = {(method, path) for path, methods in description["paths"].items() for method in methods}
    assert set(found) == described, "a route that is described is asked, too"
    refused = {route: (answer.status, answer.body[:300]) for route, answer in found.items() if answer.status >= 300}
    assert not refused
    survey = found["get", "/v1/scenes/{scene}/survey"].json()
    assert set(survey["cameras"]) == {"left", "right"} and sum(survey["obstacles"]["dims"]) > 3
    for page in ("/", "/fog.html"):
        assert server.ask("GET", page).status == 200
    with StreamClient.connect(server.url, name, size=(64, 48), layers=1, overscan=1.0) as client:
        client.send_pose(client.camera, moving=False)
        assert np.isfinite(client.receive().images[0].depth.numpy()).any()


def test_jobs_and_results_are_as_messages_hold_them(monkeypatch: pytest.MonkeyPatch) -> None:
    pool = ThreadPool(LiveScenes())
    given: list[Any] = []

    def answered(job: Any) -> dict[str, Any]:
        given.append(job)
        return {"numbers": (1.0, (2, 3)), "file": bytearray(b"x"), "many": [{"one": (4,)}]}

    monkeypatch.setattr(pool._runner, "run", answered)
    job = jobs.Render(scene=jobs.SceneSource(id="a"), view=jobs.View(width=1, height=1), bounds=jobs.Bounds(),
                      options={"background": (0.0, 0.0, 0.0)}, format="png")  # fmt: skip
    made = asyncio.run(pool.run(job))
    asyncio.run(pool.stop())
    assert given[0].options == {"background": [0.0, 0.0, 0.0]} and type(given[0]) is jobs.Render
    assert made == {"numbers": [1.0, [2, 3]], "file": b"x", "many": [{"one": [4]}]}
