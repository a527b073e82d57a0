"""What users would draw points with instead: pyvista's Gaussian points. Measured, not needed."""

from __future__ import annotations

import time
from typing import Any

import numpy as np

from torchrender.points.cloud import PointCloud
from torchrender.scene.camera import Cameras


def pyvista_points(cloud: PointCloud, camera: Cameras, frames: int) -> dict[str, Any]:
    """Milliseconds of each frame of ``points_gaussian`` (off screen, picture read back), or why it cannot run."""
    try:
        import pyvista
    except (ImportError, OSError) as error:
        return {"skipped": f"pyvista is not usable here: {error}"}
    assert cloud.radius is not None
    try:
        plotter = pyvista.Plotter(off_screen=True, window_size=[camera.width, camera.height])
        points = pyvista.PolyData(cloud.position.numpy().astype(np.float32))
        color = None if cloud.color is None else (cloud.color.clamp(0, 1) * 255).byte().numpy()
        plotter.add_mesh(
            points,
            style="points_gaussian",
            scalars=color,
            rgb=color is not None,
            emissive=False,
            render_points_as_spheres=False,
            point_size=1.0,
        )
        eye, forward = camera.eye[0].tolist(), camera.forward[0].tolist()
        plotter.camera.position = eye
        plotter.camera.focal_point = [e + f for e, f in zip(eye, forward, strict=True)]
        plotter.camera.view_angle = float(
            np.degrees(2 * np.arctan(0.5 * camera.height / float(camera.intrinsics[0, 1, 1])))
        )
        seconds = []
        plotter.show(auto_close=False)
        for _ in range(frames):
            begin = time.perf_counter()
            # A camera that moves: otherwise the last picture would be given again.
            plotter.camera.azimuth += 1.0
            plotter.render()
            picture = np.asarray(plotter.screenshot(return_img=True))
            seconds.append(time.perf_counter() - begin)
        renderer = _renderer(plotter)
        plotter.close()
    # VTK raises plain RuntimeError and AttributeError where there is no OpenGL.
    except (RuntimeError, AttributeError, TypeError, ValueError, OSError) as error:
        return {"skipped": f"pyvista cannot draw here: {error}"}
    drew = bool((picture != picture[0, 0]).any())
    return {"ms": [1e3 * s for s in seconds], "renderer": renderer, "drew": drew}


def _renderer(plotter: Any) -> str:
    """Name of the OpenGL implementation."""
    text = str(plotter.render_window.ReportCapabilities())
    return text.split("OpenGL renderer string:")[-1].split("\n")[0].strip()
