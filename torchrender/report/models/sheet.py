"""Contact sheets: pictures as they come out here, as a path tracer has them, as published, and what they mean."""

from __future__ import annotations

import math
import textwrap
import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import torch
from PIL import Image as Picture
from PIL import ImageDraw
from torch import Tensor

from torchrender.images.files import write_atomically
from torchrender.pipeline.options import RenderOptions
from torchrender.renderer import render
from torchrender.report.models.path_traced import available, path_traced
from torchrender.report.models.twins import Twin, seen
from torchrender.scene.camera import Cameras
from torchrender.scene.environment import Environment
from torchrender.scene.load import load
from torchrender.scene.model import Scene

MEANS = {
    "2CylinderEngine": "Nested nodes: every part in its place.",
    "AlphaBlendModeTest": "Opaque, blend, mask with cutoffs: the ticks stand where the labels say.",
    "AnimatedMorphCube": "A cube with weights of two morph targets.",
    "BarramundiFish": "A scanned fish with its normal map; its two other pictures are not in the folder.",
    "BoxAnimated": "A box within a box at time 0.",
    "Cameras": "A square seen by the file's own first camera.",
    "ClearCoatTest": "Columns: base layer, coated, coat alone; coated is both of its neighbours.",
    "DamagedHelmet": "Metal with all maps; the visor's lights glow, nothing else does.",
    "NormalTangentTest": "Derived tangents: every bump lit from the same side as real ones beside it "
    "(steep normals are black in the path tracer).",
    "SimpleSparseAccessor": "A strip of triangles; three corners moved by a sparse accessor.",
    "SpecularTest": "Black dielectrics: from left to right more mirrored light, by what each row's label names "
    "(the path tracer is told neither colours nor textures of it).",
    "TextureCoordinateTest": "Fields of a picture: each shows its own label, upright.",
    "TextureSettingsTest": "Wrap modes and sides: a green tick wherever one is asked for, no red cross "
    "(the path tracer knows one wrap mode for both axes and draws back sides black).",
    "duck_pack-c": "The duck, compressed by meshopt: yellow with its texture.",
    "geometry-camera-light": "A scene with its own camera and photometric light.",
    "heart_draco": "A heart, compressed by Draco.",
    "simple-instancing": "Instances of one mesh, each with its own place, turn and size.",
}
"""What each file is to show, by its name."""

FRONT = {
    "AlphaBlendModeTest": 1.0, "ClearCoatTest": 1.0, "NormalTangentTest": 1.0, "SimpleSparseAccessor": 1.0,
    "SpecularTest": 1.0, "TextureCoordinateTest": -1.0, "TextureSettingsTest": 1.0,
}  # fmt: skip
"""Boards that are looked at straight, and whether they face along z or against it."""

SIDE, LINES, GAP = 176, 4, 5
SAMPLES = 40
"""Of the path tracer, for each pixel of a tile."""


@dataclass(frozen=True, eq=False)
class Tile:
    """One row of pictures (S,S,3) uint8, and the words below."""

    name: str
    words: str
    found: Tensor
    traced: Tensor | None
    published: Picture.Image | None = None


def files_of(folder: Path) -> list[Path]:
    """The models of a folder: GLB files, and glTF files in folders of their own."""
    return sorted([*folder.glob("*.glb"), *folder.glob("*/*.gltf")], key=lambda file: file.stem.lower())


def tile_of_file(file: Path, sky: Environment, side: int = SIDE, samples: int = SAMPLES) -> Tile:
    """A model by its first camera, or one that sees all of it, under a sky where it has no light of its own.

    Raises:
        TorchRenderError: it cannot be read.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        scene = load(file)
    if not scene.lights and scene.environment is None:
        scene = replace(scene, environment=sky)
    camera = _before(scene, side, FRONT[file.stem]) if file.stem in FRONT else scene.camera(width=side, height=side)
    found, traced = _both(scene, camera, samples)
    return Tile(file.stem, MEANS.get(file.stem, ""), found, traced, _published(file, file.stem))


def tile_of_twin(twin: Twin, sky: Environment, side: int = SIDE, samples: int = SAMPLES) -> Tile:
    """A scene made here."""
    scene = twin.make(sky)
    found, traced = _both(scene, seen(twin, scene, side), samples)
    words = twin.means + (f" ({twin.differs})" if twin.differs else "")
    return Tile(twin.name, words, found, traced)


def _both(scene: Scene, camera: Cameras, samples: int) -> tuple[Tensor, Tensor | None]:
    image = render(scene, camera, options=RenderOptions(supersample=2))
    if not available():
        return _bytes(image.to_srgb()[0]), None
    traced = replace(image, radiance=path_traced(scene, camera, samples)[None], exposure=image.exposure)
    return _bytes(image.to_srgb()[0]), _bytes(traced.to_srgb()[0])


def _bytes(pixels: Tensor) -> Tensor:
    return (pixels.clamp(0, 1) * 255 + 0.5).to(torch.uint8)


def _before(scene: Scene, side: int, sign: float) -> Cameras:
    """A camera that sees all of a board straight."""
    low, high = scene.bounds
    middle, size = (low + high) / 2, high - low
    away = 0.55 * float(size[:2].max()) / math.tan(math.radians(15.0)) + 0.5 * float(size[2])
    eye = middle + torch.tensor([0.0, 0.0, sign * away], dtype=torch.float64)
    return Cameras.look_at(eye, middle, width=side, height=side, fov_deg=30.0, near=1e-3 * away)


def _published(file: Path, name: str) -> Picture.Image | None:
    """Beside the file, or beside its folder."""
    for folder in (file.parent / "expected", file.parent.parent / "expected"):
        for suffix in (".png", ".jpg"):
            picture = folder / f"{name}{suffix}"
            if picture.is_file():
                return Picture.open(picture).convert("RGB")
    return None


def write_sheet(path: Path, tiles: Sequence[Tile], *, columns: int, quality: int = 85) -> None:
    """A JPEG of all tiles: here, path traced, published where any was, and words below."""
    side = tiles[0].found.shape[0]
    across = 3 if any(tile.published is not None for tile in tiles) else 2
    step = (across * side + (across + 1) * GAP, side + 13 * LINES + GAP)
    rows = -(-len(tiles) // columns)
    sheet = Picture.new("RGB", (columns * step[0] + GAP, rows * step[1] + GAP), "white")
    pen = ImageDraw.Draw(sheet)
    for number, tile in enumerate(tiles):
        x, y = GAP + number % columns * step[0], GAP + number // columns * step[1]
        for place, pixels in enumerate((tile.found, tile.traced)):
            if pixels is not None:
                sheet.paste(Picture.fromarray(pixels.numpy()), (x + place * (side + GAP), y))
        if tile.published is not None:
            tile.published.thumbnail((side, side))
            sheet.paste(tile.published, (x + 2 * (side + GAP), y))
        text = textwrap.wrap(f"{tile.name}: {tile.words}", width=across * side // 6)[:LINES]
        for line, words in enumerate(text):
            pen.text((x, y + side + 1 + 12 * line), words, fill="black")
    path.parent.mkdir(parents=True, exist_ok=True)
    write_atomically(path, lambda p: sheet.save(p, format="JPEG", quality=quality))
