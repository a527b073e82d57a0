"""Scenes: the built-in ones, and uploads kept on disk by the hash of their content.

A scene is a folder ``scenes/<sha256>`` with its file and ``facts.json``. It is made under another name and renamed when
it is complete, so that what stands there is always whole; names of clients never become paths. Of a file that the
service was started with there is a link to its folder.
"""

from __future__ import annotations

import asyncio
import contextlib
import errno
import hashlib
import json
import logging
import os
import re
import secrets
import shutil
from collections.abc import AsyncIterator, Iterator
from pathlib import Path
from typing import Any

from filelock import FileLock, Timeout

from torchrender.errors import OptionError
from torchrender_service.errors import ServiceError
from torchrender_service.renderers.contract import RendererPool
from torchrender_service.renderers.jobs import Describe, Forget, SceneSource, Validate
from torchrender_service.settings import Settings

LOG = logging.getLogger("torchrender_service.scenes.store")
KINDS = {"glb": "scene.glb", "toml": "scene.toml", "zip": "scene.zip"}
LINK = "files"
"""In the folder of a scene that the service was started with: a link to where its file lies."""
_HASH = re.compile(r"[0-9a-f]{64}")
_UNFINISHED = ".unfinished-"
_FACTS = "facts.json"
SCENE_SHARE = 4
"""The textures of a scene may fill one in so many parts of a renderer's memory."""
TEXEL_BYTES = 22
"""Of a decoded texel with its smaller copies: four numbers of four bytes, and a third of that again."""
UNPACKED = 8
"""Times the bytes of the largest upload that an archive may unpack to."""
MAX_SHOWN = 80
"""Characters of a name in what an earlier server has kept."""


class SceneStore:
    """All scenes that can be rendered."""

    def __init__(self, settings: Settings, pool: RendererPool) -> None:
        self._settings = settings
        self._pool = pool
        self._folder = Path(settings.data_dir) / "scenes"
        self._built_in: dict[str, asyncio.Task[dict[str, Any]]] = {}
        self._uploads: dict[str, dict[str, Any]] = {}
        self._live: dict[str, dict[str, Any]] = {}  # scenes of a running program, which its renderer holds
        self._revisions: dict[str, int] = {}

    @contextlib.contextmanager
    def own_folder(self) -> Iterator[None]:
        """Keep the data folder for this process: two that write there would destroy each other's uploads.

        Raises:
            OptionError: it cannot be made or written, or another server has it.
        """
        lock = FileLock(self._folder.parent / ".lock")
        try:
            self._folder.mkdir(parents=True, exist_ok=True)
            if not os.access(self._folder, os.W_OK | os.X_OK):
                raise PermissionError(errno.EACCES, os.strerror(errno.EACCES))
            lock.acquire(timeout=0)
        except Timeout:
            detail = f"data_dir {self._settings.data_dir}: another server uses this folder"
            raise OptionError(detail) from None
        except OSError as error:
            detail = f"data_dir {self._settings.data_dir} cannot be used: {error.strerror or error}"
            raise OptionError(detail) from error
        with lock:
            yield

    def open(self) -> None:
        """Read what an earlier process left; remove what it did not finish."""
        self._folder.mkdir(parents=True, exist_ok=True)
        for folder in sorted(self._folder.iterdir()):
            if folder.name.startswith(_UNFINISHED):
                shutil.rmtree(folder, ignore_errors=True)
            elif _HASH.fullmatch(folder.name):
                facts = _read_facts(folder)
                if facts is None:
                    LOG.warning("scene folder is not usable", extra={"scene": folder.name})
                else:
                    self._uploads[folder.name] = facts

    @property
    def version(self) -> str:
        """Changes whenever the list of scenes does."""
        return hashlib.sha256("\n".join([*self.names, str(self._revisions)]).encode()).hexdigest()[:32]

    @property
    def names(self) -> list[str]:
        """Ids of all scenes."""
        return [*self._live, *self._settings.built_in, *self._uploads]

    def revision(self, scene: str) -> int:
        """How often a scene has changed."""
        return self._revisions.get(scene, 0)

    def source(self, scene: str) -> SceneSource:
        """Where renderers find a scene.

        Raises:
            ServiceError: 404.
        """
        if scene in self._live or scene in self._settings.built_in:
            return SceneSource(id=scene)
        if scene in self._uploads:
            facts = self._uploads[scene]
            return SceneSource(id=scene, path=str(self._folder / scene / facts.get("main", KINDS[facts["kind"]])))
        raise ServiceError(404, "no-such-scene", f"there is no scene {scene[:80]!r}")

    async def facts(self, scene: str) -> dict[str, Any]:
        """What clients are told about a scene; a built-in one is built for this once.

        Raises:
            ServiceError: 404, or what the renderer says.
        """
        if scene in self._live:
            return self._live[scene]
        source = self.source(scene)
        if source.path is not None:
            return self._uploads[scene]
        task = self._built_in.get(scene)
        if task is None or (task.done() and (task.cancelled() or task.exception() is not None)):
            task = self._built_in[scene] = asyncio.create_task(self._pool.run(Describe(scene=source)))
        facts = await asyncio.shield(task)
        return {"id": scene, "built_in": True, "kind": "procedural", "bytes": 0} | facts

    def put_live(self, scene: str, facts: dict[str, Any]) -> None:
        """A scene of a running program is there, or has changed."""
        self._revisions[scene] = self._revisions.get(scene, 0) + 1
        self._live[scene] = {"id": scene, "built_in": False, "kind": "live", "bytes": 0} | facts

    def drop_live(self, scene: str) -> None:
        """Its program shows it no longer."""
        self._live.pop(scene, None)

    async def keep(self, body: AsyncIterator[bytes], kind: str, name: str | None) -> tuple[dict[str, Any], bool]:
        """Check an upload and keep it; returns its facts and whether it is new.

        Raises:
            ServiceError: 409 the store is full, 413 too large, 422 not a scene, 507 the disk is full.
        """
        self._check_room(0)
        folder = self._folder / (_UNFINISHED + secrets.token_hex(8))
        try:
            folder.mkdir()
            return await self._keep(body, kind, name, folder)
        except OSError as error:
            if error.errno not in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG):
                raise
            LOG.error("an upload does not fit on the disk", extra={"reason": error.strerror})
            raise ServiceError(507, "disk-full", "the disk of the server is full", retry_after_s=60.0) from error
        finally:
            shutil.rmtree(folder, ignore_errors=True)

    async def _keep(
        self, body: AsyncIterator[bytes], kind: str, name: str | None, folder: Path
    ) -> tuple[dict[str, Any], bool]:
        file = folder / KINDS[kind]
        scene, size = await self._receive(body, file, kind)
        if scene in self._uploads:
            return self._uploads[scene], False
        self._check_room(size)
        settings = self._settings
        texels = settings.memory_mb * 2**20 // SCENE_SHARE // TEXEL_BYTES
        job = Validate(
            path=str(file),
            kind=kind,
            max_triangles=settings.max_triangles,
            max_texture_pixels=min(settings.max_texture_pixels, texels),
            max_bytes=UNPACKED * settings.max_upload_bytes,
        )
        facts = await self._pool.inspect(job)
        facts |= {"id": scene, "built_in": False, "kind": kind, "bytes": size, "name": name or facts["name"]}
        await asyncio.to_thread(_finish, folder, facts, self._folder / scene)
        new = scene not in self._uploads
        self._uploads.setdefault(scene, facts)
        LOG.info("scene kept", extra={"scene": scene, "bytes": size, "triangles": facts["triangles"]})
        return self._uploads[scene], new

    async def delete(self, scene: str) -> None:
        """Remove an uploaded scene.

        Raises:
            ServiceError: 404, or 403 for a built-in scene.
        """
        if self.source(scene).path is None:
            raise ServiceError(403, "built-in-scene", "built-in scenes cannot be deleted")
        del self._uploads[scene]
        doomed = self._folder / (_UNFINISHED + secrets.token_hex(8))
        with contextlib.suppress(FileNotFoundError):
            os.replace(self._folder / scene, doomed)
        self._pool.forget(Forget(scene=scene))
        await asyncio.to_thread(shutil.rmtree, doomed, ignore_errors=True)

    def _check_room(self, more: int) -> None:
        kept = sum(facts["bytes"] for facts in self._uploads.values())
        if len(self._uploads) >= self._settings.max_scenes or kept + more > self._settings.max_store_bytes:
            raise ServiceError(409, "store-full", "the store is full: delete a scene first")

    async def _receive(self, body: AsyncIterator[bytes], file: Path, kind: str) -> tuple[str, int]:
        """Write the body to ``file``; returns the scene's id and size."""
        digest, size, limit = hashlib.sha256(kind.encode()), 0, self._settings.max_upload_bytes
        with file.open("wb") as out:
            async for chunk in body:
                size += len(chunk)
                if size > limit:
                    raise ServiceError(413, "body-too-large", f"scenes may have at most {limit} bytes")
                digest.update(chunk)
                out.write(chunk)
        if not size:
            raise ServiceError(422, "scene-file", "the body is empty")
        return digest.hexdigest(), size


def _read_facts(folder: Path) -> dict[str, Any] | None:
    try:
        facts = json.loads((folder / _FACTS).read_text())
        facts = _cut(dict(facts))
        main = str(facts.get("main", ""))
        file = folder / (main if main.startswith(f"{LINK}/") else KINDS[facts["kind"]])
        whole = facts["id"] == folder.name and file.stat().st_size == facts["bytes"]
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        return None
    return facts if whole else None


def _cut(facts: dict[str, Any]) -> dict[str, Any]:
    """Without names and lists that are longer than clients are shown; earlier servers kept them whole."""
    cut = dict(facts) | {"name": str(facts["name"])[:MAX_SHOWN]}
    cut["cameras"] = [str(name)[:MAX_SHOWN] for name in facts.get("cameras", [])[:64]]
    if "animations" in facts:
        cut["animations"] = {str(name)[:MAX_SHOWN]: s for name, s in list(facts["animations"].items())[:64]}
    return cut


def _finish(folder: Path, facts: dict[str, Any], target: Path) -> None:
    """Make sure that everything is on the disk, then give the folder its name."""
    (folder / _FACTS).write_text(json.dumps(facts))
    for path in (*folder.rglob("*"), folder):
        handle = os.open(path, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)
    # Somebody else has uploaded the same meanwhile: both are the same scene.
    with contextlib.suppress(OSError):
        os.rename(folder, target)
    if not target.is_dir():
        raise ServiceError(503, "store", "the scene cannot be kept: the disk refuses", retry_after_s=10.0)
