"""Point clouds from PLY files, and from meshes by sampling their surfaces."""

from __future__ import annotations

import math
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from torchrender.arrays import in_single_precision
from torchrender.checks import check_class, check_count
from torchrender.errors import InputError, MeshError, SceneFileError, SceneWarning, TorchRenderWarning
from torchrender.points.cloud import PointCloud
from torchrender.points.gaussians import covariances
from torchrender.scene.files.content import read_bytes
from torchrender.scene.files.gltf.container import GltfFile
from torchrender.scene.files.gltf.points import has_only_points, read_gltf_points
from torchrender.scene.files.plain.ply import declares_faces, read_ply
from torchrender.scene.files.plain.ply_format import MAX_HEADER, read_header
from torchrender.scene.files.report import LoadReport, Notes
from torchrender.scene.load import load
from torchrender.scene.model import Scene
from torchrender.voxels.coverage import surface_alpha, surface_colors

SAMPLES = 1_000_000
"""Points that a mesh is sampled by, if not told otherwise."""

GLTF = (".glb", ".gltf")

OPEN = 0.1
"""Share of its area that the area vectors of a closed surface may add up to: scanned meshes have small holes."""

COVER = 1.7
"""Radius of sampled points over the square root of the area that each stands for: random points leave few holes."""


SEEN = 1 / 512
HALF = 0.5
"""Of the opacity: what is less is not there; of holes: a point beyond is in one."""


MOST_NAMED = 3
"""Materials that a warning names."""


class SampledWarning(TorchRenderWarning):
    """A file of surfaces was given where points are wanted: points on them are taken."""


class LostEmissionWarning(SceneWarning):
    """Surfaces that emit light were sampled: points have a colour that is lit, and no light of their own."""


@in_single_precision
def load_points(
    path: str | Path, *, samples: int | None = None, seed: int = 0, drop_invalid: bool = False
) -> PointCloud:
    """A point cloud from a PLY or glTF file without faces, or ``samples`` points on the surfaces of anything else.

    PLY vertices may have normals (nx, ny, nz and other usual names), colours (red, green, blue and other usual names:
    integers are sRGB, floats linear, or sRGB where they reach 255), opacity (``alpha``) and radii (``radius``, in scene
    units); missing normals and radii are estimated. A file of 3D Gaussians gives ellipsoids. Other mesh and scene
    files, and the names of built-in scenes, are loaded as by :func:`torchrender.load` and sampled, which is said.

    Args:
        drop_invalid: leave points that are NaN or infinite out, in place of an error.

    Raises:
        SceneFileError: missing, damaged or unsupported file, one that is too large (:func:`pack_points` takes files of
            any size), or positions that are not finite.
        InputError: an unknown name; ``samples`` given for a file of points, or less than 1.
    """
    check_class("path", path, str, Path)
    source = Path(path)
    if holds_points(source):
        if samples is not None:
            raise InputError(f"samples is for meshes only, {source} holds points")
        return read_points(source, drop_invalid)[0]
    scene = load(path, drop_invalid=drop_invalid)
    count = SAMPLES if samples is None else check_count("samples", samples, 1, 2**31)
    if samples is None and source.suffix:
        warnings.warn(f"{source}: holds surfaces: sampled by {count:,} points", SampledWarning, stacklevel=2)
    return sample_points(scene, count, seed=seed)


def read_points(path: Path, drop_invalid: bool = False) -> tuple[PointCloud, LoadReport]:
    """The points of a file that :func:`holds_points`, and what was read of it. Errors as :func:`load_points`."""
    notes = Notes(path)
    read = _gltf_points if path.suffix.lower() in GLTF else _ply_points
    cloud = read(path, read_bytes(path), notes, drop_invalid)
    return cloud, notes.close()


def holds_points(path: str | Path) -> bool:
    """Whether a file is a PLY file without faces, or a glTF file whose primitives are all points."""
    source = Path(path)
    suffix = source.suffix.lower()
    if suffix not in (".ply", *GLTF) or not source.is_file():
        return False
    if suffix == ".ply":
        with source.open("rb") as file:
            start = file.read(MAX_HEADER)
        return not declares_faces(read_header(source, start, source.stat().st_size))
    return has_only_points(GltfFile(source, read_bytes(source)))


def _ply_points(path: Path, data: bytes, notes: Notes, drop: bool) -> PointCloud:
    model = read_ply(path, data, notes)
    gaussians = model.gaussians
    columns: dict[str, Any] = {
        "position": model.position,
        "normal": None if gaussians is not None else model.normals,
        "color": None if model.colors is None else model.colors[:, :3],
        "opacity": model.colors[:, 3] if model.colors is not None and model.colors.shape[1] == 4 else None,
        "radius": model.radius,
        "spread": None,
    }
    if gaussians is not None:
        notes.read("3D Gaussians", len(model.position))
        columns |= {"color": gaussians.color, "opacity": gaussians.opacity, "spread": covariances(gaussians)}
    return _cloud(path, columns, notes, drop)


def _gltf_points(path: Path, data: bytes, notes: Notes, drop: bool) -> PointCloud:
    columns: dict[str, Any] = {**read_gltf_points(path, data, notes), "radius": None, "spread": None}
    return _cloud(path, columns, notes, drop)


def _cloud(path: Path, columns: dict[str, Any], notes: Notes, drop: bool) -> PointCloud:
    position = columns["position"]
    wrong = ~np.isfinite(position).all(axis=1)
    if wrong.any() and not drop:
        reason = f"{int(wrong.sum())} of {len(position)} points are NaN or infinite, first {int(wrong.argmax())}"
        raise SceneFileError(path, f"{reason}; drop_invalid (--drop-invalid) leaves them out")
    if wrong.any():
        notes.repaired("points that are NaN or infinite: dropped", int(wrong.sum()))
        columns = {k: None if v is None else v[~wrong] for k, v in columns.items()}
    if not len(columns["position"]):
        raise SceneFileError(path, "holds no points")
    if columns["normal"] is not None:
        columns = {**columns, "normal": notes.known_normals(columns["normal"])}
    notes.read("points", len(columns["position"]))
    tensors: dict[str, Any] = {k: None if v is None else torch.from_numpy(np.array(v)) for k, v in columns.items()}
    return PointCloud(**tensors, name=path.stem).completed()


@in_single_precision
def sample_points(scene: Scene, count: int, *, seed: int = 0) -> PointCloud:
    """``count`` points spread evenly over all surfaces of a scene, with normals, colours and radii.

    Those that fall into holes of textures are left out, so that there may be less; surfaces that blend give their
    opacity, thin walls what they keep of the light behind them.

    A closed surface that is inside out is turned; an open one gives points that are drawn from both sides. Stratified
    along the triangles by area. Radius: 1.7 times the square root of the area per point. Colours are those
    of the material, texture and vertices, unlit. Points emit nothing: a :class:`LostEmissionWarning` names materials
    whose emission, or its texture, is lost.

    Raises:
        MeshError: a scene without surfaces.
        OptionError: ``count`` no whole number, or < 1.
    """
    check_count("count", count, 1, 2**31)
    geometry = scene.geometry
    corners = geometry.vertices[geometry.faces.long()]
    area = 0.5 * torch.linalg.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]).norm(dim=1)
    total = float(area.sum())
    if not total > 0:
        raise MeshError(f"scene {scene.name!r} has no surface to sample")
    sign, two_sided = _sides(corners, area)
    generator = torch.Generator().manual_seed(seed)
    place = (torch.arange(count, dtype=torch.float64) + torch.rand(count, generator=generator).double()) / count
    triangle = torch.searchsorted(area.cumsum(0), place * total).clamp_max(len(area) - 1)
    # Points of area zero at the end of the list are no place for a sample.
    triangle = triangle.clamp_max(int((area > 0).nonzero().max()))
    # Roberts' two-dimensional golden ratio: neighbours within a triangle keep apart, so that few discs leave no hole.
    steps = torch.arange(count, dtype=torch.float64)[None] * torch.tensor([[0.7548776662466927], [0.5698402909980532]])
    u, v = (steps + torch.rand(2, 1, generator=generator).double()) % 1.0
    root = u.sqrt()
    weights = torch.stack([1 - root, root * (1 - v), root * v], dim=1)
    spacing = math.sqrt(total / count)
    alpha = surface_alpha(scene, triangle, weights, 0.0)
    if alpha is not None:
        has_holes = torch.tensor([m.alpha_cutoff is not None for m in scene.materials])[geometry.material[triangle]]
        keep = alpha > torch.where(has_holes, HALF - 1e-9, SEEN)
        if not bool(keep.any()):
            raise MeshError(f"scene {scene.name!r} has no surface to sample: all of it is transparent")
        alpha = torch.where(has_holes, 1.0, alpha)[keep]
        triangle, weights = triangle[keep], weights[keep]
    _say_emission(scene, triangle)
    chosen = geometry.faces[triangle].long()
    return PointCloud(
        position=(weights[:, :, None] * corners[triangle]).sum(1),
        normal=sign * _normals(scene, triangle, chosen, weights),
        radius=torch.full((len(triangle),), COVER * spacing),
        color=surface_colors(scene, triangle, weights, spacing).float(),
        opacity=None if alpha is None or bool((alpha == 1.0).all()) else alpha.float(),
        two_sided=two_sided,
        name=scene.name,
    )


def _say_emission(scene: Scene, triangle: Tensor) -> None:
    """Name the materials of these triangles that emit light."""
    used = torch.unique(scene.geometry.material[triangle]).tolist()
    lost = [one for one in (scene.materials[number] for number in used) if bool((one.emission > 0).any())]
    if not lost:
        return
    named = [f"{one.name!r}{'' if one.emission_texture is None else ' (with its texture)'}" for one in lost]
    more = [f"{len(named) - MOST_NAMED} more"] if len(named) > MOST_NAMED else []
    text = ", ".join([*named[:MOST_NAMED], *more])
    told = f"{scene.name}: points have no light of their own: the emission of {text} is not used"
    warnings.warn(told, LostEmissionWarning, stacklevel=3)


def _sides(corners: Tensor, area: Tensor) -> tuple[float, bool]:
    """-1 if a closed surface is inside out, else 1; and whether it is open, so that both sides have to be drawn.

    The area vectors of a closed surface add up to nothing, and the volume below it tells where its outside is.
    """
    corners = corners - corners.reshape(-1, 3).mean(0)
    vector = 0.5 * torch.linalg.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    if float(vector.sum(0).norm()) > OPEN * float(area.sum()):
        return 1.0, True
    volume = float((vector * corners.mean(1)).sum())
    return (-1.0 if volume < 0 else 1.0), False


def _normals(scene: Scene, triangle: Tensor, chosen: Tensor, weights: Tensor) -> Tensor:
    """Shading normals; the triangle's own where there is none, and never on its other side."""
    geometry = scene.geometry
    flat = geometry.face_normals[triangle]
    if geometry.normals is None:
        return flat
    smooth = (weights[:, :, None].float() * geometry.normals[chosen]).sum(1)
    usable = (smooth.norm(dim=1) > 1e-6) & ((smooth * flat).sum(1) > 0)
    return torch.where(usable[:, None], smooth, flat)
