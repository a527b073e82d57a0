"""What is asked of a scene before it is kept: nothing outside it, no more than it may be, and one small picture of it.

Counts are checked against what the file declares, before anything of that size is built.
"""

from __future__ import annotations

import base64
import binascii
import io
import logging
import re
import struct
import warnings
from pathlib import Path
from typing import Any

import torch
from PIL import Image as PilImage
from PIL import UnidentifiedImageError

from torchrender.errors import SceneFileError
from torchrender.scene.files.gltf.container import GltfFile
from torchrender.scene.files.gltf.meshes import surface_count
from torchrender.scene.files.gltf.meshopt import EXTENSIONS
from torchrender.scene.files.gltf.nodes import instance_count
from torchrender.scene.files.gltf.read import read_gltf
from torchrender.scene.files.scene_file import load_scene_file
from torchrender.scene.files.toml_table import parse_toml_values
from torchrender.scene.model import Scene
from torchrender.scene.procedural import SCENES
from torchrender_service.errors import ServiceError
from torchrender_service.renderers.engine import render_image
from torchrender_service.renderers.jobs import Bounds, Validate
from torchrender_service.renderers.keeping.textures import bounded, within
from torchrender_service.renderers.scene_cache import describe
from torchrender_service.renderers.uploads.any_scene import load_any
from torchrender_service.renderers.uploads.archive import FOLDER, main_file, named_files, picture_pixels, unpack

MAX_LIGHTS = 64
MAX_NODES = 100_000
MAX_TABLES = 10_000
BYTES_PER_TRIANGLE = 256
"""What three vertices and their indices take, generously."""
MAX_TOML_BYTES = 2**23
MAX_KEY_PARTS = 16
_PART = rb"""(?:[A-Za-z0-9_-]+|"[^"\n]*"|'[^'\n]*')[ \t]*"""
_LONG_KEY = re.compile(rb"(?:^|[\[{,])[ \t]*(?:" + _PART + rb"\.[ \t]*){%d}" % MAX_KEY_PARTS, re.MULTILINE)
PROBE = (48, 27)
MAX_NOTES = 64
_FILE_KEYS = ("file", "texture", "density_file")
_SEGMENTS = {"box": 2, "quad": 1, "plane": 1}
"""Of shapes that do not say; others have 64."""
_DAMAGE = (TypeError, KeyError, IndexError, AttributeError, ArithmeticError, RecursionError, struct.error)
LOG = logging.getLogger("torchrender_service.renderers.upload")


def validate(job: Validate, texture_bytes: int | None = None) -> dict[str, Any]:
    """Facts about an uploaded file.

    Args:
        texture_bytes: that textures of a scene may take in a renderer; None: all that they have.

    Raises:
        ServiceError, SceneFileError, InputError: it is not kept, and why.
    """
    more: dict[str, Any] = {}
    unused: list[str] = []
    try:
        with bounded(texture_bytes) as bound:
            if job.kind == "zip":
                scene, main, unused = _read_archive(Path(job.path), job)
                more = {"main": main}
            else:
                scene = _read(Path(job.path), job)
    except _DAMAGE as error:
        # Readers name what they foresee; a file that trips them otherwise is no less damaged.
        LOG.warning("a reader failed on an upload", exc_info=error)
        raise ServiceError(422, "scene-file", f"damaged ({type(error).__name__})") from error
    _check_scene(scene, job)
    scene = within(scene, texture_bytes, bound.lost)
    facts = describe(scene) | more
    facts["report"]["not_used"] = [*facts["report"]["not_used"], *unused][:MAX_NOTES]
    if facts.pop("orthographic"):
        render_image(scene, scene.camera(width=PROBE[0], height=PROBE[1]), Bounds())
        return facts
    image, _ = render_image(scene, scene.camera(width=PROBE[0], height=PROBE[1]), Bounds())
    if not bool(torch.isfinite(image.radiance).all()):
        raise ServiceError(422, "scene-file", "a picture of the scene has values that are not finite")
    return facts


def _read(path: Path, job: Validate) -> Scene:
    data = path.read_bytes()
    if job.kind == "glb":
        check_glb(path, data, job)
        return read_gltf(path, data)
    check_toml(path, data, job)
    return load_scene_file(path)


def _read_archive(path: Path, job: Validate) -> tuple[Scene, str, list[str]]:
    """The scene of an archive, its file below the archive's own folder, and the files that it does not use."""
    folder = path.parent / FOLDER
    files = unpack(path, folder, job.max_bytes)
    main = main_file(path, files)
    used = named_files(main, folder)
    _check_count("texture pixels", picture_pixels(sorted(used)), job.max_texture_pixels)
    if main.suffix.lower() in (".glb", ".gltf"):
        check_gltf(main, main.read_bytes(), job)
    unused = [f"file {file.relative_to(folder).as_posix()[:150]}" for file in files if file.resolve() not in used]
    return load_any(main), main.relative_to(path.parent).as_posix(), unused


def check_toml_text(path: Path, data: bytes) -> None:
    """Refuse keys that take a parser minutes: its time grows with the square of a key's parts.

    Raises:
        SceneFileError: too large, or a key with too many parts.
    """
    if len(data) > MAX_TOML_BYTES:
        raise SceneFileError(path, f"a scene file may have at most {MAX_TOML_BYTES} bytes, this one has {len(data)}")
    found = _LONG_KEY.search(data)
    if found is not None:
        line = data.count(b"\n", 0, found.start()) + 1
        raise SceneFileError(path, f"line {line}: a key may have at most {MAX_KEY_PARTS} parts")


def check_glb(path: Path, data: bytes, limits: Validate) -> None:
    """Refuse what reaches outside the file or declares too much.

    Raises:
        ServiceError, SceneFileError: says what.
    """
    if data[:4] != b"glTF":
        others = "glTF, OBJ, PLY and STL come in a ZIP archive"
        raise SceneFileError(path, f"is no GLB file: it does not start with glTF; {others}")
    file = GltfFile(path, data)
    for group in ("buffers", "images"):
        for number, entry in enumerate(file.entries(group)):
            uri = entry.get("uri") if isinstance(entry, dict) else None
            if uri is not None and not (isinstance(uri, str) and uri.startswith("data:")):
                raise SceneFileError(path, "everything must be inside the file", key=f"{group}[{number}].uri")
    check_gltf(path, data, limits)


def check_gltf(path: Path, data: bytes, limits: Validate) -> None:
    """Refuse what declares too much.

    Raises:
        ServiceError, SceneFileError: says what.
    """
    file = GltfFile(path, data)
    nodes = file.entries("nodes")
    if len(nodes) > MAX_NODES:
        raise SceneFileError(path, f"may have at most {MAX_NODES} nodes, has {len(nodes)}", key="nodes")
    triangles, vertices = 0, 0
    counted: dict[Any, tuple[int, int]] = {}
    for node in nodes:
        if isinstance(node, dict) and "mesh" in node:
            mesh = node["mesh"]
            if not isinstance(mesh, int) or mesh not in counted:
                counted[mesh] = surface_count(file, mesh), _vertices(file, mesh)
            copies = instance_count(file, node)
            triangles += copies * counted[mesh][0]
            vertices += copies * counted[mesh][1]
    _check_count("triangles", triangles, limits.max_triangles)
    _check_count("vertices", vertices, 3 * limits.max_triangles)
    _check_count("bytes of unfolded data", _unfolded_bytes(file), BYTES_PER_TRIANGLE * limits.max_triangles)
    _check_count("texture pixels", sum(_texture_pixels(file)), limits.max_texture_pixels)


def check_toml(path: Path, data: bytes, limits: Validate) -> None:
    """The same for a scene file.

    Raises:
        ServiceError, SceneFileError: says what.
    """
    check_toml_text(path, data)
    values = parse_toml_values(path, data)
    tables = _tables(values)
    if len(tables) > MAX_TABLES:
        raise SceneFileError(path, f"may have at most {MAX_TABLES} tables, has {len(tables)}")
    for where, table in tables:
        for key in _FILE_KEYS:
            if key in table:
                raise SceneFileError(path, "scenes that are uploaded must not name files", key=f"{where}{key}")
    _check_count("triangles", sum(_toml_triangles(table) for _, table in tables), limits.max_triangles)


def _check_scene(scene: Scene, limits: Validate) -> None:
    _check_count("triangles", scene.geometry.triangle_count, limits.max_triangles)
    _check_count("lights", len(scene.lights), MAX_LIGHTS)
    if not scene.geometry.triangle_count:
        raise ServiceError(422, "scene-file", "the scene has no triangles")
    if not 0.0 < scene.diagonal < 1e12:
        raise ServiceError(422, "scene-file", f"the scene's diagonal must be in (0, 1e12), is {scene.diagonal:g}")


def _check_count(what: str, count: int, limit: int) -> None:
    if count > limit:
        raise ServiceError(422, "too-large", f"a scene may have at most {limit} {what}, this one declares {count}")


def _vertices(file: GltfFile, mesh: object) -> int:
    total = 0
    primitives = file.item("meshes", mesh).get("primitives")
    for entry in primitives if isinstance(primitives, list) else []:
        attributes = entry.get("attributes") if isinstance(entry, dict) else None
        if isinstance(attributes, dict) and "POSITION" in attributes:
            count = file.item("accessors", attributes["POSITION"]).get("count")
            targets = entry.get("targets")
            shapes = 1 + (len(targets) if isinstance(targets, list) else 0)
            total += shapes * count if isinstance(count, int) else 0
    return total


def _unfolded_bytes(file: GltfFile) -> int:
    """Bytes that compressed buffer views declare."""
    total = 0
    for entry in file.entries("bufferViews"):
        extensions = entry.get("extensions") if isinstance(entry, dict) else None
        for name in EXTENSIONS:
            packed = extensions.get(name) if isinstance(extensions, dict) else None
            if isinstance(packed, dict):
                count, stride = packed.get("count"), packed.get("byteStride")
                total += count * stride if isinstance(count, int) and isinstance(stride, int) else 0
    return total


def _texture_pixels(file: GltfFile) -> list[int]:
    """Pixels that each image declares; one that is not readable counts nothing and is met again when it is used."""
    found = []
    for entry in file.entries("images"):
        if not isinstance(entry, dict):
            continue
        if "bufferView" in entry:
            buffer, start, size, _ = file.view(entry["bufferView"])
            data = buffer[start : start + size]
        else:
            try:
                data = base64.b64decode(str(entry.get("uri", "")).partition(",")[2])
            except (binascii.Error, ValueError):
                continue
        if data[:8] == b"\xabKTX 20\xbb"[:8] and len(data) >= 28:
            width, height = struct.unpack_from("<II", data, 20)
            found.append(width * height)
            continue
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                width, height = PilImage.open(io.BytesIO(data)).size
        except (UnidentifiedImageError, OSError, ValueError, SyntaxError, PilImage.DecompressionBombError):
            continue
        found.append(width * height)
    return found


def _tables(values: dict[str, Any]) -> list[tuple[str, dict[str, Any]]]:
    """Every table of a TOML file with its dotted name; without recursion, because dotted keys nest without limit."""
    found: list[tuple[str, dict[str, Any]]] = []
    waiting = [("", values)]
    while waiting and len(found) <= MAX_TABLES:
        where, table = waiting.pop()
        found.append((where[-200:], table))
        for key, value in table.items():
            entries = value if isinstance(value, list) else [value]
            for number, entry in enumerate(entries):
                if isinstance(entry, dict):
                    waiting.append((f"{where}{key}[{number}]." if isinstance(value, list) else f"{where}{key}.", entry))
    return found


def _toml_triangles(table: dict[str, Any]) -> int:
    """Triangles that a geometry table declares; an upper bound for shapes."""
    name = table.get("procedural")
    if isinstance(name, str):
        count = table.get("triangles")
        usual = SCENES[name].usual if name in SCENES else 0
        return count if isinstance(count, int) else usual
    shape = table.get("shape")
    if isinstance(shape, str):
        segments = table.get("segments", _SEGMENTS.get(shape, 64))
        return 4 * segments * segments if isinstance(segments, int) else 0
    return 0
