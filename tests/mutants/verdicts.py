"""What was found out, kept from run to run: in ``build`` as it comes, and beside the page of results."""

from __future__ import annotations

import hashlib
import json
import subprocess
from collections.abc import Sequence
from pathlib import Path

from mutants.bench import CAUGHT, ENDLESS, SURVIVED, UNUSABLE, arguments
from mutants.fault import Fault

NOT_ASKED = "not asked"


class Verdicts:
    """Of faults, and of the tests without any. Each holds until its fault or the tests change.

    One that was caught stays caught, as tests are not taken away.
    """

    def __init__(self, root: Path) -> None:
        self._root = root
        self._running, self._shown = root / "build" / "mutants.jsonl", root / "docs" / "results" / "mutants.json"
        self._rows: dict[str, dict[str, str]] = {}
        self._read = 0
        if self._shown.exists():
            self._take(json.loads(self._shown.read_text())["verdicts"])

    def find(self, fault: Fault) -> dict[str, str]:
        """The row of a fault: its verdict, the end of what the tests said and the commit that was asked."""
        self._refresh()
        return self._rows.get(fault.key) or self._rows.get(self._name(fault), {"verdict": NOT_ASKED})

    def of_tests(self, tests: str) -> str:
        """Verdict of a run of them without a fault."""
        self._refresh()
        return self._rows.get(self._name_of_tests(tests), {"verdict": NOT_ASKED})["verdict"]

    def add(self, fault: Fault, verdict: str, said: str) -> None:
        """Keep what a run found."""
        self._write(self._name(fault), verdict, said[-300:] if verdict == CAUGHT else said)

    def add_tests(self, tests: str, verdict: str, said: str) -> None:
        """Keep how they end without a fault."""
        self._write(self._name_of_tests(tests), verdict, said)

    def show(self, faults: Sequence[Fault]) -> Path:
        """Write those of ``faults`` beside the page, from where a fresh checkout goes on."""
        found = [self.find(fault) for fault in faults]
        rows = [{k: row[k] for k in ("key", "verdict", "commit")} for row in found if row["verdict"] != NOT_ASKED]
        rows.sort(key=lambda row: row["key"])
        self._shown.write_text(json.dumps({"verdicts": rows}, indent=1) + "\n")
        return self._shown

    def _write(self, name: str, verdict: str, said: str) -> None:
        row = {"key": name, "verdict": verdict, "said": said, "commit": commit(self._root)}
        self._running.parent.mkdir(exist_ok=True)
        with self._running.open("a") as file:
            file.write(json.dumps(row) + "\n")

    def _refresh(self) -> None:
        """Read what came since, also from another process."""
        if self._running.exists() and self._running.stat().st_size > self._read:
            with self._running.open() as file:
                file.seek(self._read)
                self._take([json.loads(line) for line in file.readlines()])
                self._read = file.tell()

    def _take(self, rows: Sequence[dict[str, str]]) -> None:
        for row in rows:
            self._rows[row["key"]] = row
            if row["verdict"] in (CAUGHT, ENDLESS):
                self._rows[row["key"].partition("-")[0]] = row

    def _name(self, fault: Fault) -> str:
        return f"{fault.key}-{self._state(fault.tests)}"

    def _name_of_tests(self, tests: str) -> str:
        return f"tests-{hashlib.sha256(tests.encode()).hexdigest()[:12]}-{self._state(tests)}"

    def _state(self, tests: str) -> str:
        """Of the tests' text."""
        named = [self._root / word.partition("::")[0] for word in arguments(tests)]
        files = [file for one in named for file in (sorted(one.rglob("*.py")) if one.is_dir() else [one])]
        told = b"".join(file.read_bytes() for file in files if file.is_file())
        return hashlib.sha256(told).hexdigest()[:8]


def commit(root: Path) -> str:
    """Of the tree that is asked, marked where it has changes that no commit holds."""
    words = ["git", "-C", str(root), "describe", "--always", "--abbrev=8", "--dirty"]
    return subprocess.run(words, capture_output=True, check=True, text=True).stdout.strip()


def table(faults: Sequence[Fault], verdicts: Verdicts) -> list[tuple[str, int, int, int]]:
    """Area, caught, asked and seeded; all of them last."""
    rows: dict[str, list[str]] = {}
    for fault in faults:
        rows.setdefault(fault.area, []).append(verdicts.find(fault)["verdict"])
    rows["all"] = [one for found in rows.values() for one in found]
    out = []
    for area, found in rows.items():
        asked = [one for one in found if one in (CAUGHT, ENDLESS, SURVIVED)]
        out.append((area, sum(one != SURVIVED for one in asked), len(asked), len(found)))
    return out


def missed(faults: Sequence[Fault], verdicts: Verdicts) -> list[tuple[str, Fault]]:
    """Those that the tests did not notice, and those that could not be seeded."""
    found = [(verdicts.find(fault)["verdict"], fault) for fault in faults]
    return [(verdict, fault) for verdict, fault in found if verdict in (SURVIVED, UNUSABLE)]
