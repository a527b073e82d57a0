"""Mitsuba's ``volpath`` on T1, where it is installed: error at about the time that our picture takes."""

from __future__ import annotations

import importlib.util
import math
import time
from dataclasses import replace
from typing import Any

import numpy as np

from torchrender.report.scattering.scenes import eye, t1
from torchrender.report.scattering.stage import Stage
from torchrender.scene.medium import Medium

SAMPLES = (1, 4, 16)


CASES: dict[str, dict[str, Any]] = {
    "T1": {},
    "T1, forward (g = 0.6)": {"asymmetry": 0.6},
    "T1, three times as dense": {"density": 3.0},
}


def beside_mitsuba(size: tuple[int, int]) -> dict[str, Any]:
    """Times and relative errors of a lamp's light in homogeneous media before black surfaces.

    The reference is a closed form, tested to 1e-4 against quadrature; single scattering in either program.
    """
    if importlib.util.find_spec("mitsuba") is None:
        return {"missing": "Mitsuba is not installed (`pip install mitsuba`): not compared"}
    import mitsuba as mi

    mi.set_variant("scalar_rgb")  # the other variants bring a compiler that does not get on with ours
    rows = [row for name, change in CASES.items() for row in _case(mi, size, name, change)]
    return {"version": mi.__version__, "variant": mi.variant(), "rows": rows}


def _case(mi: Any, size: tuple[int, int], name: str, change: dict[str, Any]) -> list[dict[str, Any]]:
    scene = t1()
    scene = replace(scene, media=(replace(scene.media[0], **change),))
    stage = Stage.of(scene, eye(*size), 1024)
    wanted = stage.light(way="walk", block=1, panels=64).numpy()
    stage.light()
    begin = time.perf_counter()
    found = stage.light()
    ms = 1e3 * (time.perf_counter() - begin)
    rows: list[dict[str, Any]] = [
        {"case": name, "what": "slices, 2 x 2", "ms": ms, "rmse": _rmse(found.numpy(), wanted)}
    ]
    world = mi.load_dict(_world(mi, size, scene.media[0]))
    for samples in SAMPLES:
        mi.render(world, spp=samples, seed=1)
        begin = time.perf_counter()
        image = np.array(mi.render(world, spp=samples, seed=2))[..., 0]
        took = 1e3 * (time.perf_counter() - begin)
        rows.append({"case": name, "what": f"volpath, {samples} samples", "ms": took, "rmse": _rmse(image, wanted)})
    scaled = rows[-1]["rmse"] * math.sqrt(rows[-1]["ms"] / ms)
    return [*rows, {"case": name, "what": "volpath at our time", "ms": ms, "rmse": scaled}]


def _rmse(found: np.ndarray, wanted: np.ndarray) -> float:
    return float(np.sqrt(np.mean((found - wanted) ** 2)) / wanted.mean())


def _world(mi: Any, size: tuple[int, int], air: Medium) -> dict[str, Any]:
    """T1 with black surfaces: what remains is scattered light."""
    black = {"type": "diffuse", "reflectance": {"type": "rgb", "value": 0.0}}
    thick = float(air.extinction[0]) * float(air.density)
    medium = {
        "type": "homogeneous", "albedo": float(air.scattering[0] / air.extinction[0]), "sigma_t": thick,
        "phase": {"type": "hg", "g": air.asymmetry},
    }  # fmt: skip
    fov = float(2 * np.degrees(np.arctan(0.5 / 0.9)))
    move = mi.ScalarTransform4f
    box = move().translate([0.0, 1.5, -3.75]).scale([4.8, 2.5, 4.25])
    made: dict[str, Any] = {
        "type": "scene",
        "integrator": {"type": "volpath", "max_depth": 2, "rr_depth": 100},
        "sensor": {
            "type": "perspective", "fov": fov, "fov_axis": "x", "near_clip": 0.001,
            "to_world": move().look_at(origin=[0, 0, 0], target=[0, 0, -1], up=[0, 1, 0]),
            "film": {"type": "hdrfilm", "width": size[0], "height": size[1], "rfilter": {"type": "box"}},
            "medium": medium,
        },
        "air": {"type": "cube", "to_world": box, "bsdf": {"type": "null"}, "interior": medium},
        "lamp": {"type": "point", "position": [1.0, 1.0, -4.5], "intensity": {"type": "rgb", "value": 3.0},
                 "medium": medium},
    }  # fmt: skip
    for name, centre, radius in (("a", [0.3, -0.3, -4.0], 0.7), ("b", [-1.2, -0.5, -5.0], 0.5)):
        made[name] = {"type": "sphere", "center": centre, "radius": radius, "bsdf": black}
    for name, centre, half in (("floor", [0, -1.05, -3.8], [5, 0.045, 4.4]), ("wall", [0, 1.5, -8.1], [5, 2.7, 0.099])):
        where = move().translate(centre).scale(half)
        made[name] = {"type": "cube", "to_world": where, "bsdf": black}
    return made
