"""What values say of themselves where somebody looks at them: a line, not their numbers."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import fields
from html import escape
from typing import Any

import numpy as np
from torch import Tensor

WIDEST = 60
"""Characters that one field gets."""
FEW = 8
"""Numbers that are written out."""


def brief(self: Any) -> str:
    """``repr`` of a dataclass in a line: shapes and types of tensors, how many of what is many, defaults left out.

    A class takes it as ``__repr__ = brief``.
    """
    told = ", ".join(f"{name}={text}" for name, text in _fields(self))
    return f"{type(self).__name__}({told})"


def brief_html(self: Any) -> str:
    """The same as a table, for notebooks: a class takes it as ``_repr_html_ = brief_html``."""
    return html_table((type(self).__name__, ""), list(_fields(self)))


def html_table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A table whose cells hold these texts, as they are."""

    def line(cells: Sequence[str], kind: str) -> str:
        made = "".join(f'<{kind} style="text-align:left">{escape(cell)}</{kind}>' for cell in cells)
        return f"<tr>{made}</tr>"

    body = "".join(line(row, "td") for row in rows)
    return f"<table><thead>{line(head, 'th')}</thead><tbody>{body}</tbody></table>"


def _fields(self: Any) -> Iterator[tuple[str, str]]:
    for one in fields(self):
        if not one.repr or one.name.startswith("_"):
            continue
        value = vars(self).get(one.name)  # what is made on first use is not made for this
        if value is not None and not _is_empty(value):
            yield one.name, _told(value)


def _is_empty(value: object) -> bool:
    return isinstance(value, tuple | list | Mapping | str) and not value


def _told(value: object) -> str:
    if isinstance(value, Tensor | np.ndarray):
        return _array(value)
    if isinstance(value, tuple | list) and value and not all(isinstance(v, int | float) for v in value):
        names = [str(name) for name in (getattr(v, "name", None) for v in value) if isinstance(name, str)]
        listed = f": {', '.join(names)}" if len(names) == len(value) else ""
        return _cut(f"{len(value)} {type(value[0]).__name__}{listed}")
    if isinstance(value, Mapping):
        return _cut(f"{len(value)}: {', '.join(str(key) for key in value)}")
    text = repr(value)
    return text if len(text) <= WIDEST else f"{type(value).__name__}(...)"


def _array(value: Any) -> str:
    kind = str(value.dtype).removeprefix("torch.")
    count = int(np.prod(value.shape))
    if 0 < count <= FEW and value.ndim <= 1:
        values = value.detach().tolist() if isinstance(value, Tensor) else value.tolist()
        shown = values if isinstance(values, list) else [values]
        return "[" + ", ".join(f"{v:.6g}" if isinstance(v, float) else str(v) for v in shown) + "]"
    return f"{kind} {tuple(value.shape)}"


def _cut(text: str) -> str:
    return text if len(text) <= WIDEST else text[: WIDEST - 1] + "…"
