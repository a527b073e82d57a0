"""Scenes of the running program in a browser or a notebook."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from torchrender.errors import InputError
from torchrender.extras import check_extra
from torchrender.scene.mesh import Mesh
from torchrender.scene.model import Scene

if TYPE_CHECKING:
    from torchrender.points.cloud import PointCloud
    from torchrender_service.viewer.view import View


def show(
    scene: Scene | Mesh | PointCloud | str | Path,
    *,
    port: int = 0,
    hosts: Sequence[str] = (),
    prefix: str | None = None,
    browser: bool | None = None,
) -> View:
    """Show a scene of this program in a browser; in notebooks the view shows itself.

        view = tr.show(scene)
        view.update(vertices=moved)            # of the only mesh, or mesh="name"
        view.add(cloud)                        # points, meshes, lights
        view.camera = tr.Cameras.look_at(...)  # reads and moves what the page shows
        view.on_pick(print)                    # what somebody clicks on: mesh, face, world point
        view.screenshot().save("view.png")     # needs no browser

    The service runs in a thread of the program, on the loopback address, and renders the program's own scenes; several
    views share it. Where the program runs on another machine, forward the port: ``ssh -L 8000:127.0.0.1:8000``.

    Args:
        scene: of this program, or the name or file of one; a mesh or a point cloud alone is a scene of its own.
        port: 0: any that is free.
        hosts: names under which browsers see the service where a proxy shows it, such as ``hub.example.org``.
        prefix: address below which a proxy shows it, for notebooks; None: as JupyterHub with jupyter-server-proxy has
            it, else this machine's.
        browser: open one; None: unless this is a notebook.

    Raises:
        MissingExtraError: the packages of the service are not installed.
        InputError: nothing that can be shown, a port outside [0, 65535]. SceneFileError: a file that cannot be read.
        TorchRenderError: the port is in use.
    """
    if isinstance(port, bool) or not isinstance(port, int) or not 0 <= port <= 65535:
        raise InputError(f"port must be in [0, 65535], got {port!r}")
    check_extra("service", "tr.show")
    from torchrender_service.viewer.view import open_view

    return open_view(scene, port=port, hosts=hosts, prefix=prefix, browser=browser)
