"""The documentation: whole, linked, and built without a warning where its extra is installed."""

from __future__ import annotations

import inspect
import os
import re
import subprocess
import sys
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path

import pytest

import torchrender as tr

ROOT = Path(__file__).resolve().parents[2]
DOCS = ROOT / "docs"
PAGES = sorted(DOCS.rglob("*.md"))
NEEDED = ("sphinx", "furo", "myst_parser", "latex2mathml")


def documented() -> list[str]:
    """Full names of what the reference shows."""
    found = []
    for page in (DOCS / "reference").glob("*.md"):
        module = ""
        for line in page.read_text().splitlines():
            if match := re.match(r"\.\. currentmodule:: (\S+)", line):
                module = match[1]
            elif match := re.match(r"\.\. auto(?:class|function|exception):: (\S+)", line):
                found.append(f"{module}.{match[1]}")
    return found


def test_the_reference_has_every_public_name_once() -> None:
    names = documented()
    assert len(names) == len(set(names))
    for module in ("torchrender", "torchrender.batch", "torchrender.client", "torchrender.photo.fog"):
        public = {f"{module}.{name}" for name in import_module(module).__all__ if not name.startswith("_")}
        assert public <= set(names), public - set(names)
    for full in names:
        module, _, name = full.rpartition(".")
        assert inspect.getdoc(getattr(import_module(module), name)), full


def test_the_reference_has_every_error_and_warning() -> None:
    errors = import_module("torchrender.errors")
    own = {n for n, kind in vars(errors).items() if inspect.isclass(kind) and kind.__module__ == errors.__name__}
    shown = {full.rpartition(".")[2] for full in documented() if full.startswith("torchrender.errors.")}
    assert own - {"TorchRenderError"} == shown


def test_pages_show_the_scripts_as_they_are() -> None:
    pages = [page for page in (DOCS / "how-to").glob("*.md") if page.stem != "index"]
    assert len(pages) == 17
    for page in pages:
        script = (DOCS / "examples" / f"{page.stem.replace('-', '_')}.py").read_text()
        (block,) = re.findall(r"```python\n(.*?)```", page.read_text(), re.DOTALL)
        assert script.split('"""\n', 1)[1].lstrip("\n") == block, f"{page.name} and its script differ"


def test_every_system_has_a_picture_a_formula_settings_and_limits() -> None:
    pages = [page for page in (DOCS / "systems").glob("*.md") if page.stem != "index"]
    assert len(pages) == 14
    for page in pages:
        text = page.read_text()
        for part in ("![", "```math", "## Settings", "## Limits", "results/"):
            if part != "results/" or page.stem != "scattering":
                assert part in text, f"{page.name}: {part}"


def test_every_file_that_a_page_names_exists() -> None:
    for page in PAGES:
        links = re.findall(r"\]\(([^)#:]+)(?:#[^)]*)?\)", page.read_text())
        assert not [link for link in links if not (page.parent / link).exists()], page


def test_help_is_short_and_says_where_to_go_on() -> None:
    text = tr.__doc__ or ""
    assert len(text.splitlines()) < 40
    for name in ("load", "render", "rasterize", "RayCaster", "Cameras.look_at", "Mesh.box"):
        assert f"tr.{name}" in text
        found: object = tr
        for part in name.split("."):
            found = getattr(found, part)


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    missing = [name for name in NEEDED if find_spec(name) is None]
    if missing:
        if os.environ.get("TORCHRENDER_REQUIRE_DOCS"):
            pytest.fail(f"the site needs {', '.join(missing)}")
        pytest.skip(f'the site needs {", ".join(missing)}: pip install "torchrender[docs]"')
    out = tmp_path_factory.mktemp("site")
    command = [sys.executable, "-m", "sphinx", "-q", "-W", "--keep-going", "-b", "html", str(DOCS), str(out)]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return out


def test_the_site_builds_without_a_warning_and_needs_no_network(site: Path) -> None:
    pages = list(site.rglob("*.html"))
    assert len(pages) > len(PAGES)
    for page in pages:
        loaded = re.findall(r'<(?:script|link|img|iframe)[^>]+(?:src|href)="(https?://[^"]+)"', page.read_text())
        assert not loaded, f"{page.name} loads {loaded}"
    reference = (site / "reference" / "pictures.html").read_text()
    assert 'id="torchrender.render"' in reference and "rendered pixels per picture pixel" in reference
    assert '<math xmlns="http://www.w3.org/1998/Math/MathML"' in (site / "systems" / "scattering.html").read_text()
    assert '<svg class="curves"' in (site / "systems" / "reflections.html").read_text()
