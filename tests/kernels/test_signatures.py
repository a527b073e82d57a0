"""What is recorded is what is called: types survive being written down, and use stays within the record."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from numba import typeof

import kernel_uses
from torchrender.kernels import hooks, worker
from torchrender.kernels.points import tree
from torchrender.kernels.raster.records import __name__ as RECORDS
from torchrender.kernels.signatures import GROUPS, Use, _type, described, kernel_of, recorded, types_of
from torchrender.scene.load import load


def test_types_are_the_same_after_being_written_down() -> None:
    readonly = np.zeros((2, 3), dtype=np.float32)
    readonly.flags.writeable = False
    for value in (
        1, 1.5, True, None, np.uint8(1), np.zeros(3), np.zeros((2, 3), dtype=np.int32)[:, 1:], readonly,
        np.asfortranarray(readonly), np.zeros(2, dtype=bool), (1, 2), (1, 2.0, np.zeros(3, dtype=np.uint64)),
    ):  # fmt: skip
        kind = typeof(value)
        told = json.loads(json.dumps(described(kind)))
        assert _type(told) == kind, kind
    with pytest.raises(TypeError, match="cannot be recorded"):
        described(typeof("text"))


def test_every_recorded_use_names_a_kernel_and_types() -> None:
    """Records, too: those of the rasterizer are among them."""
    assert {group for use in recorded() for group in (part.split(".")[0] for part in use.parts)} == set(GROUPS)
    for use in recorded():
        kernel = kernel_of(use)
        kinds = types_of(use)
        assert [described(one) for one in kinds] == json.loads(use.arguments)
        assert len(kinds) == len(kernel._compiler.pysig.parameters) and use.seconds > 0
    assert any(f"{RECORDS}:" in use.arguments for use in recorded())
    with pytest.raises(TypeError, match="not a kernel"):
        kernel_of(Use("points.tree.np", "[]", 0.0, ()))


def test_a_record_that_has_lost_a_field_is_not_what_was_recorded() -> None:
    """It would be compiled in vain at every warm-up."""
    use = next(one for one in recorded() if '"record"' in one.arguments)
    told = json.loads(use.arguments)
    record = next(one for one in told if "record" in one)
    record["of"].pop()
    with pytest.raises(TypeError, match="fields now, recorded are"):
        types_of(Use(use.kernel, json.dumps(told), 0.0, ()))


@pytest.mark.parametrize("work", ["default_pictures", "first_keyframes", "streams"])
def test_use_stays_within_the_record(work: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """So nothing is compiled after a warm-up. Where this fails, run ``python tests/kernel_uses.py --write``."""
    known = {(use.kernel, json.dumps(json.loads(use.arguments))): set(use.parts) for use in recorded()}
    if work == "streams":  # of two scenes, which have an area light, sunlight and no mirrors; all take a minute
        some = [load("cornell_box"), load("tree", size=3000)]
        monkeypatch.setattr(kernel_uses, "scenes", lambda: iter(some))
    group = {"default_pictures": "render", "first_keyframes": "serve.first", "streams": "serve"}[work]
    found = kernel_uses.record(only=(work,)).parts
    assert len(found) > 10
    for key in found:
        assert key in known, f"{key[0]} with {key[1]} is not recorded"
        assert any(group in (part, part.split(".")[0]) and not part.endswith(".more") for part in known[key]), key


def test_a_use_outside_the_record_is_seen() -> None:
    """The comparison above can fail."""
    recorder = kernel_uses.Recorder()
    with recorder.listening():
        recorder.run("points", lambda: tree.levels_of(np.int32(7)))
    ((name, kinds),) = recorder.parts
    assert name == "points.tree.levels_of" and json.loads(kinds) == ["int32"]
    assert (name, kinds) not in {(use.kernel, use.arguments) for use in recorded()}


def test_what_a_pass_has_done_by_threads_is_the_pass_s() -> None:
    """Else every picture would have it compiled."""
    code = "from threading import Thread\ndef run(work):\n    t = Thread(target=work)\n    t.start()\n    t.join()\n"
    made = {"__name__": "torchrender.passes.light.some_pass"}
    exec(code, made)
    recorder = kernel_uses.Recorder()
    with recorder.listening():
        recorder.run("render", lambda: made["run"](lambda: tree.levels_of(np.int64(7))))
    assert list(recorder.parts.values()) == [{"render.some_pass"}]


def test_hooks_are_asked_in_their_block_alone() -> None:
    asked = []
    with hooks.before_compiling(lambda kernel: asked.append(kernel) is None):
        assert hooks.is_dealt_with("a.b")
    assert not hooks.is_dealt_with("a.b") and asked == ["a.b"]


def test_the_worker_needs_neither_torch_nor_scenes() -> None:
    """It must start quickly: only kernels are imported."""
    assert callable(worker.main)
    code = (
        "import sys, io; sys.stdin = io.StringIO(''); from torchrender.kernels import worker; worker.main();"
        "sys.exit('torch' in sys.modules or 'torchrender.scene' in sys.modules or 'numba' not in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", code], check=False, capture_output=True, text=True)
    assert done.returncode == 0 and json.loads(done.stdout) == {"ready": True}, done.stderr


def test_a_picture_after_a_warm_up_compiles_nothing() -> None:
    """In a process of its own, helpers included; ``python tests/kernel_uses.py --check`` does so for all work."""
    code = (
        "import kernel_uses, sys\n"
        "from torchrender.kernels.warm_up import missing, warm_up\n"
        "assert warm_up(missing(['render'])).failed == ()\n"
        "from torchrender.renderer import render\n"
        "with kernel_uses.compiled() as names: render('washroom', width=48, height=48)\n"
        "late = list(names)\n"
        "from numba import njit\n"
        "with kernel_uses.compiled() as names: njit(lambda x: x + 1)(1)\n"
        "sys.exit(f'{late} {names}' if late or not names else 0)"
    )
    tests = str(Path(kernel_uses.__file__).parent)
    path = os.pathsep.join([tests, os.environ.get("PYTHONPATH", ""), str(Path(tests).parent)])
    environment = {**os.environ, "PYTHONPATH": path, "TORCHRENDER_CURVES": os.devnull + "/none"}
    done = subprocess.run([sys.executable, "-c", code], check=False, capture_output=True, text=True, env=environment)
    assert done.returncode == 0, done.stderr
