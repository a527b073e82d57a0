"""The page of the score, from the verdicts that are kept."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from pathlib import Path

from mutants.fault import Fault
from mutants.verdicts import NOT_ASKED, Verdicts, missed, table

GOAL = 90


def write_page(root: Path, faults: Sequence[Fault], verdicts: Verdicts) -> Path:
    """``docs/results/mutants.md`` and the verdicts beside it.

    Raises:
        ValueError: a verdict is of a tree with changes that no commit holds.
    """
    asked = Counter(row["commit"] for row in map(verdicts.find, faults) if row["verdict"] != NOT_ASKED)
    if any(name.endswith("-dirty") for name in asked):
        raise ValueError("a verdict is of a tree with changes that no commit holds: ask it again from a commit")
    verdicts.show(faults)
    path = root / "docs" / "results" / "mutants.md"
    path.write_text(_page(faults, verdicts, asked))
    return path


def _page(faults: Sequence[Fault], verdicts: Verdicts, asked: Counter[str]) -> str:
    of_each = ", ".join(f"commit {name} ({count})" for name, count in asked.most_common())
    lines = [
        "# Faults that the tests notice",
        "",
        f"`make mutants` seeds {len(faults)} faults written by hand, one at a time, into a copy of the tree, and runs "
        f"the tests that are about the place: {sum(asked.values())} of them so far. Verdicts are kept until the fault "
        "or those tests change, and one that was caught stays caught; one that was not counts as not asked once tests "
        f"were written for it, until it is asked again. Verdicts by what was asked: {of_each}.",
        "",
        f"| area | caught | asked | seeded | score | goal {GOAL} % |",
        "|---|---|---|---|---|---|",
    ]
    for area, caught, of, seeded in table(faults, verdicts):
        share = 100 * caught / of if of else 0.0
        word = "met" if of == seeded and share >= GOAL else "missed" if of == seeded else "not all asked"
        lines.append(f"| {area} | {caught} | {of} | {seeded} | {f'{share:.0f} %' if of else '-'} | {word} |")
    found = missed(faults, verdicts)
    lines += ["", "## Not noticed", ""] if found else ["", "None of those that were asked is left unnoticed."]
    lines += [f"- {one.area}, `{one.file}`: {_code(one.old)} → {_code(one.new)}" for _, one in found]
    return "\n".join(lines) + "\n"


def _code(text: str) -> str:
    told = " ".join(text.split())
    return f"`` {told} ``" if told else "nothing"
