"""Contact sheet of every built-in scene, and of real ones where they are: ``python -m torchrender.report.gallery``.

Writes ``docs/gallery.jpg``. Real scenes are looked for in ``TORCHRENDER_DATA`` (default ``../shared/data``).
"""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import torch
from PIL import Image as Picture
from PIL import ImageDraw
from torch import Tensor

from torchrender.images.files import write_atomically
from torchrender.pipeline.options import RenderOptions
from torchrender.renderer import render
from torchrender.report.common.command import study_parser
from torchrender.scene.camera import Cameras
from torchrender.scene.light import PointLight
from torchrender.scene.load import load
from torchrender.scene.model import Scene
from torchrender.scene.procedural import SCENES, build

MODELS = (
    "meshes/stanford_dragon_res2.ply",
    "scenes/forest_tile.glb",
    "gltf/2CylinderEngine.glb",
    "characters/CesiumMan.glb",
)
LAMP_DROP = torch.tensor([0.0, 0.4, 0.0])  # the world file puts the lights inside their shades
COLUMNS, MARGIN, CAPTION = 4, 6, 18


def main() -> None:
    """Render all and write the sheet."""
    parser = study_parser(__doc__, output=Path("docs/gallery.jpg"))
    parser.add_argument("--size", default="480x360", help="size of one picture (default 480x360)")
    arguments = parser.parse_args()
    width, height = (int(n) for n in arguments.size.split("x"))
    options = RenderOptions(supersample=2)
    tiles = []
    for caption, scene, camera in subjects():
        sys.stderr.write(f"{caption}\n")
        image = render(scene, camera, width=width, height=height, options=options)
        tiles.append((f"{caption}, {scene.geometry.triangle_count:,} triangles", image.to_srgb()[0]))
    arguments.output.parent.mkdir(parents=True, exist_ok=True)
    picture = sheet(tiles)
    write_atomically(arguments.output, lambda p: picture.save(p, format="JPEG", quality=90))
    sys.stderr.write(f"wrote {arguments.output}\n")


def subjects() -> Iterator[tuple[str, Scene, Cameras | str | None]]:
    """Caption, scene and camera of each picture."""
    for name in SCENES:
        yield name, build(name), None
    data = Path(os.environ.get("TORCHRENDER_DATA", "../shared/data"))
    store = data / "scenes" / "bookstore.glb"
    if store.is_file():
        yield "bookstore.glb", lit_store(load(store), store.with_name("bookstore_lights.json")), store_camera()
    for model in MODELS:
        if (data / model).is_file():
            yield Path(model).name, load(data / model), None


def store_camera() -> Cameras:
    """A view into the furnished shop, which has no ceiling and no camera of its own."""
    return Cameras.look_at((6.4, 2.3, 4.4), (-1.0, 0.5, -1.5), width=480, height=360, fov_deg=62, near=0.05)


def lit_store(scene: Scene, lights: Path) -> Scene:
    """The shop with the lamps of its world file."""
    lamps = json.loads(lights.read_text())["lights"]
    points = tuple(
        PointLight(
            position=torch.tensor(lamp["position"]) - LAMP_DROP,
            intensity=torch.tensor(lamp["diffuse"]) * 9,
            name=lamp["name"],
        )
        for lamp in lamps
        if lamp["type"] == "point"
    )
    return replace(scene, lights=points, ambient=torch.full((3,), 0.25))


def sheet(tiles: list[tuple[str, Tensor]], columns: int = COLUMNS) -> Picture.Image:
    """Pictures (H,W,3) in rows with captions below."""
    height, width = tiles[0][1].shape[:2]
    rows = -(-len(tiles) // columns)
    step = (width + MARGIN, height + MARGIN + CAPTION)
    out = Picture.new("RGB", (columns * step[0] + MARGIN, rows * step[1] + MARGIN), "white")
    pen = ImageDraw.Draw(out)
    for k, (caption, image) in enumerate(tiles):
        x, y = MARGIN + (k % columns) * step[0], MARGIN + (k // columns) * step[1]
        pixels = image if image.dtype == torch.uint8 else (image.clamp(0, 1) * 255 + 0.5).to(torch.uint8)
        out.paste(Picture.fromarray(pixels.numpy()), (x, y))
        pen.text((x + 2, y + height + 2), caption, fill="black")
    return out
