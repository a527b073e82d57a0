"""A contact sheet of test models: each as it comes out here, beside the picture published with it and what it means."""

from __future__ import annotations

import math
import textwrap
import warnings
from pathlib import Path

import torch
from PIL import Image as Picture
from PIL import ImageDraw
from torch import Tensor

from torchrender.errors import TorchRenderError
from torchrender.images.files import write_atomically
from torchrender.pipeline.options import RenderOptions
from torchrender.renderer import render
from torchrender.scene.camera import Cameras
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
    "NormalTangentTest": "Derived tangents: every bump lit from the same side as real ones beside it.",
    "SimpleSparseAccessor": "A strip of triangles; three corners moved by a sparse accessor.",
    "SpecularTest": "Black dielectrics: from left to right more mirrored light, by what each row's label names.",
    "TextureCoordinateTest": "Fields of a picture: each shows its own label, upright.",
    "TextureSettingsTest": "Wrap modes and sides: a green tick wherever one is asked for, no red cross.",
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

SIDE, LINES, GAP = 256, 4, 6


def files_of(folder: Path) -> list[Path]:
    """The models of a folder: GLB files, and glTF files in folders of their own."""
    return sorted([*folder.glob("*.glb"), *folder.glob("*/*.gltf")], key=lambda file: file.stem.lower())


def write_sheet(path: Path, folder: Path, *, side: int = SIDE, names: tuple[str, ...] = ()) -> list[str]:
    """Draw all models of a folder, or those named; -> what did not come out, one line each."""
    tiles, failed = [], []
    for file in files_of(folder):
        if names and file.stem not in names:
            continue
        try:
            tiles.append((file.stem, drawn(file, side), _published(folder / "expected", file.stem)))
        except TorchRenderError as error:
            failed.append(f"{file.stem}: {error}")
    if tiles:
        _write(path, tiles, side)
    return failed


def drawn(file: Path, side: int) -> Tensor:
    """(H,W,3) uint8 picture of a model by its first camera, or one that sees all of it."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        scene = load(file)
        camera = _before(scene, side, FRONT[file.stem]) if file.stem in FRONT else None
        image = render(scene, camera, width=side, height=side, options=RenderOptions(supersample=2))
    pixels: Tensor = image.to_srgb()[0]
    return pixels if pixels.dtype == torch.uint8 else (pixels.clamp(0, 1) * 255 + 0.5).to(torch.uint8)


def _before(scene: Scene, side: int, sign: float) -> Cameras:
    """A camera that sees all of a board straight."""
    low, high = scene.bounds
    middle, size = (low + high) / 2, high - low
    away = 0.55 * float(size[:2].max()) / math.tan(math.radians(15.0)) + 0.5 * float(size[2])
    eye = middle + torch.tensor([0.0, 0.0, sign * away], dtype=torch.float64)
    return Cameras.look_at(eye, middle, width=side, height=side, fov_deg=30.0, near=1e-3 * away)


def _published(folder: Path, name: str) -> Picture.Image | None:
    for suffix in (".png", ".jpg"):
        file = folder / f"{name}{suffix}"
        if file.is_file():
            return Picture.open(file).convert("RGB")
    return None


def _write(path: Path, tiles: list[tuple[str, Tensor, Picture.Image | None]], side: int) -> None:
    columns = 3
    step = (2 * side + 2 * GAP, side + 14 * LINES + GAP)
    rows = -(-len(tiles) // columns)
    sheet = Picture.new("RGB", (columns * step[0] + GAP, rows * step[1] + GAP), "white")
    pen = ImageDraw.Draw(sheet)
    for number, (name, pixels, published) in enumerate(tiles):
        x, y = GAP + number % columns * step[0], GAP + number // columns * step[1]
        sheet.paste(Picture.fromarray(pixels.numpy()), (x, y))
        if published is not None:
            published.thumbnail((side, side))
            sheet.paste(published, (x + side + GAP // 2, y))
        else:
            pen.text((x + side + GAP, y + 4), "no picture was published with it", fill="grey")
        text = textwrap.wrap(f"{name}: {MEANS.get(name, '')}", width=2 * side // 7)[:LINES]
        for line, words in enumerate(text):
            pen.text((x, y + side + 2 + 13 * line), words, fill="black")
    path.parent.mkdir(parents=True, exist_ok=True)
    write_atomically(path, lambda p: sheet.save(p, format="JPEG", quality=88))
