"""Colours and textures of the two rooms."""

from __future__ import annotations

import numpy as np
import torch

from torchrender.scene.material import Material
from torchrender.scene.procedural.parts.assembly import Assembly
from torchrender.scene.procedural.parts.textures import abstract, landscape, mottled, planks, rug, stripes, wood

SHARP = {"mirror": 1e5, "dark glass": 4e3, "screen": 4e3, "glass shelf": 4e3}
"""Phong exponents of flat panes: a wide highlight would look like a lamp in the glass."""


_LIVING_ROOM_MIRRORS = {  # name: diffuse colour, specular degree, tint
    "mirror": ((0.02, 0.02, 0.02), 0.95, (1, 1, 1)),
    "chrome": ((0.06, 0.06, 0.06), 0.88, (0.97, 0.98, 1.0)),
    "brass": ((0.10, 0.06, 0.015), 0.82, (1.0, 0.80, 0.42)),
    "copper": ((0.10, 0.04, 0.02), 0.8, (1.0, 0.66, 0.5)),
    "dark glass": ((0.015, 0.02, 0.025), 0.42, (0.95, 1.0, 1.0)),
    "screen": ((0.012, 0.012, 0.015), 0.30, (1, 1, 1)),
    "blue glaze": ((0.02, 0.08, 0.30), 0.28, (1, 1, 1)),
    "white glaze": ((0.70, 0.69, 0.66), 0.20, (1, 1, 1)),
    "red glaze": ((0.40, 0.02, 0.015), 0.25, (1, 1, 1)),
    "green glaze": ((0.03, 0.16, 0.10), 0.25, (1, 1, 1)),
}


def living_room_palette(rng: np.random.Generator) -> dict[str, Material]:
    """Materials of the living room by name."""
    made = Assembly()
    m = made.material
    made.material(
        "parquet",
        (1, 1, 1),
        texture=planks(rng, (0.20, 0.095, 0.04), (0.42, 0.23, 0.105)),
        specular=0.28,
        shininess=28.0,
    )
    m("ceiling", (0.80, 0.79, 0.76))
    m("plaster", (0.70, 0.66, 0.58))
    m("accent wall", (0.16, 0.27, 0.27))
    m("window frame", (0.78, 0.77, 0.74))
    m("white wood", (0.74, 0.72, 0.68))
    m("outside", (0.5, 0.5, 0.5), emission=torch.tensor([0.5, 0.55, 0.6]))
    m("view sky", (0, 0, 0), emission=torch.tensor([0.80, 0.95, 1.15]))
    m("view hills", (0, 0, 0), emission=torch.tensor([0.34, 0.50, 0.42]))
    m("view trees", (0, 0, 0), emission=torch.tensor([0.11, 0.22, 0.08]))
    m("sofa frame", (0.42, 0.40, 0.36))
    m("sofa fabric", (0.50, 0.48, 0.43))
    m("mustard", (0.62, 0.36, 0.05))
    m("teal", (0.05, 0.24, 0.26))
    m(
        "striped",
        (1, 1, 1),
        texture=stripes(((0.75, 0.7, 0.6), (0.5, 0.1, 0.06), (0.75, 0.7, 0.6), (0.1, 0.2, 0.27)), (3, 1, 1, 1)),
    )
    m("seat fabric", (0.45, 0.12, 0.06))
    m("dark wood", (1, 1, 1), texture=wood(rng, (0.055, 0.03, 0.018), (0.13, 0.07, 0.04)))
    m("light wood", (1, 1, 1), texture=wood(rng, (0.38, 0.23, 0.11), (0.55, 0.36, 0.19)))
    m("rug", (1, 1, 1), texture=rug(rng, (0.50, 0.42, 0.31), (0.30, 0.045, 0.035), (0.09, 0.12, 0.2)))
    m("curtain", (0.66, 0.60, 0.50))
    m("book", (1, 1, 1), specular=0.03)
    m("paper", (0.75, 0.70, 0.58))
    m("gilt", (0.65, 0.48, 0.16), specular=0.06)
    m("shade", (0.80, 0.72, 0.55), emission=torch.tensor([0.62, 0.44, 0.22]))
    m("soil", (0.06, 0.04, 0.025))
    m("stem", (0.14, 0.22, 0.06))
    m("leaf", (0.07, 0.22, 0.045), specular=0.05, shininess=30.0)
    m("fruit", (1, 1, 1), specular=0.06, shininess=60.0)
    m("frame", (0.09, 0.055, 0.03))
    m("sunset", (1, 1, 1), texture=landscape(rng))
    m("lake", (1, 1, 1), texture=landscape(rng, warm=False), specular=0.12, shininess=300.0)
    m(
        "abstract",
        (1, 1, 1),
        texture=abstract(rng, ((0.6, 0.1, 0.05), (0.05, 0.2, 0.3), (0.7, 0.5, 0.1), (0.1, 0.1, 0.1))),
        specular=0.12,
        shininess=300.0,
    )
    m("marble", (1, 1, 1), texture=mottled(rng, (0.55, 0.53, 0.5), (0.8, 0.79, 0.77)), specular=0.15, shininess=250.0)
    for name, (color, specular, tint) in _LIVING_ROOM_MIRRORS.items():
        made.mirror(name, color, specular, tint, shininess=SHARP.get(name, 400.0))
    return made.materials


def washroom_palette(rng: np.random.Generator) -> dict[str, Material]:
    """Materials of the washroom by name."""
    made = Assembly()
    m = made.material
    m("grout", (0.60, 0.59, 0.56))
    m("plaster", (0.74, 0.73, 0.69))
    m("ceiling", (0.82, 0.82, 0.80))
    m("wall tile", (1, 1, 1), specular=0.06, shininess=60.0)
    m("floor tile", (1, 1, 1), specular=0.16, shininess=50.0)
    m("window frame", (0.78, 0.78, 0.76))
    m("white wood", (0.74, 0.73, 0.70))
    m("outside", (0.5, 0.5, 0.5), emission=torch.tensor([0.5, 0.55, 0.6]))
    m("view sky", (0, 0, 0), emission=torch.tensor([0.85, 0.98, 1.15]))
    m("view hills", (0, 0, 0), emission=torch.tensor([0.36, 0.52, 0.42]))
    m("view trees", (0, 0, 0), emission=torch.tensor([0.12, 0.24, 0.08]))
    m("oak", (1, 1, 1), texture=wood(rng, (0.30, 0.17, 0.08), (0.47, 0.29, 0.15)))
    m("stone", (1, 1, 1), texture=mottled(rng, (0.30, 0.30, 0.31), (0.48, 0.47, 0.46)), specular=0.07, shininess=120.0)
    m("terry white", (0.80, 0.79, 0.76))
    m("terry coral", (0.70, 0.24, 0.17))
    m("terry blue", (0.10, 0.27, 0.38))
    m("mat", (0.62, 0.60, 0.54))
    m("amber", (0.36, 0.13, 0.02), specular=0.07, shininess=200.0)
    m("green soap", (0.10, 0.32, 0.18), specular=0.07, shininess=200.0)
    m("soap", (0.75, 0.62, 0.5))
    m("lamp", (0.85, 0.85, 0.82), emission=torch.tensor([1.0, 0.93, 0.8]))
    m("leaf", (0.07, 0.22, 0.045), specular=0.05, shininess=30.0)
    m("pot", (0.45, 0.17, 0.08))
    for name, color, specular, tint in (
        ("mirror", (0.02, 0.02, 0.02), 0.95, (1, 1, 1)), ("chrome", (0.06, 0.06, 0.06), 0.88, (0.97, 0.98, 1.0)),
        ("porcelain", (0.80, 0.80, 0.78), 0.12, (1, 1, 1)),
        ("glass shelf", (0.12, 0.17, 0.16), 0.35, (0.95, 1.0, 0.98)),
        ("brass", (0.10, 0.06, 0.015), 0.8, (1.0, 0.82, 0.48)),
    ):  # fmt: skip
        made.mirror(name, color, specular, tint, shininess=SHARP.get(name, 400.0))
    return made.materials
