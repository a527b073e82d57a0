"""Replicas that share a storage: what one keeps, all have; what one deletes, none has; a slow one stops nobody else."""

from __future__ import annotations

import asyncio
import hashlib
import os
import secrets
import threading
import time
from collections.abc import AsyncIterator, Coroutine, Iterator
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import pytest

from service_parts import FakePool
from torchrender.errors import OptionError
from torchrender_service.errors import ServiceError
from torchrender_service.renderers.jobs import Forget, Job
from torchrender_service.scenes.storage import SharedStorage
from torchrender_service.scenes.store import LOOK_S, SceneStore
from torchrender_service.settings import read_settings
from torchrender_service.web.kept import KeptContainers, KeptPhotos

DATA = b'name = "box"\n[[geometry]]\nshape = "box"\n'
SCENE = hashlib.sha256(b"toml" + DATA).hexdigest()


class Inspecting(FakePool):
    """Finds every upload good."""

    async def inspect(self, job: Job, asked: Any = None) -> dict[str, Any]:
        del job, asked
        return {"name": "box", "triangles": 12}


class Replica:
    """The scenes of one replica."""

    def __init__(self, address: str, folder: Path, **settings: Any) -> None:
        self.pool, self.gone = Inspecting(), []
        given = read_settings(None, {}, data_dir=str(folder), shared_storage=address, built_in=[], **settings)
        self.store = SceneStore(given, self.pool, self.gone.append)
        self.store.open()

    async def keep(self, data: bytes = DATA) -> tuple[dict[str, Any], bool]:
        async def body() -> AsyncIterator[bytes]:
            yield data

        return await self.store.keep(body(), "toml", None)


@pytest.fixture(params=["folder", "memory", "s3"])
def address(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[str]:
    if request.param == "folder":
        yield str(tmp_path / "shared")
    elif request.param == "memory":
        import fsspec

        yield "memory://shared"
        fsspec.filesystem("memory").rm("/shared", recursive=True)
    else:
        yield from local_s3()


def local_s3() -> Iterator[str]:
    """An object store in a process of this test."""
    if find_spec("moto") is None or find_spec("s3fs") is None:
        pytest.skip("an object store for tests (moto with its server) and s3fs are not installed")
    import s3fs
    from moto.server import ThreadedMotoServer

    server = ThreadedMotoServer(port=0)
    server.start()
    host, port = server.get_host_and_port()
    before = dict(os.environ)
    os.environ |= {
        "AWS_ACCESS_KEY_ID": "test",
        "AWS_SECRET_ACCESS_KEY": "test",
        "AWS_ENDPOINT_URL": f"http://{host}:{port}",
    }
    try:
        bucket = f"bucket-{port}-{secrets.token_hex(4)}"  # the store outlives its server
        s3fs.S3FileSystem(use_listings_cache=False).mkdir(bucket)
        yield f"s3://{bucket}/torchrender"
    finally:
        os.environ.clear()
        os.environ.update(before)
        s3fs.S3FileSystem.clear_instance_cache()
        server.stop()


def play(work: Coroutine[Any, Any, None]) -> None:
    asyncio.run(asyncio.wait_for(work, 60.0))


def test_what_one_keeps_all_have_and_what_one_deletes_none_has(address: str, tmp_path: Path) -> None:
    async def work() -> None:
        first, second = Replica(address, tmp_path / "1"), Replica(address, tmp_path / "2")
        await second.store.refresh()
        facts, new = await first.keep()
        assert new and facts["id"] == SCENE
        assert await second.store.facts(SCENE) == facts
        source = await second.store.find(SCENE)
        assert source.path is not None and Path(source.path).read_bytes() == DATA
        assert Path(source.path).is_relative_to(tmp_path / "2")
        assert await second.keep() == (facts, False)
        later = Replica(address, tmp_path / "3")
        await later.store.refresh()
        assert later.store.names == [SCENE] and not list((tmp_path / "3" / "scenes").iterdir())
        await later.store.delete(SCENE)
        await second.store.deleted_elsewhere(SCENE)
        assert second.gone == [SCENE] and second.pool.jobs[-1] == (None, Forget(scene=SCENE))
        assert not list((tmp_path / "2" / "scenes").iterdir())
        first.store._looked -= LOOK_S
        await first.store.refresh()
        assert first.gone == [SCENE] and first.store.names == []
        for replica in (first, second, later):
            with pytest.raises(ServiceError, match="there is no scene"):
                await replica.store.find(SCENE)

    play(work())


def test_a_scene_that_came_again_is_not_dropped_for_old_news(address: str, tmp_path: Path) -> None:
    async def work() -> None:
        first, second = Replica(address, tmp_path / "1"), Replica(address, tmp_path / "2")
        await first.keep()
        await second.store.find(SCENE)
        await first.store.delete(SCENE)
        assert (await second.keep())[1], "it is gone for all, whatever this one still has"
        await first.store.deleted_elsewhere(SCENE)
        await second.store.deleted_elsewhere(SCENE)
        assert second.gone == [SCENE] and (await first.store.find(SCENE)).id == SCENE

    play(work())


def test_containers_and_photos_go_by_their_content_and_the_oldest_go(address: str) -> None:
    async def work() -> None:
        storage = SharedStorage(address, patience_s=10.0, max_kept_bytes=64)
        first, second = KeptContainers(64, storage), KeptContainers(64, storage)
        name = await first.put(b"a" * 40)
        assert name == hashlib.sha256(b"a" * 40).hexdigest()
        assert await second.has(name) and await second.get(name) == b"a" * 40
        photos = [KeptPhotos(FakePool(), 64, storage) for _ in range(2)]
        photo = await photos[0].put(b"photo")
        assert (await photos[1].get(photo.name)).data == b"photo"
        await photos[1].drop(photo.name)
        with pytest.raises(ServiceError, match="send it again"):
            await photos[1].get(photo.name)
        await asyncio.sleep(1.05 if address.startswith("s3") else 0.02)  # S3 tells times in whole seconds
        newer = await first.put(b"b" * 30)
        third = KeptContainers(64, storage)
        assert await third.get(newer) == b"b" * 30
        with pytest.raises(ServiceError, match="dropped"):
            await third.get(name)

    play(work())


def test_what_is_not_whole_counts_as_not_there(tmp_path: Path) -> None:
    async def work() -> None:
        shared = tmp_path / "shared"
        first, second = Replica(str(shared), tmp_path / "1"), Replica(str(shared), tmp_path / "2")
        await first.keep()
        home = shared / "scenes" / SCENE
        whole = (home / "whole.json").read_bytes()
        for damage in (b"", whole[:20], b"[]", b'{"facts": 1, "files": {}}'):
            (home / "whole.json").write_bytes(damage)
            with pytest.raises(ServiceError) as none:
                await second.store.find(SCENE)
            assert none.value.status == 404
        (home / "whole.json").write_bytes(whole)
        (home / "scene.toml").write_bytes(DATA[:-3])
        with pytest.raises(ServiceError) as cut:
            await second.store.find(SCENE)
        assert cut.value.status == 404 and not list((tmp_path / "2" / "scenes").iterdir())
        (home / "whole.json").write_bytes(
            whole.replace(b"scene.toml", b"../../../x", 1).replace(b"scene.toml", b"../../../x")
        )
        with pytest.raises(ServiceError, match=r"a file '\.\./\.\./\.\./x'"):
            await second.store.find(SCENE)
        kept = KeptContainers(64, second.store.storage)
        (shared / "kept").mkdir()
        (shared / "kept" / ("0" * 64)).write_bytes(b"something else")
        assert not await kept.has("0" * 64)

    play(work())


def test_slow_storage_is_said_and_keeps_nobody_else_waiting(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    async def work() -> None:
        replica = Replica(str(tmp_path / "shared"), tmp_path / "1", storage_s=0.1)
        storage, go_on = replica.store.storage, threading.Event()
        assert storage is not None
        monkeypatch.setattr(storage._files, "cat_file", lambda _: go_on.wait(30.0))
        with pytest.raises(ServiceError, match="does not answer") as slow:
            await replica.store.find(SCENE)
        assert slow.value.status == 503 and slow.value.retry_after_s is not None
        many = [replica.store.facts(f"{k:064x}") for k in range(20)]
        said = await asyncio.gather(*many, return_exceptions=True)
        assert all(isinstance(one, ServiceError) and one.status == 503 for one in said)
        assert await asyncio.wait_for(asyncio.to_thread(time.monotonic), 5.0), "other threads are free"
        go_on.set()

    play(work())


def test_a_full_storage_is_said_and_nothing_is_kept_by_halves(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    async def work() -> None:
        replica = Replica(str(tmp_path / "shared"), tmp_path / "1")
        assert replica.store.storage is not None

        def full(*_: object) -> None:
            raise OSError(28, os.strerror(28))

        monkeypatch.setattr(replica.store.storage._files, "put_file", full)
        with pytest.raises(ServiceError) as said:
            await replica.keep()
        assert said.value.status == 507 and replica.store.names == []
        assert not list((tmp_path / "1" / "scenes").iterdir())

    play(work())


def test_an_address_that_nobody_knows_is_refused() -> None:
    with pytest.raises(OptionError, match="shared_storage nothing://x cannot be used"):
        SharedStorage("nothing://x", patience_s=1.0, max_kept_bytes=1)
