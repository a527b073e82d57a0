"""Run every effect over every hard case: ``python -m torchrender.report.stability [--quick] [--seconds 200]``.

Writes ``docs/results/stability.md`` and ``.json``; ``--seconds`` ends a run early, and the next goes on. Each pair of
effect and case is examined once more with one thread, and each scene with vertices that went through float32 (which
leaves those of the studio, in other views and lights, as they are); results must be finite, bounded, the same bit by
bit whatever the number of threads, nearly the same in both precisions, and obey the effect's law.
``tests/hard/test_stability.py`` asserts it.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from functools import lru_cache, partial
from pathlib import Path
from typing import Any

import torch

from torchrender.kernels.threads import limited_threads
from torchrender.passes.hard import HardEffect, Outputs, bounds_error, difference, same
from torchrender.passes.table import PASSES
from torchrender.quality.machine import machine_record
from torchrender.quality.pages import write_record, write_text
from torchrender.report.common.command import run_in_parts
from torchrender.report.common.parts import Parts
from torchrender.report.stability.cases import BY_NAME, CASES, Case, HardCase
from torchrender.report.stability.numerics import NUMERICS
from torchrender.report.stability.page import page
from torchrender.report.stability.picture import PICTURE
from torchrender.report.stability.samples import SAMPLES

EFFECTS: tuple[HardEffect, ...] = (*(record for step in PASSES for record in step.hard), PICTURE, *SAMPLES)
"""Everything that is examined: the records of all passes, and those of what is no pass."""

NUMBERS = 2000  # random arguments of each numerical function


@dataclass(frozen=True, kw_only=True)
class Finding:
    """What came of one effect on one case."""

    effect: str
    case: str
    skipped: str | None = None  # why the case says nothing about the effect
    bounds: str | None = None  # the first value that is not finite or out of bounds
    repeats: bool = True  # bit by bit the same again, with one thread
    stored: bool = True  # float32 and float64 tensors of the same numbers give the same bit by bit
    rounding: float | None = None  # share of values that change when vertices are rounded to float32
    law: float = 0.0  # deviation from the effect's law
    twin: float | None = None  # share of values that differ from the case that must look the same
    seconds: float = 0.0
    faults: tuple[str, ...] = ()  # what must not be, in words


def pairs() -> Iterator[tuple[HardEffect, HardCase]]:
    """Every effect with every case that differs from the others in what the effect depends on."""
    for effect in EFFECTS:
        for case in CASES:
            if case.about in effect.about:
                yield effect, case


def why_not(effect: HardEffect, case: HardCase) -> str | None:
    """Why a case says nothing about an effect; None: it does."""
    subject = _subject(case.name)
    if subject.cameras.orthographic and not effect.parallel:
        return "it takes perspective cameras"
    if case.rounds and effect.borders:
        return "what lies on borders of cells decides"
    return effect.skip(subject)


def examine(effect: HardEffect, case: HardCase) -> Finding:
    """Run an effect on a case in all the ways that must agree."""
    begin = time.perf_counter()
    subject = _subject(case.name)
    reason = why_not(effect, case)
    if reason is not None:
        return Finding(effect=effect.name, case=case.name, skipped=reason)
    found = effect.run(subject)
    with limited_threads(1):
        again = effect.run(_once_more(case.name))
    finding = Finding(
        effect=effect.name,
        case=case.name,
        bounds=bounds_error(found, effect.bounds(subject)),
        repeats=same(found, again),
        law=effect.law.deviation(subject, found),
    )
    if case.about == "scene":  # others have the vertices of the first case, which float32 keeps as they are
        rounded = effect.run(_subject(case.name, rounded=True))
        finding = replace(finding, rounding=difference(found, rounded))
        if case.twin is not None:  # it holds for all cases or for none: a few will do
            stored = same(rounded, effect.run(case.subject().stored(torch.float64, rounded=True)))
            finding = replace(finding, stored=stored)
    if case.twin is not None and (effect.turns or not case.turned):
        finding = replace(finding, twin=difference(found, _usual(effect, case.twin)))
    return replace(finding, faults=tuple(faults(finding, effect)), seconds=time.perf_counter() - begin)


def faults(finding: Finding, effect: HardEffect) -> list[str]:
    """What must not be, in words; empty if all is well."""
    found = [] if finding.bounds is None else [finding.bounds]
    found += [] if finding.repeats else ["differs when run again, with one thread"]
    found += [] if finding.stored else ["depends on the type that vertices are stored in"]
    limits = {"rounding": effect.rounding, "law": effect.law.limit, "twin": effect.twins}
    for name, limit in limits.items():
        value = getattr(finding, name)
        if value is not None and not value <= limit:  # NaN is a fault
            found.append(f"{name}: {value:.3g}, limit {limit:g}")
    return found


@lru_cache(maxsize=2 * len(CASES))
def _subject(case: str, *, rounded: bool = False) -> Case:
    """What all effects share of a case."""
    subject = BY_NAME[case].subject()
    return subject.stored(torch.float32, rounded=True) if rounded else subject


@lru_cache(maxsize=len(CASES))
def _once_more(case: str) -> Case:
    """Made anew, for what is run again: all that effects share of it comes of one thread, too.

    What an effect would change in it for those after it is told by the cases that others look like: their float64 runs
    start from nothing.
    """
    return BY_NAME[case].subject()


@lru_cache(maxsize=len(EFFECTS))
def _usual(effect: HardEffect, case: str) -> Outputs:
    """Results on the case that others must look like."""
    return effect.run(_subject(case))


def numbers() -> dict[str, float]:
    """Largest relative difference between float32 and float64 of every numerical function, on the same arguments."""
    return {function.name: function.difference(NUMBERS) for function in NUMERICS}


def findings_of(effect: HardEffect, quick: bool = False) -> list[dict[str, Any]]:
    """Of all cases that are about an effect; ``quick``: of the first few. What must not be is said at once."""
    found = []
    for other, case in pairs():
        if other is effect and (not quick or case in CASES[:4]):
            found.append(asdict(examine(effect, case)))
            if found[-1]["faults"]:
                sys.stderr.write(f"{effect.name}, {case.name}: {'; '.join(found[-1]['faults'])}\n")
    return found


def study(quick: bool, parts: Parts) -> dict[str, Any]:
    """All findings, a part for each effect."""
    findings: list[dict[str, Any]] = []
    for effect in EFFECTS:
        findings += parts.measured(effect.name, partial(findings_of, effect, quick))
    return {
        "machine": machine_record(),
        "effects": [
            {
                "name": e.name, "law": e.law.text, "limit": e.law.limit, "rounding": e.rounding, "twins": e.twins,
                "modules": e.modules,
            }
            for e in EFFECTS
        ],
        "cases": [{"name": c.name, "why": c.why, "twin": c.twin} for c in CASES],
        "findings": findings,
        "numerics": numbers(),
    }  # fmt: skip


def run(folder: Path, quick: bool, parts: Parts) -> tuple[list[Path], int]:
    """Write the page and the record; with the number of pairs with a fault."""
    record = study(quick, parts)
    files = [folder / "stability.json", folder / "stability.md"]
    write_record(files[0], record)
    write_text(files[1], page(record))
    return files, sum(bool(finding["faults"]) for finding in record["findings"])


def main(argv: Sequence[str] | None = None) -> None:
    """The command; its exit status is 1 if something must not be."""
    faulty = 0

    def write(folder: Path, quick: bool, parts: Parts) -> list[Path]:
        nonlocal faulty
        files, faulty = run(folder, quick, parts)
        return files

    run_in_parts(__doc__, write, "stability", quick="a few cases, to check that it works", argv=argv)
    sys.exit(1 if faulty else 0)
