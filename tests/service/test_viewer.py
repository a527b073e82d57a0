"""Scenes of this program in a viewer: shown, changed, clicked on and photographed."""

from __future__ import annotations

import asyncio
import contextlib
import http.client
import os
import socket
import sys
import threading
import time
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch

import torchrender as tr
from torchrender.client import StreamClient
from torchrender.clock import StepClock
from torchrender.errors import InputError, TorchRenderError
from torchrender.wire.cameras import header_of
from torchrender.wire.messages import Hello, Look, Pick, Picked, Status, Type, decode, encode
from torchrender_service.renderers.job_runner import JobRunner
from torchrender_service.renderers.jobs import FindPixel, Forget, SceneSource, SmoothKeyframe, Survey
from torchrender_service.viewer.live_scenes import LiveScenes
from torchrender_service.viewer.thread_pool import NICENESS, ThreadPool
from torchrender_service.viewer.view import Pick as Found
from torchrender_service.viewer.view import View

SIZE = (96, 64)


def small_scene() -> tr.Scene:
    red, grey = tr.Material(name="red", diffuse=torch.tensor([0.8, 0.1, 0.1])), tr.Material(name="grey")
    ball = tr.Mesh.sphere(0.5, (0.0, 0.5, 0.0), segments=24, name="ball")
    floor = tr.Mesh.box((4.0, 0.1, 4.0), (0.0, -0.05, 0.0), name="floor", material=1)
    return tr.Scene(meshes=(ball, floor), materials=(red, grey), name="Ball & floor")


@pytest.fixture(scope="module")
def view() -> Iterator[View]:
    with tr.show(small_scene(), browser=False) as made:
        yield made


@pytest.fixture
def client(view: View) -> Iterator[StreamClient]:
    view.scene = small_scene()
    address = view.url.partition("?")[0]
    with StreamClient.connect(address, view.id, size=SIZE, layers=0, overscan=1.0) as made:
        made.send_pose(made.camera, moving=False)
        made.receive()
        yield made


@pytest.mark.skipif(sys.platform != "linux", reason="threads have an order of their own")
def test_the_thread_that_renders_gives_way_to_the_program_and_its_browser(monkeypatch) -> None:
    found = []

    def noted(runner: Any, job: Any) -> dict[str, Any]:
        del runner, job
        found.append(os.getpriority(os.PRIO_PROCESS, threading.get_native_id()))
        return {}

    monkeypatch.setattr(JobRunner, "run", noted)
    own = os.getpriority(os.PRIO_PROCESS, threading.get_native_id())
    pool = ThreadPool(LiveScenes())
    asyncio.run(pool.run(Forget(session="none")))
    asyncio.run(pool.stop())
    assert found == [min(19, own + NICENESS)]
    assert os.getpriority(os.PRIO_PROCESS, threading.get_native_id()) == own, "and nobody else does"


def test_an_empty_scene_is_shown_and_filled() -> None:
    with tr.show(tr.Scene(), browser=False) as empty:
        assert not bool(empty.screenshot(width=16, height=12).gbuffer.covered.any())
        empty.scene = small_scene()
        assert bool(empty.screenshot(width=16, height=12).gbuffer.covered.any())
        empty.scene = tr.Scene(environment=tr.Environment(radiance=torch.full((4, 8, 3), 0.5)))
        sky = empty.screenshot(width=16, height=12)
        assert not bool(sky.gbuffer.covered.any()) and float(sky.radiance.min()) == pytest.approx(0.5, abs=1e-3)


def newest(client: StreamClient, fits: Any, timeout_s: float = 20.0) -> Any:
    end = time.monotonic() + timeout_s
    while time.monotonic() < end:
        keyframe = client.receive(timeout_s)
        if fits(keyframe.images[0].header):
            return keyframe
    raise AssertionError("no such keyframe")


def test_the_scene_of_the_program_is_shown(view: View, client: StreamClient) -> None:
    assert client.scene["name"] == "Ball & floor"
    shown = client.kept[-1].images[0]
    expected = tr.rasterize(view.scene, client.camera).depth[0]
    both = shown.depth.isfinite() & expected.isfinite()
    assert float((shown.depth.isfinite() == expected.isfinite()).float().mean()) > 0.99
    assert float(((shown.depth - expected).abs() / expected)[both].max()) < 1e-3


def test_moved_vertices_are_shown(view: View, client: StreamClient) -> None:
    ball = view.scene.mesh("ball")
    lifted = ball.vertices + torch.tensor([0.0, 0.7, 0.0])
    before = client.kept[-1].images[0]
    view.update(mesh="ball", vertices=lifted)
    preview = newest(client, lambda header: header.revision > before.header.revision)
    width, height = (side // 2 for side in SIZE)
    assert preview.images[0].depth.shape == (height, width), "a small picture comes first"
    seen = preview.images[0].depth.isfinite()
    small = tr.rasterize(view.scene, client.camera.scaled(0.5)).depth[0]
    assert float((seen == small.isfinite()).float().mean()) > 0.99
    made = newest(client, lambda header: header.revision > before.header.revision and header.still)
    expected = tr.rasterize(view.scene, client.camera).depth[0]
    depth = made.images[0].depth
    assert float((depth.isfinite() == expected.isfinite()).float().mean()) > 0.99
    assert float((depth.isfinite() != before.depth.isfinite()).float().mean()) > 0.01
    normals = view.scene.mesh("ball").normals
    assert normals is not None and ball.normals is not None
    assert float((normals * ball.normals).sum(-1).min()) > 0.98, "a ball keeps its normals"


def test_points_meshes_and_lights_are_added(view: View, client: StreamClient) -> None:
    count = view.scene.geometry.triangle_count
    cloud = tr.PointCloud(position=torch.rand(50, 3, dtype=torch.float64), color=torch.rand(50, 3))
    view.add(cloud, tr.Mesh.box(0.2, (1.0, 0.1, 0.0)), tr.PointLight(position=(0, 3, 0), intensity=(9.0, 9.0, 9.0)))
    assert view.scene.geometry.triangle_count == count + 8 * 50 + 12
    assert len(view.scene.lights) == 1
    newest(client, lambda header: header.revision > 0)
    with pytest.raises(InputError, match="not str"):
        view.add("a word")


def test_materials_are_added_with_what_has_them(view: View) -> None:
    view.scene = small_scene()
    gold = tr.Material(name="gold", diffuse=(0.9, 0.7, 0.2))
    view.add(tr.Mesh.box(0.2, (1.0, 0.1, 0.0), material=2, name="bar"), gold)
    assert [m.name for m in view.scene.materials] == ["red", "grey", "gold"]
    assert view.scene.materials[view.scene.mesh("bar").material] is gold
    with pytest.raises(InputError, match=r"material must be in \[0, 2\], got 3"):
        view.add(tr.Mesh.box(0.2, (1.0, 0.4, 0.0), material=3))
    assert len(view.scene.meshes) == 3, "what cannot be added changes nothing"


def test_mistakes_are_named(view: View) -> None:
    view.scene = small_scene()
    with pytest.raises(InputError, match=r"vertices must have shape"):
        view.update(mesh="ball", vertices=torch.zeros(3, 3))
    with pytest.raises(InputError, match="one of the scene's 2 meshes"):
        view.update(vertices=torch.zeros(3, 3))
    with pytest.raises(InputError, match="no light"):
        view.update(light=())
    with pytest.raises(InputError, match="single perspective"):
        view.camera = tr.Cameras.cat([view.camera, view.camera])
    with pytest.raises(TorchRenderError, match="no page has shown"):
        view.wait(0.05)
    word: Any = "x"
    with pytest.raises(InputError, match=r"camera must be Cameras, such as .*, got str"):
        view.camera = word
    with pytest.raises(InputError, match="camera must be Cameras"):
        view.pick(3, 4, word)
    with pytest.raises(InputError, match="a view shows meshes, point clouds, lights and materials, not str"):
        view.add(word)
    before = view.scene
    with pytest.raises(InputError, match="a view shows a Scene, not NoneType"):
        view.scene = None  # type: ignore[assignment]
    assert view.scene is before
    nothing: Any = 3
    with pytest.raises(InputError, match="takes a Scene, the name or file of one, a Mesh or a PointCloud, not int"):
        tr.show(nothing, browser=False)


def test_a_closed_view_says_so(view: View) -> None:
    del view  # the service that others run in stays
    closed = tr.show(small_scene(), browser=False)
    closed.close()
    closed.close()
    for change in (
        lambda: closed.update(lights=()),
        lambda: closed.add(tr.Mesh.box()),
        lambda: setattr(closed, "camera", closed.camera),
        lambda: closed.on_pick(print),
    ):
        with pytest.raises(InputError, match="the view of 'Ball & floor' was closed: show the scene again"):
            change()
    assert closed.pick(320, 180) is not None


def test_names_meshes_and_points_are_shown_as_scenes(view: View) -> None:
    del view
    cloud = tr.PointCloud(position=torch.rand(20, 3, dtype=torch.float64), color=torch.rand(20, 3), name="dust")
    for thing, name in (("cornell_box", "cornell_box"), (tr.Mesh.sphere(name="moon"), "moon"), (cloud, "dust")):
        with tr.show(thing, browser=False) as made:
            assert made.scene.name == name and made.scene.geometry.triangle_count > 0


def test_vertices_that_ask_for_a_gradient_are_shown(view: View) -> None:
    view.scene = small_scene()
    ball = view.scene.mesh("ball")
    view.update(mesh="ball", vertices=(ball.vertices + 0.1).requires_grad_())
    shown = view.scene.mesh("ball").vertices
    assert not shown.requires_grad
    torch.testing.assert_close(shown, ball.vertices + 0.1)


def test_the_camera_is_read_and_moved(view: View, client: StreamClient) -> None:
    aside = tr.Cameras.look_at((3.0, 2.0, 1.0), (0.0, 0.3, 0.0), width=SIZE[0], height=SIZE[1])
    client.send_pose(aside, moving=False)
    newest(client, lambda header: np.allclose(header.camera.world_from_camera, header_of(aside).world_from_camera))
    assert np.abs((view.camera.camera_from_world - aside.camera_from_world).numpy()).max() < 1e-12
    assert view.wait(1.0) is view
    picture = view.screenshot(width=48, height=32)
    expected = tr.render(view.scene, aside.scaled(0.5))
    assert float((picture.radiance - expected.radiance).abs().max()) < 1e-5


def test_another_scene_is_shown_from_its_own_camera() -> None:
    """The same one changed is looked at from where it was."""
    box = tr.load("cornell_box")
    with tr.show(small_scene(), browser=False) as made:
        made.camera = aside = tr.Cameras.look_at((3.0, 2.0, 1.0), (0.0, 0.3, 0.0), width=SIZE[0], height=SIZE[1])
        made.scene = small_scene()
        torch.testing.assert_close(made.camera.camera_from_world, aside.camera_from_world)
        made.scene = box
        wanted = box.camera(width=SIZE[0], height=SIZE[1])
        torch.testing.assert_close(made.camera.camera_from_world, wanted.camera_from_world)


@contextlib.contextmanager
def viewer_socket(view: View) -> Iterator[Any]:
    """A socket of a viewer, greeted."""
    from websockets.sync.client import connect

    from torchrender.client.session import post_session

    address = view.url.partition("?")[0]
    body = {"scene": view.id, "width": SIZE[0], "height": SIZE[1], "layers": 0}
    session = post_session(f"{address}v1/sessions", body, None, 30.0)
    protocols: Any = ["torchrender.v1", f"bearer.{session['ticket']}"]
    place = "ws" + address.removeprefix("http") + "v1/stream"
    with connect(place, subprotocols=protocols, compression=None) as socket:
        socket.send(encode(Hello(versions=(1, 1), viewer=True)))
        yield socket


def wait_for(socket: Any, kind: Type) -> Any:
    end = time.monotonic() + 10
    while time.monotonic() < end:
        received = decode(socket.recv(10))
        if isinstance(received.message, {Type.STATUS: Status, Type.LOOK: Look, Type.PICKED: Picked}[kind]):
            return received.message
    raise AssertionError(kind)


def test_clicks_come_back_exact(view: View) -> None:
    view.scene = small_scene()
    heard: list[Found] = []

    @view.on_pick
    def take(found: Found) -> None:
        heard.append(found)

    camera = tr.Cameras.look_at((2.0, 1.5, 2.5), (0.0, 0.4, 0.0), width=SIZE[0], height=SIZE[1])
    header = header_of(camera)
    seen = tr.rasterize(view.scene, camera)
    random = np.random.default_rng(0)
    for x, y in random.uniform((0, 0), SIZE, (200, 2)).tolist():
        triangle = int(seen.triangle[0, int(y), int(x)])
        found = view.pick(x, y, camera)
        assert (found is None) == (triangle < 0)
        if found is not None:
            assert found.triangle == triangle
            assert found.object == int(seen.object_id[0, int(y), int(x)])
            assert float((found.point - seen.position[0, int(y), int(x)]).abs().max()) < 1e-9
    with viewer_socket(view) as socket:
        assert wait_for(socket, Type.STATUS).ahead == 0, "a sign of life comes by itself"
        for number, (x, y) in enumerate(random.uniform((0, 0), SIZE, (5, 2)).tolist()):
            socket.send(encode(Pick(seq=number, camera=header, x=x, y=y)))
            told = wait_for(socket, Type.PICKED)
            assert (told.seq, told.triangle) == (number, int(seen.triangle[0, int(y), int(x)]))
        socket.send(encode(Pick(seq=999, camera=header, x=SIZE[0] / 2, y=SIZE[1] / 2)))
        told = wait_for(socket, Type.PICKED)
        assert told.name == "ball"
        end = time.monotonic() + 5
        while time.monotonic() < end and not (heard and heard[-1].triangle == told.triangle):
            time.sleep(0.01)
        assert heard[-1].mesh.name == "ball" and heard[-1].material.name == "red"
        view.camera = camera
        assert wait_for(socket, Type.LOOK).camera.world_from_camera == header.world_from_camera


def test_several_views_share_a_server_and_show_themselves(view: View, monkeypatch: pytest.MonkeyPatch) -> None:
    with tr.show(replace(small_scene(), name="other"), browser=False) as other:
        assert other.url.partition("?")[0] == view.url.partition("?")[0] and other.id != view.id
        html = other._repr_html_()
        assert html.startswith("<iframe") and other.id in html
    monkeypatch.setenv("JUPYTERHUB_SERVICE_PREFIX", "/user/ann/")
    with tr.show(small_scene(), browser=False, hosts=["hub.example.org"]) as proxied:
        port = proxied.url.split(":")[2].split("/")[0]
        assert f'src="/user/ann/proxy/{port}/?scene=' in proxied._repr_html_()
        for host, status in (("hub.example.org", 200), ("elsewhere.example.org", 421)):
            asked = http.client.HTTPConnection("127.0.0.1", int(port), timeout=10)
            asked.request("GET", "/v1/scenes", headers={"Host": host})
            answer = asked.getresponse()
            assert answer.status == status, "the proxy passes the browser's own name on"
            answer.read()
            asked.close()


def test_pages_of_this_machine_may_hold_it_in_a_frame(view: View) -> None:
    import urllib.request

    with urllib.request.urlopen(view.url, timeout=10) as answer:
        policy = answer.headers["content-security-policy"]
        assert "frame-ancestors 'self' http://127.0.0.1:*" in policy
        assert answer.headers["x-frame-options"] is None
    with urllib.request.urlopen(view.url.partition("?")[0] + "v1/scenes", timeout=10) as answer:
        assert "frame-ancestors 'none'" in answer.headers["content-security-policy"]


def test_a_picture_that_nobody_waits_for_ends_between_two_passes(monkeypatch: pytest.MonkeyPatch) -> None:
    pool, begun, ended = ThreadPool(LiveScenes()), threading.Event(), threading.Event()

    def endless(job: Any) -> dict[str, Any]:
        if job.session == "next":
            return {"made": True}
        clock = StepClock()
        try:
            while True:
                begun.set()
                with clock.measure("pass"):
                    time.sleep(0.001)
        finally:
            ended.set()

    monkeypatch.setattr(pool._runner, "run", endless)

    async def change_of_mind() -> dict[str, Any]:
        running = asyncio.ensure_future(pool.run(Forget(session="first")))
        await asyncio.to_thread(begun.wait)
        running.cancel()
        made = await pool.run(Forget(session="next"))
        await pool.stop()
        return made

    assert asyncio.run(change_of_mind()) == {"made": True}
    assert ended.is_set()


def test_what_is_urgent_comes_first_and_between_two_passes(monkeypatch: pytest.MonkeyPatch) -> None:
    pool, begun, go_on, order = ThreadPool(LiveScenes()), threading.Event(), threading.Event(), []
    source = SceneSource(id="a")
    glance = FindPixel(scene=source, camera=header_of(small_scene().camera(width=8, height=6)), x=0.0, y=0.0)

    def noted(job: Any) -> dict[str, Any]:
        clock, name = StepClock(), getattr(job, "session", type(job).__name__)
        order.append(f"{name} begins")
        if name == "long":
            begun.set()
            go_on.wait(10)
            with clock.measure("pass"):
                order.append("a pass")
        return {}

    monkeypatch.setattr(pool._runner, "run", noted)

    async def ask() -> None:
        running = [asyncio.ensure_future(pool.run(SmoothKeyframe(session="long", id=1)))]
        await asyncio.to_thread(begun.wait)
        for job in (Survey(scene=source), SmoothKeyframe(session="next", id=1), glance):
            running.append(asyncio.ensure_future(pool.run(job)))
            await asyncio.sleep(0.01)
        go_on.set()
        await asyncio.gather(*running)
        begun.clear()
        go_on.clear()
        running = [asyncio.ensure_future(pool.run(SmoothKeyframe(session="long", id=2)))]
        await asyncio.to_thread(begun.wait)
        running.append(asyncio.ensure_future(pool.run(Survey(scene=source))))
        await asyncio.sleep(0.01)
        await pool.stop()
        go_on.set()
        assert await running[0] == {}
        with pytest.raises(asyncio.CancelledError):
            await running[1]

    asyncio.run(ask())
    first = ["long begins", "FindPixel begins", "a pass", "next begins", "Survey begins"]
    assert order == [*first, "long begins", "a pass"]


def test_a_port_that_is_taken_says_so_once(capfd: pytest.CaptureFixture[str]) -> None:
    with socket.create_server(("127.0.0.1", 0)) as other, pytest.raises(TorchRenderError, match="in use"):
        tr.show(small_scene(), browser=False, port=other.getsockname()[1])
    assert capfd.readouterr().err == ""


@pytest.mark.parametrize("place", [("a", 1), (1, None), (float("nan"), 1)])
def test_places_that_are_no_numbers_are_named(view: View, place: tuple[Any, Any]) -> None:
    with pytest.raises(InputError, match=r"^[xy] must"):
        view.pick(*place)


def test_pictures_have_the_size_that_is_asked_for(view: View) -> None:
    camera = view.camera
    picture = view.screenshot(height=24)
    assert tuple(picture.radiance.shape[1:3]) == (24, round(24 * camera.width / camera.height))
    for sides in ({"width": 0, "height": 3}, {"height": -1}, {"width": "a"}):
        with pytest.raises(InputError, match=r"width|height"):
            view.screenshot(**sides)


@pytest.mark.parametrize("port", [-1, 99999, 8000.5, True])
def test_ports_that_there_are_not_are_refused(port: Any) -> None:
    with pytest.raises(InputError, match=r"port must be in \[0, 65535\], got"):
        tr.show(tr.Scene(), port=port, browser=False)
