"""Visibility of many light samples from many receivers, refined only where neighbours disagree. Rays by Embree.

Groups of neighbouring receivers first trace a few samples each, all different, that together cover the light: where
they agree the whole group is lit, or dark. Elsewhere each receiver traces a coarse grid of samples, and if those
disagree a finer one; last, the samples between known ones that disagree, until no more come to be known to disagree.
What lies between agreeing samples takes their value: an occluder smaller than the grid, seen from the receiver, can be
missed. Packets of sixteen rays go through Embree's own float32 triangles: see :class:`PlainEmbree` for the tree.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import prange, types

from torchrender.kernels.compile import kernel
from torchrender.kernels.rays.boxes import SCALE
from torchrender.kernels.rays.embree import ARGUMENTS, STATE
from torchrender.kernels.rays.embree import load_library as load_library

GROUP, WIDE = 16, 16
"""Receivers that are looked at together; rays of a packet."""

UNKNOWN, LIT, DARK, BELOW, ASKED = 0, 1, 2, 3, 4
"""States of a sample, seen from a receiver. BELOW: it lies below the receiver's surface."""

_FAR, _MASK = 8 * WIDE, 9 * WIDE
_FIELDS = 12 * WIDE
_ROUNDING = 4e-7  # of the scene's half extent, which is one in Embree's frame: twice what float32 may be off there
_END = 1e-5  # rays end this share of their length before the light

_occluded16 = types.ExternalFunction("rtcOccluded16", types.void(types.int64, types.int64, types.int64, types.int64))


class LightSamples(NamedTuple):
    """The samples of one light, n x n in rows, and which of them are traced first."""

    places: np.ndarray  # (S,3) float64, scene units
    side: int  # n; 0: no grid, all are traced
    probes: np.ndarray  # (GROUP,K) int64 samples that each receiver of a group traces first; none: K = 0
    coarse: np.ndarray  # (M,) int64 samples that a receiver traces next
    knots: np.ndarray  # (L,) int64 rows and columns of the fine grid


class _Work(NamedTuple):
    """One thread's room."""

    ray: np.ndarray  # (_FIELDS,) float32 at a cache line, RTCRay16
    words: np.ndarray  # the same as int32
    valid: np.ndarray  # (WIDE,) int32 at a cache line
    state: np.ndarray  # (GROUP,S) uint8
    origin: np.ndarray  # (GROUP,3) float64 in Embree's frame
    waiting: np.ndarray  # (WIDE,2) int64 receiver and sample
    filled: np.ndarray  # (1,) int64 rays that wait
    ends: np.ndarray  # (S,3) float64 samples in Embree's frame
    scene: np.int64
    arguments: np.int64


@kernel()
def _flush(w):
    """Trace the rays that wait."""
    count = w.filled[0]
    if count == 0:
        return
    for q in range(WIDE):
        w.valid[q] = -1 if q < count else 0
        row = q if q < count else 0
        j, s = w.waiting[row, 0], w.waiting[row, 1]
        length2 = 0.0
        for k in range(3):
            start = w.origin[j, k]
            step = w.ends[s, k] - start
            w.ray[k * WIDE + q] = start
            w.ray[(4 + k) * WIDE + q] = step
            length2 += step * step
        w.ray[3 * WIDE + q] = 0.0
        w.ray[7 * WIDE + q] = 0.0
        w.ray[_FAR + q] = 1.0 - _END - _ROUNDING / max(np.sqrt(length2), 1e-30)
        w.words[_MASK + q] = -1
        w.words[_MASK + WIDE + q] = 0
        w.words[_MASK + 2 * WIDE + q] = 0
    _occluded16(np.int64(w.valid.ctypes.data), w.scene, np.int64(w.ray.ctypes.data), w.arguments)
    for q in range(count):
        w.state[w.waiting[q, 0], w.waiting[q, 1]] = DARK if w.ray[_FAR + q] < 0.0 else LIT
    w.filled[0] = 0


@kernel(inline=True)
def _ask(w, j, s):
    """Have a ray traced, if that sample is not known."""
    if w.state[j, s] != UNKNOWN:
        return
    w.state[j, s] = ASKED
    w.waiting[w.filled[0], 0], w.waiting[w.filled[0], 1] = j, s
    w.filled[0] += 1
    if w.filled[0] == WIDE:
        _flush(w)


@kernel()
def _agree(w, j, samples):
    """LIT or DARK if these samples of a receiver all are, UNKNOWN if none is known, ASKED if some are either."""
    lit = dark = False
    for q in range(samples.shape[0]):
        lit |= w.state[j, samples[q]] == LIT
        dark |= w.state[j, samples[q]] == DARK
    if lit and dark:
        return ASKED
    return LIT if lit else (DARK if dark else UNKNOWN)


@kernel()
def _fill(w, j, value):
    """What is not known takes a value."""
    for s in range(w.state.shape[1]):
        if w.state[j, s] == UNKNOWN:
            w.state[j, s] = value


@kernel()
def _cells(w, j, light, settle):
    """Ask for what is unknown in cells of the fine grid that hold both; with ``settle`` fill those that hold one.

    Returns the number of rays that were asked for.
    """
    n, knots, asked = light.side, light.knots, 0
    for a in range(knots.shape[0] - 1):
        for b in range(knots.shape[0] - 1):
            lit = dark = unknown = 0
            for row in range(knots[a], knots[a + 1] + 1):
                for column in range(knots[b], knots[b + 1] + 1):
                    state = w.state[j, row * n + column]
                    lit += state == LIT
                    dark += state == DARK
                    unknown += state == UNKNOWN
            if unknown == 0:
                continue
            mixed = (lit > 0) == (dark > 0)  # both, or nothing is known
            if not mixed and not settle:
                continue
            for row in range(knots[a], knots[a + 1] + 1):
                for column in range(knots[b], knots[b + 1] + 1):
                    s = row * n + column
                    if w.state[j, s] == UNKNOWN:
                        if mixed:
                            _ask(w, j, s)
                            asked += 1
                        else:
                            w.state[j, s] = LIT if lit > 0 else DARK
    return asked


@kernel(inline=True)
def _height(points, normals, i, places, s):
    """Of a sample above a receiver's surface."""
    return (
        normals[i, 0] * (places[s, 0] - points[i, 0])
        + normals[i, 1] * (places[s, 1] - points[i, 1])
        + normals[i, 2] * (places[s, 2] - points[i, 2])
    )


@kernel()
def _aim(points, normals, gaps, light, frame, i, j, w):
    """Set up a receiver: its start in Embree's frame, and which samples lie below it; how many do not."""
    n, scale, above = light.side, frame[SCALE], 0
    gap = gaps[i] * scale + _ROUNDING
    for k in range(3):
        w.origin[j, k] = points[i, k] * scale - frame[k] + normals[i, k] * gap
    samples = light.places.shape[0]
    lowest = np.inf
    for row in (0, max(n - 1, 0)):  # heights are linear over the light: its corners tell
        for s in (row * n, row * n + max(n - 1, 0)):
            lowest = min(lowest, _height(points, normals, i, light.places, s))
    if n > 0 and lowest > 0.0:
        w.state[j, :] = UNKNOWN
        return samples
    for s in range(samples):
        up = _height(points, normals, i, light.places, s) > 0.0
        w.state[j, s] = UNKNOWN if up else BELOW
        above += up
    return above


@kernel()
def _refine(w, members, light, whole, open_):
    """Know every sample of the receivers marked in ``open_`` (GROUP,); ``whole``: all of the light lies above them."""
    for j in range(members):
        if open_[j] and whole[j]:
            for q in range(light.coarse.shape[0]):
                _ask(w, j, light.coarse[q])
    _flush(w)
    for j in range(members):
        if not open_[j]:
            continue
        if not whole[j]:  # fewer samples, of which the grid may miss all
            for s in range(w.state.shape[1]):
                _ask(w, j, s)
            continue
        found = _agree(w, j, light.coarse)
        if found == LIT or found == DARK:
            _fill(w, j, found)
            open_[j] = False
            continue
        for a in range(light.knots.shape[0]):
            for b in range(light.knots.shape[0]):
                _ask(w, j, light.knots[a] * light.side + light.knots[b])
    _flush(w)
    more = True
    while more:
        asked = 0
        for j in range(members):
            if open_[j]:
                asked += _cells(w, j, light, False)
        _flush(w)
        more = asked > 0
    for j in range(members):
        if open_[j]:
            _cells(w, j, light, True)
    _flush(w)


@kernel()
def _probe(w, members, light, whole):
    """LIT or DARK if a group's probes all are; else, or if some receiver lies partly below the light, UNKNOWN."""
    for j in range(members):
        if not whole[j]:
            return UNKNOWN
    for j in range(members):
        for q in range(light.probes.shape[1]):
            _ask(w, j, light.probes[j, q])
    _flush(w)
    lit = dark = False
    for j in range(members):
        found = _agree(w, j, light.probes[j])
        lit |= found == LIT or found == ASKED
        dark |= found == DARK or found == ASKED
    if lit == dark:
        return UNKNOWN
    return LIT if lit else DARK


@kernel()
def _group(points, normals, gaps, light, frame, begin, w, out):
    """Up to GROUP receivers from ``begin`` on."""
    bits, above = out
    members, samples = min(GROUP, points.shape[0] - begin), light.places.shape[0]
    open_, whole = np.zeros(GROUP, np.bool_), np.zeros(GROUP, np.bool_)
    for j in range(members):
        above[begin + j] = _aim(points, normals, gaps, light, frame, begin + j, j, w)
        open_[j], whole[j] = above[begin + j] > 0, above[begin + j] == samples
    found = _probe(w, members, light, whole) if light.side > 0 else UNKNOWN
    if light.side == 0:
        for j in range(members):
            for s in range(samples):
                _ask(w, j, s)
        _flush(w)
    elif found == UNKNOWN:
        _refine(w, members, light, whole, open_)
    else:
        for j in range(members):
            _fill(w, j, found)
    for j in range(members):
        if above[begin + j] > 0:
            for s in range(samples):
                if w.state[j, s] == LIT:
                    bits[begin + j, s >> 6] |= np.int64(1) << np.int64(s & 63)


@kernel()
def _lane(tree, points, normals, gaps, light, lane, lanes, out):
    """Every ``lanes``-th group."""
    scene, frame = tree
    room, room2 = np.zeros(_FIELDS + 16, np.float32), np.zeros(WIDE + 16, np.int32)
    first, first2 = (-np.int64(room.ctypes.data) % 64) // 4, (-np.int64(room2.ctypes.data) % 64) // 4
    ray = room[first : first + _FIELDS]
    contexts, arguments = np.zeros(1, STATE), np.zeros(1, ARGUMENTS)
    contexts[0].instance, contexts[0].instance_primitive = -1, -1
    arguments[0].features, arguments[0].context = -1, contexts.ctypes.data
    samples = light.places.shape[0]
    ends = np.zeros((samples, 3))
    for s in range(samples):
        for k in range(3):
            ends[s, k] = light.places[s, k] * frame[SCALE] - frame[k]
    w = _Work(
        ray,
        ray.view(np.int32),
        room2[first2 : first2 + WIDE],
        np.zeros((GROUP, samples), np.uint8),
        np.zeros((GROUP, 3)),
        np.zeros((WIDE, 2), np.int64),
        np.zeros(1, np.int64),
        ends,
        scene,
        np.int64(arguments.ctypes.data),
    )
    groups = (points.shape[0] + GROUP - 1) // GROUP
    for group in range(lane, groups, lanes):
        _group(points, normals, gaps, light, frame, group * GROUP, w, out)


@kernel(parallel=True)
def refine_light(tree, points, normals, gaps, light, lanes, out):
    """Which samples of a light each receiver sees.

    Args:
        tree: scene and frame of a :class:`~torchrender.kernels.rays.plain_embree.PlainEmbree`.
        points, normals: (P,3) float64, neighbours next to each other; normals face the viewer.
        gaps: (P,) float64 scene units that points may be off.
        light: :class:`LightSamples`.
        lanes: pieces of work.
        out: ``bits`` (P,ceil(S/64)) int64, zero: bit s % 64 of word s // 64 is set where sample s is visible; and
            ``above`` (P,) int32, written: samples above the receiver's surface.
    """
    for lane in prange(lanes):
        _lane(tree, points, normals, gaps, light, np.int64(lane), lanes, out)
