"""A digest of a scene's content: two processes that loaded the same scene get the same one."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np
from torch import Tensor

from torchrender.scene.model import Scene

_PLAIN = (str, int, float, bool, type(None), bytes, complex)


def scene_digest(scene: Scene) -> str:
    """SHA-256 over meshes, materials, textures, lights, media and cameras."""
    digest = hashlib.sha256()
    _add(digest, scene)
    return digest.hexdigest()


def _add(digest: Any, value: Any) -> None:
    if isinstance(value, Tensor):
        value = value.detach().cpu().numpy()
    if isinstance(value, np.ndarray):
        digest.update(f"{value.dtype}{value.shape}".encode())
        digest.update(np.ascontiguousarray(value).data)
    elif isinstance(value, _PLAIN):
        digest.update(f"{type(value).__name__}:{value!r};".encode())
    elif isinstance(value, Mapping):
        for key in sorted(value, key=repr):
            _add(digest, key)
            _add(digest, value[key])
    elif isinstance(value, (list, tuple)):
        digest.update(f"[{len(value)}".encode())
        for one in value:
            _add(digest, one)
    elif is_dataclass(value):
        digest.update(type(value).__name__.encode())
        for field in fields(value):
            if field.name != "report":  # tells where the file lay and what was repaired
                _add(digest, getattr(value, field.name, None))
    else:
        digest.update(type(value).__name__.encode())
