"""Knobs: the ordered settings of a pass, from fast to exact, as changes to the options of a picture."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from torchrender.errors import InputError
from torchrender.pipeline.options import RenderOptions


@dataclass(frozen=True)
class Setting:
    """One setting: its name, and the options it stands for; a dot leads into a group (``"shadow.size"``)."""

    name: str
    changes: Mapping[str, Any]

    def applied(self, options: RenderOptions) -> RenderOptions:
        """The options with this setting."""
        for path, value in self.changes.items():
            group, _, name = path.rpartition(".")
            if group:
                value = replace(getattr(options, group), **{name: value})
            options = replace(options, **{group or name: value})
        return options

    def matches(self, options: RenderOptions) -> bool:
        """The options are what this setting stands for."""
        for path, wanted in self.changes.items():
            value: Any = options
            for name in path.split("."):
                value = getattr(value, name)
            if value != wanted:
                return False
        return True


@dataclass(frozen=True)
class Knob:
    """Settings of a pass, from fast to exact.

    ``reference`` is what errors are measured against; it may be a setting that is too slow to be chosen. ``context``
    are options under which the settings differ at all.
    """

    name: str
    settings: tuple[Setting, ...]
    reference: Setting
    context: Setting = Setting("context", {})

    def setting(self, name: str) -> Setting:
        """The setting of that name.

        Raises:
            InputError: there is none; the message lists those there are.
        """
        for setting in (*self.settings, self.reference):
            if setting.name == name:
                return setting
        raise InputError(f"{self.name} has no setting {name!r}; known settings: {', '.join(self.names)}")

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the settings, from fast to exact."""
        return tuple(s.name for s in self.settings)

    def current(self, options: RenderOptions) -> str:
        """Name of the setting that the options are at, or ``custom``."""
        for setting in (*self.settings, self.reference):
            if setting.matches(options):
                return setting.name
        return "custom"
