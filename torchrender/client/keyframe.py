"""A keyframe of a stream, put together from its messages."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from torchrender.buffers import DepthImages
from torchrender.wire.containers import KeyframeImage, depth_images_of


@dataclass(frozen=True, eq=False)
class StreamedKeyframe:
    """One keyframe: the picture of a camera and extra layers around it."""

    id: int
    pose: int  # number of the pose that asked for it, -1: none
    still: bool  # a refinement of a view that stands still
    samples: int  # pictures whose mean its colours are
    scene_s: float | None  # seconds into the scene's animation; None: it stands as its file does
    revision: int  # of a scene that its program changes
    images: tuple[KeyframeImage, ...]  # layer 0 first
    mirror: KeyframeImage | None  # what the mirrors of layer 0 show, where it seems to be
    plan: Mapping[str, Any] | None  # what ran and why
    bytes: int  # of all messages
    latency_ms: float  # from sending the pose to having decoded layer 0

    def depth_images(self) -> DepthImages:
        """All layers (N,H,W) as depth images of the package; sky is a surface very far away."""
        return depth_images_of(self.images)


def keyframe_of(parts: Sequence[tuple[KeyframeImage, int]], latency_ms: float) -> StreamedKeyframe:
    """The keyframe of all its messages, layer 0 first, each with its bytes."""
    first = parts[0][0].header
    return StreamedKeyframe(
        id=first.id,
        pose=first.pose,
        still=first.still,
        samples=first.samples,
        scene_s=first.scene_s,
        revision=first.revision,
        images=tuple(p for p, _ in parts if not p.header.mirrors),
        mirror=next((p for p, _ in parts if p.header.mirrors), None),
        plan=first.plan,
        bytes=sum(size for _, size in parts),
        latency_ms=latency_ms,
    )
