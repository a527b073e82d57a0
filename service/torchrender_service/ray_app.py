"""The service on Ray Serve: ``serve run torchrender_service.ray_app:application data_dir=/shared num_replicas=2``.

On one machine: ``python -m torchrender_service.ray_local --port 8000 num_replicas=2``.

Every replica is a whole service with renderers of its own. What they share is a directory of sessions, a named actor,
and a storage for scenes and kept files: a stream may begin on any of them and go on on any other.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import math
import os
import shutil
import statistics
from collections.abc import AsyncIterator, Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import msgspec
import ray
from fastapi import FastAPI
from filelock import FileLock, Timeout
from ray import serve
from ray.serve.config import AutoscalingConfig, AutoscalingContext, AutoscalingPolicy

from torchrender.errors import OptionError
from torchrender_service.logs import set_up_logs
from torchrender_service.metrics import Metrics
from torchrender_service.ray_directory import ray_directory
from torchrender_service.settings import Settings, memory_of_host_mb, read_settings
from torchrender_service.web.app import make_app

LOG = logging.getLogger("torchrender_service.ray_app")
NAME = "torchrender"
THREADS = ("OMP", "MKL", "OPENBLAS", "NUMBA", "NUMEXPR", "VECLIB")
MANY = 1_000_000
"""Requests that Serve lets a replica have: the service counts them itself, and a stream is one while it lasts."""
LOOK_S = 0.2
"""Between two looks whether Serve stops this replica."""
QUEUE_WAIT = "queue_wait_s"


class RayOptions(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """How many replicas there are, and how large each of them is."""

    num_replicas: int = 1
    max_replicas: int = 0  # more than num_replicas: as many are started as keep the wait for a renderer short
    num_cpus: float = 0.0  # of each replica; 0: all of this machine, shared by num_replicas
    queue_wait_s: float = 0.25  # seconds that a job may wait for a renderer before there should be more of them
    name: str = NAME  # of the directory of sessions

    def __post_init__(self) -> None:
        if self.num_replicas < 1 or (self.max_replicas and self.max_replicas < self.num_replicas):
            counts = f"num_replicas {self.num_replicas} and max_replicas {self.max_replicas}"
            raise OptionError(f"there must be at least one replica, and no fewer at most than at least: {counts}")
        if self.num_cpus < 0.0 or self.queue_wait_s <= 0.0:
            raise OptionError(f"num_cpus must be >= 0 and queue_wait_s > 0: {self.num_cpus} and {self.queue_wait_s}")

    @property
    def cpus(self) -> float:
        """Cores of each replica."""
        return self.num_cpus or max(1.0, (os.cpu_count() or 1) / self.num_replicas)


def application(args: Mapping[str, Any]) -> serve.Application:
    """What Serve runs.

    Args:
        args: fields of :class:`RayOptions` and of :class:`Settings`; what is missing is read as ``torchrender serve``
            does it, from ``TORCHRENDER_CONFIG`` and the environment of this process. ``shared_storage`` is a folder in
            ``data_dir`` unless it is given; machines that share no disk need an address.

    Raises:
        OptionError: an unknown name, a wrong type, or a value out of range.
    """
    options = options_of(args)
    own = RayOptions.__struct_fields__
    settings = settings_of({name: value for name, value in args.items() if name not in own}, options)
    deployment = serve.deployment(
        replica_class(settings, options.name),
        name=NAME,
        max_ongoing_requests=MANY,
        graceful_shutdown_timeout_s=settings.shutdown_s + 5.0,
        graceful_shutdown_wait_loop_s=0.5,
        health_check_period_s=2.0,
        health_check_timeout_s=10.0,
        ray_actor_options={
            "num_cpus": options.cpus,
            "runtime_env": {"env_vars": thread_variables(settings.renderer_threads)},
        },
        **_scaling(options),
    )
    return deployment.bind()


def options_of(args: Mapping[str, Any]) -> RayOptions:
    """What of the arguments is about replicas.

    Raises:
        OptionError: a wrong type, or a value out of range.
    """
    own = {name: args[name] for name in RayOptions.__struct_fields__ if name in args}
    try:
        return msgspec.convert(own, RayOptions, strict=False)
    except msgspec.ValidationError as error:
        raise OptionError(f"ray: {error}") from error


def settings_of(given: Mapping[str, Any], options: RayOptions) -> Settings:
    """Settings of each replica: cores and memory are its share of a machine."""
    settings = read_settings(**given)
    threads = settings.threads or max(1, min(int(options.cpus), 4))
    share = min(1.0, options.cpus / (os.cpu_count() or 1))
    filled: dict[str, Any] = {
        "threads": threads,
        "renderers": settings.renderers or max(1, int(options.cpus) // threads),
        "shared_storage": settings.shared_storage or str(Path(settings.data_dir).absolute() / "shared"),
        "data_dir": str(Path(settings.data_dir).absolute() / "replicas"),
    }
    settings = msgspec.structs.replace(settings, **filled)
    if not settings.renderer_memory_mb:
        processes = settings.renderer_count + settings.batch_renderer + settings.spare_renderer
        memory = int(0.75 * share * memory_of_host_mb() / processes)
        settings = msgspec.structs.replace(settings, renderer_memory_mb=max(512, memory))
    return settings


def thread_variables(threads: int) -> dict[str, str]:
    """Of the environment, for all libraries that start threads."""
    return {f"{name}_NUM_THREADS": str(threads) for name in THREADS} | {"OMP_WAIT_POLICY": "PASSIVE"}


def replica_class(settings: Settings, name: str) -> type:
    """The class whose objects are replicas."""

    def build() -> FastAPI:
        return build_replica(settings, name)

    class Replica:
        """A whole service."""

        def record_autoscaling_stats(self) -> dict[str, float]:
            """How long jobs have waited for a renderer lately."""
            return {QUEUE_WAIT: _WAITS[-1].mean_s() if _WAITS else 0.0}

    ready: type = serve.ingress(build)(Replica)
    return ready


class Waits:
    """How long jobs wait that somebody looks at; large pictures may wait."""

    def __init__(self, metrics: Metrics) -> None:
        self._metrics = metrics
        self._before = (0.0, 0.0)

    def mean_s(self) -> float:
        """Of those that have begun since this was asked last."""
        total, count = self._before
        self._before = self._metrics.total("queue_wait_seconds", but=("rank", "batch"))
        return (self._before[0] - total) / max(1.0, self._before[1] - count)


_WAITS: list[Waits] = []
"""Of the replica of this process."""


def build_replica(settings: Settings, name: str) -> FastAPI:
    """The application of one replica, within its process."""
    set_up_logs(settings.log_level)
    context = serve.get_replica_context()
    home = OwnHome(Path(settings.data_dir), context.replica_tag)
    settings = msgspec.structs.replace(settings, data_dir=str(home.folder))
    app = make_app(settings, directory=ray_directory(settings, name), replica=context.replica_tag)
    inner = app.router.lifespan_context
    stopping = stopping_of_replica()

    @contextlib.asynccontextmanager
    async def lifespan(app: FastAPI) -> AsyncIterator[Any]:
        state = app.state.service
        _WAITS.append(Waits(state.metrics))
        watch = asyncio.create_task(_say_goodbye(state, stopping, settings.shutdown_s))
        try:
            async with inner(app) as given:
                yield given
        finally:
            watch.cancel()
            home.give_up()

    app.router.lifespan_context = lifespan
    return app


async def _say_goodbye(state: Any, stopping: Callable[[], bool], seconds: float) -> None:
    """Serve waits for requests to end, and a stream is one that never does: so all are told as soon as it waits."""
    while not stopping():
        await asyncio.sleep(LOOK_S)
    LOG.info("Serve stops this replica", extra={"streams": len(state.sessions.connections)})
    await state.say_goodbye(seconds)


def stopping_of_replica() -> Callable[[], bool]:
    """Whether Serve stops the replica of this process. Serve tells its own part of it alone, which is looked at here.

    Raises:
        RuntimeError: there is nothing to look at, in this version of Ray.
    """
    for actor in ray._private.worker.global_worker.actors.values():
        found = getattr(actor, "_replica_impl", None)
        if found is not None and hasattr(found, "_shutting_down"):
            return partial(getattr, found, "_shutting_down")
    raise RuntimeError(f"Ray {ray.__version__} does not show when a replica is stopped: streams could not be told")


class OwnHome:
    """A folder for this replica alone; those that others have left behind are removed."""

    def __init__(self, parent: Path, tag: str) -> None:
        parent.mkdir(parents=True, exist_ok=True)
        for left in parent.iterdir():
            if left.is_dir():
                _remove_unused(left)
        self.folder = parent / tag
        self.folder.mkdir(exist_ok=True)
        self._lock = FileLock(self.folder / ".lock")
        self._lock.acquire(timeout=0)

    def give_up(self) -> None:
        """Remove it."""
        shutil.rmtree(self.folder, ignore_errors=True)
        self._lock.release()


def _remove_unused(folder: Path) -> None:
    lock = FileLock(folder / ".lock")
    try:
        with lock.acquire(timeout=0):
            shutil.rmtree(folder, ignore_errors=True)
    except (Timeout, OSError):
        return


def _scaling(options: RayOptions) -> dict[str, Any]:
    if options.max_replicas <= options.num_replicas:
        return {"num_replicas": options.num_replicas}
    policy = AutoscalingPolicy(
        policy_function="torchrender_service.ray_app:QueueWaitPolicy",
        policy_kwargs={"queue_wait_s": options.queue_wait_s},
    )
    scaling = AutoscalingConfig(
        min_replicas=options.num_replicas,
        max_replicas=options.max_replicas,
        policy=policy,
        upscale_delay_s=5.0,
        downscale_delay_s=120.0,
    )
    return {"autoscaling_config": scaling}


class QueueWaitPolicy:
    """As many replicas as keep the wait for a renderer near a goal: connections say nothing about it."""

    def __init__(self, queue_wait_s: float) -> None:
        self._goal_s = queue_wait_s

    def __call__(self, context: AutoscalingContext) -> tuple[int, dict[str, Any]]:
        """How many there should be."""
        waits = (context.aggregated_metrics or {}).get(QUEUE_WAIT, {})
        mean = statistics.fmean(waits.values()) if waits else self._goal_s / 2
        return wanted_replicas(context.current_num_replicas, mean, self._goal_s), {}


def wanted_replicas(now: int, wait_s: float, goal_s: float) -> int:
    """More where jobs wait longer than the goal, in proportion, twice as many at most; one fewer where they hardly
    wait at all."""
    if wait_s > goal_s:
        return max(now + 1, math.ceil(now * min(2.0, wait_s / goal_s)))
    return max(1, now - 1) if wait_s < goal_s / 10 else now
