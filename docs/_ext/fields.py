"""Fields of dataclasses with the comments beside them: what an option means and which unit it has stands there."""

from __future__ import annotations

import dataclasses
import inspect
import re
from typing import Any

from sphinx.application import Sphinx

_FIELD = re.compile(r"^    (\w+): (.+?)(?:\s+#\s?(.*))?$")
_MORE = re.compile(r"^    # ?(.*)$")
_FACTORY = re.compile(r"field\((?:.*default_factory=)(.+)\)$")


def fields_of(cls: type) -> list[tuple[str, str, str, str]]:
    """Name, type, default and comment of each public field that the class itself declares."""
    found: list[tuple[str, str, str, str]] = []
    own = {one.name for one in dataclasses.fields(cls) if not one.name.startswith("_")}
    inside = False
    for line in inspect.getsource(cls).splitlines():
        more = _MORE.match(line)
        if more and inside and found:
            found[-1] = (*found[-1][:3], f"{found[-1][3]} {more[1]}".strip())
            continue
        match = _FIELD.match(line)
        inside = match is not None and match[1] in own
        if match is not None and inside:
            kind, _, default = match[2].partition(" = ")
            default = _FACTORY.sub(lambda m: m[1].removeprefix("lambda: "), default)
            found.append((match[1], kind, default, match[3] or ""))
    return found


def add_fields(app: Sphinx, what: str, name: str, obj: Any, options: Any, lines: list[str]) -> None:
    """Append the fields to the docstring of a dataclass."""
    del app, name, options
    if what != "class" or not dataclasses.is_dataclass(obj):
        return
    rows = fields_of(obj)
    if not rows:
        return
    lines += ["", ".. list-table::", "   :header-rows: 1", "   :widths: 18 20 18 44", ""]
    lines += ["   * - field", "     - type", "     - default", "     - meaning"]
    for field, kind, default, comment in rows:
        shown = f"``{default}``" if default else "required"
        lines += [f"   * - ``{field}``", f"     - ``{kind}``", f"     - {shown}", f"     - {_text(comment)}"]
    lines.append("")


def hide_signature(app: Sphinx, what: str, name: str, obj: Any, *rest: Any) -> tuple[str, None] | None:
    """Dataclasses of many fields have them as a table: a signature would say it again."""
    del app, name, rest
    return ("", None) if what == "class" and dataclasses.is_dataclass(obj) and len(fields_of(obj)) > 3 else None


def _text(comment: str) -> str:
    """A comment as reStructuredText: its signs mean nothing there."""
    return re.sub(r"([*`_|\\])", r"\\\1", comment)


def setup(app: Sphinx) -> dict[str, Any]:
    """Called by Sphinx."""
    app.connect("autodoc-process-signature", hide_signature)
    app.connect("autodoc-process-docstring", add_fields, priority=900)
    return {"version": "1", "parallel_read_safe": True, "parallel_write_safe": True}
