"""A discrete-event simulation of many streams on many renderers, by SimPy: what waits for what, and how long.

A client looks elsewhere at intervals, and each view it tells takes its time of a core, with or without a keyframe;
only its newest view counts, and one keyframe of it is made at a time. A keyframe waits for its renderer, which loads
the scene first where it does not keep it, and for a core of its machine: renderers, and all that carries views and
keyframes, share the cores by turns. So queues, cold scenes and what carrying costs are in it; noise, memory and the
network between machines are not.
"""

from __future__ import annotations

import math
import random
import statistics
from collections import OrderedDict
from collections.abc import Callable, Generator, Iterator
from dataclasses import dataclass, field
from typing import Any, Literal

import simpy

from torchrender.checks import check_choice
from torchrender.errors import OptionError
from torchrender.report.distributed.ring import Ring

TURN_S = 0.004
"""That a process has a core for while others wait."""
HOUSE_S = 0.05
"""Between two turns of what is always done."""
Placing = Literal["fewest", "random", "ring"]
Process = Generator[simpy.Event, Any, None]


@dataclass(frozen=True, kw_only=True)
class Cluster:
    """What serves.

    Args:
        machines: each with so many cores and renderers, which have one thread each.
        render_s, spread: mean time of a keyframe in a renderer with a core of its own, and its standard deviation as a
            share of that; times are log-normal.
        carry_s: of a core, for a keyframe from the renderer to the client, whoever pays for it on that machine.
        tell_s: of a core, for a view from the client to the service, also where a newer one comes before its keyframe.
        always_s: of a core, each second on each machine, whatever is asked.
        load_s: of a core, to read a scene and build its trees.
        scenes_kept: by each renderer.
    """

    machines: int = 1
    cores: int = 2
    renderers: int = 2
    render_s: float = 0.1
    spread: float = 0.2
    carry_s: float = 0.0
    tell_s: float = 0.0
    always_s: float = 0.0
    load_s: float = 0.0
    scenes_kept: int = 8

    def __post_init__(self) -> None:
        if min(self.machines, self.cores, self.renderers, self.scenes_kept) < 1:
            raise OptionError("machines, cores, renderers and scenes_kept must be >= 1")
        if self.render_s <= 0.0 or min(self.spread, self.carry_s, self.tell_s, self.always_s, self.load_s) < 0.0:
            raise OptionError("render_s must be > 0, spread, carry_s, tell_s, always_s and load_s >= 0")


@dataclass(frozen=True, kw_only=True)
class Load:
    """Who asks.

    Args:
        sessions: streams, all there from the start.
        period_s: between two views of a client.
        scenes: different ones; the k-th is asked for in proportion to ``1 / k``.
        seconds: simulated, after ``settle_s`` that do not count.
        placing: each session's renderer: of those with the fewest sessions, any, or of its scene on a ring.
    """

    sessions: int
    period_s: float = 1.0
    scenes: int = 1
    seconds: float = 30.0
    settle_s: float = 5.0
    placing: Placing = "fewest"
    seed: int = 1

    def __post_init__(self) -> None:
        check_choice("placing", self.placing, ("fewest", "random", "ring"))
        if min(self.sessions, self.scenes) < 1 or min(self.period_s, self.seconds) <= 0.0:
            raise OptionError("sessions and scenes must be >= 1, period_s and seconds > 0")


@dataclass(frozen=True)
class Served:
    """What came of it, after the first seconds."""

    keyframes_per_s: float
    latency_s: float  # median, from a view to its keyframe
    latency_p95_s: float
    waiting_s: float  # mean, of that for a renderer
    cores_busy: float  # share
    cold: float  # share of keyframes for which a scene was loaded


@dataclass(eq=False)
class _Renderer:
    turn: simpy.Resource
    cores: simpy.Resource
    sessions: int = 0
    warm: OrderedDict[int, None] = field(default_factory=OrderedDict)


class _World:
    def __init__(self, cluster: Cluster, load: Load) -> None:
        self.cluster, self.load = cluster, load
        self.now = simpy.Environment()
        self.chance = random.Random(load.seed)
        machines = [simpy.Resource(self.now, cluster.cores) for _ in range(cluster.machines)]
        self.renderers = [
            _Renderer(simpy.Resource(self.now, 1), cores) for cores in machines for _ in range(cluster.renderers)
        ]
        if cluster.always_s:
            for cores in machines:
                self.now.process(self.keep_house(cores))
        self.ring = Ring(len(self.renderers))
        self.latencies: list[float] = []
        self.waits: list[float] = []
        self.busy_s, self.cold = 0.0, 0

    @property
    def counts(self) -> bool:
        return self.now.now >= self.load.settle_s

    def use(self, cores: simpy.Resource, seconds: float) -> Process:
        """So much of a core, in turns."""
        while seconds > 1e-12:
            turn = min(TURN_S, seconds)
            with cores.request() as request:
                yield request
                yield self.now.timeout(turn)
            if self.counts:
                self.busy_s += turn
            seconds -= turn

    def keep_house(self, cores: simpy.Resource) -> Process:
        while True:
            self.now.process(self.use(cores, HOUSE_S * self.cluster.always_s))
            yield self.now.timeout(HOUSE_S)

    def session(self, renderer: _Renderer, scene: int) -> Process:
        load = self.load
        begin = self.chance.uniform(0.0, load.period_s)
        yield self.now.timeout(begin)
        number = 0
        if self.cluster.tell_s:
            self.now.process(self.tell(renderer))
        while True:
            looked_at = begin + number * load.period_s
            with renderer.turn.request() as request:
                yield request
                if self.counts:
                    self.waits.append(self.now.now - looked_at)
                yield from self.load_scene(renderer, scene)
                yield from self.use(renderer.cores, self.render_time())
            self.now.process(self.carry(renderer, looked_at))
            newest = math.floor((self.now.now - begin) / load.period_s + 1e-9)
            if newest > number:
                number = newest
                continue
            number += 1
            yield self.now.timeout(begin + number * load.period_s - self.now.now)

    def tell(self, renderer: _Renderer) -> Process:
        """All views of a session: they come by the clock, and one after the other."""
        begin, number = self.now.now, 0
        while True:
            yield from self.use(renderer.cores, self.cluster.tell_s)
            number += 1
            yield self.now.timeout(max(0.0, begin + number * self.load.period_s - self.now.now))

    def carry(self, renderer: _Renderer, looked_at: float) -> Process:
        yield from self.use(renderer.cores, self.cluster.carry_s)
        if self.counts:
            self.latencies.append(self.now.now - looked_at)

    def load_scene(self, renderer: _Renderer, scene: int) -> Process:
        if scene not in renderer.warm:
            self.cold += self.counts
            yield from self.use(renderer.cores, self.cluster.load_s)
            renderer.warm[scene] = None
            while len(renderer.warm) > self.cluster.scenes_kept:
                renderer.warm.popitem(last=False)
        renderer.warm.move_to_end(scene)

    def render_time(self) -> float:
        if not self.cluster.spread:
            return self.cluster.render_s
        variance = math.log1p(self.cluster.spread**2)
        mean = math.log(self.cluster.render_s) - variance / 2
        return self.chance.lognormvariate(mean, math.sqrt(variance))

    def place(self, scene: int) -> _Renderer:
        placing = self.load.placing
        if placing == "random":
            return self.chance.choice(self.renderers)
        if placing == "fewest":
            return min(self.renderers, key=lambda r: r.sessions)
        return self.renderers[self.ring.place(str(scene), [r.sessions for r in self.renderers])]


def simulate(cluster: Cluster, load: Load) -> Served:
    """Let it run."""
    world = _World(cluster, load)
    shares = [1.0 / (k + 1) for k in range(load.scenes)]
    for scene in world.chance.choices(range(load.scenes), shares, k=load.sessions):
        renderer = world.place(scene)
        renderer.sessions += 1
        world.now.process(world.session(renderer, scene))
    world.now.run(until=load.settle_s + load.seconds)
    ordered = sorted(world.latencies) or [math.inf]
    made = len(world.latencies)
    return Served(
        keyframes_per_s=made / load.seconds,
        latency_s=statistics.median(ordered),
        latency_p95_s=ordered[min(len(ordered) - 1, math.ceil(0.95 * len(ordered)) - 1)],
        waiting_s=statistics.fmean(world.waits) if world.waits else 0.0,
        cores_busy=world.busy_s / (load.seconds * cluster.machines * cluster.cores),
        cold=world.cold / max(1, made),
    )


def capacity(cluster: Cluster, period_s: float, good: Callable[[Served], bool], *, most: int = 4096) -> int:
    """The most sessions, of powers of two and their middles, that are served well; 0 for none."""
    found = 0
    for sessions in _steps(most):
        if not good(simulate(cluster, Load(sessions=sessions, period_s=period_s))):
            break
        found = sessions
    return found


def _steps(most: int) -> Iterator[int]:
    step = 1
    while step <= most:
        yield step
        if step > 1 and step + step // 2 <= most:
            yield step + step // 2
        step *= 2
