"""Which files a scene file names, without reading what is in them: so that none of them is written over."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from pathlib import Path
from urllib.parse import quote, unquote

TEXTS = (".toml", ".gltf", ".obj", ".mtl", ".json", ".jsonl")
"""Files that name others."""
_QUOTED = re.compile(rb"""["']([^"'\r\n]{1,1024}\.(?:gltf|obj|mtl))["']""", re.IGNORECASE)


def names_file(source: Path, file: Path) -> bool:
    """Whether a file is ``source`` itself, or one that it names, or that a text among those names."""
    todo = [source]
    seen: set[Path] = set()
    while todo:
        text = todo.pop()
        if text in seen or not os.path.isfile(text):
            continue
        seen.add(text)
        if text.samefile(file):
            return True
        if text.suffix.lower() in TEXTS:
            data = text.read_bytes()
            if any(_is_in(data, name) for name in _spellings(text.parent, file)):
                return True
            todo += [text.parent / name for name in _texts_in(data, text.suffix.lower())]
    return False


def _spellings(folder: Path, file: Path) -> set[bytes]:
    """How a text in a folder may name a file."""
    absolute = os.path.abspath(file)
    names = {absolute}
    if os.path.splitdrive(absolute)[0] == os.path.splitdrive(os.path.abspath(folder))[0]:
        names.add(os.path.relpath(absolute, os.path.abspath(folder)))
    plain = {Path(name).as_posix() for name in names}
    spelled = plain | {quote(name) for name in plain} | {name.replace("/", "\\") for name in plain}
    return {name.encode(errors="surrogateescape") for name in spelled}


def _is_in(data: bytes, name: bytes) -> bool:
    """Whether a name is there, not as the end of a longer one."""
    at = data.find(name)
    while at >= 0:
        before = data[max(at - 3, 0) : at]
        if before.endswith(b"./") and not before.endswith(b"../"):
            before = before[:-2]
        last = before[-1:].decode("latin-1")
        if not (last.isalnum() or last in tuple("_-./\\")):
            return True
        at = data.find(name, at + 1)
    return False


def _texts_in(data: bytes, suffix: str) -> Iterator[str]:
    """Names of further texts."""
    if suffix == ".obj":
        at = data.find(b"mtllib ")
        while at >= 0:
            end = data.find(b"\n", at)
            yield data[at + 7 : end if end >= 0 else None].decode("utf-8", "surrogateescape").strip()
            at = data.find(b"mtllib ", at + 7)
    elif suffix in (".toml", ".json"):
        for found in _QUOTED.findall(data):
            yield unquote(found.decode("utf-8", "surrogateescape"))
