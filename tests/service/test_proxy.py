"""Pages and streams below a path of another server, as jupyter-server-proxy shows them: the prefix is taken off, the
browser's Host, Origin and subprotocols come through, WebSockets are passed on."""

from __future__ import annotations

import http.client
import re
import urllib.parse
from collections.abc import Iterator

import pytest
import torch

import torchrender as tr
from path_proxy import PathProxy
from torchrender.client import StreamClient
from torchrender_service.viewer.view import View

HUB = "hub.example.org"
SIZE = (96, 64)


@pytest.fixture(scope="module")
def shown() -> Iterator[tuple[View, PathProxy]]:
    ball = tr.Mesh.sphere(0.5, (0.0, 0.5, 0.0), segments=16, name="ball")
    floor = tr.Mesh.box((4.0, 0.1, 4.0), (0.0, -0.05, 0.0), name="floor")
    with tr.show(tr.Scene(meshes=(ball, floor), name="proxied"), browser=False, hosts=[HUB]) as view:
        port = urllib.parse.urlsplit(view.url).port
        assert port is not None
        with PathProxy(f"/user/ann/proxy/{port}", port) as proxy:
            yield view, proxy


def get(proxy: PathProxy, path: str, host: str = HUB) -> tuple[int, dict[str, str], str]:
    asked = http.client.HTTPConnection("127.0.0.1", proxy.port, timeout=20)
    try:
        asked.request("GET", path, headers={"Host": host})
        answer = asked.getresponse()
        return answer.status, {k.lower(): v for k, v in answer.getheaders()}, answer.read().decode()
    finally:
        asked.close()


def test_everything_that_the_page_asks_for_lies_below_the_prefix(shown: tuple[View, PathProxy]) -> None:
    _, proxy = shown
    status, _, text = get(proxy, proxy.prefix + "/")
    assert status == 200
    wanted = re.findall(r'(?:src|href)="([^"#:]+)"', text)
    assert len(wanted) >= 2
    for address in wanted:
        assert not address.startswith("/"), f"{address} would leave the prefix"
        assert get(proxy, f"{proxy.prefix}/{address}")[0] == 200
    assert get(proxy, "/v1/scenes")[0] == 404, "what is not below the prefix is another server's"
    assert get(proxy, proxy.prefix + "/v1/scenes", "elsewhere.example.org")[0] == 421


def test_a_stream_runs_through_it_and_follows_the_program(shown: tuple[View, PathProxy]) -> None:
    view, proxy = shown
    with StreamClient.connect(proxy.url, view.id, size=SIZE, layers=0, overscan=1.0) as client:
        client.send_pose(client.camera, moving=False)
        first = client.receive(30.0)
        ball = view.scene.mesh("ball")
        view.update(mesh="ball", vertices=ball.vertices + torch.tensor([0.0, 0.6, 0.0]))
        before = first.images[0].header.revision
        while (made := client.receive(30.0)).images[0].header.revision == before or not made.images[0].header.still:
            pass  # a preview comes first, of a quarter of the pixels
        expected = tr.rasterize(view.scene, client.camera).depth[0]
        assert float((made.images[0].depth.isfinite() == expected.isfinite()).float().mean()) > 0.99
        again = client.reconnect()
        again.send_pose(again.camera, moving=False)
        assert again.receive(30.0).images
        again.close()
