"""Strict reading of TOML tables: every key is asked for once, whatever is left over is an error."""

from __future__ import annotations

import difflib
import math
import re
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import torch

from torchrender.errors import InputError, SceneFileError
from torchrender.numerics.color import linear_from_srgb

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

_MISSING = object()


def parse_toml(path: Path, data: bytes) -> Table:
    """The top-level table of a TOML file.

    Raises:
        SceneFileError: not UTF-8, or not TOML; the reason names line and column.
    """
    return Table(path, "", parse_toml_values(path, data))


def parse_toml_values(path: Path, data: bytes) -> dict[str, Any]:
    """The plain values of a TOML file; errors as :func:`parse_toml`."""
    try:
        return tomllib.loads(data.decode("utf-8-sig"))
    except RecursionError as error:
        raise SceneFileError(path, "not a TOML file (nested too deeply)") from error
    except (UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        raise SceneFileError(path, f"not a TOML file ({error})") from error


class Table:
    """One table of a TOML file. Reading a key takes it; :meth:`finish` complains about keys nobody took.

    All methods raise :class:`SceneFileError` with the file, the dotted key and the reason.
    """

    def __init__(self, path: Path, key: str, values: dict[str, Any]) -> None:
        self.path = path
        self.key = key
        self._values = values
        self._asked: list[str] = []

    def dotted(self, name: str) -> str:
        """Full name of a key, such as ``light[2].intensity``."""
        return f"{self.key}.{name}" if self.key else name

    def error(self, name: str, reason: str) -> SceneFileError:
        """The error for a key of this table; the empty name stands for the table itself."""
        return SceneFileError(self.path, reason, key=(self.dotted(name) if name else self.key) or None)

    def __contains__(self, name: str) -> bool:
        return name in self._values

    def _take(self, name: str, default: Any) -> Any:
        self._asked.append(name)
        if name in self._values:
            return self._values[name]
        if default is _MISSING:
            raise self.error(name, "is missing")
        return default

    def finish(self) -> None:
        """Raise for the first key that was not asked for, with the closest known one as a hint."""
        for name in self._values:
            if name not in self._asked:
                near = difflib.get_close_matches(name, self._asked, n=1)
                hint = f"did you mean {near[0]!r}?" if near else f"known: {', '.join(sorted(set(self._asked)))}"
                raise self.error(name, f"unknown key; {hint}")

    @contextmanager
    def reporting(self, name: str = "") -> Iterator[None]:
        """Turn an :class:`InputError` raised inside into one that names this table or one of its keys."""
        try:
            yield
        except InputError as error:
            raise self.error(name, str(error)) from error

    # ------------------------------------------------------------------ values

    def number(self, name: str, default: Any = _MISSING, low: float = -math.inf, high: float = math.inf) -> Any:
        """A finite number in [low, high]; the default is given back as it is."""
        value = self._take(name, default)
        if name not in self._values:
            return value
        if not _is_number(value):
            raise self.error(name, f"must be a number, got {value!r}")
        if not low <= value <= high:
            limit = (
                f">= {low:g}" if high == math.inf else f"<= {high:g}" if low == -math.inf else f"in [{low:g}, {high:g}]"
            )
            raise self.error(name, f"must be {limit}, got {value}")
        return float(value)

    def integer(self, name: str, default: Any = _MISSING, low: int = 0, high: int = 2**53) -> Any:
        """A whole number in [low, high]."""
        value = self._take(name, default)
        if name not in self._values:
            return value
        if isinstance(value, bool) or not isinstance(value, int) or not low <= value <= high:
            raise self.error(name, f"must be a whole number in [{low}, {high}], got {value!r}")
        return value

    def text(self, name: str, default: Any = _MISSING) -> Any:
        """A string that is not empty."""
        value = self._take(name, default)
        if name in self._values and (not isinstance(value, str) or not value):
            raise self.error(name, f"must be text, got {value!r}")
        return value

    def flag(self, name: str, default: Any = _MISSING) -> Any:
        """``true`` or ``false``."""
        value = self._take(name, default)
        if value is not default and not isinstance(value, bool):
            raise self.error(name, f"must be true or false, got {value!r}")
        return value

    def choice(self, name: str, choices: Sequence[str], default: Any = _MISSING) -> Any:
        """One of the given words."""
        value = self._take(name, default)
        if name in self._values and value not in choices:
            near = difflib.get_close_matches(str(value), choices, n=1)
            hint = f"; did you mean {near[0]!r}?" if near else ""
            raise self.error(name, f"must be one of {', '.join(choices)}, got {value!r}{hint}")
        return value

    def words(self, name: str, choices: Sequence[str], default: Any) -> Any:
        """A list of some of the given words."""
        value = self._take(name, default)
        if name in self._values and (not isinstance(value, list) or any(v not in choices for v in value)):
            raise self.error(name, f"must be a list out of {', '.join(choices)}, got {value!r}")
        return value

    def vector(self, name: str, size: int = 3, default: Any = _MISSING, *, repeat: bool = False) -> Any:
        """Finite numbers (size,) float64; with ``repeat`` a single number stands for all."""
        value = self._take(name, default)
        if name not in self._values:
            return value
        if repeat and _is_number(value):
            value = [value] * size
        if not isinstance(value, list) or len(value) != size or not all(_is_number(v) for v in value):
            raise self.error(name, f"must be {size} numbers{' or one' if repeat else ''}, got {value!r}")
        return torch.tensor(value, dtype=torch.float64)

    def color(self, name: str, default: Any = _MISSING, high: float = math.inf) -> Any:
        """Linear RGB (3,) float32 from one number, three linear numbers, or sRGB ``"#rrggbb"``; in [0, high]."""
        value = self._values.get(name)
        if isinstance(value, str):
            self._asked.append(name)
            if not re.fullmatch(r"#[0-9a-fA-F]{6}", value):
                raise self.error(name, f'must be three numbers or "#rrggbb", got {value!r}')
            return linear_from_srgb(torch.tensor([int(value[k : k + 2], 16) / 255 for k in (1, 3, 5)]))
        rgb = self.vector(name, 3, default, repeat=True)
        if name in self._values:
            if bool((rgb < 0).any()) or bool((rgb > high).any()):
                limit = ">= 0" if high == math.inf else f"in [0, {high:g}]"
                raise self.error(name, f"must be {limit}, got {value!r}")
            return rgb.float()
        return rgb

    def file(self, name: str, default: Any = _MISSING) -> Any:
        """Path of an existing file, relative to the folder of the TOML file."""
        value = self.text(name, default)
        if name not in self._values:
            return value
        found = self.path.parent / value
        try:
            exists = found.is_file()
        except (OSError, ValueError):
            exists = False
        if not exists:
            raise self.error(name, f"no such file: {value!r} (looked for {found})")
        return found

    def table(self, name: str) -> Table | None:
        """A table; None if there is none."""
        value = self._take(name, None)
        if value is None:
            return None
        if not isinstance(value, dict):
            raise self.error(name, f"must be a table [{name}], got {value!r}")
        return Table(self.path, self.dotted(name), value)

    def tables(self, name: str) -> list[Table]:
        """An array of tables; empty if there is none."""
        value = self._take(name, [])
        if not isinstance(value, list) or not all(isinstance(v, dict) for v in value):
            raise self.error(name, f"must be tables [[{name}]], got {value!r}")
        return [Table(self.path, f"{self.dotted(name)}[{k}]", v) for k, v in enumerate(value)]


def _is_number(value: object) -> bool:
    # Written as a comparison because whole numbers in TOML may be too large for a float.
    return isinstance(value, int | float) and not isinstance(value, bool) and -1e300 <= value <= 1e300
