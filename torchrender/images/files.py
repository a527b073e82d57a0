"""Picture files in and out. In memory every picture is linear light, float32, row 0 on top.

PNG, JPEG, WebP, BMP, TGA and KTX2 hold sRGB; Radiance HDR and OpenEXR hold linear light already.
"""

from __future__ import annotations

import io
import os
import secrets
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np
import torch
from PIL import Image
from torch import Tensor

from torchrender.errors import ImageFileError, InputError
from torchrender.images.bounded import converted, kept_as_codes
from torchrender.images.coded import linear, read_codes, scaled
from torchrender.images.exr import read_exr, write_exr
from torchrender.images.ktx import read_ktx2
from torchrender.images.radiance import read_radiance
from torchrender.numerics.color import srgb_from_linear
from torchrender.numerics.texels.coded import room_for

READ_SUFFIXES = (".png", ".jpg", ".jpeg", ".webp", ".bmp", ".tga", ".ktx2", ".hdr", ".pic", ".exr")
WRITE_SUFFIXES = (".png", ".exr")
MAX_PIXELS = 2**28
PNG_LEVEL = 4
"""Of compression: half the time of the usual 6 for files that are 5 to 9 % larger."""
"""Larger pictures are refused before memory is taken for them (as float RGB they would fill 3 GiB)."""

_CHANNEL_NAMES = {1: ("Y",), 2: ("Y", "A"), 3: ("R", "G", "B"), 4: ("R", "G", "B", "A")}
_KINDS = (
    (b"\x89PNG", ".png"),
    (b"\xff\xd8\xff", ".jpg"),
    (b"RIFF", ".webp"),
    (b"BM", ".bmp"),
    (b"\xabKTX 20\xbb", ".ktx2"),
    (b"#?", ".hdr"),
    (b"\x76\x2f\x31\x01", ".exr"),
)


def read_image(path: str | Path, *, encoded: bool = False) -> Tensor:
    """(H,W,C) float32 linear light of a PNG, JPEG, WebP, BMP, TGA, KTX2, Radiance or OpenEXR file.

    C is 1 (grey), 2 (grey, alpha), 3 (RGB) or 4 (RGBA). 8- and 16-bit sRGB is decoded at full precision, alpha is
    only scaled to [0,1]. EXR: the data window of the first part; luminance/chroma files become RGB. A camera's
    orientation tag is applied, and so is the order of lines and columns of a Radiance picture. KTX2 needs the package
    opengl_basisu, which the extra ``ktx`` brings.

    Args:
        encoded: leave the codes of an sRGB picture as they are, scaled to [0,1]: for normals and other plain numbers.

    Raises:
        ImageFileError: missing, empty, damaged, cut off, of an unsupported kind, or more than ``MAX_PIXELS``.
    """
    path = _of_known_kind(path)
    return read_image_bytes(picture_bytes(path), path, encoded=encoded)


def _of_known_kind(path: str | Path) -> Path:
    path = Path(path)
    if path.suffix.lower() not in READ_SUFFIXES:
        raise ImageFileError(path, f"cannot read {path.suffix or 'a file without suffix'}; {_list(READ_SUFFIXES)}")
    return path


def picture_bytes(path: Path) -> bytes:
    """What is in the file of a picture.

    Raises:
        ImageFileError: missing, or not readable.
    """
    try:
        return path.read_bytes()
    except FileNotFoundError as error:
        raise ImageFileError(path, "no such file") from error
    except OSError as error:
        raise ImageFileError(path, error.strerror or str(error)) from error


def read_image_bytes(data: bytes, name: str | Path, *, encoded: bool = False) -> Tensor:
    """Like :func:`read_image` for a picture in memory; its first bytes tell its kind, ``name`` is for messages."""
    found = _codes_or_numbers(data, name)
    return found if isinstance(found, Tensor) else converted(found, scaled if encoded else linear)


def read_texture_bytes(data: bytes, name: str | Path, *, encoded: bool = False) -> Tensor:
    """The same numbers as a texture (H,W,3|4): grey is repeated, and codes of 8 bits are kept as they are."""
    found = _codes_or_numbers(data, name)
    if isinstance(found, Tensor) or found.dtype != np.uint8:
        return as_texture(found if isinstance(found, Tensor) else converted(found, scaled if encoded else linear))
    if found.shape[2] <= 2:
        grey, whole = found, room_for((*found.shape[:2], found.shape[2] + 2), np.uint8)
        whole[..., :3], whole[..., 3:] = grey[..., :1], grey[..., 1:]
        found = whole
    return kept_as_codes(found, 0 if encoded else 3)


def as_texture(image: Tensor) -> Tensor:
    """(H,W,3|4) from a picture (H,W,C) of 1 to 4 channels: grey is repeated."""
    if image.shape[2] <= 2:
        return torch.cat([image[..., :1].expand(-1, -1, 3), image[..., 1:]], dim=-1)
    return image


def read_texture(path: str | Path, *, encoded: bool = False) -> Tensor:
    """Like :func:`read_texture_bytes` for a file. Errors as :func:`read_image`."""
    return read_texture_bytes(picture_bytes(_of_known_kind(path)), Path(path), encoded=encoded)


def _codes_or_numbers(data: bytes, name: str | Path) -> np.ndarray[Any, Any] | Tensor:
    """(H,W,C) codes, or linear light as the file has it."""
    if not data:
        raise ImageFileError(name, "the file is empty")
    kind = next((suffix for magic, suffix in _KINDS if data.startswith(magic)), None)
    if kind is None and Path(name).suffix.lower() == ".tga":  # the only kind that has no first bytes of its own
        kind = ".tga"
    if kind is None:
        raise ImageFileError(name, f"is no picture of a known kind; {_list(READ_SUFFIXES)}")
    if kind == ".hdr":
        return torch.from_numpy(read_radiance(data, name, MAX_PIXELS))
    if kind == ".exr":
        return torch.from_numpy(_read_exr_bytes(data, name))
    return read_ktx2(data, name, MAX_PIXELS) if kind == ".ktx2" else read_codes(data, name, MAX_PIXELS)


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
        write_atomically(path, lambda temporary: picture.save(temporary, format="PNG", compress_level=PNG_LEVEL))
        return
    names = _CHANNEL_NAMES.get(pixels.shape[2]) if channels is None else tuple(channels)
    if names is None or len(names) != pixels.shape[2] or len(set(names)) != len(names):
        raise InputError(f"channels must be {pixels.shape[2]} different names, got {names}")
    planes = {name: pixels[..., k].numpy() for k, name in enumerate(names)}
    write_atomically(path, lambda temporary: write_exr(temporary, planes))


def numbered(path: Path, number: int, count: int) -> Path:
    """``path`` itself if it is the only one of ``count``, else with ``_000``-style number before the suffix."""
    return path if count == 1 else path.with_name(f"{path.stem}_{number:03d}{path.suffix}")


def png_bytes(image: Tensor) -> bytes:
    """Linear (H,W) or (H,W,C) as the content of a PNG file, 8-bit sRGB, clamped to [0,1]."""
    pixels = image.detach().cpu().float()
    out = io.BytesIO()
    _encode_png(pixels[..., None] if pixels.dim() == 2 else pixels).save(out, format="PNG", compress_level=PNG_LEVEL)
    return out.getvalue()


def side_by_side(pictures: Tensor, most: int = 4) -> Tensor:
    """The first of B pictures (B,H,W,C) in a row (H,W,C), as notebooks show a batch."""
    return torch.cat(list(pictures[:most].detach()), dim=1)


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
    temporary = _temporary(path)
    try:
        write(temporary)
        os.replace(temporary, path)
    # OpenEXR reports a full disk as a bare RuntimeError.
    except (OSError, RuntimeError) as error:
        raise ImageFileError(path, f"cannot be written ({error})") from error
    finally:
        with suppress(OSError):
            temporary.unlink(missing_ok=True)


@contextmanager
def new_folder(path: Path) -> Iterator[None]:
    """Make a folder and those above it for what is written meanwhile; where that fails, those that were made and are
    empty go again.

    Raises:
        ImageFileError: it cannot be made.
    """
    made = [one for one in (path, *path.parents) if not one.is_dir()]
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ImageFileError(path, error.strerror or str(error)) from error
    try:
        yield
    except BaseException:
        with suppress(OSError):
            for folder in made:
                folder.rmdir()
        raise


def check_writable(path: Path) -> None:
    """Find out before the work whether :func:`write_atomically` can write a file; none is left behind.

    Raises:
        ImageFileError: the folder does not exist or takes no file of that name, or a folder stands in its place.
    """
    temporary = _temporary(path)
    try:
        if path.is_dir():  # an error where the name is too long
            raise ImageFileError(path, "cannot be written (there is a folder of that name)")
        temporary.open("xb").close()
        temporary.unlink()
    except OSError as error:
        raise ImageFileError(path, f"cannot be written ({error.strerror or error})") from error


def _temporary(path: Path) -> Path:
    """A name beside a file, for what becomes that file: short, so that any name of a file has room for it.

    Raises:
        ImageFileError: the folder does not exist.
    """
    if not path.parent.is_dir():
        raise ImageFileError(path, f"folder {path.parent} does not exist")
    return path.with_name(f".{secrets.token_hex(8)}{path.suffix}")


def write_bytes(path: Path, data: bytes) -> None:
    """A file with this content, as :func:`write_atomically` writes it.

    Raises:
        ImageFileError: as there.
    """

    def write(temporary: Path) -> None:
        temporary.write_bytes(data)

    write_atomically(path, write)


def _list(suffixes: Sequence[str]) -> str:
    return "supported: " + ", ".join(suffixes)


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
