"""Files that the service is started with."""

from __future__ import annotations

import asyncio
import json
import socket
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

import torchrender as tr
from torchrender.cli.main import main
from torchrender.cli.serve import _keep
from torchrender_service.renderers.contract import RendererPool
from torchrender_service.renderers.jobs import SceneSource
from torchrender_service.renderers.scene_cache import SceneCache
from torchrender_service.scenes.store import SceneStore
from torchrender_service.settings import Settings
from torchrender_service.web.page import PageFiles

OBJ = "mtllib a.mtl\nusemtl red\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"


@pytest.fixture
def model(tmp_path: Path) -> Path:
    folder = tmp_path / "models"
    folder.mkdir()
    (folder / "red.obj").write_text(OBJ)
    (folder / "a.mtl").write_text("newmtl red\nKd 0.9 0 0\n")
    return folder / "red.obj"


def test_a_model_is_a_scene_where_it_lies(model: Path, tmp_path: Path) -> None:
    data = tmp_path / "data"
    name, flat = _keep(model, data)
    assert not flat and _keep(model, data) == (name, False)
    facts = json.loads((data / "scenes" / name / "facts.json").read_text())
    assert (facts["name"], facts["triangles"], facts["kind"]) == ("red", 1, "zip")
    assert str(tmp_path) not in json.dumps({k: v for k, v in facts.items() if k != "report"}), "no path is told"
    pool: Any = RendererPool
    store = SceneStore(Settings(data_dir=str(data)), pool)
    store.open()
    source = store.source(name)
    assert isinstance(source, SceneSource)
    assert SceneCache().get(source).materials[0].diffuse.tolist() == pytest.approx([0.9, 0, 0])
    model.write_text(OBJ + "# other\n")
    assert _keep(model, data)[0] != name, "what has changed is another scene"


def test_a_scene_of_an_orthographic_camera_is_served_and_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], model: Path
) -> None:
    flat = tmp_path / "flat.toml"
    flat.write_text('[[geometry]]\nshape = "box"\n[[camera]]\neye = [0, 0, 4]\ntarget = [0, 0, 0]\nview_height = 3\n')
    served: list[Any] = []
    monkeypatch.setattr("torchrender_service.serving.run", lambda settings, start: served.append((settings, start)))
    for _ in range(2):  # kept before or not
        assert main(["serve", str(flat), str(model), "--data", str(tmp_path / "data")]) == 0
        lines = [line for line in capsys.readouterr().err.splitlines() if " is scene " in line]
        assert len(lines) == 2 and "pictures of it, but no streams" in lines[0] and "orthographic" not in lines[1]
        assert served[-1][1] == lines[1].split()[-1], "the page begins with what it can show"
    scenes = {json.loads(file.read_text())["name"] for file in (tmp_path / "data").glob("scenes/*/facts.json")}
    assert scenes == {"flat", "red"}


def test_what_is_no_model_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "notes.txt").write_text("nothing")
    for file, told in (("notes.txt", "cannot read .txt"), ("none.glb", "no such file")):
        assert main(["serve", str(tmp_path / file), "--data", str(tmp_path / "data")]) == 2
        assert told in capsys.readouterr().err


def test_a_port_that_is_taken_is_one_line(tmp_path: Path) -> None:
    """In a process of its own: the service sets up the logs of the whole process."""
    with socket.create_server(("127.0.0.1", 0)) as other:
        port = other.getsockname()[1]
        code = "import sys; from torchrender.cli.main import main; sys.exit(main(sys.argv[1:]))"
        command = [sys.executable, "-c", code, "serve", "--port", str(port), "--data", str(tmp_path / "data")]
        done = subprocess.run(command, capture_output=True, text=True, timeout=120)
    assert done.returncode == 2 and done.stdout == ""
    assert done.stderr.splitlines() == [
        f"torchrender: error: cannot listen on 127.0.0.1, port {port}: Address already in use"
    ]


@pytest.mark.parametrize(("query", "status"), [(b"", 307), (b"scene=city", 200)])
def test_the_page_begins_with_it(query: bytes, status: int) -> None:
    static = Path(tr.__file__).parent.parent / "service" / "torchrender_service" / "static"
    files = PageFiles(directory=static, html=True, start="abc")
    scope = {"type": "http", "method": "GET", "path": "/", "headers": [], "query_string": query}
    response = asyncio.run(files.get_response(".", scope))
    assert response.status_code == status
    if status == 307:
        assert response.headers["location"] == "?scene=abc"


def test_a_scene_that_a_full_disk_does_not_take_is_kept_later(
    model: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    data = tmp_path / "data"
    with pytest.MonkeyPatch.context() as patch:

        def refuse(*_: Any, **__: Any) -> int:
            raise OSError(28, "No space left on device")

        patch.setattr(Path, "write_text", refuse)
        assert main(["serve", str(model), "--data", str(data)]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1 and "red.obj: cannot be kept in" in said and "(No space left on device)" in said
    assert not list((data / "scenes").iterdir())
    name, _ = _keep(model, data)
    assert (data / "scenes" / name / "facts.json").exists()


@pytest.mark.parametrize("left", ["", "{", '{"id": "other"}'])
def test_a_broken_folder_of_a_scene_is_made_again(left: str, model: Path, tmp_path: Path) -> None:
    data = tmp_path / "data"
    name, _ = _keep(model, data)
    facts = data / "scenes" / name / "facts.json"
    whole = facts.read_text()
    facts.write_text(left) if left else facts.unlink()
    assert _keep(model, data) == (name, False)
    assert json.loads(facts.read_text()) == json.loads(whole)
    assert model.exists() and len(list((data / "scenes").iterdir())) == 1, "what the link leads to stays"
