"""The notebook of the documentation, cell by cell in one namespace, as a kernel runs it."""

from __future__ import annotations

import ast
import json
from pathlib import Path
from typing import Any

import pytest

NOTEBOOK = Path(__file__).resolve().parents[2] / "docs" / "examples" / "viewer.ipynb"


def run_cell(source: str, names: dict[str, Any]) -> Any:
    """Run a cell; the value of its last line, where that is an expression which does not end with a semicolon."""
    tree = ast.parse(source)
    last = tree.body.pop() if isinstance(tree.body[-1], ast.Expr) and not source.rstrip().endswith(";") else None
    exec(compile(tree, str(NOTEBOOK), "exec"), names)
    return eval(compile(ast.Expression(last.value), str(NOTEBOOK), "eval"), names) if last is not None else None


def test_the_notebook_runs_and_shows_its_values(monkeypatch: pytest.MonkeyPatch) -> None:
    opened: list[str] = []
    monkeypatch.setattr("webbrowser.open", opened.append)
    cells = json.loads(NOTEBOOK.read_text())["cells"]
    names: dict[str, Any] = {}
    shown = [run_cell("".join(c["source"]), names) for c in cells if c["cell_type"] == "code"]
    scene, view, _, meshes, triangles, found, image, plan, _ = shown
    assert "<" in scene._repr_html_()
    assert view._repr_html_().startswith('<iframe src="http://127.0.0.1:')
    assert meshes == len(scene.meshes)
    assert triangles == 8 * 200
    assert isinstance(found[0], str) and len(found[2]) == 3
    assert image._repr_png_()[:4] == b"\x89PNG"
    assert "pass" in (plan._repr_html_() if hasattr(plan, "_repr_html_") else str(plan))
    assert opened and not any(c.get("outputs") for c in cells), "kept without outputs"
