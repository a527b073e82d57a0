"""Ten sessions, a thousand, a hundred thousand: which part of the service is full first, and where scenes should be."""

from __future__ import annotations

import time
from dataclasses import asdict
from typing import Any

from torchrender.report.distributed.reckoning import CORE_HOUR, Costs, costs_of, prices
from torchrender.report.distributed.simulation import Cluster, Load, simulate
from torchrender.scene.camera import Cameras
from torchrender.wire.cameras import header_of
from torchrender_service.load_test.rows import Row
from torchrender_service.renderers.jobs import Bounds
from torchrender_service.streams.ledger import Beat, SessionLedger, SessionRecord

SESSIONS = (10, 1_000, 100_000)
VIEWS_PER_S = 1.0
"""Of a client that looks about: what each session is reckoned with."""
CORES = 16
"""Of a machine; a proxy of Serve on each is one process."""
ROOM = 0.7
"""Share of a machine's cores that is planned for, so that waiting stays short."""
REPLICA_SESSIONS = 100
CALL_S = 1e-3
"""Of one call to an actor of Ray, beside its work."""


def many_record(replicas: dict[str, Any], quick: bool) -> dict[str, Any]:
    """What the ledger takes, and what is simulated with the costs of a measured run."""
    costs = costs_of(replicas)
    sizes = (10, 100) if quick else SESSIONS
    return {
        "costs": asdict(costs),
        "keyframe_bytes": replicas["leisure"]["keyframe_bytes"],
        "ledger": {str(count): ledger_s(count) for count in sizes},
        "placing": placing_record(costs, quick),
        "machine": machine_record(costs, quick),
    }


def ledger_s(sessions: int) -> dict[str, float]:
    """Seconds of a beat of a replica, and of a stream from its session to its end, with so many sessions."""
    ledger = SessionLedger(max_sessions=sessions + 1, max_per_address=sessions + 1, ticket_s=60.0, resume_s=60.0)
    camera = header_of(Cameras.look_at([0.0, 0.0, 3.0], [0.0, 0.0, 0.0], width=64, height=48, fov_deg=50.0))

    def add(name: str, replica: str) -> None:
        given: dict[str, Any] = {"camera": camera, "extra_layers": 0, "overscan": 1.0, "bounds": Bounds()}
        ticket = ledger.add(SessionRecord(id=name, scene="city", client=name[:3], **given))
        ledger.redeem(ticket, replica)

    for number in range(sessions):
        add(f"{number:06d}", str(number // REPLICA_SESSIONS))
    names = tuple(f"{number:06d}" for number in range(min(sessions, REPLICA_SESSIONS)))
    rounds = 200
    begin = time.perf_counter()
    for _ in range(rounds):
        ledger.beat(Beat(replica="0", connected=names))
    between = time.perf_counter()
    for _ in range(rounds):
        add("one more", "0")
        ledger.renew("one more", "0")
        ledger.end("one more")
    return {"beat_s": (between - begin) / rounds, "stream_s": (time.perf_counter() - between) / rounds}


def machine_record(costs: Costs, quick: bool) -> dict[str, Any]:
    """One machine with as many sessions as are planned for, and with half as many again."""
    cluster = Cluster(cores=CORES, renderers=CORES, **asdict(costs))
    planned = max(1, int(ROOM * CORES / (VIEWS_PER_S * costs.view_s)))
    found = {}
    for name, sessions in (("planned", planned), ("half as many again", planned * 3 // 2)):
        load = Load(sessions=sessions, period_s=1.0 / VIEWS_PER_S, seconds=3.0 if quick else 15.0, settle_s=3.0)
        found[name] = {"sessions": sessions, **asdict(simulate(cluster, load))}
    return found


def placing_record(costs: Costs, quick: bool) -> dict[str, Any]:
    """Renderers that keep eight scenes each, of a hundred: where sessions go."""
    cluster = Cluster(machines=2 if quick else 8, cores=4, renderers=4, load_s=2.0, scenes_kept=8, **asdict(costs))
    each = max(1, int(0.5 * 4 / (VIEWS_PER_S * costs.view_s)))
    found = {}
    for placing in ("random", "fewest", "ring"):
        load = Load(sessions=each * cluster.machines, scenes=100, placing=placing, seconds=3.0 if quick else 10.0)
        found[placing] = asdict(simulate(cluster, load))
    return {"sessions": each * cluster.machines, "machines": cluster.machines, **found}


def many_rows(parts: dict[str, Any]) -> list[Row]:
    """As the page has them."""
    record = parts["many"]
    return [*_sizes(record), *_machine(record), *_placing(record)]


def shares(record: dict[str, Any], sessions: int) -> dict[str, float]:
    """Of each part that so many sessions take, 1 is all of it; of machines and bytes how many."""
    costs = Costs(**record["costs"])
    views = sessions * VIEWS_PER_S
    cores = views * costs.view_s
    machines = max(1, -(-cores // (ROOM * CORES)))
    known = sorted(record["ledger"], key=int)
    ledger = record["ledger"][next((n for n in known if int(n) >= sessions), known[-1])]
    replicas = max(1, sessions // REPLICA_SESSIONS)
    return {
        "machines": machines,
        "renderers": views * costs.render_s / (machines * CORES),
        "a proxy": views / machines * (costs.tell_s + costs.carry_s),
        "the directory": replicas * (ledger["beat_s"] + CALL_S) + sessions / 600.0 * (ledger["stream_s"] + 5 * CALL_S),
        "network of a machine": views / machines * record["keyframe_bytes"] * 8 / 10e9,
        "gigabits_per_s": views * record["keyframe_bytes"] * 8 / 1e9,
    }


def _sizes(record: dict[str, Any]) -> list[Row]:
    rows = []
    for sessions in SESSIONS:
        found = shares(record, sessions)
        parts = {name: found[name] for name in ("renderers", "a proxy", "the directory", "network of a machine")}
        first = max(parts, key=lambda name: parts[name])
        size = f"{found['machines']:.0f} machines of {CORES} cores, {found['gigabits_per_s']:.3g} Gbit/s"
        told = ", ".join(f"{name} {100 * share:.3g} %" for name, share in parts.items())
        rows.append(
            Row(
                what=f"{sessions:,} sessions, a view a second each, ten minutes long",
                goal="",
                measured=f"{size}; {told}; first full: {first}",
                met=None,
            )
        )
    return rows


def _machine(record: dict[str, Any]) -> list[Row]:
    return [
        Row(
            what=f"simulated: a machine of {CORES} cores with {found['sessions']} sessions, {name}",
            goal="",
            measured=f"{found['keyframes_per_s'] / found['sessions']:.2f} keyframes/s each, "
            f"median {1e3 * found['latency_s']:.0f} ms, p95 {1e3 * found['latency_p95_s']:.0f} ms",
            met=None,
        )
        for name, found in record["machine"].items()
    ]


def _placing(record: dict[str, Any]) -> list[Row]:
    placing = record["placing"]
    names = {"random": "anywhere", "fewest": "where the fewest are", "ring": "on a ring by their scene"}
    rows = []
    for name, told in names.items():
        found = placing[name]
        rate, p95 = f"{found['keyframes_per_s']:.0f} keyframes/s", f"p95 {1e3 * found['latency_p95_s']:.0f} ms"
        what = f"simulated: {placing['sessions']} sessions of 100 scenes on {placing['machines']} machines, {told}"
        cold = f"{100 * found['cold']:.1f} % had to load the scene"
        rows.append(Row(what=what, goal="", measured=f"{rate}, {p95}, {cold}", met=None))
    return rows


def price_rows(parts: dict[str, Any]) -> list[Row]:
    """What it costs."""
    record, pictures_per_core_s = parts["many"], parts["batch"]["workers"]["2"]["rate"] / 2
    costs = Costs(**record["costs"])
    found = prices(costs, keyframes_per_s=VIEWS_PER_S, keyframe_bytes=record["keyframe_bytes"],
                   pictures_per_core_s=pictures_per_core_s)  # fmt: skip
    return [
        Row(
            what="a session that looks about for an hour",
            goal="",
            measured=f"{found['cores']:.3f} cores, {found['session_hour']:.4f} $",
            met=None,
        ),
        Row(
            what="1,000 pictures of the batch above",
            goal="",
            measured=f"{found['pictures_1000']:.4f} $ at {CORE_HOUR} $ for a core and hour",
            met=None,
        ),
    ]
