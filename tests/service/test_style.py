"""Materials from a photo over HTTP."""

from __future__ import annotations

import io
import json
from pathlib import Path
from urllib.parse import urlencode

import numpy as np
import pytest
import torch
from PIL import Image as PilImage

import torchrender as tr
from service_server import RunningServer


def photo(width: int = 60, height: int = 40, kind: str = "PNG") -> bytes:
    """Blue above, orange below."""
    pixels = np.zeros((height, width, 3), np.uint8)
    pixels[: height // 2], pixels[height // 2 :] = (40, 70, 200), (230, 140, 30)
    file = io.BytesIO()
    PilImage.fromarray(pixels).save(file, kind)
    return file.getvalue()


def ask(server: RunningServer, body: bytes, accept: str, kind: str = "image/png", **query: object):
    where = "/v1/style?" + urlencode({"scene": "cornell_box", "views": 8, **query}, doseq=True)
    return server.ask("POST", where, body, content_type=kind, accept=accept)


def test_a_styled_scene_comes_back(server: RunningServer, tmp_path: Path) -> None:
    answer = ask(server, photo(), "model/gltf-binary")
    assert answer.status == 200, answer.body
    assert "search;dur=" in answer.headers["server-timing"]
    path = tmp_path / "styled.glb"
    path.write_bytes(answer.body)
    scene = tr.load(path)
    assert {m.name for m in scene.meshes} >= {"floor", "short box"}
    colors = torch.stack([scene.materials[m.material].diffuse for m in scene.meshes if m.name != "light"])
    # Nothing of the old white, red and green is left: everything is blue or orange.
    assert bool(((colors[:, 2] > colors[:, 0]) | (colors[:, 0] > 1.5 * colors[:, 2])).all())


def test_sheet_and_facts(server: RunningServer) -> None:
    sheet = ask(server, photo(kind="JPEG"), "image/png", "image/jpeg")
    assert sheet.status == 200 and PilImage.open(io.BytesIO(sheet.body)).width > 800
    facts = ask(server, photo(), "application/json", lock=["tall box"], pick=["short box=0,0,60,10"]).json()
    found = {o["name"]: o for o in facts["objects"]}
    assert found["tall box"]["locked"] and found["short box"]["locked"] and not found["floor"]["locked"]
    assert found["short box"]["diffuse"][2] > 3 * found["short box"]["diffuse"][0]
    assert facts["cost"]["after"] <= facts["cost"]["before"]


@pytest.mark.parametrize(
    ("body", "query", "status", "text"),
    [
        (b"no picture", {}, 422, "no PNG or JPEG"),
        (b"", {}, 422, "no PNG or JPEG"),
        (photo()[:100], {}, 422, "damaged"),
        (photo(300, 300), {}, 422, "65536 pixels"),
        (photo(), {"scene": "nowhere"}, 404, "no scene"),
        (photo(), {"lock": "sofa"}, 422, "no object is named 'sofa'"),
        (photo(), {"pick": "floor=1,2"}, 422, "must look like"),
        (photo(), {"pick": "floor=0,0,600,10"}, 422, "within the photo"),
        (photo(), {"views": 99}, 422, "views"),
        (b"\0" * 300_000, {}, 413, "at most 200000 bytes"),
    ],
)
def test_wrong_use(server: RunningServer, body: bytes, query: dict[str, object], status: int, text: str) -> None:
    answer = ask(server, body, "*/*", **query)
    assert answer.status == status and text in json.dumps(answer.json())


def test_wrong_media_types(server: RunningServer) -> None:
    assert ask(server, photo(), "*/*", "image/gif").status == 415
    assert ask(server, photo(), "text/html").status == 406
