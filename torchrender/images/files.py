"""Picture files in and out. In memory every picture is linear light, float32, row 0 on top.

PNG and JPEG hold sRGB and are decoded and encoded here; Radiance HDR and OpenEXR hold linear light already.
"""

from __future__ import annotations

import io
import os
import re
import secrets
import tempfile
import warnings
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch
from PIL import Image, ImageOps, UnidentifiedImageError
from torch import Tensor

from torchrender.errors import ImageFileError, InputError
from torchrender.images.exr import read_exr, write_exr
from torchrender.numerics.color import srgb_from_linear, srgb_table

READ_SUFFIXES = (".png", ".jpg", ".jpeg", ".hdr", ".exr")
WRITE_SUFFIXES = (".png", ".exr")
MAX_PIXELS = 2**28
"""Larger pictures are refused before memory is taken for them (as float RGB they would fill 3 GiB)."""

_CHANNEL_NAMES = {1: ("Y",), 2: ("Y", "A"), 3: ("R", "G", "B"), 4: ("R", "G", "B", "A")}
_KINDS = ((b"\x89PNG", ".png"), (b"\xff\xd8\xff", ".jpg"), (b"#?", ".hdr"), (b"\x76\x2f\x31\x01", ".exr"))


def read_image(path: str | Path) -> Tensor:
    """(H,W,C) float32 linear light of a PNG, JPEG, Radiance HDR or OpenEXR file.

    C is 1 (grey), 2 (grey, alpha), 3 (RGB) or 4 (RGBA). 8- and 16-bit sRGB is decoded at full precision, alpha is
    only scaled to [0,1]. EXR: the data window of the first part; luminance/chroma files become RGB. A camera's
    orientation tag is applied.

    Raises:
        ImageFileError: missing, empty, damaged, cut off, of an unsupported kind, or more than ``MAX_PIXELS``.
    """
    path = Path(path)
    if path.suffix.lower() not in READ_SUFFIXES:
        raise ImageFileError(path, f"cannot read {path.suffix or 'a file without suffix'}; {_list(READ_SUFFIXES)}")
    try:
        data = path.read_bytes()
    except FileNotFoundError as error:
        raise ImageFileError(path, "no such file") from error
    except OSError as error:
        raise ImageFileError(path, error.strerror or str(error)) from error
    return read_image_bytes(data, path)


def read_image_bytes(data: bytes, name: str | Path) -> Tensor:
    """Like :func:`read_image` for a picture in memory; its first bytes tell its kind, ``name`` is for messages."""
    if not data:
        raise ImageFileError(name, "the file is empty")
    kind = next((suffix for magic, suffix in _KINDS if data.startswith(magic)), None)
    if kind is None:
        raise ImageFileError(name, f"is no picture of a known kind; {_list(READ_SUFFIXES)}")
    if kind == ".hdr":
        return torch.from_numpy(_read_hdr(data, name))
    if kind == ".exr":
        return torch.from_numpy(_read_exr_bytes(data, name))
    return _read_srgb(data, name)


def write_image(path: str | Path, image: Tensor, *, channels: Sequence[str] | None = None) -> None:
    """Write linear (H,W) or (H,W,C) to ``.png`` (8-bit sRGB, clamped to [0,1]) or ``.exr`` (float32, as it is).

    ``channels`` names the C planes of an EXR file; the default is Y, YA, RGB or RGBA. The file appears whole or not
    at all.

    Raises:
        ImageFileError: unsupported suffix, missing folder, or the file cannot be written.
        InputError: wrong shape, NaN in a PNG, or channel names that do not fit.
    """
    path = Path(path)
    suffix = path.suffix.lower()
    if suffix not in WRITE_SUFFIXES:
        raise ImageFileError(path, f"cannot write {path.suffix or 'a file without suffix'}; {_list(WRITE_SUFFIXES)}")
    pixels = image.detach().cpu().float()
    if pixels.dim() == 2:
        pixels = pixels[..., None]
    if pixels.dim() != 3 or pixels.numel() == 0:
        raise InputError(f"image must have shape (H, W) or (H, W, C) and not be empty, got {tuple(image.shape)}")
    if suffix == ".png":
        if channels is not None:
            raise InputError("channels can only be named in EXR files")
        picture = _encode_png(pixels)
        write_atomically(path, lambda temporary: picture.save(temporary, format="PNG"))
        return
    names = _CHANNEL_NAMES.get(pixels.shape[2]) if channels is None else tuple(channels)
    if names is None or len(names) != pixels.shape[2] or len(set(names)) != len(names):
        raise InputError(f"channels must be {pixels.shape[2]} different names, got {names}")
    planes = {name: pixels[..., k].numpy() for k, name in enumerate(names)}
    write_atomically(path, lambda temporary: write_exr(temporary, planes))


def write_npz(path: str | Path, arrays: Mapping[str, Tensor | np.ndarray[Any, Any]]) -> None:
    """Write named arrays to a compressed ``.npz`` file, whole or not at all.

    Raises:
        ImageFileError: another suffix, missing folder, or the file cannot be written.
    """
    path = Path(path)
    if path.suffix.lower() != ".npz":
        raise ImageFileError(path, "arrays are written to .npz")
    plain = {k: v.detach().cpu().numpy() if isinstance(v, Tensor) else np.asarray(v) for k, v in arrays.items()}

    def write(temporary: Path) -> None:
        with temporary.open("wb") as file:
            np.savez_compressed(file, **plain)  # type: ignore[arg-type]

    write_atomically(path, write)


def write_atomically(path: Path, write: Callable[[Path], None]) -> None:
    """Call ``write`` with a temporary name in the same folder, then rename; nothing is left behind on failure.

    Raises:
        ImageFileError: the folder does not exist, or the file cannot be written.
    """
    if not path.parent.is_dir():
        raise ImageFileError(path, f"folder {path.parent} does not exist")
    temporary = path.with_name(f".{path.stem}-{secrets.token_hex(6)}{path.suffix}")
    try:
        write(temporary)
        os.replace(temporary, path)
    # OpenEXR reports a full disk as a bare RuntimeError.
    except (OSError, RuntimeError) as error:
        raise ImageFileError(path, f"cannot be written ({error})") from error
    finally:
        temporary.unlink(missing_ok=True)


def _list(suffixes: Sequence[str]) -> str:
    return "supported: " + ", ".join(suffixes)


def _check_size(name: str | Path, width: int, height: int) -> None:
    if width < 1 or height < 1 or width * height > MAX_PIXELS:
        raise ImageFileError(name, f"declares {width} x {height} pixels, the limit is {MAX_PIXELS}")


def _read_srgb(data: bytes, name: str | Path) -> Tensor:
    try:
        with warnings.catch_warnings():
            # Pillow's own size limit only warns, and lower than ours; ours is checked before decoding.
            warnings.simplefilter("ignore", Image.DecompressionBombWarning)
            picture: Image.Image = Image.open(io.BytesIO(data), formats=("PNG", "JPEG"))
        _check_size(name, *picture.size)
        deep = picture.format == "PNG" and data[24:25] == b"\x10"
        picture.load()
        codes = _deep_png(data, name) if deep else _codes(ImageOps.exif_transpose(picture))
    except ImageFileError:
        raise
    except Image.DecompressionBombError as error:
        raise ImageFileError(name, f"declares more pixels than the limit of {MAX_PIXELS}") from error
    except (UnidentifiedImageError, OSError, ValueError, SyntaxError, EOFError) as error:
        raise ImageFileError(name, f"damaged or cut off ({error})") from error
    return _linear(codes)


def _codes(picture: Image.Image) -> np.ndarray[Any, Any]:
    """(H,W,C) uint8."""
    if picture.mode not in ("L", "LA", "RGB", "RGBA"):
        clear = "transparency" in picture.info or picture.mode in ("PA", "La", "RGBa")
        grey = picture.mode in ("1", "I", "F")
        picture = picture.convert("RGBA" if clear else "L" if grey else "RGB")
    elif "transparency" in picture.info:
        picture = picture.convert("LA" if picture.mode == "L" else "RGBA")
    codes = np.asarray(picture)
    return codes[..., None] if codes.ndim == 2 else codes


def _deep_png(data: bytes, name: str | Path) -> np.ndarray[Any, Any]:
    """(H,W,C) uint16; Pillow would cut 16-bit colour to 8 bits."""
    import cv2  # slow to import, and few pictures need it

    codes = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    if codes is None or codes.dtype != np.uint16:
        raise ImageFileError(name, "damaged 16-bit PNG")
    if codes.ndim == 2:
        return codes[..., None]
    order = [2, 1, 0, 3][: codes.shape[2]]
    codes = codes[..., order]
    # PNG colour type 4 (byte 25) is grey with alpha, which OpenCV expands to four channels.
    return codes[..., 2:] if data[25] == 4 else codes


def _linear(codes: np.ndarray[Any, Any]) -> Tensor:
    bits = 8 * codes.dtype.itemsize
    colors = 1 if codes.shape[2] <= 2 else 3
    table = srgb_table(bits).numpy()
    if codes.shape[2] == colors:
        return torch.from_numpy(table[codes])
    out = np.zeros(codes.shape, dtype=np.float32)
    out[..., :colors] = table[codes[..., :colors]]
    out[..., colors] = codes[..., colors] / np.float32(2**bits - 1)
    return torch.from_numpy(out)


def _read_hdr(data: bytes, name: str | Path) -> np.ndarray[Any, Any]:
    import cv2  # slow to import, and few pictures need it

    size = re.search(rb"\n[-+]([XY]) (\d{1,9}) [-+][XY] (\d{1,9})\n", data[:65536])
    if size is None:
        raise ImageFileError(name, "Radiance header without a size line: damaged or cut off")
    first, second = int(size.group(2)), int(size.group(3))
    _check_size(name, *((second, first) if size.group(1) == b"Y" else (first, second)))
    try:
        pixels = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    except cv2.error as error:
        raise ImageFileError(name, f"damaged ({error})") from error
    if pixels is None or pixels.ndim != 3:
        raise ImageFileError(name, "damaged or cut off Radiance picture")
    return np.ascontiguousarray(pixels[..., ::-1], dtype=np.float32)


def _read_exr_bytes(data: bytes, name: str | Path) -> np.ndarray[Any, Any]:
    if isinstance(name, Path) and name.is_file():
        return read_exr(name, MAX_PIXELS)
    # Older bindings read from files only.
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "image.exr"
        path.write_bytes(data)
        try:
            return read_exr(path, MAX_PIXELS)
        except ImageFileError as error:
            raise ImageFileError(name, error.reason) from error


def _encode_png(pixels: Tensor) -> Image.Image:
    count = pixels.shape[2]
    if count not in _CHANNEL_NAMES:
        raise InputError(f"a PNG has 1 to 4 channels, got {count}")
    if bool(pixels.isnan().any()):
        raise InputError("image must not contain NaN")
    pixels = pixels.clamp(0.0, 1.0)
    colors = 1 if count <= 2 else 3
    encoded = torch.cat([srgb_from_linear(pixels[..., :colors]), pixels[..., colors:]], dim=-1)
    codes = (encoded * 255.0 + 0.5).to(torch.uint8).numpy()
    return Image.fromarray(codes[..., 0] if count == 1 else codes)
