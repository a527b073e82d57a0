"""Sessions from the request to the end of their stream, with a pool that renders elsewhere."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Coroutine
from typing import Any

import msgspec
import pytest
from fastapi import FastAPI, Request
from starlette.datastructures import Headers

from service_parts import CAMERA, FACTS, Actor, FakePool, make_record
from torchrender.wire.messages import MAJOR, SUBPROTOCOL, Bye, Hello, Message, Type, Welcome, decode, encode
from torchrender_service.errors import ServiceError
from torchrender_service.metrics import Metrics
from torchrender_service.renderers.jobs import Forget, Job, Locate, SceneSource
from torchrender_service.settings import Settings, read_settings
from torchrender_service.streams.directory import SessionDirectory, local_directory, make_ledger
from torchrender_service.streams.sessions import SceneClock, Session, SessionStore
from torchrender_service.streams.stream import Stream, Surroundings
from torchrender_service.web.app import make_app
from torchrender_service.web.routes_stream import _admitted
from torchrender_service.web.routes_stream import make_session as answer_request
from torchrender_service.web.schemas import SessionRequest
from torchrender_service.web.state import ServiceState, state_of

WISH = SessionRequest(scene="cornell_box", width=64, height=48)


def run(play: Coroutine[Any, Any, None]) -> None:
    """What hangs fails soon."""
    asyncio.run(asyncio.wait_for(play, 20.0))


class Socket:
    """A client that sends what it is told to."""

    def __init__(self) -> None:
        self.inbox: asyncio.Queue[dict[str, Any]] = asyncio.Queue()
        self.sent: list[Message] = []
        self.scope: dict[str, Any] = {"extensions": {}}
        self.code: int | None = None

    def say(self, message: Message) -> None:
        self.inbox.put_nowait({"type": "websocket.receive", "bytes": encode(message)})

    async def receive(self) -> dict[str, Any]:
        return await self.inbox.get()

    async def send_bytes(self, data: bytes) -> None:
        self.sent.append(decode(data, (Type.WELCOME, Type.BYE)).message)

    async def close(self, code: int, reason: str) -> None:
        del reason
        self.code = code


class Stage:
    """A store of sessions, and streams without sockets."""

    def __init__(self, **settings: Any) -> None:
        self.settings = read_settings(None, {}, **settings)
        self.ledger = make_ledger(self.settings)
        self.store = SessionStore(lambda _: None, local_directory(self.ledger))
        self.around = Surroundings(settings=self.settings, sessions=self.store, pool=FakePool(), metrics=Metrics())

    async def open(self, ticket: str) -> tuple[Socket, asyncio.Task[None], Welcome]:
        socket = Socket()
        record = await self.store.redeem(ticket)
        session = self.store.find(record)
        if session is None:
            session = Session.of(record, SceneSource(id=record.scene), dict(FACTS), Actor("far away"))
            self.store.put(session)
        stream = Stream(socket, session, self.around)  # type: ignore[arg-type]
        task = asyncio.create_task(stream.run())
        socket.say(Hello(versions=(MAJOR, MAJOR)))
        while not socket.sent:
            await asyncio.sleep(0)
        (welcome,) = socket.sent
        assert isinstance(welcome, Welcome)
        return socket, task, welcome


def test_a_session_does_not_expire_while_its_stream_is_connected() -> None:
    """However long that lasts, and whoever makes sessions meanwhile."""

    async def play() -> None:
        stage = Stage(ticket_s=0.02, resume_s=0.3)
        ticket = stage.ledger.add(make_record("long"))
        socket, task, welcome = await stage.open(ticket)
        await asyncio.sleep(0.04)
        stage.ledger.add(make_record("another"))
        await stage.store.beat()
        assert not task.done() and len(stage.ledger) == 2 and len(stage.store.connections) == 1
        await stage.store.redeem(welcome.resume)  # the way back is still open
        socket.inbox.put_nowait({"type": "websocket.disconnect"})
        await task
        await stage.store.beat()
        assert len(stage.store) == 1, "it may come back"
        await asyncio.sleep(0.35)
        await stage.store.beat()
        assert len(stage.store) == len(stage.ledger) == 0

    run(play())


def test_a_second_connection_takes_the_session_over() -> None:
    async def play() -> None:
        stage = Stage()
        first, task, welcome = await stage.open(stage.ledger.add(make_record("one")))
        second, other, _ = await stage.open(welcome.resume)
        await task
        assert first.code == 1008 and isinstance(first.sent[-1], Bye)
        assert not other.done() and len(stage.store) == 1 and len(stage.store.connections) == 1
        second.say(Bye(reason="done"))
        await other
        assert second.code == 1000 and len(stage.store) == 0

    run(play())


def service(pool: FakePool, **settings: Any) -> tuple[ServiceState, Request]:
    """The state of a service with another pool, and a request to it."""

    def make_pool(settings: Settings, metrics: Metrics) -> FakePool:
        del settings, metrics
        return pool

    app: FastAPI = make_app(read_settings(None, {}, built_in=["cornell_box"], **settings), make_pool)
    request = Request({"type": "http", "app": app, "headers": []})
    return state_of(request), request


class Knocking:
    """A WebSocket with a ticket, before it is accepted."""

    def __init__(self, request: Request, ticket: str) -> None:
        self.app, self.headers = request.app, Headers({"host": "localhost"})
        self.scope = {"subprotocols": [SUBPROTOCOL, f"bearer.{ticket}"]}


def test_a_renderer_is_chosen_when_the_stream_begins_and_handed_back_after_it() -> None:
    """Another pool may give whatever it knows its renderers by."""
    pool = FakePool("first", "second", "here")

    async def play() -> None:
        state, request = service(pool)
        made = [await answer_request(request, WISH) for _ in range(2)]
        located = [address for address, job in pool.jobs if isinstance(job, Locate)]
        assert located == ["first", "second"] and pool.back == pool.given
        session = await _admitted(Knocking(request, made[1]["ticket"]), state)  # type: ignore[arg-type]
        assert session.renderer is pool.given[2] and session.id == made[1]["session"]
        assert session.camera == CAMERA and len(state.sessions) == 1
        state.sessions.end(session)
        assert pool.back == pool.given
        assert pool.jobs[-1] == (None, Forget(session=session.id))

    run(play())


@pytest.mark.parametrize("why", ["refused", "full"])
def test_a_session_that_comes_to_nothing_gives_its_renderer_back(why: str) -> None:
    ledger = make_ledger(read_settings(None, {}, max_sessions=1))

    class Refusing(FakePool):
        """Finds no camera, or lets others take the last place meanwhile."""

        def answer(self, job: Job) -> dict[str, Any]:
            if isinstance(job, Locate):
                if why == "refused":
                    raise ServiceError(422, "invalid-value", "no camera")
                ledger.add(make_record("quicker"))
            return super().answer(job)

    pool = Refusing()
    state, request = service(pool)
    state.sessions.directory = local_directory(ledger)
    with pytest.raises(ServiceError) as caught:
        asyncio.run(answer_request(request, WISH))
    assert caught.value.status == {"refused": 422, "full": 429}[why]
    assert pool.back == pool.given and len(pool.given) == 1


def test_streams_end_when_their_session_goes_on_in_another_replica() -> None:
    """And what the client had set goes along; ids of keyframes never come twice."""

    async def play() -> None:
        stage = Stage()
        _, task, welcome = await stage.open(stage.ledger.add(make_record("one")))
        (session,) = stage.store.of_scene("cornell_box")
        session.exposure, session.next_id = 2.0, 7
        await stage.store.beat()
        other = Stage()
        other.store = SessionStore(lambda _: None, local_directory(stage.ledger), "other")
        other.around.sessions = other.store
        _, elsewhere, _ = await other.open(welcome.resume)
        (moved,) = other.store.of_scene("cornell_box")
        assert moved.exposure == 2.0 and moved.next_id >= 2**20
        await stage.store.beat()
        await task
        assert len(stage.store) == 0 and len(stage.ledger) == 1 and not elsewhere.done()
        elsewhere.cancel()
        await asyncio.gather(elsewhere, return_exceptions=True)

    run(play())


def test_a_directory_that_was_lost_learns_from_the_replicas_what_there_is() -> None:
    async def play() -> None:
        stage = Stage()
        _, task, welcome = await stage.open(stage.ledger.add(make_record("one")))
        await stage.store.beat()
        fresh = make_ledger(stage.settings)
        stage.store.directory = local_directory(fresh)
        await stage.store.beat()
        assert len(fresh) == 1 and not task.done() and len(stage.store) == 1
        assert (await stage.store.redeem(welcome.resume)).id == "one"
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)

    run(play())


def test_a_directory_out_of_reach_lets_streams_go_on() -> None:
    async def ask(name: str, *given: Any) -> Any:
        raise ServiceError(503, "directory", f"cannot {name} {len(given)}")

    async def play() -> None:
        stage = Stage()
        _, task, _ = await stage.open(stage.ledger.add(make_record("one")))
        stage.store.directory = SessionDirectory(ask, lambda *_: None)
        with pytest.raises(ServiceError, match="cannot beat"):
            await stage.store.beat()
        assert not task.done() and len(stage.store) == 1
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)

    run(play())


def test_the_clock_of_a_scene_counts_while_it_plays() -> None:
    clock = SceneClock()
    assert clock.at(5.0) is None
    clock.play(True, 100.0)
    assert clock.at(100.0) == 0.0 and clock.at(102.5) == 2.5
    clock.play(True, 103.0)  # again: nothing begins anew
    clock.play(False, 104.0)
    assert clock.at(200.0) == 4.0
    clock.play(True, 300.0)
    assert clock.at(301.0) == 5.0


@pytest.mark.parametrize("playing", [True, False])
def test_the_clock_of_a_scene_goes_on_in_another_replica(playing: bool) -> None:
    record = msgspec.structs.replace(make_record("s"), scene_s=12.5, playing=playing)
    before = time.monotonic()
    session = Session.of(record, SceneSource(id=record.scene), dict(FACTS), Actor("far away"))
    assert session.clock.playing == playing
    passed = session.clock.at(before + 100.0)
    assert passed == pytest.approx(112.5 if playing else 12.5, abs=0.5)
    again = session.record()
    assert again.playing == playing and again.scene_s == pytest.approx(12.5, abs=0.5)


def test_a_scene_that_never_moved_has_no_clock_anywhere() -> None:
    session = Session.of(make_record("s"), SceneSource(id="cornell_box"), dict(FACTS), Actor("far away"))
    assert session.clock.at(1e6) is None and session.record().scene_s is None and not session.record().playing
