"""The work of a batch as a callable over rows, for data pipelines that bring their own processes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import torch

from torchrender.batch.job import KINDS, OUTPUTS, SceneSource, check_outputs, options_of
from torchrender.checks import check_choice
from torchrender.errors import InputError
from torchrender.numerics.color import srgb_from_linear
from torchrender.raster import rasterize
from torchrender.renderer import render
from torchrender.scene.camera import Cameras

Array = np.ndarray[Any, Any]


class Renderer:
    """Renders rows of cameras: ``dataset.map_batches(Renderer, fn_constructor_args=("city",), concurrency=2)``.

    The scene is loaded when the first rows come, and kept with its trees.

    Args:
        path_or_name: a scene as :func:`torchrender.load` takes it.
        width, height: of the pictures.
        what: "pictures" or "depth".
        outputs: arrays of depth images.
        choices: further arguments of :func:`torchrender.load`.
        wishes: options of pictures, as :class:`~torchrender.batch.job.Job` has them.

    Raises:
        OptionError: an unknown kind, array or wish, or arrays for pictures.
    """

    def __init__(
        self,
        path_or_name: str,
        width: int = 512,
        height: int = 512,
        *,
        what: str = "pictures",
        outputs: Sequence[str] = OUTPUTS,
        choices: Mapping[str, Any] | None = None,
        **wishes: Any,
    ) -> None:
        check_choice("what", what, tuple(kind for kind in KINDS if kind != "film"))
        check_outputs(what, outputs)
        self._source = SceneSource(path_or_name, dict(choices or {}))
        self._size, self._what, self._outputs = (width, height), what, tuple(outputs)
        self._options = options_of(wishes)
        self._scene: Any = None

    def __call__(self, rows: Mapping[str, Array]) -> dict[str, Array]:
        """The rows with what is seen: ``picture`` (N,H,W,3) uint8 sRGB, or the arrays of depth images (N,H,W,...).

        Args:
            rows: ``camera_to_world`` (N,4,4) with x right, y up, z backward (OpenGL, Blender, NeRF), and ``fov_deg``
                (N,) vertical; or ``eye`` (N,3), ``target`` (N,3) and ``fov_deg``. Other columns are handed on.

        Raises:
            InputError: neither is there. CameraError: names what is wrong.
        """
        if self._scene is None:
            self._scene = self._source.load()
        cameras = self._cameras(rows)
        if self._what == "depth":
            made = rasterize(self._scene, cameras, outputs=self._outputs)
            return dict(rows) | {name: values.numpy() for name, values in made.items()}
        pictures = [self._picture(cameras[number]) for number in range(len(cameras))]
        width, height = self._size
        empty = np.zeros((0, height, width, 3), np.uint8)
        return dict(rows) | {"picture": np.stack(pictures) if pictures else empty}

    def _picture(self, camera: Cameras) -> Array:
        seen = render(self._scene, camera, options=self._options).displayed()[0]
        codes: Array = (srgb_from_linear(seen.detach()) * 255.0 + 0.5).clamp(0.0, 255.0).to(torch.uint8).numpy()
        return codes

    def _cameras(self, rows: Mapping[str, Array]) -> Cameras:
        width, height = self._size
        if "camera_to_world" in rows:
            poses, angles = np.asarray(rows["camera_to_world"], float), self._angles(rows)
            made = [
                Cameras.from_opengl(pose.reshape(4, 4), width=width, height=height, fov_deg=float(angle))
                for pose, angle in zip(poses, angles, strict=True)
            ]
        elif "eye" in rows and "target" in rows:
            made = [
                Cameras.look_at(eye.tolist(), target.tolist(), width=width, height=height, fov_deg=float(angle))
                for eye, target, angle in zip(
                    np.asarray(rows["eye"], float), np.asarray(rows["target"], float), self._angles(rows), strict=True
                )
            ]
        else:
            raise InputError(f"rows must have camera_to_world, or eye and target; they have {', '.join(rows)}")
        return Cameras.cat(made)

    def _angles(self, rows: Mapping[str, Array]) -> Array:
        if "fov_deg" not in rows:
            raise InputError("rows must have fov_deg, the vertical opening angle")
        return np.asarray(rows["fov_deg"], float).reshape(-1)
