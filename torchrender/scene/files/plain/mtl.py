"""Wavefront MTL materials: Phong's, or metallic-roughness where the file speaks of roughness and metal.

Colours count as linear, as in most modelling programs. ``Ns`` is the exponent; the width of the mirror lobe is that of
the GGX lobe with the same peak, ``gloss = (2 / (Ns + 2))^(1/4)``. ``illum`` decides about reflection: 0 and 1 have no
highlight, 2 has one but mirrors nothing: it becomes a dielectric of that roughness, whose highlight Ks scales; from 3
on Ks mirrors. ``Ka`` has no effect: ambient light is reflected as any other.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from torchrender.errors import InputError, SceneFileError
from torchrender.numerics.texels.scaling import scaled_bilinearly
from torchrender.numerics.texture import channels_of
from torchrender.scene.files.plain.mtl_maps import (
    MapReader,
    MapUse,
    is_normal_map,
    is_number,
    normals_of_heights,
    parse_map,
)
from torchrender.scene.files.plain.obj import decoded
from torchrender.scene.files.report import Notes
from torchrender.scene.files.texture_file import find_beside
from torchrender.scene.material import Material, Sampler

_PHYSICAL = ("pr", "pm", "pc", "ps", "map_pr", "map_pm")
_NOT_USED = ("map_ns", "disp", "decal", "refl", "map_refl", "map_ps", "aniso", "anisor", "tf", "map_tr", "sharpness")
_BUMPS = ("norm", "map_kn", "map_bump", "bump", "map_norm")
_SHARP = 0.1
"""Share of half-transparent texels of a mask up to which it cuts holes; beyond, it blends."""
_XYZ = torch.tensor(
    [[3.2404542, -1.5371385, -0.4985314], [-0.9692660, 1.8760108, 0.0415560], [0.0556434, -0.2040259, 1.0572252]]
)

Entry = dict[str, list[str]]


def read_materials(path: Path, libraries: list[str], wanted: list[str], notes: Notes) -> dict[str, Material]:
    """Materials by name, out of the MTL files ``libraries`` beside ``path``; those not in ``wanted`` are left out.

    A missing library or picture is a warning; names that no library defines get the default material.

    Raises:
        SceneFileError: a number that is none, or one out of range.
    """
    entries: dict[str, Entry] = {}
    whole = True
    for library in libraries:
        for file in _files(path, library):
            try:
                entries |= _entries(decoded(file.read_bytes()))
            except (OSError, ValueError) as error:
                whole = False
                reason = getattr(error, "strerror", None) or str(error)
                notes.missing(f"mtllib {file.name}", f"the file cannot be read ({reason})")
    maps = MapReader(path, notes)
    found = {}
    for name in wanted:
        if name in entries:
            found[name] = _Draft(path, name, entries[name], maps, notes).material()
        else:
            if whole:
                notes.not_used(f"material {name!r}, which no library defines")
            found[name] = Material(name=name)
    return found


def picture_material(path: Path, file: str, notes: Notes) -> Material:
    """A white material with that picture."""
    picture = MapReader(path, notes).read(MapUse(file), "")
    return Material(name="default", diffuse=torch.ones(3), diffuse_texture=picture)


def _files(path: Path, library: str) -> list[Path]:
    """The file of that name, which may hold blanks; else several files."""
    whole = find_beside(path, library)
    words = library.split()
    try:
        if len(words) < 2 or whole.is_file():
            return [whole]
    except (OSError, ValueError):
        return [whole]
    return [find_beside(path, word) for word in words]


def _entries(text: str) -> dict[str, Entry]:
    entries: dict[str, Entry] = {}
    current: Entry = {}
    for line in text.splitlines():
        head = line.lstrip().lower()
        words = (
            line.split() if head.startswith(("map_", "bump", "norm", "disp", "newmtl")) else line.split("#")[0].split()
        )
        if len(words) < 2:
            continue
        if words[0].lower() == "newmtl":
            current = entries.setdefault(line.strip()[6:].strip(), {})
        else:
            current[words[0].lower()] = words[1:]
    return entries


class _Draft:
    """One material in the making."""

    def __init__(self, path: Path, name: str, entry: Entry, maps: MapReader, notes: Notes) -> None:
        self._path, self._name, self._entry, self._maps, self._notes = path, name, entry, maps, notes
        self._samplers: dict[str, Sampler] = {}

    def material(self) -> Material:
        """All of it."""
        for key in _NOT_USED:
            if key in self._entry:
                self._notes.not_used(f"MTL {key}")
        values = self._base() | self._opacity() | self._relief() | self._emission()
        values |= self._physical() if any(k in self._entry for k in _PHYSICAL) else self._phong()
        texture = values.pop("alpha_of", None)
        if texture is not None:
            values |= _with_alpha(values["diffuse_texture"], texture)
        elif values["diffuse_texture"] is not None and values["diffuse_texture"].shape[2] == 4 and not values["blend"]:
            values["alpha_cutoff"] = 0.5
        samplers = {n: s for n, s in self._samplers.items() if values.get(n) is not None}
        try:
            return Material(name=self._name, samplers=samplers, **values)
        except InputError as error:
            raise SceneFileError(self._path, str(error), key=f"material {self._name}") from error

    def _base(self) -> dict[str, Any]:
        color, texture = self._color("kd", 0.8), self._map("map_kd", "diffuse_texture")
        if texture is not None and "kd" not in self._entry:
            color = torch.ones(3)
        elif texture is not None and not bool((color > 0).any()):
            self._notes.repaired("Kd 0 under a map_Kd: the picture is shown as it is")
            color = torch.ones(3)
        return {"diffuse": color, "diffuse_texture": texture}

    def _opacity(self) -> dict[str, Any]:
        words = self._entry.get("d", [])
        if words[:1] == ["-halo"]:
            self._notes.not_used("MTL d -halo, the plain opacity is taken")
            words = words[1:]
        if words:
            opacity = self._number_of("d", words)
        else:
            opacity = 1.0 - self._number("tr", 0.0)
        opacity = min(max(opacity, 0.0), 1.0)
        out: dict[str, Any] = {"opacity": opacity, "blend": opacity < 1.0}
        if "map_d" in self._entry:
            use = parse_map(self._entry["map_d"])
            mask = self._maps.channel(use, self._name)
            if mask is not None:
                out["alpha_of"] = mask
                self._samplers.setdefault("diffuse_texture", use.sampler)
        return out

    def _relief(self) -> dict[str, Any]:
        key = next((k for k in _BUMPS if k in self._entry), None)
        if key is None:
            return {}
        use = parse_map(self._entry[key])
        picture = self._maps.read(use, self._name, encoded=True)
        if picture is None:
            return {}
        self._samplers["normal_texture"] = use.sampler
        strength = use.numbers("-bm", [1.0])[0]
        if key in ("norm", "map_kn", "map_norm") or is_normal_map(picture):
            return {"normal_texture": channels_of(picture, 0, 3), "normal_scale": min(max(strength, -100.0), 100.0)}
        height = self._maps.channel(use, self._name)
        assert height is not None
        return {"normal_texture": normals_of_heights(height, strength * _BUMP_TEXELS)}

    def _emission(self) -> dict[str, Any]:
        texture = self._map("map_ke", "emission_texture")
        color = self._color("ke", 0.0)
        if texture is not None and not bool((color > 0).any()):
            color = torch.ones(3)
        return {"emission": color, "emission_texture": texture}

    def _phong(self) -> dict[str, Any]:
        shininess = min(max(self._number("ns", 32.0), 1.0), 1e6)
        gloss = (2.0 / (shininess + 2.0)) ** 0.25
        color = self._color("ks", 0.0)
        strongest = min(max(float(color.max()), 0.0), 1.0)
        model = int(self._number("illum", -1.0))
        tint = color / color.max() if float(color.max()) > 0 else torch.ones(3)
        if model in (0, 1) or (model == 2 and not strongest > 0):
            return {"specular": 0.0, "gloss": gloss, "shininess": shininess}
        if model == 2:
            picture = self._map("map_ks", "specular_texture")
            picture = None if picture is None else channels_of(picture, 0, 3)
            more = {"specular_weight": strongest, "specular_color": tint, "specular_texture": picture}
            return {"metallic": 0.0, "roughness": min(gloss, 1.0), "ior": self._ior(), **more}
        picture = self._map("map_ks", "specular_texture")
        return {
            "specular": strongest if picture is None or "ks" in self._entry else 1.0,
            "specular_color": tint,
            "specular_texture": None if picture is None else channels_of(picture, 0, 3),
            "gloss": gloss,
            "shininess": shininess,
        }

    def _physical(self) -> dict[str, Any]:
        shininess = min(max(self._number("ns", 32.0), 0.0), 1e6)
        values: dict[str, Any] = {
            "metallic": self._share("pm", 1.0 if "map_pm" in self._entry else 0.0),
            "roughness": self._share("pr", 1.0 if "map_pr" in self._entry else (2.0 / (shininess + 2.0)) ** 0.25),
            "clearcoat": self._share("pc", 0.0),
            "clearcoat_roughness": self._share("pcr", 0.0),
            "sheen_color": torch.full((3,), self._share("ps", 0.0)),
            "ior": self._ior(),
        }
        picture = self._map("map_ks", "specular_texture")
        values["specular_texture"] = None if picture is None else channels_of(picture, 0, 3)
        uses = {k: parse_map(self._entry[k]) for k in ("map_pr", "map_pm") if k in self._entry}
        planes = {k: self._maps.channel(use, self._name) for k, use in uses.items()}
        planes = {k: p for k, p in planes.items() if p is not None}
        if planes:
            self._samplers["metallic_roughness_texture"] = uses[next(iter(planes))].sampler
            values["metallic_roughness_texture"] = _two_channels(planes.get("map_pr"), planes.get("map_pm"))
        return values

    # ----------------------------------------------------------------- helpers

    def _ior(self) -> float:
        value = self._number("ni", 1.5)
        return value if 1.0 < value <= 100.0 else 1.5  # many files say 1 for "nothing special"

    def _map(self, key: str, field: str) -> Tensor | None:
        if key not in self._entry:
            return None
        use = parse_map(self._entry[key])
        picture = self._maps.read(use, self._name)
        if picture is not None:
            self._samplers[field] = use.sampler
        return picture

    def _share(self, key: str, default: float) -> float:
        return min(max(self._number(key, default), 0.0), 1.0)

    def _number(self, key: str, default: float) -> float:
        return self._number_of(key, self._entry[key]) if key in self._entry else default

    def _number_of(self, key: str, words: list[str]) -> float:
        if not words or not is_number(words[0]):
            reason = f"must be numbers, got {' '.join(words)!r}"
            raise SceneFileError(self._path, reason, key=f"{self._name}.{key}")
        return float(words[0])

    def _color(self, key: str, default: float) -> Tensor:
        words = self._entry.get(key)
        if words is None:
            return torch.full((3,), default)
        kind = words[0].lower()
        if kind == "spectral":
            self._notes.not_used(f"MTL {key} spectral: {default:g} is taken")
            return torch.full((3,), default)
        numbers = words[1:] if kind == "xyz" else words
        if not all(is_number(w) for w in numbers) or not numbers:
            reason = f"must be numbers, got {' '.join(words)!r}"
            raise SceneFileError(self._path, reason, key=f"{self._name}.{key}")
        values = torch.tensor([float(w) for w in numbers])
        values = values[:3] if len(values) >= 3 else values[:1].expand(3).clone()
        if kind == "xyz":
            self._notes.repaired(f"MTL {key} xyz: turned into linear RGB")
            values = (_XYZ @ values).clamp_min(0.0)
        return values


_BUMP_TEXELS = 4.0
"""Texels that a height of one stands out by: MTL gives heights no unit."""


def _two_channels(rough: Tensor | None, metal: Tensor | None) -> Tensor:
    """(H,W,3) with roughness in the second and metallic in the third channel."""
    known = next(p for p in (rough, metal) if p is not None)
    size = max((p.shape for p in (rough, metal) if p is not None), key=lambda s: s[0] * s[1])
    planes = [torch.ones_like(known) if p is None else p for p in (rough, metal)]
    first, second = (_scaled(p[..., None], (size[0], size[1]))[..., 0] for p in planes)
    return torch.stack([torch.ones_like(first), first, second], dim=-1)


def _with_alpha(texture: Tensor | None, mask: Tensor) -> dict[str, Any]:
    """An RGBA texture; a mask of another size is scaled to it. Sharp masks cut holes, soft ones blend."""
    soft = float(((mask > 0.1) & (mask < 0.9)).float().mean()) > _SHARP
    color = torch.ones(*mask.shape, 3) if texture is None else channels_of(texture, 0, 3)
    size = (max(color.shape[0], mask.shape[0]), max(color.shape[1], mask.shape[1]))
    whole = torch.cat([_scaled(color, size), _scaled(mask[..., None], size)], dim=-1)
    return {"diffuse_texture": whole, "blend": soft, "alpha_cutoff": None if soft else 0.5}


def _scaled(picture: Tensor, size: tuple[int, int]) -> Tensor:
    if tuple(picture.shape[:2]) == size:
        return picture
    planes = scaled_bilinearly(picture.permute(2, 0, 1)[None], size)
    return planes[0].permute(1, 2, 0).contiguous()
