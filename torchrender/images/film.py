"""Films from pictures, whole or not at all."""

from __future__ import annotations

import os
import re
import shutil
import warnings
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Protocol, runtime_checkable

import numpy as np
import torch
from PIL import Image as PillowImage
from torch import Tensor

from torchrender.checks import check_class, check_range
from torchrender.errors import ImageFileError, InputError, NotUsedWarning
from torchrender.images.files import new_folder, write_atomically, write_image
from torchrender.numerics.color import srgb_from_linear

CODECS = {".mp4": "mp4v", ".avi": "MJPG"}
FILMS = (*CODECS, ".gif")
"""Suffixes of films; a path without one is a folder of numbered PNG files."""
_FRAME = re.compile(r"frame_(\d{4,9})\.png")


@runtime_checkable
class Displayed(Protocol):
    """A picture that knows how it is shown, such as :class:`torchrender.Image`."""

    def displayed(self) -> Tensor:
        """(B,H,W,3) linear values in [0,1]."""
        ...


def write_film(path: str | Path, frames: Displayed | Iterable[Displayed | Tensor], fps: float = 30.0) -> list[Path]:
    """Write pictures as a film; returns the files written. The film appears whole or not at all.

    ``.mp4`` (MPEG-4 part 2), ``.avi`` (Motion JPEG) and ``.gif`` (256 colours, endless); a path without suffix is a
    folder of ``frame_0000.png`` …, made where it is missing; frames of an earlier, longer film that are still there are
    said, with a NotUsedWarning. MP4 and AVI have even sides: an odd last row or column is
    left out, with a NotUsedWarning. GIF counts hundredths of a second: frames get those in turn that keep the film's
    length.

    Args:
        frames: pictures, or linear tensors (H,W,3) or (B,H,W,3) in [0,1], all of one size. A batch is so many frames.
            They may come from a generator: one at a time is held (GIF: all, eight bits each).
        fps: frames per second, 0.1 to 240; GIF at most 50.

    Raises:
        OptionError: ``fps`` outside its range.
        ImageFileError: another suffix, a missing folder, or a film that cannot be written here, or not all of it.
        InputError: no frames, frames of several sizes, of another shape or with NaN, or too small for a film.
    """
    check_class("path", path, str, Path)
    path = Path(path)
    suffix = path.suffix.lower()
    if suffix and suffix not in FILMS:
        raise ImageFileError(path, f"films are {', '.join(FILMS)} or a folder of PNG files, not {path.suffix}")
    check_range("fps", fps, 0.1, 50.0 if suffix == ".gif" else 240.0)
    pictures = _of_one_size(frames)
    if not suffix:
        return _write_frames(path, pictures)
    if suffix == ".gif":
        write_atomically(path, lambda temporary: _write_gif(temporary, pictures, fps))
    else:
        write_atomically(path, lambda temporary: _encode(temporary, pictures, fps, CODECS[suffix]))
    return [path]


def _of_one_size(frames: Displayed | Iterable[Displayed | Tensor]) -> Iterator[Tensor]:
    """Linear (H,W,3) one after the other.

    Raises:
        InputError: none at all, or one that does not fit; names its number.
    """
    size, number = None, 0
    if isinstance(frames, Displayed):  # one picture, or a batch of them
        frames = (frames,)
    elif not isinstance(frames, Iterable):
        raise InputError(f"frames must be pictures one after the other, got {type(frames).__name__}")
    for frame in frames:
        batch = frame.displayed() if isinstance(frame, Displayed) else frame
        if not isinstance(batch, Tensor) or batch.dim() not in (3, 4) or batch.shape[-1] != 3:
            told = tuple(batch.shape) if isinstance(batch, Tensor) else type(batch).__name__
            raise InputError(f"frame {number} must be a picture or a tensor (H, W, 3) or (B, H, W, 3), got {told}")
        for picture in batch.detach()[None] if batch.dim() == 3 else batch.detach():
            size = size or picture.shape
            if picture.shape != size or not picture.numel():
                want = f"{size[1]}x{size[0]}"
                raise InputError(f"frame {number} must be {want} pixels, got {picture.shape[1]}x{picture.shape[0]}")
            if bool(torch.isnan(picture).any()):
                raise InputError(f"frame {number} must hold no NaN")
            yield picture
            number += 1
    if not number:
        raise InputError("a film needs at least one frame")


def _codes(picture: Tensor) -> np.ndarray:
    """(H,W,3) sRGB bytes."""
    return (srgb_from_linear(picture.clamp(0.0, 1.0)) * 255.0 + 0.5).to("cpu").numpy().astype(np.uint8)


def _write_frames(folder: Path, pictures: Iterator[Tensor]) -> list[Path]:
    files: list[Path] = []
    with new_folder(folder):
        for number, picture in enumerate(pictures):
            files.append(folder / frame_name(number))
            write_image(files[-1], picture)
    rest = sum(1 for number in _numbers(folder) if number >= len(files))
    if rest:
        told = f"{folder} holds {rest} more frames, from number {len(files)} on, that are not of this film"
        warnings.warn(told, NotUsedWarning, stacklevel=3)
    return files


def frame_name(number: int) -> str:
    """Of a film in a folder."""
    return f"frame_{number:04d}.png"


def _numbers(folder: Path) -> Iterator[int]:
    """Of the frames in a folder."""
    for file in folder.iterdir():
        match = _FRAME.fullmatch(file.name)
        if match is not None:
            yield int(match[1])


def _write_gif(path: Path, pictures: Iterator[Tensor], fps: float) -> None:
    images = [PillowImage.fromarray(_codes(picture)).quantize(256) for picture in pictures]
    ends = [round(100.0 * (k + 1) / fps) for k in range(len(images))]
    times = [10 * (end - begin) for begin, end in zip([0, *ends[:-1]], ends)]  # ms, whole hundredths
    images[0].save(path, save_all=True, append_images=images[1:], duration=times, loop=0, disposal=1)


def _say_size(path: Path, width: int, height: int) -> None:
    """Say what does not fit a film, whose sides are even."""
    odd = [what for what, side in (("column", width), ("row", height)) if side % 2 and side > 1]
    if odd:
        told = f"{path.suffix} films have even sides: the last {' and '.join(odd)} of {width}x{height} pixels left out"
        warnings.warn(told, NotUsedWarning, stacklevel=2)


def _encode(path: Path, pictures: Iterator[Tensor], fps: float, codec: str) -> None:
    import cv2

    writer, count = None, 0
    try:
        for picture in pictures:
            codes = _codes(picture)[..., ::-1]
            if writer is None:
                size = (codes.shape[1] // 2 * 2, codes.shape[0] // 2 * 2)
                _say_size(path, codes.shape[1], codes.shape[0])
                if min(size) < 2:
                    raise InputError(
                        f"a film needs pictures of at least 2x2 pixels, got {codes.shape[1]}x{codes.shape[0]}"
                    )
                writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*codec), fps, size)
                if not writer.isOpened():
                    raise OSError(f"OpenCV cannot write {path.suffix} films here; take .gif or a folder")
            writer.write(np.ascontiguousarray(codes[: size[1], : size[0]]))
            count += 1
    finally:
        if writer is not None:
            writer.release()
    _check_whole(path, count)


def _check_whole(path: Path, count: int) -> None:
    """Read a film once more: OpenCV says nothing of a disk that takes no more.

    Raises:
        OSError: it does not hold so many frames.
    """
    import cv2

    handle = os.open(path, os.O_RDWR)
    try:
        os.fsync(handle)  # what the disk refuses only now is an error of its own
    finally:
        os.close(handle)
    film, found = cv2.VideoCapture(str(path)), 0
    try:
        while film.grab():
            found += 1
    finally:
        film.release()
    if found != count:
        free = shutil.disk_usage(path.parent).free
        raise OSError(f"{found} of {count} frames can be read of what was written; {free:,} bytes are free there")
