"""What one client may do to the others before anything is rendered: each of these once took the whole service down."""

from __future__ import annotations

import asyncio
import contextlib
import gzip
import json
import re
import socket
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from service_little import FACTS, PICTURE, LittleServer, little_server
from service_parts import FakePool
from torchrender.errors import OptionError
from torchrender_service.door import accepting, traces
from torchrender_service.door.accepting import MOST_ADDRESSES, Arrivals, listening
from torchrender_service.door.address import client_of, group_of
from torchrender_service.door.rates import Quota, Rates
from torchrender_service.errors import ServiceError
from torchrender_service.logs import Budget, JsonLines
from torchrender_service.scenes import store
from torchrender_service.settings import Settings, memory_of_host_mb, misspelt, read_settings
from torchrender_service.web.page import coding_of

OTHER = "127.0.0.2"  # an address of an attacker; this machine has all of 127/8
SMALL = {"scene": "cornell_box", "width": 64, "height": 48}
TOML = b'[[geometry]]\nshape = "box"\n'
LIMITS = {
    "header_s": 0.6,
    "body_s": 0.6,
    "idle_s": 0.6,
    "write_s": 0.6,
    "max_connections": 40,
    "max_connections_per_address": 30,
    "max_uploads_per_address": 2,
    "requests_per_s": 60,
}


@pytest.fixture(scope="module")
def little(tmp_path_factory: pytest.TempPathFactory) -> Iterator[LittleServer]:
    with little_server(tmp_path_factory.mktemp("little"), root_path="/tr", **LIMITS) as server:
        yield server


def until(true: Callable[[], bool], seconds: float = 15.0) -> bool:
    end = time.monotonic() + seconds
    while not true() and time.monotonic() < end:
        time.sleep(0.02)
    return true()


def ended(connection: socket.socket) -> bytes:
    """What the server says before it closes."""
    said = b""
    try:
        while part := connection.recv(65536):
            said += part
    except ConnectionError:
        pass
    return said


def post(path: str, length: int, kind: str = "application/toml") -> bytes:
    head = f"POST {path} HTTP/1.1\r\nhost: localhost\r\ncontent-type: {kind}\r\ncontent-length: {length}\r\n\r\n"
    return head.encode()


def test_an_address_opens_so_many_connections_a_second() -> None:
    refused: list[int] = []
    arrivals = Arrivals(Settings(connections_per_s=10, trusted_proxies=("10.0.0.9",)), lambda: refused.append(1))
    assert [arrivals.let_in(OTHER, 5.0) for _ in range(22)] == [True] * 20 + [False] * 2
    assert len(refused) == 2
    assert arrivals.let_in("127.0.0.1", 5.0)
    assert all(arrivals.let_in("10.0.0.9", 5.0) for _ in range(100))
    assert [arrivals.let_in(OTHER, 5.25) for _ in range(3)] == [True, True, False]
    assert [arrivals.let_in(OTHER, 99.0) for _ in range(22)] == [True] * 20 + [False] * 2
    for number in range(2 * MOST_ADDRESSES):  # who comes from everywhere fills no memory
        arrivals.let_in(f"198.51.{number // 250}.{number % 250}", 100.0)
    assert len(arrivals._left) <= MOST_ADDRESSES


def test_new_connections_leave_turns_to_others(monkeypatch: pytest.MonkeyPatch) -> None:
    now = [50.0]

    def clock() -> float:
        now[0] += 0.3 * accepting.TURN_S
        return now[0]

    (one,) = listening("127.0.0.1", 0, Arrivals(Settings(connections_per_s=3)))
    with one:
        one.listen(16)
        visitors = [socket.create_connection(one.getsockname(), source_address=(OTHER, 0)) for _ in range(9)]
        honest = socket.create_connection(one.getsockname())
        monkeypatch.setattr(accepting.time, "monotonic", clock)
        turns, accepted = 0, []
        while "127.0.0.1" not in accepted:
            turns += 1
            with pytest.raises(BlockingIOError):
                while True:
                    connection, peer = one.accept()
                    accepted.append(peer[0])
                    connection.close()
        assert accepted == [OTHER] * 6 + ["127.0.0.1"], "nobody is lost between two turns"
        assert turns >= 3
        for visitor in (*visitors, honest):
            visitor.close()


def test_few_are_let_in_before_others_have_a_turn(monkeypatch: pytest.MonkeyPatch) -> None:
    """However many wait, and however quick it is; the next turn goes on with them."""
    monkeypatch.setattr(accepting, "TURN_S", 60.0)
    (one,) = listening("127.0.0.1", 0, Arrivals(Settings(connections_per_s=1000)))
    one.listen(16)
    waiting = [socket.create_connection(one.getsockname()) for _ in range(3 * accepting.AT_ONCE - 1)]
    turns = []
    with one, contextlib.ExitStack() as stack:
        for _ in range(4):
            turns.append(0)
            with contextlib.suppress(BlockingIOError):
                while True:
                    stack.enter_context(one.accept()[0])
                    turns[-1] += 1
    for client in waiting:
        client.close()
    assert turns == [accepting.AT_ONCE, accepting.AT_ONCE, accepting.AT_ONCE - 1, 0]


def test_what_is_refused_is_closed_before_anybody_looks_at_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(accepting, "TOLD_PER_S", 2)
    monkeypatch.setattr(accepting.time, "monotonic", lambda: 50.0)
    (one,) = listening("127.0.0.1", 0, Arrivals(Settings(connections_per_s=1)))
    with one:
        one.listen(16)
        with pytest.raises(BlockingIOError):
            one.accept()
        visitors = [socket.create_connection(one.getsockname(), source_address=(OTHER, 0)) for _ in range(5)]
        honest = socket.create_connection(one.getsockname())
        for visitor in visitors[2:4]:
            visitor.sendall(b"GET / HTTP/1.1\r\nhost: localhost\r\n\r\n")
        accepted = []
        for _ in range(3):
            connection, peer = one.accept()
            accepted.append(peer[0])
            connection.close()
        assert accepted == [OTHER, OTHER, "127.0.0.1"]
        with pytest.raises(BlockingIOError):
            one.accept()
        for visitor in visitors[2:4]:  # told why, and the connection ends in order
            visitor.settimeout(5.0)
            said = b""
            while part := visitor.recv(65536):
                said += part
            head, _, body = said.partition(b"\r\n\r\n")
            assert head.startswith(b"HTTP/1.1 429 ") and b"connection: close" in head and b"retry-after: 1" in head
            assert json.loads(body)["type"].endswith(":connections-a-second")
        visitors[4].settimeout(5.0)
        with pytest.raises(ConnectionResetError):
            visitors[4].recv(1)
        for visitor in (*visitors, honest):
            visitor.close()


HEAD = b"GET /health HTTP/1.1\r\nhost: localhost\r\n"


@pytest.mark.parametrize(
    ("request_", "status"),
    [
        (b"BREW /pot HTTP/1.1\r\nhost: localhost\r\n\r\n", 400),
        (b"GET / HTTP/9.9\r\nhost: localhost\r\n\r\n", 400),
        (HEAD + b"content-length: -5\r\n\r\n", 400),
        (HEAD + b"content-length: 99999999999999999999\r\n\r\n", 400),
        (HEAD + b"content-length: 5\r\ntransfer-encoding: chunked\r\n\r\n0\r\n\r\n", 400),
        (b"\x16\x03\x01\x02\x00", 400),
        (b"GET /" + 100_000 * b"a" + b" HTTP/1.1\r\nhost: localhost\r\n\r\n", 414),
        (b"GET /" + 300_000 * b"a", 414),
        (HEAD + b"x-a: " + 200_000 * b"a" + b"\r\n\r\n", 431),
        (HEAD + b"x-a: " + 700_000 * b"a", 431),
        (HEAD + b"".join(b"x-%d: %s\r\n" % (k, 1000 * b"a") for k in range(200)) + b"\r\n", 431),
    ],
)
def test_what_is_no_http_is_told_so_in_a_problem_document(little: LittleServer, request_: bytes, status: int) -> None:
    with little.connect() as one:
        one.settimeout(10.0)
        one.sendall(request_)
        head, _, body = ended(one).partition(b"\r\n\r\n")
    assert head.startswith(b"HTTP/1.1 %d " % status) and b"content-type: application/problem+json" in head
    assert json.loads(body)["status"] == status
    assert until(lambda: little.state.connections.of("127.0.0.1") == 0)


def test_headers_may_be_large_and_each_request_has_its_own(little: LittleServer) -> None:
    with little.connect() as one:
        one.settimeout(10.0)
        for _ in range(4):
            one.sendall(HEAD + b"x-a: " + 40_000 * b"a" + b"\r\n\r\n")
            said = b""
            while b"version" not in said:
                said += one.recv(65536)
            assert b" 200 " in said


def test_a_connection_too_many_is_told_so(tmp_path: Path) -> None:
    with little_server(tmp_path, max_connections_per_address=2) as server:
        busy = [server.connect(OTHER) for _ in range(2)]
        for one in busy:
            one.sendall(post("/v1/reproject", 50, "application/json"))
        assert until(lambda: len(server.state.connections._busy.get(OTHER, ())) == 2)
        with server.connect(OTHER) as one:
            said = ended(one)
        assert said.startswith(b"HTTP/1.1 429 ") and b"application/problem+json" in said
        for one in busy:
            one.close()


def test_half_sent_headers_are_ended_and_keep_nobody_out(little: LittleServer) -> None:
    attackers = [little.connect(OTHER) for _ in range(60)]
    for one in attackers:
        one.sendall(b"GET /health HTTP/1.1\r\nhost: loc")
    assert until(lambda: little.state.connections.of(OTHER) <= LIMITS["max_connections_per_address"])
    assert little.ask("GET", "/health").status == 200
    said = [ended(one) for one in attackers]
    for one in attackers:
        one.close()
    assert sum(b" 408 " in one for one in said) >= 20, "those that were let in are told why they are ended"
    assert until(lambda: little.state.connections.of(OTHER) == 0)


def test_many_addresses_do_not_lock_others_out(little: LittleServer) -> None:
    attackers = [little.connect(f"127.0.1.{k}") for k in range(60)]
    assert until(lambda: len(little.state.connections) <= LIMITS["max_connections"])
    assert little.ask("GET", "/health").status == 200
    for one in attackers:
        one.close()


def test_a_body_that_drips_is_ended(little: LittleServer) -> None:
    with little.connect() as one:
        one.sendall(post("/v1/scenes", 1000) + b"n")
        begin = time.monotonic()
        said = ended(one)
        assert b" 408 " in said and b"application/problem+json" in said
        assert time.monotonic() - begin < 10.0


def test_an_idle_connection_is_ended(little: LittleServer) -> None:
    before = little.counted("connections_ended", reason="idle")
    with little.connect() as one:
        one.sendall(b"GET /health HTTP/1.1\r\nhost: localhost\r\n\r\n")
        assert b'"status":"ok"' in ended(one)
    assert little.counted("connections_ended", reason="idle") == before + 1


def test_an_answer_that_nobody_reads_is_ended(little: LittleServer) -> None:
    before = little.counted("connections_ended", reason="answer")
    with little.connect(room=4096) as one:
        body = json.dumps(SMALL).encode()
        one.sendall(post("/v1/render", len(body), "application/json") + body)
        assert until(lambda: little.counted("connections_ended", reason="answer") == before + 1)
        assert len(ended(one)) < len(PICTURE)
    assert len(little.ask("POST", "/v1/render", SMALL).body) == len(PICTURE), "whoever reads gets all of it"


def test_slow_uploads_lock_out_nobody_but_their_own_address(little: LittleServer) -> None:
    slow = [little.connect(OTHER) for _ in range(10)]
    for one in slow:
        one.sendall(post("/v1/scenes", len(TOML)) + TOML[:4])
    assert until(lambda: little.counted("rejected", kind="busy") >= 8)
    assert little.ask("POST", "/v1/scenes", TOML, content_type="application/toml").status in (200, 201)
    for one in slow:
        one.close()


def test_an_address_that_asks_too_often_is_told_to_wait(tmp_path: Path) -> None:
    rates = Rates(read_settings(None, {}, requests_per_s=5, data_dir=str(tmp_path)))
    with pytest.raises(ServiceError) as caught:
        for _ in range(11):  # a second may end in between
            rates.check("10.0.0.1")
    assert caught.value.status == 429 and caught.value.retry_after_s is not None
    rates.check("10.0.0.2")


def test_attempts_to_open_a_stream_count_too(tmp_path: Path) -> None:
    with little_server(tmp_path, requests_per_s=1) as server:
        head = (
            "GET /v1/stream HTTP/1.1\r\nhost: localhost\r\nupgrade: websocket\r\nconnection: upgrade\r\n"
            "sec-websocket-version: 13\r\nsec-websocket-key: dGhlIHNhbXBsZSBub25jZQ==\r\n\r\n"
        )
        for _ in range(50):
            with server.connect() as other:
                other.sendall(head.encode())
                said = other.recv(4096)
            if b" 429 " in said:
                break
        assert b" 429 " in said


def test_work_for_a_client_that_left_is_given_up(little: LittleServer) -> None:
    little.pool.waits = True
    try:
        with little.connect() as one:
            body = json.dumps(SMALL).encode()
            one.sendall(post("/v1/render", len(body), "application/json") + body)
            assert little.pool.begun.wait(10.0)
        assert little.pool.given_up.wait(10.0)
        assert little.pool.asked[-1] is not None and little.pool.asked[-1].client == "127.0.0.1"
    finally:
        little.pool.waits = False


def test_a_large_body_does_not_hold_the_others_up(little: LittleServer) -> None:
    answer = little.ask("POST", "/v1/reproject", post("/", 2**27), content_type="application/json")
    assert answer.status == 422
    with little.connect() as one:
        one.sendall(post("/v1/reproject", 2**26, "application/json"))
        assert b" 413 " in ended(one), "JSON of 64 MB is refused by its length"
    answer = little.ask("POST", "/v1/keyframes", b"TRDI", content_type="application/vnd.torchrender.keyframes")
    assert answer.status == 422 and "message" in answer.json()["detail"]


def test_a_body_that_was_refused_is_not_read_for_ever(little: LittleServer) -> None:
    """Who sends 84 MB again and again had the server look through all of it each time."""
    piece, most = bytes(2**18), 2**28
    with little.connect(OTHER) as connection:
        connection.settimeout(0.3)
        connection.sendall(post("/v1/render", most, "application/json"))
        sent = 0
        with contextlib.suppress(OSError):  # nobody takes it, or the connection is gone
            while sent < most:
                sent += connection.send(piece)
        connection.settimeout(15.0)
        assert sent < most // 4
        assert b"413" in ended(connection).partition(b"\r\n")[0]
    with little.connect(OTHER) as connection:
        connection.settimeout(15.0)
        connection.sendall(post("/v1/render", 2**21, "application/json") + bytes(2**21) + b"GET /health HTTP/1.1\r\n")
        connection.sendall(b"host: localhost\r\nconnection: close\r\n\r\n")
        said = ended(connection)
        assert b"HTTP/1.1 413" in said and b"HTTP/1.1 200" in said, "one that is a little too large costs no connection"


def test_pages_of_other_sites_cannot_ask(little: LittleServer) -> None:
    plan = "/v1/plan?scene=cornell_box&width=64&height=48"
    assert little.ask("GET", plan, origin="http://evil.example").status == 403
    for site in ("cross-site", "same-site", "Same-Site"):
        assert little.ask("GET", plan, sec_fetch_site=site).status == 403
    assert little.ask("GET", plan, origin=little.url, sec_fetch_site="same-origin").status == 200
    headers = little.ask("GET", "/").headers
    assert headers["x-frame-options"] == "DENY" and f"ws://{little.address} " in headers["content-security-policy"]
    assert "connect-src 'self' data: " in headers["content-security-policy"], "the decoder fetches its own code"
    assert " ws: " not in headers["content-security-policy"]


@pytest.mark.parametrize(
    ("method", "path", "body", "named"),
    [
        ("GET", "/v1/plan?scene=cornell_box&foo=1", b"", "query.foo"),
        ("GET", "/v1/plan?scene=cornell_box&scene=nest", b"", "query.scene"),
        ("GET", "/v1/scenes?nmae=a", b"", "query.nmae"),
        ("GET", "/v1/scenes/cornell_box?x", b"", "query.x"),
        ("GET", "/v1/scenes/cornell_box?x=", b"", "query.x"),
        ("DELETE", "/v1/scenes/cornell_box?force=1", b"", "query.force"),
        ("POST", "/v1/render?scene=nest", json.dumps(SMALL).encode(), "query.scene"),
        ("POST", "/v1/style?scene=nest&seed=1&seed=2", b"", "query.seed"),
        ("POST", "/v1/style?scene=nest&sed=1", b"", "query.sed"),
        ("POST", "/v1/render", b'{"scene": "nest", "width": 8, "height": 8, "width": 9}', "body.width"),
        ("POST", "/v1/sessions", b'{"scene": "nest", "camera": {"name": "a", "name": "a"}}', "body.name"),
    ],
)
def test_what_would_be_passed_over_is_named(
    little: LittleServer, method: str, path: str, body: bytes, named: str
) -> None:
    answer = little.ask(method, path, body or None, content_type="application/json")
    assert answer.status == 422 and answer.headers["content-type"] == "application/problem+json"
    assert answer.json()["type"].endswith(":invalid-value") and answer.json()["detail"].startswith(named + ":")


def test_words_that_may_come_several_times_still_may(little: LittleServer) -> None:
    answer = little.ask("POST", "/v1/style?scene=cornell_box&lock=a&lock=b", b"", content_type="text/plain")
    assert answer.status == 415


def test_bodies_come_as_they_are(little: LittleServer) -> None:
    packed = gzip.compress(TOML)
    answer = little.ask("POST", "/v1/scenes", packed, content_type="application/toml", content_encoding="gzip")
    assert answer.status == 415 and "gzip" in answer.json()["detail"]
    same = little.ask("POST", "/v1/scenes", TOML, content_type="application/toml", content_encoding="identity")
    assert same.status in (200, 201)


def test_every_answer_has_a_request_id(little: LittleServer) -> None:
    assert little.ask("GET", "/health", x_request_id="mine-1").headers["x-request-id"] == "mine-1"
    assert re.fullmatch("[0-9a-f]{16}", little.ask("GET", "/health", x_request_id="a b").headers["x-request-id"])


def test_requests_and_their_jobs_are_traced(little: LittleServer, monkeypatch: pytest.MonkeyPatch) -> None:
    spans: list[tuple[str, dict[str, str]]] = []

    class Tracer:
        @contextmanager
        def start_as_current_span(self, name: str, attributes: dict[str, str]) -> Iterator[None]:
            spans.append((name, attributes))
            yield

    monkeypatch.setattr(traces, "TRACER", Tracer())
    little.ask("GET", "/v1/plan?scene=cornell_box&width=8&height=8", x_request_id="abc")
    assert spans == [("GET", {"request": "abc", "path": "/v1/plan"}), ("Plan", {"class": "interactive"})]
    monkeypatch.setattr(traces, "TRACER", None)
    assert little.ask("GET", "/health").status == 200


def test_the_service_works_below_a_path(little: LittleServer) -> None:
    for path in ("/tr/v1/scenes", "/v1/scenes", "/tr/", "/tr/bundle/page.js"):
        assert little.ask("GET", path).status == 200, path
    made = little.ask("POST", "/tr/v1/scenes", TOML + b"\n", content_type="application/toml")
    assert made.headers["location"] == f"/tr/v1/scenes/{made.json()['id']}"
    assert little.ask("GET", made.headers["location"]).status == 200
    assert little.ask("GET", "/v1/openapi.json").json()["servers"] == [{"url": "/tr"}]


def test_scenes_come_in_parts_and_are_not_sent_twice(little: LittleServer) -> None:
    little.ask("POST", "/v1/scenes", TOML + b"\n\n", content_type="application/toml")
    whole = little.ask("GET", "/v1/scenes")
    found, following = [], "v1/scenes?limit=1"
    while following:
        part = little.ask("GET", "/" + following).json()
        found += part["scenes"]
        following = part["next"]
    assert found == whole.json()["scenes"] and len(found) > 1
    assert little.ask("GET", "/v1/scenes", if_none_match=whole.headers["etag"]).status == 304
    little.ask("POST", "/v1/scenes", TOML + b"\n\n\n", content_type="application/toml")
    assert little.ask("GET", "/v1/scenes", if_none_match=whole.headers["etag"]).status == 200


def test_the_page_is_small_and_comes_in_few_requests(little: LittleServer) -> None:
    html = gzip.decompress(little.ask("GET", "/", accept_encoding="gzip").body).decode()
    files = ["/", *re.findall(r'(?:src|href)="((?:bundle|css)/[^"]+|icon.svg)"', html), "bundle/decode-worker.js"]
    sizes = {}
    for name in dict.fromkeys(files):
        answer = little.ask("GET", "/" + name.lstrip("/"), accept_encoding="gzip, deflate, br")
        assert answer.status == 200 and answer.headers["content-encoding"] == "gzip", name
        again = little.ask("GET", "/" + name.lstrip("/"), accept_encoding="gzip", if_none_match=answer.headers["etag"])
        assert again.status == 304 and not again.body
        sizes[name] = len(answer.body)
    assert sum(sizes.values()) <= 300_000, sizes
    assert len(sizes) + 3 <= 15  # scenes, session, stream


def test_the_bundles_are_made_from_the_sources_that_are_here() -> None:
    """After a change of static/js: make page."""
    folder = Path(__file__).parents[2] / "service"
    code: dict[str, Any] = {"__file__": str(folder / "note_page_sources.py"), "__name__": "note"}
    exec((folder / "note_page_sources.py").read_text(), code)
    assert json.loads(code["NOTE"].read_text()) == code["sources"]()


def test_a_full_disk_is_a_problem_document(little: LittleServer, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(store, "finish", full)
    answer = little.ask("POST", "/v1/scenes", TOML + b"#", content_type="application/toml")
    assert answer.status == 507 and answer.json()["type"].endswith(":disk-full")


def test_a_server_that_stops_answers_all_who_ask(tmp_path: Path) -> None:
    answers: list[Any] = []
    with little_server(tmp_path, shutdown_s=3.5) as server:
        server.pool.waits = True
        askers = [threading.Thread(target=lambda: answers.append(server.ask("POST", "/v1/render", SMALL)))]
        askers[0].start()
        assert server.pool.begun.wait(10.0)
        server.state.bodies.stopping = True
        late = server.ask("POST", "/v1/render", SMALL)
        assert late.status == 503 and "retry-after" in late.headers and late.json()["status"] == 503
        assert server.ask("GET", "/health").status == 200
        server.state.bodies.stopping = False
        server.server.should_exit = True
        askers[0].join(20.0)
    assert [(a.status, a.headers["content-type"]) for a in answers] == [(503, "application/problem+json")]


def test_addresses_that_limits_count_for() -> None:
    assert group_of("2001:db8:1:2:3:4:5:6") == group_of("2001:db8:1:2::9") != group_of("2001:db8:1:3::9")
    assert group_of("::ffff:10.0.0.1") == "10.0.0.1" and group_of("nonsense") == "unknown"
    scope = {"type": "http", "client": ("10.0.0.1", 5), "headers": [(b"x-forwarded-for", b"6.6.6.6, 9.9.9.9")]}
    assert client_of(scope, ()) == "10.0.0.1", "whoever is no proxy says nothing about others"
    assert client_of(scope, ("10.0.0.1",)) == "9.9.9.9"


def test_a_quota_is_of_one_address_and_of_all() -> None:
    quota = Quota("uploads", 2, 1)
    with quota.take("a"), pytest.raises(ServiceError) as own, quota.take("a"):
        pass
    assert own.value.status == 429
    with quota.take("a"), quota.take("b"), pytest.raises(ServiceError) as all_of_them, quota.take("c"):
        pass
    assert all_of_them.value.status == 503 and len(quota) == 0


def test_two_servers_do_not_share_a_folder(tmp_path: Path) -> None:
    def scenes(folder: Path) -> store.SceneStore:
        return store.SceneStore(read_settings(None, {}, data_dir=str(folder)), FakePool())

    with (
        scenes(tmp_path).own_folder(),
        pytest.raises(OptionError, match="another server"),
        scenes(tmp_path).own_folder(),
    ):
        pass
    with scenes(tmp_path).own_folder():
        pass
    (tmp_path / "file").write_text("")
    unusable = scenes(tmp_path / "file" / "data").own_folder()
    with pytest.raises(OptionError, match=r"data_dir .*file/data cannot be used: Not a directory"), unusable:
        pass


def test_variables_that_are_no_settings_are_named() -> None:
    said = misspelt({"TORCHRENDER_MAX_SESIONS": "3", "TORCHRENDER_PORT": "1", "TORCHRENDER_X_PORT": "tcp://1", "A": ""})
    assert said == ["TORCHRENDER_MAX_SESIONS is no setting and changes nothing; did you mean TORCHRENDER_MAX_SESSIONS?"]


def test_renderers_share_the_memory_of_the_host() -> None:
    settings = Settings(renderers=3)
    assert 512 <= settings.memory_mb <= memory_of_host_mb()
    assert Settings(renderers=1).memory_mb >= settings.memory_mb and Settings(renderer_memory_mb=700).memory_mb == 700


def test_names_that_an_earlier_server_kept_whole_are_shown_cut(tmp_path: Path) -> None:
    home = tmp_path / "scenes" / ("a" * 64)
    home.mkdir(parents=True)
    (home / "scene.toml").write_bytes(TOML)
    facts = {**FACTS, "id": home.name, "kind": "toml", "bytes": len(TOML), "built_in": False}
    (home / "facts.json").write_text(json.dumps({**facts, "name": "n" * 3_000_000, "cameras": ["c" * 999] * 99}))
    scenes = store.SceneStore(read_settings(None, {}, data_dir=str(tmp_path)), FakePool())
    scenes.open()
    found = asyncio.run(scenes.facts(home.name))
    assert len(found["name"]) == 80 and len(found["cameras"]) == 64 and len(found["cameras"][0]) == 80


@pytest.mark.parametrize(
    ("accepted", "coding"),
    [("gzip, zstd", "zstd"), ("gzip", "gzip"), ("gzip;q=0, zstd; q=0", None), ("", None), ("br", None)],
)
def test_the_coding_that_a_browser_takes(accepted: str, coding: str | None) -> None:
    assert coding_of(accepted) == coding


def test_a_flood_of_log_records_stays_small(tmp_path: Path) -> None:
    import logging

    with (tmp_path / "log").open("w") as file:
        budget = Budget(file, bytes_per_s=1000.0, burst=2000.0)
        budget.setFormatter(JsonLines())
        record = logging.LogRecord("a", logging.WARNING, "f", 1, "the same thing again and again", None, None)
        for _ in range(1000):
            budget.emit(record)
        budget._room = 500.0
        budget.emit(record)
    lines = (tmp_path / "log").read_text().splitlines()
    assert 5 < len(lines) < 30 and "records were left out" in lines[-2]
