"""Storage that all replicas of a service see: a folder of a shared disk, or an object store such as S3.

Everything in it goes by the hash of its content, so nothing there is ever changed: it comes and goes as a whole.

- ``scenes/<id>/...`` the files of a scene, and ``scenes/<id>/whole.json``, which is written last and deleted first:
  without it, whatever else there is counts as not there.
- ``kept/<id>`` keyframe containers and photos, the oldest going first.
"""

from __future__ import annotations

import asyncio
import contextlib
import errno
import hashlib
import json
import logging
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path, PurePosixPath
from typing import Any, TypeVar

from torchrender.errors import OptionError
from torchrender_service.errors import ServiceError

LOG = logging.getLogger("torchrender_service.scenes.storage")
WHOLE = "whole.json"
THREADS = 8
"""Calls under way: where storage hangs, others are told so and nothing else waits for it."""
PRUNE = 16
"""Kept files are looked through whenever one in so many parts of what they may take was written."""
T = TypeVar("T")


class SharedStorage:
    """What replicas share.

    Args:
        address: a folder, or an address of fsspec such as ``s3://bucket/path``.
        patience_s: seconds for each file that is read or written.
        max_kept_bytes: of all kept files.

    Raises:
        OptionError: the address cannot be used, or the package for it is missing.
    """

    def __init__(self, address: str, *, patience_s: float, max_kept_bytes: int) -> None:
        import fsspec

        try:
            self._files, root = fsspec.core.url_to_fs(address, use_listings_cache=False)
        except (ImportError, ValueError, OSError) as error:
            raise OptionError(f"shared_storage {address} cannot be used: {error}") from error
        self._root = PurePosixPath(root)
        self._patience_s = patience_s
        self._max_kept = max_kept_bytes
        self._written = 0
        self._threads = ThreadPoolExecutor(THREADS, thread_name_prefix="shared-storage")

    async def scenes(self) -> set[str]:
        """Ids of all scenes."""
        return await self._do(self._scenes, 1) or set()

    async def scene(self, name: str) -> dict[str, Any] | None:
        """Facts of a scene; None: there is none."""
        whole = await self._do(lambda: self._whole(name), 1)
        return None if whole is None else dict(whole["facts"])

    async def put_scene(self, name: str, folder: Path, facts: dict[str, Any]) -> None:
        """Keep the files of a scene."""
        files = {file.relative_to(folder).as_posix(): file for file in sorted(folder.rglob("*")) if file.is_file()}

        def put() -> None:
            home = self._root / "scenes" / name
            for relative, file in files.items():
                target = home / relative
                self._files.makedirs(str(target.parent), exist_ok=True)
                self._files.put_file(str(file), str(target))
            sizes = {relative: file.stat().st_size for relative, file in files.items()}
            self._files.pipe_file(str(home / WHOLE), json.dumps({"facts": facts, "files": sizes}).encode())

        await self._do(put, len(files) + 1)

    async def fetch_scene(self, name: str, folder: Path) -> dict[str, Any] | None:
        """Put the files of a scene into a folder; its facts, or None where it is not there, or not whole."""
        whole = await self._do(lambda: self._whole(name), 1)
        if whole is None:
            return None

        def fetch() -> dict[str, Any] | None:
            home = self._root / "scenes" / name
            for relative, size in whole["files"].items():
                target = folder / relative
                if not target.resolve().is_relative_to(folder.resolve()):
                    raise ServiceError(
                        503, "storage", f"the shared storage holds a scene with a file {relative[:80]!r}"
                    )
                target.parent.mkdir(parents=True, exist_ok=True)
                self._files.get_file(str(home / relative), str(target))
                if target.stat().st_size != size:
                    LOG.error("a scene in the shared storage is damaged", extra={"scene": name, "file": relative})
                    return None
            return dict(whole["facts"])

        return await self._do(fetch, len(whole["files"]))

    async def delete_scene(self, name: str) -> None:
        """Delete a scene; none of that name is none deleted."""

        def delete() -> None:
            home = self._root / "scenes" / name
            for path, recursive in ((home / WHOLE, False), (home, True)):
                with contextlib.suppress(FileNotFoundError):
                    self._files.rm(str(path), recursive=recursive)

        await self._do(delete, 2)

    async def put(self, name: str, data: bytes) -> None:
        """Keep a file by the hash of its content; the oldest make room."""

        def put() -> None:
            target = self._root / "kept" / name
            if self._files.exists(str(target)):
                return
            self._files.makedirs(str(target.parent), exist_ok=True)
            self._files.pipe_file(str(target), data)
            self._written += len(data)
            if self._written >= self._max_kept // PRUNE:
                self._written = 0
                self._prune()

        if len(data) <= self._max_kept:
            await self._do(put, 1)

    async def get(self, name: str) -> bytes | None:
        """A kept file; None where there is none."""
        data = await self._do(lambda: self._files.cat_file(str(self._root / "kept" / name)), 1)
        whole = data is not None and hashlib.sha256(data).hexdigest() == name
        return data if whole else None

    async def drop(self, name: str) -> None:
        """Delete a kept file; none of that name is none deleted."""
        await self._do(lambda: self._files.rm(str(self._root / "kept" / name)), 1)

    def close(self) -> None:
        """Begin nothing more."""
        self._threads.shutdown(wait=False, cancel_futures=True)

    def _scenes(self) -> set[str]:
        """Those that are whole."""
        return {PurePosixPath(path).parent.name for path in self._files.glob(str(self._root / "scenes" / "*" / WHOLE))}

    def _whole(self, name: str) -> dict[str, Any] | None:
        try:
            found = dict(json.loads(self._files.cat_file(str(self._root / "scenes" / name / WHOLE))))
        except ValueError:  # it is being written
            return None
        return found if isinstance(found.get("files"), dict) and isinstance(found.get("facts"), dict) else None

    def _prune(self) -> None:
        """Times are those of the storage, compared with each other alone."""
        kept = sorted(self._files.ls(str(self._root / "kept"), detail=True), key=_written_at)
        over = sum(one["size"] for one in kept) - self._max_kept
        for one in kept:
            if over <= 0:
                break
            over -= one["size"]
            with contextlib.suppress(FileNotFoundError):
                self._files.rm(one["name"])

    async def _do(self, work: Callable[[], T | None], files: int) -> T | None:
        """In a thread; None where a file is not there.

        Raises:
            ServiceError: 503, it takes too long or fails; 507, it is full.
        """
        try:
            job = asyncio.get_running_loop().run_in_executor(self._threads, work)
            return await asyncio.wait_for(job, self._patience_s * files)
        except FileNotFoundError:
            return None
        except ServiceError:
            raise
        except asyncio.TimeoutError:
            raise ServiceError(503, "storage", "the shared storage does not answer", retry_after_s=5.0) from None
        except Exception as error:  # each kind of storage has errors of its own
            if isinstance(error, OSError) and error.errno in (errno.ENOSPC, errno.EDQUOT):
                raise ServiceError(507, "disk-full", "the shared storage is full", retry_after_s=60.0) from error
            LOG.error("the shared storage fails", exc_info=error)
            raise ServiceError(503, "storage", "the shared storage fails", retry_after_s=5.0) from error


def _written_at(entry: dict[str, Any]) -> float:
    value = next((entry[key] for key in ("mtime", "LastModified", "created") if entry.get(key) is not None), 0.0)
    return float(value.timestamp() if hasattr(value, "timestamp") else value)
