"""Packages beyond the base installation, by the extra that brings them."""

from __future__ import annotations

from importlib.util import find_spec

from torchrender.errors import MissingExtraError

CLIENT = ("msgspec", "simplejpeg", "websockets", "zstandard")
EXTRAS = {
    "client": CLIENT,
    "ray": ("ray", "pyarrow"),
    "scale": ("simpy",),
    "service": (*CLIENT, "fastapi", "filelock", "fsspec", "httptools", "limits", "uvicorn"),
}
"""As in pyproject.toml."""


def check_extra(extra: str, what: str) -> None:
    """Say what to install where packages of an extra are missing.

    Args:
        what: needs them; begins the message.

    Raises:
        MissingExtraError: names the extra and its packages that are missing.
    """
    missing = [name for name in EXTRAS[extra] if not _there(name)]
    if missing:
        raise MissingExtraError(extra, what, missing)


def _there(package: str) -> bool:
    try:
        return find_spec(package) is not None
    except (ImportError, ValueError):  # an import hook refuses it, or it is half loaded
        return False
