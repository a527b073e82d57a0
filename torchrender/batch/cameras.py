"""Cameras of a batch: a file with a row for each, a swing about the scene, or a grid through it.

A file is JSON: a list of rows, or an object with ``cameras`` or, as NeRF's ``transforms.json`` has it, ``frames``; or
JSON lines (``.jsonl``). A row is a table of

- ``eye``, ``target`` and, if wanted, ``up``; or ``matrix`` or ``transform_matrix``, from camera to world with x right,
  y up, z backward (OpenGL, Blender, NeRF);
- ``fov`` or ``fov_deg``, the vertical opening angle in degrees; or as instant-ngp and Nerfstudio define them: ``fl_x``
  and ``fl_y``, focal lengths in pixels of pictures of ``w`` x ``h``, or ``camera_angle_x`` and ``camera_angle_y`` in
  radians, and ``cx``, ``cy``, the principal point, in the middle where it is not given;
- ``near`` and ``name`` (or ``file_path``, whose stem is the name), if wanted.

What a row lacks is looked for in the object around the rows. Pictures of another shape than ``w`` x ``h`` keep the
vertical opening angle.
"""

from __future__ import annotations

import itertools
import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path, PurePosixPath
from typing import Any

from torch import Tensor

from torchrender.batch.job import plain_name
from torchrender.errors import InputError, SceneFileError
from torchrender.numerics.transforms import pinhole_matrix
from torchrender.scene.camera import Cameras
from torchrender.scene.cameras.doors import focal_length
from torchrender.scene.model import Scene, resized

USUAL_FOV = 50.0
LENS = ("fov", "fov_deg", "fl_x", "fl_y", "camera_angle_x", "camera_angle_y")
"""How wide a camera sees, the first that is there: a row that says one takes none from the object around."""
AROUND = frozenset({*LENS, "cx", "cy", "w", "h", "near", "up"})
KNOWN = AROUND | {"eye", "target", "matrix", "transform_matrix", "name", "file_path"}
DISTORTION = ("k1", "k2", "k3", "k4", "k5", "k6", "p1", "p2")
"""Of lenses, as OpenCV names it; none where it is 0."""
PINHOLES = ("OPENCV", "PINHOLE", "SIMPLE_PINHOLE", "PERSPECTIVE")
GRID_TURNS = ("east", "north", "west", "south")


MOST_CAMERAS = 250_000
"""Of one batch: their names and poses are in memory, and written into its manifest."""


def check_count(count: int, what: str) -> None:
    """Refuse more cameras than a batch may have.

    Raises:
        InputError: names ``what`` has so many, and the limit.
    """
    if count > MOST_CAMERAS:
        raise InputError(f"{what} has {count} cameras, a batch at most {MOST_CAMERAS}")


@dataclass(frozen=True, eq=False)
class CameraRows:
    """Cameras with their names, and the rows that are none."""

    cameras: Cameras
    names: tuple[str, ...]
    bad: tuple[str, ...]  # "row 17: why"
    not_used: tuple[str, ...]  # keys of rows, and of the object around them, that nobody reads


def read_cameras(path: str | Path, *, width: int, height: int) -> CameraRows:
    """The cameras of a file, of one size; rows that are wrong are left out and named.

    Raises:
        SceneFileError: no such file, no JSON, no rows, or not one right row.
    """
    path = Path(path)
    try:
        text = path.read_text(encoding="utf-8-sig")
    except FileNotFoundError as error:
        raise SceneFileError(path, "no such file") from error
    except IsADirectoryError as error:
        raise SceneFileError(path, "is a folder, not a file") from error
    except OSError as error:
        raise SceneFileError(path, error.strerror or str(error)) from error
    except UnicodeDecodeError as error:
        raise SceneFileError(path, f"is no text ({error})") from error
    made: list[Cameras] = []
    names: list[str] = []
    bad: list[str] = []
    seen: set[str] = set()
    unused: dict[str, None] = {}
    rows, around = _rows(path, text)
    unused |= dict.fromkeys(_unused(around, AROUND))
    for number, row in enumerate(rows):
        try:
            if not isinstance(row, Mapping):
                raise InputError(f"must be a table, is {str(row)[:40]!r}")
            name = _name(row, number)
            if name.casefold() in seen:
                raise InputError(f"name {name!r} is there twice")
            wide = () if row.keys().isdisjoint(LENS) else LENS
            kept = {key: value for key, value in around.items() if key not in wide}
            camera = _camera({**kept, **row}, width, height)
        except (InputError, TypeError, ValueError, OverflowError) as error:
            bad.append(f"row {number}: {error}")
            continue
        unused |= dict.fromkeys(_unused(row, KNOWN))
        seen.add(name.casefold())
        made.append(camera)
        names.append(name)
    if not made:
        raise SceneFileError(path, f"holds no camera that can be used ({bad[0]})" if bad else "holds no cameras")
    return CameraRows(Cameras.cat(made), tuple(names), tuple(bad), tuple(unused))


def grid_cameras(scene: Scene, cells: tuple[int, int, int], *, width: int, height: int) -> CameraRows:
    """Four views, a quarter turn apart, from the middle of each cell of a grid through the scene's box.

    Raises:
        InputError: a cell count below 1, more than ``MOST_CAMERAS`` cameras, or a scene without extent.
    """
    if min(cells) < 1:
        raise InputError(f"a grid has at least one cell each way, got {'x'.join(map(str, cells))}")
    check_count(len(GRID_TURNS) * math.prod(cells), f"a grid of {'x'.join(map(str, cells))} cells")
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


def _unused(table: Mapping[str, Any], known: frozenset[str]) -> list[str]:
    """Keys that say something and are not used: distortion of 0 and pinhole cameras are what everybody takes."""
    silent = {key for key in DISTORTION if table.get(key) == 0}
    if table.get("camera_model") in PINHOLES:
        silent.add("camera_model")
    if not table.keys().isdisjoint(("fov", "fov_deg")):
        known = known - {*LENS[2:]}
    return [key for key in table if key not in known and key not in silent]


def _line(text: str) -> Any:
    try:
        return json.loads(text)
    except ValueError as error:
        return f"no JSON: {error}"


def _rows(path: Path, text: str) -> tuple[list[Any], dict[str, Any]]:
    """The rows, and the object around them without those."""
    if path.suffix.lower() == ".jsonl":
        return [_line(line) for line in text.splitlines() if line.strip()], {}
    try:
        found = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise SceneFileError(path, f"is no JSON ({error})") from error
    around: dict[str, Any] = {}
    if isinstance(found, Mapping):
        key = next((key for key in ("cameras", "frames") if key in found), None)
        if key is None:
            raise SceneFileError(path, "must hold a list of cameras, or a table with cameras or frames")
        around = {name: value for name, value in found.items() if name != key}
        found = found[key]
    if not isinstance(found, list):
        raise SceneFileError(path, "the cameras must be a list")
    return found, around


def _name(row: Mapping[str, Any], number: int) -> str:
    if "name" in row:
        name = row["name"]
        if not isinstance(name, str):
            raise InputError(f"name must be text, got {name!r}")
    elif "file_path" in row:
        name = PurePosixPath(str(row["file_path"]).replace("\\", "/")).stem
    else:
        return f"{number:06d}"
    if not plain_name(name):
        raise InputError(f"name {name!r} is no plain file name")
    return name


def _camera(row: Mapping[str, Any], width: int, height: int) -> Cameras:
    near: dict[str, Any] = {"near": _number(row, "near")} if "near" in row else {}
    size = (round(_number(row, "w")), round(_number(row, "h"))) if {"w", "h"} <= row.keys() else None
    lens = _intrinsics(row, *(size or (width, height)), measured=size is not None)
    sides: dict[str, Any] = dict(zip(("width", "height"), size or (width, height), strict=True))
    matrix = row.get("matrix", row.get("transform_matrix"))
    if matrix is not None:
        return resized(Cameras.from_opengl(matrix, K=lens, **sides, **near), width, height)
    eye, target = (_vector(row, name) for name in ("eye", "target"))
    up = _vector(row, "up") if "up" in row else [0.0, 1.0, 0.0]
    made = Cameras.look_at(eye, target, up=up, fov_deg=USUAL_FOV, **sides, **near)
    return resized(replace(made, intrinsics=lens[None]), width, height)


def _intrinsics(row: Mapping[str, Any], width: int, height: int, *, measured: bool) -> Tensor:
    """(3,3) in pixels of pictures of this size; ``measured``: it is that which the row names.

    Raises:
        InputError: numbers of pixels without the size of the picture that they are of.
    """
    pixels = [name for name in ("fl_x", "fl_y", "cx", "cy") if name in row]
    kind = next((name for name in LENS if name in row), "fov_deg")
    if kind.startswith("fov"):
        across = down = focal_length(kind, _number(row, kind) if kind in row else USUAL_FOV, height)
        pixels = [name for name in pixels if name.startswith("c")]
    elif kind.startswith("fl"):
        across = _number(row, kind)
        down = _number(row, "fl_y") if "fl_y" in row else across
    else:
        sides = {"camera_angle_x": width, "camera_angle_y": height}
        focal = {
            name: focal_length(f"{name} in degrees", math.degrees(_number(row, name)), sides[name])
            for name in sides
            if name in row
        }
        across = focal[kind]
        # Pixels are square, but in pictures whose size says otherwise.
        down = focal.get("camera_angle_y", across) if measured else across
    if pixels and not measured:
        raise InputError(f"{pixels[0]} needs w and h, the size of the picture whose pixels it counts")
    middle = (_number(row, "cx") if "cx" in row else width / 2, _number(row, "cy") if "cy" in row else height / 2)
    return pinhole_matrix(across, down, *middle)


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
