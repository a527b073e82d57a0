"""Pictures that MTL files name, with the options of ``map_`` statements."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import torch
from torch import Tensor

from torchrender.errors import ImageFileError
from torchrender.images.files import read_texture
from torchrender.numerics.texture import channels_of
from torchrender.scene.files.report import Notes
from torchrender.scene.files.texture_file import find_beside
from torchrender.scene.material import Sampler

_OPTIONS = {
    "-o": 3,
    "-s": 3,
    "-t": 3,
    "-mm": 2,
    **dict.fromkeys(("-blendu", "-blendv", "-clamp", "-cc", "-texres", "-bm", "-boost", "-imfchan", "-type"), 1),
}
"""How many values follow each at most."""
_WORDS = {"-blendu", "-blendv", "-clamp", "-cc", "-imfchan", "-type"}
_CHANNELS = {"r": 0, "g": 1, "b": 2, "m": 3}


@dataclass(frozen=True)
class MapUse:
    """A picture and how it lies on the surface."""

    file: str
    options: dict[str, list[str]] = field(default_factory=dict)

    def numbers(self, name: str, default: list[float]) -> list[float]:
        """Values of an option; those left out keep their default."""
        given = [float(v) for v in self.options.get(name, [])]
        return given + default[len(given) :]

    @property
    def sampler(self) -> Sampler:
        """Wrap and transform."""
        offset, scale = self.numbers("-o", [0.0] * 3), self.numbers("-s", [1.0] * 3)
        wrap = "clamp" if self.options.get("-clamp", ["off"])[0].lower() == "on" else "repeat"
        transform = torch.tensor([[scale[0], 0.0, offset[0]], [0.0, scale[1], offset[1]]])
        return Sampler(transform=transform, wrap_u=wrap, wrap_v=wrap)


def parse_map(words: list[str]) -> MapUse:
    """The file behind the options of a map statement; names may hold blanks."""
    at = 0
    options: dict[str, list[str]] = {}
    while at < len(words) - 1 and words[at].lower() in _OPTIONS:
        name = words[at].lower()
        at += 1
        values: list[str] = []
        while len(values) < _OPTIONS[name] and at < len(words) - 1 and (is_number(words[at]) or name in _WORDS):
            values.append(words[at])
            at += 1
        options[name] = values
    return MapUse(" ".join(words[at:]), options)


def is_number(word: str) -> bool:
    """Whether a word is a number."""
    try:
        float(word)
    except ValueError:
        return False
    return True


class MapReader:
    """Pictures beside one file; each is read once."""

    def __init__(self, path: Path, notes: Notes) -> None:
        self._path, self._notes = path, notes
        self._pictures: dict[tuple[str, bool], Tensor | None] = {}

    def read(self, use: MapUse, material: str, *, encoded: bool = False) -> Tensor | None:
        """(H,W,3|4), linear or as stored; None with a warning where it cannot be read."""
        key = (use.file, encoded)
        if key not in self._pictures:
            self._pictures[key] = self._load(use.file, material, encoded=encoded)
        picture = self._pictures[key]
        for name in ("-t", "-cc", "-texres", "-boost", "-type"):
            if name in use.options:
                self._notes.not_used(f"option {name} of a map")
        for name in ("-blendu", "-blendv"):
            if use.options.get(name, ["on"])[0].lower() == "off":
                self._notes.not_used(f"option {name} off of a map")
        if picture is None or "-mm" not in use.options:
            return picture
        base, gain = use.numbers("-mm", [0.0, 1.0])
        color, alpha = channels_of(picture, 0, 3), channels_of(picture, 3, picture.shape[2])
        return torch.cat([(color * gain + base).clamp_min(0.0), alpha], dim=-1)

    def channel(self, use: MapUse, material: str) -> Tensor | None:
        """(H,W) plain numbers of the channel that the options name: the luminance, or of a grey picture its grey."""
        picture = self.read(use, material, encoded=True)
        if picture is None:
            return None
        name = use.options.get("-imfchan", ["l"])[0].lower()
        place = _CHANNELS.get(name)
        if place is not None and place < picture.shape[2]:
            return channels_of(picture, place, place + 1)[..., 0]
        return channels_of(picture, 0, 3).mean(dim=-1)

    def _load(self, name: str, material: str, *, encoded: bool) -> Tensor | None:
        found = find_beside(self._path, name)
        if found != self._path.parent / name.replace("\\", "/"):
            self._notes.repaired(f"picture {name!r} is not there, {found.name} beside the file is taken")
        try:
            return read_texture(found, encoded=encoded)
        except ImageFileError as error:
            self._notes.missing(f"material {material!r}", f"texture {name!r}: {error.reason}")
            return None


def is_normal_map(picture: Tensor) -> bool:
    """Whether a picture named as a bump map holds normals: it is coloured, and mostly points outwards."""
    means = channels_of(picture, 0, 3).mean(dim=(0, 1))
    return bool(means[2] > 0.7) and bool((means[:2] - 0.5).abs().max() < 0.2)


def normals_of_heights(height: Tensor, scale: float) -> Tensor:
    """(H,W,3) normal texture of heights (H,W) in [0,1], one texel wide for a height of ``scale``; edges repeat."""
    du = (torch.roll(height, -1, 1) - torch.roll(height, 1, 1)) / 2
    dv = (torch.roll(height, 1, 0) - torch.roll(height, -1, 0)) / 2  # v runs up, rows run down
    normal = torch.stack([-scale * du, -scale * dv, torch.ones_like(height)], dim=-1)
    return (torch.nn.functional.normalize(normal, dim=-1) + 1) / 2
