"""HELLO and WELCOME: what both sides can do."""

from __future__ import annotations

from torchrender.wire.errors import ProtocolError
from torchrender.wire.messages import CREDITS, MAJOR, Hello, Welcome
from torchrender_service.settings import Settings
from torchrender_service.streams.sessions import Session

MAX_MESSAGE_BYTES = 65536
"""From clients."""


def check_hello(hello: Hello) -> None:
    """Whether there is a common version and codec.

    Raises:
        ProtocolError: names what is missing.
    """
    low, high = hello.versions
    if not low <= MAJOR <= high:
        raise ProtocolError(f"versions must include {MAJOR}, got {low} to {high}")
    if "pz1" not in hello.depth or "jpeg" not in hello.color:
        raise ProtocolError("depth must include pz1 and color must include jpeg")


def welcome_of(session: Session, settings: Settings, ticket: str, max_pixels: int) -> Welcome:
    """The answer to HELLO. ``ticket`` opens the next connection, ``max_pixels`` bounds a keyframe picture."""
    facts = session.facts
    limits = {
        "max_pixels": max_pixels,
        "max_message_bytes": MAX_MESSAGE_BYTES,
        "resume_s": settings.resume_s,
        "stall_s": settings.stall_s,
        "overscan": session.overscan,
        "layers": session.extra_layers,
    }
    return Welcome(
        version=MAJOR,
        session=session.id,
        resume=ticket,
        credits=CREDITS,
        limits=limits,
        scene={"id": session.scene.id}
        | {k: facts[k] for k in ("name", "triangles", "diagonal", "bounds")}
        | {"animations": facts.get("animations", {}), "controls": facts.get("controls", "walk")},
        camera=session.camera,
    )
