"""A process that makes chunks of a batch: ``python -m torchrender.batch.worker FOLDER THREADS``.

Reads numbers of chunks from its standard input, a line each, and answers each with a line of JSON: its record, or
``failed`` with the reason. It ends when its input does.
"""

from __future__ import annotations

import json
import os
import signal
import sys
from pathlib import Path
from typing import Any


def main(folder: Path, threads: int) -> int:
    """Work until standard input ends."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # a terminal interrupts the whole group; the parent ends this process
    out = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)  # what libraries print is no answer
    import torch

    from torchrender.batch.digest import scene_digest
    from torchrender.batch.folder import load_job
    from torchrender.batch.said import collecting
    from torchrender.batch.work import ChunkMaker
    from torchrender.errors import TorchRenderError

    def tell(message: dict[str, Any]) -> None:
        out.write(json.dumps(message) + "\n")
        out.flush()

    torch.set_num_threads(threads)  # those of kernels follow the environment
    try:
        job, known = load_job(folder)
        with collecting({}):  # whoever began the batch has read the scene, too, and was told
            scene = job.scene.load()
        if scene_digest(scene) != known:
            tell({"failed": f"{job.scene.path_or_name} has changed since the batch began", "for_all": True})
            return 1
    except TorchRenderError as error:
        tell({"failed": str(error), "for_all": True})
        return 1
    tell({"ready": True})
    maker = ChunkMaker(scene, job, folder)
    for line in sys.stdin:
        tell(maker.answer(int(line)))
    return 0


if __name__ == "__main__":
    try:
        code = main(Path(sys.argv[1]), int(sys.argv[2]))
        sys.stderr.flush()
    except BrokenPipeError:  # whoever asked is gone
        code = 1
    os._exit(code)
