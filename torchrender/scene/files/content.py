"""The bytes of a file, or a clear error."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from torchrender.errors import SceneFileError

MAX_FILE_BYTES = 2**31


def json_values(data: bytes) -> Any:
    """What a JSON text holds.

    Raises:
        ValueError: it is none, or is nested too deeply.
    """
    try:
        return json.loads(data)
    except RecursionError as error:
        raise ValueError("nested too deeply") from error


def read_bytes(path: Path) -> bytes:
    """The content of a file.

    Raises:
        SceneFileError: missing, a folder, unreadable, empty or larger than ``MAX_FILE_BYTES``.
    """
    try:
        size = path.stat().st_size
        if path.is_file() and size > MAX_FILE_BYTES:
            raise SceneFileError(path, f"has {size} bytes, the limit is {MAX_FILE_BYTES}")
        data = path.read_bytes()
    except FileNotFoundError as error:
        raise SceneFileError(path, "no such file") from error
    except OSError as error:
        raise SceneFileError(path, error.strerror or str(error)) from error
    if not data:
        raise SceneFileError(path, "the file is empty")
    return data
