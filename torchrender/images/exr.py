"""OpenEXR pictures: half or float; RGB(A), luminance, and luminance with subsampled chroma.

Source of the chroma reconstruction: OpenEXR, "Luminance/chroma images" (technical introduction) and the 27-tap
half-band filter of its RGBA interface.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from torchrender.errors import ImageFileError
from torchrender.numerics.color import LUMINANCE_WEIGHTS

# Weights of the samples 1, 3, 5 ... 13 pixels away on either side of a pixel that has no chroma of its own.
_CHROMA_TAPS = (0.627123, -0.186077, 0.087929, -0.043159, 0.019597, -0.007540, 0.002128)


def read_exr(path: Path, max_pixels: int) -> np.ndarray[Any, Any]:
    """(H,W,C) float32 of the first part's data window; C is 1 (Y), 2 (Y, alpha), 3 (RGB) or 4 (RGBA).

    Raises:
        ImageFileError: damaged, larger than ``max_pixels``, or without channels that make a colour.
    """
    planes, chromaticities = _read(path, max_pixels)
    return _compose(path, planes, _luminance_weights(chromaticities))


def read_exr_depth(path: Path, max_pixels: int) -> np.ndarray[Any, Any]:
    """(H,W) float32 of the plane ``Z``, that of a layer, or else the only plane that is no alpha: ``Y`` or ``V``.

    Raises:
        ImageFileError: damaged, larger than ``max_pixels``, or without one plane that is depth; names those it has.
    """
    planes, _ = _read(path, max_pixels)
    layers = [name for name in planes if name.endswith(".Z")]
    values = [name for name in planes if name != "A" and not name.endswith(".A")]
    chosen = ["Z"] if "Z" in planes else layers or values
    if len(chosen) != 1:
        raise ImageFileError(path, f"needs one plane of depth, Z or Y, has {', '.join(sorted(planes)) or 'none'}")
    return planes[chosen[0]]


def _read(path: Path, max_pixels: int) -> tuple[dict[str, np.ndarray[Any, Any]], Any]:
    """Planes (H,W) float32 by name, and the chromaticities of the header, if any."""
    import OpenEXR  # few pictures are such files

    try:
        with OpenEXR.File(str(path), header_only=True) as file:
            header = dict(file.header())
        (left, top), (right, bottom) = (np.asarray(v, dtype=np.int64) for v in header["dataWindow"])
        height, width = int(bottom - top + 1), int(right - left + 1)
        if height < 1 or width < 1 or height * width > max_pixels:
            raise ImageFileError(path, f"declares {width} x {height} pixels, the limit is {max_pixels}")
        with OpenEXR.File(str(path), separate_channels=True) as file:
            planes = {
                name: _full_size(path, name, channel.pixels, (height, width))
                for name, channel in file.channels().items()
                if channel.pixels is not None
            }
    except ImageFileError:
        raise
    # The bindings raise bare RuntimeError, ValueError, KeyError and their own classes for damaged files.
    except Exception as error:
        raise ImageFileError(path, f"damaged or not an OpenEXR file ({error})") from error
    return planes, header.get("chromaticities")


def write_exr(path: Path, planes: Mapping[str, np.ndarray[Any, Any]]) -> None:
    """Float32 scan lines, ZIP compressed, one (H,W) plane per channel name."""
    import OpenEXR

    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    channels = {name: np.ascontiguousarray(plane, dtype=np.float32) for name, plane in planes.items()}
    with OpenEXR.File(header, channels) as file:
        file.write(str(path))


def _full_size(path: Path, name: str, pixels: np.ndarray[Any, Any], size: tuple[int, int]) -> np.ndarray[Any, Any]:
    plane = np.asarray(pixels, dtype=np.float32)
    for axis in (0, 1):
        if plane.shape[axis] == size[axis]:
            continue
        if plane.shape[axis] != (size[axis] + 1) // 2:
            raise ImageFileError(path, f"channel {name!r} is subsampled by other than 2, which is not supported")
        plane = upsample_chroma(plane, axis, size[axis])
    return plane


def upsample_chroma(plane: np.ndarray[Any, Any], axis: int, size: int) -> np.ndarray[Any, Any]:
    """Twice as many samples along ``axis``: the given ones stay at even places, odd places are interpolated."""
    known = np.moveaxis(plane, axis, 0)
    taps = len(_CHROMA_TAPS)
    padded = np.pad(known, [(taps, taps)] + [(0, 0)] * (known.ndim - 1), mode="edge")
    count = len(known)
    between = np.zeros_like(known)
    for k, weight in enumerate(_CHROMA_TAPS):
        between += np.float32(weight) * (padded[taps - k : taps - k + count] + padded[taps + 1 + k :][:count])
    out = np.zeros((2 * count, *known.shape[1:]), dtype=np.float32)
    out[0::2], out[1::2] = known, between
    return np.moveaxis(out[:size], 0, axis)


def _luminance_weights(chromaticities: Any) -> tuple[float, float, float]:
    """Luminance of the red, green and blue primary; BT.709 where the file names none."""
    if chromaticities is None:
        return LUMINANCE_WEIGHTS
    xy = np.asarray(chromaticities, dtype=np.float64).reshape(4, 2)
    xyz = np.stack([xy[:, 0] / xy[:, 1], np.ones(4), (1 - xy.sum(1)) / xy[:, 1]])
    weights = np.linalg.solve(xyz[:, :3], xyz[:, 3])
    return float(weights[0]), float(weights[1]), float(weights[2])


def _compose(
    path: Path, planes: dict[str, np.ndarray[Any, Any]], weights: tuple[float, float, float]
) -> np.ndarray[Any, Any]:
    prefix = next(
        (p for p in _layers(planes) if {p + "R", p + "G", p + "B"} <= planes.keys() or p + "Y" in planes), None
    )
    if prefix is None:
        raise ImageFileError(path, f"needs channels R, G, B or Y, has {', '.join(sorted(planes)) or 'none'}")
    if prefix + "R" in planes:
        color = [planes[prefix + c] for c in "RGB"]
    elif {prefix + "RY", prefix + "BY"} <= planes.keys():
        y = planes[prefix + "Y"]
        red, blue = (planes[prefix + "RY"] + 1) * y, (planes[prefix + "BY"] + 1) * y
        color = [red, (y - weights[0] * red - weights[2] * blue) / weights[1], blue]
        # Half floats and the interpolation leave small negative values where a saturated colour is dark.
        color = [np.maximum(c, 0.0) for c in color]
    else:
        color = [planes[prefix + "Y"]]
    if prefix + "A" in planes:
        color.append(planes[prefix + "A"])
    return np.stack(color, axis=-1)


def _layers(planes: dict[str, np.ndarray[Any, Any]]) -> list[str]:
    """Name prefixes of the layers, the unnamed one first."""
    return ["", *sorted({name.rpartition(".")[0] + "." for name in planes if "." in name})]
