"""Pictures that mesh files name: where they are, and what is said where they are not."""

from __future__ import annotations

from pathlib import Path

from torchrender.errors import TorchRenderWarning


class MissingTextureWarning(TorchRenderWarning):
    """A mesh file names a picture or material file that cannot be read; the plain colour is used instead."""


def find_beside(path: Path, name: str) -> Path:
    """The file of that name beside ``path``; where there is none, one of its last part, in any case of letters.

    Files are often written on another machine: they name their pictures by whole paths, or in other letters.
    """
    named = path.parent / name.replace("\\", "/")
    try:
        if named.is_file():
            return named
        last = named.name.lower()
        for folder in dict.fromkeys((named.parent, path.parent)):
            found = sorted(f for f in folder.iterdir() if f.name.lower() == last) if folder.is_dir() else []
            if found:
                return found[0]
    except (OSError, ValueError):  # no name at all: too long, or with bytes that names do not have
        pass
    return named
