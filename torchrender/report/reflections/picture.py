"""The picture of reflections in the README.

``python -m torchrender.report.reflections.picture [-o docs/reflections.jpg]``

One row per scene: clustered depth images, rays, the environment map alone, and no reflections.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from torchrender.images.files import write_atomically
from torchrender.pipeline.options import RenderOptions
from torchrender.renderer import render
from torchrender.report.gallery.study import sheet
from torchrender.scene.procedural import build

VIEWS = (("living_room", "default"), ("washroom", "default"))
CAPTIONS = {
    "clustered": "clustered depth images",
    "traced": "ray tracing",
    "environment": "environment map",
    "off": "no reflections",
}


def main() -> None:
    """Command-line entry."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--size", type=int, default=384, metavar="PIXELS", help="side of one picture (default 384)")
    parser.add_argument("-o", "--output", type=Path, default=Path("docs/reflections.jpg"))
    arguments = parser.parse_args()
    tiles = []
    for name, camera in VIEWS:
        scene = build(name)
        for mode, caption in CAPTIONS.items():
            sys.stderr.write(f"{name}, {caption}\n")
            options = RenderOptions(supersample=2, reflections=mode)
            image = render(scene, camera, width=arguments.size, height=arguments.size, options=options)
            tiles.append((caption, image.to_srgb()[0]))
    picture = sheet(tiles, columns=len(CAPTIONS))
    write_atomically(arguments.output, lambda path: picture.save(path, format="JPEG", quality=82))
    sys.stderr.write(f"wrote {arguments.output}\n")


if __name__ == "__main__":
    main()
