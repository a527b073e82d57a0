"""Seed the faults of the list one at a time into a copy of the tree and tell which the tests notice.

    make mutants                     all of the list, about an hour on two cores
    make mutants AREAS="warp points" some areas
    make mutants CHANCE=3            faults by chance instead, three in each of the modules; SEED=1 draws others

What was found is kept in ``build/mutants.jsonl`` and not asked again until the list or its tests change; ``--seconds``
ends a run early, the next one goes on, and runs beside each other share what they find. Tests that fail without a fault
tell nothing: each are run so first. ``--page`` writes the kept verdicts to ``docs/results/mutants.md``.
"""

from __future__ import annotations

import argparse
import os
import signal
import sys
import time
from collections import Counter
from pathlib import Path

os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")
sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

# Once, before all of the processes that are forked from this one.
import numba  # noqa: F401
import pytest  # noqa: F401
import scipy.sparse  # noqa: F401
import torch  # noqa: F401

from mutants.bench import CAUGHT, ENDLESS, SURVIVED, UNUSABLE, Bench
from mutants.chance import drawn
from mutants.fault import Fault
from mutants.listed import FAULTS
from mutants.modules import modules
from mutants.page import write_page
from mutants.verdicts import NOT_ASKED, Verdicts, missed, table

ROOT = Path(__file__).resolve().parents[2]


def main() -> int:
    """The command; its status tells whether every fault was noticed."""
    signal.signal(signal.SIGTERM, lambda *_: sys.exit("stopped"))
    options = _options()
    chosen = [f for f in FAULTS if not options.areas or f.area in options.areas]
    if options.chance:
        chosen = [f for one in modules(options.areas) for f in drawn(ROOT, *one, options.chance, options.seed)]
    verdicts = Verdicts(ROOT)
    _ask(_in_turn(chosen), verdicts, options)
    if options.page:
        print(write_page(ROOT, FAULTS, verdicts))
    return _score(chosen, verdicts)


def _ask(chosen: list[Fault], verdicts: Verdicts, options: argparse.Namespace) -> None:
    """Seed those that have no verdict, while there is time."""
    end = time.monotonic() + options.seconds
    bench = None
    for fault in chosen:
        known = verdicts.find(fault)["verdict"]
        if known in (CAUGHT, ENDLESS) or (known != NOT_ASKED and not options.again):
            continue
        if time.monotonic() > end:
            break
        bench = bench or Bench(ROOT, ROOT / "build" / "mutants")
        if verdicts.of_tests(fault.tests) == NOT_ASKED:
            verdict, said = bench.run(None, "", fault.tests, options.limit)
            verdicts.add_tests(fault.tests, verdict, said)
            print(f"{'passed' if verdict == SURVIVED else verdict:9}  without a fault  {fault.tests}", flush=True)
        if verdicts.of_tests(fault.tests) != SURVIVED:
            verdicts.add(fault, UNUSABLE, "its tests fail without a fault")
            continue
        begin = time.monotonic()
        try:
            verdict, said = bench.run(fault.file, fault.seeded(ROOT), fault.tests, options.limit)
        except ValueError as error:
            verdict, said = UNUSABLE, str(error)
        verdicts.add(fault, verdict, said)
        print(f"{verdict:9}{time.monotonic() - begin:6.1f} s  {fault.area}  {fault.title}", flush=True)


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("areas", nargs="*", help="of the list; default: all")
    parser.add_argument("--chance", type=int, default=0, help="faults by chance in each module instead of the list's")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--seconds", type=float, default=1e9, help="begin no other fault after so long")
    parser.add_argument("--limit", type=float, default=200.0, help="seconds after which a test run is endless")
    parser.add_argument("--again", action="store_true", help="ask again about those that were not caught")
    parser.add_argument("--page", action="store_true", help="write the page of results")
    return parser.parse_args()


def _in_turn(chosen: list[Fault]) -> list[Fault]:
    """One of each area, then the next of each: what a part of the time finds out is about all of them."""
    seen: Counter[str] = Counter()
    places = {}
    for fault in chosen:
        places[fault.key] = seen[fault.area]
        seen[fault.area] += 1
    return sorted(chosen, key=lambda fault: places[fault.key])


def _score(chosen: list[Fault], verdicts: Verdicts) -> int:
    """Print the table; 0 if all were asked and caught."""
    print(f"\n{'area':18}{'caught':>8}{'asked':>8}{'seeded':>8}{'score':>8}")
    rows = table(chosen, verdicts)
    for area, caught, asked, seeded in rows:
        print(f"{area:18}{caught:8}{asked:8}{seeded:8}{f'{100 * caught / asked:.0f} %' if asked else '-':>8}")
    for verdict, fault in missed(chosen, verdicts):
        print(f"  {verdict:9} {fault.area}: {fault.title}")
    return 0 if rows[-1][1] == rows[-1][3] else 1


if __name__ == "__main__":
    sys.exit(main())
