"""Wavefront MTL materials (Phong): Kd, Ks, Ns, Ke, map_Kd, d and map_d.

Colours count as linear, as in most modelling programs. ``Ns`` is the exponent; the width of the mirror lobe is that of
the GGX lobe with the same peak, ``gloss = (2 / (Ns + 2))^(1/4)``.
"""

from __future__ import annotations

from pathlib import Path

import torch
from torch import Tensor

from torchrender.errors import ImageFileError, InputError, SceneFileError
from torchrender.images.files import read_image
from torchrender.scene.files.texture_file import as_texture, warn_missing_texture
from torchrender.scene.material import Material

_COLORS = {"kd": 0.8, "ks": 0.0, "ke": 0.0}
# Options of map_Kd and how many values follow each at most.
_OPTIONS = {"-o": 3, "-s": 3, "-t": 3, "-mm": 2, "-blendu": 1, "-blendv": 1, "-clamp": 1, "-cc": 1, "-texres": 1}
_OPTIONS |= {"-bm": 1, "-boost": 1, "-imfchan": 1, "-type": 1}


def read_materials(
    path: Path, libraries: list[str], wanted: list[str], *, texture: str | None = None
) -> dict[str, Material]:
    """Materials by name, out of the MTL files ``libraries`` beside ``path``; those not in ``wanted`` are left out.

    A missing library or picture is a warning; names that no library defines get the default material. ``texture``
    adds a white material named "" with that picture.

    Raises:
        SceneFileError: a number that is none, or one out of range.
    """
    entries: dict[str, dict[str, list[str]]] = {}
    for library in libraries:
        file = path.parent / library.replace("\\", "/")
        try:
            text = file.read_text(encoding="utf-8", errors="replace")
        except (OSError, ValueError):
            warn_missing_texture(path, f"mtllib {library}", "the file cannot be read")
            continue
        entries |= _entries(text)
    images: dict[str, Tensor | None] = {}
    found = {name: _material(path, name, entries[name], images) for name in wanted if name in entries}
    found |= {name: Material(name=name) for name in wanted if name not in entries}
    if texture is not None:
        found[""] = Material(name="default", diffuse=torch.ones(3), diffuse_texture=_image(path, texture, "", images))
    return found


def _entries(text: str) -> dict[str, dict[str, list[str]]]:
    entries: dict[str, dict[str, list[str]]] = {}
    current: dict[str, list[str]] = {}
    for line in text.splitlines():
        words = line.split("#")[0].split() if not line.lstrip().lower().startswith("map_") else line.split()
        if len(words) < 2:
            continue
        if words[0].lower() == "newmtl":
            current = entries.setdefault(" ".join(words[1:]), {})
        else:
            current[words[0].lower()] = words[1:]
    return entries


def _material(path: Path, name: str, entry: dict[str, list[str]], images: dict[str, Tensor | None]) -> Material:
    def numbers(key: str, default: float) -> Tensor:
        try:
            values = [float(v) for v in entry.get(key, [str(default)])]
        except ValueError as error:
            raise SceneFileError(path, f"must be numbers, got {' '.join(entry[key])!r}", key=f"{name}.{key}") from error
        return torch.tensor(values if len(values) == 3 else values[:1] * 3)

    kd, ks, ke = (numbers(key, default) for key, default in _COLORS.items())
    shininess = min(max(float(numbers("ns", 32.0)[0]), 1.0), 1e6)
    opacity = float(numbers("d", 1.0)[0])
    texture = _image(path, _file_name(entry["map_kd"]), name, images) if "map_kd" in entry else None
    if texture is not None and "kd" not in entry:
        kd = torch.ones(3)
    mask = _image(path, _file_name(entry["map_d"]), name, images) if "map_d" in entry else None
    cutoff = None
    if mask is not None or opacity < 1.0 or (texture is not None and texture.shape[2] == 4):
        texture, cutoff = _with_alpha(texture, mask, opacity), 0.5
    strongest = float(ks.max())
    try:
        return Material(
            name=name,
            diffuse=kd,
            diffuse_texture=texture,
            specular=min(max(strongest, 0.0), 1.0),
            specular_color=ks / strongest if strongest > 0 else torch.ones(3),
            gloss=(2.0 / (shininess + 2.0)) ** 0.25,
            shininess=shininess,
            emission=ke,
            alpha_cutoff=cutoff,
        )
    except InputError as error:
        raise SceneFileError(path, str(error), key=f"material {name}") from error


def _with_alpha(texture: Tensor | None, mask: Tensor | None, opacity: float) -> Tensor:
    """An RGBA texture; a mask of another size is scaled to it."""
    color = torch.ones(1, 1, 3) if texture is None else texture
    if mask is not None:
        alpha = mask[..., :1]
        if texture is None:
            color = torch.ones(1, 1, 3).expand(*mask.shape[:2], 3)
        elif alpha.shape[:2] != color.shape[:2]:
            scaled = torch.nn.functional.interpolate(
                alpha.permute(2, 0, 1)[None], size=color.shape[:2], mode="bilinear"
            )
            alpha = scaled[0].permute(1, 2, 0)
    else:
        alpha = color[..., 3:] if color.shape[2] == 4 else torch.ones_like(color[..., :1])
    return torch.cat([color[..., :3], alpha * opacity], dim=-1)


def _file_name(words: list[str]) -> str:
    """The file behind the options of a map statement; names may hold blanks."""
    at = 0
    while at < len(words) - 1 and words[at].lower() in _OPTIONS:
        values = _OPTIONS[words[at].lower()]
        at += 1
        while values and at < len(words) - 1 and (_is_number(words[at]) or values == 1):
            at, values = at + 1, values - 1
    return " ".join(words[at:])


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True


def _image(path: Path, name: str, material: str, images: dict[str, Tensor | None]) -> Tensor | None:
    if name not in images:
        try:
            images[name] = as_texture(read_image(path.parent / name.replace("\\", "/")))
        except ImageFileError as error:
            warn_missing_texture(path, f"material {material!r}", f"texture {name!r}: {error.reason}")
            images[name] = None
    return images[name]
