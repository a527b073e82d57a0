"""Numbers that the thesis prints for non-redundant sampling: directions to confirm, not values to hit.

Its scenes are not available; the built-in ones have their size and character.
"""

from __future__ import annotations

# Table 2 (pixel) and table 5 (visibility), in percent, for images V0, V1, V2: conventional redundant; then for
# non-redundant images and for depth peeling: hidden, and useful among the hidden.
KINDS: dict[str, dict[str, dict[str, tuple[int, int, int]]]] = {
    "pixel": {
        "nest": {"C": (0, 70, 80), "N": (0, 62, 76), "Nu": (0, 89, 86), "P": (10, 46, 52), "Pu": (99, 2, 71)},
        "grass": {"C": (0, 54, 69), "N": (0, 56, 75), "Nu": (0, 85, 80), "P": (15, 51, 71), "Pu": (99, 4, 79)},
        "city": {"C": (0, 82, 84), "N": (0, 73, 80), "Nu": (0, 40, 23), "P": (1, 78, 88), "Pu": (100, 7, 8)},
        "tree": {"C": (0, 23, 35), "N": (0, 84, 88), "Nu": (0, 99, 98), "P": (44, 63, 72), "Pu": (99, 98, 97)},
    },
    "visibility": {
        "nest": {"C": (0, 80, 87), "N": (0, 55, 66), "Nu": (0, 66, 61), "P": (10, 39, 45), "Pu": (99, 38, 55)},
        "grass": {"C": (0, 58, 74), "N": (0, 48, 73), "Nu": (0, 80, 85), "P": (15, 48, 69), "Pu": (99, 81, 76)},
        "city": {"C": (0, 87, 87), "N": (0, 74, 80), "Nu": (0, 29, 9), "P": (1, 75, 88), "Pu": (100, 10, 6)},
        "tree": {"C": (0, 49, 67), "N": (0, 36, 54), "Nu": (0, 92, 96), "P": (44, 30, 45), "Pu": (99, 95, 94)},
    },
}

# Table 4 (pixel) and table 6 (visibility): available samples in percent, mean and minimum over the frames.
AVAILABLE: dict[str, dict[str, dict[str, tuple[float, float]]]] = {
    "pixel": {
        "nest": {"C": (90, 89), "N": (93, 92), "P": (92, 89)},
        "grass": {"C": (86, 81), "N": (96, 91), "P": (93, 88)},
        "city": {"C": (97, 96), "N": (98, 97), "P": (96, 91)},
        "tree": {"C": (55, 53), "N": (59, 57), "P": (55, 48)},
    },
    "visibility": {
        "nest": {"C": (95.25, 94.46), "N": (99.84, 99.73), "P": (99.50, 98.82)},
        "grass": {"C": (86.61, 83.61), "N": (99.72, 99.35), "P": (99.57, 98.15)},
        "city": {"C": (98.91, 97.64), "N": (99.82, 99.32), "P": (99.37, 94.23)},
        "tree": {"C": (85.36, 83.63), "N": (98.61, 97.78), "P": (97.65, 93.94)},
    },
}

# Table 7: milliseconds for three 1024 x 1024 images on a GeForce GTX 570.
TIMES: dict[str, dict[str, float]] = {
    "nest": {"C": 1.8, "N": 3.6, "P": 3.3},
    "grass": {"C": 1.7, "N": 3.0, "P": 3.2},
    "city": {"C": 1.6, "N": 3.3, "P": 2.7},
    "tree": {"C": 2.1, "N": 6.4, "P": 6.5},
}
