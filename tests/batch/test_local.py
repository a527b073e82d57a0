"""A batch over processes: the same bytes for every number of workers; what stops it loses and doubles nothing."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tarfile
import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from torchrender.batch import Job, SceneSource, run
from torchrender.batch.digest import scene_digest
from torchrender.batch.folder import alone_in, load_job, open_folder
from torchrender.batch.job import MANIFEST
from torchrender.batch.local import TRIES, BatchError, _environment
from torchrender.batch.said import MOST_TOLD
from torchrender.batch.work import ChunkMaker
from torchrender.errors import (
    ImageFileError,
    InputError,
    LightWarning,
    OptionError,
    RepairedWarning,
    SceneFileError,
    SceneWarning,
)
from torchrender.raster import rasterize
from torchrender.scene.cameras.path import built_in_path
from torchrender.scene.load import load

SOURCE = SceneSource("city", {"size": 2000})
SCENE = SOURCE.load()


def job(count: int = 5, **rest: object) -> Job:
    cameras = built_in_path(SCENE, "orbit").cameras(count, width=24, height=16, near=0.1)
    return Job(SOURCE, cameras, **{"chunk": 2, **rest})  # type: ignore[arg-type]


FAKE = """
import json, sys
print(json.dumps({"ready": True}), flush=True)
for line in sys.stdin:
    chunk = int(line)
    said = {}
    %s
    print(json.dumps({"chunk": chunk, "files": [], "ms": 1.0, "said": said}), flush=True)
"""


@pytest.fixture
def fake(monkeypatch: pytest.MonkeyPatch):
    """Workers that only pretend, with a line of code of their own."""
    real = subprocess.Popen

    def use(line: str) -> None:
        def start(command: list[str], **rest: object) -> subprocess.Popen[str]:
            return real([sys.executable, "-S", "-c", FAKE % line, *command[3:]], **rest)  # type: ignore[call-overload]

        monkeypatch.setattr("subprocess.Popen", start)

    return use


def test_workers_write_what_one_process_does_and_go_on_where_they_were(tmp_path: Path) -> None:
    asked, told = job(), []
    outcome = run(asked, tmp_path / "out", workers=2, tell=lambda *numbers: told.append(numbers))
    assert (outcome.cameras, outcome.made, outcome.failed, outcome.restarts) == (5, 5, {}, 0)
    assert told[0] == (0, 5) and told[-1] == (5, 5)
    for chunk in range(asked.chunks):
        for name, data in ChunkMaker(SCENE, asked, tmp_path).contents(chunk):
            assert (tmp_path / "out" / name).read_bytes() == data
    assert run(asked, tmp_path / "out", workers=2).made == 0


def test_light_of_a_sky_is_the_same_for_any_number_of_threads(tmp_path: Path) -> None:
    import torchrender as tr

    satin = tr.Material(name="satin", diffuse=[0.5] * 3, metallic=0.0, roughness=0.6)
    box = tr.Scene(
        meshes=[tr.Mesh.sphere(1.0), tr.Mesh.plane(4.0)], materials=[satin]
    )  # lit as every scene without light
    tr.write_scene(tmp_path / "box.glb", box)
    cameras = built_in_path(box, "orbit").cameras(2, width=48, height=32, near=0.01)
    asked = Job(SceneSource(str(tmp_path / "box.glb")), cameras, chunk=1, format="exr")
    files = {}
    for count in (1, 2):
        folder = tmp_path / str(count)
        open_folder(folder, asked, scene_digest(asked.scene.load()))
        subprocess.run(
            [sys.executable, "-m", "torchrender.batch.worker", str(folder), str(count)],
            input="0\n1\n",
            text=True,
            check=True,
            env=_environment(count),
            stdout=subprocess.DEVNULL,
        )
        files[count] = [file.read_bytes() for file in sorted(folder.glob("*.exr"))]
    assert len(files[1]) == 2 and files[1] == files[2]


def test_an_unfinished_manifest_and_lost_files_are_made_again(tmp_path: Path, fake) -> None:
    asked, here = job(), scene_digest(SCENE)
    assert open_folder(tmp_path, asked, here) == {}
    records = [ChunkMaker(SCENE, asked, tmp_path).make(chunk) for chunk in range(3)]
    text = "".join(json.dumps(record) + "\n" for record in records)
    (tmp_path / MANIFEST).write_text(text[:-9])  # killed while it wrote
    assert sorted(open_folder(tmp_path, asked, here)) == [0, 1]
    assert (tmp_path / MANIFEST).read_text().endswith("\n")
    (tmp_path / "000001.png").unlink()
    assert sorted(open_folder(tmp_path, asked, here)) == [1]
    fake("pass")
    assert run(asked, tmp_path, workers=1).made == 3


def test_another_job_or_a_changed_scene_is_refused(tmp_path: Path) -> None:
    open_folder(tmp_path, job(), scene_digest(SCENE))
    with pytest.raises(InputError, match="other format"):
        open_folder(tmp_path, job(format="exr"), scene_digest(SCENE))
    with pytest.raises(InputError, match="other cameras"):
        other = built_in_path(SCENE, "orbit").cameras(5, width=24, height=16, near=0.2)
        open_folder(tmp_path, Job(SOURCE, other, chunk=2), scene_digest(SCENE))
    with pytest.raises(InputError, match="city has changed since"):
        open_folder(tmp_path, job(), "another")
    with pytest.raises(InputError, match="city has changed since"):
        open_folder(tmp_path, Job(SOURCE, other, chunk=2), "another")  # an orbit about what the scene is now
    assert scene_digest(load("city", size=2000)) == scene_digest(SCENE) != scene_digest(load("city", size=3000))


def test_two_runs_in_one_folder_are_kept_apart(tmp_path: Path, fake) -> None:
    fake("pass")
    with alone_in(tmp_path), pytest.raises(InputError, match="another process writes a batch there now"):
        run(job(), tmp_path, workers=1)
    assert run(job(), tmp_path, workers=1).cameras == 5


def test_a_killed_worker_loses_and_doubles_nothing(tmp_path: Path, fake) -> None:
    mark = tmp_path / "killed"
    once = f"chunk == 1 and not os.path.exists({str(mark)!r})"
    fake(f"import os; {once} and (open({str(mark)!r}, 'w'), os.kill(os.getpid(), 9))")
    outcome = run(job(), tmp_path / "out", workers=2)
    assert (outcome.cameras, outcome.failed, outcome.restarts) == (5, {}, 1)
    chunks = [json.loads(line)["chunk"] for line in (tmp_path / "out" / MANIFEST).read_text().splitlines()]
    assert sorted(chunks) == [0, 1, 2]


def test_a_worker_that_hangs_is_killed_and_its_chunk_made(tmp_path: Path, fake, monkeypatch) -> None:
    monkeypatch.setattr("torchrender.batch.local.LEAST_S", 0.3)
    mark = tmp_path / "hung"
    once = f"chunk == 1 and not os.path.exists({str(mark)!r})"
    fake(f"import os, time; {once} and (open({str(mark)!r}, 'w'), time.sleep(60))")
    outcome = run(job(), tmp_path / "out", workers=1)
    assert (outcome.cameras, outcome.failed, outcome.restarts) == (5, {}, 1) and mark.exists()


def test_a_chunk_that_always_kills_is_given_up_and_the_others_made(tmp_path: Path, fake) -> None:
    fake("chunk == 1 and __import__('os')._exit(9)")
    outcome = run(job(), tmp_path, workers=1)
    assert outcome.cameras == 3 and list(outcome.failed) == [1] and outcome.restarts == TRIES
    assert "exit status 9" in outcome.failed[1]


def test_what_stops_all_says_so_and_keeps_what_is_done(tmp_path: Path, fake) -> None:
    fake("chunk == 2 and (print(json.dumps({'failed': 'disk full', 'for_all': True}), flush=True), sys.exit())")
    with pytest.raises(BatchError, match="disk full; 4 of 5 cameras are done and stay"):
        run(job(), tmp_path, workers=1)
    fake("pass")
    assert run(job(), tmp_path, workers=1).made == 1


def test_a_process_that_cannot_begin_ends_the_batch(tmp_path: Path, fake) -> None:
    fake("pass\nraise SystemExit(3)\n#")
    with pytest.raises(OptionError, match=r"workers must be in \[1, 256\], got 0"):
        run(job(), tmp_path, workers=0)
    with pytest.raises(ImageFileError):
        (tmp_path / "file").write_text("")
        run(job(), tmp_path / "file", workers=1)


def test_a_full_disk_is_for_all_and_leaves_nothing_by_halves(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object) -> int:
        raise OSError(28, os.strerror(28))

    monkeypatch.setattr(Path, "write_bytes", full)
    with pytest.raises(ImageFileError, match="No space left") as problem:
        ChunkMaker(SCENE, job(), tmp_path).make(0)
    assert isinstance(problem.value.__cause__, OSError) and not list(tmp_path.iterdir())


def test_shards_hold_the_files_of_a_chunk_and_no_time_of_day(tmp_path: Path) -> None:
    asked = job(what="depth", shards=True, names=("a", "b", "c", "d", "e"))
    first = ChunkMaker(SCENE, asked, tmp_path).make(1)
    data = (tmp_path / "shard_000001.tar").read_bytes()
    assert first["files"] == ChunkMaker(SCENE, asked, tmp_path).make(1)["files"]
    assert (tmp_path / "shard_000001.tar").read_bytes() == data
    with tarfile.open(tmp_path / "shard_000001.tar") as shard:
        assert shard.getnames() == ["c.npz", "d.npz"]
        arrays = np.load(shard.extractfile("d.npz"))  # type: ignore[arg-type]
        wanted = rasterize(SCENE, asked.cameras[3], outputs=("depth", "normal", "object_id"))
        assert sorted(arrays) == sorted(wanted)
        for name in wanted:
            np.testing.assert_array_equal(arrays[name], wanted[name][0].numpy())


def test_results_do_not_overwrite_what_the_folder_needs() -> None:
    with pytest.raises(InputError, match=r"'cameras' would overwrite cameras\.npz, which the folder of a batch needs"):
        job(2, what="depth", names=("a", "cameras"))
    with pytest.raises(InputError, match="'Cameras' would overwrite"):
        job(1, what="depth", names=("Cameras",))
    assert job(1, names=("cameras",)).format == "png"
    assert job(1, what="depth", shards=True, names=("cameras",)).shards


@pytest.mark.parametrize("name", ["a\tb", "a\rb", "a ", "a.", "CON", "nul.txt", "com1", "\ud800", ".a", "a/b", ""])
def test_names_that_no_file_has_everywhere(name: str) -> None:
    with pytest.raises(InputError, match="no plain file name"):
        job(1, names=(name,))


def test_damaged_lines_of_a_manifest_are_chunks_that_are_made_again(tmp_path: Path) -> None:
    asked = job(5, chunk=1)
    assert open_folder(tmp_path, asked, "digest") == {}
    lines = [json.dumps(ChunkMaker(SCENE, asked, tmp_path).make(chunk)) for chunk in range(4)]
    damaged = [lines[0], lines[1][:20] + lines[2], '{"a": 1}', "[1]", '{"chunk": 1}', "", lines[3]]
    (tmp_path / MANIFEST).write_text("\n".join(damaged) + '\n{"chunk": 4, "fi')
    (tmp_path / "cameras.npz").write_bytes(b"PK")
    assert sorted(open_folder(tmp_path, asked, "digest")) == [0, 3]
    assert (tmp_path / MANIFEST).read_text() == f"{lines[0]}\n{lines[3]}\n"
    again, digest = load_job(tmp_path)
    assert again.key() == asked.key() and digest == "digest"


@pytest.mark.parametrize(("file", "text", "told"), [
    ("job.json", "[1]", "job.json.*must hold a table"),
    ("job.json", '{"key": 1}', "job.json.*is damaged"),
    ("cameras.npz", "PK", "cameras.npz.*cannot be read"),
    ("cameras.npz", None, "cameras.npz.*cannot be read"),
])  # fmt: skip
def test_damaged_folders_are_named(tmp_path: Path, file: str, text: str | None, told: str) -> None:
    open_folder(tmp_path, job(), "digest")
    (tmp_path / file).unlink()
    if text is not None:
        (tmp_path / file).write_text(text)
    with pytest.raises(SceneFileError, match=told):
        load_job(tmp_path)


def test_names_of_shards_are_those_of_samples(tmp_path: Path) -> None:
    """WebDataset takes a name up to its first dot: two pictures of one film would be one sample."""
    long = "n" * 180  # more than plain tar headers hold
    with pytest.warns(RepairedWarning, match="'frame.0001' and 1 more: WebDataset takes names up to the first dot"):
        asked = job(3, what="depth", shards=True, names=("frame.0001", "frame.0002", long), chunk=3)
    assert asked.names == ("frame_0001", "frame_0002", long)
    made = ChunkMaker(SCENE, asked, tmp_path).make(0)
    assert made["files"] == ChunkMaker(SCENE, asked, tmp_path).make(0)["files"]
    with tarfile.open(tmp_path / "shard_000000.tar") as shard:
        assert shard.getnames() == ["frame_0001.npz", "frame_0002.npz", f"{long}.npz"]
    with pytest.warns(RepairedWarning), pytest.raises(InputError, match="'a_b' is there twice"):
        job(2, what="depth", shards=True, names=("a.b", "a_b"))
    with pytest.raises(InputError, match="no plain file name"):
        job(1, names=("ä" * 150,))  # of 300 bytes, more than file systems take


@pytest.mark.parametrize("kind", ["exr", "npz"])
def test_other_formats_are_those_of_pictures(tmp_path: Path, kind: str) -> None:
    ChunkMaker(SCENE, job(1, format=kind), tmp_path).make(0)
    assert [p.name for p in tmp_path.iterdir()] == [f"000000.{kind}"]


@pytest.mark.parametrize("what", ["film", "pictures"])
def test_chunks_do_not_depend_on_those_before(tmp_path: Path, what: str) -> None:
    """Though a process keeps what all pictures share: here a tree, occluders, and what shades hits of mirrors' rays."""
    source = SceneSource("washroom", {"size": 7000})
    scene = source.load()
    cameras = built_in_path(scene, "walk1").cameras(60, width=32, height=24, near=0.01)[:4]
    asked = Job(source, cameras, what=what, chunk=2)
    maker = ChunkMaker(scene, asked, tmp_path)
    for chunk in (1, 0):
        assert dict(maker.contents(chunk)) == dict(ChunkMaker(scene, asked, tmp_path).contents(chunk))
    assert {"ray_caster", "hit_shader"} <= set(maker._shared.kept), "nothing was kept: the test says nothing"


def test_wrong_jobs_are_refused_by_name() -> None:
    for wrong, message in (
        ({"what": "sound"}, "what"),
        ({"what": "depth", "format": "png"}, "format of depth"),
        ({"what": "film", "shards": True}, "a film is one file"),
        ({"wishes": {"budget_ms": 50}}, "unknown 'budget_ms'"),
        ({"chunk": 0}, "chunk must be >= 1"),
        ({"names": ("a",)}, "one for each of 5"),
        ({"names": ("a", "b", "A", "c", "d")}, "'A' is there twice"),
        ({"names": ("a", "b", "../c", "d", "e")}, "no plain file name"),
    ):
        with pytest.raises(InputError, match=message):
            job(**wrong)  # type: ignore[arg-type]
    with pytest.raises(InputError, match="at least one"):
        Job(SOURCE, job().cameras[:0])


def test_a_worker_whose_driver_is_gone_ends_quietly(tmp_path: Path) -> None:
    open_folder(tmp_path / "out", job(), scene_digest(SCENE))
    command = [sys.executable, "-m", "torchrender.batch.worker", str(tmp_path / "out"), "1"]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as worker:
        assert worker.stdout is not None and worker.stderr is not None
        worker.stdout.close()
        assert worker.wait(120) == 1
        assert worker.stderr.read() == b""


def test_what_is_said_of_a_picture_names_its_camera_and_is_in_its_record(tmp_path: Path) -> None:
    cameras = built_in_path(SCENE, "orbit").cameras(2, width=24, height=16, near=0.1)
    turned = cameras.camera_from_world.clone()
    turned[1] = torch.diag(torch.tensor([-1.0, 1.0, -1.0, 1.0], dtype=torch.float64)) @ turned[1]
    asked = Job(SOURCE, replace(cameras, camera_from_world=turned), names=("towards", "away"), chunk=2)
    assert not asked.wishes
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        record = ChunkMaker(SCENE, asked, tmp_path).make(0)
    ((text, kind),) = record["said"].items()
    assert text.startswith("city: camera 'away' sees nothing") and kind == "ViewWarning"


def test_what_workers_say_is_said_once_each(tmp_path: Path, fake) -> None:
    fake("said = {'all is dark': 'LightWarning', f'about {chunk}': 'SceneWarning'}")
    with warnings.catch_warnings(record=True) as heard:
        warnings.simplefilter("always")
        run(job(6), tmp_path / "few", workers=1)
    assert sorted((str(one.message), one.category) for one in heard) == [
        *((f"about {chunk}", SceneWarning) for chunk in range(3)), ("all is dark", LightWarning)
    ]  # fmt: skip
    with warnings.catch_warnings(record=True) as heard:
        warnings.simplefilter("always")
        run(job(2 * MOST_TOLD + 8), tmp_path / "many", workers=1)
    assert len(heard) == MOST_TOLD + 1
    assert str(heard[-1].message) == "5 more warnings are in the records of the chunks"


@pytest.mark.parametrize(("shards", "name"), [(False, "000001.png"), (True, "shard_000000.tar")])
def test_files_that_no_batch_made_are_not_written_over(shards: bool, name: str, tmp_path: Path) -> None:
    mine = job(2, shards=shards)
    (tmp_path / name).write_bytes(b"mine")
    with pytest.raises(InputError, match=f"holds {name} that no batch made: give another folder"):
        open_folder(tmp_path, mine, "digest")
    assert [path.name for path in tmp_path.iterdir()] == [name]
    (tmp_path / name).unlink()
    open_folder(tmp_path, mine, "digest")
    (tmp_path / name).write_bytes(b"made")
    assert open_folder(tmp_path, mine, "digest") == {}, "its own files are made again"
