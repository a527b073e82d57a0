"""Skins and animations of a glTF file."""

from __future__ import annotations

from typing import Any

import numpy as np

from torchrender.errors import SceneFileError
from torchrender.scene.files.gltf.accessors import Accessors
from torchrender.scene.files.gltf.container import Array, GltfFile, object_of
from torchrender.scene.motion.records import CUBIC, LINEAR, PATHS, STEP, Animation, Channel, Skin

_WIDTHS = {"translation": 3, "rotation": 4, "scale": 3}
_KINDS = {"translation": ("VEC3",), "rotation": ("VEC4",), "scale": ("VEC3",), "weights": ("SCALAR",)}


class GltfMotion:
    """Skins and animations of one file."""

    def __init__(self, file: GltfFile) -> None:
        self._file = file
        self._accessors = Accessors(file)

    def skins(self) -> list[Skin]:
        """All skins.

        Raises:
            SceneFileError: joints that are no nodes, or too few matrices.
        """
        return [self._skin(k) for k in range(len(self._file.entries("skins")))]

    def _skin(self, index: int) -> Skin:
        entry, key = self._file.item("skins", index), f"skins[{index}]"
        joints = entry.get("joints")
        if not isinstance(joints, list) or not joints:
            raise SceneFileError(self._file.path, "must be an array of nodes", key=f"{key}.joints")
        for joint in joints:
            self._file.item("nodes", joint)
        bind = np.tile(np.eye(4), (len(joints), 1, 1))
        if "inverseBindMatrices" in entry:
            given = self._accessors.read(entry["inverseBindMatrices"], ("MAT4",), f"{key}.inverseBindMatrices")
            if len(given) < len(joints):
                reason = f"has {len(given)} matrices for {len(joints)} joints"
                raise SceneFileError(self._file.path, reason, key=f"{key}.inverseBindMatrices")
            bind = given[: len(joints)].astype(np.float64).reshape(-1, 4, 4).transpose(0, 2, 1)
        return Skin(np.array(joints, np.int64), np.nan_to_num(bind))

    def animations(self) -> list[Animation]:
        """All animations.

        Raises:
            SceneFileError: key frames that do not fit one another.
        """
        return [self._animation(k) for k in range(len(self._file.entries("animations")))]

    def _animation(self, index: int) -> Animation:
        entry, key = self._file.item("animations", index), f"animations[{index}]"
        channels, samplers = entry.get("channels"), entry.get("samplers")
        if not isinstance(channels, list) or not isinstance(samplers, list):
            raise SceneFileError(self._file.path, "needs channels and samplers", key=key)
        found = []
        read: dict[tuple[int, str, int], Channel] = {}
        for number, channel in enumerate(channels):
            where = f"{key}.channels[{number}]"
            target = object_of(object_of(channel).get("target"))
            path, node, sampler = target.get("path"), target.get("node"), object_of(channel).get("sampler")
            if path not in PATHS:
                self._file.notes.not_used(f"animated {path}")
                continue
            if node is None:
                self._file.notes.not_used("animation channels without a node")
                continue
            self._file.item("nodes", node)
            if not isinstance(sampler, int) or not 0 <= sampler < len(samplers):
                raise SceneFileError(self._file.path, f"there is no sampler {sampler!r}", key=where)
            targets = self._target_count(node) if path == "weights" else 0
            known = (sampler, path, targets)
            if known not in read:
                read[known] = self._channel(object_of(samplers[sampler]), path, targets, f"{key}.samplers[{sampler}]")
            one = read[known]
            found.append(
                Channel(node=node, path=path, times=one.times, values=one.values, interpolation=one.interpolation)
            )
        return Animation(name=str(entry.get("name", f"animation {index}")), channels=tuple(found))

    def _target_count(self, node: int) -> int:
        """Morph targets of a node's mesh."""
        entry = self._file.item("nodes", node)
        primitives = self._file.item("meshes", entry["mesh"]).get("primitives") if "mesh" in entry else None
        first = object_of(primitives[0]) if isinstance(primitives, list) and primitives else {}
        targets = first.get("targets")
        return len(targets) if isinstance(targets, list) else 0

    def _channel(self, sampler: dict[str, Any], path: str, targets: int, key: str) -> Channel:
        interpolation = sampler.get("interpolation", LINEAR)
        if interpolation not in (STEP, LINEAR, CUBIC):
            raise SceneFileError(self._file.path, f"unknown interpolation {interpolation!r}", key=key)
        times = self._times(sampler, key)
        values = self._accessors.read(sampler.get("output"), _KINDS[path], f"{key}.output").astype(np.float64)
        per_key, width = (3 if interpolation == CUBIC else 1), _WIDTHS.get(path, targets)
        if values.size != len(times) * per_key * width or not np.isfinite(values).all():
            reason = f"must be {len(times) * per_key * width} finite numbers, there are {values.size}"
            raise SceneFileError(self._file.path, reason, key=f"{key}.output")
        shape = (len(times), 3, width) if interpolation == CUBIC else (len(times), width)
        return Channel(node=-1, path=path, times=times, values=values.reshape(shape), interpolation=interpolation)

    def _times(self, sampler: dict[str, Any], key: str) -> Array:
        times = self._accessors.read(sampler.get("input"), ("SCALAR",), f"{key}.input").astype(np.float64)
        if not len(times) or not np.isfinite(times).all() or (np.diff(times) < 0).any():
            raise SceneFileError(self._file.path, "must be finite times that do not fall", key=f"{key}.input")
        return times
