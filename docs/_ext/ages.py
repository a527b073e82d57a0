"""Says on each page of results how far the program has moved on since it was measured.

A page names the commit that it was measured on. Where git knows that commit the note counts the later ones that touch
the program; where it does not, or the program had changes that no commit holds, the figures cannot be repeated, and the
note says that.
"""

from __future__ import annotations

import re
import subprocess
from functools import cache
from pathlib import Path

from sphinx.application import Sphinx

ROOT = Path(__file__).resolve().parents[2]
PROGRAM = ("torchrender", "service/torchrender_service")
COMMIT = re.compile(r"\bcommit `?([0-9a-f]{7,40})(-dirty)?\b")


def commits_of(text: str) -> list[tuple[str, bool]]:
    """Commits that a page names, in its order, and whether there were changes beside them."""
    return list(dict.fromkeys((name, bool(dirty)) for name, dirty in COMMIT.findall(text)))


@cache
def commits_since(name: str) -> int | None:
    """Commits to the program after this one; None where the history has no such commit."""
    try:
        _git("merge-base", "--is-ancestor", name, "HEAD")
        return len(_git("rev-list", f"{name}..HEAD", "--", *PROGRAM).split())
    except (OSError, subprocess.CalledProcessError):
        return None


@cache
def has_history() -> bool:
    """Whether this is a checkout with all of its commits."""
    try:
        return _git("rev-parse", "--is-shallow-repository").strip() == "false"
    except (OSError, subprocess.CalledProcessError):
        return False


def note(text: str) -> str | None:
    """What a page of results has to say of its age; None where there is nothing to say."""
    said = []
    for name, dirty in commits_of(text):
        since = commits_since(name)
        if dirty or since is None:
            said.append(f"It was measured on `{name}` with changes that no commit holds, so its figures are of then.")
        elif since:
            said.append(f"{since} commits have changed the program since `{name}`, on which it was measured.")
    return " ".join(dict.fromkeys(said)) or None


def _git(*words: str) -> str:
    return subprocess.run(["git", "-C", str(ROOT), *words], capture_output=True, text=True, check=True).stdout


def _add_note(app: Sphinx, name: str, content: list[str]) -> None:  # noqa: ARG001
    if not name.startswith("results/") or not has_history():
        return
    said = note(content[0])
    if said is not None:
        title, _, rest = content[0].partition("\n")
        content[0] = f"{title}\n\n:::{{note}}\nThis page is older than the program. {said}\n:::\n{rest}"


def setup(app: Sphinx) -> dict[str, bool]:
    """Called by Sphinx."""
    app.connect("source-read", _add_note)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
