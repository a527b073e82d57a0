"""The sessions of all replicas in one named actor of a Ray cluster."""

from __future__ import annotations

import asyncio
from typing import Any

import ray

from torchrender_service.errors import ServiceError
from torchrender_service.settings import Settings
from torchrender_service.streams.directory import SessionDirectory, make_ledger

NAMESPACE = "torchrender"
ANSWER_S = 5.0
"""For an answer of the actor; one that is started again takes less."""


class LedgerActor:
    """Holds the ledger; one call at a time, in the order in which each replica makes them."""

    def __init__(self, settings: Settings) -> None:
        self._ledger = make_ledger(settings)

    def call(self, name: str, given: tuple[Any, ...]) -> Any:
        """Call a method of the ledger. Errors are results: Ray would wrap them."""
        try:
            return getattr(self._ledger, name)(*given)
        except ServiceError as error:
            return error


def ray_directory(settings: Settings, name: str) -> SessionDirectory:
    """The directory of that name, begun where there is none; it lasts as long as the cluster.

    Its actor is started again when it is lost, and learns from the replicas what it has to know.
    """
    actor = (
        ray.remote(LedgerActor)
        .options(
            name=name,
            namespace=NAMESPACE,
            lifetime="detached",
            get_if_exists=True,
            num_cpus=0,
            max_restarts=-1,
            max_task_retries=0,
        )
        .remote(settings)
    )

    async def ask(method: str, *given: Any) -> Any:
        try:
            result = await asyncio.wait_for(_result(actor.call.remote(method, given)), ANSWER_S)
        except (asyncio.TimeoutError, ray.exceptions.RayError) as error:
            detail = "the directory of sessions does not answer"
            raise ServiceError(503, "directory", detail, retry_after_s=2.0) from error
        if isinstance(result, ServiceError):
            raise result
        return result

    def tell(method: str, *given: Any) -> None:
        actor.call.remote(method, given)

    return SessionDirectory(ask, tell)


async def _result(reference: Any) -> Any:
    return await reference


def end_directory(name: str) -> None:
    """End the actor of that name, if there is one."""
    try:
        ray.kill(ray.get_actor(name, namespace=NAMESPACE))
    except ValueError:
        return
