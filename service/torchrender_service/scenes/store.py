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
import logging
import os
import re
import secrets
import shutil
import time
from collections.abc import AsyncIterator, Callable, Iterator
from pathlib import Path
from typing import Any

from filelock import FileLock, Timeout

from torchrender.errors import OptionError
from torchrender_service.errors import ServiceError
from torchrender_service.renderers.contract import RendererPool
from torchrender_service.renderers.jobs import Describe, Forget, SceneSource, Validate
from torchrender_service.scenes.built_in import built_in_facts
from torchrender_service.scenes.folder import KINDS, UNFINISHED, finish, read_facts
from torchrender_service.scenes.storage import SharedStorage
from torchrender_service.settings import Settings

LOG = logging.getLogger("torchrender_service.scenes.store")
_HASH = re.compile(r"[0-9a-f]{64}")
SCENE_SHARE = 4
"""The textures of a scene may fill one in so many parts of a renderer's memory."""
TEXEL_BYTES = 22
"""Of a decoded texel with its smaller copies: four numbers of four bytes, and a third of that again."""
UNPACKED = 8
"""Times the bytes of the largest upload that an archive may unpack to."""
LOOK_S = 0.5
"""Between two looks at which scenes the shared storage holds."""


class SceneStore:
    """All scenes that can be rendered.

    Where there is a shared storage, this one's folder holds copies of what renderers have needed: on a miss and on
    delete the storage is looked at.

    Args:
        on_gone: called with each scene that was deleted by another replica.
    """

    def __init__(self, settings: Settings, pool: RendererPool, on_gone: Callable[[str], None] | None = None) -> None:
        self._settings = settings
        self._pool = pool
        self._on_gone = on_gone or (lambda _: None)
        self.storage: SharedStorage | None = None
        if settings.shared_storage:
            self.storage = SharedStorage(
                settings.shared_storage, patience_s=settings.storage_s, max_kept_bytes=settings.max_kept_bytes
            )
        self._shared: set[str] = set()  # of the uploads: those that the storage holds
        self._here: set[str] = set()  # those whose files are in the folder
        self._coming: dict[str, asyncio.Task[None]] = {}
        self._looked = -LOOK_S
        self._folder = Path(settings.data_dir) / "scenes"
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
            if folder.name.startswith(UNFINISHED):
                shutil.rmtree(folder, ignore_errors=True)
            elif _HASH.fullmatch(folder.name):
                facts = read_facts(folder)
                if facts is None:
                    LOG.warning("scene folder is not usable", extra={"scene": folder.name})
                else:
                    self._uploads[folder.name] = facts
                    self._here.add(folder.name)

    @property
    def version(self) -> str:
        """Changes whenever the list of scenes does."""
        return hashlib.sha256("\n".join([*self.names, str(self._revisions)]).encode()).hexdigest()[:32]

    @property
    def names(self) -> list[str]:
        """Ids of all scenes."""
        uploads = self._uploads if self.storage is None else sorted(self._uploads)  # alike on all replicas
        return [*self._live, *self._settings.built_in, *uploads]

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

    async def find(self, scene: str) -> SceneSource:
        """Where renderers find a scene, which is fetched first where only the shared storage has it.

        Raises:
            ServiceError: 404, or 503 where the storage does not answer.
        """
        if self.storage is not None and scene not in self._here and _HASH.fullmatch(scene):
            task = self._coming.get(scene)
            if task is None:
                task = self._coming[scene] = asyncio.create_task(self._fetch(self.storage, scene))
                task.add_done_callback(lambda _: self._coming.pop(scene, None))
            await asyncio.shield(task)
        return self.source(scene)

    async def refresh(self) -> None:
        """Learn which scenes the shared storage holds, where that was not looked at just now."""
        if self.storage is None or time.monotonic() - self._looked < LOOK_S:
            return
        self._looked = time.monotonic()
        try:
            there = await self.storage.scenes()
            for scene in self._shared - there:
                self._drop(scene)
            for scene in there - set(self._uploads):
                await self._learn(self.storage, scene)
            self._shared |= there & set(self._uploads)
        except ServiceError as error:
            LOG.warning("scenes are listed as they were known: %s", error.detail)

    async def facts(self, scene: str) -> dict[str, Any]:
        """What clients are told about a scene. No renderer is asked.

        Raises:
            ServiceError: 404, or what the shared storage says.
        """
        if scene in self._live:
            return self._live[scene]
        if self.storage is not None and scene not in self._uploads and _HASH.fullmatch(scene):
            await self._learn(self.storage, scene)
        source = self.source(scene)
        if source.path is not None:
            return self._uploads[scene]
        return {"id": scene, "built_in": True, "kind": "procedural", "bytes": 0} | built_in_facts()[scene]

    async def prepare(self, scene: str) -> None:
        """Have a renderer load a scene: the first client that looks at it need not wait. ServiceError: as it says."""
        await self._pool.run(Describe(scene=self.source(scene)))

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
        folder = self._folder / (UNFINISHED + secrets.token_hex(8))
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
        if self.storage is not None and not await self._learn(self.storage, scene):
            self._drop(scene)  # another replica has deleted it
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
        if self.storage is not None:
            await self.storage.put_scene(scene, folder, facts)
            self._shared.add(scene)
        await asyncio.to_thread(finish, folder, facts, self._folder / scene)
        new = scene not in self._uploads
        self._uploads.setdefault(scene, facts)
        self._here.add(scene)
        LOG.info("scene kept", extra={"scene": scene, "bytes": size, "triangles": facts["triangles"]})
        return self._uploads[scene], new

    async def delete(self, scene: str) -> None:
        """Remove an uploaded scene.

        Raises:
            ServiceError: 404, 403 for a built-in scene, 503 where the shared storage does not answer.
        """
        if self.storage is not None and _HASH.fullmatch(scene):
            await self._learn(self.storage, scene)
        if self.source(scene).path is None:
            raise ServiceError(403, "built-in-scene", "built-in scenes cannot be deleted")
        if self.storage is not None:
            await self.storage.delete_scene(scene)
        await asyncio.to_thread(shutil.rmtree, self._take_out(scene), ignore_errors=True)

    async def deleted_elsewhere(self, scene: str) -> None:
        """Another replica says so: look whether it is still gone.

        Raises:
            ServiceError: 503, the shared storage does not answer.
        """
        if self.storage is not None and scene in self._uploads and await self.storage.scene(scene) is None:
            self._drop(scene)

    async def _learn(self, storage: SharedStorage, scene: str) -> bool:
        """Whether it is there; of a scene that was not known the facts are noted."""
        facts = await storage.scene(scene)
        if facts is None:
            return scene in self._uploads and scene not in self._shared
        self._uploads.setdefault(scene, facts)
        self._shared.add(scene)
        return True

    async def _fetch(self, storage: SharedStorage, scene: str) -> None:
        """Copy it here, if it is there."""
        folder = self._folder / (UNFINISHED + secrets.token_hex(8))
        try:
            folder.mkdir()
            facts = await storage.fetch_scene(scene, folder)
            if facts is None:
                return
            await asyncio.to_thread(finish, folder, facts, self._folder / scene)
            self._uploads.setdefault(scene, facts)
            self._shared.add(scene)
            self._here.add(scene)
            LOG.info("scene fetched", extra={"scene": scene, "bytes": facts["bytes"]})
        finally:
            shutil.rmtree(folder, ignore_errors=True)

    def _drop(self, scene: str) -> None:
        """It is gone for all."""
        if scene in self._uploads:
            shutil.rmtree(self._take_out(scene), ignore_errors=True)
            self._on_gone(scene)

    def _take_out(self, scene: str) -> Path:
        """Forget a scene; returns where its files are now, to be deleted."""
        del self._uploads[scene]
        self._here.discard(scene)
        self._shared.discard(scene)
        doomed = self._folder / (UNFINISHED + secrets.token_hex(8))
        with contextlib.suppress(FileNotFoundError):
            os.replace(self._folder / scene, doomed)
        self._pool.forget(Forget(scene=scene))
        return doomed

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
