"""Fog in a photo over HTTP."""

from __future__ import annotations

import base64
import io
import json

import numpy as np
import pytest
from PIL import Image as PilImage

from service_server import RunningServer

MARKS = {
    "camera": {"horizon": 25.0},
    "region": [{"label": "sky", "polygon": [[0, 0], [80, 0], [80, 25], [0, 25]]}],
    "outdoor": {"near": 3.0, "far": 90.0},
}


def photo() -> str:
    pixels = np.full((60, 80, 3), 60, np.uint8)
    pixels[:25] = (150, 170, 210)
    file = io.BytesIO()
    PilImage.fromarray(pixels).save(file, "PNG")
    return base64.b64encode(file.getvalue()).decode()


def ask(server: RunningServer, accept: str = "image/png", **changed: object):
    body = {"photo": photo(), "marks": MARKS, "visibility": 60.0, **changed}
    return server.ask("POST", "/v1/fog", json.dumps(body).encode(), content_type="application/json", accept=accept)


def test_a_foggy_picture_comes_back(server: RunningServer) -> None:
    answer = ask(server)
    assert answer.status == 200, answer.body
    assert "scattered;dur=" in answer.headers["server-timing"]
    picture = np.array(PilImage.open(io.BytesIO(answer.body))).astype(int)
    assert picture.shape == (60, 80, 3)
    # The far ground is lighter than the near one, and both are lighter than without fog.
    assert picture[28].mean() > picture[58].mean() + 10 > 70
    other = np.array(PilImage.open(io.BytesIO(ask(server, visibility=1e6).body))).astype(int)
    assert abs(other[58] - 60).max() <= 1


def test_facts_come_back(server: RunningServer) -> None:
    found = ask(server, "application/json").json()
    assert found["facts"]["depth_m"][0] == pytest.approx(3.0, abs=0.1) and found["timings_ms"]["all"] > 0


@pytest.mark.parametrize(
    ("changed", "text"),
    [
        ({"photo": "%%"}, "base64"),
        ({"photo": base64.b64encode(b"none").decode()}, "no PNG or JPEG"),
        ({"marks": {"rooms": {}}}, "unknown key"),
        ({"visibility": None}, "either visibility or scattering"),
        ({"wrong": 1}, "wrong"),
    ],
)
def test_bad_requests_are_named(server: RunningServer, changed: dict, text: str) -> None:
    answer = ask(server, **changed)
    assert answer.status == 422 and text in answer.body.decode()
