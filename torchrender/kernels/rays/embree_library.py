"""Embree's shared library out of the embreex wheel: found, checked, and known to compiled code by symbol name.

Compiled code fills Embree's records itself, by the layout of Embree 4.0 to 4.4; any other version is refused.
"""

from __future__ import annotations

import ctypes
import importlib.util
import sys
import warnings
from functools import cache
from pathlib import Path

import llvmlite.binding as llvm

_MAJOR, _MINORS = 4, range(5)
_VERSION_MAJOR, _VERSION_MINOR, _USER_GEOMETRY = 1, 2, 100  # device properties
_NAMES = {"win32": "embree4*.dll", "darwin": "libembree4*.dylib"}
_OTHERWISE = "libembree4*.so*"
_POINTER, _UNSIGNED, _SIZE = ctypes.c_void_p, ctypes.c_uint, ctypes.c_size_t
_FUNCTIONS = {
    "rtcNewDevice": (_POINTER, [ctypes.c_char_p]),
    "rtcGetDeviceProperty": (ctypes.c_ssize_t, [_POINTER, ctypes.c_int]),
    "rtcGetDeviceError": (ctypes.c_int, [_POINTER]),
    "rtcNewScene": (_POINTER, [_POINTER]),
    "rtcNewGeometry": (_POINTER, [_POINTER, _UNSIGNED]),
    "rtcSetSharedGeometryBuffer": (None, [_POINTER, *[_UNSIGNED] * 3, _POINTER, *[_SIZE] * 3]),
    "rtcSetGeometryBuildQuality": (None, [_POINTER, _UNSIGNED]),
    "rtcSetSceneBuildQuality": (None, [_POINTER, _UNSIGNED]),
    "rtcSetSceneFlags": (None, [_POINTER, _UNSIGNED]),
    "rtcSetGeometryUserPrimitiveCount": (None, [_POINTER, _UNSIGNED]),
    "rtcSetGeometryUserData": (None, [_POINTER, _POINTER]),
    "rtcSetGeometryBoundsFunction": (None, [_POINTER, _POINTER, _POINTER]),
    "rtcSetGeometryIntersectFunction": (None, [_POINTER, _POINTER]),
    "rtcSetGeometryOccludedFunction": (None, [_POINTER, _POINTER]),
    "rtcCommitGeometry": (None, [_POINTER]),
    "rtcAttachGeometry": (_UNSIGNED, [_POINTER, _POINTER]),
    "rtcCommitScene": (None, [_POINTER]),
    "rtcReleaseGeometry": (None, [_POINTER]),
    "rtcReleaseScene": (None, [_POINTER]),
}
_CALLED = ("rtcIntersect1", "rtcOccluded1")  # by compiled code


class EmbreeWarning(UserWarning):
    """Embree is installed but cannot be used; rays go through the compiled tree, which is slower."""


def bundled_library(package: Path, platform: str = sys.platform) -> Path | None:
    """The one Embree library that a wheel of embreex brings, or None.

    Args:
        package: folder of the package ``embreex``. The tools that repair wheels put libraries beside it
            (``embreex.libs``: Linux and Windows) or into it (``.dylibs``: macOS).
        platform: as in :data:`sys.platform`.
    """
    pattern = _NAMES.get(platform, _OTHERWISE)
    for folder in (package.parent / f"{package.name}.libs", package / ".dylibs", package / ".libs", package):
        found = sorted(folder.glob(pattern))
        if found:
            return found[0]
    return None


@cache
def embree() -> ctypes.CDLL | None:
    """Embree's C interface; None where the package is missing or, said once by a warning, cannot be used."""
    found = importlib.util.find_spec("embreex")
    if found is None or found.origin is None:
        return None
    try:
        return _load(Path(found.origin).parent)
    except (OSError, ImportError, AttributeError, RuntimeError) as error:
        text = f"embreex is installed but not usable: {error}; rays go through the compiled tree, which is slower"
        warnings.warn(text, EmbreeWarning, stacklevel=2)
        return None


def _load(package: Path) -> ctypes.CDLL:
    path = bundled_library(package)
    if path is None:
        raise OSError(f"no Embree 4 library lies beside or in {package}")
    import embreex.rtcore_scene  # noqa: F401  loads the libraries that Embree itself needs

    library = ctypes.CDLL(str(path))
    for name, (result, arguments) in _FUNCTIONS.items():
        function = getattr(library, name)
        function.restype, function.argtypes = result, arguments
    for name in _CALLED:
        getattr(library, name)
    device = library.rtcNewDevice(None)
    if not device:
        raise RuntimeError(f"{path.name} gives no device, error {library.rtcGetDeviceError(None)}")
    check_version(*(library.rtcGetDeviceProperty(device, p) for p in (_VERSION_MAJOR, _VERSION_MINOR)))
    if not library.rtcGetDeviceProperty(device, _USER_GEOMETRY):
        raise RuntimeError(f"{path.name} is built without user geometry")
    library.device = device  # type: ignore[attr-defined]
    llvm.load_library_permanently(str(path))
    return library


def check_version(major: int, minor: int) -> None:
    """Refuse versions whose records may be laid out differently.

    Raises:
        RuntimeError: with the version and those that are known.
    """
    if major != _MAJOR or minor not in _MINORS:
        known = f"{_MAJOR}.{_MINORS.start} to {_MAJOR}.{_MINORS.stop - 1}"
        raise RuntimeError(f"Embree {major}.{minor} is none of the versions {known} whose records are known")
