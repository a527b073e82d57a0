"""Mitsuba on the same plane under the same sky: light that spheres or the mesh leave, in about our time.

Its camera looks straight down from just above the plane, so that every pixel sees one of the points; its integrator
``direct`` samples sky and cosine and weighs both (multiple importance sampling).
"""

from __future__ import annotations

import importlib.util
import tempfile
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np
import torch
from torch import Tensor

from torchrender.effects.sky_shadows.light import prepare_light
from torchrender.effects.sky_shadows.options import SkyLightOptions
from torchrender.effects.sky_shadows.shade import hidden_bits
from torchrender.quality.timing import take_turns
from torchrender.report.all_frequency.accuracy import CHECKED, OFFSET, shaded, unshadowed
from torchrender.report.all_frequency.stage import GAP, SIDE, Stage, errors
from torchrender.report.all_frequency.ways import mesh_bits, texel_sum
from torchrender.report.time_limits.scene import write_ply
from torchrender.scene.environment import Environment

NUMBER = 64
"""Spheres."""


def beside_mitsuba(at: Stage, skies: list[Environment], samples: int) -> dict[str, Any]:
    """Errors against a converged picture of Mitsuba, of ``samples`` per pixel, for mesh and spheres."""
    if importlib.util.find_spec("mitsuba") is None:
        return {"missing": "Mitsuba is not installed (`pip install mitsuba`): not compared"}
    import mitsuba as mi

    mi.set_variant("scalar_rgb")  # the other variants bring a compiler that does not get on with ours
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "model.ply"
        write_ply(file, at.model)
        rows = {one.name: _under(mi, at, one, file, samples) for one in skies}
    return {"version": mi.__version__, "variant": mi.variant(), "samples": samples, "skies": rows}


def _under(mi: Any, at: Stage, environment: Environment, file: Path, samples: int) -> dict[str, Any]:
    spheres = at.spheres[NUMBER]
    light = prepare_light(environment)
    whole = unshadowed(at.normals, light)
    ours = shaded(at.points, at.normals, spheres, light)
    ms = take_turns({"ours": lambda: shaded(at.points, at.normals, spheres, light)}, runs=5, warm_up=1)["ours"].least
    free = _outside(at, spheres)
    some = at.some(CHECKED)
    some = some[free[some]]
    points, normals = at.points[some], at.normals[some]
    bits = hidden_bits(points[None], normals[None], spheres[None], SkyLightOptions(direct_bits=True))[0]
    sums = {
        "spheres": texel_sum(bits, normals, light),
        "mesh": texel_sum(mesh_bits(at.caster, points, normals, OFFSET * at.size), normals, light),
    }
    made: dict[str, Any] = {"ms": ms, "free": float(free.double().mean())}
    for kind, summed in sums.items():
        world = mi.load_dict(_world(mi, at, environment, _balls(spheres) if kind == "spheres" else _mesh(file)))
        halves = [_picture(mi, world, samples // 2, seed) for seed in (1, 2)]
        wanted = (halves[0] + halves[1]) / 2
        made[kind] = {
            "noise": errors(halves[0][free], halves[1][free], whole)["rms"] / 2,
            "agree": errors(summed, wanted[some], whole)["rms"],
            "ours": errors(ours[free], wanted[free], whole)["rms"],
            "mitsuba": _at_our_time(mi, world, ms, (wanted, whole, free)),
        }
    return made


def _outside(at: Stage, spheres: Tensor) -> Tensor:
    """(P,) bool: no sphere reaches the point's pixel. Where spheres come through the plane, sides of it are hidden."""
    pixel = 2 * at.size / (SIDE - 1)
    away = (at.points[:, None] - spheres[None, :, :3].double()).norm(dim=-1)
    return (away > spheres[None, :, 3] + 0.75 * pixel).all(dim=1)


def _at_our_time(mi: Any, world: Any, ms: float, judged: tuple[Tensor, Tensor, Tensor]) -> dict[str, float]:
    """Samples that fit into our time, what they take and err by; and the error scaled to exactly our time."""
    wanted, whole, free = judged
    took = {}
    for samples in (1, 9):
        runs = []
        for seed in range(3):
            begin = perf_counter()
            _picture(mi, world, samples, seed)
            runs.append(1e3 * (perf_counter() - begin))
        took[samples] = min(runs)
    each = max((took[9] - took[1]) / 8, 1e-3)
    samples = max(1, int((ms - took[1]) / each) + 1)
    begin = perf_counter()
    image = _picture(mi, world, samples, 3)
    spent = 1e3 * (perf_counter() - begin)
    rms = errors(image[free], wanted[free], whole)["rms"]
    # A sample more or less: the error falls with the root of what comes after the picture's fixed part.
    fits = max((ms - (took[1] - each)) / each, 0.05)
    return {"samples": samples, "ms": spent, "rms": rms, "rms_at_our_time": rms * (samples / fits) ** 0.5}


def _picture(mi: Any, world: Any, samples: int, seed: int) -> Tensor:
    """(P,3) float64 radiance of the plane's points."""
    image = np.array(mi.render(world, spp=samples, seed=seed))
    return torch.from_numpy(image[..., :3].astype(np.float64)).reshape(-1, 3)


def _world(mi: Any, at: Stage, environment: Environment, blockers: dict[str, Any]) -> dict[str, Any]:
    move = mi.ScalarTransform4f
    x, y, z = at.middle.tolist()
    half, up = at.size * SIDE / (SIDE - 1), 1e-3 * GAP * at.size
    pose = move().look_at(origin=[x, y + up, z], target=[x, y + up - 1.0, z], up=[0.0, 0.0, -1.0])
    film = {
        "type": "hdrfilm", "width": SIDE, "height": SIDE, "pixel_format": "rgb", "component_format": "float32",
        "rfilter": {"type": "box"},
    }  # fmt: skip
    sensor = {
        "type": "orthographic", "to_world": pose @ move().scale([half, half, 1.0]), "near_clip": 0.01 * up,
        "far_clip": 10.0 * up, "film": film, "sampler": {"type": "independent"},
    }  # fmt: skip
    turned = move().translate([x, y, z]).rotate([1, 0, 0], -90).scale(2.0 * at.size)
    # Its azimuth begins where ours has the middle of the picture.
    picture = np.roll(environment.radiance.numpy().astype(np.float32), -(environment.radiance.shape[1] // 2), axis=1)
    return {
        "type": "scene",
        "integrator": {"type": "direct", "hide_emitters": False},
        "sensor": sensor,
        "sky": {"type": "envmap", "bitmap": mi.Bitmap(np.ascontiguousarray(picture)), "scale": environment.intensity},
        "floor": {"type": "rectangle", "to_world": turned, "bsdf": _matt(1.0)},
        **blockers,
    }


def _matt(share: float) -> dict[str, Any]:
    return {"type": "diffuse", "reflectance": {"type": "rgb", "value": share}}


def _mesh(file: Path) -> dict[str, Any]:
    return {"model": {"type": "ply", "filename": str(file), "bsdf": _matt(0.0)}}


def _balls(spheres: Tensor) -> dict[str, Any]:
    rows = [row for row in spheres.tolist() if row[3] > 0]
    return {
        f"ball{k}": {"type": "sphere", "center": row[:3], "radius": row[3], "bsdf": _matt(0.0)}
        for k, row in enumerate(rows)
    }
