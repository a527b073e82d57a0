"""One chunk of a batch: its pictures or arrays, written to files or to one shard."""

from __future__ import annotations

import io
import tarfile
import tempfile
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np

from torchrender.batch.folder import file_record
from torchrender.batch.job import Job
from torchrender.batch.said import Said, collecting
from torchrender.errors import TorchRenderError
from torchrender.images.files import png_bytes, write_atomically, write_bytes
from torchrender.pipeline.history import RenderHistory
from torchrender.raster import rasterize
from torchrender.renderer import render
from torchrender.scene.model import Scene


class ChunkMaker:
    """Makes chunks of one job, one after the other.

    What all pictures of a scene share (its tree, what shades hits of rays, the maps and occluders of its lights) is
    made once. It depends on the scene alone: a chunk has the same bytes whatever was made before it.
    """

    def __init__(self, scene: Scene, job: Job, folder: Path) -> None:
        self._scene, self._job, self._folder = scene, job, folder
        self._shared = RenderHistory.alone()
        self._said: Said = {}  # of the chunk that is made

    def answer(self, chunk: int) -> dict[str, Any]:
        """The record of a chunk that was made, or ``failed`` with the reason; ``for_all``: others will fail, too."""
        try:
            return self.make(chunk)
        except TorchRenderError as error:
            return {"failed": str(error), "chunk": chunk, "for_all": isinstance(error.__cause__, OSError)}
        except MemoryError:
            self._shared = RenderHistory.alone()
            return {"failed": "out of memory", "chunk": chunk, "for_all": False}

    def make(self, chunk: int) -> dict[str, Any]:
        """Render a chunk into the folder; the files appear whole or not at all.

        Returns:
            Its record: number, files with bytes and digests, milliseconds, and warnings, if there were some.

        Raises:
            ImageFileError: a file cannot be written.
        """
        begin = perf_counter()
        files, self._said = [], {}
        if self._job.shards:
            files.append(self._folder / f"shard_{chunk:06d}.tar")
            write_atomically(files[0], lambda path: _write_shard(path, self.contents(chunk)))
        else:
            for name, data in self.contents(chunk):
                files.append(self._folder / name)
                write_bytes(files[-1], data)
        written = [file_record(file) for file in files]
        record = {"chunk": chunk, "files": written, "ms": round(1e3 * (perf_counter() - begin), 1)}
        return record | ({"said": self._said} if self._said else {})

    def contents(self, chunk: int) -> Iterator[tuple[str, bytes]]:
        """Names and bytes of the files of a chunk."""
        job, scene = self._job, self._scene
        options, film = job.options(), job.what == "film"
        history = replace(self._shared, sequence=film)
        for number in job.rows(chunk):
            camera, name = job.cameras[number], f"{job.names[number]}.{job.format}"
            if job.what == "depth":
                with collecting(self._said, job.names[number]):
                    arrays = rasterize(scene, camera, outputs=job.outputs)
                yield name, _npz({key: value[0].numpy() for key, value in arrays.items()})
                continue
            with collecting(self._said, job.names[number]):
                image = render(scene, camera, options=options, history=history)
            assert image.history is not None
            self._shared = replace(image.history.shared(), pace=None, pictures=0, drawn=None, sequence=False)
            history = image.history if film else self._shared
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
    with tarfile.open(path, "w", format=tarfile.PAX_FORMAT) as shard:
        for name, data in members:
            told = tarfile.TarInfo(name)
            told.size, told.mtime, told.mode = len(data), 0, 0o644
            shard.addfile(told, io.BytesIO(data))
