"""Cameras of a batch: a file with a row for each, a swing about the scene, or a grid through it.

A file is JSON: a list of rows, or an object with ``cameras`` or, as NeRF's ``transforms.json`` has it, ``frames``; or
JSON lines (``.jsonl``). A row is a table of

- ``eye``, ``target`` and, if wanted, ``up``; or ``matrix`` or ``transform_matrix``, from camera to world with x right,
  y up, z backward (OpenGL, Blender, NeRF);
- ``fov`` or ``fov_deg``, the vertical opening angle in degrees, or ``camera_angle_x``, the horizontal one in radians;
- ``near`` and ``name`` (or ``file_path``, whose stem is the name), if wanted.

What a row lacks is looked for in the object around the rows.
"""

from __future__ import annotations

import itertools
import json
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any

from torchrender.batch.job import plain_name
from torchrender.errors import InputError, SceneFileError
from torchrender.scene.camera import Cameras
from torchrender.scene.model import Scene

USUAL_FOV = 50.0
KNOWN = frozenset(
    {
        "eye",
        "target",
        "up",
        "matrix",
        "transform_matrix",
        "fov",
        "fov_deg",
        "camera_angle_x",
        "near",
        "name",
        "file_path",
    }
)
GRID_TURNS = ("east", "north", "west", "south")


@dataclass(frozen=True, eq=False)
class CameraRows:
    """Cameras with their names, and the rows that are none."""

    cameras: Cameras
    names: tuple[str, ...]
    bad: tuple[str, ...]  # "row 17: why"
    not_used: tuple[str, ...]  # keys of rows that nobody reads


def read_cameras(path: str | Path, *, width: int, height: int) -> CameraRows:
    """The cameras of a file, of one size; rows that are wrong are left out and named.

    Raises:
        SceneFileError: no such file, no JSON, no rows, or not one right row.
    """
    path = Path(path)
    try:
        text = path.read_text(encoding="utf-8")
    except FileNotFoundError as error:
        raise SceneFileError(path, "no such file") from error
    except (OSError, UnicodeDecodeError) as error:
        raise SceneFileError(path, str(error)) from error
    made: list[Cameras] = []
    names: list[str] = []
    bad: list[str] = []
    seen: set[str] = set()
    unused: dict[str, None] = {}
    for number, row, around in _rows(path, text):
        try:
            if not isinstance(row, Mapping):
                raise InputError(f"must be a table, is {str(row)[:40]!r}")
            name = _name(row, number)
            if name.casefold() in seen:
                raise InputError(f"name {name!r} is there twice")
            camera = _camera({**around, **row}, width, height)
        except (InputError, TypeError, ValueError, OverflowError) as error:
            bad.append(f"row {number}: {error}")
            continue
        unused |= dict.fromkeys(key for key in row if key not in KNOWN)
        seen.add(name.casefold())
        made.append(camera)
        names.append(name)
    if not made:
        raise SceneFileError(path, f"holds no camera that can be used ({bad[0]})" if bad else "holds no cameras")
    return CameraRows(Cameras.cat(made), tuple(names), tuple(bad), tuple(unused))


def grid_cameras(scene: Scene, cells: tuple[int, int, int], *, width: int, height: int) -> CameraRows:
    """Four views, a quarter turn apart, from the middle of each cell of a grid through the scene's box.

    Raises:
        InputError: a cell count below 1, or a scene without extent.
    """
    if min(cells) < 1:
        raise InputError(f"a grid has at least one cell each way, got {'x'.join(map(str, cells))}")
    low, high = (corner.tolist() for corner in scene.bounds)
    far = scene.diagonal
    if not far > 0:
        raise InputError("the scene has no extent that a grid could be laid through")
    made, names = [], []
    for cell in itertools.product(*map(range, cells)):
        eye = [a + (b - a) * (at + 0.5) / n for a, b, at, n in zip(low, high, cell, cells, strict=True)]
        for turn, side in enumerate(GRID_TURNS):
            angle = turn * math.pi / 2
            ahead = [eye[0] + math.cos(angle) * far, eye[1], eye[2] - math.sin(angle) * far]
            near = 1e-4 * far
            made.append(Cameras.look_at(eye, ahead, width=width, height=height, fov_deg=USUAL_FOV, near=near))
            names.append("_".join(f"{at:03d}" for at in cell) + f"_{side}")
    return CameraRows(Cameras.cat(made), tuple(names), (), ())


def _rows(path: Path, text: str) -> Iterator[tuple[int, Any, Mapping[str, Any]]]:
    """Number, content and surroundings of each row."""
    if path.suffix.lower() == ".jsonl":
        for number, line in enumerate(line for line in text.splitlines() if line.strip()):
            try:
                yield number, json.loads(line), {}
            except ValueError as error:
                yield number, f"no JSON: {error}", {}
        return
    try:
        found = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise SceneFileError(path, f"is no JSON ({error})") from error
    around: Mapping[str, Any] = {}
    if isinstance(found, Mapping):
        key = next((key for key in ("cameras", "frames") if key in found), None)
        if key is None:
            raise SceneFileError(path, "must hold a list of cameras, or a table with cameras or frames")
        around = {name: value for name, value in found.items() if name in ("fov", "camera_angle_x", "near", "up")}
        found = found[key]
    if not isinstance(found, list):
        raise SceneFileError(path, "the cameras must be a list")
    for number, row in enumerate(found):
        yield number, row, around


def _name(row: Mapping[str, Any], number: int) -> str:
    if "name" in row:
        name = str(row["name"])
    elif "file_path" in row:
        name = PurePosixPath(str(row["file_path"]).replace("\\", "/")).stem
    else:
        return f"{number:06d}"
    if not plain_name(name):
        raise InputError(f"name {name!r} is no plain file name")
    return name


def _camera(row: Mapping[str, Any], width: int, height: int) -> Cameras:
    near: dict[str, Any] = {"near": _number(row, "near")} if "near" in row else {}
    angle: dict[str, Any] = {"fov_deg": USUAL_FOV}
    named = next((name for name in ("fov", "fov_deg") if name in row), None)
    if named is not None:
        angle = {"fov_deg": _number(row, named)}
    elif "camera_angle_x" in row:
        angle = {"fov_x_deg": math.degrees(_number(row, "camera_angle_x"))}
    matrix = row.get("matrix", row.get("transform_matrix"))
    if matrix is not None:
        return Cameras.from_opengl(matrix, width=width, height=height, **angle, **near)
    eye, target = (_vector(row, name) for name in ("eye", "target"))
    up = _vector(row, "up") if "up" in row else [0.0, 1.0, 0.0]
    if "fov_x_deg" in angle:
        half = math.tan(math.radians(angle["fov_x_deg"]) / 2) * height / width
        angle = {"fov_deg": math.degrees(2 * math.atan(half))}
    return Cameras.look_at(eye, target, up=up, width=width, height=height, **angle, **near)


def _number(row: Mapping[str, Any], name: str) -> float:
    value = row[name]
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise InputError(f"{name} must be a finite number, is {str(value)[:40]}")
    return float(value)


def _vector(row: Mapping[str, Any], name: str) -> list[float]:
    value = row.get(name)
    if value is None:
        raise InputError(f"{name} is missing")
    right = isinstance(value, list) and len(value) == 3
    if not right or not all(isinstance(v, int | float) and math.isfinite(v) for v in value):
        raise InputError(f"{name} must be three finite numbers, is {str(value)[:60]}")
    return [float(v) for v in value]
