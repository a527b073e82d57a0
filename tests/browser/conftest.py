"""Chromium and the server, once for all tests of this folder.

Where one of them is missing the tests are skipped, with ``CI`` or ``TORCHRENDER_REQUIRE_BROWSER=1`` they fail.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from typing import Any

import pytest

from browser_stage import FLAGS, REFINED, Service, Visit, find_chromium

SIZE = {"width": 320, "height": 180}


def unavailable(why: str) -> None:
    if os.environ.get("CI") or os.environ.get("TORCHRENDER_REQUIRE_BROWSER") == "1":
        pytest.fail(f"the browser tests must run here: {why}")
    pytest.skip(why)


@pytest.fixture(scope="package")
def browser() -> Iterator[Any]:
    try:
        from playwright.sync_api import sync_playwright
    except ImportError:
        unavailable("playwright is not installed (pip install 'torchrender[test]')")
    path = find_chromium()
    if path is None:
        unavailable("no Chromium found: install Debian's chromium or set TORCHRENDER_CHROMIUM")
    with sync_playwright() as playwright:
        chromium = playwright.chromium.launch(executable_path=path, args=list(FLAGS))
        yield chromium
        chromium.close()


@pytest.fixture(scope="package")
def service(browser: Any) -> Iterator[Service]:
    del browser  # without one there is nothing to serve
    server = Service(batch_niceness=2)  # the tests that run beside these leave nothing over
    server.start()
    yield server
    server.stop()


@pytest.fixture(scope="package")
def room(browser: Any, service: Service) -> Iterator[Visit]:
    """The living room at rest, with two extra layers. Tests must leave the view as it is."""
    context = browser.new_context(viewport=SIZE)
    visit = Visit.begin(context, service.url, scene="living_room", layers=2, overscan=1.2, **SIZE)
    visit.wait(REFINED)
    yield visit
    context.close()


@pytest.fixture(scope="package")
def violations() -> Callable[[Any], list[str]]:
    """What axe-core finds on a page against WCAG 2.2 AA and good practice: rule, weight and elements."""
    try:
        from axe_playwright_python.sync_playwright import Axe
    except ImportError:
        unavailable("axe-playwright-python is not installed (pip install 'torchrender[test]')")
    rules = ("wcag2a", "wcag2aa", "wcag21a", "wcag21aa", "wcag22aa", "best-practice")
    options = {"resultTypes": ["violations"], "runOnly": {"type": "tag", "values": rules}}

    def found(page: Any) -> list[str]:
        broken = Axe().run(page, options=options).response["violations"]
        return [f"{rule['id']} ({rule['impact']}): {[node['html'][:120] for node in rule['nodes']]}" for rule in broken]

    return found


@pytest.fixture
def visit(browser: Any, service: Service) -> Iterator[Callable[..., Visit]]:
    """Opens pages, by default on the small box at the test size."""
    contexts = []

    def begin(*, scene: str = "cornell_box", context: dict[str, Any] | None = None, **query: Any) -> Visit:
        made = browser.new_context(**{"viewport": SIZE} | (context or {}))
        contexts.append(made)
        return Visit.begin(made, service.url, **{"scene": scene, "layers": 1, **SIZE, **query})

    yield begin
    for made in contexts:
        made.close()
