"""One chunk of a batch: its pictures or arrays, written to files or to one shard."""

from __future__ import annotations

import io
import tarfile
import tempfile
from collections.abc import Iterator
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np

from torchrender.batch.folder import file_record
from torchrender.batch.job import Job
from torchrender.errors import TorchRenderError
from torchrender.images.files import png_bytes, write_atomically, write_bytes
from torchrender.pipeline.history import RenderHistory
from torchrender.raster import rasterize
from torchrender.renderer import render
from torchrender.scene.model import Scene


def make_chunk(scene: Scene, job: Job, chunk: int, folder: Path) -> dict[str, Any]:
    """Render a chunk into the folder; the files appear whole or not at all.

    Returns:
        Its record: number, files with bytes and digests, milliseconds.

    Raises:
        ImageFileError: a file cannot be written.
    """
    begin = perf_counter()
    files = []
    if job.shards:
        files.append(folder / f"shard_{chunk:06d}.tar")
        write_atomically(files[0], lambda path: _write_shard(path, contents(scene, job, chunk)))
    else:
        for name, data in contents(scene, job, chunk):
            files.append(folder / name)
            write_bytes(files[-1], data)
    written = [file_record(file) for file in files]
    return {"chunk": chunk, "files": written, "ms": round(1e3 * (perf_counter() - begin), 1)}


def answer(scene: Scene, job: Job, chunk: int, folder: Path) -> dict[str, Any]:
    """The record of a chunk that was made, or ``failed`` with the reason; ``for_all``: others will fail, too."""
    try:
        return make_chunk(scene, job, chunk, folder)
    except TorchRenderError as error:
        return {"failed": str(error), "chunk": chunk, "for_all": isinstance(error.__cause__, OSError)}
    except MemoryError:
        return {"failed": "out of memory", "chunk": chunk, "for_all": False}


def contents(scene: Scene, job: Job, chunk: int) -> Iterator[tuple[str, bytes]]:
    """Names and bytes of the files of a chunk."""
    options, history = job.options(), RenderHistory() if job.what == "film" else None
    for number in job.rows(chunk):
        camera, name = job.cameras[number], f"{job.names[number]}.{job.format}"
        if job.what == "depth":
            arrays = rasterize(scene, camera, outputs=job.outputs)
            yield name, _npz({key: value[0].numpy() for key, value in arrays.items()})
            continue
        image = render(scene, camera, options=options, history=history)
        history = image.history if job.what == "film" else None
        if job.format == "png":
            yield name, png_bytes(image.displayed()[0])
        else:
            with tempfile.TemporaryDirectory() as place:
                image.save(Path(place) / name)
                yield name, (Path(place) / name).read_bytes()


def _npz(arrays: dict[str, Any]) -> bytes:
    """The same bytes for the same arrays: NumPy's own files hold no time of day."""
    out = io.BytesIO()
    np.savez_compressed(out, **arrays)
    return out.getvalue()


def _write_shard(path: Path, members: Iterator[tuple[str, bytes]]) -> None:
    with tarfile.open(path, "w", format=tarfile.USTAR_FORMAT) as shard:
        for name, data in members:
            told = tarfile.TarInfo(name)
            told.size, told.mtime, told.mode = len(data), 0, 0o644
            shard.addfile(told, io.BytesIO(data))
