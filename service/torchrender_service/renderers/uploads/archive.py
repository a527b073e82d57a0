"""ZIP archives with a scene and the files that it names: unpacked beside them, with nothing that reaches elsewhere."""

from __future__ import annotations

import re
import stat
import warnings
import zipfile
from collections.abc import Iterator, Sequence
from pathlib import Path, PurePosixPath
from urllib.parse import unquote

from PIL import Image as PilImage
from PIL import UnidentifiedImageError

from torchrender.errors import SceneFileError
from torchrender.scene.files.gltf.container import GltfFile
from torchrender_service.errors import ServiceError

FOLDER = "files"
MAX_FILES = 2000
MAX_RATIO = 200
"""Bytes that come out of one of the archive, at most."""
SMALL = 2**20
"""Bytes below which no ratio counts."""
MAX_NAME = 200
PIECE = 2**20
MAIN = (".gltf", ".glb", ".obj", ".ply", ".stl")
"""Kinds of scenes, the first one found is taken."""
PICTURES = (".png", ".jpg", ".jpeg", ".webp", ".bmp", ".tga", ".tif", ".tiff", ".gif", ".exr", ".hdr")
_NAMES = re.compile(rb"^[ \t]*(?:mtllib|map_\w+|bump|disp|decal|refl|norm)[ \t]+(.+?)[ \t\r]*$", re.MULTILINE | re.I)


def unpack(archive: Path, folder: Path, max_bytes: int) -> list[Path]:
    """Write the files of an archive below ``folder``; returns their paths.

    Folders of macOS and names that begin with a dot are left out.

    Raises:
        SceneFileError: damaged, or a name that leads elsewhere. ServiceError: too many files, or too much in them.
    """
    try:
        with zipfile.ZipFile(archive) as opened:
            infos = [i for i in opened.infolist() if not i.is_dir() and not _hidden(i.filename)]
            if len(infos) > MAX_FILES:
                raise ServiceError(422, "too-large", f"an archive may have at most {MAX_FILES} files")
            left = max_bytes
            written = []
            for info in infos:
                path = _place(archive, folder, info)
                path.parent.mkdir(parents=True, exist_ok=True)
                left -= _write(opened, info, path, min(left, max(SMALL, MAX_RATIO * info.compress_size)))
                written.append(path)
    except (zipfile.BadZipFile, NotImplementedError, RuntimeError, EOFError, OSError, ValueError) as error:
        raise SceneFileError(archive, f"is no archive that can be read ({str(error)[:100]})") from error
    return written


def _hidden(name: str) -> bool:
    return any(part.startswith((".", "__MACOSX")) and part not in (".", "..") for part in PurePosixPath(name).parts)


def _place(archive: Path, folder: Path, info: zipfile.ZipInfo) -> Path:
    name = PurePosixPath(info.filename.replace("\\", "/"))
    odd = name.is_absolute() or ".." in name.parts or ":" in info.filename or "\0" in info.filename
    link = stat.S_ISLNK(info.external_attr >> 16)
    if odd or link or len(info.filename) > MAX_NAME or info.flag_bits & 1:
        raise SceneFileError(archive, f"an archive must hold plain files of its own, not {info.filename[:80]!r}")
    return folder.joinpath(*name.parts)


def _write(opened: zipfile.ZipFile, info: zipfile.ZipInfo, path: Path, limit: int) -> int:
    """Bytes written: counted, because an archive may say something else."""
    size = 0
    with opened.open(info) as source, path.open("xb") as out:
        while piece := source.read(PIECE):
            size += len(piece)
            if size > limit:
                raise ServiceError(422, "too-large", f"{info.filename[:80]!r} unpacks to more than may be kept")
            out.write(piece)
    return size


def main_file(archive: Path, files: Sequence[Path]) -> Path:
    """The scene among files: of the first kind that is there the one that lies highest, then by name.

    Raises:
        SceneFileError: there is none.
    """
    for suffix in MAIN:
        found = [file for file in files if file.suffix.lower() == suffix]
        if found:
            return min(found, key=lambda file: (len(file.parts), file.name))
    raise SceneFileError(archive, f"holds no scene: {', '.join(MAIN)}")


def named_files(main: Path, folder: Path) -> set[Path]:
    """The files that a scene names, itself included; checked to lie in ``folder``.

    Raises:
        SceneFileError: a name that leads out of it.
    """
    found = {main.resolve()}
    waiting = [main.resolve()]
    while waiting:
        file = waiting.pop()
        for name in _names(file):
            for where in (file.parent, main.parent):  # textures of an MTL file may be named from either
                path = _inside(main, where, name, folder)
                if path.is_file() and path not in found:
                    found.add(path)
                    waiting.append(path)
    return found


def _inside(main: Path, where: Path, name: str, folder: Path) -> Path:
    """A named file, where it lies below the archive's folder."""
    path = Path(name.replace("\\", "/"))
    whole = (where / path).resolve()
    if path.is_absolute() or not whole.is_relative_to(folder.resolve()):
        raise SceneFileError(main, f"must not name files elsewhere: {name[:80]!r}")
    return whole


def _names(file: Path) -> Iterator[str]:
    """Other files that one of these names."""
    suffix = file.suffix.lower()
    if suffix in (".gltf", ".glb"):
        read = GltfFile(file, file.read_bytes())
        for group in ("buffers", "images"):
            for entry in read.entries(group):
                uri = entry.get("uri") if isinstance(entry, dict) else None
                if isinstance(uri, str) and not uri.startswith("data:"):
                    yield unquote(uri)
    elif suffix in (".obj", ".mtl"):
        for match in _NAMES.finditer(file.read_bytes()):
            line = match[1].decode("utf-8", "replace")
            yield line
            yield line.rpartition(" ")[2]  # after options such as -bm 0.3


def picture_pixels(files: Sequence[Path]) -> int:
    """Pixels that all pictures among files declare together; what cannot be read counts nothing here."""
    total = 0
    for file in files:
        if file.suffix.lower() not in PICTURES:
            continue
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                with PilImage.open(file) as picture:
                    total += picture.width * picture.height
        except (UnidentifiedImageError, OSError, ValueError, SyntaxError, PilImage.DecompressionBombError):
            continue
    return total
