"""What the command line writes: sizes and checks before the work, progress during it, files after it."""

from __future__ import annotations

import gc
import os
import re
import signal
import sys
import threading
import warnings
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeVar

from torchrender.errors import ImageFileError, OptionError, TorchRenderWarning

T = TypeVar("T")

LASTING = frozenset({"serve", "load-test"})
"""Commands that run for hours and end as Python does."""

LASTING = frozenset({"serve", "load-test"})
"""Commands that run for hours and end as Python does."""

_CHANNELS = ("Z", "id.triangle", "id.object", "layer")
_ARRAYS = ("depth", "triangle", "object_id", "barycentric", "normal", "layer", "truncated")


def image_size(text: str) -> tuple[int, int]:
    """Width and height from ``1024x768``.

    Raises:
        OptionError: another form, a side outside of 1 to 32768, or more pixels than picture files may have.
    """
    from torchrender.images.files import MAX_PIXELS
    from torchrender.scene.cameras.record import MAX_SIDE

    match = re.fullmatch(r"(\d+)[xX](\d+)", text.strip())
    if match is None:
        raise OptionError(f"--size must look like 1024x768, got {text!r}")
    # Numbers of any length are read, but not those that Python takes long for.
    width, height = (int(side[:9]) if len(side.lstrip("0")) < 9 else MAX_SIDE + 1 for side in match.groups())
    if not (1 <= width <= MAX_SIDE and 1 <= height <= MAX_SIDE and width * height <= MAX_PIXELS):
        limits = f"sides of 1 to {MAX_SIDE} pixels, and {MAX_PIXELS:,} pixels at most"
        raise OptionError(f"--size must have {limits}, got {text!r}")
    return width, height


def check_output(path: Path, suffixes: Sequence[str]) -> None:
    """Refuse an output that cannot be written before the work is done."""
    if path.suffix.lower() not in suffixes:
        raise ImageFileError(path, f"the output must be {', '.join(suffixes)}, not {path.suffix or 'without suffix'}")
    check_file(path)


def check_file(path: Path) -> None:
    """Refuse a file that cannot be written: see :func:`~torchrender.images.files.check_writable`."""
    from torchrender.images.files import check_writable

    check_writable(path)


def check_folder(path: Path) -> None:
    """Refuse a folder for files that cannot be made, or that takes none; it is made when there is something to write.

    Raises:
        ImageFileError: it is a file or below one, or nothing can be written there.
    """
    there = next(one for one in (path, *path.absolute().parents) if os.path.lexists(one))
    if not there.is_dir():
        raise ImageFileError(path, f"{there} is no folder")
    try:
        check_file(there / "file")
    except ImageFileError as error:
        raise ImageFileError(path, f"{there} takes no files: it {error.reason}") from error


def make_folder(path: Path) -> None:
    """Make a folder and those above it."""
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ImageFileError(path, error.strerror or str(error)) from error


def collect_garbage() -> None:
    """Switch the garbage collector on again, which a command starts without: long ones would fill the memory."""
    if not gc.isenabled():
        gc.freeze()  # what was imported stays
        gc.enable()


def plain(text: str) -> str:
    """A line for a terminal: what files hold may be control characters, which are shown as escapes."""
    return "".join(c if c.isprintable() else c.encode("unicode_escape", "backslashreplace").decode() for c in text)


def in_words(value: object) -> str:
    """A value of what ``info`` prints."""
    if isinstance(value, float):
        return f"{value:.6g}"
    if isinstance(value, int) and not isinstance(value, bool):
        return f"{value:,}"
    if isinstance(value, dict):
        return ", ".join(f"{count} {name}" for name, count in value.items()) or "none"
    if isinstance(value, list):
        return ", ".join(f"({in_words(v)})" if isinstance(v, list) else in_words(v) for v in value) or "none"
    return "none" if value is None else str(value)


class Terminated(KeyboardInterrupt):
    """The process was told to end, by SIGTERM."""


@contextmanager
def ending_when_told(command: str) -> Iterator[None]:
    """SIGTERM ends a command as Ctrl-C does, so that nothing half written stays; once more, at once.

    Raises:
        Terminated: the signal came.
    """
    usual = signal.getsignal(signal.SIGTERM) == signal.SIG_DFL
    if command in LASTING or not usual or threading.current_thread() is not threading.main_thread():
        yield
        return

    def stop(*_: object) -> None:
        signal.signal(signal.SIGTERM, signal.SIG_DFL)
        raise Terminated

    signal.signal(signal.SIGTERM, stop)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, signal.SIG_DFL)


@contextmanager
def saying_warnings() -> Iterator[None]:
    """Warnings of this package are one line each on stderr, said once."""
    with warnings.catch_warnings():
        usual = warnings.showwarning
        said = set()

        def say(message: Warning | str, category: type[Warning], *rest: Any, **more: Any) -> None:
            if not issubclass(category, TorchRenderWarning):
                usual(message, category, *rest, **more)
            elif str(message) not in said:
                said.add(str(message))
                print(f"torchrender: warning: {plain(str(message))}", file=sys.stderr)

        warnings.showwarning = say
        warnings.simplefilter("always", TorchRenderWarning)
        yield


PATIENCE_S = 2.0
"""What takes longer is shown, if somebody is watching."""


@contextmanager
def waiting(what: str) -> Iterator[None]:
    """A line on stderr that counts the seconds of one long step, once it has taken :data:`PATIENCE_S`."""
    if not sys.stderr.isatty():
        yield
        return
    done = threading.Event()

    def show() -> None:
        if done.wait(PATIENCE_S):
            return
        from tqdm import tqdm

        form = "{desc} {elapsed}"
        with tqdm(desc=what, bar_format=form, file=sys.stderr, leave=False, initial=int(PATIENCE_S)) as line:
            while not done.wait(0.5):
                line.update()

    watcher = threading.Thread(target=show, daemon=True)
    watcher.start()
    try:
        yield
    finally:
        done.set()
        watcher.join()


@contextmanager
def sharing(what: str) -> Iterator[Callable[[str, float], None]]:
    """A progress bar on stderr for steps that tell their share, after :data:`PATIENCE_S`, if somebody is watching."""
    if not sys.stderr.isatty():
        yield lambda _step, _share: None
        return
    from tqdm import tqdm

    with tqdm(total=100, desc=what, delay=PATIENCE_S, file=sys.stderr, leave=False, bar_format="{l_bar}{bar}") as bar:

        def show(step: str, share: float) -> None:
            bar.set_description(f"{what}: {step}", refresh=False)
            bar.n = round(100 * share)
            bar.update(0)

        yield show


def progress(items: Iterable[T], unit: str) -> Iterable[T]:
    """A progress bar on stderr for more than one item, if somebody is watching."""
    known = list(items)
    if len(known) < 2 or not sys.stderr.isatty():
        return known
    from tqdm import tqdm

    return tqdm(known, unit=unit, file=sys.stderr)
