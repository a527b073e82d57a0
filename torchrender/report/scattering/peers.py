"""Mitsuba's ``volpath`` beside ours, where it is installed: whether both mean the same, and errors at equal time."""

from __future__ import annotations

import importlib.util
import math
import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import torch
from torch import Tensor

from torchrender.arrays import view
from torchrender.report.scattering.scenes import eye, t1, t2
from torchrender.report.scattering.stage import SUN_STEPS, Stage, StudyOptions
from torchrender.scene.camera import Cameras
from torchrender.scene.light import DirectionalLight, Light, PointLight
from torchrender.scene.medium import Medium
from torchrender.scene.model import Scene

CASES: dict[str, tuple[Callable[[], Scene], dict[str, Any]]] = {
    "T1, lamp": (t1, {}),
    "T2, lamp over a grille, g = 0.6": (lambda: t2("lamp"), {"asymmetry": 0.6}),
    "T2, sun through windows": (lambda: t2("sun"), {}),
}
"""Scenes, and what of their homogeneous media is other than usual."""


FEW = 4
"""Samples up to which a picture of the path tracer is made twice, and the quicker counts."""


def beside_mitsuba(study: StudyOptions) -> dict[str, Any]:
    """Times and relative errors of one scattering in homogeneous media before black surfaces.

    The reference takes many steps along every ray of either light, with a shadow ray at each: neither slices nor
    light images have a part in it.
    """
    if importlib.util.find_spec("mitsuba") is None:
        return {"missing": "Mitsuba is not installed (`pip install mitsuba`): not compared"}
    import mitsuba as mi

    mi.set_variant("scalar_rgb")  # the other variants bring a compiler that does not get on with ours
    cases = [_case(mi, study, name, *how) for name, how in CASES.items()]
    return {"version": mi.__version__, "variant": mi.variant(), "size": study.small, "cases": cases}


def _case(mi: Any, study: StudyOptions, name: str, make: Callable[[], Scene], change: dict[str, Any]) -> dict[str, Any]:
    scene = make()
    scene = replace(scene, media=(replace(scene.media[0], **change),))
    camera = eye(*study.small)
    stage = Stage.of(scene, camera, study.map_size)
    finer = SUN_STEPS if isinstance(scene.lights[0], DirectionalLight) else 1
    rays = {"way": "march", "shadows": "rays", "block": 1, "steps": finer * study.rays_steps}
    wanted = torch.stack([stage.light(**rays, seed=s) for s in range(study.peer_seeds)]).mean(0)

    def ours() -> Tensor:
        """All that a picture needs but the tree of rays, which Mitsuba keeps, too."""
        return Stage.of(scene, camera, study.map_size, caster=stage.lit.caster).light()

    found, ms = _timed(ours, study.runs + 1)
    rows: list[dict[str, Any]] = [{"what": "slices, 2 x 2", "ms": ms, "rmse": _rmse(found.numpy(), wanted.numpy())}]
    world = mi.load_dict(_world(mi, camera, scene))
    image = np.zeros(1)
    for samples in study.peer_samples:
        image, took = _timed(partial(_traced, mi, world, samples), 2 if samples <= FEW else 1)
        rows.append({"what": f"volpath, {samples} samples", "ms": took, "rmse": _rmse(image, wanted.numpy())})
    # The same light: means of tiles, whose noise is far less than that of pixels.
    tiles = [_tiles(picture) for picture in (image, wanted.numpy())]
    return {
        "case": name,
        "rows": rows,
        "mean": float(image.mean() / wanted.numpy().mean()),
        "tiles": _rmse(*tiles),
        "at_our_time": rows[-1]["rmse"] * math.sqrt(rows[-1]["ms"] / ms),
    }


def _traced(mi: Any, world: Any, samples: int) -> np.ndarray:
    return np.array(mi.render(world, spp=samples, seed=2))[..., 0]


def _timed(work: Callable[[], Any], runs: int) -> tuple[Any, float]:
    """Result, and least milliseconds of ``runs`` runs."""
    least, made = math.inf, None
    for _ in range(runs):
        begin = time.perf_counter()
        made = work()
        least = min(least, 1e3 * (time.perf_counter() - begin))
    return made, least


def _rmse(found: np.ndarray, wanted: np.ndarray) -> float:
    return float(np.sqrt(np.mean((found - wanted) ** 2)) / wanted.mean())


def _tiles(picture: np.ndarray, across: int = 5) -> np.ndarray:
    """Means of ``across`` x ``across`` parts of a picture."""
    rows = np.array_split(picture, across, axis=0)
    return np.array([[part.mean() for part in np.array_split(row, across, axis=1)] for row in rows])


def _world(mi: Any, camera: Cameras, scene: Scene) -> dict[str, Any]:
    """The same triangles, light and medium; surfaces are black: what remains is scattered light."""
    air, light = scene.media[0], scene.lights[0]
    medium = _medium(air)
    move = mi.ScalarTransform4f
    half, middle = ((air.high - air.low) / 2).tolist(), ((air.high + air.low) / 2).tolist()
    fov = 2 * math.degrees(math.atan(camera.width / 2 / float(camera.intrinsics[0, 0, 0])))
    return {
        "type": "scene",
        "integrator": {"type": "volpath", "max_depth": 2, "rr_depth": 100},
        "sensor": {
            "type": "perspective", "fov": fov, "fov_axis": "x", "near_clip": 0.001,
            "to_world": move().look_at(origin=[0, 0, 0], target=[0, 0, -1], up=[0, 1, 0]),
            "film": {
                "type": "hdrfilm", "width": camera.width, "height": camera.height, "rfilter": {"type": "box"},
                "pixel_format": "rgb", "component_format": "float32",
            },
            "medium": medium,
        },
        "air": {
            "type": "cube", "to_world": move().translate(middle).scale(half), "bsdf": {"type": "null"},
            "interior": medium,
        },
        "lamp": _lamp(light, medium),
        "solids": _solids(mi, scene),
    }  # fmt: skip


def _lamp(light: Light, medium: dict[str, Any]) -> dict[str, Any]:
    if isinstance(light, DirectionalLight):
        power = {"type": "rgb", "value": light.irradiance.tolist()}
        return {"type": "directional", "direction": light.direction.tolist(), "irradiance": power}
    assert isinstance(light, PointLight)
    power = {"type": "rgb", "value": light.intensity.tolist()}
    return {"type": "point", "position": light.position.tolist(), "intensity": power, "medium": medium}


def _medium(air: Medium) -> dict[str, Any]:
    return {
        "type": "homogeneous", "albedo": float(air.scattering[0] / air.extinction[0]),
        "sigma_t": float(air.extinction[0]) * float(air.density), "phase": {"type": "hg", "g": air.asymmetry},
    }  # fmt: skip


def _solids(mi: Any, scene: Scene) -> Any:
    black = mi.load_dict({"type": "diffuse", "reflectance": {"type": "rgb", "value": 0.0}})
    properties = mi.Properties()
    properties["bsdf"] = black
    places, faces = view(scene.geometry.vertices, np.float32), view(scene.geometry.faces, np.uint32)
    mesh = mi.Mesh("solids", len(places), len(faces), properties)
    parameters = mi.traverse(mesh)
    parameters["vertex_positions"], parameters["faces"] = places.reshape(-1), faces.reshape(-1)
    parameters.update()
    return mesh
