"""Seed the faults of the list one at a time into a copy of the tree and tell which the tests notice.

    make mutants                     all of the list, about an hour on two cores
    make mutants AREAS="warp points" some areas
    make mutants CHANCE=3            faults by chance instead, three in each of the modules; SEED=1 draws others

What was found is kept in ``build/mutants.jsonl`` and not asked again until the list, the file or its tests change;
``--seconds`` ends a run early, the next one goes on.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import sys
import tempfile
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

from mutants.bench import CAUGHT, ENDLESS, SURVIVED, UNUSABLE, Bench, arguments
from mutants.chance import drawn
from mutants.fault import Fault
from mutants.listed import FAULTS
from mutants.modules import modules

ROOT = Path(__file__).resolve().parents[2]
KEPT = ROOT / "build" / "mutants.jsonl"


def main() -> int:
    """The command; its status tells whether every fault was noticed."""
    options = _options()
    chosen = [f for f in FAULTS if not options.areas or f.area in options.areas]
    if options.chance:
        chosen = [f for one in modules(options.areas) for f in drawn(ROOT, *one, options.chance, options.seed)]
    known = _kept()
    chosen = _in_turn(chosen)
    end = time.monotonic() + options.seconds
    with tempfile.TemporaryDirectory(prefix="torchrender-mutants-") as folder:
        bench = Bench(ROOT, Path(folder))
        for fault in chosen:
            key = f"{fault.key}-{_state(fault)}"
            if _verdict(fault, known) == CAUGHT or (key in known and not options.again):
                continue
            if time.monotonic() > end:
                break
            begin = time.monotonic()
            try:
                verdict, said = bench.run(fault.file, fault.seeded(ROOT), fault.tests, options.limit)
            except ValueError as error:
                verdict, said = UNUSABLE, str(error)
            known[key] = {"key": key, "verdict": verdict, "said": said if verdict != CAUGHT else said[-300:]}
            KEPT.parent.mkdir(exist_ok=True)
            with KEPT.open("a") as file:
                file.write(json.dumps(known[key]) + "\n")
            print(f"{verdict:9}{time.monotonic() - begin:6.1f} s  {fault.area}  {fault.title}", flush=True)
    return _score(chosen, known)


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("areas", nargs="*", help="of the list; default: all")
    parser.add_argument("--chance", type=int, default=0, help="faults by chance in each module instead of the list's")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--seconds", type=float, default=1e9, help="begin no other fault after so long")
    parser.add_argument("--limit", type=float, default=200.0, help="seconds after which a test run is endless")
    parser.add_argument("--again", action="store_true", help="ask again about those that were not caught")
    return parser.parse_args()


def _in_turn(chosen: list[Fault]) -> list[Fault]:
    """One of each area, then the next of each: what a part of the time finds out is about all of them."""
    seen: Counter[str] = Counter()
    places = {}
    for fault in chosen:
        places[fault.key] = seen[fault.area]
        seen[fault.area] += 1
    return sorted(chosen, key=lambda fault: places[fault.key])


def _state(fault: Fault) -> str:
    """Of the tests: what was found holds as long as they are the same."""
    named = [ROOT / word.partition("::")[0] for word in arguments(fault.tests)]
    files = [file for one in named for file in (sorted(one.rglob("*.py")) if one.is_dir() else [one])]
    told = b"".join(file.read_bytes() for file in files if file.is_file())
    return hashlib.sha256(told).hexdigest()[:8]


def _verdict(fault: Fault, known: dict[str, dict[str, str]]) -> str:
    """What was found: of these tests, or that earlier ones caught it, as tests are not taken away."""
    if fault.key in known:
        return CAUGHT
    return known.get(f"{fault.key}-{_state(fault)}", {"verdict": "not asked"})["verdict"]


def _kept() -> dict[str, dict[str, str]]:
    if not KEPT.exists():
        return {}
    rows = (json.loads(line) for line in KEPT.read_text().splitlines())
    found = {row["key"]: row for row in rows}
    return found | {key.partition("-")[0]: row for key, row in found.items() if row["verdict"] == CAUGHT}


def _score(chosen: list[Fault], known: dict[str, dict[str, str]]) -> int:
    """Print the table; 0 if all were asked and caught."""
    rows: dict[str, list[str]] = {}
    missed = []
    for fault in chosen:
        verdict = _verdict(fault, known)
        rows.setdefault(fault.area, []).append(verdict)
        if verdict in (SURVIVED, UNUSABLE):
            missed.append(f"  {verdict:9} {fault.area}: {fault.title}")
    print(f"\n{'area':16}{'caught':>8}{'seeded':>8}{'not asked':>11}{'score':>8}")
    rows["all"] = [one for found in rows.values() for one in found]
    for area, found in rows.items():
        asked = [one for one in found if one in (CAUGHT, ENDLESS, SURVIVED)]
        caught = sum(one != SURVIVED for one in asked)
        share = f"{100 * caught / len(asked):.0f} %" if asked else "-"
        print(f"{area:16}{caught:8}{len(asked):8}{len(found) - len(asked):11}{share:>8}")
    print("\n".join(missed))
    return 0 if all(one in (CAUGHT, ENDLESS) for one in rows["all"]) else 1


if __name__ == "__main__":
    sys.exit(main())
