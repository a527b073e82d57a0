"""Damaged files of every kind, a few of each; ``python -m torchrender.report.fuzz`` reads a night of them."""

from __future__ import annotations

from pathlib import Path

import pytest

from torchrender.report.fuzz import study as fuzz
from torchrender.report.fuzz.mutate import mutated
from torchrender.report.fuzz.seeds import picture, seeds

FILES = 60


@pytest.mark.parametrize("name", seeds())
def test_a_damaged_file_gives_a_scene_or_an_error_of_ours(name: str, tmp_path: Path) -> None:
    suffix, data = seeds()[name]
    (tmp_path / "a.png").write_bytes(picture("PNG"))
    (tmp_path / "a.obj").write_bytes(seeds()["obj"][1])
    (tmp_path / "a.mtl").write_bytes(seeds()["mtl"][1])
    assert fuzz.read(suffix, data, tmp_path) == "read"
    found = {fuzz.read(suffix, mutated(data, number), tmp_path) for number in range(FILES)}
    assert found - {"read"}, "the damage does nothing"


def test_other_errors_slow_files_and_dead_processes_are_failures(monkeypatch: pytest.MonkeyPatch) -> None:
    """What the study is for is told apart: here by what its processes answer."""

    class Worker:
        exitcode = -11

        def join(self, seconds: float) -> None: ...

    class Answers:
        def __init__(self, *answers: object) -> None:
            self.answers = ["ready", *answers]

        def poll(self, _: float) -> bool:
            return bool(self.answers) and self.answers[0] != "slow"

        def recv(self) -> object:
            answer = self.answers.pop(0)
            if answer == "dead":
                raise EOFError
            return answer

    outcome = fuzz.Outcome("obj")
    limits = (5.0, 100.0)
    next_file = fuzz._listen(
        Answers((0, "read", 0.1, 1.0), (1, "!TypeError: x", 0.1, 1.0), "slow"), Worker(), outcome, 0, 9, limits
    )  # type: ignore[arg-type]
    assert next_file == 3 and [n for n, _ in outcome.failures] == [1, 2]
    next_file = fuzz._listen(Answers("dead"), Worker(), outcome, 3, 9, limits)  # type: ignore[arg-type]
    assert next_file == 4 and outcome.failures[-1] == (3, "the process died: -11")
    fuzz._listen(Answers((4, "SceneFileError", 0.1, 500.0)), Worker(), outcome, 4, 9, limits)  # type: ignore[arg-type]
    assert outcome.failures[-1] == (4, "grew by 500 MB") and outcome.count == {"read": 1, "SceneFileError": 1}
    monkeypatch.setattr(fuzz, "study", lambda *_, **__: outcome)
    assert fuzz.main(["--kind", "obj", "--count", "1"]) == 1
