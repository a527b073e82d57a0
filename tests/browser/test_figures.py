"""Figures of the page belong to the picture that is shown; names of scenes are text."""

from __future__ import annotations

import urllib.parse
import urllib.request
from collections.abc import Callable

from browser_stage import ARRIVED, COMPLETE, Service, Visit, says

NASTY = "<img src=x onerror=\"document.title='broken'\">"


def test_holes_are_those_of_the_picture_that_stands(visit: Callable[..., Visit], service: Service) -> None:
    page = visit(layers=0, overscan=1)
    page.wait(COMPLETE)
    with service.held():
        page.hold("ArrowRight", 1.0)
        page.rest()
        _, covered = page.capture()
        empty = 1.0 - covered.mean()
        assert empty > 0.02, "the view has left what the picture holds"
        page.wait(f"() => Math.abs(window.torchrender.stats.holes - {empty}) < 0.01")
    page.page.keyboard.press("Home")
    page.wait(ARRIVED)
    page.wait("() => window.torchrender.stats.holes < 0.005")


def test_nothing_is_current_before_there_is_a_picture(visit: Callable[..., Visit], service: Service) -> None:
    page = visit()
    page.wait(COMPLETE)
    says(page.page, "#brief", "filled")
    with service.held():
        page.page.locator("#scene").select_option("living_room")
        says(page.page, "#brief", "no picture of this scene yet")
        assert page.state("stats")["holes"] is None and not page.state("stats")["shown"]
    page.wait("() => window.torchrender.scene === 'living_room' && window.torchrender.keyframes.length > 0")
    says(page.page, "#brief", "filled")


def test_names_of_scenes_are_text(visit: Callable[..., Visit], service: Service) -> None:
    body = b'name = "box"\n[[geometry]]\nshape = "box"\nsize = 1.0\n'
    address = f"{service.url}v1/scenes?name={urllib.parse.quote(NASTY)}"
    asked = urllib.request.Request(address, body, {"content-type": "application/toml"})
    with urllib.request.urlopen(asked) as answer:
        place = answer.headers["location"]
    try:
        page = visit(scene=place.rpartition("/")[2])
        page.wait(COMPLETE)
        page.page.wait_for_function("() => document.querySelectorAll('#scene option').length === 3")
        assert NASTY in page.page.locator("#scene option").all_inner_texts()
        page.page.locator("#toggle").click()
        assert page.page.locator("img[src='x']").count() == 0
        assert page.page.title() != "broken" and not page.problems
    finally:
        urllib.request.urlopen(urllib.request.Request(f"{service.url.rstrip('/')}{place}", method="DELETE"))
