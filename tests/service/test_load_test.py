"""What the load test makes of its findings, and how it attacks; its figures are its own command's."""

from __future__ import annotations

import asyncio
import contextlib
import itertools
import json
import math
import os
import random
import statistics
import subprocess
import sys
import time
from collections.abc import AsyncIterator, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from torchrender.quality.machine import machine_record
from torchrender_service.load_test import beside, driver, watching
from torchrender_service.load_test.attacks import ATTACKS, Attack
from torchrender_service.load_test.driver import LoadClient, LoadTestError, ServerUnderTest, percentile, processor_s
from torchrender_service.load_test.files import large_texture_glb, long_key_toml, long_name_glb
from torchrender_service.load_test.playing import player
from torchrender_service.load_test.rows import Effort, Row
from torchrender_service.load_test.run import page
from torchrender_service.load_test.watching import Change, Others, Seen, change_of, left_out, noting


def test_the_page_says_what_an_attack_once_did() -> None:
    plain = Row(what="a", goal="b", measured="c", met=True)
    attack = Row(what="d", goal="e", measured="f", met=False, before="g")
    assert attack.to_dict()["before"] == "g" and "before" not in plain.to_dict()
    text = page({"Load": [plain], "Attacks": [attack]}, machine_record(), Effort(quick=True))
    assert "| a | b | c | met |" in text and "| d | g | e | f | **missed** |" in text
    assert "torchrender load-test --quick" in text
    for line in text.splitlines():
        assert "nan" not in line.split()


def test_each_attack_has_a_name_and_a_past_of_its_own() -> None:
    assert len({attack.name for attack in ATTACKS}) == len(ATTACKS) == 9
    assert all(attack.once and attack.slower >= 1.1 for attack in ATTACKS)


def test_what_an_attacker_sends_is_made_before_it_attacks() -> None:
    """What takes long to make would else take from others while it is measured what they notice."""
    attack = next(one for one in ATTACKS if "JSON" in one.name)
    assert len(attack.prepare()) > 84_000_000 and attack.prepare() is attack.prepare()


def test_percentiles_are_values_that_were_seen() -> None:
    values = [float(v) for v in range(1, 101)]
    assert [percentile(values, share) for share in (0.0, 0.5, 0.95, 1.0)] == [1.0, 50.0, 95.0, 100.0]
    assert math.isnan(percentile([], 0.5))
    seen = Seen(blocks=[[0.1] * 9, [], [0.1] * 10 + [0.9]], health_s=[0.01, 0.02], log_bytes=100.0, seconds=6.0)
    assert (seen.p95_ms, seen.health_ms, seen.log_per_minute) == (100.0, 20.0, 1000.0)


def test_a_change_of_p95_comes_with_an_interval_that_holds_it() -> None:
    """Of many pairs of stretches that are alike, about nine of ten intervals hold what is true: no change."""
    rng = random.Random(1)

    def stretch(factor: float = 1.0) -> Seen:
        return Seen(blocks=[[factor * rng.lognormvariate(-4.5, 0.15) for _ in range(20)] for _ in range(12)])

    alike = [change_of(stretch(), stretch()) for _ in range(60)]
    held = sum(one.low <= 1.0 <= one.high for one in alike)
    assert 47 <= held <= 60
    assert statistics.median(one.high - one.low for one in alike) < 0.25
    worse = change_of(stretch(), stretch(1.5))
    assert worse.times == pytest.approx(1.5, abs=0.2) and worse.low > 1.1 and worse.decides(1.1)
    assert not change_of(stretch(), stretch(1.1)).decides(1.1)
    assert change_of(stretch(), stretch(0.8)).decides(1.1)
    assert str(Change(1.04, 0.97, 1.12)) == "+4 % [-3, +12]"


def test_hold_ups_widen_the_interval() -> None:
    """Twenty late keyframes of one hold-up are not twenty findings."""
    together = [[0.01] * 20] * 19 + [[0.05] * 20]
    apart = [[0.01] * 19 + [0.05]] * 20
    usual = Seen(blocks=[[0.01] * 20] * 20)
    one, many = change_of(usual, Seen(blocks=together)), change_of(usual, Seen(blocks=apart))
    assert one.high > 4.0 and one.low == pytest.approx(1.0)
    assert many.low == many.high == pytest.approx(1.0)


def test_without_keyframes_nothing_is_known_and_no_limit_is_kept() -> None:
    change = change_of(Seen(), Seen(blocks=[[0.1]]))
    assert str(change) == "not known" and not change.times <= 1.1 and not change.decides(1.1)


def test_a_time_in_which_others_take_the_machine_is_left_out(monkeypatch: pytest.MonkeyPatch) -> None:
    taken = iter([0.0, 0.5, 0.14])
    monkeypatch.setattr(watching, "Others", lambda _: SimpleNamespace(cores=lambda: next(taken)))
    server, one, seen = ServerUnderTest(None, 1, "127.0.0.1", 9), LoadClient(None, None, 0.0), Seen()  # type: ignore[arg-type]

    async def play() -> None:
        for number in range(3):
            async with noting(server, [one], seen):
                one.latencies_s.append(float(number))

    asyncio.run(play())
    assert (seen.blocks, seen.disturbed) == ([[0.0], [2.0]], [[1.0]])
    assert seen.latencies_s == [0.0, 2.0, 1.0], "two blocks are too few to say anything"
    assert left_out([seen]) == ", 33 % disturbed, and too much to leave out" and left_out([Seen(blocks=[[1.0]])]) == ""
    enough = Seen.together([seen, seen, seen])
    assert enough.latencies_s == [0.0, 2.0] * 3
    assert left_out([enough, enough]) == ", 33 % left out"


def test_others_are_those_that_are_no_part_of_the_test(monkeypatch: pytest.MonkeyPatch) -> None:
    now, ran = [50.0], {"all": 900.0, 7: 3.0, 8: 5.0}
    monkeypatch.setattr(watching.time, "perf_counter", lambda: now[0])
    monkeypatch.setattr(watching.os, "getpid", lambda: 7)
    monkeypatch.setattr(watching, "family", lambda _: [7, 8, 9])  # an attacker, and the server
    monkeypatch.setattr(watching, "all_processor_s", lambda: ran["all"])
    monkeypatch.setattr(watching, "processor_s", lambda pid: (ran[pid], 0.5))
    monkeypatch.setattr(ServerUnderTest, "processor_s", lambda _: (ran["all"] / 9.0, 0.0))
    others = Others(ServerUnderTest(None, 9, "127.0.0.1", 9))
    now[0] += 2.0
    ran |= {"all": 903.6, 7: 3.5, 8: 5.3}
    assert others.cores() == pytest.approx((3.6 - 0.4 - 0.5 - 0.3) / 2.0)
    now[0] += 1.0
    ran[8] = 9.0  # ticks of the system are coarse
    assert others.cores() == 0.0


def test_attacks_share_the_time_that_there_is(monkeypatch: pytest.MonkeyPatch) -> None:
    """What one does not need is left to the next ones; each has an address of its own."""
    begun: list[tuple[str, str, float]] = []

    @contextlib.contextmanager
    def server(**_: str) -> Iterator[ServerUnderTest]:
        yield ServerUnderTest(None, 1, "127.0.0.1", 9)

    @contextlib.asynccontextmanager
    async def honest(_: ServerUnderTest) -> AsyncIterator[list[LoadClient]]:
        yield []

    async def nothing(*_: Any) -> None:
        return

    async def row(server: ServerUnderTest, _: Any, attack: Attack, times: beside.Times, until: float) -> str:
        assert times is beside.QUICK
        begun.append((attack.name, server.attacker, until - time.perf_counter()))
        return attack.name

    for name, instead in {
        "running_server": server,
        "_honest": honest,
        "_until_ready": nothing,
        "_row": row,
        "ask": lambda *_: (201, b""),
        "ASIDE_S": 0.0,
        "SETTLE_S": 0.0,
    }.items():
        monkeypatch.setattr(beside, name, instead)
    rows: list[Any] = asyncio.run(beside.attack_rows(Effort(quick=True)))
    assert rows == [attack.name for attack in ATTACKS] == [name for name, _, _ in begun]
    assert len({address for _, address, _ in begun}) == (9 if sys.platform == "linux" else 1)
    shares = [left / beside.QUICK.all_s for _, _, left in begun]
    assert shares == pytest.approx([(k + 1) / 9 for k in range(9)], abs=0.02)


def test_turns_go_on_until_the_limit_is_kept_or_missed_for_sure(monkeypatch: pytest.MonkeyPatch) -> None:
    """Once it says nothing more, or no more time is left."""

    class Playing:
        processor_s = 0.5

        async def play(self, _: float) -> str:
            return "found"

    @contextlib.asynccontextmanager
    async def player(*_: Any) -> AsyncIterator[Playing]:
        yield Playing()

    def turns(during: float, until: float = math.inf) -> int:
        stretches = itertools.cycle([0.010, during, 0.010])

        async def watch(_: Any, __: Any, work: Any) -> Seen:
            await work
            value = next(stretches)
            return Seen(blocks=[[value * (1.0 + 0.02 * k)] * 8 for k in range(8)], seconds=1.0)

        monkeypatch.setattr(beside, "watch", watch)
        times = beside.Times(quiet_s=0.0, loud_s=1.0, rounds=(1, 3))
        seen = asyncio.run(beside._watched(ServerUnderTest(None, 1, "", 9), [], ATTACKS[0], times, until))
        assert len(seen.quiet) == 2 * len(seen.loud) and seen.found == ["found"]
        assert seen.attacker_s == 0.5 * len(seen.loud)
        return len(seen.loud)

    async def nothing(*_: Any) -> None:
        return

    for name, instead in {"player": player, "_until_rested": nothing, "SETTLE_S": 0.0, "AFTER_S": 0.0}.items():
        monkeypatch.setattr(beside, name, instead)
    assert turns(0.010) == turns(0.020) == 1
    assert turns(0.011) == 3
    assert turns(0.011, until=0.0) == 1


def test_stretches_of_time_add_up() -> None:
    first = Seen(blocks=[[0.1]], health_s=[0.01], seconds=2.0, log_bytes=10.0)
    made = Seen.together([first, Seen(blocks=[[0.2], [0.3]], memory_mb=[5.0], seconds=1.0, server_s=0.5)])
    assert made.latencies_s == [0.1, 0.2, 0.3] and made.seconds == 3.0 and made.server_s == 0.5
    assert (made.memory_mb, made.health_s, made.log_bytes) == ([5.0], [0.01], 10.0)
    assert first.blocks == [[0.1]]


def test_a_pose_that_a_later_one_overtook_was_waited_for_all_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(driver.time, "perf_counter", lambda: 10.0)
    keyframe: Any = SimpleNamespace(pose=2, still=False)
    for counts, found in ((True, [3.0, 1.0]), (False, [1.0])):
        client = LoadClient(None, None, 0.0, counts_overtaken=counts)  # type: ignore[arg-type]
        client._sent = {1: 7.0, 2: 9.0, 3: 9.5}
        client._note(keyframe)
        assert client.latencies_s == found and client._sent == {3: 9.5}


def test_files_that_do_harm_are_small() -> None:
    texture = large_texture_glb(512, 3)
    assert texture[:4] == b"glTF" and len(texture) < 20_000
    assert texture != large_texture_glb(512, 4)  # each is another scene
    assert 2_000 < len(long_name_glb(1_000)) < 5_000
    assert long_key_toml(10) == b"a.a.a.a.a.a = 1\n"


def test_an_attack_that_cannot_begin_is_no_attack_that_did_no_harm() -> None:
    server = ServerUnderTest(None, 1, "127.0.0.1", 9, None, "127.0.0.2")

    async def play(name: str) -> None:
        async with player(server, name) as playing:
            await playing.play(60.0)  # it comes last with the system

    with pytest.raises(RuntimeError, match="cannot be prepared"):
        asyncio.run(play("no such attack"))
    with pytest.raises(RuntimeError, match="broke"):
        asyncio.run(play("pictures whose clients leave"))  # nobody listens there


def test_sessions_keep_to_the_clock_whatever_holds_one_up(monkeypatch: pytest.MonkeyPatch) -> None:
    """Those that begin at different times would else fall into step."""
    now, sent = [100.0], []

    async def sleep(seconds: float) -> None:
        now[0] += max(0.0, seconds)
        if len(sent) == 6:
            raise asyncio.CancelledError

    async def send_pose(_: LoadClient, x: float) -> None:
        sent.append((round(now[0], 6), x))
        now[0] += 0.3 if len(sent) == 2 else 0.01  # one hold-up is longer than a period

    clock = SimpleNamespace(time=lambda: now[0])
    monkeypatch.setattr(driver.asyncio, "get_running_loop", lambda: clock)
    monkeypatch.setattr(driver.asyncio, "sleep", sleep)
    monkeypatch.setattr(LoadClient, "send_pose", send_pose)
    monkeypatch.setattr(LoadClient, "_read", lambda _: asyncio.Event().wait())
    welcome: Any = SimpleNamespace(scene={"diagonal": 10.0})
    client = LoadClient(None, welcome, 0.0)  # type: ignore[arg-type]
    with pytest.raises(asyncio.CancelledError):
        asyncio.run(client.look_around(reach=0.1, period_s=0.25, begin_s=0.05))
    assert [at for at, _ in sent] == pytest.approx([100.05, 100.3, 100.8, 101.05, 101.3, 101.55])
    assert [x for _, x in sent] == [1.0, -1.0] * 3


def test_the_renderer_that_is_killed_is_that_of_the_sessions(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The last one that began to be it; what else starts or computes is waited for."""
    server = ServerUnderTest(None, 1, "127.0.0.1", 9, tmp_path / "log")
    started = [
        {"message": "renderer started", "renderer": n, "pid": k} for n, k in (("0", 11), ("batch", 12), ("0", 14))
    ]
    lines = ["listening", *map(json.dumps, started), "renderer started"]
    (tmp_path / "log").write_text("\n".join(lines))
    assert server.renderer_pid() == 14 and server.renderer_pid("batch") == 12
    with pytest.raises(LoadTestError, match="no renderer 7"):
        server.renderer_pid("7")
    now, waited = {12: 3.0, 14: 50.0}, []

    async def sleep(seconds: float) -> None:
        waited.append(seconds)
        now[14] += seconds  # works for the sessions
        now[12] += 0.6 if len(waited) < 3 else 0.04
        if len(waited) == 2:
            now[15] = 0.5  # is there from now on

    monkeypatch.setattr(ServerUnderTest, "children", lambda _: [*now])
    monkeypatch.setattr(driver, "processor_s", lambda pid: (now[pid], 0.0))
    monkeypatch.setattr(beside.asyncio, "sleep", sleep)
    asyncio.run(beside._until_rested(server))
    assert waited == [beside.REST_S] * 3


@pytest.mark.skipif(sys.platform != "linux", reason="other systems do not tell")
def test_processor_time_is_that_of_the_process_and_of_its_children_that_ended() -> None:
    own, _ = processor_s(os.getpid())
    assert 0.0 < own <= sum(os.times()[:2]) + 0.05
    before = processor_s(os.getpid())[1]
    subprocess.run([sys.executable, "-c", "for k in range(4_000_000): pass"], check=True)
    assert processor_s(os.getpid())[1] > before
    assert processor_s(2**22 + 1) == (0.0, 0.0), "there is no such process"


def test_a_row_tells_whose_processor_time_it_was() -> None:
    quiet, loud = Seen(seconds=4.0, server_s=0.4, renderers_s=1.0), Seen(seconds=8.0, server_s=1.6, renderers_s=4.0)
    assert beside._cores(quiet, loud, 12.0) == "server 0.10 → 0.20, renderers 0.25 → 0.50, attacker 1.50"
