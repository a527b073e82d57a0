"""A closed washroom: tiled in real geometry, with mirrors, basins, chrome taps, a shower, pipes and towels."""

from __future__ import annotations

import numpy as np

from torchrender.scene.light import Light, PointLight, RectLight, SpotLight
from torchrender.scene.material import Material
from torchrender.scene.model import Scene
from torchrender.scene.procedural.parts import furniture as fu
from torchrender.scene.procedural.parts import vessels as ve
from torchrender.scene.procedural.parts.assembly import Assembly, as_tensor, fitted, view
from torchrender.scene.procedural.parts.palettes import washroom_palette
from torchrender.scene.procedural.parts.room import Shell, door
from torchrender.scene.procedural.parts.tiling import WINDOW, H, X, Z, tiled_room
from torchrender.scene.procedural.parts.washroom_fixtures import (
    paper_and_bin,
    pipes,
    shelves,
    shower,
    toilet,
    towels,
    vanity,
)

USUAL, FEWEST = 90_000, 7_000
FULL = 178_000  # about the count at which detail 1 leaves an eighth to the bath mat's pile
MAT = (0.9, 0.55, 0.0, 0.28)  # width, depth, centre x, centre z


def _furnished(detail: float, materials: dict[str, Material], seed: int) -> Assembly:
    rng = np.random.default_rng((seed, 8))
    made = Assembly(materials)
    shell = Shell(half_x=X, half_z=Z, height=H, cell=float(np.clip(0.3 / detail, 0.06, 1.6)))
    shell.build(made, floor="grout", ceiling="ceiling", walls=("plaster", "plaster", "plaster"))
    shell.window_wall(made, "plaster", low=WINDOW[0], high=WINDOW[1], bars=1)
    tiled_room(made, rng, detail)
    vanity(made, rng, detail)
    for add in (towels, shelves, toilet, paper_and_bin, pipes, shower):
        add(made, detail)
    made.add("door", {m: p.moved((0.55, 0.001, Z - 0.001), yaw_deg=180.0) for m, p in door(0.85, 2.03).items()})
    grip = ve.handle(
        ((0.2, 1.0, Z - 0.04), (0.2, 1.0, Z - 0.1), (0.24, 1.0, Z - 0.11), (0.33, 1.0, Z - 0.11)), 0.009, detail
    )
    made.add("door handle", ("chrome", grip))
    w, depth, x, z = MAT
    made.add("bath mat", ("mat", fu.carpet(w, depth, detail * 0.6).moved((x, 0.006, z))))
    return made


def washroom(triangles: int, seed: int) -> Scene:
    """Curved surfaces get finer and tiles smaller with the count; the bath mat's pile fills up what is left."""
    palette = washroom_palette(np.random.default_rng((seed, 9)))
    made, left = fitted(lambda detail: _furnished(detail, palette, seed), triangles, usual=FULL)
    w, depth, x, z = MAT
    pile = fu.pile(np.random.default_rng((seed, 10)), w, depth, max(left // 4, 1), 0.014)
    made.add("bath mat pile", ("mat", pile.moved((x, 0.006, z))))
    cameras = {
        "default": view((0.95, 1.48, 1.36), (-0.42, 0.92, -1.0), 65.0, 0.03, 20.0),
        "close": view((0.02, 1.28, -0.72), (-0.82, 0.97, -1.4), 52.0, 0.02, 20.0),
        "mirror": view((-0.55, 1.5, 0.55), (-0.1, 1.28, -1.5), 60.0, 0.03, 20.0),
        "toilet": view((-1.25, 1.5, -0.55), (1.1, 0.75, 0.15), 62.0, 0.03, 20.0),
    }
    return made.scene("washroom", lights=_lights(), cameras=cameras, ambient=(0.17, 0.17, 0.165))


def _lights() -> list[Light]:
    (low_z, low_y), (high_z, high_y) = WINDOW
    return [
        RectLight(
            corner=as_tensor((-X + 0.02, low_y, low_z)),
            edge_u=as_tensor((0, high_y - low_y, 0)),
            edge_v=as_tensor((0, 0, high_z - low_z)),
            radiance=as_tensor((4.6, 5.0, 5.6)),
            name="window",
        ),
        PointLight(
            position=as_tensor((-0.75, 1.97, -Z + 0.32)), intensity=as_tensor((0.8, 0.73, 0.6)), name="left lamp"
        ),
        PointLight(
            position=as_tensor((0.25, 1.97, -Z + 0.32)), intensity=as_tensor((0.8, 0.73, 0.6)), name="right lamp"
        ),
        SpotLight(
            position=as_tensor((0.45, 2.46, 0.35)),
            direction=as_tensor((-0.05, -1.0, -0.1)),
            intensity=as_tensor((3.0, 2.85, 2.6)),
            inner_deg=35.0,
            outer_deg=62.0,
            name="ceiling spot",
        ),
    ]
