"""Batches and streams over several processes and replicas, measured.

``python -m torchrender.report.distributed [PART ...] [--quick] [-o docs/results]`` writes ``distributed.md`` and
``distributed.json``. Each part takes a few minutes at most; parts that are not asked for stay as they were.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from torchrender.errors import OptionError
from torchrender.quality.machine import machine_line, machine_record
from torchrender.quality.pages import write_record, write_text
from torchrender.report.common.command import study_parser, write_named
from torchrender.report.common.progress import part
from torchrender.report.distributed import batches, streams
from torchrender.report.distributed.cluster import haproxy_file
from torchrender.report.distributed.many import many_record, many_rows, price_rows
from torchrender.report.distributed.reckoning import check_rows
from torchrender.report.distributed.stream_rows import lost_rows, stream_rows
from torchrender_service.load_test.rows import Row, table_of

Measure = Callable[[bool, dict[str, Any]], dict[str, Any]]
"""What a part finds: quickly or not, and what the parts so far have found."""
PARTS: dict[str, Measure] = {
    "batch": lambda quick, _: batches.local_record(batches.QUICK if quick else batches.BatchEffort()),
    "ray-batch": lambda quick, _: batches.ray_record(batches.QUICK if quick else batches.BatchEffort()),
    "killed": lambda quick, _: batches.killed_record(
        batches.QUICK if quick else batches.BatchEffort(size=128, cameras=32)
    ),
    "server": lambda quick, _: streams.server_record(streams.QUICK if quick else streams.StreamEffort()),
    "replicas": lambda quick, _: streams.replica_record(streams.QUICK if quick else streams.StreamEffort()),
    "haproxy": lambda quick, _: streams.replica_record(
        streams.QUICK if quick else streams.StreamEffort(), haproxy=True
    ),
    "lost": lambda quick, _: streams.lost_record(streams.QUICK if quick else streams.StreamEffort()),
    "many": lambda quick, parts: many_record(_found(parts, "replicas"), quick),
}
TABLES: tuple[tuple[str, tuple[str, ...], Callable[[dict[str, Any]], list[Row]]], ...] = (
    ("Batches on one machine", ("batch",), batches.local_rows),
    ("Batches by Ray Data", ("ray-batch",), batches.ray_rows),
    ("Batches that are killed", ("killed",), batches.killed_rows),
    ("Streams over two replicas behind Ray's proxy", ("server", "replicas"), stream_rows),
    ("Streams over two replicas behind HAProxy", ("server", "haproxy"), partial(stream_rows, of="haproxy")),
    ("Replicas that go", ("lost",), lost_rows),
    ("The simulation, Ray's proxy", ("replicas",), check_rows),
    ("The simulation, HAProxy", ("haproxy",), partial(check_rows, of="haproxy")),
    ("Many sessions, reckoned", ("many",), many_rows),
    ("What it costs", ("many", "batch"), price_rows),
)


def run(folder: Path, quick: bool, names: Sequence[str] = ()) -> list[Path]:
    """Measure parts, without names all that this machine can, and write the page with all that are there.

    Raises:
        OptionError: an unknown part. MissingExtraError: a part needs Ray, which is not installed.
    """
    unknown = [name for name in names if name not in PARTS]
    if unknown:
        raise OptionError(f"part must be one of {', '.join(PARTS)}, got {unknown[0]}")
    data = folder / "distributed.json"
    try:
        record = json.loads(data.read_text())
    except FileNotFoundError:
        record = {"parts": {}}
    for name in names or _measurable():
        with part(name):
            measured = PARTS[name](quick, record["parts"])
        record["parts"][name] = {"machine": machine_record(), "quick": quick, "found": measured}
        write_record(data, record)
    page_file = folder / "distributed.md"
    write_text(page_file, page(record["parts"]))
    return [data, page_file]


def _measurable() -> tuple[str, ...]:
    if haproxy_file() is None:
        sys.stderr.write("haproxy: left out, the program is not installed\n")
        return tuple(name for name in PARTS if name != "haproxy")
    return tuple(PARTS)


def _found(parts: dict[str, Any], name: str) -> dict[str, Any]:
    if name not in parts:
        raise OptionError(f"part {name} must be measured first")
    return dict(parts[name]["found"])


def page(parts: dict[str, Any]) -> str:
    """``distributed.md``."""
    lines = [
        "# Many processes, many replicas",
        "",
        "`python -m torchrender.report.distributed`. Two cores carry all of it: renderers, servers, Ray and the "
        "clients that measure. What it means for more machines is reckoned in [scale](../scale.md).",
        "",
    ]
    found = {name: measured["found"] for name, measured in parts.items()}
    for heading, names, rows_of in TABLES:
        if not all(name in parts for name in names):
            continue
        machines = dict.fromkeys(_measured_on(parts[name]) for name in names)
        lines += [f"## {heading}", "", "; ".join(machines), "", *table_of(rows_of(found)), ""]
    return "\n".join(lines)


def _measured_on(measured: dict[str, Any]) -> str:
    return machine_line(measured["machine"]) + (", quick" if measured["quick"] else "")


def main(argv: Sequence[str] | None = None) -> None:
    """The command."""
    parser = study_parser(__doc__, quick="little of everything, in a minute or two")
    parser.add_argument("parts", nargs="*", metavar="PART", help=f"of {', '.join(PARTS)}; default: all")
    arguments = parser.parse_args(argv)
    write_named(arguments.output, lambda folder: run(folder, arguments.quick, arguments.parts))
