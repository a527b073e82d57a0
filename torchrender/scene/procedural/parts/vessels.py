"""Turned and bent things for interiors: vases, bowls, kettles, lamps, taps, bottles. They stand on y = 0."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from torchrender.scene.procedural.parts.curves import cylinder, lathe, sphere, spline, torus, tube
from torchrender.scene.procedural.parts.shapes import Array, Part, merge

Profile = Sequence[tuple[float, float]]

VASES: dict[str, Profile] = {
    "tall": ((0.045, 0.0), (0.06, 0.03), (0.085, 0.15), (0.075, 0.28), (0.035, 0.38), (0.032, 0.43), (0.05, 0.47)),
    "round": ((0.05, 0.0), (0.09, 0.03), (0.125, 0.11), (0.095, 0.2), (0.045, 0.235), (0.05, 0.26)),
    "slim": ((0.05, 0.0), (0.05, 0.02), (0.042, 0.12), (0.055, 0.3), (0.075, 0.44), (0.07, 0.5)),
    "urn": (
        (0.07, 0.0),
        (0.075, 0.02),
        (0.04, 0.07),
        (0.09, 0.16),
        (0.13, 0.28),
        (0.11, 0.36),
        (0.085, 0.39),
        (0.1, 0.42),
    ),
}


def cut(number: float, detail: float, low: int = 4) -> int:
    """Segments at a level of detail."""
    return max(round(number * detail), low)


def vessel(profile: Profile, segments: int, rows: int, *, wall: float = 0.006, depth: float = 0.12) -> Part:
    """A closed pot: the spline through ``profile`` (foot to rim) outside, hollow for ``depth`` of its height."""
    outer = spline(profile, rows)
    height = outer[-1, 1]
    floor = height * (1.0 - depth) if depth < 1 else wall
    inner = outer[outer[:, 1] > floor][::-1] - np.array([wall, 0.0])
    inner = np.concatenate([inner, [[max(inner[-1, 0], 1e-4), floor]]])
    inner[0, 1] -= 0.3 * wall
    mid = [[(outer[-1, 0] + inner[0, 0]) / 2, height + wall * 0.35]]
    return lathe(np.concatenate([[[0.0, outer[0, 1]]], outer[:1], outer, mid, inner, [[0.0, floor]]]), segments)


def vase(kind: str, detail: float, scale: float = 1.0) -> Part:
    """One of :data:`VASES`."""
    return vessel(VASES[kind], cut(88, detail, 6), cut(52, detail, 4)).transformed(np.eye(3) * scale)


def bowl(radius: float, height: float, detail: float) -> Part:
    """An open bowl on a foot ring."""
    profile = ((0.42 * radius, 0.0), (0.45 * radius, 0.06 * height), (0.8 * radius, 0.45 * height), (radius, height))
    return vessel(profile, cut(96, detail, 6), cut(30, detail, 4), wall=0.05 * radius, depth=0.86)


def handle(
    points: Sequence[Sequence[float]], radius: float, detail: float, *, rows: float = 36, sides: float = 18
) -> Part:
    """A bent rod with round ends."""
    path = spline(points, cut(rows, detail, 4))
    taper = np.full(len(path), radius)
    taper[[0, -1]] *= 0.8
    return tube(path, taper, cut(sides, detail, 3))


def kettle(detail: float) -> Part:
    """A stove kettle with spout, lid knob and arched handle, 0.25 m high."""
    seg, rows = cut(96, detail, 6), cut(40, detail, 4)
    body = spline(((0.09, 0.0), (0.105, 0.012), (0.108, 0.05), (0.095, 0.11), (0.055, 0.15), (0.045, 0.155)), rows)
    lid = spline(((0.045, 0.155), (0.05, 0.163), (0.03, 0.175), (0.008, 0.18)), max(rows // 3, 4))
    shell = lathe(np.concatenate([[[0, 0]], body[:1], body, lid, [[0.0, 0.18]]]), seg)
    spout = spline(((0.07, 0.06, 0.0), (0.125, 0.085, 0.0), (0.15, 0.13, 0.0), (0.175, 0.155, 0.0)), cut(22, detail, 3))
    knob = sphere(0.014, cut(32, detail, 4)).moved((0, 0.19, 0))
    arch = handle(((-0.07, 0.135, 0), (-0.1, 0.2, 0), (0.0, 0.26, 0), (0.1, 0.2, 0), (0.07, 0.135, 0)), 0.007, detail)
    return merge([shell, tube(spout, np.linspace(0.024, 0.011, len(spout)), cut(24, detail, 4)), knob, arch])


def teapot(detail: float) -> Part:
    """A round pot with spout and ear."""
    seg, rows = cut(88, detail, 6), cut(44, detail, 4)
    body = spline(
        ((0.045, 0.0), (0.075, 0.02), (0.09, 0.06), (0.07, 0.105), (0.038, 0.12), (0.03, 0.132), (0.006, 0.138)), rows
    )
    shell = lathe(np.concatenate([[[0, 0]], body[:1], body, [[0.0, 0.1385]]]), seg)
    spout = spline(((0.06, 0.04, 0.0), (0.11, 0.06, 0.0), (0.13, 0.11, 0.0)), cut(20, detail, 3))
    ear = handle(((-0.075, 0.095, 0), (-0.125, 0.1, 0), (-0.13, 0.05, 0), (-0.08, 0.035, 0)), 0.007, detail)
    top = sphere(0.011, cut(28, detail, 4)).moved((0, 0.147, 0))
    return merge([shell, tube(spout, np.linspace(0.019, 0.009, len(spout)), cut(22, detail, 4)), ear, top])


def shade(low_radius: float, high_radius: float, height: float, detail: float) -> Part:
    """A lamp shade: a thin cone, open below and above, its foot at y = 0."""
    t, w = np.linspace(0.0, 1.0, cut(10, detail, 3)), 0.003
    outer = np.stack([low_radius + (high_radius - low_radius) * t, height * t], axis=1)
    inner = outer[::-1] - (w, 0.0)
    return lathe(np.concatenate([outer, outer[-1:], inner[:1], inner, inner[-1:], outer[:1]]), cut(72, detail, 6))


def dome(radius: float, detail: float) -> Part:
    """A hanging hemisphere, open below: rim at y = 0."""
    t = np.linspace(0.0, np.pi / 2, cut(36, detail, 4))
    outer = np.stack([np.cos(t), np.sin(t)], axis=1) * radius
    inner = outer[::-1] * 0.975
    outer[-1, 0] = inner[0, 0] = 0.0
    return lathe(np.concatenate([outer, inner, inner[-1:], outer[:1]]), cut(88, detail, 6))


def stand(height: float, foot: float, pole: float, detail: float) -> Part:
    """A lamp stand or candlestick: domed foot and a thin pole."""
    profile = ((foot, 0.0), (foot, 0.012), (foot * 0.75, 0.022), (pole * 1.6, 0.045), (pole, 0.1), (pole, height))
    outer = spline(profile, cut(48, detail, 6))
    return lathe(np.concatenate([[[0.0, 0.0]], outer[:1], outer, outer[-1:], [[0.0, height]]]), cut(56, detail, 4))


def turned_base(height: float, radius: float, detail: float) -> Part:
    """A table lamp's body: two bulges on a foot."""
    r, h = radius, height
    profile = (
        (r, 0),
        (r, 0.04 * h),
        (0.35 * r, 0.12 * h),
        (0.95 * r, 0.36 * h),
        (0.3 * r, 0.62 * h),
        (0.5 * r, 0.78 * h),
        (0.14 * r, h),
    )
    outer = spline(profile, cut(64, detail, 6))
    return lathe(np.concatenate([[[0.0, 0.0]], outer[:1], outer, outer[-1:], [[0.0, h]]]), cut(80, detail, 6))


def bottle(height: float, radius: float, detail: float) -> Part:
    """A closed bottle with a neck and cap."""
    r, h = radius, height
    profile: Profile = (
        (r * 0.94, 0.0),
        (r, 0.02 * h),
        (r, 0.6 * h),
        (0.85 * r, 0.7 * h),
        (0.36 * r, 0.79 * h),
        (0.34 * r, 0.84 * h),
    )
    outer = spline(profile, cut(28, detail, 4))
    cap = cylinder(0.42 * r, 0.84 * h, h, cut(32, detail, 4), bevel=0.05 * r)
    closed = np.concatenate([[[0.0, 0.0]], outer[:1], outer, outer[-1:], [[0.0, 0.84 * h]]])
    return merge([lathe(closed, cut(40, detail, 4)), cap])


def basin_tap(detail: float) -> Part:
    """A curved mixer tap, 0.2 m high, that reaches towards +z, with a lever."""
    body = cylinder(0.022, 0.0, 0.07, cut(48, detail, 4), bevel=0.004, rows=4)
    ring = torus(0.024, 0.005, cut(48, detail, 4), cut(14, detail, 3)).moved((0, 0.004, 0))
    neck: Array = spline(
        ((0, 0.06, 0), (0, 0.14, 0.0), (0, 0.19, 0.03), (0, 0.2, 0.075), (0, 0.18, 0.115), (0, 0.15, 0.125)),
        cut(52, detail, 4),
    )
    lever = handle(((0.01, 0.05, 0), (0.05, 0.075, 0.0), (0.085, 0.105, 0.0)), 0.006, detail, rows=20)
    tip = cylinder(0.014, 0.142, 0.156, cut(32, detail, 4), bevel=0.003).moved((0, 0, 0.126))
    return merge([body, ring, tube(neck, 0.011, cut(30, detail, 4)), lever, tip])
