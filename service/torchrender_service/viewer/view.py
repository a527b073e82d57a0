"""A scene of the running program, as a browser shows it."""

from __future__ import annotations

import os
import secrets
import sys
import time
import warnings
import webbrowser
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import torch
from torch import Tensor

from torchrender.checks import ArrayLike, as_array, check_range
from torchrender.errors import InputError, TorchRenderError, TorchRenderWarning
from torchrender.image import Image
from torchrender.pipeline.options import RenderOptions
from torchrender.points.cloud import PointCloud
from torchrender.points.solids import point_mesh
from torchrender.renderer import render
from torchrender.scene.camera import Cameras
from torchrender.scene.light import Light
from torchrender.scene.load import load
from torchrender.scene.material import Material
from torchrender.scene.mesh import Mesh
from torchrender.scene.model import Scene
from torchrender.wire.cameras import cameras_of, header_of, view_text
from torchrender.wire.messages import CameraHeader, Picked
from torchrender_service.renderers.jobs import FindPixel, SceneSource
from torchrender_service.renderers.viewing.picking import find_pixel
from torchrender_service.viewer.live_server import LiveServer, live_server

HEIGHT = 480  # pixels of a notebook's frame
MAX_PIXEL = 2**31
SIZE = (640, 360)
POLL_S = 0.01


@dataclass(frozen=True, eq=False, kw_only=True)
class Pick:
    """The surface that a pixel shows."""

    mesh: Mesh
    object: int  # number of the mesh in the scene
    face: int  # of that mesh
    triangle: int  # of the whole scene
    material: Material
    point: Tensor  # (3,) float64 world
    normal: Tensor  # (3,) float64 world, shading normal
    depth: float  # along the view, scene units


class View:
    """A scene that browsers show. Use :func:`torchrender.show`.

    Attributes:
        id: of the scene in the addresses of the service.
    """

    def __init__(self, scene: Scene, server: LiveServer, prefix: str | None) -> None:
        self.id = f"{_word(scene.name)}_{secrets.token_hex(3)}"
        self._scene, self._server, self._prefix = scene, server, prefix
        self._start: Cameras | None = None
        self._closed = False
        server.put(self.id, scene)

    # --------------------------------------------------------------- where it is

    @property
    def url(self) -> str:
        """Address of the page on this machine."""
        return f"http://127.0.0.1:{self._server.port}/{self._query}"

    @property
    def _query(self) -> str:
        text = f"?scene={self.id}"
        if self._start is not None:
            text += "&view=" + view_text(header_of(self._start), self._scene.diagonal)
        return text

    def _repr_html_(self) -> str:
        """In notebooks: the page in a frame, beside the notebook's own address where a proxy shows it."""
        base = self._prefix or f"http://127.0.0.1:{self._server.port}/"
        source = escape(base.rstrip("/") + "/" + self._query)
        style = f"width:100%;height:{HEIGHT}px;border:0;border-radius:8px"
        title = escape(f"{self._scene.name}, a torchrender view")
        return f'<iframe src="{source}" title="{title}" allow="clipboard-write; fullscreen" style="{style}"></iframe>'

    def __repr__(self) -> str:
        return f"View of {self._scene.name!r} at {self.url}"

    def open(self) -> View:
        """Show the page in the browser of this machine."""
        webbrowser.open(self.url)
        return self

    def wait(self, timeout_s: float = 30.0) -> View:
        """Return when a page shows it.

        Raises:
            TorchRenderError: none does in time.
        """
        end = time.monotonic() + timeout_s
        while self._server.camera(self.id) is None:
            if time.monotonic() > end:
                raise TorchRenderError(f"no page has shown {self.url} within {timeout_s:g} s")
            time.sleep(POLL_S)
        return self

    # --------------------------------------------------------------- the scene

    @property
    def scene(self) -> Scene:
        """As it is shown; assigning another one shows that, from its own camera where it has another name."""
        return self._scene

    @scene.setter
    def scene(self, scene: Scene) -> None:
        if not isinstance(scene, Scene):
            raise InputError(f"a view shows a Scene, not {type(scene).__name__}")
        another = scene.name != self._scene.name
        self._show(scene)
        if another and not (camera := scene.camera(width=SIZE[0], height=SIZE[1])).orthographic:
            self.camera = camera

    def _show(self, scene: Scene) -> None:
        self._check_open()
        self._server.put(self.id, scene)
        self._scene = scene

    def update(self, *, vertices: ArrayLike | None = None, mesh: str | None = None, **changes: Any) -> View:
        """Change the scene; every page shows it as soon as its next picture is made.

        Args:
            vertices: (V,3) new places of a mesh's vertices, as many as before; what asks for a gradient is shown, too.
            mesh: its name; None: the scene has one mesh only.
            changes: fields of :class:`Scene`, such as ``lights`` or ``materials``.

        Raises:
            InputError: no such mesh or field. MeshError: another number of vertices, or such that are not finite.
        """
        scene = self._scene.replace(**changes) if changes else self._scene
        if vertices is not None:
            number = _number_of(scene, mesh)
            meshes = list(scene.meshes)
            meshes[number] = meshes[number].with_vertices(_values("vertices", vertices))
            scene = scene.with_meshes(meshes)
        elif mesh is not None:
            raise InputError("mesh names what vertices belong to: give vertices, too")
        self._show(scene)
        return self

    def add(self, *things: Mesh | PointCloud | Material | Light) -> View:
        """Show more: meshes, point clouds (as small discs), lights; materials, numbered on, as is that of each cloud.

        Raises:
            InputError: something that is none of these, or a mesh of a material that there is not.
        """
        meshes, lights, materials = list(self._scene.meshes), list(self._scene.lights), list(self._scene.materials)
        for thing in things:
            if isinstance(thing, PointCloud):
                materials.append(Material(name=thing.name, diffuse=torch.ones(3)))
                meshes.append(point_mesh(thing, material=len(materials) - 1))
            elif isinstance(thing, Mesh):
                meshes.append(thing)
            elif isinstance(thing, Material):
                materials.append(thing)
            elif isinstance(thing, Light):
                lights.append(thing)
            else:
                raise InputError(f"a view shows meshes, point clouds, lights and materials, not {type(thing).__name__}")
        self._show(self._scene.replace(meshes=meshes, lights=lights, materials=materials))
        return self

    # --------------------------------------------------------------- looking

    @property
    def camera(self) -> Cameras:
        """Where the page that was opened last looks from; before one is, where it will. Assigning moves all pages."""
        seen = self._server.camera(self.id)
        if seen is not None:
            return cameras_of(seen)
        if self._start is not None:
            return self._start
        return self._scene.camera(width=SIZE[0], height=SIZE[1])

    @camera.setter
    def camera(self, camera: Cameras) -> None:
        header = _header("camera", camera)
        self._check_open()
        self._start = camera
        self._server.look(self.id, header)

    def on_pick(self, callback: Callable[[Pick], None]) -> Callable[[Pick], None]:
        """Call back with every surface that somebody clicks on, in a thread for callbacks; works as a decorator."""
        self._check_open()

        def told(picked: Picked) -> None:
            found = self._pick_of({name: getattr(picked, name) for name in picked.__struct_fields__})
            if found is not None:
                callback(found)

        self._server.listen(self.id, told)
        return callback

    def pick(self, x: float, y: float, camera: Cameras | None = None) -> Pick | None:
        """What a pixel shows, without a page: the ids of the rasterizer there. None: nothing.

        Args:
            x, y: pixels; the first one's centre is at 0.5.
            camera: default :attr:`camera`.
        """
        for name, value in (("x", x), ("y", y)):
            check_range(name, value, -MAX_PIXEL, MAX_PIXEL)
        header = _header("camera", self.camera if camera is None else camera)
        return self._pick_of(find_pixel(self._scene, FindPixel(scene=SceneSource(id=self.id), camera=header, x=x, y=y)))

    def _pick_of(self, found: dict[str, Any]) -> Pick | None:
        if found["triangle"] < 0 or found["object"] >= len(self._scene.meshes):
            return None
        mesh = self._scene.meshes[found["object"]]
        point, normal = (torch.tensor(found[name], dtype=torch.float64) for name in ("point", "normal"))
        names = ("object", "face", "triangle", "depth")
        numbers = {name: found[name] for name in names}
        return Pick(mesh=mesh, material=self._scene.materials[mesh.material], point=point, normal=normal, **numbers)

    def screenshot(
        self, *, width: int | None = None, height: int | None = None, options: RenderOptions | None = None
    ) -> Image:
        """A picture of the scene as it is, from where the page looks; needs no page and no display.

        Args:
            width, height: pixels; default: as the page has, in its shape. The vertical opening angle stays.
        """
        return render(self._scene, self.camera, width=width, height=height, options=options)

    def close(self) -> None:
        """Show it no longer; pictures and picks without a page still work."""
        if not self._closed:
            self._closed = True
            self._server.drop(self.id)

    def _check_open(self) -> None:
        if self._closed:
            raise InputError(f"the view of {self._scene.name!r} was closed: show the scene again with tr.show(scene)")

    def __enter__(self) -> View:
        return self

    def __exit__(self, *rest: object) -> None:
        self.close()


def open_view(
    thing: Scene | Mesh | PointCloud | str | Path,
    *,
    port: int = 0,
    hosts: Sequence[str] = (),
    prefix: str | None = None,
    browser: bool | None = None,
) -> View:
    """See :func:`torchrender.show`."""
    scene = _scene_of(thing)
    notebook = "ipykernel" in sys.modules
    public = os.environ.get("JUPYTERHUB_PUBLIC_URL", "")
    if not hosts and public:
        hosts = (urlsplit(public).netloc,)
    server = live_server(port, hosts)
    if prefix is None and (home := os.environ.get("JUPYTERHUB_SERVICE_PREFIX")):
        prefix = f"{home.rstrip('/')}/proxy/{server.port}/"
        if not hosts:
            told = "name the hub's host for the proxy to be let in: tr.show(scene, hosts=['hub.example.org'])"
            warnings.warn(told, TorchRenderWarning, stacklevel=3)
    view = View(scene, server, prefix)
    if browser if browser is not None else not notebook:
        view.open()
    return view


def _scene_of(thing: Scene | Mesh | PointCloud | str | Path) -> Scene:
    if isinstance(thing, str | Path):
        return load(thing)
    if isinstance(thing, Mesh):
        return Scene(meshes=(thing,), name=thing.name)
    if isinstance(thing, PointCloud):
        white = Material(name=thing.name, diffuse=torch.ones(3))
        return Scene(meshes=(point_mesh(thing),), materials=(white,), name=thing.name)
    if isinstance(thing, Scene):
        return thing
    raise InputError(
        f"tr.show takes a Scene, the name or file of one, a Mesh or a PointCloud, not {type(thing).__name__}"
    )


def _header(name: str, camera: Cameras) -> CameraHeader:
    """The message of a camera that a page can look from."""
    if not isinstance(camera, Cameras):
        raise InputError(f"{name} must be Cameras, such as Cameras.look_at(...), got {type(camera).__name__}")
    if len(camera) != 1 or camera.orthographic:
        kind = "orthographic" if camera.orthographic else "perspective"
        raise InputError(f"{name} must be a single perspective camera, got {len(camera)} {kind}")
    return header_of(camera)


def _word(name: str) -> str:
    """A name as an address can hold it."""
    return "".join(c if c.isascii() and c.isalnum() else "_" for c in name.lower())[:40] or "scene"


def _values(name: str, value: ArrayLike) -> Tensor:
    """An array without its gradient: a picture for the eye needs none."""
    return as_array(name, value).detach()


def _number_of(scene: Scene, name: str | None) -> int:
    if name is None:
        if len(scene.meshes) != 1:
            raise InputError(f"mesh must name one of the scene's {len(scene.meshes)} meshes")
        return 0
    chosen = scene.mesh(name)
    return next(k for k, mesh in enumerate(scene.meshes) if mesh is chosen)
