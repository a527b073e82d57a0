"""Marks in files: TOML, or JSON with the same keys."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any, TypeVar

import tomllib

from torchrender.errors import InputError, SceneFileError
from torchrender.images.files import write_atomically
from torchrender.photo.fog.marks.records import (
    CameraMark,
    CuboidMark,
    LampMark,
    LightMark,
    Marks,
    OutdoorMark,
    RegionMark,
    RoomMark,
    WindowMark,
)

T = TypeVar("T")
MAX_BYTES = 2**20
MAX_MARKS = 256
SUFFIXES = (".toml", ".json")
ONE = {"camera": CameraMark, "room": RoomMark, "outdoor": OutdoorMark}
MANY = {"light": LightMark, "window": WindowMark, "cuboid": CuboidMark, "lamp": LampMark, "region": RegionMark}
PLURAL = {"light": "lights", "window": "windows", "cuboid": "cuboids", "lamp": "lamps", "region": "regions"}
_WORDS = ("wall", "label", "kind", "labels")
_FLAGS = ("on", "glow")
_WHOLE = ("width", "height")


def read_marks(path: str | Path) -> Marks:
    """Marks of a file.

    Raises:
        SceneFileError: missing, damaged, unknown keys or values; names the file, the key and the reason.
    """
    path = Path(path)
    if path.suffix.lower() not in SUFFIXES:
        raise SceneFileError(path, f"marks are read from {', '.join(SUFFIXES)}")
    try:
        data = path.read_bytes()
    except OSError as error:
        raise SceneFileError(path, "no such file" if isinstance(error, FileNotFoundError) else str(error)) from error
    return parse_marks(data, path)


def parse_marks(data: bytes, name: str | Path) -> Marks:
    """Marks of a file in memory; the suffix of ``name`` tells whether it is JSON. Errors as in :func:`read_marks`."""
    if len(data) > MAX_BYTES:
        raise SceneFileError(name, f"marks have at most {MAX_BYTES} bytes, got {len(data)}")
    try:
        text = data.decode("utf-8-sig")
        table = json.loads(text) if Path(name).suffix.lower() == ".json" else tomllib.loads(text)
    except (ValueError, RecursionError) as error:
        raise SceneFileError(name, f"cannot be read: {error}") from error
    if not isinstance(table, dict):
        raise SceneFileError(name, "must be a table")
    return marks_of(table, name)


def marks_of(table: Mapping[str, Any], name: str | Path = "marks") -> Marks:
    """Marks from a table with the keys of a file. Errors as in :func:`read_marks`."""
    _known(table, ("photo", "labels", *ONE, *MANY), name, None)
    given: dict[str, Any] = {}
    for key, kind in ONE.items():
        if key in table:
            given[key] = _record(kind, table[key], name, key)
    for key, kind in MANY.items():
        entries = table.get(key, [])
        if not isinstance(entries, list) or len(entries) > MAX_MARKS:
            raise SceneFileError(name, f"must be a list of at most {MAX_MARKS} tables", key=key)
        given[PLURAL[key]] = tuple(_record(kind, entry, name, f"{key}[{k}]") for k, entry in enumerate(entries))
    photo = table.get("photo", {})
    if not isinstance(photo, dict):
        raise SceneFileError(name, "must be a table", key="photo")
    _known(photo, _WHOLE, name, "photo")
    for key, value in photo.items():
        if isinstance(value, bool) or not isinstance(value, int):
            raise SceneFileError(name, f"must be a whole number, got {value!r}", key=f"photo.{key}")
    labels = table.get("labels")
    if labels is not None and not isinstance(labels, str):
        raise SceneFileError(name, f"must name a picture, got {labels!r}", key="labels")
    try:
        return Marks(**given, **photo, labels=labels)
    except InputError as error:
        raise SceneFileError(name, str(error)) from error


def _known(table: Mapping[str, Any], keys: tuple[str, ...], name: str | Path, where: str | None) -> None:
    for key in table:
        if key not in keys:
            raise SceneFileError(name, f"unknown key {key!r}; known are {', '.join(keys)}", key=where)


def _record(kind: type[T], table: object, name: str | Path, where: str) -> T:
    if not isinstance(table, dict):
        raise SceneFileError(name, f"must be a table, got {table!r}", key=where)
    _known(table, tuple(f.name for f in fields(kind)), name, where)  # type: ignore[arg-type]
    for key, value in table.items():
        wanted = str if key in _WORDS else bool if key in _FLAGS else None
        if wanted is not None and not isinstance(value, wanted):
            raise SceneFileError(name, f"must be a {wanted.__name__}, got {value!r}", key=f"{where}.{key}")
        if wanted is None and isinstance(value, str | bool):
            raise SceneFileError(name, f"must be numbers, got {value!r}", key=f"{where}.{key}")
    try:
        return kind(**table)
    except (InputError, TypeError, AttributeError, ValueError) as error:
        raise SceneFileError(name, str(error), key=where) from error


def table_of(marks: Marks) -> dict[str, Any]:
    """The table of a file that holds these marks; what is as usual is left out."""
    table: dict[str, Any] = {}
    photo = {k: getattr(marks, k) for k in _WHOLE if getattr(marks, k) is not None}
    if photo:
        table["photo"] = photo
    if marks.labels is not None:
        table["labels"] = marks.labels
    for key in ONE:
        made = _plain(getattr(marks, key))
        if made:
            table[key] = made
    for key in MANY:
        entries = [_plain(m) for m in getattr(marks, PLURAL[key])]
        if entries:
            table[key] = entries
    return table


def _plain(record: object) -> dict[str, Any]:
    if record is None:
        return {}
    assert is_dataclass(record)
    out = {}
    for item in fields(record):
        value = getattr(record, item.name)
        if value is not None and value != item.default:
            out[item.name] = _listed(value)
    return out


def _listed(value: Any) -> Any:
    if isinstance(value, tuple | list):
        return [_listed(v) for v in value]
    if isinstance(value, Mapping):
        return {k: _listed(v) for k, v in value.items()}
    return value


def write_marks(path: str | Path, marks: Marks) -> None:
    """Write marks to ``.toml`` or ``.json``; the file appears whole or not at all.

    Raises:
        SceneFileError: another suffix, or the file cannot be written.
    """
    path = Path(path)
    if path.suffix.lower() not in SUFFIXES:
        raise SceneFileError(path, f"marks are written to {', '.join(SUFFIXES)}")
    write_atomically(path, writer(text_of(marks, path.suffix)))


def text_of(marks: Marks, suffix: str) -> str:
    """The text of a file of marks: JSON, or TOML for any other suffix."""
    table = table_of(marks)
    return json.dumps(table, indent=1) + "\n" if suffix.lower() == ".json" else _toml(table)


def writer(text: str) -> Callable[[Path], None]:
    """Writes a text to a path."""

    def write(path: Path) -> None:
        path.write_text(text)

    return write


def _toml(table: dict[str, Any]) -> str:
    lines = [f"{k} = {json.dumps(v)}" for k, v in table.items() if not isinstance(v, dict | list)]
    for key, value in table.items():
        for entry in value if isinstance(value, list) else [value] if isinstance(value, dict) else []:
            lines += ["", f"[[{key}]]" if isinstance(value, list) else f"[{key}]"]
            lines += [f"{k} = {json.dumps(v)}" for k, v in entry.items() if not isinstance(v, dict)]
            for name, inner in ((k, v) for k, v in entry.items() if isinstance(v, dict)):
                lines += ["", f"[{key}.{name}]", *(f"{k} = {json.dumps(v)}" for k, v in inner.items())]
    return "\n".join(lines).lstrip("\n") + "\n"
