"""One picture in the making: what its passes ask for."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, Protocol, TypeVar

from torchrender.buffers import GBuffer, RaySurface
from torchrender.pipeline.buffer import Buffer, Layer
from torchrender.pipeline.history import RenderHistory
from torchrender.pipeline.options import RenderOptions
from torchrender.scene.camera import Cameras
from torchrender.scene.model import Scene
from torchrender.shade import SentLight

T = TypeVar("T")


class SampleRenderer(Protocol):
    """The passes of the picture over other samples: see :meth:`Frame.over_hits`."""

    def __call__(self, samples: GBuffer | RaySurface) -> SentLight:
        """Radiance (B,H,W,3) of samples (B,H,W), reflections left out, and how these go into it."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Frame:
    """A picture in the making. Passes read buffers and return what they make; they write nothing else."""

    scene: Scene  # with its lights
    cameras: Cameras  # of the picture
    options: RenderOptions
    history: RenderHistory
    values: Mapping[Buffer[Any], Any]  # made so far
    asked: Mapping[Buffer[Any], frozenset[Buffer[Any]]]  # what is asked for, and by the makers of what
    hits: Callable[[Mapping[Buffer[Any], Any], Mapping[str, Any]], SampleRenderer] = field(repr=False)
    wanted: frozenset[Buffer[Any]] = frozenset()  # asked for from outside
    spare_ms: float = math.inf  # what sensing may take

    @property
    def view(self) -> Cameras:
        """The cameras at the size that is rendered."""
        factor = self.options.supersample
        return self.cameras if factor == 1 else self.cameras.scaled(factor)

    def __getitem__(self, buffer: Buffer[T]) -> T:
        return buffer.checked(self.values[buffer])

    def get(self, buffer: Buffer[T]) -> T | None:
        """A buffer that may not be there."""
        return self[buffer] if buffer in self.values else None

    def askers(self, buffer: Buffer[Any]) -> frozenset[Buffer[Any]]:
        """What the passes that ask for a buffer make of it."""
        return self.asked.get(buffer, frozenset())

    def earlier(self, buffer: Buffer[T]) -> T | None:
        """What an earlier picture left of a buffer, while it still holds."""
        return self.history.get(buffer, self.options)

    def layers(self) -> Iterator[tuple[Layer[Any], Any]]:
        """What is blended into the picture, in order."""
        found = [(buffer.layer, value) for buffer, value in self.values.items() if buffer.layer is not None]
        yield from sorted(found, key=lambda pair: pair[0].order)

    def over_hits(self, given: Mapping[Buffer[Any], Any], **changes: Any) -> SampleRenderer:
        """The same passes, at the settings that they have for the hits of rays, with these buffers at hand.

        Args:
            changes: other values of options, by group: ``ambient={"rays": 2}``.
        """
        return self.hits(given, changes)
