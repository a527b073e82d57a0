"""The folder of a batch: its job, what was made of it so far, and the results.

``job.json`` and ``cameras.npz`` say what is to be made; ``manifest.jsonl`` gets a line for each chunk when all of it is
on disk. A run that is stopped anywhere goes on where the manifest ends.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import torch

from torchrender.batch.job import CAMERAS, JOB, MANIFEST, Job, SceneSource
from torchrender.errors import ImageFileError, InputError, SceneFileError
from torchrender.image import camera_arrays
from torchrender.images.files import write_atomically, write_bytes
from torchrender.scene.camera import Cameras

try:
    import fcntl
except ImportError:  # not on Windows
    fcntl = None  # type: ignore[assignment]

LOCK = ".running"
"""Locked by the process that writes the batch, for as long as it lives."""


@contextlib.contextmanager
def alone_in(folder: Path) -> Iterator[None]:
    """Hold a folder while a batch is written to it.

    Raises:
        InputError: another process writes a batch there. ImageFileError: the folder cannot be written.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        file = (folder / LOCK).open("a")
    except OSError as error:
        raise ImageFileError(folder, error.strerror or str(error)) from error
    with file:
        if fcntl is not None:
            try:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError as error:
                told = "another process writes a batch there now: wait for it, or give another folder"
                raise InputError(f"{folder}: {told}") from error
            except OSError:  # a file system without locks
                pass
        yield


def open_folder(folder: Path, job: Job, scene: str) -> dict[int, dict[str, Any]]:
    """Begin a batch in a folder, or go on with it; returns the records of the chunks that are there, by number.

    Args:
        scene: digest of what the scene's source holds now.

    Raises:
        InputError: the folder holds another batch, or files that results would replace and no batch wrote, or the scene
            has changed since it began.
        ImageFileError: it cannot be written.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ImageFileError(folder, error.strerror or str(error)) from error
    known = _described(folder)
    if known is None:
        _check_free(folder, job)
        _write_cameras(folder, job.cameras)
        text = json.dumps({"key": job.key(), "scene_digest": scene, **job.described()}, indent=1) + "\n"
        write_bytes(folder / JOB, text.encode())
        (folder / MANIFEST).unlink(missing_ok=True)
        return {}
    if known.get("key") != job.key():
        mine = job.described()
        different = [name for name in mine if json.loads(json.dumps(mine[name])) != known.get(name)] or ["cameras"]
        # Cameras that are laid about the scene are others because it is another one.
        if different != ["cameras"] or known.get("scene_digest") == scene:
            raise InputError(f"{folder} holds a batch with other {', '.join(different)}: give another folder")
    if known.get("scene_digest") != scene:
        raise InputError(f"{job.scene.path_or_name} has changed since the batch in {folder} began: give another folder")
    _write_cameras(folder, job.cameras)  # whole, whatever happened to the file
    return {chunk: record for chunk, record in _manifest(folder).items() if _is_there(folder, record)}


def _check_free(folder: Path, job: Job) -> None:
    """Refuse a folder whose files a new batch would write over.

    Raises:
        InputError: names the first.
    """
    there = {entry.name for entry in os.scandir(folder)}
    if job.shards:
        names = [f"shard_{chunk:06d}.tar" for chunk in range(job.chunks)]
    else:
        names = [f"{name}.{job.format}" for name in job.names]
    taken = [name for name in names if name in there]
    if taken:
        more = f" and {len(taken) - 1} more files" if len(taken) > 1 else ""
        raise InputError(f"{folder} holds {taken[0]}{more} that no batch made: give another folder")


def load_job(folder: Path) -> tuple[Job, str]:
    """The job of a folder, and the digest of its scene.

    Raises:
        SceneFileError: a file of the folder is missing or damaged.
    """
    known = _described(folder)
    if known is None:
        raise SceneFileError(folder / JOB, "no such file")
    cameras = _read_cameras(folder / CAMERAS)
    try:
        same = {name: known[name] for name in ("what", "format", "shards", "wishes", "chunk")}
        source = SceneSource(known["scene"]["path_or_name"], known["scene"]["choices"])
        job = Job(source, cameras, tuple(known["names"]), outputs=tuple(known["outputs"]), **same)
        return job, str(known["scene_digest"])
    except (LookupError, TypeError, ValueError) as error:
        raise SceneFileError(folder / JOB, f"is damaged ({error!r})") from error


def _read_cameras(path: Path) -> Cameras:
    try:
        with np.load(path) as arrays:
            width, height = (int(v) for v in arrays["image_size"])
            tensors = {n: torch.from_numpy(arrays[n]) for n in ("camera_from_world", "intrinsics", "near", "far")}
            return Cameras(**tensors, width=width, height=height, orthographic=bool(arrays["orthographic"]))
    except (OSError, EOFError, LookupError, TypeError, ValueError, zipfile.BadZipFile) as error:
        raise SceneFileError(path, f"cannot be read ({error})") from error


def note(folder: Path, record: dict[str, Any]) -> None:
    """Add a chunk to the manifest, for good."""
    with (folder / MANIFEST).open("ab") as file:
        file.write(json.dumps(record).encode() + b"\n")
        file.flush()
        os.fsync(file.fileno())


def file_record(path: Path) -> dict[str, Any]:
    """Name, bytes and digest of a file that was written."""
    with path.open("rb") as file:
        digest = hashlib.file_digest(file, "sha256") if hasattr(hashlib, "file_digest") else _digest(file)
    return {"file": path.name, "bytes": path.stat().st_size, "sha256": digest.hexdigest()}


def _digest(file: Any) -> Any:
    digest = hashlib.sha256()
    for block in iter(lambda: file.read(1 << 20), b""):
        digest.update(block)
    return digest


def _described(folder: Path) -> dict[str, Any] | None:
    try:
        known = json.loads((folder / JOB).read_text())
    except FileNotFoundError:
        return None
    except (OSError, ValueError) as error:
        raise SceneFileError(folder / JOB, f"cannot be read ({error})") from error
    if not isinstance(known, dict):
        raise SceneFileError(folder / JOB, "must hold a table")
    return known


def _manifest(folder: Path) -> dict[int, dict[str, Any]]:
    """Records by chunk. Lines that hold none, of a stopped process or a full disk, count as not there and are left out
    of the file: their chunks are made again."""
    path = folder / MANIFEST
    try:
        text = path.read_bytes()
    except FileNotFoundError:
        return {}
    lines = text.split(b"\n")
    found = {line: _record(line) for line in lines[:-1]}  # after the last end of a line is what was not finished
    whole = b"".join(line + b"\n" for line, record in found.items() if record is not None)
    if whole != text:
        write_bytes(path, whole)
    return {record["chunk"]: record for record in found.values() if record is not None}


def _record(line: bytes) -> dict[str, Any] | None:
    try:
        record = json.loads(line)
        whole = all(isinstance(one["file"], str) and isinstance(one["bytes"], int) for one in record["files"])
        return record if whole and isinstance(record["chunk"], int) else None
    except (LookupError, TypeError, ValueError):
        return None


def _is_there(folder: Path, record: dict[str, Any]) -> bool:
    return all(_size(folder / one["file"]) == one["bytes"] for one in record["files"])


def _size(path: Path) -> int:
    try:
        return path.stat().st_size
    except OSError:
        return -1


def _write_cameras(folder: Path, cameras: Cameras) -> None:
    arrays = {name: value.numpy() for name, value in camera_arrays(cameras).items()}

    def write(path: Path) -> None:
        with path.open("wb") as file:
            np.savez(file, **arrays)  # type: ignore[arg-type]

    write_atomically(folder / CAMERAS, write)
