"""The parts of a scene that get one material each."""

from __future__ import annotations

import fnmatch
from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from torchrender.checks import check_choice
from torchrender.errors import InputError
from torchrender.photo.style.options import CUTS
from torchrender.scene.mesh import Mesh
from torchrender.scene.model import Scene

MAX_OBJECTS = 5000
GLOWS = 0.05
"""Radiance from which a mesh is a light source; less is a detail that glows, and stays in the new material."""
_LISTED = 12


@dataclass(frozen=True, eq=False)
class StyleObjects:
    """m objects of a scene. Light sources are none of them: they keep their material."""

    names: tuple[str, ...]  # m different names
    meshes: tuple[tuple[int, ...], ...]  # places in Scene.meshes
    triangle: Tensor  # (F,) int64 object of each triangle, -1 where the material is kept
    kept: tuple[str, ...]  # names of meshes that emit light

    def __len__(self) -> int:
        return len(self.names)

    def find(self, words: Sequence[str]) -> list[int]:
        """Objects by name, by ``#number``, or by a pattern with ``*`` and ``?``; in order, each once.

        A single string is one word.

        Raises:
            InputError: a word that fits no object; the message lists the names.
        """
        found: set[int] = set()
        for word in [words] if isinstance(words, str) else words:
            found |= self._matching(word)
        return sorted(found)

    def one(self, word: str) -> int:
        """The only object that a word fits.

        Raises:
            InputError: it fits none or several.
        """
        found = sorted(self._matching(word))
        if len(found) > 1:
            raise InputError(f"object {word!r} fits {len(found)} objects: {_listed([self.names[i] for i in found])}")
        return found[0]

    def _matching(self, word: str) -> set[int]:
        if not isinstance(word, str):
            raise InputError(f"an object is named by a string, got {type(word).__name__}")
        if word in self.names:
            return {self.names.index(word)}
        if word.startswith("#") and word[1:].isdecimal() and int(word[1:]) < len(self.names):
            return {int(word[1:])}
        found = {i for i, name in enumerate(self.names) if fnmatch.fnmatchcase(name, word)}
        if not found:
            kept = f"; {word!r} emits light and keeps its material" if word in self.kept else ""
            raise InputError(f"no object is named {word!r}; objects: {_listed(self.names)}{kept}")
        return found


def cut_scene(scene: Scene, cut: str = "object") -> StyleObjects:
    """The objects of a scene: its own, its meshes, or all meshes of one material.

    Raises:
        InputError: nothing to give a material to, or more than ``MAX_OBJECTS``.
    """
    check_choice("cut", cut, CUTS)
    groups: dict[int, list[int]] = {}
    kept = []
    for number, mesh in enumerate(scene.meshes):
        if not len(mesh.faces):
            continue
        if float(scene.materials[mesh.material].emission.max()) >= GLOWS:
            kept.append(mesh.name)
            continue
        own = number if mesh.object_id is None else mesh.object_id
        key = {"object": own, "mesh": number, "material": mesh.material}[cut]
        groups.setdefault(key, []).append(number)
    if not groups:
        reason = "all of its meshes emit light" if kept else "it holds no triangles"
        raise InputError(f"scene {scene.name!r} has no object to give a material to: {reason}")
    if len(groups) > MAX_OBJECTS:
        raise InputError(f"a scene may have at most {MAX_OBJECTS} objects, {scene.name!r} has {len(groups)}")
    of_mesh = torch.full((len(scene.meshes),), -1, dtype=torch.int64)
    for index, numbers in enumerate(groups.values()):
        of_mesh[numbers] = index
    sizes = torch.tensor([len(m.faces) for m in scene.meshes])
    if cut == "material":
        wanted = [scene.materials[key].name for key in groups]
    else:
        wanted = [_name([scene.meshes[k] for k in numbers]) for numbers in groups.values()]
    return StyleObjects(
        names=_different(wanted),
        meshes=tuple(tuple(numbers) for numbers in groups.values()),
        triangle=torch.repeat_interleave(of_mesh, sizes),
        kept=tuple(dict.fromkeys(kept)),
    )


def _name(meshes: Sequence[Mesh]) -> str:
    """What the names of an object's meshes share up to a slash, else the name of the first."""
    first = meshes[0].name
    head = first.split("/")[0]
    shared = len(meshes) > 1 and all(m.name.split("/")[0] == head for m in meshes)
    return (head if shared and head else first) or "object"


def _different(names: Sequence[str]) -> tuple[str, ...]:
    """The names, with a number behind those that are taken already."""
    taken: set[str] = set()
    out = []
    for name in names:
        number, chosen = 2, name
        while chosen in taken:
            chosen, number = f"{name} ({number})", number + 1
        taken.add(chosen)
        out.append(chosen)
    return tuple(out)


def _listed(names: Sequence[str]) -> str:
    more = f" and {len(names) - _LISTED} more" if len(names) > _LISTED else ""
    return ", ".join(names[:_LISTED]) + more
