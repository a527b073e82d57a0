"""A closed, furnished living room with more than twenty reflecting objects and several lights."""

from __future__ import annotations

import numpy as np

from torchrender.scene.light import Light, PointLight, RectLight, SpotLight
from torchrender.scene.material import Material
from torchrender.scene.model import Scene
from torchrender.scene.procedural.parts import furniture as fu
from torchrender.scene.procedural.parts import vessels as ve
from torchrender.scene.procedural.parts.assembly import Assembly, as_tensor, fitted, view
from torchrender.scene.procedural.parts.curves import cylinder, sphere, torus, tube
from torchrender.scene.procedural.parts.palettes import living_room_palette
from torchrender.scene.procedural.parts.room import Shell, door, skirting
from torchrender.scene.procedural.parts.shapes import (
    Part,
    box,
    frame,
    merge,
    pitch_matrix,
    rounded_box,
    tilt_matrix,
    yaw_matrix,
)

USUAL, FEWEST = 280_000, 10_000
X, Z, H = 3.2, 2.7, 2.7
FULL = 405_000  # about the count at which detail 1 leaves an eighth to the carpet's pile
RUG = (2.9, 2.0, -0.55, -0.55)  # width, depth, centre x, centre z
WINDOW = ((-1.25, 0.75), (0.75, 2.25))  # low and high corner (z, y)


def _seating(made: Assembly, d: float) -> None:
    made.add("sofa", {m: p.moved((-0.65, 0, -2.12)) for m, p in fu.sofa(2.3, 3, d).items()})
    for k, (x, name, yaw) in enumerate(((-1.42, "mustard", 14.0), (-1.1, "teal", -8.0), (0.12, "striped", -12.0))):
        soft = fu.cushion((0.42, 0.42, 0.13), 0.055, d)
        soft = Part(soft.vertices, soft.faces, soft.normals, soft.vertices[:, :2] / 0.42 + 0.5)
        pose = yaw_matrix(yaw) @ pitch_matrix(-24.0) @ tilt_matrix(4.0 - 5 * k)
        made.add(f"{name} pillow", (name, soft.transformed(pose, (x, 0.67, -1.915 + 0.02 * k))))
    arm = {m: p.moved((-1.75 - 0.15, 0, 1.05), yaw_deg=128.0) for m, p in fu.sofa(1.02, 1, d).items()}
    made.add("armchair", arm)
    for k, (x, z, yaw) in enumerate(((1.72, 0.98, 82.0), (2.38, 1.62, 176.0), (2.45, 0.36, 4.0))):
        made.add(f"chair {k + 1}", {m: p.moved((x, 0, z), yaw_deg=yaw) for m, p in fu.chair(d).items()})
    w, depth, x, z = RUG
    made.add("carpet", ("rug", fu.carpet(w, depth, d).moved((x, 0.001, z))))


def _coffee_table(made: Assembly, rng: np.random.Generator, d: float) -> None:
    x, z, y = -0.6, -0.62, 0.42
    legs = fu.table(1.25, 0.68, 0.40, d, top="top", legs="chrome")["chrome"].moved((x, 0.012, z))
    made.add("coffee table legs", ("chrome", legs))
    top = rounded_box((1.25, 0.022, 0.68), 0.01, steps=ve.cut(4, d, 0), cells=ve.cut(16, d, 1))
    made.add("coffee table top", ("dark glass", top.moved((x, y - 0.001, z))))
    y += 0.0105
    made.add("blue vase", ("blue glaze", ve.vase("round", d, 0.8).moved((x - 0.40, y, z - 0.12))))
    twigs = fu.bush(rng, ve.cut(9, d, 3), ve.cut(12, d, 3), 0.42)
    made.add("twigs", {m: p.moved((x - 0.40, y + 0.12, z - 0.12)) for m, p in twigs.items()})
    made.add("fruit bowl", ("chrome", ve.bowl(0.16, 0.085, d).moved((x + 0.37, y, z - 0.04))))
    made.add("fruit", ("fruit", fu.apples(rng, 7, d).moved((x + 0.37, y + 0.022, z - 0.04))))
    tray = merge([cylinder(0.17, 0.0, 0.008, ve.cut(80, d, 6), bevel=0.002, rows=ve.cut(3, d, 1)),
                  torus(0.168, 0.008, ve.cut(96, d, 6), ve.cut(20, d, 3)).moved((0, 0.01, 0))])  # fmt: skip
    made.add("tray", ("brass", tray.moved((x - 0.02, y, z + 0.10))))
    made.add("teapot", ("red glaze", ve.teapot(d).moved((x - 0.05, y + 0.0085, z + 0.08), yaw_deg=-35.0)))
    for k, (a, b) in enumerate(((0.085, 0.155), (0.065, 0.02))):
        made.add(f"cup {k + 1}", ("white glaze", ve.bowl(0.034, 0.045, d * 0.55).moved((x + a, y + 0.0085, z + b))))
    covers = [
        rounded_box((0.26 - 0.02 * k, 0.022, 0.19), 0.003, steps=ve.cut(1, d, 0)).moved(
            (0, 0.0115 + 0.0225 * k, 0), yaw_deg=11.0 * k
        )
        for k in range(3)
    ]
    tones = ((0.55, 0.12, 0.06), (0.08, 0.18, 0.25), (0.65, 0.55, 0.35))
    made.add(
        "magazines",
        (
            "book",
            merge([c.tinted(np.array(t)) for c, t in zip(covers, tones)]).moved((x + 0.12, y, z - 0.19), yaw_deg=8.0),
        ),
    )


def _dining(made: Assembly, d: float) -> None:
    x, z = 2.42, 0.95
    made.add(
        "dining table",
        {m: p.moved((x, 0, z)) for m, p in fu.table(0.95, 0.85, 0.74, d, top="light wood", legs="light wood").items()},
    )
    made.add("kettle", ("chrome", ve.kettle(d).moved((x + 0.05, 0.7405, z - 0.16), yaw_deg=145.0)))
    made.add("salad bowl", ("green glaze", ve.bowl(0.13, 0.08, d).moved((x - 0.2, 0.7405, z + 0.14))))
    made.add("copper jug", ("copper", ve.vase("urn", d, 0.42).moved((x + 0.3, 0.7405, z + 0.12))))


def _storage(made: Assembly, rng: np.random.Generator, d: float) -> None:
    books = int(np.clip(round(190 * d), 18, 900))
    made.add(
        "bookshelf", {m: p.moved((2.42, 0, -Z + 0.172)) for m, p in fu.bookshelf(rng, 1.35, 2.05, 5, books).items()}
    )
    made.add("slim vase", ("white glaze", ve.vase("slim", d, 0.72).moved((2.05, 2.0505, -Z + 0.17))))
    made.add("globe", ("brass", sphere(0.10, ve.cut(64, d, 4)).moved((2.75, 2.1505, -Z + 0.17))))
    board = [fu.block((2.72, 0.1, -1.55), (3.17, 0.56, 0.05), 0.012, d)]
    board += [box((2.705, 0.13, -1.53 + 0.525 * k), (2.7215, 0.53, -1.53 + 0.525 * k + 0.51)) for k in range(3)]
    feet = [cylinder(0.018, 0.0, 0.11, ve.cut(16, d, 3)).moved((a, 0, b)) for a in (2.78, 3.1) for b in (-1.48, -0.02)]
    made.add("sideboard", {"dark wood": merge(board), "light wood": merge(feet)})
    for k in range(3):
        path = np.linspace((2.69, 0.45, -1.375 + 0.525 * k), (2.69, 0.45, -1.175 + 0.525 * k), ve.cut(10, d, 3))
        rod = [tube(path, 0.006, ve.cut(18, d, 3))]
        rod += [
            tube(np.linspace((2.69, 0.45, v), (2.71, 0.45, v), 3), 0.004, ve.cut(12, d, 3))
            for v in (path[0, 2] + 0.03, path[-1, 2] - 0.03)
        ]
        made.add(f"sideboard handle {k + 1}", ("brass", merge(rod)))
    screen = frame(1.14, 0.66, 0.012, 0.03).moved((2.97, 0.97, -0.75), yaw_deg=-90.0)
    made.add(
        "television",
        {
            "frame": merge(
                [screen, box((2.90, 0.565, -0.92), (3.05, 0.58, -0.58)), box((2.99, 0.575, -0.78), (3.02, 0.66, -0.72))]
            )
        },
    )
    made.add("television screen", ("screen", box((2.947, 0.648, -1.312), (2.969, 1.292, -0.188))))


def _walls(made: Assembly, rng: np.random.Generator, d: float) -> None:
    for name, w, h, x, y, canvas in (("sunset painting", 1.25, 0.78, -0.65, 1.62, "sunset"),):
        pieces = fu.picture(w, h)
        made.add(
            name,
            {"frame": pieces["frame"].moved((x, y, -Z + 0.001)), canvas: pieces["canvas"].moved((x, y, -Z + 0.001))},
        )
    for k, (y, z, canvas) in enumerate(((1.75, -2.05, "lake"), (1.75, 1.35, "abstract"))):
        pieces = fu.picture(0.46, 0.6)
        side = {m: p.moved((-X + 0.001, y, z), yaw_deg=90.0) for m, p in pieces.items()}
        made.add(f"picture frame {k + 1}", ("frame", side["frame"]))
        made.add(f"picture glass {k + 1}", (canvas, side["canvas"]))
    cells = ve.cut(12, d, 1)
    glass = rounded_box((0.62, 1.75, 0.014), 0.006, steps=ve.cut(3, d, 0), cells=cells)
    made.add("wall mirror", ("mirror", glass.moved((1.2, 1.12, -Z + 0.018))))
    made.add("mirror frame", ("brass", frame(0.70, 1.83, 0.05, 0.034).moved((1.2, 1.12, -Z + 0.001))))
    made.add(
        "round mirror",
        (
            "mirror",
            cylinder(0.36, 0.0, 0.012, ve.cut(96, d, 6), rows=1).transformed(
                tilt_matrix(90.0), (X - 0.004, 1.62, 1.25)
            ),
        ),
    )
    made.add(
        "round mirror rim",
        (
            "copper",
            torus(0.365, 0.016, ve.cut(110, d, 6), ve.cut(20, d, 3)).transformed(
                tilt_matrix(90.0), (X - 0.016, 1.62, 1.25)
            ),
        ),
    )
    made.add("door", {m: p.moved((0.9, 0, Z - 0.001), yaw_deg=180.0) for m, p in door(0.9, 2.05).items()})
    grip = merge([ve.handle(((0, 0, 0), (0, 0, -0.05), (0.03, 0, -0.06), (0.13, 0, -0.06)), 0.009, d),
                  cylinder(0.026, 0.0, 0.008, ve.cut(36, d, 4)).transformed(pitch_matrix(-90.0))])  # fmt: skip
    made.add("door handle", ("chrome", grip.moved((0.52, 1.03, Z - 0.041))))
    for name, z in (("left curtain", 1.02), ("right curtain", -1.52)):
        drape = fu.curtain(rng, 0.62, 2.42, 6, d).moved((-X + 0.13, 0.03, z), yaw_deg=90.0)
        made.add(name, ("curtain", drape))
    rail = tube(
        np.linspace((-X + 0.13, 2.475, 1.5), (-X + 0.13, 2.475, -2.0), ve.cut(30, d, 4)), 0.012, ve.cut(20, d, 3)
    )
    knobs = [sphere(0.024, ve.cut(28, d, 4)).moved((-X + 0.13, 2.475, z)) for z in (1.52, -2.02)]
    made.add("curtain rail", ("brass", merge([rail, *knobs])))


def _lamps(made: Assembly, rng: np.random.Generator, d: float) -> None:
    made.add("pendant lamp", ("copper", ve.dome(0.24, d).moved((-0.6, 1.86, -0.6))))
    cord = tube(np.linspace((-0.6, 2.09, -0.6), (-0.6, H + 0.01, -0.6), 3), 0.004, 6)
    made.add("pendant cord", ("frame", cord))
    made.add("floor lamp", ("chrome", ve.stand(1.42, 0.15, 0.011, d).moved((-2.5, 0, -2.2))))
    made.add("floor lamp shade", ("shade", ve.shade(0.22, 0.15, 0.3, d).moved((-2.5, 1.33, -2.2))))
    made.add("table lamp", ("blue glaze", ve.turned_base(0.26, 0.075, d).moved((2.93, 0.5605, -1.43))))
    made.add("table lamp shade", ("shade", ve.shade(0.15, 0.10, 0.2, d).moved((2.93, 0.80, -1.43))))
    for k, z in enumerate((0.28, 0.55)):
        made.add(
            f"candlestick {k + 1}",
            ("brass", ve.stand(0.2 - 0.05 * k, 0.05, 0.008, d).moved((-X + 0.05, WINDOW[0][1] + 0.0045, z))),
        )
    made.add("urn", ("green glaze", ve.vase("urn", d, 1.15).moved((2.86, 0, -1.92 - 0.02))))
    made.add("floor vase", ("white glaze", ve.vase("tall", d, 1.5).moved((0.72, 0, -2.42))))
    made.add(
        "plant pot",
        (
            "red glaze",
            ve.vessel(
                ((0.15, 0), (0.16, 0.02), (0.2, 0.25), (0.205, 0.33)), ve.cut(88, d, 6), ve.cut(24, d, 4), depth=0.3
            ).moved((-2.72, 0, 1.98)),
        ),
    )
    made.add("soil", ("soil", cylinder(0.19, 0.2, 0.285, ve.cut(32, d, 4)).moved((-2.72, 0, 1.98))))
    tall = fu.bush(rng, ve.cut(14, d, 4), ve.cut(26, d, 3), 1.15)
    made.add("house plant", {m: p.transformed(np.eye(3) * 1.25, (-2.72, 0.26, 1.98)) for m, p in tall.items()})
    made.add("sill pot", ("white glaze", ve.bowl(0.075, 0.11, d).moved((-X + 0.06, WINDOW[0][1] + 0.0045, -0.95))))
    made.add(
        "snake plant",
        (
            "leaf",
            fu.snake_plant(rng, ve.cut(16, d, 4)).transformed(
                np.eye(3) * 0.55, (-X + 0.06, WINDOW[0][1] + 0.09, -0.95)
            ),
        ),
    )


def _furnished(detail: float, materials: dict[str, Material], seed: int) -> Assembly:
    rng = np.random.default_rng((seed, 5))
    made = Assembly(materials)
    shell = Shell(half_x=X, half_z=Z, height=H, cell=float(np.clip(0.2 / detail, 0.04, 1.6)))
    shell.build(made, floor="parquet", ceiling="ceiling", walls=("accent wall", "plaster", "plaster"))
    shell.window_wall(made, "plaster", low=WINDOW[0], high=WINDOW[1], bars=2)
    made.add("skirting", ("white wood", skirting(shell, 0.09, 0.014)))
    _seating(made, detail)
    _dining(made, detail)
    for add in (_coffee_table, _storage, _walls, _lamps):
        add(made, rng, detail)
    return made


def living_room(triangles: int, seed: int) -> Scene:
    """Every curved surface gets finer with the count; the carpet's pile fills up what is left."""
    palette = living_room_palette(np.random.default_rng((seed, 7)))
    made, left = fitted(lambda detail: _furnished(detail, palette, seed), triangles, usual=FULL)
    w, depth, x, z = RUG
    tufts = fu.pile(np.random.default_rng((seed, 6)), w, depth, max(left // 4, 1), 0.011)
    made.add("carpet pile", ("rug", tufts.moved((x, 0.001, z))))
    cameras = {
        "default": view((1.75, 1.58, 2.52), (-0.35, 0.86, -1.2), 60.0, 0.05, 30.0),
        "close": view((0.35, 0.95, 0.5), (-0.62, 0.42, -0.75), 46.0, 0.03, 30.0),
        "sofa": view((-0.75, 1.12, -1.55), (1.5, 0.9, 0.6), 62.0, 0.05, 30.0),
        "mirror": view((0.25, 1.4, 0.75), (1.25, 1.05, -2.7), 50.0, 0.05, 30.0),
    }
    return made.scene("living_room", lights=_lights(), cameras=cameras, ambient=(0.2, 0.195, 0.185))


def _lights() -> list[Light]:
    (low_z, low_y), (high_z, high_y) = WINDOW
    return [
        RectLight(
            corner=as_tensor((-X + 0.02, low_y, low_z)), edge_u=as_tensor((0, high_y - low_y, 0)),
            edge_v=as_tensor((0, 0, high_z - low_z)), radiance=as_tensor((5.6, 6.1, 6.9)), name="window",
        ),
        PointLight(position=as_tensor((-0.6, 1.79, -0.6)), intensity=as_tensor((3.4, 2.8, 2.1)), name="pendant lamp"),
        PointLight(position=as_tensor((-2.5, 1.5, -2.2)), intensity=as_tensor((1.1, 0.78, 0.42)), name="floor lamp"),
        SpotLight(
            position=as_tensor((1.7, 2.62, 0.9)), direction=as_tensor((0.1, -1.0, 0.05)),
            intensity=as_tensor((3.2, 2.9, 2.4)), inner_deg=28.0, outer_deg=52.0, name="ceiling spot",
        ),
    ]  # fmt: skip
