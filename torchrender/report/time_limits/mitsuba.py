"""Mitsuba with its time limit, in a process of its own: ``python -m torchrender.report.time_limits.mitsuba JOB``.

``JOB`` is a JSON file written by :mod:`torchrender.report.time_limits.study`; pictures go beside it as EXR, times
into the file that it names. Not imported by the rest of the package.
"""

from __future__ import annotations

import json
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np


def main(job: dict[str, Any]) -> None:
    """Render the scene of the job once per limit and run."""
    import mitsuba as mi

    mi.set_variant(job["variant"])
    folder = Path(job["folder"])
    scene = mi.load_dict(_scene(mi, json.loads((folder / "scene.json").read_text()), folder))
    times: dict[str, list[float]] = {}
    _render(mi, scene, 1, 0.0)  # compiles what is compiled on first use
    for name, seconds, samples, runs in job["tasks"]:
        times[name] = []
        for _ in range(runs):
            begin = time.perf_counter()
            image = _render(mi, scene, samples, seconds)
            times[name].append(1e3 * (time.perf_counter() - begin))
        mi.Bitmap(np.array(image), mi.Bitmap.PixelFormat.RGBA).write(str(folder / f"{job['label']}-{name}.exr"))
        Path(job["result"]).write_text(json.dumps({"version": mi.__version__, "ms": times}))


def _render(mi: Any, scene: Any, samples: int, seconds: float) -> Any:
    integrator = mi.load_dict({"type": "path", "max_depth": 6, "timeout": seconds if seconds > 0 else -1.0})
    return np.array(mi.render(scene, integrator=integrator, spp=samples))


def _scene(mi: Any, record: dict[str, Any], folder: Path) -> dict[str, Any]:
    pose = np.array(record["world_from_camera"]) @ np.diag([-1.0, -1.0, 1.0, 1.0])  # x left, y up, z forward
    width, height = record["size"]
    film = {"type": "hdrfilm", "width": width, "height": height, "pixel_format": "rgba", "rfilter": {"type": "box"}}
    made: dict[str, Any] = {
        "type": "scene",
        "sensor": {
            "type": "perspective",
            "fov": record["fov_deg"],
            "fov_axis": "y",
            "to_world": mi.ScalarTransform4f(pose),
            "near_clip": 0.01,
            "film": film,
        },
        "surroundings": {"type": "constant", "radiance": {"type": "rgb", "value": record["surroundings"]}},
    }
    for number, mesh in enumerate(record["meshes"]):
        surface = {"type": "twosided", "inner": {"type": "diffuse", "reflectance": _rgb(mesh["color"])}}
        made[f"mesh{number}"] = {"type": "ply", "filename": str(folder / mesh["file"]), "bsdf": surface}
    for number, light in enumerate(record["lights"]):
        made[f"light{number}"] = _light(mi, light)
    return made


def _rgb(value: list[float]) -> dict[str, Any]:
    return {"type": "rgb", "value": value}


def _light(mi: Any, light: dict[str, Any]) -> dict[str, Any]:
    if light["kind"] == "rectangle":
        corner, u, v = (np.array(light[name]) for name in ("corner", "edge_u", "edge_v"))
        matrix = np.eye(4)
        matrix[:3, 0], matrix[:3, 1], matrix[:3, 2] = u / 2, v / 2, np.cross(u, v)
        matrix[:3, 3] = corner + (u + v) / 2
        emitter = {"type": "area", "radiance": _rgb(light["radiance"])}
        return {"type": "rectangle", "to_world": mi.ScalarTransform4f(matrix), "emitter": emitter}
    if light["kind"] == "spot":
        place = np.array(light["position"])
        look = mi.ScalarTransform4f().look_at(
            origin=place.tolist(), target=(place + light["direction"]).tolist(), up=[0.0, 0.0, 1.0]
        )
        return {
            "type": "spot",
            "to_world": look,
            "intensity": _rgb(light["intensity"]),
            "cutoff_angle": light["outer_deg"],
            "beam_width": light["inner_deg"],
        }
    if light["kind"] == "point":
        return {"type": "point", "position": light["position"], "intensity": _rgb(light["intensity"])}
    return {"type": "directional", "direction": light["direction"], "irradiance": _rgb(light["irradiance"])}


if __name__ == "__main__":
    main(json.loads(Path(sys.argv[1]).read_text()))
