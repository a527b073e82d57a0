"""One exception tree. Catch :class:`TorchRenderError` to catch everything this package raises on purpose."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path


class TorchRenderError(Exception):
    """Root of every error raised on purpose by torchrender."""


class InputError(TorchRenderError, ValueError):
    """An argument has a wrong shape, type or value; the message names it and the limit."""


class OptionError(InputError):
    """An option lies outside its range; the message names the option and the range."""


class CameraError(InputError):
    """A camera is not usable: singular matrix, empty image, near plane not in front of far plane."""


class MeshError(InputError):
    """A mesh is not usable: bad indices, NaN or infinite vertices; the message names the mesh."""


class MissingExtraError(TorchRenderError, ImportError):
    """A part of the package needs packages that the base installation leaves out; ``extra`` brings them."""

    def __init__(self, extra: str, what: str, missing: Sequence[str]) -> None:
        self.extra = extra
        self.missing = tuple(missing)
        super().__init__(f'{what} needs {", ".join(missing)}: pip install "torchrender[{extra}]"')


class SceneFileError(TorchRenderError):
    """A scene, mesh or image file cannot be used. Names the file, the key where there is one, and the reason."""

    def __init__(self, path: str | Path, reason: str, *, key: str | None = None) -> None:
        self.path = Path(path)
        self.key = key
        self.reason = reason
        where = f"{path}: {key}" if key else f"{path}"
        super().__init__(f"{where}: {reason}")


class ImageFileError(SceneFileError):
    """An image file is missing, damaged or of a kind that is not supported."""


class PointFileError(SceneFileError):
    """A file of compressed points is missing, damaged, cut off or of another version."""
