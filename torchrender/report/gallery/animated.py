"""An animated character at several times: ``python -m torchrender.report.gallery.animated WALKER.glb``.

Writes ``docs/animated.jpg``: pictures side by side out of the first half of the animation, on a floor under a low sun
and a sky. What moves is brought up to date by ``Scene.at``; floor, light and camera stay.
"""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import torch
from PIL import Image as Picture

from torchrender.errors import SceneFileError
from torchrender.images.files import write_atomically
from torchrender.pipeline.history import RenderHistory
from torchrender.pipeline.options import RenderOptions
from torchrender.renderer import render
from torchrender.report.common.command import study_parser
from torchrender.scene.camera import Cameras
from torchrender.scene.light import DirectionalLight
from torchrender.scene.load import load
from torchrender.scene.material import Material
from torchrender.scene.model import Scene
from torchrender.scene.shapes import plane

SUN = torch.tensor([-0.55, -1.0, -0.35])
SKY = torch.tensor([0.30, 0.34, 0.40])


def on_floor(scene: Scene) -> Scene:
    """The scene lit by a low sun, on a floor that is three times as wide as it is tall."""
    low, high = scene.bounds
    height = float((high - low).max())
    floor = plane(torch.tensor([3.0 * height, 3.0 * height]), 1, 1.0)
    middle = torch.tensor([float(low[0] + high[0]) / 2, float(low[1]), float(low[2] + high[2]) / 2]).double()
    floor = replace(floor, vertices=floor.vertices + middle, name="floor", material=len(scene.materials))
    sun = DirectionalLight(direction=SUN / SUN.norm(), irradiance=torch.tensor([2.2, 2.05, 1.75]), name="sun")
    stone = Material(name="stone", diffuse=torch.tensor([0.52, 0.48, 0.43]))
    return replace(
        scene, meshes=(*scene.meshes, floor), materials=(*scene.materials, stone), lights=(sun,), ambient=SKY
    )


def view_of(scene: Scene, width: int, height: int) -> Cameras:
    """A camera that sees all of a figure from its side and a little from above."""
    low, high = scene.bounds
    middle, tall = (low + high) / 2, float((high - low).max())
    eye = middle + torch.tensor([1.25, 0.45, 1.15]).double() * tall
    return Cameras.look_at(eye, middle, width=width, height=height, fov_deg=45.0)


def strip(scene: Scene, times: list[float], animation: str | None, width: int, height: int) -> Picture.Image:
    """The scene at these times, side by side."""
    camera, whole = view_of(scene, width, height), on_floor(scene)
    history, options = RenderHistory(), RenderOptions(supersample=2)
    out = Picture.new("RGB", (width * len(times), height))
    for number, time in enumerate(times):
        image = render(whole.at(time, animation), camera, options=options, history=history)
        out.paste(Picture.fromarray((image.to_srgb()[0] * 255 + 0.5).to(torch.uint8).numpy()), (number * width, 0))
    return out


def main(arguments: list[str] | None = None) -> int:
    """Render and write the strip."""
    parser = study_parser(__doc__, output=Path("docs/animated.jpg"))
    parser.add_argument("scene", help="an animated glTF file")
    parser.add_argument("--animation", help="its name or number (default: the first)")
    parser.add_argument("--pictures", type=int, default=5, help="how many (default 5)")
    parser.add_argument("--size", default="320x440", help="of one picture (default 320x440)")
    chosen = parser.parse_args(arguments)
    width, height = (int(n) for n in chosen.size.split("x"))
    scene = load(chosen.scene)
    known = scene.animations
    if not known:
        raise SceneFileError(chosen.scene, "has no animation")
    duration = known.get(chosen.animation, next(iter(known.values())))
    times = [duration * k / chosen.pictures / 2 for k in range(chosen.pictures)]
    picture = strip(scene, times, chosen.animation, width, height)
    write_atomically(chosen.output, lambda p: picture.save(p, format="JPEG", quality=86))
    sys.stderr.write(f"wrote {chosen.output}\n")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
