"""Every kernel module is imported by a test, where its slow twin is."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PACKAGE = ROOT / "torchrender" / "kernels"
MODULES = sorted(
    ".".join(("torchrender.kernels", *path.relative_to(PACKAGE).with_suffix("").parts))
    for path in PACKAGE.rglob("*.py")
    if path.name != "__init__.py"
)


def imported() -> set[str]:
    """Full names of all that tests import, from modules and as modules."""
    names = set()
    for path in (ROOT / "tests").rglob("test_*.py"):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Import):
                names |= {alias.name for alias in node.names}
            elif isinstance(node, ast.ImportFrom) and node.module:
                names |= {node.module, *(f"{node.module}.{alias.name}" for alias in node.names)}
    return names


IMPORTED = imported()


@pytest.mark.parametrize("module", MODULES)
def test_a_test_imports_the_kernel(module: str) -> None:
    assert module in IMPORTED, f"{module} is imported by no test: write its slow twin under tests/kernels"
