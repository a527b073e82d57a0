"""Each attack beside ten honest sessions: what these notice, and what the server takes."""

from __future__ import annotations

import asyncio
import contextlib
import math
import time
from collections.abc import AsyncIterator
from dataclasses import dataclass, field, replace

from torchrender_service.load_test.attacks import ATTACKS, PICTURE, Attack
from torchrender_service.load_test.driver import LoadClient, ServerUnderTest, client, running_server
from torchrender_service.load_test.playing import Player, player
from torchrender_service.load_test.raw import ask, attacker
from torchrender_service.load_test.rows import Effort, Row
from torchrender_service.load_test.watching import Change, Seen, change_of, left_out, watch
from torchrender_service.renderers.pool import ASIDE_S
from torchrender_service.settings import Settings

SESSIONS = 10
SMALL = {"width": 96, "height": 54, "layers": 0}
EVERY_S = 0.25
"""Each honest session asks for a keyframe so often: one takes about 8 ms of a core, so all together need less than half
of what one renderer can do on two cores, and their delay is that of pictures, not of a queue of their own making. The
more of them, the less does p95 depend on two or three."""
SETTLE_S = 0.5
"""What the attack before left to do, and the start of the next one's process, are no part of what was before it."""
RESTING, REST_S, LONGEST_REST_S = 0.1, 1.0, 20.0
"""Cores that the renderers without sessions take together when all have started, for how long that is looked at, and
how long it is waited for: one that starts takes from the others, and is not what is measured."""
AFTER_S = 0.5
"""Nor is what an attack left to do a part of what comes after it."""
OVER_S = 30.0
HEALTH_MS = 50.0
LOG_BYTES_PER_MINUTE = 2**20
FIRST = b'name = "first"\n[[geometry]]\nshape = "box"\n'
"""An honest upload before all attacks: the process that looks at it would else start amid the first of them."""


async def attack_rows(effort: Effort) -> list[Row]:
    """One row for each attack."""
    rows = []
    with running_server(max_sessions="64", log_level="info", built_in="cornell_box") as server:
        await _until_ready(server)
        await asyncio.to_thread(ask, server, "POST", "/v1/scenes", FIRST, "application/toml", "127.0.0.1")
        async with _honest(server) as sessions:
            await asyncio.sleep(ASIDE_S + SETTLE_S)  # then the renderer of large pictures begins to start
            times, begin = QUICK if effort.quick else THOROUGH, time.perf_counter()
            for number, attack in enumerate(ATTACKS):
                attacked = replace(server, attacker=attacker(number))
                share = (number + 1) / len(ATTACKS)
                rows.append(await _row(attacked, sessions, attack, times, begin + share * times.all_s))
    return rows


async def _until_rested(server: ServerUnderTest) -> None:
    """Until all renderers but that of the sessions have nothing to do."""
    end, used = time.perf_counter() + LONGEST_REST_S, server.aside_s()
    while time.perf_counter() < end:
        await asyncio.sleep(REST_S)
        before, used = used, server.aside_s()
        if sum(now - before.get(pid, 0.0) for pid, now in used.items()) < RESTING * REST_S:
            return


async def _until_ready(server: ServerUnderTest) -> None:
    while (await asyncio.to_thread(ask, server, "GET", "/ready"))[0] != 200:
        await asyncio.sleep(0.2)


@contextlib.asynccontextmanager
async def _honest(server: ServerUnderTest) -> AsyncIterator[list[LoadClient]]:
    """Clients that look around all the time, one after the other."""
    async with contextlib.AsyncExitStack() as stack:
        sessions = [await stack.enter_async_context(client(server, "cornell_box", **SMALL)) for _ in range(SESSIONS)]
        starts = [k * EVERY_S / SESSIONS for k in range(SESSIONS)]
        looks = [one.look_around(period_s=EVERY_S, begin_s=begin) for one, begin in zip(sessions, starts, strict=True)]
        walks = [asyncio.create_task(look) for look in looks]
        try:
            yield sessions
        finally:
            for walk in walks:
                walk.cancel()
            await asyncio.gather(*walks, return_exceptions=True)


@dataclass(frozen=True, kw_only=True)
class Times:
    """How long an attack is watched."""

    quiet_s: float  # before it and after it
    loud_s: float  # while it goes on
    rounds: tuple[int, int]  # at least and at most: as many as it takes until the limit is kept, or missed, for sure
    all_s: float = math.inf  # for all attacks: those that are decided at once leave more to others


QUICK = Times(quiet_s=2.5, loud_s=3.5, rounds=(1, 3), all_s=110.0)
THOROUGH = Times(quiet_s=8.0, loud_s=15.0, rounds=(2, 4))


@dataclass(eq=False)
class Watched:
    """An attack that came and went, several times, and the time about it."""

    quiet: list[Seen] = field(default_factory=list)
    loud: list[Seen] = field(default_factory=list)
    found: list[str] = field(default_factory=list)
    attacker_s: float = 0.0

    @property
    def change(self) -> Change:
        """Of p95."""
        return change_of(Seen.together(self.quiet), Seen.together(self.loud))


async def _watched(
    server: ServerUnderTest, sessions: list[LoadClient], attack: Attack, times: Times, until: float
) -> Watched:
    """In turns without it and with it, so that whatever else changes on this machine meets both.

    Args:
        until: time after which no further turn begins.
    """
    seen = Watched()
    for number in range(times.rounds[1]):
        async with player(server, attack.name) as playing:
            await _until_rested(server)
            await asyncio.sleep(SETTLE_S)
            seen.quiet.append(await watch(server, sessions, asyncio.sleep(times.quiet_s)))

            async def play(playing: Player = playing) -> None:
                begin = time.perf_counter()
                said = await playing.play(attack.longer * times.loud_s)
                seen.found.extend([said] if said and said not in seen.found else [])
                least = attack.watched * times.quiet_s
                await asyncio.sleep(max(0.0, least - (time.perf_counter() - begin)))

            seen.loud.append(await watch(server, sessions, play()))
            seen.attacker_s += playing.processor_s
        await asyncio.sleep(AFTER_S)
        seen.quiet.append(await watch(server, sessions, asyncio.sleep(times.quiet_s)))
        enough = seen.change.decides(attack.slower) or time.perf_counter() > until
        if enough and number + 1 >= times.rounds[0]:
            break
    return seen


async def _row(
    server: ServerUnderTest, sessions: list[LoadClient], attack: Attack, times: Times, until: float = math.inf
) -> Row:
    seen = await _watched(server, sessions, attack, times, until)
    over = await _over_after(server)
    before, during, change = Seen.together(seen.quiet), Seen.together(seen.loud), seen.change
    # What a renderer may take is a share of the memory of host or container: an attack gets no more than one such.
    grown, most = max(during.memory_mb) - min(seen.quiet[0].memory_mb), Settings().memory_mb
    text = (
        f"p95 {_compared(before, during)}, {change} "
        f"({len(before.latencies_s)} and {len(during.latencies_s)} keyframes{left_out([before, during])}), "
        f"/health p99 {during.health_ms:.0f} ms, cores: {_cores(before, during, seen.attacker_s)}, "
        f"memory {grown:+.0f} MB of {most}, log {during.log_per_minute / 1024:.0f} KB/min, over after {over:.1f} s"
        + "".join(f"; {one}" for one in seen.found)
    )
    met = (
        change.times <= attack.slower
        and during.health_ms < HEALTH_MS
        and grown < most
        and during.log_per_minute <= LOG_BYTES_PER_MINUTE
        and over < OVER_S
        and not any("MISSED" in one for one in seen.found)
    )
    goal = (
        f"p95 +{100 * (attack.slower - 1):.0f} % at most, /health p99 < 50 ms, memory and log bounded, over within 30 s"
    )
    details = {
        "p95_before_ms": _known(before.p95_ms),
        "p95_during_ms": _known(during.p95_ms),
        "health_p99_ms": during.health_ms,
        "p95_change": [_known(value) for value in change],
        "attacker_cores": seen.attacker_s / during.seconds,
        "server_cores": [one.server_s / one.seconds for one in (before, during)],
        "renderer_cores": [one.renderers_s / one.seconds for one in (before, during)],
        "memory_mb": grown,
        "memory_bound_mb": most,
        "log_bytes_per_minute": during.log_per_minute,
        "over_after_s": over,
    }
    return Row(
        what=attack.name,
        goal=goal,
        measured=text.replace("MISSED", "missed"),
        met=met,
        before=attack.once,
        details=details,
    )


def _compared(before: Seen, during: Seen) -> str:
    """In words: without any keyframe there is nothing to compare."""
    pair = (f"{ms:.1f} ms" if math.isfinite(ms) else "no keyframe" for ms in (before.p95_ms, during.p95_ms))
    return " → ".join(pair)


def _cores(before: Seen, during: Seen, attacker_s: float) -> str:
    """Who takes how much of the machine, as mean numbers of cores."""
    named = ("server", "renderers")
    pairs = [(one.server_s / one.seconds, one.renderers_s / one.seconds) for one in (before, during)]
    parts = [f"{name} {first:.2f} → {second:.2f}" for name, first, second in zip(named, *pairs, strict=True)]
    return ", ".join([*parts, f"attacker {attacker_s / during.seconds:.2f}"])


def _known(ms: float) -> float | None:
    """JSON has no infinity."""
    return ms if math.isfinite(ms) else None


async def _over_after(server: ServerUnderTest) -> float:
    """Until a small picture is made at once again and no connection of the attacker is left."""
    begin = time.perf_counter()
    while (passed := time.perf_counter() - begin) < OVER_S + 5.0:
        status, _ = await asyncio.to_thread(ask, server, "POST", "/v1/render", PICTURE)
        if status == 200 and await asyncio.to_thread(server.gauge, "connections") < SESSIONS + 12:
            return passed
        await asyncio.sleep(0.2)
    return passed
