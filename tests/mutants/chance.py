"""Faults by chance, so that tests are not only those that a list was written for."""

from __future__ import annotations

import ast
import random
from collections.abc import Iterator
from pathlib import Path

from mutants.fault import Fault

SWAPPED: dict[type[ast.AST], str] = {
    ast.Lt: ">", ast.LtE: ">", ast.Gt: "<", ast.GtE: "<", ast.Eq: "!=", ast.NotEq: "==", ast.Is: "is not",
    ast.IsNot: "is", ast.Add: "-", ast.Sub: "+", ast.Mult: "/", ast.Div: "*", ast.FloorDiv: "*", ast.And: "or",
    ast.Or: "and", ast.LShift: ">>", ast.RShift: "<<", ast.BitAnd: "|", ast.BitOr: "&",
}  # fmt: skip
NAMES = {"min": "max", "max": "min", "floor": "ceil", "ceil": "floor", "sin": "cos", "cos": "sin", "any": "all",
         "all": "any", "minimum": "maximum", "maximum": "minimum", "argmin": "argmax", "argmax": "argmin"}  # fmt: skip


def drawn(root: Path, area: str, file: str, tests: str, count: int, seed: int) -> list[Fault]:
    """``count`` different faults of a Python file."""
    text = (root / file).read_text()
    found = list(_changes(text))
    random.Random(f"{seed} {file}").shuffle(found)
    out: list[Fault] = []
    for start, end, new in found:
        if len(out) == count:
            break
        old, new = _unique(text, start, end, new)
        if old:
            out.append(Fault(area=area, file=file, old=old, new=new, tests=tests))
    return out


def _unique(text: str, start: int, end: int, new: str) -> tuple[str, str]:
    """The change with the whole lines around it, as many as make it unique."""
    first, last = text.rfind("\n", 0, start) + 1, text.find("\n", end)
    for _ in range(6):
        old = text[first:last]
        if text.count(old) == 1:
            return old, text[first:start] + new + text[end:last]
        first, last = text.rfind("\n", 0, max(first - 1, 0)) + 1, text.find("\n", last + 1)
        if last < 0:
            break
    return "", ""


def _changes(text: str) -> Iterator[tuple[int, int, str]]:
    """Where, and what instead, of everything inside functions."""
    tree = ast.parse(text)
    lines = [0]
    for line in text.splitlines(keepends=True):
        lines.append(lines[-1] + len(line))

    def place(row: int, column: int) -> int:
        begin = lines[row - 1]
        return begin + len(text[begin:].encode()[:column].decode())

    def span(node: ast.expr) -> tuple[int, int]:
        return place(node.lineno, node.col_offset), place(node.end_lineno or 0, node.end_col_offset or 0)

    def between(a: ast.expr, b: ast.expr, new: str) -> Iterator[tuple[int, int, str]]:
        low, high = span(a)[1], span(b)[0]
        gap = text[low:high]
        sign = gap.strip(" ()\n")
        if sign and "#" not in gap:
            at = low + gap.index(sign)
            yield at, at + len(sign), new

    for function in ast.walk(tree):
        if not isinstance(function, ast.FunctionDef | ast.AsyncFunctionDef):
            continue
        for node in (inner for statement in function.body for inner in ast.walk(statement)):
            if isinstance(node, ast.Compare) and len(node.ops) == 1 and type(node.ops[0]) in SWAPPED:
                yield from between(node.left, node.comparators[0], SWAPPED[type(node.ops[0])])
            elif isinstance(node, ast.BinOp) and type(node.op) in SWAPPED:
                yield from between(node.left, node.right, SWAPPED[type(node.op)])
            elif isinstance(node, ast.BoolOp):
                yield from between(node.values[0], node.values[1], SWAPPED[type(node.op)])
            elif isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not | ast.USub):
                start, end = span(node)
                yield start, end, text[span(node.operand)[0] : span(node.operand)[1]]
            elif isinstance(node, ast.Name | ast.Attribute):
                name = node.id if isinstance(node, ast.Name) else node.attr
                if name in NAMES:
                    end = span(node)[1]
                    yield end - len(name), end, NAMES[name]
            elif isinstance(node, ast.Constant) and type(node.value) in (int, float):
                start, end = span(node)
                yield start, end, repr(node.value + 1) if type(node.value) is int else repr(node.value * 1.5 + 0.25)
