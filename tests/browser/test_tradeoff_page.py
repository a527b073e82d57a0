"""The page of curves: names cover neither each other nor points, settings stand in their own order."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from torchrender.tuning.tradeoff import SceneCurves
from torchrender.tuning.tradeoff_page import write_page

OVERLAPS = """() => {
  const boxes = [...document.querySelectorAll("#plot text")].filter(t => t.getAttribute("pointer-events") === "none")
    .map(t => t.getBBox());
  const dots = [...document.querySelectorAll("#plot circle")].map(c => c.getBBox());
  let count = 0;
  boxes.forEach((a, i) => { for (const b of [...boxes.slice(i + 1), ...dots]) count += overlap(a, b); });
  return [boxes.length, dots.length, count];
}"""


def _curves(settings: dict[str, tuple[float, float]]) -> SceneCurves:
    values = {
        name: {"ms": ms, "flip": flip, "psnr": 30.0, "relative_mse": 0.1, "own": None, "spread_ms": 0.1,
               "first_ms": ms, "runs": 2, "repeats": True, "picture": "", "difference": ""}
        for name, (ms, flip) in settings.items()
    }  # fmt: skip
    record = {"reference": "rays", "own_measure": None, "frontier": list(settings)[-1:], "settings": values,
              "commit": "abc1234", "date": "2026-01-01", "picture": ""}  # fmt: skip
    return SceneCurves("somewhere/1", 64, {"transparency": record})


@pytest.fixture
def page_of(browser: Any, tmp_path: Path) -> Iterator[Callable[[SceneCurves], Any]]:
    context = browser.new_context(viewport={"width": 1000, "height": 900})

    def opened(curves: SceneCurves) -> Any:
        write_page(tmp_path / "tradeoff.html", [curves])
        page = context.new_page()
        page.goto((tmp_path / "tradeoff.html").as_uri())
        return page

    yield opened
    context.close()


def test_names_cover_nothing(page_of: Callable[[SceneCurves], Any]) -> None:
    close = {f"a rather long name {k}": (10.0 + 0.3 * k, 0.1 + 0.001 * (k % 3)) for k in range(8)}
    page = page_of(_curves({**close, "far": (900.0, 0.0)}))
    assert page.evaluate(OVERLAPS) == [9, 9, 0]


def test_settings_stand_in_their_own_order(page_of: Callable[[SceneCurves], Any]) -> None:
    page = page_of(_curves({"off": (1.0, 0.2), "8": (2.0, 0.1), "0.5": (3.0, 0.05), "2": (4.0, 0.01)}))
    rows = page.evaluate(
        "() => [...document.querySelectorAll('#table tbody tr td:first-child')].map(c => c.textContent)"
    )
    assert rows == ["off", "8", "0.5", "2 *"]
    assert "Commit abc1234" in page.text_content("#summary")
