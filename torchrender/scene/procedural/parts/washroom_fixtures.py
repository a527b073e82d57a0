"""What stands and hangs in the washroom: vanity, towels, shelves, toilet, pipes and shower."""

from __future__ import annotations

import numpy as np

from torchrender.scene.procedural.parts import furniture as fu
from torchrender.scene.procedural.parts import vessels as ve
from torchrender.scene.procedural.parts.assembly import Assembly
from torchrender.scene.procedural.parts.curves import cylinder, lathe, sphere, spline, torus, tube
from torchrender.scene.procedural.parts.shapes import Part, box, frame, merge, pitch_matrix, rounded_box, tilt_matrix
from torchrender.scene.procedural.parts.tiling import X, Z

COUNTER = 0.80  # height of the vanity's counter, metres


def _basin(detail: float) -> Part:
    """An oval counter-top basin."""
    return ve.bowl(0.2, 0.13, detail).transformed(np.diag([1.2, 1.0, 0.92]))


def vanity(made: Assembly, rng: np.random.Generator, d: float) -> None:
    """Counter with two basins under two mirrors, along the back wall."""
    _cabinet(made, d)
    for name, x in (("left", -0.75), ("right", 0.25)):
        _basin_place(made, name, x, d)
    _counter_things(made, rng, d)


def _cabinet(made: Assembly, d: float) -> None:
    y = COUNTER
    made.add("counter", ("stone", fu.block((-1.25, y, -Z + 0.012), (0.75, y + 0.04, -Z + 0.54), 0.008, d)))
    body = [fu.block((-1.21, 0.26, -Z + 0.013), (0.71, y - 0.001, -Z + 0.50), 0.006, d)]
    body += [
        box((-1.2 + 0.4775 * k, 0.275, -Z + 0.49), (-1.2 + 0.4775 * k + 0.4675, y - 0.015, -Z + 0.515))
        for k in range(4)
    ]
    made.add("vanity", ("oak", merge(body)))
    for k in range(4):
        x = -1.2 + 0.4775 * k + (0.39 if k % 2 == 0 else 0.075)
        knob = ve.handle(
            ((x, 0.42, -Z + 0.515), (x, 0.42, -Z + 0.545), (x, 0.54, -Z + 0.545), (x, 0.54, -Z + 0.515)),
            0.006,
            d,
            rows=22,
            sides=12,
        )
        made.add(f"vanity handle {k + 1}", ("chrome", knob))


def _basin_place(made: Assembly, name: str, x: float, d: float) -> None:
    y = COUNTER
    made.add(f"{name} basin", ("porcelain", _basin(d).moved((x, y + 0.0405, -Z + 0.30))))
    made.add(f"{name} tap", ("chrome", ve.basin_tap(d).transformed(np.eye(3) * 1.15, (x, y + 0.0405, -Z + 0.075))))
    glass = rounded_box((0.74, 0.92, 0.012), 0.005, steps=ve.cut(3, d, 0), cells=ve.cut(10, d, 1))
    made.add(f"{name} mirror", ("mirror", glass.moved((x, 1.50, -Z + 0.026))))
    made.add(f"{name} mirror frame", ("oak", frame(0.80, 0.98, 0.04, 0.030).moved((x, 1.50, -Z + 0.0105))))
    lamp = lathe(
        np.concatenate(
            [spline(((0.0, -0.07), (0.052, -0.045), (0.068, 0.0), (0.05, 0.048), (0.0, 0.07)), ve.cut(26, d, 4))]
        ),
        ve.cut(36, d, 4),
    )
    made.add(f"{name} lamp", ("lamp", lamp.moved((x, 2.13, -Z + 0.12))))
    arm = ve.handle(
        ((x, 2.235, -Z + 0.008), (x, 2.245, -Z + 0.07), (x, 2.235, -Z + 0.12), (x, 2.185, -Z + 0.12)),
        0.009,
        d,
        rows=20,
        sides=14,
    )
    made.add(f"{name} lamp arm", ("chrome", arm))


def _counter_things(made: Assembly, rng: np.random.Generator, d: float) -> None:
    y = COUNTER
    for k, (x, h, material) in enumerate(((-0.28, 0.2, "amber"), (-0.20, 0.16, "green soap"), (-1.12, 0.22, "amber"))):
        made.add(
            f"bottle {k + 1}", (material, ve.bottle(h, 0.03, d).moved((x, y + 0.0405, -Z + 0.12 + 0.04 * (k == 1))))
        )
    made.add("soap dish", ("brass", ve.bowl(0.06, 0.025, d * 0.7).moved((-0.22, y + 0.0405, -Z + 0.33))))
    made.add(
        "soap",
        (
            "soap",
            rounded_box((0.07, 0.024, 0.045), 0.01, steps=ve.cut(4, d, 0)).moved(
                (-0.22, y + 0.064, -Z + 0.33), yaw_deg=25
            ),
        ),
    )
    made.add(
        "tumbler",
        (
            "chrome",
            ve.vessel(
                ((0.03, 0), (0.032, 0.01), (0.036, 0.06), (0.038, 0.1)),
                ve.cut(48, d, 4),
                ve.cut(14, d, 3),
                depth=0.9,
                wall=0.003,
            ).moved((0.62, y + 0.0405, -Z + 0.14)),
        ),
    )
    made.add(
        "pot",
        (
            "pot",
            ve.vessel(
                ((0.05, 0), (0.055, 0.01), (0.07, 0.09), (0.072, 0.1)), ve.cut(40, d, 4), ve.cut(12, d, 3), depth=0.3
            ).moved((-1.08, y + 0.0405, -Z + 0.33)),
        ),
    )
    made.add(
        "plant",
        ("leaf", fu.snake_plant(rng, ve.cut(18, d, 3)).transformed(np.eye(3) * 0.5, (-1.08, y + 0.1, -Z + 0.33))),
    )


def towels(made: Assembly, d: float) -> None:
    """Rail with towels on the left wall under the window."""
    path = spline(
        (
            (-X + 0.005, 1.06, -0.55),
            (-X + 0.085, 1.06, -0.55),
            (-X + 0.09, 1.06, -0.52),
            (-X + 0.09, 1.06, 0.62),
            (-X + 0.085, 1.06, 0.65),
            (-X + 0.005, 1.06, 0.65),
        ),
        ve.cut(60, d, 6),
    )
    made.add("towel rail", ("chrome", tube(path, 0.010, ve.cut(24, d, 4))))
    for k, (z, width, drop, material) in enumerate(
        ((-0.24, 0.42, 0.52, "terry white"), (0.30, 0.44, 0.60, "terry coral"))
    ):
        made.add(f"towel {k + 1}", (material, fu.towel(width, drop, d).moved((-X + 0.09, 1.06, z), yaw_deg=90.0)))


def shelves(made: Assembly, d: float) -> None:
    """Two glass shelves with rolled towels and flasks on the right wall."""
    board = rounded_box((0.24, 0.018, 0.9), 0.006, steps=ve.cut(2, d, 0), cells=ve.cut(4, d, 1))
    for k, y in enumerate((1.25, 1.62)):
        made.add(f"glass shelf {k + 1}", ("glass shelf", board.moved((X - 0.13, y, -0.42))))
        rods = [
            ve.handle(
                ((X - 0.004, y - 0.05, z), (X - 0.1, y - 0.045, z), (X - 0.2, y - 0.009, z)),
                0.006,
                d,
                rows=14,
                sides=10,
            )
            for z in (-0.78, -0.06)
        ]
        made.add(f"shelf bracket {k + 1}", ("chrome", merge(rods)))
    t = np.linspace(0.0, 4.5 * np.pi, ve.cut(60, d, 8))
    for k, (z, y, material) in enumerate(
        (
            (-0.72, 1.2595, "terry blue"),
            (-0.54, 1.2595, "terry white"),
            (-0.36, 1.2595, "terry blue"),
            (-0.45, 1.6295, "terry coral"),
        )
    ):
        r = 0.012 + 0.068 * t / t[-1]
        spiral = np.stack([np.zeros_like(t), r * np.sin(t), r * np.cos(t)], axis=1)
        roll = np.stack([spiral - np.array((0.1, 0, 0)), spiral + np.array((0.09, 0, 0))], axis=0)
        from_roll = fu.thick_sheet(np.linspace(roll[0], roll[1], ve.cut(6, d, 2)), 0.009)
        made.add(f"rolled towel {k + 1}", (material, from_roll.moved((X - 0.14, y + 0.0915, z))))
    for k, z in enumerate((-0.75, -0.66, -0.15)):
        made.add(
            f"flask {k + 1}",
            ("green soap" if k else "amber", ve.bottle(0.17 + 0.03 * k, 0.03, d).moved((X - 0.13, 1.6295, z))),
        )


def toilet(made: Assembly, d: float) -> None:
    """Toilet at the right wall."""
    x, z = X - 0.38, 0.66
    bowl = ve.vessel(
        ((0.12, 0.0), (0.13, 0.03), (0.115, 0.15), (0.18, 0.33), (0.2, 0.40)),
        ve.cut(72, d, 6),
        ve.cut(30, d, 4),
        depth=0.45,
        wall=0.025,
    )
    made.add("toilet", ("porcelain", merge([
        bowl.transformed(np.diag([1.28, 1.0, 0.95]), (x - 0.06, 0.004, z)),
        rounded_box((0.19, 0.36, 0.40), 0.03, steps=ve.cut(4, d, 0)).moved((X - 0.11, 0.60, z)),
        rounded_box((0.20, 0.42, 0.22), 0.03, steps=ve.cut(4, d, 0)).moved((X - 0.12, 0.22, z)),
    ])))  # fmt: skip
    seat = torus(0.165, 0.034, ve.cut(72, d, 6), ve.cut(16, d, 3)).transformed(
        np.diag([1.28, 0.42, 1.0]), (x - 0.06, 0.418, z)
    )
    made.add("toilet seat", ("oak", seat))
    made.add(
        "flush button",
        ("chrome", cylinder(0.03, 0.0, 0.012, ve.cut(32, d, 4), bevel=0.003).moved((X - 0.11, 0.775, z))),
    )


def paper_and_bin(made: Assembly, d: float) -> None:
    """Paper on its holder, and a bin, beside the toilet."""
    hanger = ve.handle(
        ((X - 0.002, 0.78, 0.25), (X - 0.07, 0.78, 0.25), (X - 0.075, 0.78, 0.27), (X - 0.075, 0.78, 0.40)),
        0.007,
        d,
        rows=22,
        sides=12,
    )
    made.add("paper holder", ("chrome", hanger))
    paper = lathe(
        np.array(
            [
                (0.022, -0.05),
                (0.055, -0.05),
                (0.055, -0.05),
                (0.055, 0.05),
                (0.055, 0.05),
                (0.022, 0.05),
                (0.022, 0.05),
                (0.022, -0.05),
            ]
        ),
        ve.cut(40, d, 4),
    )
    made.add("paper", ("terry white", paper.transformed(pitch_matrix(90.0), (X - 0.075, 0.767, 0.335))))
    made.add(
        "bin",
        (
            "chrome",
            ve.vessel(
                ((0.10, 0.0), (0.105, 0.01), (0.115, 0.25), (0.118, 0.28)),
                ve.cut(64, d, 4),
                ve.cut(20, d, 4),
                depth=0.9,
            ).moved((X - 0.3, 0.0045, 0.22)),
        ),
    )


def pipes(made: Assembly, d: float) -> None:
    """Hot and cold water along the right wall."""
    path = spline(
        (
            (X - 0.06, 0.02, 1.05),
            (X - 0.06, 0.9, 1.05),
            (X - 0.06, 1.5, 1.05),
            (X - 0.06, 2.2, 1.05),
            (X - 0.06, 2.35, 1.05),
            (X - 0.06, 2.42, 0.95),
            (X - 0.06, 2.42, 0.6),
            (X - 0.06, 2.42, -Z - 0.05),
        ),
        ve.cut(70, d, 4),
    )
    made.add("hot pipe", ("brass", tube(path, 0.018, ve.cut(22, d, 4))))
    made.add("cold pipe", ("chrome", tube(path + np.array((0, -0.02, 0.055)), 0.014, ve.cut(22, d, 4))))


def shower(made: Assembly, d: float) -> None:
    """Shower pipe with head and mixer on the back wall, in the right corner."""
    x = 1.22
    pipe = spline(
        (
            (x, 1.0, -Z + 0.05),
            (x, 1.5, -Z + 0.05),
            (x, 2.05, -Z + 0.05),
            (x, 2.2, -Z + 0.09),
            (x, 2.24, -Z + 0.2),
            (x, 2.22, -Z + 0.4),
        ),
        ve.cut(60, d, 4),
    )
    head = lathe(
        np.array(
            [
                (0.0, -0.012),
                (0.11, -0.012),
                (0.11, -0.012),
                (0.115, -0.006),
                (0.11, 0.0),
                (0.05, 0.012),
                (0.016, 0.03),
                (0.0, 0.03),
            ]
        ),
        ve.cut(64, d, 4),
    )
    made.add("shower", ("chrome", merge([tube(pipe, 0.011, ve.cut(24, d, 4)), head.moved((x, 2.19, -Z + 0.41))])))
    mixer = [
        cylinder(0.022, -0.11, 0.11, ve.cut(40, d, 4), bevel=0.005, rows=3).transformed(
            tilt_matrix(90.0), (x, 1.0, -Z + 0.06)
        )
    ]
    mixer += [sphere((0.022, 0.03, 0.03), ve.cut(32, d, 4)).moved((x + s * 0.125, 1.0, -Z + 0.06)) for s in (-1, 1)]
    made.add("shower mixer", ("chrome", merge(mixer)))
    tray = [
        box((0.80, 0.0, -Z + 0.005), (0.86, 0.09, -0.62)),
        box((0.80, 0.0, -0.68), (X - 0.005, 0.089, -0.621)),
        box((0.85, 0.0, -Z + 0.0055), (X - 0.0055, 0.05, -0.65)),
    ]
    made.add("shower tray", ("porcelain", merge(tray)))
    drain = merge(
        [torus(0.04, 0.006, ve.cut(36, d, 4), ve.cut(10, d, 4)), cylinder(0.036, -0.004, 0.004, ve.cut(28, d, 4))]
    )
    made.add("drain", ("chrome", drain.moved((1.25, 0.0525, -1.05))))
