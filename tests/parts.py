"""In which order processes that share the tests take them: whole files, what takes longest first."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

from xdist.scheduler import LoadFileScheduling

BROWSER = "tests/browser"
"""One part: its files share a server, a browser and the pages that are open in it."""
LONGEST = (
    BROWSER,
    "tests/hard/test_stability.py",
    "tests/docs/test_examples.py",
    "tests/hard/test_enhancement.py",
    "tests/hard/test_walkthrough.py",
    "tests/kernels/test_signatures.py",
    "tests/docs/test_site.py",
    "tests/hard/test_inputs.py",
    "tests/service/test_viewer_routes.py",
    "tests/kernels/test_warm_up.py",
    "tests/kernels/test_compile.py",
    "tests/passes/test_batches.py",
    "tests/service/test_shutdown.py",
    "tests/test_docs.py",
    "tests/hard/test_clustered_reflection.py",
    "tests/hard/test_material_style.py",
    "tests/report/test_reflections.py",
    "tests/service/test_stream.py",
    "tests/service/test_api.py",
)
"""Parts of ten seconds and more, the longest first. Left to the end, one of them keeps a process busy while the others
have nothing to do."""
_RANKS = {part: rank for rank, part in enumerate(LONGEST)}


def part_of(test: str) -> str:
    """The part that a test belongs to: its file, or the folder of pages."""
    file = test.partition("::")[0]
    return BROWSER if file.startswith(f"{BROWSER}/") else file


def in_turn(tests: list[str]) -> list[int]:
    """Places in ``tests`` in the order in which they are taken: behind the longest, parts with many tests first."""
    parts = [part_of(test) for test in tests]
    size = Counter(parts)
    turn = {
        part: (_RANKS.get(part, len(_RANKS)), -size[part], first) for first, part in enumerate(dict.fromkeys(parts))
    }
    return sorted(range(len(tests)), key=lambda place: turn[parts[place]])


class PartScheduling(LoadFileScheduling):
    """``--dist loadfile`` by parts, which processes take as their tests are sorted."""

    def _split_scope(self, nodeid: str) -> str:
        return part_of(nodeid)


def missing(root: Path) -> list[str]:
    """Names of :data:`LONGEST` that are no longer there."""
    return [part for part in LONGEST if not (root / part).exists()]
