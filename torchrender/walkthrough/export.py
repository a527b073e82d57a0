"""Walkthroughs for other programs: planes with their textures as GLB, points as PLY and in this project's format."""

from __future__ import annotations

import io
import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import torch
import trimesh

from torchrender.errors import InputError, SceneFileError
from torchrender.images.files import write_atomically
from torchrender.points.file import write_points
from torchrender.points.tree import build_patches
from torchrender.scene.files.gltf.out.write import glb_bytes
from torchrender.scene.model import Scene
from torchrender.walkthrough.model import Walkthrough


def write_glb(path: str | Path, walkthrough: Walkthrough, *, points: bool = False) -> int:
    """Planes as textured meshes that every light leaves as the photos are (unlit), holes cut out by alpha; returns the
    bytes written.

    Args:
        points: the points, too, as squares with vertex colours.

    Raises:
        SceneFileError: another suffix, or the file cannot be written. InputError: nothing to write.
    """
    path = Path(path)
    if path.suffix.lower() != ".glb":
        raise SceneFileError(path, "planes are written to .glb")
    if not walkthrough.planes and not (points and len(walkthrough.points)):
        raise InputError("the walkthrough has no planes to write")
    scene = walkthrough.scene(points=points)
    # Photos hold their light already, and the format knows no ambient light, which is all that the scene has.
    shown = tuple(replace(material, unlit=True) for material in scene.materials)
    return _write_meshes(path, replace(scene, materials=shown))


def _write_meshes(path: Path, scene: Scene) -> int:
    """The meshes of a scene alone, without its light and cameras; returns the bytes written."""
    data = glb_bytes(replace(scene, ambient=torch.zeros(3), photo_light=False, cameras={}), path)

    def write(temporary: Path) -> None:
        temporary.write_bytes(data)

    write_atomically(path, write)
    return len(data)


def write_ply(path: str | Path, walkthrough: Walkthrough) -> int:
    """Points as binary PLY with normals, sRGB colours and radii; returns the bytes written.

    Raises:
        SceneFileError: another suffix, or the file cannot be written. InputError: there are no points.
    """
    path = Path(path)
    if path.suffix.lower() != ".ply":
        raise SceneFileError(path, "points are written to .ply")
    p = walkthrough.points
    if not len(p):
        raise InputError("the walkthrough has no points to write")
    names = ("x", "y", "z", "nx", "ny", "nz", "radius")
    kinds = [(n, "<f4") for n in names] + [(n, "u1") for n in ("red", "green", "blue")]
    rows = np.zeros(len(p), kinds)
    for k, name in enumerate(("x", "y", "z")):
        rows[name], rows["n" + name] = p.position[:, k], p.normal[:, k]
    rows["radius"] = 0.75 * p.footprint
    for k, name in enumerate(("red", "green", "blue")):
        rows[name] = p.color[:, k]
    head = ["ply", "format binary_little_endian 1.0", f"element vertex {len(p)}"]
    head += [f"property float {n}" for n in names] + [f"property uchar {n}" for n in ("red", "green", "blue")]
    out = io.BytesIO()
    out.write(("\n".join([*head, "end_header"]) + "\n").encode())
    out.write(rows.tobytes())

    def write(temporary: Path) -> None:
        temporary.write_bytes(out.getvalue())

    write_atomically(path, write)
    return len(out.getvalue())


def write_trp(path: str | Path, walkthrough: Walkthrough) -> int:
    """Points in this project's compressed format; returns the bytes written.

    Raises:
        PointFileError: the file cannot be written. InputError: there are no points.
    """
    return write_points(path, build_patches(walkthrough.cloud()))


def _write_squares(path: Path, walkthrough: Walkthrough) -> None:
    """Points as squares in a PLY mesh, whose vertex colours are sRGB: eight bits of linear light show steps in the
    dark."""
    square = walkthrough.point_mesh()
    made = trimesh.Trimesh(square.vertices.numpy(), square.faces.numpy(), process=False)
    made.visual = trimesh.visual.ColorVisuals(made, vertex_colors=np.repeat(walkthrough.points.color, 4, axis=0))
    data = made.export(file_type="ply")

    def write(temporary: Path) -> None:
        temporary.write_bytes(data)

    write_atomically(path, write)


def write_scene(folder: str | Path, walkthrough: Walkthrough, *, most_points: int = 300_000) -> Path:
    """The whole walkthrough as a scene file: planes as GLB, points as squares in a PLY mesh, the photos' cameras,
    ambient light 1.

    This is what goes wherever scenes go (the service and its clients). Returns the scene file.

    Args:
        most_points: of more points a random part is taken, each standing for more area.

    Raises:
        SceneFileError: the files cannot be written. InputError: nothing to write.
    """
    folder = Path(folder)
    p = walkthrough.points
    if len(p) > most_points:
        rows = np.sort(np.random.default_rng(0).choice(len(p), most_points, replace=False))
        less = np.float32(np.log(most_points / len(p)))
        fields = {n: getattr(p, n)[rows] for n in ("position", "normal", "color", "object_id")}
        thinner = replace(p, **fields, log_density=p.log_density[rows] + less)
        walkthrough = replace(walkthrough, points=thinner)
    lines = [f"name = {json.dumps(walkthrough.name)}", "ambient = 1.0", "photo_light = true"]
    if walkthrough.planes:
        # Lit by the ambient light of the scene file: lamps that are added to it light and shade them.
        _write_meshes(folder / "planes.glb", walkthrough.scene(points=False))
        lines += ["[[geometry]]", 'file = "planes.glb"']
    if len(walkthrough.points):
        _write_squares(folder / "points.ply", walkthrough)
        lines += ["[[material]]", 'name = "points"', "diffuse = 1.0"]
        lines += ["[[geometry]]", 'file = "points.ply"', 'material = "points"']
    cameras = walkthrough.cameras
    if cameras is not None and len(cameras):
        fov = 2 * math.degrees(math.atan(cameras.height / (2 * float(cameras.intrinsics[0, 1, 1]))))
        for n in range(0, len(cameras), max(len(cameras) // 8, 1)):
            eye, ahead = cameras.eye[n].tolist(), (cameras.eye[n] + cameras.forward[n]).tolist()
            up = (-cameras.world_from_camera[n, :3, 1]).tolist()
            lines += ["[[camera]]", f'name = "frame{n}"', f"eye = {eye}", f"target = {ahead}", f"up = {up}"]
            lines += [f"fov_deg = {min(max(fov, 1.0), 170.0)}", f"near = {float(cameras.near[n])}"]
            lines += [f"width = {cameras.width}", f"height = {cameras.height}"]
    text = "\n".join(lines) + "\n"

    def write(temporary: Path) -> None:
        temporary.write_text(text)

    write_atomically(folder / "scene.toml", write)
    return folder / "scene.toml"
