"""The page's own quads, drawn in double precision: what its graphics would show if they did not round.

WebGL may place corners on a grid of 1/16 pixel, as software rendering does, and outlines differ by that. Here corners
are not rounded, so that differences to the Python reprojection are those of the surfaces.
"""

from __future__ import annotations

import base64
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numba import njit

from browser_stage import run_script
from torchrender.reconstruct.reproject import pixel_matrices
from torchrender.scene.camera import Cameras
from torchrender.wire.containers import KeyframeImage

EXTRA_BIAS, STEP_BIAS = 0.01, 0.001  # of warp.js
RIP = 0.12  # of shaders.js

SCRIPT = """
    const { Decoder } = await import("/js/decoder.js");
    const decoder = new Decoder();
    const { codes, scale, quads } = await decoder.decode(bytes(given.message).buffer, 1e8);
    decoder.worker.terminate();
    return { scale, codes: text(codes), corners: text(quads.data), joined: text(quads.joined) };
"""


@dataclass
class PageImage:
    """A KEYFRAME as the page's worker hands it on."""

    image: KeyframeImage
    scale: float  # 1/z of code 1
    codes: np.ndarray[Any, Any]  # (H,W) uint16; 65535 where there is no sample
    corners: np.ndarray[Any, Any]  # (Q,4,3): u, v, 1/z
    joined: np.ndarray[Any, Any]  # (H+1,W+1) uint8


def page_image(page: Any, message: bytes, image: KeyframeImage) -> PageImage:
    """Decode a KEYFRAME message in the page; ``image``: as Python decodes it."""
    height, width = image.depth.shape
    got = run_script(page, SCRIPT, message=message)
    codes, corners, joined = (base64.b64decode(got[name]) for name in ("codes", "corners", "joined"))
    return PageImage(
        image,
        got["scale"],
        np.frombuffer(codes, np.uint16).reshape(height, width),
        np.frombuffer(corners, np.float32).reshape(-1, 4, 3).astype(np.float64),
        np.frombuffer(joined, np.uint8).reshape(height + 1, width + 1),
    )


def drawn_exactly(images: Sequence[PageImage], camera: Cameras) -> tuple[np.ndarray[Any, Any], np.ndarray[Any, Any]]:
    """Display colours (H,W,3) uint8 and validity (H,W) of images as ``camera`` sees them, the preferred one first."""
    size = (camera.height, camera.width)
    nearest, color = np.full(size, -1.0), np.zeros((*size, 3))
    for rank, page in enumerate(images):
        bias = 0.0 if rank == 0 else EXTRA_BIAS + rank * STEP_BIAS
        matrix = pixel_matrices(page.image.camera, camera)[0]
        source = (page.codes, page.scale, page.joined, page.image.codes.numpy().astype(np.float64))
        _draw(page.corners, matrix, 1.0 - bias, source, nearest, color)
    return color.round().astype(np.uint8), nearest >= 0.0


@njit(cache=True)
def _draw(corners, matrix, factor, source, nearest, color):
    height, width = nearest.shape
    x, y, z = np.zeros(4), np.zeros(4), np.zeros(4)
    for quad in corners:
        for k in range(4):
            u, v, q = quad[k]
            z[k] = matrix[2, 0] * u + matrix[2, 1] * v + matrix[2, 2] + matrix[2, 3] * q
            x[k] = (matrix[0, 0] * u + matrix[0, 1] * v + matrix[0, 2] + matrix[0, 3] * q) / z[k]
            y[k] = (matrix[1, 0] * u + matrix[1, 1] * v + matrix[1, 2] + matrix[1, 3] * q) / z[k]
        if z.min() <= 0.0:
            continue
        for a, b, c in ((0, 1, 2), (0, 2, 3)):
            area = (x[b] - x[a]) * (y[c] - y[a]) - (y[b] - y[a]) * (x[c] - x[a])
            if area >= 0.0:
                continue
            first_x, last_x = max(min(x[a], x[b], x[c]) - 0.5, 0.0), min(max(x[a], x[b], x[c]) - 0.5, width - 1.0)
            first_y, last_y = max(min(y[a], y[b], y[c]) - 0.5, 0.0), min(max(y[a], y[b], y[c]) - 0.5, height - 1.0)
            for j in range(int(np.ceil(first_y)), int(np.floor(last_y)) + 1):
                for i in range(int(np.ceil(first_x)), int(np.floor(last_x)) + 1):
                    px, py = i + 0.5, j + 0.5
                    wa = ((x[b] - px) * (y[c] - py) - (y[b] - py) * (x[c] - px)) / area / z[a]
                    wb = ((x[c] - px) * (y[a] - py) - (y[c] - py) * (x[a] - px)) / area / z[b]
                    wc = ((x[a] - px) * (y[b] - py) - (y[a] - py) * (x[b] - px)) / area / z[c]
                    if min(wa, wb, wc) < 0.0:
                        continue
                    inverse = wa * quad[a, 2] + wb * quad[b, 2] + wc * quad[c, 2]  # 1/depth here
                    if inverse * factor <= nearest[j, i]:
                        continue
                    place = (wa * quad[a] + wb * quad[b] + wc * quad[c]) / (wa + wb + wc)
                    if _shade(place, source, color[j, i]):
                        nearest[j, i] = inverse * factor


@njit(cache=True)
def _shade(place, source, color):
    """The fragment shader of the warp: tells whether the fragment is kept."""
    codes, scale, joined, texels = source
    height, width = codes.shape
    column, row = int(np.floor(place[0] - 0.5)), int(np.floor(place[1] - 0.5))
    s, t = place[0] - 0.5 - column, place[1] - 0.5 - row
    columns = (min(max(column, 0), width - 1), min(max(column + 1, 0), width - 1))
    rows = (min(max(row, 0), height - 1), min(max(row + 1, 0), height - 1))
    right, lower = int(s >= 0.5), int(t >= 0.5)
    code = codes[rows[lower], columns[right]]
    near = code * scale
    if code == 65535 or abs(near - place[2]) > RIP * max(near, place[2]) + 2.0 * scale:
        return False
    word = joined[min(max(row + 1, 0), height), min(max(column + 1, 0), width)]
    label = (word >> (2 * (right + 2 * lower))) & 3
    total = 0.0
    color[:] = 0.0
    for k in range(4):
        if (word >> (2 * k)) & 3 == label:
            weight = (s if k & 1 else 1.0 - s) * (t if k & 2 else 1.0 - t)
            color += weight * texels[rows[k >> 1], columns[k & 1]]
            total += weight
    color /= total
    return True
