"""Marks as data; places are pixels (x, y) of the photo, row 0 on top, and may lie outside of it."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

from torchrender.checks import check_choice, check_range
from torchrender.errors import InputError

Point = tuple[float, float]
Polygon = tuple[Point, ...]
WALLS = ("left", "right", "floor", "ceiling", "back", "front")
CORNERS = tuple(f"{a}_{b}_{c}" for a in ("back", "front") for b in ("left", "right") for c in ("floor", "ceiling"))
LABELS = ("ground", "vertical", "sky")
LAMPS = ("point", "cone")
FARTHEST_PIXEL = 1e5


def as_point(name: str, value: object) -> Point:
    """Two finite numbers."""
    try:
        x, y = (float(v) for v in value)  # type: ignore[attr-defined]
    except (TypeError, ValueError) as error:
        raise InputError(f"{name} must be x, y in pixels, got {value!r}") from error
    if not (abs(x) <= FARTHEST_PIXEL and abs(y) <= FARTHEST_PIXEL):
        raise InputError(f"{name} must lie within {FARTHEST_PIXEL:g} pixels, got {x:g}, {y:g}")
    return x, y


def as_polygon(name: str, value: object, least: int = 3) -> Polygon:
    """At least so many points, not all on one line.

    Raises:
        InputError: too few, no numbers, or no area.
    """
    if not isinstance(value, Sequence) or isinstance(value, str):
        raise InputError(f"{name} must be a list of points, got {value!r}")
    points = tuple(as_point(f"{name}[{k}]", p) for k, p in enumerate(value))
    if len(points) < least:
        raise InputError(f"{name} must have at least {least} points, got {len(points)}")
    if least >= 3 and _spread(points) < 0.5:
        raise InputError(f"{name} has no area: its points lie on one line")
    return points


def as_outline(name: str, value: object) -> Polygon:
    """A polygon whose edges do not cross.

    Raises:
        InputError: as :func:`as_polygon`, or two edges that cross.
    """
    points = as_polygon(name, value)
    if crosses_itself(points):
        raise InputError(f"{name} crosses itself: name its corners one after the other around it")
    return points


def crosses_itself(points: Polygon) -> bool:
    """Whether two edges of a closed polygon cross inside of both."""

    def side(a: Point, b: Point, p: Point) -> float:
        return (b[0] - a[0]) * (p[1] - a[1]) - (b[1] - a[1]) * (p[0] - a[0])

    edges = [(points[k - 1], points[k]) for k in range(len(points))]
    return any(
        side(a, b, c) * side(a, b, d) < 0 and side(c, d, a) * side(c, d, b) < 0
        for k, (a, b) in enumerate(edges)
        for c, d in edges[k + 1 :]
    )


def _spread(points: Polygon) -> float:
    """Largest area of a triangle of the polygon's first edge's fan, square pixels."""
    (x0, y0) = points[0]
    return max(
        abs((a[0] - x0) * (b[1] - y0) - (b[0] - x0) * (a[1] - y0)) / 2
        for k, a in enumerate(points[1:])
        for b in points[k + 2 :]
    )


@dataclass(frozen=True, kw_only=True)
class CameraMark:
    """What is known of the camera; what is None is found or assumed."""

    focal: float | None = None  # pixels
    center: Point | None = None  # principal point; None: the picture's middle
    height: float = 1.6  # metres above the floor or ground
    horizon: float | None = None  # outdoors: image row; None: the picture's middle

    def __post_init__(self) -> None:
        check_range("camera height", self.height, 0.05, 500.0)
        if self.focal is not None:
            check_range("camera focal", self.focal, 1.0, 1e6)
        if self.center is not None:
            object.__setattr__(self, "center", as_point("camera center", self.center))


@dataclass(frozen=True, kw_only=True)
class RoomMark:
    """Corners of the room by name (back or front, left or right, floor or ceiling), as pixels."""

    corners: Mapping[str, Point]
    height: float | None = None  # metres, where it is known

    def __post_init__(self) -> None:
        for name in self.corners:
            check_choice("room corner", name, CORNERS)
        object.__setattr__(self, "corners", {k: as_point(f"room corner {k}", v) for k, v in self.corners.items()})
        if len(self.corners) < 4:
            raise InputError(f"a room needs at least 4 marked corners, got {len(self.corners)}")
        if self.height is not None:
            check_range("room height", self.height, 0.5, 100.0)


@dataclass(frozen=True, kw_only=True)
class LightMark:
    """A lamp with an area on a wall or the ceiling."""

    polygon: Polygon
    wall: str | None = None  # None: the one that its middle lies on
    on: bool = True

    def __post_init__(self) -> None:
        object.__setattr__(self, "polygon", as_outline("light polygon", self.polygon))
        if self.wall is not None:
            check_choice("light wall", self.wall, WALLS)


@dataclass(frozen=True, kw_only=True)
class WindowMark:
    """A window or door; ``lit`` is where the sun through it meets the floor, corner by corner."""

    polygon: Polygon
    lit: Polygon | None = None
    wall: str | None = None
    glow: bool = True  # sky light comes through it, too

    def __post_init__(self) -> None:
        object.__setattr__(self, "polygon", as_outline("window polygon", self.polygon))
        if self.wall is not None:
            check_choice("window wall", self.wall, WALLS)
        if self.lit is not None:
            object.__setattr__(self, "lit", as_polygon("window lit", self.lit))
            if len(self.lit) != len(self.polygon):
                raise InputError(
                    f"window lit must have as many corners as its polygon, {len(self.polygon)}, got {len(self.lit)}"
                )


@dataclass(frozen=True, kw_only=True)
class CuboidMark:
    """Furniture: its footprint on the floor (three corners of a parallelogram, or all corners), and how high it is."""

    base: Polygon
    height: float | None = None  # metres
    top: Point | None = None  # or: where the edge above the first corner ends

    def __post_init__(self) -> None:
        object.__setattr__(self, "base", as_outline("cuboid base", self.base))
        if (self.height is None) == (self.top is None):
            raise InputError("a cuboid needs either height or top")
        if self.height is not None:
            check_range("cuboid height", self.height, 1e-3, 100.0)
        if self.top is not None:
            object.__setattr__(self, "top", as_point("cuboid top", self.top))


@dataclass(frozen=True, kw_only=True)
class LampMark:
    """A lamp in the picture, or beside it: how far it is, or where it would stand on the ground."""

    at: Point
    distance: float | None = None  # metres along the view, camera z; None: by depth or foot
    foot: Point | None = None
    kind: str = "point"
    direction: tuple[float, float, float] = (0.0, -1.0, 0.0)  # of a cone: world, y up, -z away from the camera
    angle_deg: float = 50.0  # half angle of a cone
    strength: float = 1.0
    color: tuple[float, float, float] | None = None  # linear; None: the photo's there
    radius: float = 4.0  # pixels that are the lamp itself

    def __post_init__(self) -> None:
        object.__setattr__(self, "at", as_point("lamp at", self.at))
        check_choice("lamp kind", self.kind, LAMPS)
        check_range("lamp angle_deg", self.angle_deg, 1.0, 89.0)
        check_range("lamp strength", self.strength, 0.0, 1e6)
        check_range("lamp radius", self.radius, 0.0, 1e4)
        if self.distance is not None:
            check_range("lamp distance", self.distance, 0.05, 1e5)
        if self.foot is not None:
            object.__setattr__(self, "foot", as_point("lamp foot", self.foot))
        for name in ("direction", "color"):
            value = getattr(self, name)
            if value is not None and (len(value) != 3 or not all(math.isfinite(float(v)) for v in value)):
                raise InputError(f"lamp {name} must be three finite numbers, got {value!r}")
        if not any(self.direction):
            raise InputError("lamp direction must not be zero")


@dataclass(frozen=True, kw_only=True)
class RegionMark:
    """Part of an outdoor photo: later ones lie over earlier ones."""

    label: str
    polygon: Polygon
    depth: float | None = None  # metres, of vertical ones

    def __post_init__(self) -> None:
        check_choice("region label", self.label, LABELS)
        object.__setattr__(self, "polygon", as_polygon("region polygon", self.polygon))
        if self.depth is not None:
            check_range("region depth", self.depth, 0.1, 1e5)


@dataclass(frozen=True, kw_only=True)
class OutdoorMark:
    """Depths of the ground, and what tells its light."""

    near: float | None = None  # metres, at the ground's lowest row; None: by camera height and horizon
    far: float | None = None  # metres, at its highest row
    sky: float = 5000.0  # metres
    shadow: Polygon | None = None  # ground in shadow
    sunlit: Polygon | None = None  # ground in the sun
    object_top: Point | None = None  # top of something
    shadow_tip: Point | None = None  # and where its shadow ends
    sky_share: float = 1.0  # of the sky, seen by the shadow

    def __post_init__(self) -> None:
        for name in ("near", "far", "sky"):
            if getattr(self, name) is not None:
                check_range(f"outdoor {name}", getattr(self, name), 0.1, 1e6)
        if self.near is not None and self.far is not None and self.far < self.near:
            raise InputError(f"outdoor far must be at least near, got near {self.near:g} and far {self.far:g}")
        check_range("outdoor sky_share", self.sky_share, 0.01, 1.0)
        for name in ("shadow", "sunlit"):
            if getattr(self, name) is not None:
                object.__setattr__(self, name, as_polygon(f"outdoor {name}", getattr(self, name)))
        for name in ("object_top", "shadow_tip"):
            if getattr(self, name) is not None:
                object.__setattr__(self, name, as_point(f"outdoor {name}", getattr(self, name)))
        if (self.object_top is None) != (self.shadow_tip is None):
            raise InputError("object_top and shadow_tip go together")


@dataclass(frozen=True, kw_only=True)
class Marks:
    """All marks of one photo: a room makes it indoors."""

    width: int | None = None  # of the photo the marks refer to
    height: int | None = None
    camera: CameraMark = field(default_factory=CameraMark)
    room: RoomMark | None = None
    lights: tuple[LightMark, ...] = ()
    windows: tuple[WindowMark, ...] = ()
    cuboids: tuple[CuboidMark, ...] = ()
    lamps: tuple[LampMark, ...] = ()
    regions: tuple[RegionMark, ...] = ()
    labels: str | None = None  # picture of labels: 0 ground, 1 vertical, 2 sky
    outdoor: OutdoorMark = field(default_factory=OutdoorMark)

    def __post_init__(self) -> None:
        for name in ("width", "height"):
            if getattr(self, name) is not None:
                check_range(f"photo {name}", getattr(self, name), 1, 2**20)
        if self.room is None and (self.lights or self.windows or self.cuboids):
            raise InputError("lights, windows and cuboids need a room: mark its corners")
        if self.room is not None and (self.regions or self.labels):
            raise InputError("a room has no regions of ground, vertical and sky")

    @property
    def indoor(self) -> bool:
        """There is a room."""
        return self.room is not None


def scaled(marks: Marks, factor_x: float, factor_y: float) -> Marks:
    """The same marks of a photo with another size."""
    from torchrender.photo.fog.marks.scale import scaled_record

    return replace(scaled_record(marks, factor_x, factor_y), width=None, height=None)
