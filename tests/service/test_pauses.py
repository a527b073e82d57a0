"""Who gives way to keyframes stands still while one is made, and never for long."""

from __future__ import annotations

import asyncio
import signal
from collections.abc import Coroutine
from typing import Any

import pytest

from torchrender_service.renderers.processes import pauses as module
from torchrender_service.renderers.processes.pauses import Pauses

STOP, GO = signal.SIGSTOP, signal.SIGCONT


class Process:
    """Notes the signals that it gets."""

    def __init__(self) -> None:
        self.returncode: int | None = None
        self.told: list[signal.Signals] = []

    def send_signal(self, number: signal.Signals) -> None:
        self.told.append(number)


def run(play: Coroutine[Any, Any, None]) -> None:
    asyncio.run(asyncio.wait_for(play, 30.0))


def test_others_stand_still_only_where_all_renderers_make_keyframes(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "SHARE", 0.0)

    async def play() -> None:
        pauses, aside = Pauses(2), Process()
        pauses.note("0", True)
        pauses.join(aside)  # type: ignore[arg-type]
        assert aside.told == []
        pauses.note("1", True)
        pauses.note("1", True)
        assert aside.told == [STOP]
        pauses.note("0", False)
        assert aside.told == [STOP, GO]
        pauses.note("0", True)
        pauses.leave(aside)  # type: ignore[arg-type]
        pauses.note("0", False)
        assert aside.told == [STOP, GO, STOP, GO], "one that is waited for now does not stay as it is"

    run(play())


def test_who_comes_while_others_stand_still_stands_still_too() -> None:
    async def play() -> None:
        pauses, first, second, ended = Pauses(), Process(), Process(), Process()
        ended.returncode = 0
        pauses.note("0", True)
        for one in (first, second, second, ended):
            pauses.join(one)  # type: ignore[arg-type]
        pauses.join(None)
        assert first.told == second.told == [STOP]
        pauses.note("0", False)
        assert first.told == second.told == [STOP, GO] and ended.told == []

    run(play())


def test_nobody_stands_still_for_long_and_all_run_between(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "LONGEST_S", 0.02)
    now = 100.0
    monkeypatch.setattr(module, "monotonic", lambda: now)

    async def play() -> None:
        nonlocal now
        pauses, aside = Pauses(), Process()
        pauses.join(aside)  # type: ignore[arg-type]
        pauses.note("0", True)
        now += 8.0
        for _ in range(100):
            await asyncio.sleep(0.01)
            if aside.told == [STOP, GO]:
                break
        assert aside.told == [STOP, GO], "a keyframe that takes long is not waited for"
        for passed, stops in ((1.9, False), (0.2, True)):  # a quarter of eight seconds is two
            now += passed
            pauses.note("0", False)
            pauses.note("0", True)
            assert (aside.told[2:] == [STOP]) == stops

    run(play())
