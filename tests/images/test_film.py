"""Films: whole or not at all, at the right speed, in every format."""

from __future__ import annotations

import contextlib
import signal
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import pytest
import torch
from PIL import Image

import torchrender as tr
from torchrender.errors import ImageFileError, InputError, NotUsedWarning, OptionError

pytestmark = pytest.mark.filterwarnings("ignore:.* films have even sides")

FRAMES = [torch.full((10, 13, 3), level) for level in (0.1, 0.4, 0.9)]


def read(path: Path) -> list[tuple[int, ...]]:
    film, shapes = cv2.VideoCapture(str(path)), []
    while True:
        good, picture = film.read()
        if not good:
            return shapes
        shapes.append(picture.shape)


@pytest.mark.parametrize("suffix", [".mp4", ".avi"])
def test_films_hold_every_frame(suffix: str, tmp_path: Path) -> None:
    path = tmp_path / f"film{suffix}"
    assert tr.write_film(path, iter(FRAMES), 25) == [path]
    assert read(path) == [(10, 12, 3)] * 3  # even sides
    assert cv2.VideoCapture(str(path)).get(cv2.CAP_PROP_FPS) == 25
    assert [p.name for p in tmp_path.iterdir()] == [path.name]


def test_a_gif_keeps_its_length(tmp_path: Path) -> None:
    frames = [torch.full((4, 5, 3), k / 30) for k in range(30)]
    (path,) = tr.write_film(tmp_path / "film.gif", frames, 30)
    with Image.open(path) as film:
        assert film.n_frames == 30 and film.info["loop"] == 0 and film.size == (5, 4)
        times = []
        for number in range(30):
            film.seek(number)
            times.append(film.info["duration"])
    assert set(times) == {30, 40} and sum(times) == 1000  # hundredths of a second that add up to one


def test_a_folder_of_pictures_and_batches(tmp_path: Path) -> None:
    scene = tr.load("cornell_box", size=100)
    camera = scene.camera(width=16, height=12)
    image = tr.render(scene, tr.Cameras.cat([camera, camera]))
    files = tr.write_film(tmp_path / "new" / "frames", [image, image.displayed()[0]])
    assert [f.name for f in files] == ["frame_0000.png", "frame_0001.png", "frame_0002.png"]
    shown = [Image.open(f).tobytes() for f in files]
    assert shown[0] == shown[2]


def failing() -> object:
    yield FRAMES[0]
    raise KeyError("the scene is gone")


@pytest.mark.parametrize("name", ["film.mp4", "film.gif"])
def test_what_fails_half_way_leaves_the_old_film(name: str, tmp_path: Path) -> None:
    (tmp_path / name).write_bytes(b"old")
    with pytest.raises(KeyError):
        tr.write_film(tmp_path / name, failing())
    assert (tmp_path / name).read_bytes() == b"old" and len(list(tmp_path.iterdir())) == 1


@pytest.mark.parametrize(
    ("name", "frames", "fps", "error", "told"),
    [
        ("film.mov", FRAMES, 30, ImageFileError, ".mp4, .avi, .gif or a folder"),
        ("none/film.mp4", FRAMES, 30, ImageFileError, "does not exist"),
        ("film.mp4", FRAMES, 0, OptionError, "fps"),
        ("film.gif", FRAMES, 60, OptionError, r"\[0.1, 50"),
        ("film.mp4", [], 30, InputError, "at least one frame"),
        ("film.mp4", [FRAMES[0], torch.zeros(10, 14, 3)], 30, InputError, "frame 1 must be 13x10 pixels, got 14x10"),
        ("film.mp4", [torch.zeros(10, 13)], 30, InputError, r"frame 0 must be a picture"),
        ("film.gif", [FRAMES[0], FRAMES[1] * float("nan")], 30, InputError, "frame 1 must hold no NaN"),
        ("film.avi", [torch.zeros(1, 1, 3)], 30, InputError, "2x2"),
        ("film.mp4", ["a.png"], 30, InputError, "got str"),
    ],
)
def test_what_cannot_be_is_said(name, frames, fps, error, told, tmp_path: Path) -> None:
    with pytest.raises(error, match=told):
        tr.write_film(tmp_path / name, frames, fps)
    assert not list(tmp_path.iterdir())


def test_one_picture_is_a_film_too(tmp_path: Path) -> None:
    class Still:
        def displayed(self) -> torch.Tensor:
            return torch.rand(2, 8, 8, 3)

    assert len(tr.write_film(tmp_path / "frames", Still())) == 2
    word: Any = 3
    with pytest.raises(InputError, match="frames must be pictures one after the other, got int"):
        tr.write_film(tmp_path / "frames", word)


def test_what_odd_sides_lose_is_said(tmp_path: Path) -> None:
    with pytest.warns(NotUsedWarning, match=r"\.mp4 films have even sides: the last column of 13x10 pixels left out"):
        tr.write_film(tmp_path / "odd.mp4", FRAMES)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        tr.write_film(tmp_path / "even.mp4", [frame[:, :12] for frame in FRAMES])


@contextlib.contextmanager
def room_for(size: int) -> Iterator[None]:
    """Files may have so many bytes: what a full disk is to their writers."""
    resource = pytest.importorskip("resource")
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    usual = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
        signal.signal(signal.SIGXFSZ, usual)


@pytest.mark.parametrize("suffix", [".mp4", ".avi", ".gif"])
def test_a_film_that_the_disk_does_not_take_is_none(suffix: str, tmp_path: Path) -> None:
    path = tmp_path / f"film{suffix}"
    path.write_bytes(b"old")
    frames = [torch.rand(96, 128, 3) for _ in range(20)]
    with room_for(24 << 10), pytest.raises(ImageFileError, match=rf"film\{suffix}: cannot be written \("):
        tr.write_film(path, frames)
    assert path.read_bytes() == b"old" and len(list(tmp_path.iterdir())) == 1
    tr.write_film(path, frames)
    assert path.stat().st_size > 24 << 10, "what was tried above is more than fits"


def test_how_many_frames_can_be_read_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    usual = cv2.VideoWriter

    class Forgetful:
        """Leaves every other frame out."""

        fourcc = staticmethod(usual.fourcc)

        def __init__(self, *arguments: Any) -> None:
            self._writer, self._count = usual(*arguments), 0

        def write(self, picture: Any) -> None:
            self._count += 1
            if self._count % 2:
                self._writer.write(picture)

        def isOpened(self) -> bool:
            return self._writer.isOpened()

        def release(self) -> None:
            self._writer.release()

    monkeypatch.setattr(cv2, "VideoWriter", Forgetful)
    with pytest.raises(ImageFileError, match=r"2 of 3 frames can be read of what was written; [\d,]+ bytes are free"):
        tr.write_film(tmp_path / "film.avi", FRAMES)
    assert not list(tmp_path.iterdir())


def test_frames_of_a_longer_film_are_told(tmp_path: Path) -> None:
    tr.write_film(tmp_path, FRAMES)
    (tmp_path / "frame_old.png").write_bytes(b"")
    with pytest.warns(NotUsedWarning, match="holds 2 more frames, from number 1 on, that are not of this film"):
        tr.write_film(tmp_path, FRAMES[:1])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        tr.write_film(tmp_path, FRAMES)
