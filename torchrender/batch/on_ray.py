"""A batch over the machines of a Ray cluster, by Ray Data.

Actors load the scene once and keep it with its trees. They write to the folder themselves, so that it must be one that
all machines see; the process that called notes what is done. Ray makes an actor's chunk again where the actor is lost.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import torch

from torchrender.batch.digest import scene_digest
from torchrender.batch.folder import alone_in, load_job, note
from torchrender.batch.job import Job
from torchrender.batch.local import BatchError, Outcome, Tell, begin
from torchrender.batch.said import Said, collecting, note_said, say_all
from torchrender.batch.work import ChunkMaker
from torchrender.errors import OptionError
from torchrender.extras import check_extra
from torchrender.kernels.threads import limited_threads

Array = np.ndarray[Any, Any]
AUTO = "auto"
"""A cluster that is running, else one on this machine for as long as the batch lasts."""


class ChunkActor:
    """An actor: rows with ``id``, the number of a chunk, become rows with its record as JSON."""

    def __init__(self, folder: str, threads: int) -> None:
        self._folder, self._threads = Path(folder), threads
        torch.set_num_threads(threads)
        self._job, known = load_job(self._folder)
        with collecting({}):  # whoever began the batch has read the scene, too, and was told
            scene = self._job.scene.load()
        self._changed = scene_digest(scene) != known
        self._maker = ChunkMaker(scene, self._job, self._folder)

    def __call__(self, rows: Mapping[str, Array]) -> dict[str, list[str]]:
        with limited_threads(self._threads):
            return {"record": [json.dumps(self._made(int(chunk))) for chunk in rows["id"]]}

    def _made(self, chunk: int) -> dict[str, Any]:
        if self._changed:
            why = f"{self._job.scene.path_or_name} has changed since the batch began, or differs between machines"
            return {"failed": why, "chunk": chunk, "for_all": True}
        return self._maker.answer(chunk)


def run_on_ray(
    job: Job,
    folder: str | Path,
    *,
    address: str = AUTO,
    workers: int | None = None,
    threads: int = 1,
    tell: Tell | None = None,
) -> Outcome:
    """Make what a job asks for, or what is left of it, as :func:`torchrender.batch.run` does, on a Ray cluster.

    Args:
        folder: for the results, on a disk that all machines of the cluster see under this name.
        address: of the cluster, such as ``"ray://host:10001"``; "auto": the one that runs here, else a new one.
        workers: actors at most; default: as many as the cluster has cores for. It starts with one and adds more while
            chunks wait.
        threads: cores of each actor.

    Raises:
        MissingExtraError: Ray is not installed. BatchError: the cluster cannot be reached, or nothing can go on.
        InputError, OptionError, ImageFileError: as :func:`torchrender.batch.run`.
    """
    check_extra("ray", "a batch on a Ray cluster")
    import ray
    import ray.data

    if threads < 1 or (workers is not None and workers < 1):
        raise OptionError(f"workers and threads must be >= 1, got {workers} and {threads}")
    with alone_in(Path(folder)):
        left, done = begin(job, Path(folder), tell)
        if not left:
            return Outcome(done, 0, {}, 0)
        return _run(ray, job, Path(folder), (address, workers, threads), (left, done, tell))


def _run(
    ray: Any,
    job: Job,
    folder: Path,
    where: tuple[str, int | None, int],
    state: tuple[list[int], int, Tell | None],
) -> Outcome:
    address, workers, threads = where
    left, done, tell = state
    own = not ray.is_initialized()
    if own:
        _connect(ray, address)
    try:
        records = _records(ray, folder.absolute(), left, workers or _room(ray, threads), threads)
        return _noted(job, folder, done, records, tell)
    except (ray.exceptions.RayError, ray.data.exceptions.RayDataUserCodeException) as error:
        raise BatchError(f"Ray: {str(error).splitlines()[-1]}; the same call goes on from here") from error
    finally:
        if own:
            ray.shutdown()


def _noted(job: Job, folder: Path, done: int, records: Iterator[dict[str, Any]], tell: Tell | None) -> Outcome:
    failed: dict[int, str] = {}
    said: Said = {}
    made = 0
    for record in records:
        if record.get("for_all"):
            raise BatchError(f"{record['failed']}; {done} of {len(job.cameras)} cameras are done and stay")
        if "failed" in record:
            failed[record["chunk"]] = str(record["failed"])
            continue
        note(folder, record)
        count = len(job.rows(record["chunk"]))
        done, made = done + count, made + count
        note_said(said, record)
        if tell is not None:
            tell(done, len(job.cameras))
    say_all(said)
    return Outcome(done, made, failed, 0)


def _connect(ray: Any, address: str) -> None:
    quiet = {"log_to_driver": False, "logging_level": "ERROR", "configure_logging": False}
    try:
        ray.init(address=None if address == AUTO else address, **quiet)
    except (ConnectionError, RuntimeError, ValueError) as error:
        raise BatchError(f"no Ray cluster at {address} ({error})") from error


def _room(ray: Any, threads: int) -> int:
    return max(1, int(ray.cluster_resources().get("CPU", 1)) // threads)


def _records(ray: Any, folder: Path, left: list[int], workers: int, threads: int) -> Iterator[dict[str, Any]]:
    """Records of chunks as they are done."""
    context = ray.data.DataContext.get_current()
    context.enable_progress_bars = False
    chunks = ray.data.from_items([{"id": chunk} for chunk in left], override_num_blocks=len(left))
    made = chunks.map_batches(
        ChunkActor,
        fn_constructor_args=(str(folder), threads),
        batch_size=1,
        num_cpus=threads,
        compute=ray.data.ActorPoolStrategy(min_size=1, max_size=max(1, min(workers, len(left)))),
    )
    for row in made.iter_rows():
        yield json.loads(row["record"])
