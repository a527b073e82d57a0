"""What all routes share."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable

from starlette.requests import HTTPConnection

from torchrender_service.door.bodies import Bodies
from torchrender_service.door.connections import Connections
from torchrender_service.errors import ServiceError
from torchrender_service.metrics import Metrics
from torchrender_service.renderers.contract import RendererPool
from torchrender_service.renderers.jobs import Forget
from torchrender_service.renderers.pool import Pool
from torchrender_service.scenes.store import SceneStore
from torchrender_service.settings import Settings
from torchrender_service.streams.directory import SessionDirectory, local_directory, make_ledger
from torchrender_service.streams.sessions import Session, SessionStore
from torchrender_service.streams.stream import SCENE_GONE, Surroundings
from torchrender_service.web.kept import KeptContainers, KeptPhotos

LOG = logging.getLogger("torchrender_service.web.state")
EXPIRE_S = 1.0
MakePool = Callable[[Settings, Metrics], RendererPool]


class ServiceState:
    """Settings, renderers, scenes and sessions of one service."""

    def __init__(
        self,
        settings: Settings,
        make_pool: MakePool = Pool,
        *,
        directory: SessionDirectory | None = None,
        replica: str = "",
    ) -> None:
        self.settings = settings
        self.metrics = Metrics({"replica": replica} if replica else {})
        self.connections = Connections(settings, self.metrics)
        self.bodies = Bodies(settings)
        self.pool = make_pool(settings, self.metrics)
        self.scenes = SceneStore(settings, self.pool, self.scene_gone)
        self.kept = KeptContainers(settings.max_kept_bytes, self.scenes.storage)
        self.photos = KeptPhotos(self.pool, settings.max_kept_bytes, self.scenes.storage)
        directory = directory or local_directory(make_ledger(settings))
        self.sessions = SessionStore(self._session_ended, directory, replica)
        self.around = Surroundings(settings=settings, sessions=self.sessions, pool=self.pool, metrics=self.metrics)
        self._tasks: list[asyncio.Task[None]] = []
        self._told = ""  # why the directory is out of reach

    async def start(self) -> None:
        """Open the store and start the renderers."""
        self.scenes.open()
        self.connections.open_files()
        self.pool.start()
        work = (self._expire(), self._warm_up(), self.connections.sweep())
        self._tasks = [asyncio.create_task(one) for one in work]

    async def stop(self) -> None:
        """End everything."""
        await self.say_goodbye(0.0)
        for task in self._tasks:
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)
        await self.pool.stop()
        if self.scenes.storage is not None:
            self.scenes.storage.close()

    @property
    def stopping(self) -> bool:
        """Nothing new is begun."""
        return self.bodies.stopping

    async def say_goodbye(self, seconds: float) -> None:
        """Begin nothing new: streams end, jobs that wait are given back, and those that run may take so long."""
        self.bodies.stopping = True
        await asyncio.gather(self._stop_streams(), self.pool.drain(seconds))
        await self.pool.stop()  # what has not ended by now is told to come again

    async def _stop_streams(self) -> None:
        """Say goodbye to all clients and wait until they are told."""
        for connection in self.sessions.connections:
            connection.end(1012, "the server is stopping")
        for _ in range(40):
            if not self.sessions.connections:
                break
            await asyncio.sleep(0.05)

    def scene_deleted(self, scene: str) -> None:
        """End the sessions that show it, on all replicas."""
        self.sessions.directory.delete_scene(scene)
        self.scene_gone(scene)

    def scene_gone(self, scene: str) -> None:
        """End the sessions here that show it."""
        for session in self.sessions.of_scene(scene):
            if session.connection is not None:
                session.connection.end(SCENE_GONE, "the scene was deleted")
            else:
                self.sessions.end(session)

    def scene_changed(self, scene: str) -> None:
        """Its program has changed it: every stream of it wants a new keyframe."""
        for session in self.sessions.of_scene(scene):
            if session.connection is not None:
                session.connection.refresh()

    def _session_ended(self, session: Session) -> None:
        self.pool.forget(Forget(session=session.id))
        self.pool.release(session.renderer)

    async def _expire(self) -> None:
        while True:
            await asyncio.sleep(EXPIRE_S)
            self.photos.expire()
            try:
                for scene in await self.sessions.beat():
                    await self.scenes.deleted_elsewhere(scene)
                self._told = ""
            except ServiceError as error:
                if error.detail != self._told:
                    LOG.warning("%s", error.detail)
                self._told = error.detail

    async def _warm_up(self) -> None:
        """Start every renderer and have the built-in scenes loaded, so that the first client need not wait."""
        try:
            await self.pool.warm_up()
            for scene in self.settings.built_in:
                await self.scenes.prepare(scene)
        except ServiceError as error:
            LOG.error("warm-up failed: %s", error.detail)


def state_of(connection: HTTPConnection) -> ServiceState:
    """The state of the application that serves a request."""
    state: ServiceState = connection.app.state.service
    return state
