"""A client of the service's stream: sends poses, receives depth images as tensors, and reprojects them itself.

``PROTOCOL.md`` of the package ``torchrender_service`` tells what goes over the wire.
"""

from __future__ import annotations

import contextlib
import time
import urllib.parse
from collections import deque
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from types import TracebackType
from typing import Any

import msgspec
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import ClientConnection
from websockets.sync.client import connect as open_socket

from torchrender.checks import as_vector
from torchrender.client.drawing import draw_keyframes
from torchrender.client.keyframe import StreamedKeyframe, keyframe_of
from torchrender.client.mirrors import draw_with_mirrors
from torchrender.client.session import StreamClosed, StreamError, closed, post_session
from torchrender.errors import InputError
from torchrender.reconstruct.reproject import Reprojection, ReprojectOptions
from torchrender.scene.camera import Cameras
from torchrender.wire.cameras import cameras_of, header_of
from torchrender.wire.containers import KeyframeImage, decode_keyframe
from torchrender.wire.errors import CodecError, ProtocolError
from torchrender.wire.messages import (
    MAJOR,
    SUBPROTOCOL,
    Ack,
    Bye,
    Hello,
    Keyframe,
    Message,
    Pose,
    Problem,
    Received,
    Resync,
    Settings,
    Type,
    Welcome,
    check_message,
    decode,
    encode,
    split_blobs,
)

MAX_MESSAGE_BYTES = 2**26
FROM_SERVER = (Type.WELCOME, Type.KEYFRAME, Type.ERROR, Type.BYE)


class StreamClient:
    """A stream of depth images of one scene, a context manager. Use :meth:`connect`.

    Attributes:
        camera: where the view starts.
        scene: what the service says about the scene.
        limits: of the stream.
        kept: the newest keyframes, oldest first.
    """

    def __init__(self, socket: ClientConnection, open_: ExitStack, session: Mapping[str, Any], keep: int) -> None:
        self._socket = socket
        self._open_parts = open_
        self._number = 0
        self._sent: dict[int, float] = {}
        self._parts: list[tuple[KeyframeImage, int]] = []
        self._first_ms = 0.0
        self.session = dict(session)
        self.kept: deque[StreamedKeyframe] = deque(maxlen=keep)
        self._send(Hello(versions=(MAJOR, MAJOR), color=("jpeg", "webp"), mirrors=True))
        welcome = self._next(30.0).message
        if not isinstance(welcome, Welcome):
            raise StreamError(f"the service answered HELLO with {type(welcome).__name__}")
        self.camera: Cameras = cameras_of(welcome.camera)
        self.scene, self.limits, self.resume_ticket = welcome.scene, welcome.limits, welcome.resume

    @classmethod
    def connect(
        cls,
        url: str,
        scene: str,
        *,
        size: tuple[int, int] = (640, 360),
        api_key: str | None = None,
        keep: int = 2,
        timeout_s: float = 60.0,
        **wishes: Any,
    ) -> StreamClient:
        """Make a session and open its stream.

        Args:
            url: of the service, such as ``http://127.0.0.1:8000``.
            scene: id of a scene there.
            size: width and height of the view, pixels.
            keep: keyframes that :meth:`view` draws from.
            timeout_s: for the service to answer; a scene that is not loaded yet takes seconds.
            wishes: ``camera``, ``layers``, ``overscan``, ``budget_ms``, ``max_error`` as in ``POST /v1/sessions``.

        Raises:
            StreamError: the service refuses or cannot be reached. InputError: another kind of address.
        """
        parts = urllib.parse.urlsplit(url)
        if parts.scheme not in ("http", "https") or not parts.netloc:
            raise InputError(f"url must look like http://127.0.0.1:8000, got {url!r}")
        body = {"scene": scene, "width": size[0], "height": size[1], **wishes}
        session = post_session(f"{url.rstrip('/')}/v1/sessions", body, api_key, timeout_s)
        return cls._open(url, session, session["ticket"], keep, timeout_s)

    @classmethod
    def _open(cls, url: str, session: Mapping[str, Any], ticket: str, keep: int, timeout_s: float) -> StreamClient:
        address = "ws" + url.rstrip("/").removeprefix("http") + session["stream"]
        parts = ExitStack()
        try:
            socket = parts.enter_context(
                open_socket(
                    address,
                    subprotocols=[SUBPROTOCOL, f"bearer.{ticket}"],  # type: ignore[list-item]
                    compression=None,
                    max_size=MAX_MESSAGE_BYTES,
                    open_timeout=timeout_s,
                )
            )
        except InvalidStatus as error:
            raise StreamError(f"the service refused the stream with {error.response.status_code}") from error
        except (OSError, TimeoutError) as error:
            raise StreamError(f"{url} cannot be reached ({error})") from error
        return cls(socket, parts, {**session, "url": url}, keep)

    def reconnect(self, timeout_s: float = 60.0) -> StreamClient:
        """The same session in a new connection, after this one has broken; kept keyframes go along.

        Raises:
            StreamError: the session is over: :meth:`connect` again.
        """
        self._open_parts.close()
        keep = self.kept.maxlen or 1
        other = self._open(self.session["url"], self.session, self.resume_ticket, keep, timeout_s)
        other.kept.extend(self.kept)
        return other

    # --------------------------------------------------------------- talking

    def send_pose(
        self,
        camera: Cameras,
        *,
        velocity: Sequence[float] = (0.0, 0.0, 0.0),
        spin: Sequence[float] = (0.0, 0.0, 0.0),
        moving: bool = True,
    ) -> int:
        """Tell where the view is; returns the pose's number.

        Args:
            camera: a single perspective camera without skew.
            velocity: scene units per second, world axes. spin: radians per second about the camera's axes.
            moving: False: the view stands still, a refinement is welcome.

        Raises:
            InputError: names the argument. StreamClosed: the stream has ended.
        """
        if len(camera) != 1 or camera.orthographic:
            kind = "orthographic" if camera.orthographic else "perspective"
            raise InputError(f"camera must be a single perspective camera, got {len(camera)} {kind}")
        rates = [tuple(as_vector(name, one).tolist()) for name, one in (("velocity", velocity), ("spin", spin))]
        self._number += 1
        now = time.monotonic()
        self._sent[self._number] = now
        self._sent = dict(list(self._sent.items())[-256:])
        told: dict[str, Any] = {"velocity": rates[0], "spin": rates[1], "moving": moving}
        self._send(Pose(seq=self._number, time_ms=1e3 * now, camera=header_of(camera), **told))
        return self._number

    def wish(
        self,
        *,
        budget_ms: float | None = None,
        max_error: float | None = None,
        layers: int | None = None,
        density: float | None = None,
        asymmetry: float | None = None,
        playing: bool | None = None,
        **look: Any,
    ) -> None:
        """Change what keyframes may cost or be off (None: no bound), and how many extra layers they have, how thick
        media are, whether the scene plays and how it is shown (None: as before); nothing is loaded anew.

        Args:
            budget_ms: 1 to 1e5. max_error: 0 to 1. layers: 0 to 4.
            density: makes all media so many times as thick as they are in the scene, 0 to 100.
            asymmetry: another g of all media, -0.99 to 0.99.
            playing: starts and stops the scene's animation.
            look: ``exposure``, -64 to 64 EV, "auto" or "as_lit"; ``tone_map``, "none", "reinhard" or "aces"; ``off``,
                effects to leave out: "lights", "shadows", "ambient", "reflections", "transparency", "media".

        Raises:
            InputError: names the argument and its range. StreamClosed: the stream has ended.
        """
        unknown = look.keys() - {"exposure", "tone_map", "off"}
        if unknown:
            raise InputError(f"wish takes no {', '.join(sorted(unknown))}; of the look: exposure, tone_map, off")
        wish: dict[str, Any] = {"budget_ms": budget_ms, "max_error": max_error, "layers": layers, "density": density}
        settings = Settings(**wish, **look, asymmetry=asymmetry, playing=playing)
        try:
            check_message(settings)
        except ProtocolError as error:
            told = str(error).replace("SETTINGS: ", "").replace("SETTINGS.", "")
            raise InputError(f"wish: {told}") from error
        self._send(settings)

    def resync(self) -> None:
        """Ask for a fresh keyframe and forget parts of others."""
        self._parts.clear()
        self._send(Resync(last=self.kept[-1].id if self.kept else None))

    def receive(self, timeout_s: float = 60.0, *, holes: float = 0.0, pose: int | None = None) -> StreamedKeyframe:
        """The next keyframe, complete with its layers; it is acknowledged and kept.

        Args:
            pose: wait for this one's, by the number that :meth:`send_pose` gave, or a later one's; else it may be of an
                earlier pose than the last that was sent.
            holes: share of pixels without a sample that the client sees now, for the server to act on.

        Raises:
            TimeoutError: none came in time. StreamError: the service refused a message. StreamClosed: the end.
        """
        end = time.monotonic() + timeout_s
        while True:
            received = self._next(max(0.0, end - time.monotonic()))
            keyframe = self._take(received, holes) if isinstance(received.message, Keyframe) else None
            if keyframe is not None and (pose is None or keyframe.pose >= pose):
                return keyframe

    def view(self, camera: Cameras, *, options: ReprojectOptions | None = None) -> Reprojection:
        """The kept keyframes as other cameras see them, computed here.

        The newest picture goes first; what it does not reach comes from its extra layers and earlier keyframes of the
        same time and revision of the scene. What mirrors show moves as mirrored points do, where the keyframe tells it.
        ``source`` counts the newest keyframe's images first, then those of the one before it, and so on.

        Raises:
            InputError: nothing was received yet.
        """
        if not self.kept:
            raise InputError("nothing was received yet: call receive() first")
        newest = self.kept[-1]
        state = newest.scene_s, newest.revision
        now = [one for one in reversed(self.kept) if (one.scene_s, one.revision) == state]
        images = [image for keyframe in now for image in keyframe.images]
        images = [image for image in images if image.depth.shape == images[0].depth.shape]
        if newest.mirror is None:
            return draw_keyframes(images, camera, options=options)
        return draw_with_mirrors(images, newest.mirror, camera, options=options)

    def close(self) -> None:
        """Say goodbye; the session ends."""
        with contextlib.suppress(ConnectionClosed):
            self._socket.send(encode(Bye(reason="the client is done")))
        self._open_parts.close()

    def __enter__(self) -> StreamClient:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self.close()

    # --------------------------------------------------------------- private

    def _take(self, received: Received, holes: float) -> StreamedKeyframe | None:
        header = received.message
        assert isinstance(header, Keyframe)
        begin = time.monotonic()
        try:
            image = decode_keyframe(header, split_blobs(received), received.blobs)
        except CodecError:
            self.resync()
            return None
        if header.layer == 0:
            self._parts.clear()
            now = time.monotonic()
            self._first_ms = 1e3 * (now - self._sent.get(header.pose, now))
            self._send(Ack(id=header.id, decode_ms=1e3 * (now - begin), shown_ms=1e3 * now, holes=holes))
        elif not self._parts or self._parts[0][0].header.id != header.id:
            return None  # its first layer was lost in a resync
        self._parts.append((image, received.size))
        if len(self._parts) < header.layers:
            return None
        made = keyframe_of(self._parts, self._first_ms)
        self._parts.clear()
        self.kept.append(made)
        return made

    def _next(self, timeout_s: float) -> Received:
        try:
            data = self._socket.recv(timeout_s)
        except ConnectionClosed as error:
            raise closed(error) from error
        if isinstance(data, str):
            raise StreamError("the service sent text")
        received = decode(data, FROM_SERVER)
        message = received.message
        if isinstance(message, Problem):
            raise StreamError(message.detail, msgspec.to_builtins(message))
        if isinstance(message, Bye):
            raise StreamClosed(message.reason, message.retry_after_s)
        return received

    def _send(self, message: Message) -> None:
        try:
            self._socket.send(encode(message))
        except ConnectionClosed as error:
            raise closed(error) from error
