"""Runs everything and writes ``service.md`` and ``service.json``."""

from __future__ import annotations

import asyncio
import json
import sys
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any

from torchrender.images.files import write_atomically
from torchrender.quality.machine import machine_line, machine_record
from torchrender_service.load_test import beside, faults, figures, network, pictures
from torchrender_service.load_test.driver import ServerUnderTest, running_server
from torchrender_service.load_test.rows import Effort, Row, table_of

Measurement = Callable[[ServerUnderTest, Effort], Awaitable[list[Row]]]
ON_SERVER: tuple[tuple[str, Measurement], ...] = (
    ("Pictures", figures.throughput_rows),  # first: sessions that may come back would keep a renderer for themselves
    ("Latency", network.interactive_rows),
    ("Latency", network.delay_rows),
    ("Load", network.health_rows),
    ("Pictures", figures.budget_rows),
    ("Faults", network.stalled_rows),
    ("Faults", faults.message_rows),
    ("Faults", faults.connection_rows),
    ("Load", faults.soak_rows),
    ("Faults", faults.shutdown_rows),
)
ELSEWHERE = (
    Row(
        what="the page's own frame rate, and its warp against the Python reprojection",
        goal="unchanged by the link; ≥ 40 dB off holes",
        measured="by the browser tests",
        met=None,
    ),
    Row(
        what="contract fuzzing of the OpenAPI description (schemathesis)",
        goal="zero 5xx",
        measured="by tests/service/test_openapi.py",
        met=None,
    ),
)


def run_load_test(folder: Path, effort: Effort) -> bool:
    """Measure everything; whether all goals were met."""
    sections: dict[str, list[Row]] = {"Keyframes": pictures.codec_rows(effort), "Views and holes": []}
    _tell(sections["Keyframes"])
    sections["Views and holes"] = pictures.view_rows(effort)
    _tell(sections["Views and holes"])
    asyncio.run(_measure(sections, effort))
    sections["Measured elsewhere"] = list(ELSEWHERE)
    record = machine_record()
    found = {name: [row.to_dict() for row in rows] for name, rows in sections.items()}
    _write(folder / "service.json", json.dumps({"machine": record, "quick": effort.quick, "rows": found}, indent=1))
    _write(folder / "service.md", page(sections, record, effort))
    return all(row.met is not False for rows in sections.values() for row in rows)


async def _measure(sections: dict[str, list[Row]], effort: Effort) -> None:
    # All clients of these rows have one address.
    unlimited = ("max_sessions", "max_sessions_per_address", "requests_per_s", "connections_per_s")
    room = dict.fromkeys(unlimited, "100000")
    settings = {**room, "max_requests_per_address": "512", "log_level": "warning"}
    with running_server(**settings) as server:
        await asyncio.to_thread(server.get, "/v1/scenes")
        sample = await faults.sample_keyframe(server, effort)
        sections["Load"] = await network.transport_rows(sample, effort)
        _tell(sections["Load"])
        for name, measure in ON_SERVER:
            rows = await measure(server, effort)
            sections.setdefault(name, []).extend(rows)
            _tell(rows)
    sections["Pictures"] += await figures.start_rows(effort)
    _tell(sections["Pictures"][-2:])
    sections["Attacks"] = await beside.attack_rows(effort)
    _tell(sections["Attacks"])


def page(sections: dict[str, list[Row]], record: dict[str, Any], effort: Effort) -> str:
    """The page as Markdown."""
    command = "torchrender load-test" + (" --quick" if effort.quick else "")
    lines = [
        "# The service, measured",
        "",
        f"`{command}` on {machine_line(record)}",
        "",
        "Server, renderers and simulated clients share this machine. Delay, jitter and loss are simulated by a relay "
        "on loopback; a lost segment costs one round trip and 200 ms, as TCP makes it. Latency is from sending a pose"
        " to having its picture (layer 0). Each attack comes from an address and a process of its own, without a key,"
        " beside ten sessions that look around in cornell_box at 96 × 54, four keyframes a second each, so that they "
        "leave half of the machine free; p95 is of those sessions, without the attack and during it, in turns, with "
        "the interval of its change that holds in nine of ten (bootstrap over half seconds; up to three turns until "
        "it lies on one side of the limit), each begun once no other renderer starts. Half seconds in which other "
        "programs took more than a seventh of a core "
        "are left out while enough others are left; how many is told. A pose that a later one overtook counts until "
        "that one's keyframe. An attacker computes elsewhere: its process runs only while no other wants the core "
        "(SCHED_IDLE). What the system does for both ends of a connection on loopback, caches and memory they share "
        "all the same: the cores that server, renderers and attacker took are in the row, before → during. Memory may"
        " grow by what one renderer may take, a share of that of the host or container. What an attack once did was "
        "seen by hand when it was found, not beside such sessions.",
        "",
    ]
    for name, rows in sections.items():
        lines += [f"## {name}", "", *table_of(rows), ""]
    return "\n".join(lines)


def _tell(rows: list[Row]) -> None:
    for row in rows:
        sys.stderr.write(f"{row.mark or '-':10s} {row.what}: {row.measured} (goal: {row.goal})\n")
    sys.stderr.flush()


def _write(path: Path, text: str) -> None:
    def write(temporary: Path) -> None:
        temporary.write_text(text + "\n")

    write_atomically(path, write)
