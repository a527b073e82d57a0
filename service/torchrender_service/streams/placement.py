"""When a stream needs its next keyframe, and from where: the newest pose, what is shown, and what is on the way.

Nothing here waits or sends; times are seconds of any one clock.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, replace
from statistics import median_low

from torchrender.wire.messages import CREDITS, Ack, CameraHeader, Pose
from torchrender_service.streams.prediction import MAX_HOLES, SPARE_SHARE, needs_keyframe, predicted, same_view

STALE_S = 0.5
"""A pose that was not renewed for so long no longer moves."""
RHYTHM = 1.5
"""Poses that come at intervals are waited for this many times as long before a view counts as at rest."""
LONGEST_S = 3.0
"""But no longer than this: the client may have gone quiet."""
SPARE_S = 0.09
"""Between the beginnings of two keyframes of a moving view that could still do without."""
TRIPS = 5
"""Round trips whose median counts: one that was slow, because something was loaded or compiled, leads nobody astray."""


@dataclass(frozen=True)
class Shown:
    """The newest keyframe."""

    view: CameraHeader  # without overscan, after prediction
    overscan: float
    typical_depth: float
    still: bool
    smooth: bool = False  # or cannot become so
    preview: bool = False


@dataclass(eq=False)
class Flight:
    """A keyframe without acknowledgement."""

    begun: float  # when its rendering began
    timed: bool  # its round trip is like that of the next one
    sent: float | None = None


class Placement:
    """What one stream knows about its client.

    Args:
        still_s: rest after which a view is refined.
        latency_s: :attr:`latency_s` of an earlier connection, 0: not known.
    """

    def __init__(self, still_s: float, latency_s: float) -> None:
        self._still_s = still_s
        self._trips = deque([latency_s] if latency_s else [], maxlen=TRIPS)
        self._making: deque[float] = deque(maxlen=TRIPS)  # seconds to the first message, of the same keyframes
        self._answers: deque[float] = deque(maxlen=TRIPS)  # and from there
        self.pose: Pose | None = None
        self.playing = False  # the scene moves: every keyframe is old as soon as it is made
        self._pose_at = 0.0
        self._moved_at = 0.0
        self._rhythm_s = 0.0  # between the last two views of a moving client
        self._holes = 0.0
        self._begun_at = 0.0  # the last keyframe
        self._changed = False  # the scene, since the last keyframe
        self._changed_at = 0.0  # when the last one was begun that shows a change
        self._fresh = True  # one keyframe is wanted whatever the pose
        self._whole = True  # the last one has all its layers
        self._shown: Shown | None = None
        self._flights: dict[int, Flight] = {}

    @property
    def latency_s(self) -> float:
        """From the start of a render to the acknowledgement, the median of the last ones; 0: not known yet."""
        return median_low(self._trips) if self._trips else 0.0

    # ------------------------------------------------------------ from client

    def take_pose(self, pose: Pose, now: float) -> None:
        """The mailbox has one slot; a pose that was overtaken on the way is not put there."""
        old = self.pose
        if old is not None and pose.seq < old.seq:
            return
        if old is None or not same_view(old.camera, pose.camera):
            self._moved_at = now
            moves = old is not None and old.moving and pose.moving
            self._rhythm_s = min(now - self._pose_at, LONGEST_S / RHYTHM) if moves else 0.0
        elif not pose.moving:
            self._rhythm_s = 0.0
        self.pose, self._pose_at = pose, now

    def take_ack(self, ack: Ack, now: float) -> float | None:
        """Give a credit back; returns the seconds since the render began, None for an id that is not on the way."""
        flight = self._flights.pop(ack.id, None)
        if flight is None:
            return None
        self._holes = ack.holes
        trip = now - flight.begun
        if flight.timed:
            self._trips.append(trip)
            if flight.sent is not None:
                self._making.append(flight.sent - flight.begun)
                self._answers.append(now - flight.sent)
        return trip

    def resync(self) -> None:
        """All credits are free again, and one fresh keyframe is wanted."""
        self._flights.clear()
        self._fresh = True

    def refresh(self, *, scene: bool = False) -> None:
        """One fresh keyframe is wanted: settings, or the ``scene`` itself, have changed."""
        self._fresh = True
        self._changed = self._changed or scene

    def outdated(self) -> bool:
        """What was sent shows another state of the scene, or other settings: its layers are not worth waiting for.

        Never twice in a row: a client that takes whole keyframes gets some of a scene that changes all the time.
        """
        return self._fresh and self._whole

    def delivered(self, *, whole: bool) -> None:
        """A keyframe was sent with all of its layers, or without."""
        self._whole = whole

    def drop_pose(self) -> None:
        """The pose cannot be rendered: wait for another one."""
        self.pose = None

    # ------------------------------------------------------------ for server

    def due(self, now: float) -> str | None:
        """Which kind of keyframe is wanted: "moving", "still", "smooth" (still, the mean of several) or None.

        "preview" is one of a view at rest whose scene has changed: a small one, before the one at rest.

        "spare" is a moving one that the view does not need yet: mirrors and outlines only get fresher by it.
        """
        pose, shown = self.pose, self._shown
        if pose is None or len(self._flights) >= CREDITS:
            return None
        if self._fresh or shown is None or self.playing:
            return "preview" if self._changed and not self._going(pose, now) else "moving"
        if needs_keyframe(shown.view, self.view(pose, now), shown.typical_depth, shown.overscan):
            return "moving"
        exact = same_view(shown.view, pose.camera)
        if self._holes > MAX_HOLES and not exact and now - self._moved_at < self._rest_s:
            return "moving"
        if self._going(pose, now):
            return "spare" if self._spare(pose, now) else None
        rested = now - self._disturbed_at >= self._rest_s
        if not rested or (shown.preview and self._flights):  # made beside a page on this machine, it would come late
            return None
        if not (exact and shown.still):
            return "still"
        return None if shown.smooth else "smooth"

    def patience(self, now: float, longest: float) -> float:
        """Seconds until something may become due without a message."""
        times = [self._disturbed_at + self._rest_s]
        if self.pose is not None and self._going(self.pose, now):
            times.append(self._begun_at + SPARE_S)
        waits = [time - now for time in times if time > now]
        return max(0.01, min([longest, *waits]))

    def view(self, pose: Pose, now: float) -> CameraHeader:
        """Where the camera will be when a keyframe that is begun now is shown."""
        if not self._going(pose, now):
            return pose.camera
        return predicted(pose, now - self._pose_at + self.latency_s)

    @property
    def _rest_s(self) -> float:
        """After this time without another view it is at rest: a client that says that it moves and is seldom heard, as
        over a slow link or in a page in the background, has not stopped between two poses."""
        return max(self._still_s, RHYTHM * self._rhythm_s)

    @property
    def _disturbed_at(self) -> float:
        """When the view, or the scene, changed last: one that changes all the time is shown by previews alone, and what
        refines a single change comes after the page has shown it."""
        return max(self._moved_at, self._changed_at)

    def _going(self, pose: Pose, now: float) -> bool:
        return (
            pose.moving
            and any((*pose.velocity, *pose.spin))
            and now - self._pose_at <= max(STALE_S, RHYTHM * self._rhythm_s)
        )

    def _spare(self, pose: Pose, now: float) -> bool:
        if now - self._begun_at < SPARE_S or (self._flights and not self._keeps_up):
            return False
        shown = self._shown
        assert shown is not None
        view = self.view(pose, now)
        return needs_keyframe(shown.view, view, shown.typical_depth, shown.overscan, share=SPARE_SHARE)

    @property
    def _keeps_up(self) -> bool:
        """The client takes keyframes sooner than they are made: the next one may be begun while it has one to take."""
        return bool(self._answers) and median_low(self._answers) < median_low(self._making)

    def begin(self, number: int, now: float, *, timed: bool) -> Flight:
        """A keyframe is begun: it takes a credit."""
        self._changed_at = now if self._changed else self._changed_at
        self._fresh, self._changed, self._begun_at = False, False, now
        flight = self._flights[number] = Flight(now, timed)
        return flight

    def done(self, number: int, shown: Shown) -> bool:
        """It is rendered; whether anybody still waits for it."""
        self._shown, self._holes = shown, 0.0
        return number in self._flights

    def smoothed(self) -> None:
        """The view at rest is there as the mean of several pictures, or will not be."""
        assert self._shown is not None
        self._shown = replace(self._shown, smooth=True)

    def failed(self, number: int) -> None:
        """It is not coming."""
        self._flights.pop(number, None)
        self._fresh = True

    def oldest_sent(self) -> float | None:
        """When the longest unacknowledged keyframe was sent; None: there is none."""
        return min((f.sent for f in self._flights.values() if f.sent is not None), default=None)
