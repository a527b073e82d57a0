"""Scenes: the built-in ones, and uploads kept on disk by the hash of their content.

A scene is a folder ``scenes/<sha256>`` with its file and ``facts.json``. It is made under another name and renamed when
it is complete, so that what stands there is always whole; names of clients never become paths.
"""

from __future__ import annotations

import asyncio
import contextlib
import hashlib
import json
import logging
import os
import re
import secrets
import shutil
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Any

from torchrender_service.errors import ServiceError
from torchrender_service.renderers.contract import RendererPool
from torchrender_service.renderers.jobs import Describe, Forget, SceneSource, Validate
from torchrender_service.settings import Settings

LOG = logging.getLogger("torchrender_service.scenes.store")
KINDS = {"glb": "scene.glb", "toml": "scene.toml"}
_HASH = re.compile(r"[0-9a-f]{64}")
_UNFINISHED = ".unfinished-"
_FACTS = "facts.json"
MAX_UPLOADS = 8
"""At a time: each holds a file of the greatest size on the disk before it is judged."""


class SceneStore:
    """All scenes that can be rendered."""

    def __init__(self, settings: Settings, pool: RendererPool) -> None:
        self._settings = settings
        self._pool = pool
        self._folder = Path(settings.data_dir) / "scenes"
        self._built_in: dict[str, asyncio.Task[dict[str, Any]]] = {}
        self._uploads: dict[str, dict[str, Any]] = {}
        self._receiving = 0

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
    def names(self) -> list[str]:
        """Ids of all scenes."""
        return [*self._settings.built_in, *self._uploads]

    def source(self, scene: str) -> SceneSource:
        """Where renderers find a scene.

        Raises:
            ServiceError: 404.
        """
        if scene in self._settings.built_in:
            return SceneSource(id=scene)
        if scene in self._uploads:
            return SceneSource(id=scene, path=str(self._folder / scene / KINDS[self._uploads[scene]["kind"]]))
        raise ServiceError(404, "no-such-scene", f"there is no scene {scene[:80]!r}")

    async def facts(self, scene: str) -> dict[str, Any]:
        """What clients are told about a scene; a built-in one is built for this once.

        Raises:
            ServiceError: 404, or what the renderer says.
        """
        source = self.source(scene)
        if source.path is not None:
            return self._uploads[scene]
        task = self._built_in.get(scene)
        if task is None or (task.done() and (task.cancelled() or task.exception() is not None)):
            task = self._built_in[scene] = asyncio.create_task(self._pool.run(Describe(scene=source)))
        facts = await asyncio.shield(task)
        return {"id": scene, "built_in": True, "kind": "procedural", "bytes": 0} | facts

    async def keep(self, body: AsyncIterator[bytes], kind: str, name: str | None) -> tuple[dict[str, Any], bool]:
        """Check an upload and keep it; returns its facts and whether it is new.

        Raises:
            ServiceError: 409 the store is full, 413 too large, 422 not a scene, 429 too many at a time.
        """
        self._check_room(0)
        if self._receiving >= MAX_UPLOADS:
            raise ServiceError(429, "busy", f"{MAX_UPLOADS} scenes are being uploaded already", retry_after_s=5.0)
        self._receiving += 1
        folder = self._folder / (_UNFINISHED + secrets.token_hex(8))
        try:
            folder.mkdir()
            file = folder / KINDS[kind]
            scene, size = await self._receive(body, file, kind)
            if scene in self._uploads:
                return self._uploads[scene], False
            self._check_room(size)
            limits = (self._settings.max_triangles, self._settings.max_texture_pixels)
            job = Validate(path=str(file), kind=kind, max_triangles=limits[0], max_texture_pixels=limits[1])
            facts = await self._pool.inspect(job)
            facts |= {"id": scene, "built_in": False, "kind": kind, "bytes": size, "name": name or facts["name"]}
            await asyncio.to_thread(_finish, folder, facts, self._folder / scene)
            new = scene not in self._uploads
            self._uploads.setdefault(scene, facts)
            LOG.info("scene kept", extra={"scene": scene, "bytes": size, "triangles": facts["triangles"]})
            return self._uploads[scene], new
        finally:
            self._receiving -= 1
            shutil.rmtree(folder, ignore_errors=True)

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
        whole = facts["id"] == folder.name and (folder / KINDS[facts["kind"]]).stat().st_size == facts["bytes"]
    except (OSError, ValueError, KeyError, TypeError):
        return None
    return dict(facts) if whole else None


def _finish(folder: Path, facts: dict[str, Any], target: Path) -> None:
    """Make sure that everything is on the disk, then give the folder its name."""
    (folder / _FACTS).write_text(json.dumps(facts))
    for path in (*folder.iterdir(), folder):
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
