"""Scenes and photos of the study: built-in rooms, scene files where they are found, and photos of rooms."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path

import torch
from torch import Tensor

from torchrender.images.files import read_image
from torchrender.scene.load import load
from torchrender.scene.model import Scene

BORDER = 10  # white pixels around some of the photos
ROOMS = {"living room": ("living_room", 60_000), "washroom": ("washroom", None), "box": ("cornell_box", None)}
FILES = {"bookstore": "scenes/bookstore.glb"}
OUTDOOR = {"garden": "scenes/house_garden.glb", "city": "city"}
PHOTOS = {
    "reading corner": "material/nyu_photo_499.png",
    "kitchenette": "material/nyu_photo_377.png",
    "kitchen": "material/nyu_photo_470.png",
    "billiard room": "material/nyu_photo_626.png",
    "coffee": "photos/coffee.png",
    "temple": "photos/china.jpg",
    "street": "photos/leuvenA.jpg",
}


def data_folder() -> Path:
    """Where scenes and photos are looked for."""
    return Path(os.environ.get("TORCHRENDER_DATA", "../shared/data"))


def photo(name: str) -> Tensor:
    """(H,W,3) linear light, without a white border."""
    path = data_folder() / PHOTOS[name]
    image = read_image(path)
    return image[BORDER:-BORDER, BORDER:-BORDER] if "nyu" in path.name else image


def indoor(names: tuple[str, ...]) -> dict[str, Scene]:
    """The named rooms that are there."""
    found = {}
    for name in names:
        if name in ROOMS:
            built, size = ROOMS[name]
            found[name] = load(built, size=size)
        elif (data_folder() / FILES[name]).is_file():
            found[name] = load(data_folder() / FILES[name])
    return found


def outdoor(names: tuple[str, ...]) -> dict[str, Scene]:
    """The named outdoor scenes that are there."""
    found = {}
    for name in names:
        source = OUTDOOR[name]
        if "/" not in source:
            found[name] = load(source, size=40_000)
        elif (data_folder() / source).is_file():
            found[name] = load(data_folder() / source)
    return found


def largest(scene: Scene, count: int) -> Scene:
    """The scene with its ``count`` objects of most surface, lights and emitters left out."""
    area: dict[int, float] = {}
    for number, mesh in enumerate(scene.meshes):
        if float(scene.materials[mesh.material].emission.max()) > 0 or not len(mesh.faces):
            continue
        corners = mesh.vertices.double()[mesh.faces]
        cross = torch.linalg.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        key = number if mesh.object_id is None else mesh.object_id
        area[key] = area.get(key, 0.0) + float(cross.norm(dim=1).sum())
    kept = set(sorted(area, key=lambda k: -area[k])[:count])
    chosen = [m for k, m in enumerate(scene.meshes) if (k if m.object_id is None else m.object_id) in kept]
    meshes = tuple(m for m in chosen if not float(scene.materials[m.material].emission.max()) > 0)
    return replace(scene, meshes=meshes)
