"""The page and views of programs below a path of another server, as in a notebook behind jupyter-server-proxy."""

from __future__ import annotations

import urllib.parse
from typing import Any

import numpy as np

import torchrender as tr
from browser_stage import REFINED, Service, Visit
from path_proxy import PathProxy

SIZE = {"width": 240, "height": 160}


def all_below(visit: Visit, proxy: PathProxy) -> bool:
    """Whatever the page asked for, streams too, lies below the prefix."""
    paths = [urllib.parse.urlsplit(address).path for address in visit.requests if not address.startswith("blob:")]
    return bool(paths) and all(path.startswith(proxy.prefix + "/") for path in paths)


def test_the_page_of_a_service_runs_below_a_path(browser: Any, service: Service) -> None:
    context = browser.new_context(viewport={"width": 900, "height": 500})
    with PathProxy("/user/ann/proxy/8000", service.port) as proxy:
        visit = Visit.begin(context, proxy.url, scene="cornell_box", layers=1, **SIZE)
        visit.wait(REFINED)
        assert visit.capture()[1].mean() > 0.99
        before = visit.keyframe_count
        visit.hold("d")
        visit.wait("() => window.torchrender.keyframes[0].samples > 1")
        assert visit.keyframe_count > before, "the stream goes on"
        assert any(path.startswith(proxy.prefix + "/v1/stream") for path in proxy.asked)
        assert all_below(visit, proxy) and not visit.problems
    context.close()


def test_a_view_of_a_program_in_a_frame_of_a_notebook(browser: Any) -> None:
    scene = tr.Scene(meshes=[tr.Mesh.sphere(0.5, (0.0, 0.5, 0.0), name="ball")], name="framed")
    context = browser.new_context(viewport={"width": 700, "height": 560})
    with tr.show(scene, browser=False) as view:
        port = urllib.parse.urlsplit(view.url).port
        assert port is not None
        with PathProxy(f"/user/ann/proxy/{port}", port) as proxy:
            view._prefix = proxy.url
            page = context.new_page()
            notebook = f"http://127.0.0.1:{proxy.port}/lab"
            page.route(notebook, lambda route: route.fulfill(content_type="text/html", body=view._repr_html_()))
            page.goto(notebook)
            view.wait(60.0)
            frame = next(f for f in page.frames if f.url.startswith(proxy.url))
            frame.wait_for_function(REFINED, timeout=60_000)
            assert np.isfinite(view.camera.eye.numpy()).all(), "the program hears where the page looks from"
            assert any("/v1/stream" in path for path in proxy.asked)
    context.close()
