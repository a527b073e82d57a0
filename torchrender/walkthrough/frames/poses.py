"""Text files of poses and intrinsics."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from torchrender.errors import CameraError, SceneFileError
from torchrender.numerics.quaternions import rotations
from torchrender.walkthrough.frames.record import Array

MAX_BYTES = 2**26


def read_text(path: Path) -> str:
    """Raises:
    SceneFileError: missing, too large or no text."""
    try:
        if path.stat().st_size > MAX_BYTES:
            raise SceneFileError(path, f"has more than {MAX_BYTES} bytes")
        return path.read_text(encoding="utf-8-sig")
    except FileNotFoundError as error:
        raise SceneFileError(path, "no such file") from error
    except OSError as error:
        raise SceneFileError(path, error.strerror or str(error)) from error
    except UnicodeDecodeError as error:
        raise SceneFileError(path, "is no text") from error


def read_rows(path: Path, width: int | None = None) -> Array:
    """Numbers (N,width) of a text file, # begins a comment; errors name the line."""
    rows = []
    for number, line in enumerate(read_text(path).splitlines(), 1):
        parts = line.split("#")[0].replace(",", " ").split()
        if not parts:
            continue
        try:
            row = [float(part) for part in parts]
        except ValueError as error:
            raise SceneFileError(path, f"line {number}: not a number in {line.strip()[:60]!r}") from error
        if width is not None and len(row) != width:
            raise SceneFileError(path, f"line {number}: {width} numbers are expected, got {len(row)}")
        rows.append(row)
    if len({len(row) for row in rows}) > 1:
        raise SceneFileError(path, "rows have different lengths")
    return np.array(rows, np.float64).reshape(len(rows), -1)


def read_pose(path: Path) -> Array:
    """(4,4) of a file with four rows of four numbers."""
    rows = read_rows(path, 4)
    if rows.shape != (4, 4):
        raise SceneFileError(path, f"a pose has four rows of four numbers, got {len(rows)} rows")
    return rows


def from_quaternion(row: Sequence[float], path: Path) -> Array:
    """(4,4) from x y z qx qy qz qw."""
    x, y, z = row[:3]
    q = np.array(row[3:7], np.float64)
    length = float(np.linalg.norm(q))
    if not 0.5 < length < 2.0:
        raise SceneFileError(path, f"a quaternion has length {length:g}, not 1")
    pose = np.eye(4)
    pose[:3, :3] = rotations(q[None])[0]
    pose[:3, 3] = (x, y, z)
    return pose


def read_pose_rows(path: Path) -> list[Array]:
    """Poses of a file with x y z qx qy qz qw, with the same behind a time, or with 12 or 16 numbers of a matrix a
    row."""
    rows = read_rows(path)
    width = rows.shape[1] if len(rows) else 7
    if width == 4 and len(rows) % 4 == 0:
        return list(rows.reshape(-1, 4, 4))
    if width in (12, 16):
        blocks = rows.reshape(len(rows), -1, 4)
        return [np.concatenate([block[:3], [[0, 0, 0, 1]]]) for block in blocks]
    if width not in (7, 8):
        raise SceneFileError(path, f"a row of poses has 7, 8, 12 or 16 numbers, got {width}")
    return [from_quaternion(row[-7:], path) for row in rows.tolist()]


def read_log(path: Path) -> list[tuple[Array, int]]:
    """World-from-camera poses of an Open3D trajectory, each with the first number of its head line."""
    lines = [line.split() for line in read_text(path).splitlines() if line.strip()]
    if not lines or len(lines) % 5:
        raise SceneFileError(path, f"a trajectory has five lines per pose, got {len(lines)} lines")
    found = []
    for n in range(0, len(lines), 5):
        try:
            head = [int(float(part)) for part in lines[n]]
            pose = np.array([[float(part) for part in line] for line in lines[n + 1 : n + 5]])
        except ValueError as error:
            raise SceneFileError(path, f"pose {n // 5}: not a number") from error
        if pose.shape != (4, 4) or not head:
            raise SceneFileError(path, f"pose {n // 5}: a head line and four rows of four numbers are expected")
        found.append((pose, head[0]))
    return found


def read_tum_list(path: Path) -> list[tuple[float, str]]:
    """Times and file names of rgb.txt or depth.txt, in the order of time."""
    found = []
    for number, line in enumerate(read_text(path).splitlines(), 1):
        parts = line.split("#")[0].split()
        if not parts:
            continue
        try:
            found.append((float(parts[0]), parts[1]))
        except (ValueError, IndexError) as error:
            raise SceneFileError(path, f"line {number}: a time and a file name are expected") from error
        if Path(parts[1]).is_absolute() or ".." in Path(parts[1]).parts:
            raise SceneFileError(path, f"line {number}: {parts[1]!r} lies outside the folder")
    return sorted(found)


def read_tum_trajectory(path: Path) -> tuple[Array, list[Array]]:
    """Times (N,) and poses of groundtruth.txt."""
    rows = read_rows(path, 8)
    return rows[:, 0], [from_quaternion(row[1:], path) for row in rows.tolist()]


def default_intrinsics(values: Sequence[float]) -> Array:
    """(3,3) from fx, fy, cx, cy with pixel centres at whole numbers, as data sets give them; ours lie at +0.5."""
    fx, fy, cx, cy = (float(v) for v in values)
    return np.array([[fx, 0, cx + 0.5], [0, fy, cy + 0.5], [0, 0, 1.0]])


def given_intrinsics(values: object) -> Array:
    """The same from four numbers, or from a 3x3 matrix without skew, that a caller gives.

    Raises:
        CameraError: anything else.
    """
    wanted = "intrinsics must be fx, fy, cx, cy, or [[fx, 0, cx], [0, fy, cy], [0, 0, 1]]"
    try:
        found = np.asarray(values, np.float64)
    except (TypeError, ValueError) as error:
        raise CameraError(f"{wanted}, got {str(values)[:80]}") from error
    if found.shape == (3, 3) and np.array_equal(found[(0, 1, 2, 2, 2), (1, 0, 0, 1, 2)], (0.0, 0.0, 0.0, 0.0, 1.0)):
        found = found[(0, 1, 0, 1), (0, 1, 2, 2)]
    if found.shape != (4,) or not np.isfinite(found).all() or min(found[:2]) <= 0:
        raise CameraError(f"{wanted}, finite and with positive focal lengths, got {found.tolist()}")
    return default_intrinsics(found.tolist())


_FILES = ("intrinsics.txt", "intrinsic.txt", "camera.txt", "calibration.txt", "camera-intrinsics.txt", "camera.json",
          "intrinsic.json", "camera_intrinsic.json", "camera_primesense.json")  # fmt: skip


def read_intrinsics(folder: Path) -> Array | None:
    """(3,3) of the first file of a known name: a 3x3 matrix, fx fy cx cy, or Open3D's JSON; None where there is
    none."""
    file = next((folder / name for name in _FILES if (folder / name).is_file()), None)
    if file is None:
        return None
    if file.suffix == ".json":
        return _json_intrinsics(file)
    rows = read_rows(file)
    if rows.shape == (3, 3) or rows.shape == (4, 4):
        return default_intrinsics((rows[0, 0], rows[1, 1], rows[0, 2], rows[1, 2]))
    if rows.size >= 4 and len(rows) == 1:
        return default_intrinsics(rows[0, :4].tolist())
    raise SceneFileError(file, f"intrinsics are a 3x3 matrix, or fx fy cx cy, got {rows.shape[0]} rows")


def _json_intrinsics(file: Path) -> Array:
    try:
        table = json.loads(read_text(file))
        values = table.get("intrinsic_matrix", table) if isinstance(table, dict) else table
        if isinstance(values, dict):
            return default_intrinsics([values[name] for name in ("fx", "fy", "cx", "cy")])
        m = np.array(values, np.float64).reshape(-1)
        # Open3D writes matrices column by column.
        fx, fy, cx, cy = (m[0], m[4], m[6], m[7]) if m[2] == 0 else (m[0], m[4], m[2], m[5])
        return default_intrinsics((fx, fy, cx, cy))
    except SceneFileError:
        raise
    except (ValueError, KeyError, IndexError, TypeError) as error:
        raise SceneFileError(file, f"no intrinsics in it ({error})") from error
