"""What the README shows works as printed."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import pytest

from torchrender.cli.main import main
from torchrender.image import Image
from torchrender.scene.procedural import SCENES

README = (Path(__file__).resolve().parent.parent / "README.md").read_text()


PAGES = sorted((Path(__file__).resolve().parent.parent / "docs").glob("*.md"))


def blocks(language: str, text: str = README) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", text, re.DOTALL)


def test_the_python_example_runs(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    # What needs a running server is tested with one, in tests/service.
    found = [block for block in blocks("python") if "StreamClient" not in block]
    assert found
    pictures = []
    for block in found:
        names: dict[str, object] = {}
        exec(compile(block, "README.md", "exec"), names)
        pictures += [value for value in names.values() if isinstance(value, Image)]
    assert pictures
    for picture in pictures:
        shown = picture.displayed()
        assert float(shown.std()) > 0.05, "a reader would see a blank wall"
        assert len(picture.visibility.object_id.unique()) > 4
    assert (tmp_path / "room.png").stat().st_size > 10_000
    assert "total" in capsys.readouterr().out


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_python_on_pages_runs(page: Path, tmp_path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    for block in blocks("python", page.read_text()):
        if "__main__" not in block:  # scripts that start processes are tested as files
            exec(compile(block, page.name, "exec"), {})


COMMANDS = re.findall(r"^    (torchrender .+)$", README, re.MULTILINE)


@pytest.mark.parametrize("command", COMMANDS)
def test_command_lines_run(command, tmp_path, monkeypatch):
    """With small images and the built-in box in place of the reader's model."""
    words = shlex.split(command, comments=True)[1:]
    words = ["cornell_box" if w.endswith(".glb") or w in SCENES else w for w in words]
    for option, value in (("--size", "40x30"), ("--triangles", "1000")):
        if option in words:
            words[words.index(option) + 1] = value
    monkeypatch.chdir(tmp_path)
    assert main(words) in (0, None)
    for k, word in enumerate(words):
        if word == "-o":
            assert any(tmp_path.glob(Path(words[k + 1]).stem + "*"))


def test_every_linked_file_exists():
    root = Path(__file__).resolve().parent.parent
    for page in (root / "README.md", *PAGES):
        links = re.findall(r"\]\(([^)#:]+)(?:#[^)]*)?\)", page.read_text())
        assert not [link for link in links if not (page.parent / link).exists()], page.name


def test_jobs_are_counted_alike_everywhere():
    docs = Path(__file__).resolve().parent.parent / "docs"
    count = len([page for page in (docs / "how-to").glob("*.md") if page.name != "index.md"])
    word = {13: "thirteen", 14: "fourteen", 15: "fifteen", 16: "sixteen", 17: "seventeen"}[count]
    for text in (README, *((docs / page).read_text() for page in ("index.md", "tutorial.md", "how-to/index.md"))):
        assert re.findall(r"\b(?:thir|four|fif|six|seven)teen\b", text.lower()) == [word]
