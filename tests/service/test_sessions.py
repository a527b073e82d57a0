"""Sessions from the request to the end of their stream, with a pool that renders elsewhere."""

from __future__ import annotations

import asyncio
from collections.abc import Coroutine
from typing import Any

import pytest
from fastapi import FastAPI, Request

from service_parts import FACTS, FakePool, make_session
from torchrender.wire.messages import MAJOR, Bye, Hello, Message, Type, Welcome, decode, encode
from torchrender_service.errors import ServiceError
from torchrender_service.metrics import Metrics
from torchrender_service.renderers.jobs import Forget, Job, Locate
from torchrender_service.settings import Settings, read_settings
from torchrender_service.streams.sessions import SceneClock, SessionStore
from torchrender_service.streams.stream import Stream, Surroundings
from torchrender_service.web.app import make_app
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
        self.store = SessionStore(self.settings, on_end=lambda _: None)
        self.around = Surroundings(settings=self.settings, sessions=self.store, pool=FakePool(), metrics=Metrics())

    async def open(self, ticket: str) -> tuple[Socket, asyncio.Task[None], Welcome]:
        socket = Socket()
        stream = Stream(socket, self.store.redeem(ticket), self.around)  # type: ignore[arg-type]
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
        ticket = stage.store.add(make_session("long", stage.settings.ticket_s, facts=FACTS))
        socket, task, welcome = await stage.open(ticket)
        await asyncio.sleep(0.04)
        stage.store.add(make_session("another"))
        stage.store.expire()
        assert not task.done() and len(stage.store) == 2 and len(stage.store.connections) == 1
        stage.store.redeem(welcome.resume)  # the way back is still open
        socket.inbox.put_nowait({"type": "websocket.disconnect"})
        await task
        stage.store.expire()
        assert len(stage.store) == 2, "it may come back"
        await asyncio.sleep(0.35)
        stage.store.expire()
        assert len(stage.store) == 1

    run(play())


def test_a_second_connection_takes_the_session_over() -> None:
    async def play() -> None:
        stage = Stage()
        first, task, welcome = await stage.open(stage.store.add(make_session("one", facts=FACTS)))
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


def test_a_session_keeps_the_renderer_that_its_pool_gives_and_hands_it_back() -> None:
    """Another pool may give whatever it knows its renderers by."""
    pool = FakePool("here", "there")

    async def play() -> None:
        state, request = service(pool)
        made = [await answer_request(request, WISH) for _ in range(2)]
        located = [address for address, job in pool.jobs if isinstance(job, Locate)]
        assert located == ["here", "there"]
        session = state.sessions.redeem(made[1]["ticket"])
        assert session.renderer is pool.given[1]
        state.sessions.end(session)
        assert pool.back == [pool.given[1]]
        assert pool.jobs[-1] == (None, Forget(session=session.id))

    run(play())


@pytest.mark.parametrize("why", ["refused", "full"])
def test_a_session_that_comes_to_nothing_gives_its_renderer_back(why: str) -> None:
    class Refusing(FakePool):
        """Finds no camera, or lets others take the last place meanwhile."""

        def answer(self, job: Job) -> dict[str, Any]:
            if isinstance(job, Locate):
                if why == "refused":
                    raise ServiceError(422, "invalid-value", "no camera")
                state.sessions.add(make_session("quicker"))
            return super().answer(job)

    pool = Refusing()
    state, request = service(pool, max_sessions=1)
    with pytest.raises(ServiceError) as caught:
        asyncio.run(answer_request(request, WISH))
    assert caught.value.status == {"refused": 422, "full": 429}[why]
    assert pool.back == pool.given and len(pool.given) == 1


def test_an_address_has_as_many_sessions_as_it_may_and_a_ticket_works_once() -> None:
    stage = Stage(max_sessions_per_address=2)
    tickets = [stage.store.add(make_session(str(k))) for k in range(2)]
    for attempt in (stage.store.check_room, lambda: stage.store.add(make_session("3"))):
        with pytest.raises(ServiceError) as refused:
            attempt()
        assert refused.value.status == 429 and "2 sessions" in str(refused.value)
    stage.store.check_room("another address")
    stage.store.redeem(tickets[0])
    with pytest.raises(ServiceError) as used:
        stage.store.redeem(tickets[0])
    assert used.value.status == 403


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
