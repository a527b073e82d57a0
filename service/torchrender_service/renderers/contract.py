"""What the server needs of whoever renders for it; :mod:`torchrender_service.renderers.pool` does it with processes."""

from __future__ import annotations

from typing import Any, Protocol

from torchrender_service.renderers.asked import Asked
from torchrender_service.renderers.jobs import Forget, Job


class RendererHandle:
    """One renderer, as whoever got it from a pool holds it.

    Every pool derives its own and alone looks inside: a process of this machine, or an actor of another one.
    """

    __slots__ = ()


class RendererPool(Protocol):
    """Carries out jobs, each in one of its renderers."""

    @property
    def ready(self) -> bool:
        """All renderers run, and first keyframes wait for no compiler."""

    @property
    def progress(self) -> str:
        """What is still going on before it is ready, or behind that, in words; empty for nothing."""

    @property
    def waiting(self) -> int:
        """Jobs waiting or running."""

    def start(self) -> None:
        """Begin to take jobs."""

    async def warm_up(self) -> None:
        """Start all renderers."""

    async def drain(self, seconds: float) -> None:
        """Take no more jobs: those that wait fail, those that run have so long to end."""

    async def stop(self) -> None:
        """End all renderers; jobs that wait fail."""

    def assign(self, *, background: bool = False) -> RendererHandle:
        """The renderer for the jobs of a new session, until :meth:`release`; as few sessions as possible share it.

        Args:
            background: one that does batch work, which keeps no stream waiting.
        """

    def release(self, renderer: RendererHandle) -> None:
        """The session is over. A handle that was released before does nothing."""

    def idle(self, renderer: RendererHandle) -> bool:
        """Whether a renderer of :meth:`assign` has nothing to do."""

    def alone(self, renderer: RendererHandle) -> bool:
        """Whether a renderer of :meth:`assign` has nothing to do, and no other session has asked it for anything of
        late."""

    def load(self, renderer: RendererHandle) -> int:
        """Jobs that wait or run in a renderer of :meth:`assign`."""

    async def run(
        self, job: Job, *, renderer: RendererHandle | None = None, asked: Asked | None = None
    ) -> dict[str, Any]:
        """The result of a job. Whoever stops waiting for it takes it back.

        Args:
            renderer: of :meth:`assign`; None: the one with the least to do, of those that do work of its class.
            asked: for whom; how long the job waited is noted there.

        Raises:
            ServiceError: what the renderer says about the job, 429 where too many jobs wait, 503 while stopping.
        """

    async def inspect(self, job: Job, asked: Asked | None = None) -> dict[str, Any]:
        """The result of a job that may do harm, apart from the others. Errors as :meth:`run`."""

    def forget(self, job: Forget) -> None:
        """Tell all renderers that run, without waiting."""
