"""Folders of RGB-D photos: TUM, 7-Scenes, Redwood and other Open3D trajectories, plain pose files, and JSON."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from torchrender.checks import check_class, check_range
from torchrender.errors import SceneFileError
from torchrender.walkthrough.frames.poses import (
    default_intrinsics,
    given_intrinsics,
    read_intrinsics,
    read_log,
    read_pose,
    read_pose_rows,
    read_tum_list,
    read_tum_trajectory,
)
from torchrender.walkthrough.frames.record import Array, CaptureWarning, Frame, RgbdSequence

COLORS = ("color", "rgb", "image", "images", "colour")
PICTURES = (".jpg", ".jpeg", ".png")
DEPTHS = (".png", ".pgm", ".npy", ".tif", ".tiff")
SMALLEST_SCALE, LARGEST_SCALE = 1e-12, 1e7
"""Codes per scene unit: with more, the 65,535 codes of a picture would not reach a hundredth of a unit."""
MAX_TIME_GAP = 0.05
"""Seconds between the photo, its depth and its pose beyond which they do not belong together."""


@dataclass(frozen=True)
class Wishes:
    """What the caller knows better than the folder."""

    intrinsics: Array | None = None  # (3,3), pixel centres at +0.5
    depth_scale: float | None = None


def load_rgbd(
    path: str | Path,
    *,
    intrinsics: Sequence[float] | Sequence[Sequence[float]] | Array | None = None,
    depth_scale: float | None = None,
) -> RgbdSequence:
    """A sequence from a folder, or from a JSON file.

    ``TUM``: rgb.txt, depth.txt, groundtruth.txt (times in seconds, 5000 codes per metre). ``7-Scenes``:
    frame-000000.color.png, .depth.png, .pose.txt (1000 per metre). ``Redwood`` and ``Open3D``: a folder of colour and
    one of depth pictures, and a trajectory .log. Or such folders with ``pose/*.txt`` (4x4, world from camera) or one
    pose.txt (a row x y z qx qy qz qw per frame). intrinsics.txt, camera.json and the like are read where they are.
    ``JSON``: see :func:`read_json_sequence`. Frames are sorted by time or name; those without a pose are left out.

    Args:
        intrinsics: fx, fy, cx, cy in pixels, or their 3x3 matrix; pixel centres at whole numbers, as such data sets
            give them.
        depth_scale: codes of a depth picture per scene unit.

    Raises:
        SceneFileError: nothing of that kind is there, or a file cannot be used; names it and says why.
        CameraError: a pose or intrinsics that are none. OptionError: a ``depth_scale`` outside
            [1e-12, 1e7].
    """
    check_class("path", path, str, Path)
    path = Path(path)
    if depth_scale is not None:
        check_range("depth_scale", depth_scale, SMALLEST_SCALE, LARGEST_SCALE)
    wishes = Wishes(None if intrinsics is None else given_intrinsics(intrinsics), depth_scale)
    if path.suffix.lower() == ".json" and path.is_file():
        return _json_sequence(path, wishes)
    if not path.is_dir():
        raise SceneFileError(path, "no such folder" if not path.exists() else "a sequence is a folder or a .json file")
    foreign = _foreign_json(path)
    for found, read in (*_LAYOUTS[1:], _LAYOUTS[0]) if foreign else _LAYOUTS:
        if found(path):
            if foreign and read is not _read_json:
                told = f"{foreign}: has cameras but no depth, as NeRF programs write it: not used"
                warnings.warn(told, CaptureWarning, stacklevel=2)
            sequence = read(path, wishes)
            break
    else:
        known = "TUM, 7-Scenes, Redwood/Open3D .log, pose files, JSON"
        missing = ""
        if not (path / "depth").is_dir() and any((path / n).is_dir() for n in ("color", "rgb", "image", "pose")):
            missing = ": it has no folder depth with depth pictures"
        raise SceneFileError(path, f"no RGB-D sequence of a known layout is here ({known}){missing}")
    if not sequence:
        raise SceneFileError(path, "holds no frame that has both a picture and a pose")
    return RgbdSequence(tuple(sequence), name=path.resolve().name)


def _json_of(path: Path) -> Path | None:
    for name in ("walkthrough.json", "sequence.json", "frames.json", "transforms.json"):
        if (path / name).is_file():
            return path / name
    return None


def _foreign_json(path: Path) -> Path | None:
    from torchrender.walkthrough.frames.json_file import is_nerf

    file = _json_of(path)
    return file if file is not None and is_nerf(file) else None


def _read_json(path: Path, wishes: Wishes) -> list[Frame]:
    file = _json_of(path)
    assert file is not None
    return list(_json_sequence(file, wishes).frames)


def _json_sequence(file: Path, wishes: Wishes) -> RgbdSequence:
    from torchrender.walkthrough.frames.json_file import read_json_sequence

    sequence = read_json_sequence(file)
    own = {name: value for name, value in vars(wishes).items() if value is not None}
    return replace(sequence, frames=tuple(replace(frame, **own) for frame in sequence.frames))


def _is_tum(path: Path) -> bool:
    return (path / "rgb.txt").is_file() and (path / "depth.txt").is_file() and (path / "groundtruth.txt").is_file()


def _read_tum(path: Path, wishes: Wishes) -> list[Frame]:
    colors, depths = read_tum_list(path / "rgb.txt"), read_tum_list(path / "depth.txt")
    times, poses = read_tum_trajectory(path / "groundtruth.txt")
    depth_times = np.array([t for t, _ in depths])
    k = _intrinsics(path, wishes, (525.0, 525.0, 319.5, 239.5))
    frames, lost = [], []
    for time, name in colors:
        pose = np.abs(times - time).argmin() if len(times) else -1
        if pose < 0 or abs(times[pose] - time) > MAX_TIME_GAP:
            lost.append(name)
            continue
        near = int(np.abs(depth_times - time).argmin()) if len(depths) else -1
        has = near >= 0 and abs(depth_times[near] - time) <= MAX_TIME_GAP
        frames.append(
            Frame(
                name=Path(name).stem,
                world_from_camera=poses[pose],
                intrinsics=k,
                color=path / name,
                depth=path / depths[near][1] if has else None,
                depth_scale=wishes.depth_scale or 5000.0,
                time=time,
            )
        )
    _say_lost(path, lost)
    return sorted(frames, key=lambda f: (f.time or 0.0, f.name))


def _seven_folder(path: Path) -> Path | None:
    for folder in (path, *sorted(p for p in path.iterdir() if p.is_dir() and p.name.startswith("seq"))):
        if any(folder.glob("*.color.png")) and any(folder.glob("*.pose.txt")):
            return folder
    return None


def _read_seven(path: Path, wishes: Wishes) -> list[Frame]:
    folder = _seven_folder(path)
    assert folder is not None
    k = _intrinsics(folder, wishes, (585.0, 585.0, 320.0, 240.0))
    frames, lost = [], []
    for color in sorted(folder.glob("*.color.png")):
        stem = color.name.removesuffix(".color.png")
        pose = folder / f"{stem}.pose.txt"
        if not pose.is_file():
            lost.append(color.name)
            continue
        depth = folder / f"{stem}.depth.png"
        frames.append(
            Frame(
                name=stem,
                world_from_camera=read_pose(pose),
                intrinsics=k,
                color=color,
                depth=depth if depth.is_file() else None,
                depth_scale=wishes.depth_scale or 1000.0,
            )
        )
    _say_lost(path, lost)
    return frames


def _color_folder(path: Path) -> Path | None:
    folder = next((path / name for name in COLORS if (path / name).is_dir()), None)
    return folder if (path / "depth").is_dir() else None


def _log_of(path: Path) -> Path | None:
    logs = sorted(path.glob("*.log"), key=lambda p: (p.name != "trajectory.log", p.name))
    return logs[0] if logs and _color_folder(path) is not None else None


def _pairs(path: Path) -> list[tuple[Path, Path | None]]:
    """Colour pictures in the order of their names, each with its depth picture: of the same name, else the same
    place."""
    folder = _color_folder(path)
    assert folder is not None
    colors = sorted((p for p in folder.iterdir() if p.suffix.lower() in PICTURES), key=_natural)
    depths = sorted((p for p in (path / "depth").iterdir() if p.suffix.lower() in DEPTHS), key=_natural)
    by_name = {p.stem: p for p in depths}
    if colors and not any(c.stem in by_name for c in colors):
        if len(colors) != len(depths):
            raise SceneFileError(
                path, f"{len(colors)} colour and {len(depths)} depth pictures, and their names do not match"
            )
        return list(zip(colors, depths))
    return [(c, by_name.get(c.stem)) for c in colors]


def _natural(path: Path) -> tuple[int, str]:
    digits = "".join(c for c in path.stem if c.isdigit())
    return (int(digits[-12:]) if digits else 0, path.name)


def _read_redwood(path: Path, wishes: Wishes) -> list[Frame]:
    log = _log_of(path)
    assert log is not None
    poses = read_log(log)
    pairs = _pairs(path)
    k = _intrinsics(path, wishes, (525.0, 525.0, 319.5, 239.5))
    if len(poses) > len(pairs):
        raise SceneFileError(log, f"has {len(poses)} poses, there are {len(pairs)} pictures")
    # Three numbers stand before each pose; the first or the last counts frames where some were left out.
    rows = [n for _, n in poses]
    direct = sorted(set(rows)) == sorted(rows) and max(rows) < len(pairs) and len(poses) < len(pairs)
    chosen = [(rows[n] if direct else n, pose) for n, (pose, _) in enumerate(poses)]
    _say_lost(path, [c.name for n, (c, _) in enumerate(pairs) if n not in {row for row, _ in chosen}])
    frames = [
        Frame(
            name=pairs[n][0].stem,
            world_from_camera=pose,
            intrinsics=k,
            color=pairs[n][0],
            depth=pairs[n][1],
            depth_scale=wishes.depth_scale or 1000.0,
        )
        for n, pose in chosen
    ]
    return sorted(frames, key=lambda f: _natural(Path(f.name)))


def _pose_source(path: Path) -> Path | None:
    if _color_folder(path) is None:
        return None
    places = [path / name for name in ("pose", "poses", "pose.txt", "poses.txt", "trajectory.txt")]
    return next((p for p in places if p.exists()), None)


def _read_plain(path: Path, wishes: Wishes) -> list[Frame]:
    source = _pose_source(path)
    assert source is not None
    pairs = _pairs(path)
    k = _intrinsics(path, wishes, (525.0, 525.0, 319.5, 239.5))
    poses: list[Array | None]
    if source.is_dir():
        files = {p.stem: p for p in source.glob("*.txt")}
        poses = [read_pose(files[c.stem]) if c.stem in files else None for c, _ in pairs]
    else:
        rows = read_pose_rows(source)
        if len(rows) != len(pairs):
            raise SceneFileError(source, f"has {len(rows)} poses, there are {len(pairs)} pictures")
        poses = list(rows)
    _say_lost(path, [c.name for (c, _), pose in zip(pairs, poses) if pose is None])
    return [
        Frame(
            name=color.stem,
            world_from_camera=pose,
            intrinsics=k,
            color=color,
            depth=depth,
            depth_scale=wishes.depth_scale or 1000.0,
        )
        for (color, depth), pose in zip(pairs, poses)
        if pose is not None
    ]


def _intrinsics(path: Path, wishes: Wishes, usual: tuple[float, float, float, float]) -> Array:
    if wishes.intrinsics is not None:
        return wishes.intrinsics
    found = read_intrinsics(path)
    if found is not None:
        return found
    fx, fy, cx, cy = usual
    warnings.warn(
        f"{path}: no intrinsics file; fx={fx:g} fy={fy:g} cx={cx:g} cy={cy:g} are taken, as usual for this layout",
        CaptureWarning,
        stacklevel=2,
    )
    return default_intrinsics(usual)


def _say_lost(path: Path, lost: list[str]) -> None:
    if lost:
        shown = ", ".join(lost[:5]) + (", ..." if len(lost) > 5 else "")
        warnings.warn(
            f"{path}: {len(lost)} pictures have no pose and are left out: {shown}", CaptureWarning, stacklevel=2
        )


_LAYOUTS: tuple[tuple[Callable[[Path], object], Callable[[Path, Wishes], list[Frame]]], ...] = (
    (_json_of, _read_json),
    (_is_tum, _read_tum),
    (_seven_folder, _read_seven),
    (_log_of, _read_redwood),
    (_pose_source, _read_plain),
)
"""Asked in this order: whether a folder is of the layout, and how it is read."""
