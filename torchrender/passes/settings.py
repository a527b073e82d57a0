"""Settings of a pass, from fast to exact, as changes to the options of a picture."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from torchrender.errors import InputError
from torchrender.pipeline.options import RenderOptions

CUSTOM = "custom"
"""Name of a setting where the options are at none of them."""


@dataclass(frozen=True)
class Setting:
    """One setting: its name, and the options it stands for.

    Dots lead into groups: ``"shadow.size"``, ``"effects.haze.steps"``. What leads to an entry of ``effects`` that is
    not there changes nothing: nobody asked for that pass.
    """

    name: str
    changes: Mapping[str, Any]

    def applied(self, options: RenderOptions) -> RenderOptions:
        """The options with this setting. They are not checked again: a table's settings are valid."""
        made = options
        for path, value in self._paths:
            made = _changed(made, path, value)
        return made

    @cached_property
    def _paths(self) -> tuple[tuple[tuple[str, ...], Any], ...]:
        return tuple((tuple(path.split(".")), value) for path, value in self.changes.items())

    def matches(self, options: RenderOptions) -> bool:
        """The options are what this setting stands for."""
        for path, wanted in self.changes.items():
            value: Any = options
            for name in path.split("."):
                value = value.get(name) if isinstance(value, Mapping) else getattr(value, name, None)
            if value != wanted:
                return False
        return True


def _changed(held: Any, path: tuple[str, ...], value: Any) -> Any:
    """``held`` with the entry at the end of a path replaced; records are copied without a check."""
    if not path:
        return value
    name, rest = path[0], path[1:]
    if isinstance(held, dict):
        return {**held, name: _changed(held[name], rest, value)} if name in held else held
    made = object.__new__(type(held))
    made.__dict__.update(held.__dict__)
    made.__dict__[name] = _changed(held.__dict__[name], rest, value)
    return made


@dataclass(frozen=True)
class Settings:
    """Settings of a pass, from fast to exact.

    ``reference`` is what errors are measured against; it may be a setting that is too slow to be chosen. ``context``
    are options under which the settings differ at all.
    """

    title: str  # what is set
    all: tuple[Setting, ...]
    reference: Setting
    context: Setting = Setting("context", {})
    shows: Callable[[RenderOptions], bool] = lambda _: True  # the settings differ with these options

    def named(self, name: str) -> Setting:
        """The setting of that name.

        Raises:
            InputError: there is none; the message lists those there are.
        """
        for setting in (*self.all, self.reference):
            if setting.name == name:
                return setting
        raise InputError(f"{self.title} has no setting {name!r}; known settings: {', '.join(self.names)}")

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of the settings, from fast to exact."""
        return tuple(s.name for s in self.all)

    @property
    def is_choice(self) -> bool:
        """There is more than one way."""
        return len(self.all) > 1

    def current(self, options: RenderOptions) -> str:
        """Name of the setting that the options are at, or ``custom``."""
        for setting in (*self.all, self.reference):
            if setting.matches(options):
                return setting.name
        return CUSTOM


def settings(
    title: str,
    choices: Mapping[str, Mapping[str, Any]],
    reference: tuple[str, Mapping[str, Any]] | None = None,
    context: Mapping[str, Any] | None = None,
    shows: Callable[[RenderOptions], bool] = lambda _: True,
) -> Settings:
    """Settings by name, from fast to exact; the last one is the reference unless another one is given."""
    made = tuple(Setting(name, changes) for name, changes in choices.items())
    exact = made[-1] if reference is None else Setting(*reference)
    return Settings(title, made, exact, Setting("context", context or {}), shows)


ONE_WAY = settings("-", {"-": {}})
"""Of a pass that knows one way only."""
