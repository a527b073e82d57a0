"""Photos that are kept, divided and marked over HTTP."""

from __future__ import annotations

import asyncio
import io
import json
from typing import Any

import numpy as np
import pytest
from PIL import Image as PilImage

from service_parts import FakePool
from service_server import RunningServer
from torchrender.photo.fog import parse_marks
from torchrender_service.errors import ServiceError
from torchrender_service.web import kept
from torchrender_service.web.kept import KeptPhotos
from torchrender_service.web.negotiation import warning_headers

MARKS = {
    "region": [{"label": "sky", "polygon": [[0, 0], [80, 0], [80, 25], [0, 25]]}],
    "outdoor": {"near": 3.0, "far": 90.0},
}


def photo(seed: int = 0) -> bytes:
    pixels = np.full((60, 80, 3), 60, np.uint8)
    pixels[:25] = (150, 170, 210)
    pixels += np.random.default_rng(seed).integers(0, 9, pixels.shape, np.uint8)
    file = io.BytesIO()
    PilImage.fromarray(pixels).save(file, "PNG")
    return file.getvalue()


def keep(server: RunningServer, data: bytes) -> Any:
    answer = server.ask("POST", "/v1/photos", data, content_type="image/png")
    assert answer.status == 201, answer.body
    return answer.json()


def fog(server: RunningServer, accept: str = "image/jpeg", **body: Any) -> Any:
    given = {"marks": MARKS, "visibility": 60.0, **body}
    return server.ask("POST", "/v1/fog", given, accept=accept)


def test_a_kept_photo_needs_not_be_sent_again(server: RunningServer) -> None:
    facts = keep(server, photo())
    assert (facts["width"], facts["height"]) == (80, 60)
    assert keep(server, photo())["id"] == facts["id"], "the same photo is kept once"
    answer = fog(server, photo_id=facts["id"], side=40)
    assert answer.status == 200, answer.body
    small = PilImage.open(io.BytesIO(answer.body))
    assert (small.format, small.size) == ("JPEG", (40, 30))
    whole = PilImage.open(io.BytesIO(fog(server, "image/png", photo_id=facts["id"]).body))
    assert whole.size == (80, 60)
    # The small one shows the same: marks are those of the whole photo.
    shrunk = np.array(whole.resize((40, 30), PilImage.Resampling.BOX)).astype(int)
    assert np.abs(shrunk - np.array(small)).mean() < 6
    found = fog(server, "application/json", photo_id=facts["id"], side=40).json()
    assert found["facts"]["size"] == [40, 30] and found["warnings"] == []


def test_strokes_become_regions(server: RunningServer) -> None:
    facts = keep(server, photo(1))
    body = {
        "parts": [{"label": "sky"}, {"label": "vertical", "depth": 30.0}],
        "strokes": [{"part": 0, "points": [[5, 8], [75, 8]]}, {"part": 1, "points": [[5, 50], [75, 50]], "width": 5}],
    }
    regions = server.ask("POST", f"/v1/photos/{facts['id']}/regions", body).json()["region"]
    assert [r["label"] for r in regions] == ["vertical", "sky"] and regions[0]["depth"] == 30.0
    assert max(y for _, y in regions[1]["polygon"]) == pytest.approx(25, abs=2.5)
    assert fog(server, photo_id=facts["id"], marks={"region": regions}).status == 200
    for changed, text in (
        ({"parts": body["parts"][:1]}, "parts"),
        ({"strokes": [{"part": 7, "points": [[1, 1]]}] * 2}, "listed"),
        ({"strokes": [body["strokes"][0]] * 2}, "at least two parts"),
        ({"strokes": [{"part": 0, "points": []}] * 2}, "points"),
    ):
        answer = server.ask("POST", f"/v1/photos/{facts['id']}/regions", {**body, **changed})
        assert answer.status == 422 and text in answer.body.decode(), answer.body


def test_marks_are_checked_and_written(server: RunningServer) -> None:
    toml = server.ask("POST", "/v1/marks", MARKS, accept="application/toml")
    assert toml.status == 200 and toml.headers["content-type"].startswith("application/toml")
    assert parse_marks(toml.body, "x.toml") == parse_marks(json.dumps(MARKS).encode(), "x.json")
    back = server.ask("POST", "/v1/marks", toml.body, content_type="application/toml", accept="application/json")
    assert back.json() == MARKS
    wrong = server.ask("POST", "/v1/marks", {"region": [{"label": "sea"}]})
    assert wrong.status == 422 and "region[0]" in wrong.body.decode()
    assert server.ask("POST", "/v1/marks", b"x", content_type="text/plain").status == 415


def test_what_is_no_photo_is_refused_and_not_kept(server: RunningServer) -> None:
    answer = server.ask("POST", "/v1/photos", b"none", content_type="image/png")
    assert answer.status == 422 and "PNG or JPEG" in answer.body.decode()
    unknown = "0" * 64
    assert fog(server, photo_id=unknown).status == 404
    assert fog(server).status == 422 and b"either photo or photo_id" in fog(server).body
    assert server.ask("POST", "/v1/photos", photo(), content_type="image/webp").status == 415
    assert server.ask("POST", "/v1/photos", photo() + b"0" * 300_000, content_type="image/png").status == 413


def test_photos_go_when_there_is_no_room_or_nobody_asks(monkeypatch: pytest.MonkeyPatch) -> None:
    asyncio.run(keep_photos(monkeypatch))


async def keep_photos(monkeypatch: pytest.MonkeyPatch) -> None:
    pool, clock = FakePool("a", "b"), [0.0]
    monkeypatch.setattr(kept.time, "monotonic", lambda: clock[0])
    photos = KeptPhotos(pool, max_bytes=100)
    first, second = [(await photos.put(data)).name for data in (b"a" * 60, b"b" * 30)]
    assert (await photos.get(first)).renderer is not (await photos.get(second)).renderer
    clock[0] = 10.0
    await photos.get(first)
    third = (await photos.put(b"c" * 35)).name
    assert (await photos.get(first)).data and (await photos.get(third)).data, "the one that was used longest ago goes"
    with pytest.raises(ServiceError, match="send it again"):
        await photos.get(second)
    assert len(pool.back) == 1
    clock[0] = 10.0 + kept.LASTS_S + 1
    await photos.get(third)
    photos.expire()
    with pytest.raises(ServiceError):
        await photos.get(first)
    assert (await photos.get(third)).data and len(pool.back) == 2
    assert await photos.put(b"d" * 500), "one that is larger than everything allowed is kept alone"


def test_warnings_beside_a_picture_stay_json() -> None:
    assert warning_headers([]) == {}
    many = warning_headers([f"{k}: {'é' * 400}" for k in range(20)])["Torchrender-Warnings"]
    assert len(many) <= 4000 and json.loads(many)[0].startswith("0: é")
