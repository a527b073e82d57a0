"""Broken connections and a killed server. This module comes last: it disturbs the other pages' streams."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from browser_stage import COMPLETE, FRAME_MS, JPEG_READY, REFINED, Relay, Service, Visit, says


def eye(visit: Visit) -> np.ndarray[Any, Any]:
    return np.array(visit.state("camera")["world_from_camera"]).reshape(4, 4)[:3, 3]


def test_a_dropped_connection_resumes_its_session(browser: Any, service: Service) -> None:
    relay = Relay(service.port)
    context = browser.new_context()
    try:
        page = Visit.begin(context, relay.url, scene="cornell_box", width=320, height=180)
        page.wait(COMPLETE)
        count = page.state("stats")["keyframes"]
        relay.cut()
        page.wait("() => window.torchrender.state === 'live' && window.torchrender.stats.connections === 2")
        asked = [url for url in page.requests if url.endswith("/v1/sessions")]
        assert len(asked) == 1, "the session is resumed, no new one is asked for"
        page.wait(f"() => window.torchrender.stats.keyframes > {count}")
    finally:
        context.close()
        relay.close()


def test_delay_does_not_slow_the_picture(browser: Any, service: Service) -> None:
    """A quarter of a second there and back: the view answers the keys in the next frames."""
    relay = Relay(service.port, 0.125)
    context = browser.new_context()
    try:
        page = Visit.begin(context, relay.url, scene="cornell_box", width=320, height=180)
        page.wait(COMPLETE)
        place, before = eye(page), page.state("stats")
        page.page.keyboard.down("KeyW")
        page.wait(f"() => window.torchrender.stats.drawn >= {before['drawn'] + 3}")
        assert np.abs(eye(page) - place).max() > 0
        page.wait("() => window.torchrender.stats.latency_ms > 250")
        page.page.keyboard.up("KeyW")
        page.wait(f"() => window.torchrender.stats.keyframes > {before['keyframes']}")
    finally:
        context.close()
        relay.close()


def test_a_killed_server_is_survived(visit: Callable[..., Visit], service: Service) -> None:
    page = visit()
    page.wait(COMPLETE)
    service.kill()
    page.wait("() => window.torchrender.state === 'waiting'")
    says(page.page, "#status", "reconnecting")
    place = eye(page)
    page.hold("KeyS", 0.3)
    assert np.abs(eye(page) - place).max() > 0, "walking goes on without a server"
    assert page.capture()[1].mean() > 0.5
    place, count = eye(page), page.state("stats")["keyframes"]
    service.start()
    page.wait(f"() => window.torchrender.state === 'live' && window.torchrender.stats.keyframes > {count}")
    assert page.state("stats")["connections"] == 2
    assert (eye(page) == place).all(), "the view stays where it was"
    page.wait(REFINED)
    assert page.capture()[1].mean() > 0.999


def test_a_page_waits_for_its_server(browser: Any, service: Service) -> None:
    """Scripts and styles were loaded, the service itself answers later."""
    context = browser.new_context()
    try:
        page = context.new_page()
        page.route("**/v1/s*", lambda route: route.abort())
        page.goto(f"{service.url}?scene=cornell_box&width=320&height=180")
        page.wait_for_function("() => document.querySelector('#status').dataset.state === 'waiting'")
        page.unroute("**/v1/s*")
        page.wait_for_function(JPEG_READY, timeout=FRAME_MS)
    finally:
        context.close()
