"""The REST interface of a real server."""

from __future__ import annotations

import base64
import io
import json
import os
import random
import statistics
import threading
import time
import urllib.error
import urllib.request

import numpy as np
import pytest
from PIL import Image as PilImage

from gltf_builder import Glb
from service_server import ON_RAY, RunningServer
from torchrender.wire.containers import read_container

IDENTITY = [float(i % 5 == 0) for i in range(16)]
PINHOLE = {
    "world_from_camera": IDENTITY,
    "fx": 50,
    "fy": 50,
    "cx": 32,
    "cy": 24,
    "width": 64,
    "height": 48,
    "near": 0.1,
}
SIZE = {"width": 64, "height": 48}
SMALL = {"scene": "cornell_box", "width": 64, "height": 48}
LOOK = {"eye": [0.278, 0.273, -0.8], "target": [0.278, 0.273, 0.0], "fov_deg": 39.0}
BOX = b'name = "box"\n[[geometry]]\nshape = "box"\nsize = 1.0\n'


def test_health_ready_metrics(server: RunningServer) -> None:
    assert server.ask("GET", "/health").json()["status"] == "ok"
    end = time.monotonic() + 250
    while server.ask("GET", "/ready").json() != {"status": "ready"} and time.monotonic() < end:
        time.sleep(0.1)  # kernels for further settings may still be compiled where it is ready
    assert server.ask("GET", "/ready").json() == {"status": "ready"}
    metrics = server.ask("GET", "/metrics")
    assert metrics.headers["content-type"].startswith("text/plain; version=0.0.4")
    server.session()
    assert server.gauge("sessions") >= 1  # those of other tests may still wait for their clients


def test_scenes_are_listed(server: RunningServer) -> None:
    scenes = server.ask("GET", "/v1/scenes").json()["scenes"]
    box = next(s for s in scenes if s["id"] == "cornell_box")
    assert box["built_in"] and box["triangles"] == 96 and box["cameras"] == ["default", "close"]
    assert server.ask("GET", "/v1/scenes/cornell_box").json() == box


def test_an_upload_is_kept_rendered_and_deleted(server: RunningServer) -> None:
    made = Glb()
    made.mesh()
    made.json["nodes"] = [{"mesh": 0}]
    for data, kind in ((made.bytes(), "model/gltf-binary"), (BOX, "application/toml")):
        first = server.ask("POST", "/v1/scenes?name=mine", data, content_type=kind)
        assert first.status == 201, first.body
        facts = first.json()
        assert facts["name"] == "mine" and first.headers["location"] == f"/v1/scenes/{facts['id']}"
        again = server.ask("POST", "/v1/scenes", data, content_type=kind)
        assert (again.status, again.json()) == (200, facts)
        assert server.ask("POST", "/v1/render", {**SMALL, "scene": facts["id"]}).status == 200
        assert server.ask("DELETE", f"/v1/scenes/{facts['id']}").status == 204
        for method in ("GET", "DELETE"):
            assert server.ask(method, f"/v1/scenes/{facts['id']}").status == 404
        assert server.ask("POST", "/v1/render", {**SMALL, "scene": facts["id"]}).status == 404


@pytest.mark.parametrize(
    ("accept", "media_type", "start"),
    [
        ("*/*", "image/png", b"\x89PNG"),
        ("image/x-exr", "image/x-exr", b"\x76\x2f\x31\x01"),
        ("application/x-npz, image/png;q=0.5", "application/x-npz", b"PK"),
    ],
)
def test_pictures_come_as_accept_asks(server: RunningServer, accept: str, media_type: str, start: bytes) -> None:
    answer = server.ask("POST", "/v1/render", SMALL, accept=accept)
    assert answer.status == 200
    assert answer.headers["content-type"] == media_type
    assert answer.body.startswith(start)
    plan = json.loads(answer.headers["torchrender-plan"])
    assert {row["pass"] for row in plan["rows"] if row["runs"]} >= {"gbuffer", "direct_light"}
    assert "gbuffer;dur=" in answer.headers["server-timing"]


def test_wanted_buffers(server: RunningServer) -> None:
    body = {**SMALL, "camera": {"name": "close"}, "buffers": ["depth", "normal"], "budget_ms": 5000.0}
    answer = server.ask("POST", "/v1/render", body, accept="application/x-npz")
    with np.load(io.BytesIO(answer.body)) as arrays:
        assert arrays["depth"].shape == (1, 48, 64)
        assert "radiance" not in arrays and "camera_from_world" in arrays


def test_cameras_in_three_forms_show_the_same(server: RunningServer) -> None:
    session = server.session()
    pictures = [
        server.ask("POST", "/v1/render", {**SMALL, "camera": camera}).body
        for camera in ({"name": "default"}, session["camera"])
    ]
    first, second = (np.asarray(PilImage.open(io.BytesIO(p))).astype(int) for p in pictures)
    assert np.abs(first - second).max() <= 1
    assert server.ask("POST", "/v1/render", {**SMALL, "camera": LOOK}).status == 200


def test_depth_images_are_reprojected(server: RunningServer) -> None:
    made = server.ask("POST", "/v1/depth-images", {**SMALL, "cameras": [LOOK], "around": 2, "spread": 0.05})
    assert made.status == 200 and made.headers["content-type"] == "application/vnd.torchrender.keyframes"
    images = read_container(made.body, max_pixels=10**4, max_images=4)
    assert len(images) == 2
    for source in (
        {"keyframes": made.headers["torchrender-keyframes"]},
        {"container": base64.b64encode(made.body).decode()},
    ):
        body = {**source, "camera": LOOK, "width": 64, "height": 48}
        answer = server.ask("POST", "/v1/reproject", body)
        picture = np.asarray(PilImage.open(io.BytesIO(answer.body)))
        assert picture.shape == (48, 64, 4)
        share = float(answer.headers["torchrender-valid-share"])
        assert share > 0.5
        assert (picture[..., 3] > 0).mean() == pytest.approx(share, abs=1e-3)
        arrays = np.load(io.BytesIO(server.ask("POST", "/v1/reproject", body, accept="application/x-npz").body))
        assert arrays["valid"].mean() == pytest.approx(share, abs=1e-6)


def test_damaged_containers_are_refused_before_they_are_kept(server: RunningServer) -> None:
    """What is kept can be reprojected, wherever a byte was changed."""
    kind = "application/vnd.torchrender.keyframes"
    whole = server.ask("POST", "/v1/depth-images", {**SMALL, "cameras": [LOOK], "around": 2, "spread": 0.05}).body
    other = server.ask("POST", "/v1/depth-images", {**SMALL, "width": 32, "cameras": [LOOK]}).body
    dice, refused = random.Random(1), 0
    for place in (*(dice.randrange(len(whole)) for _ in range(24)), len(whole) - 20):
        damaged = bytearray(whole)
        damaged[place] ^= 1 << dice.randrange(8)
        answer = server.ask("POST", "/v1/keyframes", bytes(damaged), content_type=kind)
        if answer.status == 422:
            refused += 1
            assert answer.json()["type"].endswith(":invalid-value")
            continue
        assert answer.status == 201
        body = {"keyframes": answer.json()["id"], "camera": LOOK, **SIZE}
        assert server.ask("POST", "/v1/reproject", body).status == 200, f"byte {place}"
    assert refused > 12, "most bytes are those of pictures"
    assert "checksum" in answer.json()["detail"]
    mixed = server.ask("POST", "/v1/keyframes", whole + other, content_type=kind)
    assert mixed.status == 422 and "one size" in mixed.json()["detail"]
    for status in (200, 200):  # it was kept when it was made
        again = server.ask("POST", "/v1/keyframes", whole, content_type=kind)
        assert again.status == status and again.json()["images"] == 2


def test_a_client_is_told_what_is_doubted(server: RunningServer) -> None:
    away = {"eye": [0.278, 0.273, -0.8], "target": [0.278, 0.273, -2.0]}
    for _ in range(2):  # each time
        answer = server.ask("POST", "/v1/render", {**SMALL, "camera": away})
        (told,) = json.loads(answer.headers["torchrender-warnings"])
        assert told.startswith("cornell_box: ") and "sees nothing" in told
    assert "torchrender-warnings" not in server.ask("POST", "/v1/render", {**SMALL, "camera": LOOK}).headers


def test_plans_and_curves(server: RunningServer) -> None:
    plan = server.ask("GET", "/v1/plan?scene=cornell_box&width=64&height=48&budget_ms=100").json()
    assert plan["budget_ms"] == 100.0 and "gbuffer" in plan["text"]
    late = server.ask("GET", "/v1/plan?scene=cornell_box&width=64&height=48&time=2")
    assert late.status == 422 and "has none, got 2" in late.json()["detail"]
    curve = server.ask("GET", "/v1/tradeoff/soft_shadow").json()
    assert [row["setting"] for row in curve["settings"]][:2] == ["hard", "pcss"]
    missing = server.ask("GET", "/v1/tradeoff/nonsense")
    assert missing.status == 404 and "soft_shadow" in missing.json()["detail"]


BAD = [
    ("render", {**SMALL, "scene": "nothing"}, 404, "no scene"),
    ("render", {**SMALL, "scene": "../../etc/passwd"}, 422, "scene"),
    ("render", {**SMALL, "scene": "\ud800"}, 422, "scene"),
    ("render", {**SMALL, "width": 0}, 422, "width"),
    ("render", {**SMALL, "time": -1.0}, 422, "time"),
    ("render", {**SMALL, "time": 1.5}, 422, "has none, got 1.5"),
    ("depth-images", {**SMALL, "time": 1.5}, 422, "has none, got 1.5"),
    ("render", {**SMALL, "width": 10**9}, 422, "width"),
    ("render", {**SMALL, "width": "64"}, 422, "width"),
    ("render", {**SMALL, "width": 64.5}, 422, "width"),
    ("render", {**SMALL, "width": 200, "height": 200}, 422, "at most 20000"),
    ("render", {**SMALL, "width": 120, "height": 120, "options": {"supersample": 2.0}}, 422, "at most 20000"),
    ("render", {**SMALL, "width": 90, "height": 90, "options": {"supersample": 1.5}}, 200, ""),
    ("render", {**SMALL, "width": 90, "height": 90, "options": {"supersample": 1.6}}, 422, "got 20736"),
    ("render", {**SMALL, "width": 141, "height": 142, "options": {"supersample": 0.5}}, 422, "got 20022"),
    ("render", {**SMALL, "colour": 1}, 422, "colour"),
    ("render", {**SMALL, "budget_ms": -1}, 422, "budget_ms"),
    ("render", {**SMALL, "max_error": 7}, 422, "max_error"),
    ("render", {**SMALL, "camera": {"name": "nobody"}}, 422, "no camera 'nobody'"),
    ("render", {**SMALL, "camera": {"eye": [0, 0]}}, 422, "eye"),
    ("render", {**SMALL, "camera": {"eye": [0, 0, 1e300]}}, 422, "eye"),
    ("render", {**SMALL, "camera": {"eye": [0, 0, 0], "target": [0, 0, 0]}}, 422, ""),
    ("render", {**SMALL, "camera": {**PINHOLE, "world_from_camera": [0.0] * 16}}, 422, "world_from_camera"),
    ("render", {**SMALL, "camera": {**PINHOLE, "fx": -1}}, 422, "fx"),
    ("render", {**SMALL, "options": {"tone_map": "best"}}, 422, "tone_map"),
    ("render", {**SMALL, "buffers": ["secrets"]}, 422, "buffers"),
    ("render", [], 422, "body"),
    ("depth-images", {**SMALL, "around": 5}, 422, "at most 4 views"),
    ("depth-images", {**SMALL, "around": 2, "cameras": [LOOK, LOOK]}, 422, "around"),
    ("depth-images", {**SMALL, "width": 100, "height": 100, "around": 2}, 200, ""),
    ("depth-images", {**SMALL, "width": 100, "height": 101, "around": 2}, 422, "got 20200"),
    ("depth-images", {**SMALL, "bits": 13}, 422, "bits"),
    ("depth-images", {**SMALL, "cameras": [LOOK, PINHOLE]}, 200, ""),
    ("depth-images", {**SMALL, "cameras": [LOOK, {**PINHOLE, "width": 32}]}, 422, "share width"),
    ("reproject", {"camera": LOOK}, 422, "either keyframes or container"),
    ("reproject", {"camera": LOOK, "keyframes": "a" * 64, **SIZE}, 404, "no keyframes"),
    ("reproject", {"camera": LOOK, "keyframes": "../x"}, 422, "keyframes"),
    ("reproject", {"camera": LOOK, "container": "!!!!", **SIZE}, 422, "base64"),
    ("reproject", {"camera": LOOK, "container": "AAAA", **SIZE}, 422, "message"),
    ("reproject", {"camera": {"eye": [0, 0, 0]}, "container": "AAAA"}, 422, "target"),
    ("sessions", {**SMALL, "layers": 5}, 422, "layers"),
    ("sessions", {**SMALL, "overscan": 2.0}, 422, "overscan"),
    ("sessions", {**SMALL, "width": 1000, "height": 1000}, 422, "at most 20000"),
]


@pytest.mark.parametrize(("route", "body", "status", "reason"), BAD)
def test_bad_values_are_named(server: RunningServer, route: str, body: object, status: int, reason: str) -> None:
    answer = server.ask("POST", f"/v1/{route}", body)
    assert answer.status == status, answer.body
    if status != 200:
        assert answer.headers["content-type"] == "application/problem+json"
        problem = answer.json()
        assert problem["status"] == status and problem["type"].startswith("urn:torchrender:problem:")
        assert reason in problem["detail"]


@pytest.mark.parametrize("text", ["NaN", "Infinity", "-Infinity", "1e999", "9" * 400, "null", '"1"', "{}", "[[]]"])
def test_numbers_that_are_none(server: RunningServer, text: str) -> None:
    body = '{"scene": "cornell_box", "width": 64, "height": 48, "camera": {"eye": [0, 0, ' + text + "]}}"
    answer = server.ask("POST", "/v1/render", body.encode(), content_type="application/json")
    assert answer.status == 422
    answer.json()


@pytest.mark.parametrize("body", [b"", b"{", b"\xff\xfe", b"[" * 20000, b'{"a": ' * 6000, b"\0" * 100])
def test_bodies_that_are_no_json(server: RunningServer, body: bytes) -> None:
    answer = server.ask("POST", "/v1/render", body, content_type="application/json")
    assert answer.status in (400, 422)
    assert answer.headers["content-type"] == "application/problem+json"


def test_bodies_that_are_no_scene(server: RunningServer) -> None:
    for data, kind, status in (
        (b"\0" * 1000, "model/gltf-binary", 422),
        (b"", "model/gltf-binary", 422),
        (b"name = ", "application/toml", 422),
        (BOX, "text/plain", 415),
        (b'[[material]]\nname = "a"\ntexture = "../../../etc/passwd"\n', "application/toml", 422),
        (b"x" * 200_001, "application/toml", 413),
    ):
        answer = server.ask("POST", "/v1/scenes", data, content_type=kind)
        assert answer.status == status, answer.body
    assert len(server.ask("GET", "/v1/scenes").json()["scenes"]) == 1


def test_too_large_bodies_are_refused_before_they_are_read(server: RunningServer) -> None:
    answer = server.ask("POST", "/v1/render", b" " * 40_001, content_type="application/json")
    assert answer.status == 413

    def endless():
        for _ in range(100):
            yield b" " * 4000

    request = urllib.request.Request(server.url + "/v1/render", endless(), {"Content-Type": "application/json"})
    with pytest.raises((urllib.error.HTTPError, ConnectionError, urllib.error.URLError)) as caught:
        urllib.request.urlopen(request, timeout=20)
    if isinstance(caught.value, urllib.error.HTTPError):
        assert caught.value.code == 413
        caught.value.close()


def test_deleting_what_cannot_be_deleted(server: RunningServer) -> None:
    assert server.ask("DELETE", "/v1/scenes/cornell_box").status == 403
    for name, status in (("nothing", 404), ("..%2f..%2fetc", 404), ("A" * 65, 422), ("%00", 422), ("x.toml", 422)):
        assert server.ask("DELETE", f"/v1/scenes/{name}").status == status


def test_unknown_places_and_methods(server: RunningServer) -> None:
    for method, path, status in (
        ("GET", "/v1/nothing", 404),
        ("GET", "/../../etc/passwd", 404),
        ("GET", "/%2e%2e/%2e%2e/etc/passwd", 404),
        ("PUT", "/v1/render", 405),
        ("PATCH", "/v1/render", 405),
    ):
        answer = server.ask(method, path, b"" if method[0] == "P" else None)
        assert answer.status == status, (method, path)
        assert answer.json()["status"] == status


def test_other_sites_and_names_are_kept_out(server: RunningServer) -> None:
    answer = server.ask("POST", "/v1/sessions", SMALL, origin="http://evil.example")
    assert answer.status == 403
    assert server.ask("POST", "/v1/render", SMALL, origin=server.url).status == 200
    answer = server.ask("GET", "/v1/scenes", host="evil.example")
    assert answer.status == 421


def test_not_acceptable(server: RunningServer) -> None:
    assert server.ask("POST", "/v1/render", SMALL, accept="text/html").status == 406
    assert (
        server.ask("POST", "/v1/reproject", {"camera": LOOK, "container": "AAAA"}, accept="image/x-exr").status == 406
    )


def test_health_answers_while_pictures_are_rendered(server: RunningServer) -> None:
    """The figure itself is in the report; here it is only told from being stuck behind a picture."""
    body = {"scene": "cornell_box", "width": 160, "height": 120, "options": {"reflections": "traced"}}
    stop = threading.Event()

    def render() -> None:
        while not stop.is_set():
            server.ask("POST", "/v1/render", body)

    workers = [threading.Thread(target=render) for _ in range(3)]
    for worker in workers:
        worker.start()
    health, picture = [], []
    try:
        for _ in range(20):
            begin = time.monotonic()
            assert server.ask("GET", "/health").status == 200
            health.append(time.monotonic() - begin)
        begin = time.monotonic()
        assert server.ask("POST", "/v1/render", body).status == 200
        picture.append(time.monotonic() - begin)
    finally:
        stop.set()
        for worker in workers:
            worker.join()
    assert statistics.median(health) < picture[0]


@pytest.mark.skipif(ON_RAY in os.environ, reason="Ray keeps the logs of replicas in files of its own")
def test_the_log_is_structured_and_holds_no_tickets(server: RunningServer) -> None:
    ticket = server.session()["ticket"]
    time.sleep(0.2)
    lines = [json.loads(line) for line in server.log]
    assert any(line["message"] == "request" and line["route"] == "/v1/sessions" for line in lines)
    assert not any(ticket in line for line in server.log)


@pytest.mark.parametrize(
    ("camera", "reason"),
    [
        ({"eye": [1, 1, 1], "fov_deg": 0}, "body.camera.LookAt.fov_deg: Input should be greater than 0"),
        ({"eye": [0, 0, 1e308]}, "body.camera.LookAt.eye.2: Input should be less than or equal to 1000000000000000"),
        ({**PINHOLE, "fx": -1}, "body.camera.PinholeCamera.fx: Input should be greater than 0"),
        ({"name": ""}, "body.camera.NamedCamera.name: String should have at least 1 character"),
        ("close", "body.camera: Input should be an object with the name of a camera"),
    ],
)
def test_errors_of_cameras_are_about_their_own_form(server: RunningServer, camera: object, reason: str) -> None:
    answer = server.ask("POST", "/v1/render", {**SMALL, "camera": camera})
    assert answer.status == 422
    assert answer.json()["detail"].startswith(reason)
    assert len(answer.json()["errors"]) == 1


def test_a_wrong_method_and_a_wrong_type_are_told(server: RunningServer) -> None:
    assert server.ask("GET", "/v1/render").status == 405
    assert server.ask("GET", "/v1/nothing").status == 404
    body = b'{"scene": "cornell_box"}'
    answer = server.ask("POST", "/v1/render", body, content_type="text/plain")
    assert answer.status == 415
    assert answer.json()["detail"] == "Content-Type must be application/json, got text/plain"
