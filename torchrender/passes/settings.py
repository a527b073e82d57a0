"""Settings of a pass, from fast to exact, as changes to the options of a picture."""

from __future__ import annotations

import copy
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

from torchrender.errors import InputError
from torchrender.pipeline.options import RenderOptions

CUSTOM = "custom"
"""Name of a setting where the options are at none of them."""


@dataclass(frozen=True)
class Setting:
    """One setting: its name, and the options it stands for.

    A dot leads into a group (``"shadow.size"``); ``"effects.fog"`` is the entry ``fog`` of the options of further
    passes, a whole record.
    """

    name: str
    changes: Mapping[str, Any]

    def applied(self, options: RenderOptions) -> RenderOptions:
        """The options with this setting. They are not checked again: a table's settings are valid."""
        made = copy.copy(options)
        for path, value in self.changes.items():
            group, _, name = path.rpartition(".")
            held = getattr(made, group) if group else None
            if isinstance(held, Mapping):
                value = {**held, name: value}
            elif group:
                value = replace(held, **{name: value})  # type: ignore[type-var]
            object.__setattr__(made, group or name, value)
        return made

    def matches(self, options: RenderOptions) -> bool:
        """The options are what this setting stands for."""
        for path, wanted in self.changes.items():
            value: Any = options
            for name in path.split("."):
                value = value.get(name) if isinstance(value, Mapping) else getattr(value, name)
            if value != wanted:
                return False
        return True


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
