"""What sessions and pictures cost, and what is full first: from what was measured, by formulas and by simulation."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

from torchrender.report.distributed.simulation import Cluster, Load, Served, simulate
from torchrender_service.load_test.rows import Row

CORE_HOUR = 0.04
"""US dollars, of a virtual core with 4 GB: about what large providers ask for machines that are not reserved."""
GIGABYTE = 0.05
"""US dollars, sent to the internet."""
TOLERANCE = 0.15


@dataclass(frozen=True, kw_only=True)
class Costs:
    """Of one keyframe, from a run with one client that wants all it can get: caches are warm, as where all are busy.

    Args:
        render_s, spread: in a renderer with a core of its own.
        carry_s: of a core, for its way to the client.
        tell_s: of a core, for a view that a client tells, whether a keyframe is made of it or not.
        always_s: of a core, each second, with no client at all.
    """

    render_s: float
    spread: float
    carry_s: float
    tell_s: float = 0.0
    always_s: float = 0.0

    @property
    def view_s(self) -> float:
        """Of a core, for a view that a client tells and its keyframe."""
        return self.tell_s + self.render_s + self.carry_s


def costs_of(found: dict[str, Any]) -> Costs:
    """From what the processes used while nobody was there, while clients told the same view again and again, and while
    one client looked about."""
    alone, standing, always = found["alone"], found["standing"], found["idle_cpu_s"]
    rate = alone["keyframes_per_s"]
    tell = max(0.0, standing["other_cpu_s"] - always) * standing["period_s"] / standing["sessions"]
    told = tell / alone["period_s"]
    carry = max(0.0, alone["other_cpu_s"] - always - told) / rate
    mean, deviation = alone["render_ms"]
    render = alone["renderer_cpu_s"] / rate
    spread = min(1.0, deviation / mean) if mean else 0.0
    return Costs(render_s=render, spread=spread, carry_s=carry, tell_s=tell, always_s=always)


def predicted(costs: Costs, looked: dict[str, Any], seconds: float = 60.0) -> Served:
    """What the simulation says about a measured run on two renderers and two cores."""
    cluster = Cluster(cores=2, renderers=2, **asdict(costs))
    return simulate(cluster, Load(sessions=looked["sessions"], period_s=looked["period_s"], seconds=seconds))


def check_rows(parts: dict[str, Any], of: str = "replicas") -> list[Row]:
    """The simulation beside the measured runs of two replicas, behind the proxy of part ``of``."""
    found = parts[of]
    costs = costs_of(found)
    rows = []
    for name in ("busy", "half"):
        looked = found[name]
        said = predicted(costs, looked)
        off = said.keyframes_per_s / looked["keyframes_per_s"] - 1.0
        times = f"latency {1e3 * said.latency_s:.0f} ms, measured {looked['latency_ms'][0]:.0f} ms"
        rates = f"{said.keyframes_per_s:.1f} keyframes/s, measured {looked['keyframes_per_s']:.1f} ({100 * off:+.0f} %)"
        rows.append(
            Row(
                what=f"simulated, {looked['sessions']} clients that look elsewhere every {looked['period_s']:.3g} s",
                goal="within 15 % of the measured two replicas",
                measured=f"{rates}; {times}",
                met=abs(off) <= TOLERANCE,
                details={"simulated": {"keyframes_per_s": said.keyframes_per_s, "latency_s": said.latency_s}},
            )
        )
    return rows


def prices(
    costs: Costs, *, keyframes_per_s: float, keyframe_bytes: float, pictures_per_core_s: float
) -> dict[str, float]:
    """US dollars: of an hour of a session, its share of cores and what it sends, and of 1,000 pictures of a batch."""
    cores = keyframes_per_s * costs.view_s
    sent = keyframes_per_s * keyframe_bytes * 3600.0 / 1e9
    return {
        "cores": cores,
        "session_hour": cores * CORE_HOUR + sent * GIGABYTE,
        "pictures_1000": 1000.0 / pictures_per_core_s / 3600.0 * CORE_HOUR,
    }
