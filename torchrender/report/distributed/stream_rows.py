"""What was measured of streams, as rows beside their goals."""

from __future__ import annotations

from typing import Any

from torchrender.report.distributed.reckoning import costs_of
from torchrender_service.load_test.rows import Row


def stream_rows(parts: dict[str, Any], of: str = "replicas") -> list[Row]:
    """Two replicas, behind the proxy of part ``of``, beside one server."""
    alone, found = parts["server"], parts[of]
    return [
        *_throughput(alone, found),
        *_opened(found),
        _compression(found),
        Row(
            what="memory of all processes, two renderers busy",
            goal="",
            measured=f"{found['memory_mb']:.0f} MB (one server of two renderers: {alone['memory_mb']:.0f} MB)",
            met=None,
        ),
    ]


def _throughput(alone: dict[str, Any], found: dict[str, Any]) -> list[Row]:
    ratio = found["busy"]["keyframes_per_s"] / alone["busy"]["keyframes_per_s"]
    health = found["health_ms"]
    rates = [side["busy"]["keyframes_per_s"] for side in (found, alone)]
    return [
        Row(
            what=f"two replicas of one renderer, {found['busy']['sessions']} clients that want all they can get, "
            f"{1.0 / found['busy']['period_s']:.0f} poses a second each",
            goal="≥ 0.85 of one server with two renderers",
            measured=f"{rates[0]:.1f} against {rates[1]:.1f} keyframes/s: {ratio:.2f}; "
            f"{_cores(found['busy'])} against {_cores(alone['busy'])}",
            met=ratio >= 0.85,
        ),
        Row(
            what="one client at leisure, from a view to its keyframe, median (p95)",
            goal="",
            measured=f"{_pair(found['leisure'])} (one server: {_pair(alone['leisure'])})",
            met=None,
        ),
        Row(
            what="a view that a client tells, without a keyframe, all but renderers",
            goal="",
            measured=f"{_told_ms(found):.2f} ms of a core (one server: {_told_ms(alone):.2f} ms)",
            met=None,
        ),
        Row(
            what="/health, nothing else to do, p50 (p99)",
            goal="≤ 2 ms",
            measured=f"{health[0]:.1f} ms ({health[1]:.1f}); one server: {alone['health_ms'][0]:.1f} ms",
            met=health[0] <= 2.0,
        ),
    ]


def _cores(looked: dict[str, Any]) -> str:
    return f"{looked['renderer_cpu_s']:.2f} cores of renderers and {looked['other_cpu_s']:.2f} of all else"


def _told_ms(found: dict[str, Any]) -> float:
    return 1e3 * costs_of(found).tell_s


def _pair(looked: dict[str, Any]) -> str:
    low, high = looked["latency_ms"]
    return f"{low:.0f} ms ({high:.0f})"


def _opened(found: dict[str, Any]) -> list[Row]:
    opened = found["opened"]
    why = f" ({', '.join(opened['why'])})" if opened["why"] else ""
    return [
        Row(
            what=f"{opened['asked']} streams opened at once on two replicas, each until its first keyframe",
            goal="0 refused",
            measured=f"{opened['refused']} refused{why}, all in {opened['s']:.1f} s",
            met=opened["refused"] == 0,
        ),
        Row(
            what="an upload, until every replica knows it",
            goal="≤ 1 s",
            measured=f"{found['upload_s']:.2f} s after its answer",
            met=found["upload_s"] <= 1.0,
        ),
    ]


def lost_rows(parts: dict[str, Any]) -> list[Row]:
    """A replica that is killed, and one that is taken away."""
    found = parts["lost"]
    killed, scaled = found["killed"], found["scaled"]
    back, (before, after) = killed["back_s"], killed["p95_ms"]
    told = [one for one in scaled["told"] if one[1] == 1012 and one[0]]
    return [
        Row(
            what=f"one of two replicas killed: its {killed['lost']} of {killed['clients']} clients see again",
            goal="≤ 3 s, on the other one",
            measured=f"{len(back)} of {killed['lost']} came back, after {', '.join(f'{s:.1f}' for s in back)} s",
            met=len(back) >= killed["lost"] > 0 and max(back) <= 3.0,
        ),
        Row(
            what="p95 of the other replica's clients, before and after the kill",
            goal="+25 % at most",
            measured=f"{before:.0f} → {after:.0f} ms ({100 * (after / before - 1):+.0f} %)",
            met=after <= 1.25 * before,
        ),
        Row(
            what=f"scaled down to one replica: streams of {scaled['clients']} that were told with BYE and 1012",
            goal="all that ended",
            measured=f"{len(told)} of {len(scaled['told'])} that ended"
            + (f", within {max(one[2] for one in told):.1f} s" if told else ""),
            met=0 < len(scaled["told"]) == len(told),
        ),
    ]


def _compression(found: dict[str, Any]) -> Row:
    has = found["compressed"]["deflate"]
    return Row(
        what="a client that offers compression, as browsers do",
        goal="",
        measured="the proxy compresses what is compressed already" if has else "the proxy does not compress",
        met=None,
    )
