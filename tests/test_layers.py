"""The rules of the architecture keep themselves: imports point down, modules and functions stay small."""

from __future__ import annotations

import ast
import subprocess
import sys
from collections.abc import Iterator
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

PACKAGE = Path(__file__).resolve().parent.parent / "torchrender"
SERVICE = PACKAGE.parent / "service"

# From the ground up; a module may import what stands before its own entry, and its own package. The longest entry that
# a module's name starts with is the one that counts.
ORDER = (
    "errors",
    "checks",
    "clock",
    "kernels.compile",
    "numerics",
    "image_exr",
    "image_io",
    "kernels",
    "scene",
    "buffers",
    "raster",
    "rays",
    "ray_surface",
    "shade",
    "depth",
    "geometry",
    "reprojection",
    "reflection",
    "effects",
    "photo",
    "hit_shader",
    "options",
    "pace",
    "history",
    "walkthrough",
    "knobs",
    "frame",
    "steps",
    "reasons",
    "work",
    "passes",
    "curves",
    "chooser",
    "knowledge",
    "plans",
    "planner",
    "image",
    "renderer",
    "report",
    "client",
    "cli_output",
    "cli_voxels",
    "cli_points",
    "cli_fly",
    "cli_serve",
    "cli_plan",
    "cli_scene",
    "cli",
)
ABOVE = ("client", "cli_serve")
"""What may import the service, which stands beside the package."""
MAX_LINES = 330
MAX_FUNCTION_LINES = 60
MAX_PARAMETERS = 8

FILES = sorted(PACKAGE.rglob("*.py"))
SERVICE_FILES = sorted(SERVICE.rglob("*.py"))


def module_name(path: Path) -> str:
    parts = path.relative_to(PACKAGE).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


MODULES = {module_name(path): path for path in FILES}


def layer(module: str) -> int:
    parts = module.split(".")
    for length in range(len(parts), 0, -1):
        name = ".".join(parts[:length])
        if name in ORDER:
            return ORDER.index(name)
    raise AssertionError(f"torchrender.{module} has no place in ORDER of tests/test_layers.py")


def imports(path: Path) -> Iterator[str]:
    """Full names of everything that a file imports, at any depth, types included."""
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative import"
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


def internal_imports(path: Path) -> set[str]:
    """Modules of the package that a file imports; the package itself, which holds the version, is left out."""
    found = set()
    for name in imports(path):
        root, _, rest = name.partition(".")
        while root == "torchrender" and rest:
            if rest in MODULES:
                found.add(rest)
                break
            rest = rest.rpartition(".")[0]
    return found - {module_name(path)}


def functions(path: Path) -> Iterator[ast.FunctionDef | ast.AsyncFunctionDef]:
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            yield node


def test_the_checks_see_the_package() -> None:
    assert "renderer" in MODULES
    assert {"planner", "passes", "image"} <= internal_imports(MODULES["renderer"])


@pytest.mark.parametrize("module", [name for name in MODULES if name])
def test_imports_point_down(module: str) -> None:
    own = layer(module)
    for target in internal_imports(MODULES[module]):
        same_package = module.split(".")[0] == target.split(".")[0]
        assert layer(target) < own or same_package, f"torchrender.{module} imports torchrender.{target}"


def test_no_cycles() -> None:
    graph = {name: internal_imports(path) for name, path in MODULES.items() if name}
    TopologicalSorter(graph).prepare()


def test_effects_never_import_effects() -> None:
    for name, path in MODULES.items():
        if name.startswith("effects."):
            others = {target for target in internal_imports(path) if target.startswith("effects")}
            assert not others, f"torchrender.{name} imports {others}"


def test_only_its_client_and_command_import_the_service() -> None:
    for name, path in MODULES.items():
        if name.split(".")[0] not in ABOVE:
            assert not [t for t in imports(path) if t.split(".")[0] == "service"], f"torchrender.{name}"


def test_the_serving_process_does_not_load_the_renderer() -> None:
    """It must answer at once and stay small, whatever its renderers do."""
    code = "import sys, service.server; sys.exit(any(name in sys.modules for name in ('torch', 'numba')))"
    assert subprocess.run([sys.executable, "-c", code], cwd=PACKAGE.parent, check=False).returncode == 0


def test_only_kernels_import_numba() -> None:
    for name, path in MODULES.items():
        if not name.startswith("kernels"):
            used = [target for target in imports(path) if target.split(".")[0] in ("numba", "llvmlite")]
            assert not used, f"torchrender.{name} imports {used}"


@pytest.mark.parametrize("path", FILES + SERVICE_FILES, ids=lambda path: str(path.relative_to(PACKAGE.parent)))
def test_sizes(path: Path) -> None:
    lines = len(path.read_text().splitlines())
    assert lines <= MAX_LINES, f"{path.name} has {lines} lines: look for the missing idea"
    for function in functions(path):
        length = (function.end_lineno or function.lineno) - function.lineno + 1
        assert length <= MAX_FUNCTION_LINES, f"{path.name}: {function.name} has {length} lines"
        if path.parent.name == "kernels":
            continue  # compiled loops take arrays one by one: records would have to be unpacked at each call
        arguments = function.args
        names = [a.arg for a in (*arguments.posonlyargs, *arguments.args, *arguments.kwonlyargs)]
        count = len([n for n in names if n not in ("self", "cls")])
        assert count <= MAX_PARAMETERS, f"{path.name}: {function.name} has {count} parameters"
