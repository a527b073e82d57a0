"""Pages of results: each says on which commit it was measured, and whether that can be checked out."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import pytest

ROOT = Path(__file__).resolve().parents[2]
PAGES = sorted(page for page in (ROOT / "docs" / "results").glob("*.md") if page.stem != "index")
OF_THEN: frozenset[str] = frozenset()
"""Pages measured with changes that no commit holds, to be measured again: none, and none may be added."""


@pytest.fixture
def ages(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    pytest.importorskip("sphinx")
    monkeypatch.syspath_prepend(str(ROOT / "docs" / "_ext"))
    import ages

    yield ages
    sys.modules.pop("ages")


def test_every_page_names_a_commit_of_this_history(ages: ModuleType) -> None:
    """Where the whole history is there; otherwise that it names a clean one."""
    lost = set()
    for page in PAGES:
        commits = ages.commits_of(page.read_text())
        assert commits, f"{page.name} names no commit"
        unknown = any(ages.commits_since(name) is None for name, _ in commits) if ages.has_history() else False
        if unknown or any(dirty for _, dirty in commits):
            lost.add(page.stem)
    assert lost <= OF_THEN, "measured with changes that no commit holds"
    if ages.has_history():
        assert lost == OF_THEN, "measured again: take it off the list"


def test_every_page_is_in_the_index() -> None:
    listed = set(re.findall(r"\]\(([\w-]+)\.(?:md|html)\)", (ROOT / "docs" / "results" / "index.md").read_text()))
    families = {page.stem.split("-")[0] for page in PAGES if page.stem.startswith("tradeoff-")}
    assert {page.stem for page in PAGES if not page.stem.startswith("tradeoff-")} | families <= listed


def test_ages_are_told(ages: ModuleType, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ages, "commits_since", {"1234567": 0, "89abcde": 3}.get)
    assert ages.commits_of("on a machine, commit 1234567, then commit `89abcde-dirty`.") == [
        ("1234567", False), ("89abcde", True),
    ]  # fmt: skip
    assert ages.note("commit 1234567") is None
    assert "3 commits have changed the program since `89abcde`" in ages.note("commit 89abcde")
    for lost in ("commit 89abcde-dirty", "commit fffffff"):
        assert re.search("with changes that no commit holds", ages.note(lost))


def test_later_commits_are_counted(ages: ModuleType) -> None:
    if not ages.has_history():
        pytest.skip("needs a checkout with its history")
    head = subprocess.run(["git", "-C", ROOT, "rev-parse", "--short", "HEAD"], capture_output=True, text=True).stdout
    assert ages.commits_since(head.strip()) == 0
    assert ages.commits_since("0000000") is None
