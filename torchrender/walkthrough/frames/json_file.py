"""A simple JSON description of RGB-D photos."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from torchrender.errors import CameraError, SceneFileError
from torchrender.images.files import write_atomically
from torchrender.walkthrough.frames.poses import read_text
from torchrender.walkthrough.frames.record import Array, Frame, RgbdSequence


def is_nerf(path: Path) -> bool:
    """Whether a file is a ``transforms.json`` of NeRF programs, which has cameras of photos but no depth."""
    try:
        table = json.loads(read_text(path))
    except (ValueError, RecursionError, SceneFileError):
        return False
    frames = table.get("frames") if isinstance(table, dict) else None
    first = frames[0] if isinstance(frames, list) and frames else None
    return isinstance(first, dict) and "transform_matrix" in first


def read_json_sequence(path: Path) -> RgbdSequence:
    """The frames of a JSON file.

    ``{"intrinsics": [fx, fy, cx, cy], "depth_scale": 1000, "pixel_centre": 0.5, "frames": [{"color": "a.png",
    "depth": "a_depth.png", "pose": [[...]]}, ...]}``. ``pose`` is world from camera, 4x4, OpenCV axes. Depth files are
    16-bit pictures (0 and 65535: unknown) or .npy floats (+inf: background). ``intrinsics``, ``depth_scale``, ``name``
    and ``time`` may also stand in a frame. ``pixel_centre`` is where the centre of the first pixel lies (default 0.5).
    Paths are relative to the file and stay in its folder.

    Raises:
        SceneFileError: the file cannot be used; names the key and the reason.
    """
    try:
        table = json.loads(read_text(path))
    except (ValueError, RecursionError) as error:
        raise SceneFileError(path, f"is no JSON ({error})") from error
    if not isinstance(table, dict) or not isinstance(table.get("frames"), list) or not table["frames"]:
        raise SceneFileError(path, "must be a table with a list that is not empty", key="frames")
    unknown = set(table) - {"intrinsics", "depth_scale", "pixel_centre", "frames", "name"}
    if unknown:
        raise SceneFileError(path, "unknown key", key=sorted(unknown)[0])
    frames = [_frame(path, table, n, entry) for n, entry in enumerate(table["frames"])]
    frames.sort(key=lambda f: (f.time is None, f.time or 0.0, f.name))
    return RgbdSequence(tuple(frames), name=str(table.get("name", path.resolve().parent.name)))


def _frame(path: Path, table: dict[str, Any], number: int, entry: Any) -> Frame:
    key = f"frames[{number}]"
    if not isinstance(entry, dict):
        raise SceneFileError(path, "must be a table", key=key)
    unknown = set(entry) - {"color", "depth", "pose", "intrinsics", "depth_scale", "name", "time"}
    if unknown:
        raise SceneFileError(path, "unknown key", key=f"{key}.{sorted(unknown)[0]}")
    color = _file(path, f"{key}.color", entry.get("color"))
    if color is None:
        raise SceneFileError(path, "is missing", key=f"{key}.color")
    centre = _numbers(path, "pixel_centre", [table.get("pixel_centre", 0.5)], 1)[0]
    lens = _numbers(path, f"{key}.intrinsics", entry.get("intrinsics", table.get("intrinsics")), 4)
    scale = _numbers(path, f"{key}.depth_scale", [entry.get("depth_scale", table.get("depth_scale", 1000.0))], 1)[0]
    pose = _numbers(path, f"{key}.pose", entry.get("pose"), 16).reshape(4, 4)
    time = entry.get("time")
    k = np.array([[lens[0], 0, lens[2] + 0.5 - centre], [0, lens[1], lens[3] + 0.5 - centre], [0, 0, 1.0]])
    try:
        return Frame(
            name=str(entry.get("name", color.stem)),
            world_from_camera=pose,
            intrinsics=k,
            color=color,
            depth=_file(path, f"{key}.depth", entry.get("depth")),
            depth_scale=float(scale),
            time=None if time is None else float(_numbers(path, f"{key}.time", [time], 1)[0]),
        )
    except CameraError as error:
        raise SceneFileError(path, str(error), key=key) from error


def _numbers(path: Path, key: str, value: Any, count: int) -> Array:
    try:
        found = np.array(value, np.float64).reshape(-1)
    except (TypeError, ValueError):
        found = np.zeros(0)
    if len(found) != count or not np.isfinite(found).all():
        raise SceneFileError(path, f"must be {count} finite numbers", key=key)
    return found


def _file(path: Path, key: str, value: Any) -> Path | None:
    if value is None:
        return None
    if not isinstance(value, str) or Path(value).is_absolute() or ".." in Path(value).parts:
        raise SceneFileError(path, "must be a path inside the file's folder", key=key)
    return path.parent / value


def write_json_sequence(path: Path, frames: list[dict[str, Any]], intrinsics: list[float]) -> None:
    """Write what :func:`read_json_sequence` reads."""
    text = json.dumps({"intrinsics": intrinsics, "frames": frames}, indent=1) + "\n"

    def write(temporary: Path) -> None:
        temporary.write_text(text)

    write_atomically(path, write)
