"""The rules of the architecture keep themselves: imports point down, folders, modules and functions stay small."""

from __future__ import annotations

import ast
import subprocess
import sys
from collections import Counter
from collections.abc import Iterator
from functools import cache
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
HOMES = {"torchrender": ROOT / "torchrender", "torchrender_service": ROOT / "service" / "torchrender_service"}

# From the ground up; a module may import what stands before its own entry, and modules of its own entry. The longest
# entry that a module's name starts with is the one that counts, so a folder may be split over several entries.
ORDER = (
    "torchrender.errors",
    "torchrender.extras",
    "torchrender.checks",
    "torchrender.brief",
    "torchrender.clock",
    "torchrender.arrays",
    "torchrender.kernels.hooks",
    "torchrender.kernels.claims",
    "torchrender.kernels.keys",
    "torchrender.kernels.front_end",
    "torchrender.kernels.libraries",
    "torchrender.kernels.store",
    "torchrender.kernels.compile",
    "torchrender.kernels.stages",
    "torchrender.numerics",
    "torchrender.images",
    "torchrender.kernels",
    "torchrender.scene",
    "torchrender.buffers",
    "torchrender.shading.attributes",
    "torchrender.fragment_tests",
    "torchrender.raster",
    "torchrender.rays",
    "torchrender.shading",
    "torchrender.shade",
    "torchrender.depth",
    "torchrender.reconstruct",
    "torchrender.voxels",
    "torchrender.points",
    "torchrender.effects",
    "torchrender.pipeline",
    "torchrender.passes",
    "torchrender.planning",
    "torchrender.image",
    "torchrender.run",
    "torchrender.renderer",
    "torchrender.photo",
    "torchrender.walkthrough",
    "torchrender.quality",
    "torchrender.tuning",
    "torchrender.report",
    "torchrender.wire",
    "torchrender.client",
    "torchrender_service.errors",
    "torchrender_service.problems",
    "torchrender_service.settings",
    "torchrender_service.logs",
    "torchrender_service.metrics",
    "torchrender_service.imports",
    "torchrender_service.scheduling",
    "torchrender_service.door",
    "torchrender_service.renderers",
    "torchrender_service.scenes",
    "torchrender_service.streams",
    "torchrender_service.web",
    "torchrender_service.serving",
    "torchrender_service.ray_directory",
    "torchrender_service.ray_app",
    "torchrender_service.ray_local",
    "torchrender_service.load_test",
    "torchrender_service.viewer",
    "torchrender.viewer",
    "torchrender.batch",
    "torchrender.report.distributed",
    "torchrender.cli",
    "torchrender.__main__",
)
EFFECTS = "torchrender.effects."
SERVING = ("torchrender.cli.serve", "torchrender.viewer", "torchrender.report.distributed")
"""What may import the service, which stands beside the package."""
MAX_LINES = 330
MAX_MODULES = 15
MAX_FUNCTION_LINES = 60
MAX_PARAMETERS = 8


def module_name(root: str, path: Path) -> str:
    parts = (root, *path.relative_to(HOMES[root]).with_suffix("").parts)
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


MODULES = {module_name(root, path): path for root, home in HOMES.items() for path in sorted(home.rglob("*.py"))}


def entry(module: str) -> str:
    """The entry of ORDER that counts for a module."""
    parts = module.split(".")
    for length in range(len(parts), 0, -1):
        name = ".".join(parts[:length])
        if name in ORDER:
            return name
    raise AssertionError(f"{module} has no place in ORDER of tests/test_layers.py")


@cache
def imports_of(text: str) -> tuple[str, ...]:
    """Full names of everything that a module's text imports, at any depth, types included."""
    return tuple(_imports(ast.parse(text)))


def _imports(tree: ast.Module) -> Iterator[str]:
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"relative import of {node.module}"
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


def internal_imports(module: str, modules: dict[str, Path] | None = None) -> set[str]:
    """Modules of both packages that a file imports; the packages themselves, which hold the version, are left out."""
    known = MODULES if modules is None else modules
    found = set()
    for full in imports_of(known[module].read_text()):
        name = full
        while "." in name:
            if name in known:
                found.add(name)
                break
            name = name.rpartition(".")[0]
    return found - {module}


def functions(path: Path) -> Iterator[ast.FunctionDef | ast.AsyncFunctionDef]:
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            yield node


def is_kernel(module: str) -> bool:
    return module.startswith("torchrender.kernels.")


def upward(module: str, modules: dict[str, Path] | None = None) -> list[str]:
    """What a module imports although it stands above it, or beside it without being of its entry."""
    own = entry(module)
    return [
        target
        for target in sorted(internal_imports(module, modules))
        if entry(target) != own and ORDER.index(entry(target)) > ORDER.index(own)
    ]


def test_the_checks_see_both_packages() -> None:
    assert {"torchrender.renderer", "torchrender_service.streams.stream"} <= set(MODULES)
    assert {"torchrender.planning.planner", "torchrender.image"} <= internal_imports("torchrender.renderer")
    assert "torchrender.wire.messages" in internal_imports("torchrender_service.streams.stream")


def test_an_import_that_points_up_is_found_however_deep_the_file_lies(tmp_path: Path) -> None:
    """A folder is no excuse: nested modules are held to the order as flat ones are."""
    path = tmp_path / "tiles.py"
    path.write_text("from torchrender.passes.table import PASSES\n")
    modules = {**MODULES, "torchrender.kernels.raster.tiles": path}
    assert upward("torchrender.kernels.raster.tiles", modules) == ["torchrender.passes.table"]
    path.write_text("from torchrender.scene.model import Scene\n")
    assert upward("torchrender.kernels.raster.tiles", modules) == ["torchrender.scene.model"]


def test_a_kernel_is_known_by_its_package_not_by_its_folder() -> None:
    assert is_kernel("torchrender.kernels.raster.tiles") and not is_kernel("torchrender.report.kernels")


@pytest.mark.parametrize("module", [name for name in MODULES if name not in HOMES])
def test_imports_point_down(module: str) -> None:
    assert not upward(module), f"{module} imports {upward(module)}"


def test_no_cycles() -> None:
    TopologicalSorter({name: internal_imports(name) for name in MODULES if name not in HOMES}).prepare()


def test_effects_never_import_effects() -> None:
    """Parts of one effect share a folder."""
    for name in MODULES:
        if name.startswith(EFFECTS):
            own = name.removeprefix(EFFECTS).split(".")[0]
            others = [t for t in internal_imports(name) if t.startswith(EFFECTS)]
            foreign = [t for t in others if t.removeprefix(EFFECTS).split(".")[0] != own]
            assert not foreign, f"{name} imports {foreign}"


def test_only_what_serves_imports_the_service() -> None:
    for name, path in MODULES.items():
        if name.startswith("torchrender.") and not name.startswith(SERVING):
            used = [t for t in imports_of(path.read_text()) if t.split(".")[0] == "torchrender_service"]
            assert not used, f"{name} imports {used}"


def test_the_serving_process_does_not_load_the_renderer() -> None:
    """It must answer at once and stay small, whatever its renderers do."""
    code = (
        "import sys, torchrender_service.web.server as s; sys.exit(any(n in sys.modules for n in ('torch', 'numba')))"
    )
    assert subprocess.run([sys.executable, "-c", code], cwd=ROOT, check=False).returncode == 0


def test_only_kernels_import_numba() -> None:
    for name, path in MODULES.items():
        if not is_kernel(name):
            used = [target for target in imports_of(path.read_text()) if target.split(".")[0] in ("numba", "llvmlite")]
            assert not used, f"{name} imports {used}"


def test_folders_stay_small() -> None:
    count = Counter(path.parent for path in MODULES.values() if path.name not in ("__init__.py", "__main__.py"))
    large = {str(folder.relative_to(ROOT)): number for folder, number in count.items() if number > MAX_MODULES}
    assert not large, f"more than {MAX_MODULES} modules: look for the missing idea"


@pytest.mark.parametrize("module", MODULES)
def test_sizes(module: str) -> None:
    path = MODULES[module]
    lines = len(path.read_text().splitlines())
    assert lines <= MAX_LINES, f"{module} has {lines} lines: look for the missing idea"
    for function in functions(path):
        length = (function.end_lineno or function.lineno) - function.lineno + 1
        assert length <= MAX_FUNCTION_LINES or is_kernel(module), f"{module}: {function.name} has {length} lines"
        arguments = function.args
        names = [a.arg for a in (*arguments.posonlyargs, *arguments.args, *arguments.kwonlyargs)]
        count = len([n for n in names if n not in ("self", "cls")])
        assert count <= MAX_PARAMETERS, f"{module}: {function.name} has {count} parameters"
