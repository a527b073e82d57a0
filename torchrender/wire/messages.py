"""Messages of the protocol ``torchrender.v1``: framing and checked headers. PROTOCOL.md describes them for clients.

One binary message: ``TRDI``, u8 major version, u8 type, u16 flags, u32 header length, all little endian; a msgpack map;
zeros up to a multiple of 8; then blobs, each followed by zeros up to a multiple of 8.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import Annotated, Any, Literal

import msgspec
from msgspec import Meta

from torchrender.wire.errors import ProtocolError
from torchrender.wire.fields import (
    CameraHeader,
    Natural,
    NotNegative,
    Number,
    Positive,
    Text,
    Vector,
    Words,
)
from torchrender.wire.viewing import Effect, Look, Pick, Picked, Status, ToneMap

MAGIC = b"TRDI"
MAJOR = 1
SUBPROTOCOL = "torchrender.v1"
CONTENT_TYPE = "application/vnd.torchrender.keyframes"
CREDITS = 2
MAX_LAYERS = 4
MAX_HEADER_BYTES = 2**20
_FIXED = struct.Struct("<4sBBHI")


class Type(IntEnum):
    """The byte that tells what a message is."""

    HELLO = 1
    WELCOME = 2
    POSE = 3
    KEYFRAME = 4
    ACK = 5
    RESYNC = 6
    ERROR = 7
    BYE = 8
    SETTINGS = 9
    STATUS = 10
    LOOK = 11
    PICK = 12
    PICKED = 13


class Hello(msgspec.Struct, frozen=True, kw_only=True):
    """First message of the client."""

    versions: tuple[int, int]  # lowest and highest major version that it understands
    depth: Words = ("pz1",)
    color: Words = ("jpeg",)
    max_pixels: Annotated[int, Meta(ge=1, le=2**53)] = 2**53  # of one picture
    layers: Natural | None = None  # extra layers that it can show; None: as the session asked for
    mirrors: bool = False  # it can show what mirrors show as a picture of its own
    viewer: bool = False  # it reads STATUS, LOOK and PICKED


class Welcome(msgspec.Struct, frozen=True, kw_only=True):
    """The server's answer to HELLO."""

    version: int
    session: str
    resume: str  # one-use ticket for the next connection of this session
    credits: int  # keyframes that may be without ACK
    limits: dict[str, Any]
    scene: dict[str, Any]
    camera: CameraHeader


class Pose(msgspec.Struct, frozen=True, kw_only=True):
    """Where the client looks from; only the newest counts."""

    seq: Natural
    time_ms: NotNegative  # the client's clock
    camera: CameraHeader
    velocity: Vector = (0.0, 0.0, 0.0)  # scene units per second, world axes
    spin: Vector = (0.0, 0.0, 0.0)  # radians per second about the camera's axes
    moving: bool = True


Bits = Literal[12, 14, 16]
ColorCodec = Literal["jpeg", "webp"]


class DepthBlob(msgspec.Struct, frozen=True, kw_only=True):
    """How the depth blob is to be read."""

    codec: Literal["pz1"]
    bits: Bits
    near: Positive
    length: Natural
    error: NotNegative


class ColorBlob(msgspec.Struct, frozen=True, kw_only=True):
    """How the colour blob is to be read."""

    codec: ColorCodec
    length: Natural


class MaskBlob(msgspec.Struct, frozen=True, kw_only=True):
    """Packed bits, zstd: 1 where there is a sample or sky, 0 where there is nothing."""

    length: Natural


class Keyframe(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """One depth image with colours: layer ``layer`` of the keyframe ``id``."""

    id: Natural
    pose: int  # seq of the pose that asked for it, -1: none
    time_ms: NotNegative = 0.0  # of that pose
    camera: CameraHeader
    layer: Annotated[int, Meta(ge=0, le=255)]
    layers: Annotated[int, Meta(ge=1, le=256)]
    still: bool
    samples: Annotated[int, Meta(ge=1, le=256)] = 1  # pictures whose mean the colours are
    scene_s: NotNegative | None = None  # seconds into the scene's animation; None: it stands as its file does
    revision: Natural = 0  # of a scene that its program changes
    settings: Natural = 0  # seq of the SETTINGS that it follows
    exposure: Number = 0.0  # EV that the colours are displayed with
    tone_map: ToneMap = "none"
    mirrors: bool = False  # light that was mirrored, a part of layer 0's, at the depths where what it shows seems to be
    depth: DepthBlob
    color: ColorBlob
    mask: MaskBlob | None = None
    crc32: Annotated[int, Meta(ge=0, lt=2**32)]
    render_ms: NotNegative
    encode_ms: NotNegative
    plan: dict[str, Any] | None = None


class Ack(msgspec.Struct, frozen=True, kw_only=True):
    """The client shows a keyframe; gives its credit back."""

    id: Natural
    decode_ms: NotNegative = 0.0
    shown_ms: NotNegative = 0.0  # the client's clock
    holes: Annotated[float, Meta(ge=0.0, le=1.0)] = 0.0  # share of pixels without a sample


class Resync(msgspec.Struct, frozen=True, kw_only=True):
    """The client lost track: forget what is in flight, send one fresh keyframe."""

    last: Natural | None = None


class Problem(msgspec.Struct, frozen=True, kw_only=True):
    """What is wrong, as in RFC 9457."""

    type: Text
    title: Text
    status: int
    detail: Text


class Bye(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """The last message of a connection."""

    reason: Text
    retry_after_s: NotNegative | None = None


class Settings(msgspec.Struct, frozen=True, kw_only=True):
    """What the user wants from now on; null: no bound, and of layers and media: as before."""

    budget_ms: Annotated[float, Meta(ge=1.0, le=1e5)] | None = None
    max_error: Annotated[float, Meta(ge=0.0, le=1.0)] | None = None
    layers: Annotated[int, Meta(ge=0, le=MAX_LAYERS)] | None = None
    density: Annotated[float, Meta(ge=0.0, le=100.0)] | None = None  # of all media, as a multiple of their own
    asymmetry: Annotated[float, Meta(ge=-0.99, le=0.99)] | None = None  # of all media: g
    playing: bool | None = None  # the scene's animation goes on, again and again; false: it stops where it is
    seq: Natural = 0  # comes back in the keyframes that follow it
    exposure: Annotated[float, Meta(ge=-64.0, le=64.0)] | Literal["auto", "as_lit"] | None = None  # EV
    tone_map: ToneMap | None = None
    off: Annotated[tuple[Effect, ...], Meta(max_length=16)] | None = None  # effects to leave out


Message = Hello | Welcome | Pose | Keyframe | Ack | Resync | Problem | Bye | Settings | Status | Look | Pick | Picked
CLASSES: dict[Type, type[Message]] = {
    Type.HELLO: Hello,
    Type.WELCOME: Welcome,
    Type.POSE: Pose,
    Type.KEYFRAME: Keyframe,
    Type.ACK: Ack,
    Type.RESYNC: Resync,
    Type.ERROR: Problem,
    Type.BYE: Bye,
    Type.SETTINGS: Settings,
    Type.STATUS: Status,
    Type.LOOK: Look,
    Type.PICK: Pick,
    Type.PICKED: Picked,
}
_TYPES = {cls: kind for kind, cls in CLASSES.items()}
_DECODERS = {kind: msgspec.msgpack.Decoder(cls) for kind, cls in CLASSES.items()}
_ENCODER = msgspec.msgpack.Encoder()


@dataclass(frozen=True)
class Received:
    """A message that was read."""

    message: Message
    blobs: memoryview  # from the first blob to the end of this message
    size: int  # bytes of the whole message


def encode(message: Message, blobs: Sequence[bytes] = ()) -> bytes:
    """The bytes of a message."""
    header = _ENCODER.encode(message)
    parts = [_FIXED.pack(MAGIC, MAJOR, _TYPES[type(message)], 0, len(header)), header]
    parts.append(bytes(-(_FIXED.size + len(header)) % 8))
    for blob in blobs:
        parts += [blob, bytes(-len(blob) % 8)]
    return b"".join(parts)


def padded(blobs: Sequence[bytes]) -> bytes:
    """Blobs as they stand in a message: what the checksum covers."""
    return b"".join(part for blob in blobs for part in (blob, bytes(-len(blob) % 8)))


def decode(data: bytes | memoryview, accept: Sequence[Type] = tuple(Type), *, whole: bool = True) -> Received:
    """Read the message at the start of ``data``.

    Args:
        accept: types that may come; others are an error.
        whole: nothing may follow the message.

    Raises:
        ProtocolError: no message, cut off, another version or type, or a header field out of range; names it.
    """
    data = memoryview(data)
    if len(data) < _FIXED.size:
        raise ProtocolError(f"message must have at least {_FIXED.size} bytes, got {len(data)}", fatal=True)
    magic, major, kind, flags, length = _FIXED.unpack_from(data)
    if magic != MAGIC:
        raise ProtocolError("message must start with TRDI", fatal=True)
    if major != MAJOR:
        raise ProtocolError(f"major version must be {MAJOR}, got {major}", fatal=True)
    if kind not in accept:
        raise ProtocolError(f"message type must be one of {', '.join(t.name for t in accept)}, got {kind}", fatal=True)
    if flags:
        raise ProtocolError(f"flags must be 0, got {flags}", fatal=True)
    if length > MAX_HEADER_BYTES or _FIXED.size + length > len(data):
        raise ProtocolError(
            f"header length must fit into the message and be <= {MAX_HEADER_BYTES}, got {length}", fatal=True
        )
    try:
        message = _DECODERS[Type(kind)].decode(data[_FIXED.size : _FIXED.size + length])
    except (msgspec.MsgspecError, ValueError, OverflowError, RecursionError) as error:
        raise ProtocolError(f"{Type(kind).name}: {_plain(error)}") from error
    _check_finite(message, Type(kind).name)
    start = _FIXED.size + length + -(_FIXED.size + length) % 8
    size = start + sum(n + -n % 8 for n in blob_lengths(message))
    if size > len(data) or (whole and size != len(data)):
        raise ProtocolError(
            f"{Type(kind).name}: header and blobs need {size} bytes, the message has {len(data)}", fatal=True
        )
    return Received(message, data[start:size], size)


def check_message(message: Message) -> None:
    """Find out before a message is sent whether the other side takes it.

    Raises:
        ProtocolError: a field that it would refuse; names it.
    """
    try:
        data = encode(message)
    except (TypeError, ValueError, OverflowError, msgspec.MsgspecError) as error:
        raise ProtocolError(f"{_TYPES[type(message)].name}: {_plain(error)}") from error
    decode(data)


def blob_lengths(message: Message) -> list[int]:
    """Bytes of each blob of a message, without padding."""
    if not isinstance(message, Keyframe):
        return []
    return [blob.length for blob in (message.depth, message.color, message.mask) if blob is not None]


def split_blobs(received: Received) -> list[memoryview]:
    """The blobs of a message, without padding."""
    out, at = [], 0
    for length in blob_lengths(received.message):
        out.append(received.blobs[at : at + length])
        at += length + -length % 8
    return out


def _check_finite(value: object, name: str) -> None:
    """NaN passes every bound: find it."""
    if isinstance(value, float):
        if not math.isfinite(value):
            raise ProtocolError(f"{name} must be finite, got {value}")
    elif isinstance(value, msgspec.Struct):
        for field in value.__struct_fields__:
            _check_finite(getattr(value, field), f"{name}.{field}")
    elif isinstance(value, tuple | list):
        for k, item in enumerate(value):
            _check_finite(item, f"{name}[{k}]")
    elif isinstance(value, dict):
        for key, item in value.items():
            _check_finite(item, f"{name}.{key}")


def _plain(error: Exception) -> str:
    """An error's text without control characters or lone surrogates, of limited length."""
    return str(error).encode("ascii", "backslashreplace").decode()[:300]
