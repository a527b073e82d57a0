"""Pictures, depth images and films of thousands of cameras, by several processes that can be stopped and go on.

:func:`run` does a whole job on this machine; :class:`Renderer` is the same work as a callable over rows, for data
pipelines such as Ray Data's ``map_batches``.
"""

from torchrender.batch.job import Job, SceneSource
from torchrender.batch.local import Outcome, run
from torchrender.batch.renderer import Renderer

__all__ = ["Job", "Outcome", "Renderer", "SceneSource", "run"]
