"""Pictures of a glTF file and how materials read them: texture coordinates, transform, wrap and filter.

Samplers are turned from the file's v, which points down, to ours, which points up.
"""

from __future__ import annotations

import math
import os
from collections.abc import Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
from contextvars import copy_context
from dataclasses import dataclass, field
from typing import Any

import torch
from torch import Tensor

from torchrender.errors import SceneFileError
from torchrender.images.files import read_texture_bytes
from torchrender.scene.files.gltf.container import GltfFile, object_of
from torchrender.scene.material import Sampler

_WRAPS = {10497: "repeat", 33071: "clamp", 33648: "mirror"}
_NEAREST, _NEAREST_MIPS = 9728, (9728, 9984, 9986)
_PLAIN_FILTERS = (9728, 9729)
_SOURCES = ("KHR_texture_basisu", "EXT_texture_webp")
COLOR_TEXTURES = {
    *("baseColorTexture", "diffuseTexture", "emissiveTexture", "sheenColorTexture"),
    *("specularColorTexture", "specularGlossinessTexture"),
}
"""Pictures of a material that hold colours."""
PLAIN_TEXTURES = {
    *("metallicRoughnessTexture", "normalTexture", "occlusionTexture", "specularTexture"),
    *("clearcoatTexture", "clearcoatRoughnessTexture", "transmissionTexture"),
}
"""Those that hold plain numbers."""
THREADS = min(4, os.cpu_count() or 1)
MAX_DEPTH = 4
"""Of the extensions in a material, where pictures are named."""
SETS = 2
"""Sets of texture coordinates that a mesh here has."""


@dataclass
class SetsInUse:
    """The sets of texture coordinates of the file that one material reads, in the order of its own."""

    numbers: list[int] = field(default_factory=list)

    def own(self, number: int) -> int | None:
        """Which of its own sets stands for one of the file; None if there is no room."""
        if number not in self.numbers:
            if len(self.numbers) == SETS:
                return None
            self.numbers.append(number)
        return self.numbers.index(number)


class GltfTextures:
    """Textures of one file; materials that use the same image share one tensor."""

    def __init__(self, file: GltfFile) -> None:
        self._file = file
        self._images: dict[tuple[int, bool], Tensor | None] = {}
        self._begun: dict[tuple[int, bool], Future[Tensor]] = {}
        self._pool: ThreadPoolExecutor | None = None

    def begin(self, materials: Iterable[int]) -> None:
        """Decode the pictures of these materials side by side, until they are asked for."""
        entries = self._file.entries("materials")
        wanted: dict[tuple[int, bool], None] = {}
        for number in materials:
            for name, info in _texture_infos(entries[number] if 0 <= number < len(entries) else None):
                with suppress(SceneFileError):  # said when the picture is asked for
                    sources = self._sources(self._file.item("textures", info.get("index")))
                    if sources:
                        wanted[sources[0][0], name not in COLOR_TEXTURES] = None
        if len(wanted) < 2:
            return
        self._pool = ThreadPoolExecutor(min(THREADS, len(wanted)), "pictures")
        for source, encoded in wanted:
            with suppress(SceneFileError):
                _, data = image_bytes(self._file, source)
                name = f"images[{source}]"
                self._begun[source, encoded] = self._pool.submit(copy_context().run, _decoded, data, name, encoded)
        self._pool.shutdown(wait=False)

    def color(self, info: Any, key: str) -> Tensor | None:
        """(H,W,3|4) linear light; None where there is no texture, or none that can be read, which is said."""
        return self._picture(info, key, encoded=False)

    def plain(self, info: Any, key: str) -> Tensor | None:
        """(H,W,3|4) in [0,1], as the numbers stand in the file."""
        return self._picture(info, key, encoded=True)

    def sampler(self, info: dict[str, Any], sets: SetsInUse, key: str) -> Sampler:
        """How a texture lies on the surface."""
        file = self._file
        transform = object_of(object_of(info.get("extensions")).get("KHR_texture_transform"))
        chosen = transform.get("texCoord", info.get("texCoord", 0))
        number = chosen if isinstance(chosen, int) and 0 <= chosen < 1000 else 0
        own = sets.own(number)
        if own is None:
            file.notes.not_used(f"a third set of texture coordinates of {key}: the first is taken")
        offset = file.numbers(transform, "offset", [0.0, 0.0], key)
        scale = file.numbers(transform, "scale", [1.0, 1.0], key)
        entry = self._sampler_entry(info)
        low, high = entry.get("minFilter"), entry.get("magFilter")
        nearest = high == _NEAREST and (low is None or low in _NEAREST_MIPS)
        return Sampler(
            uv_set=own or 0,
            transform=upwards(offset.tolist(), file.number(transform, "rotation", 0.0, key), scale.tolist()),
            wrap_u=self._wrap(entry.get("wrapS", 10497), key),
            wrap_v=self._wrap(entry.get("wrapT", 10497), key),
            filter="nearest" if nearest else "bilinear" if low in _PLAIN_FILTERS else "trilinear",
        )

    def _wrap(self, code: Any, key: str) -> str:
        if not isinstance(code, int) or code not in _WRAPS:
            raise SceneFileError(self._file.path, f"unknown wrap mode {code!r}", key=key)
        return _WRAPS[code]

    def _sampler_entry(self, info: dict[str, Any]) -> dict[str, Any]:
        texture = self._file.item("textures", info.get("index"))
        return self._file.item("samplers", texture["sampler"]) if "sampler" in texture else {}

    def _picture(self, info: Any, key: str, *, encoded: bool) -> Tensor | None:
        if not isinstance(info, dict):
            return None
        number = info.get("index")
        sources = self._sources(self._file.item("textures", number))
        if not sources:
            self._file.notes.missing(key, f"texture {number} has no picture")
            return None
        for place, (source, kind) in enumerate(sources):
            at = (source, encoded)
            if at not in self._images:
                self._images[at] = self._read(source, kind, key, encoded=encoded, last=place == len(sources) - 1)
            found = self._images[at]
            if found is not None:
                return found
        return None

    def _sources(self, texture: dict[str, Any]) -> list[tuple[int, str]]:
        """Images of a texture, those of extensions first: they are what the file means, the plain one stands in."""
        extensions = object_of(texture.get("extensions"))
        named = [(object_of(extensions.get(name)).get("source"), name) for name in _SOURCES]
        return [(s, n) for s, n in (*named, (texture.get("source"), "")) if isinstance(s, int)]

    def _read(self, index: int, kind: str, key: str, *, encoded: bool, last: bool) -> Tensor | None:
        try:
            name, data = image_bytes(self._file, index)
        except SceneFileError as error:
            self._say_missing(key, f"image {index}", error.reason, kind, last=last)
            return None
        begun = self._begun.pop((index, encoded), None)
        try:
            return begun.result() if begun is not None else _decoded(data, f"images[{index}]", encoded)
        except SceneFileError as error:
            self._say_missing(key, name, error.reason, kind, last=last)
            return None

    def _say_missing(self, key: str, name: str, reason: str, kind: str, *, last: bool) -> None:
        if last:
            self._file.notes.missing(key, f"texture {name!r}: {reason}")
        else:
            self._file.notes.not_used(f"{kind}, the plain picture is taken: {reason}")


def _decoded(data: bytes, name: str, encoded: bool) -> Tensor:
    return read_texture_bytes(data, name, encoded=encoded)


def _texture_infos(value: Any, depth: int = 0) -> Iterator[tuple[str, dict[str, Any]]]:
    """The pictures that a material names, with what they are for."""
    if not isinstance(value, dict) or depth > MAX_DEPTH:
        return
    for name, entry in value.items():
        if name in COLOR_TEXTURES | PLAIN_TEXTURES and isinstance(entry, dict):
            yield name, entry
        else:
            yield from _texture_infos(entry, depth + 1)


def image_bytes(file: GltfFile, index: int) -> tuple[str, bytes]:
    """Name and content of an image.

    Raises:
        SceneFileError: it is not there, or not in the file.
    """
    entry = file.item("images", index)
    uri = str(entry.get("uri", ""))
    name = str(entry.get("name", f"image {index}") if uri.startswith("data:") or not uri else uri)[:80]
    if "bufferView" in entry:
        buffer, start, size, _ = file.view(entry["bufferView"])
        return name, buffer[start : start + size]
    return name, file.resource(entry.get("uri"), f"images[{index}]")


def upwards(offset: list[float], rotation: float, scale: list[float]) -> Tensor:
    """(2,3) of KHR_texture_transform, ``T R S`` for v down, as it acts on v up."""
    cosine, sine = math.cos(rotation), math.sin(rotation)
    return torch.tensor(
        [
            [cosine * scale[0], -sine * scale[1], offset[0] + sine * scale[1]],
            [sine * scale[0], cosine * scale[1], 1.0 - cosine * scale[1] - offset[1]],
        ],
        dtype=torch.float32,
    )
