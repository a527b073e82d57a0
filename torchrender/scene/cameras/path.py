"""Camera paths: smooth ways through key poses at constant speed; built-in walks through the furnished rooms.

A path file is TOML or JSON with an array ``pose`` of tables ``eye``, ``target`` (three numbers each) and, if wanted,
``fov`` (vertical opening angle in degrees); ``ends = "closed"`` returns to the first pose.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from torchrender.checks import check_class, check_finite, check_tensor
from torchrender.errors import InputError, SceneFileError
from torchrender.scene.camera import Cameras
from torchrender.scene.cameras.spline import FINE, even_times, spans, spline_at
from torchrender.scene.files.content import json_values, read_bytes
from torchrender.scene.files.toml_table import Table, parse_toml
from torchrender.scene.model import Scene

USUAL_FRAMES = 500
"""Frames of a built-in walk: steps of less than a centimetre, as a slow walk has at 60 pictures a second."""

_SWAY = 0.02  # scene units by which a seed moves the key poses of a walk


@dataclass(frozen=True, eq=False, kw_only=True)
class CameraPath:
    """K key poses, joined by a Catmull-Rom spline.

    Raises:
        InputError: fewer than two poses, wrong shapes, values that are not finite, or an eye at its target.
    """

    eyes: Tensor  # (K,3) float64
    targets: Tensor  # (K,3) float64
    fov_deg: Tensor  # (K,) vertical opening angle
    closed: bool = False
    orthographic: Cameras | None = None  # one camera: all are orthographic, with its view height, near and far

    def __post_init__(self) -> None:
        for name in ("eyes", "targets", "fov_deg"):
            object.__setattr__(self, name, torch.as_tensor(getattr(self, name), dtype=torch.float64))
            check_finite(name, getattr(self, name))
        check_tensor("eyes", self.eyes, ("K", 3))
        check_tensor("targets", self.targets, tuple(self.eyes.shape))
        check_tensor("fov_deg", self.fov_deg, (len(self.eyes),))
        if len(self.eyes) < 2:
            raise InputError(f"a path must have at least 2 poses, got {len(self.eyes)}")
        if bool(((self.eyes - self.targets).norm(dim=1) == 0).any()):
            raise InputError("every pose of a path must have an eye that differs from its target")
        if self.orthographic is not None:
            check_class("orthographic", self.orthographic, Cameras)
            if len(self.orthographic) != 1 or not self.orthographic.orthographic:
                raise InputError("orthographic must be one orthographic camera")

    def cameras(self, frames: int, *, width: int, height: int, near: float) -> Cameras:
        """``frames`` cameras from the first pose to the last, the eye at constant speed.

        They are perspective; with ``orthographic``, they are as that camera, and ``fov_deg`` and ``near`` have no say.
        A path whose eye rests turns at constant speed from pose to pose. A closed path does not repeat its start.

        Raises:
            InputError: fewer than one frame.
        """
        if frames < 1:
            raise InputError(f"frames must be >= 1, got {frames}")
        time = even_times(self.eyes, frames, self.closed)
        ways = (self.eyes, self.targets, self.fov_deg[:, None])
        eye, target, fov = (spline_at(values, time, self.closed) for values in ways)
        lens = self.orthographic
        if lens is not None:
            nearest, farthest = float(lens.near[0]), float(lens.far[0])
            seen = lens.height / float(lens.intrinsics[0, 1, 1])
            return Cameras.orthographic_view(
                eye, target, width=width, height=height, view_height=seen, near=nearest, far=farthest
            )
        views = [
            Cameras.look_at(e, t, width=width, height=height, fov_deg=float(f.clamp(1.0, 179.0)), near=near)
            for e, t, f in zip(eye, target, fov, strict=True)
        ]
        return Cameras.cat(views)

    @property
    def length(self) -> float:
        """Way of the eye in scene units."""
        last = spans(len(self.eyes), self.closed)
        fine = torch.linspace(0, last, FINE * last + 1, dtype=torch.float64)
        eye = spline_at(self.eyes, fine, self.closed)
        return float(eye.diff(dim=0).norm(dim=1).sum())


_WALKS: dict[str, dict[str, tuple[tuple[float, ...], ...]]] = {
    # eye x, y, z, target x, y, z
    "living_room": {
        "walk1": (
            (1.75, 1.58, 2.40, -0.35, 0.86, -1.20), (1.10, 1.56, 1.85, -0.20, 0.75, -1.30),
            (0.60, 1.53, 1.20, 0.30, 0.80, -1.90), (0.50, 1.50, 0.45, 0.85, 0.95, -2.50),
        ),
        "walk2": (
            (-2.05, 1.55, 1.70, 0.30, 0.70, -1.20), (-1.20, 1.58, 1.80, 0.80, 0.75, -1.20),
            (-0.30, 1.56, 1.60, 1.60, 0.80, -1.30), (0.65, 1.52, 1.30, 2.50, 0.85, -0.80),
        ),
    },
    "washroom": {
        "walk1": (
            (0.95, 1.48, 1.30, -0.42, 0.92, -1.00), (0.62, 1.50, 0.95, -0.40, 0.98, -1.20),
            (0.20, 1.52, 0.60, -0.30, 1.05, -1.40), (-0.25, 1.50, 0.40, -0.15, 1.15, -1.50),
        ),
        "walk2": (
            (-1.10, 1.50, -0.20, 1.00, 0.80, 0.20), (-0.85, 1.52, 0.25, 0.90, 0.85, -0.30),
            (-0.45, 1.52, 0.60, 0.60, 0.95, -0.90), (0.10, 1.50, 0.75, 0.10, 1.05, -1.30),
        ),
    },
}  # fmt: skip


def walks_of(scene: Scene) -> tuple[str, ...]:
    """Names of the built-in walks through a scene; none for most."""
    return tuple(_WALKS.get(scene.name, {}))


def built_in_path(scene: Scene, name: str = "walk1", seed: int = 0) -> CameraPath:
    """A walk through a furnished room, or for any scene ``orbit``: a swing of the default camera about its middle,
    orthographic where it is.

    The seed moves the key poses of a walk by a few hundredths of a unit; 0 leaves them in place.

    Raises:
        InputError: no path of that name for this scene; the message lists those there are.
    """
    if name == "orbit":
        return _orbit(scene)
    if name not in walks_of(scene):
        known = ", ".join((*walks_of(scene), "orbit"))
        raise InputError(f"scene {scene.name!r} has no path {name!r}; known paths: {known}")
    poses = torch.tensor(_WALKS[scene.name][name], dtype=torch.float64)
    if seed:
        generator = torch.Generator().manual_seed(seed)
        poses = poses + _SWAY * torch.rand(poses.shape, generator=generator, dtype=torch.float64).mul(2).sub(1)
    fov = torch.full((len(poses),), 60.0, dtype=torch.float64)
    return CameraPath(eyes=poses[:, :3], targets=poses[:, 3:], fov_deg=fov)


def load_path(path: str | Path) -> CameraPath:
    """The path in a TOML or JSON file.

    Raises:
        SceneFileError: the file or a key in it cannot be used; says which and why.
    """
    check_class("path", path, str, Path)
    path = Path(path)
    data = read_bytes(path)
    table = parse_toml(path, data) if path.suffix.lower() != ".json" else Table(path, "", _json(path, data))
    poses = table.tables("pose")
    ends = table.choice("ends", ("open", "closed"), "open")
    table.finish()
    rows = [(p.vector("eye"), p.vector("target"), p.number("fov", 60.0, 1.0, 179.0)) for p in poses]
    for pose in poses:
        pose.finish()
    with table.reporting("pose"):
        if len(rows) < 2:
            raise InputError(f"a path must have at least 2 poses, got {len(rows)}")
        eyes, targets, fov = zip(*rows, strict=True)
        return CameraPath(
            eyes=torch.stack(eyes), targets=torch.stack(targets), fov_deg=torch.tensor(fov), closed=ends == "closed"
        )


def _json(path: Path, data: bytes) -> dict[str, Any]:
    try:
        values = json_values(data)
    except ValueError as error:
        raise SceneFileError(path, f"not a JSON file ({error})") from error
    if not isinstance(values, dict):
        raise SceneFileError(path, "must hold a JSON object")
    return values


def _orbit(scene: Scene) -> CameraPath:
    camera = scene.camera(width=64, height=64)
    eye = camera.eye[0]
    low, high = scene.bounds
    middle = (low + high) / 2 if scene.geometry.triangle_count else eye + camera.forward[0]
    ahead = float(((middle - eye) * camera.forward[0]).sum())
    target = eye + camera.forward[0] * max(ahead, 0.1 * (scene.diagonal or 1.0))
    fov = torch.rad2deg(2 * torch.atan(32.0 / camera.intrinsics[0, 1, 1]))
    eyes = []
    for angle in torch.linspace(-0.15, 0.15, 5, dtype=torch.float64):
        c, s = torch.cos(angle), torch.sin(angle)
        offset = eye - target
        eyes.append(target + torch.stack([c * offset[0] + s * offset[2], offset[1], c * offset[2] - s * offset[0]]))
    lens = camera if camera.orthographic else None
    return CameraPath(eyes=torch.stack(eyes), targets=target.expand(5, 3), fov_deg=fov.expand(5), orthographic=lens)
