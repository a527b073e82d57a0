"""The list of seeded faults is no older than the code that they are seeded into."""

from __future__ import annotations

from pathlib import Path

from mutants.listed import FAULTS

ROOT = Path(__file__).resolve().parent.parent


def test_every_listed_fault_can_be_seeded() -> None:
    old = []
    for fault in FAULTS:
        try:
            assert fault.seeded(ROOT) != (ROOT / fault.file).read_text(), fault.title
        except ValueError as error:
            old.append(str(error))
    assert not old, "\n".join(old)


def test_what_should_notice_a_fault_is_there() -> None:
    for tests in {fault.tests.partition(" -k ")[0] for fault in FAULTS}:
        assert not [name for name in tests.split() if not (ROOT / name.partition("::")[0]).exists()], tests
