"""The ledger of sessions: tickets work once, wherever; what is lost comes back; no clock but its own counts."""

from __future__ import annotations

import msgspec
import pytest

from service_parts import make_record
from torchrender_service.errors import ServiceError
from torchrender_service.streams.ledger import IDS, LOST_S, Beat, SessionLedger


class Clock:
    """Goes when it is told to."""

    now = 1000.0

    def __call__(self) -> float:
        return self.now


def make(clock: Clock | None = None, **limits: float) -> SessionLedger:
    given = {"max_sessions": 8, "max_per_address": 8, "ticket_s": 20.0, "resume_s": 30.0, **limits}
    return SessionLedger(now=clock or Clock(), **given)  # type: ignore[arg-type]


def test_tickets_work_once() -> None:
    ledger = make()
    first = ledger.add(make_record("a"))
    assert ledger.redeem(first, "here").id == "a"
    for bad in (first, "", "nonsense"):
        with pytest.raises(ServiceError, match="unknown, used or expired") as caught:
            ledger.redeem(bad, "there")
        assert caught.value.status == 403
    second, third = ledger.renew("a", "here"), ledger.renew("a", "here")
    with pytest.raises(ServiceError):
        ledger.redeem(second, "here")  # a newer one was given out
    assert ledger.redeem(third, "here").id == "a"
    for name, replica in (("a", "there"), ("b", "here")):
        with pytest.raises(ServiceError, match="over"):
            ledger.renew(name, replica)


def test_sessions_are_limited_and_expire() -> None:
    clock = Clock()
    ledger = make(clock, max_sessions=3, max_per_address=2)
    ticket = ledger.add(make_record("a"))
    ledger.add(make_record("b"))
    for attempt in (lambda: ledger.check_room("unknown"), lambda: ledger.add(make_record("c"))):
        with pytest.raises(ServiceError, match="address has 2 sessions") as caught:
            attempt()
        assert caught.value.status == 429 and caught.value.retry_after_s == 20.0
    ledger.add(make_record("c", client="another"))
    clock.now += 5.0
    with pytest.raises(ServiceError, match="there are 3 sessions") as caught:
        ledger.add(make_record("d", client="a third"))
    assert caught.value.retry_after_s == 15.0
    clock.now += 16.0
    with pytest.raises(ServiceError, match="expired"):
        ledger.redeem(ticket, "here")
    assert len(ledger) == 0


def test_a_stream_lasts_while_its_replica_is_heard_and_its_session_for_a_while_after() -> None:
    clock = Clock()
    ledger = make(clock)
    ledger.redeem(ledger.add(make_record("a")), "here")
    for _ in range(100):
        clock.now += 1.0
        assert ledger.beat(Beat(replica="here", connected=("a",))).gone == ()
    resume = ledger.renew("a", "here")
    clock.now += LOST_S + 0.1  # killed, or hanging: nobody says goodbye
    moved = ledger.redeem(resume, "there")
    assert moved.next_id == IDS
    assert ledger.beat(Beat(replica="here", connected=("a",))).gone == ("a",)
    assert ledger.beat(Beat(replica="there", connected=("a",))).gone == ()
    clock.now += 33.1  # of LOST_S and what a session waits
    assert ledger.beat(Beat(replica="there", connected=(), waiting=("a",))).gone == ("a",)
    assert len(ledger) == 0


def test_a_replica_that_only_paused_keeps_its_streams() -> None:
    clock = Clock()
    ledger = make(clock)
    ledger.redeem(ledger.add(make_record("a")), "here")
    clock.now += 10.0
    ledger.expire()
    for _ in range(2):
        assert ledger.beat(Beat(replica="here", connected=("a",))).gone == ()
        clock.now += 29.0
    ledger.expire()
    assert len(ledger) == 1


def test_what_a_client_has_set_is_there_after_a_crash() -> None:
    ledger = make()
    record = ledger.redeem(ledger.add(make_record("a")), "here")
    resume = ledger.renew("a", "here")
    changed = msgspec.structs.replace(record, exposure=1.5, settings=4)
    ledger.beat(Beat(replica="here", connected=("a",), changed=(changed,)))
    ledger.beat(Beat(replica="elsewhere", connected=(), changed=(record,)))  # it has no say
    moved = ledger.redeem(resume, "there")
    assert (moved.exposure, moved.settings) == (1.5, 4)
    ledger.release(record, "here")  # late: no longer its own
    ledger.expire()
    assert ledger.beat(Beat(replica="there", connected=("a",))).gone == ()


def test_replicas_hear_once_of_scenes_that_were_deleted() -> None:
    ledger = make()
    waiting = ledger.add(make_record("a", scene="old"))
    ledger.redeem(ledger.add(make_record("b", scene="old")), "here")
    ledger.delete_scene("old")
    with pytest.raises(ServiceError, match="expired"):
        ledger.redeem(waiting, "here")
    told = ledger.beat(Beat(replica="here", connected=("b",)))
    assert told.deleted == ("old",) and told.gone == ()
    assert ledger.beat(Beat(replica="here", connected=("b",), news=told.news)).deleted == ()
    ledger.end("b")
    assert len(ledger) == 0


def test_a_ledger_that_was_lost_takes_what_replicas_know() -> None:
    old, new = make(), make()
    assert old.epoch != new.epoch
    record = old.redeem(old.add(make_record("a")), "here")
    resume = old.renew("a", "here")
    new.restore(record, resume, "here", True)
    new.restore(record, "another", "there", False)  # who came first
    assert new.beat(Beat(replica="here", connected=("a",))).gone == ()
    assert new.redeem(resume, "there").id == "a"
