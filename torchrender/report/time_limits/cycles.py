"""Blender Cycles with its time limit, in a process of its own: ``python -m torchrender.report.time_limits.cycles JOB``.

The job is that of :mod:`torchrender.report.time_limits.mitsuba`. Not imported by the rest of the package; the package
``bpy`` exists for few versions of Python.
"""

from __future__ import annotations

import json
import math
import sys
import time
from pathlib import Path
from typing import Any


def main(job: dict[str, Any]) -> None:
    """Render the scene of the job once per limit and run."""
    import bpy

    folder = Path(job["folder"])
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    _fill(bpy, scene, json.loads((folder / "scene.json").read_text()), folder)
    _settings(scene, job["threads"])
    times: dict[str, list[float]] = {}
    _render(bpy, scene, 1, 0.0, str(folder / "warm.exr"))  # loads kernels
    for name, seconds, samples, runs in job["tasks"]:
        path = str(folder / f"{job['label']}-{name}.exr")
        times[name] = [_render(bpy, scene, samples, seconds, path) for _ in range(runs)]
        Path(job["result"]).write_text(json.dumps({"version": bpy.app.version_string, "ms": times}))


def _render(bpy: Any, scene: Any, samples: int, seconds: float, path: str) -> float:
    """Milliseconds of a picture, writing of the file left out as far as Blender lets one."""
    scene.cycles.samples = samples
    scene.cycles.time_limit = seconds
    begin = time.perf_counter()
    bpy.ops.render.render(write_still=False)
    ms = 1e3 * (time.perf_counter() - begin)
    bpy.data.images["Render Result"].save_render(path, scene=scene)
    return ms


def _settings(scene: Any, threads: int) -> None:
    scene.render.engine = "CYCLES"
    scene.cycles.device = "CPU"
    scene.cycles.use_adaptive_sampling = False
    scene.cycles.use_denoising = False
    scene.cycles.max_bounces = 6
    scene.render.threads_mode = "FIXED"
    scene.render.threads = threads
    scene.render.image_settings.file_format = "OPEN_EXR"
    scene.render.image_settings.color_mode = "RGBA"
    scene.render.image_settings.color_depth = "32"


def _fill(bpy: Any, scene: Any, record: dict[str, Any], folder: Path) -> None:
    from mathutils import Matrix

    for mesh in record["meshes"]:
        bpy.ops.wm.ply_import(filepath=str(folder / mesh["file"]), forward_axis="Y", up_axis="Z")
        made = bpy.context.selected_objects[0]
        material = bpy.data.materials.new(mesh["file"])
        material.use_nodes = True
        nodes, links = material.node_tree.nodes, material.node_tree.links
        nodes.clear()
        surface, output = nodes.new("ShaderNodeBsdfDiffuse"), nodes.new("ShaderNodeOutputMaterial")
        surface.inputs["Color"].default_value = (*mesh["color"], 1.0)
        links.new(surface.outputs[0], output.inputs["Surface"])
        made.data.materials.clear()
        made.data.materials.append(material)
    for number, light in enumerate(record["lights"]):
        _add_light(bpy, scene, light, f"light{number}")
    world = bpy.data.worlds.new("surroundings")
    world.use_nodes = True
    world.node_tree.nodes["Background"].inputs["Color"].default_value = (*record["surroundings"], 1.0)
    scene.world = world
    camera = bpy.data.cameras.new("camera")
    camera.sensor_fit = "VERTICAL"
    camera.angle = math.radians(record["fov_deg"])
    camera.clip_start = 0.01
    seen = bpy.data.objects.new("camera", camera)
    # Blender's cameras look along -z, y up.
    seen.matrix_world = Matrix(record["world_from_camera"]) @ Matrix.Diagonal((1.0, -1.0, -1.0, 1.0))
    scene.collection.objects.link(seen)
    scene.camera = seen
    scene.render.resolution_x, scene.render.resolution_y = record["size"]
    scene.render.resolution_percentage = 100


def _add_light(bpy: Any, scene: Any, light: dict[str, Any], name: str) -> None:
    """Blender's lights have a power; colours carry the rest."""
    from mathutils import Vector

    kind = {"rectangle": "AREA", "point": "POINT", "spot": "SPOT", "directional": "SUN"}[light["kind"]]
    made = bpy.data.lights.new(name, kind)
    placed = bpy.data.objects.new(name, made)
    color: list[float] = next(light[part] for part in ("radiance", "intensity", "irradiance") if part in light)
    most = max(color)
    made.color = [c / most for c in color]
    if kind == "AREA":
        corner, u, v = (Vector(light[part]) for part in ("corner", "edge_u", "edge_v"))
        made.shape, made.size, made.size_y = "RECTANGLE", u.length, v.length
        made.energy = most * math.pi * u.length * v.length
        toward = u.cross(v).normalized()
        placed.matrix_world = _axes(u.normalized(), -v.normalized(), -toward, corner + (u + v) / 2)
    elif kind == "SUN":
        made.energy = most
        placed.rotation_euler = Vector(light["direction"]).to_track_quat("-Z", "Y").to_euler()
    else:
        made.energy = most * 4.0 * math.pi * math.pi
        made.shadow_soft_size = 0.0
        placed.location = light["position"]
        if kind == "SPOT":
            made.spot_size = 2.0 * math.radians(light["outer_deg"])
            placed.rotation_euler = Vector(light["direction"]).to_track_quat("-Z", "Y").to_euler()
    scene.collection.objects.link(placed)


def _axes(x: Any, y: Any, z: Any, place: Any) -> Any:
    from mathutils import Matrix

    matrix = Matrix.Identity(4)
    for column, axis in enumerate((x, y, z, place)):
        for row in range(3):
            matrix[row][column] = axis[row]
    return matrix


if __name__ == "__main__":
    main(json.loads(Path(sys.argv[1]).read_text()))
