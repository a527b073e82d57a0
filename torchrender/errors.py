"""One exception tree. Catch :class:`TorchRenderError` to catch everything this package raises on purpose."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any


class TorchRenderError(Exception):
    """Root of every error raised on purpose by torchrender."""


class InputError(TorchRenderError, ValueError):
    """An argument has a wrong shape, type or value; the message names it and the limit."""


class OptionError(InputError):
    """An option lies outside its range; the message names the option and the range."""


class CameraError(InputError):
    """A camera is not usable: a matrix that is no rotation, empty image, near plane not in front of far plane."""


class MeshError(InputError):
    """A mesh is not usable: bad indices, NaN or infinite vertices; the message names the mesh."""


class GradientError(InputError):
    """An input asks for a gradient that the function does not give; a lost one would look like zero."""


class MissingExtraError(TorchRenderError, ImportError):
    """A part of the package needs packages that the base installation leaves out; ``extra`` brings them."""

    def __init__(self, extra: str, what: str, missing: Sequence[str]) -> None:
        self.extra = extra
        self.missing = tuple(missing)
        self._given = (extra, what, tuple(missing))
        super().__init__(f'{what} needs {", ".join(missing)}: pip install "torchrender[{extra}]"')

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), self._given


class SceneFileError(TorchRenderError):
    """A scene, mesh or image file cannot be used. Names the file, the key where there is one, and the reason."""

    def __init__(self, path: str | Path, reason: str, *, key: str | None = None) -> None:
        self.path = Path(path)
        self.key = key
        self.reason = reason
        where = f"{path}: {key}" if key else f"{path}"
        super().__init__(f"{where}: {reason}")

    def __reduce__(self) -> tuple[Any, ...]:
        # An exception is rebuilt from its message otherwise, which is not what this one is made from.
        return _file_error, (type(self), self.path, self.reason, self.key)


def _file_error(kind: type[SceneFileError], path: Path, reason: str, key: str | None) -> SceneFileError:
    return kind(path, reason, key=key)


class ImageFileError(SceneFileError):
    """An image file is missing, damaged or of a kind that is not supported."""


class PointFileError(SceneFileError):
    """A file of compressed points is missing, damaged, cut off or of another version."""


class ForkError(TorchRenderError, RuntimeError):
    """A process was forked after its parent had computed with several threads; worker processes must be spawned."""


class TorchRenderWarning(UserWarning):
    """Root of what is said without being an error; filter it, or its subclasses, as any warning."""


class NotUsedWarning(TorchRenderWarning):
    """A file or a scene holds something that has no counterpart here, or that the picture does not show; names it."""


class ExposureWarning(TorchRenderWarning):
    """A picture got an exposure that nobody asked for, as its lights are in candela and lux."""


class SceneWarning(TorchRenderWarning):
    """A scene or a view can be drawn, but hardly as it was meant."""


class EmptyWarning(SceneWarning):
    """A scene holds nothing that could be seen."""


class LightWarning(SceneWarning):
    """A light faces away from everything there is or has no area; or what a camera sees sends no light."""


class ColorWarning(SceneWarning):
    """Colours reach values that look like those of 8 bits, or are not there where a picture shows them."""


class ViewWarning(SceneWarning):
    """A camera sees nothing, stands inside a solid, or has an angle or a principal point that hardly was meant."""


class NormalsWarning(SceneWarning):
    """Shading normals of an object point to the inside of its faces."""


class UnitsWarning(SceneWarning):
    """Lights are in candela and lux, which take a unit as a metre, and the scene is as large as if in millimetres."""


class RepairedWarning(TorchRenderWarning):
    """A file was damaged or odd in a way that could be mended; names what was done."""


class LeakWarning(UserWarning):
    """A mesh is not closed: columns of cells leave the mesh as inside, or enter it as outside."""
