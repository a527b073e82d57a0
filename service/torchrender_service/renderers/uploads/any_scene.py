"""A scene out of any file that is one: surfaces, or points as small discs."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import torch

from torchrender.points.cloud import PointCloud
from torchrender.points.load import holds_points, read_points
from torchrender.points.solids import MAX_POINTS, point_mesh
from torchrender.scene.files.report import LoadReport, Note
from torchrender.scene.load import load
from torchrender.scene.material import Material
from torchrender.scene.model import Scene


def load_any(path: Path) -> Scene:
    """The scene of a file. Errors as :func:`torchrender.load` and :func:`torchrender.load_points`."""
    if not holds_points(path):
        return load(path)
    cloud, report = read_points(path)
    white = Material(name="points", diffuse=torch.ones(3))
    report = report + LoadReport(not_used=_not_shown(cloud))
    mesh = point_mesh(replace(cloud, name=path.stem))
    return Scene(meshes=(mesh,), materials=(white,), name=path.stem, report=report)


def _not_shown(cloud: PointCloud) -> tuple[Note, ...]:
    """What triangles do not show of points."""
    count = len(cloud)
    step = -(-count // MAX_POINTS)
    left_out = count - len(range(0, count, step))
    found = {f"points: every {step}. is shown": left_out}
    if cloud.opacity is not None:
        found["opacity of points: opaque ones are shown"] = int((cloud.opacity < 1.0).sum())
    if cloud.spread is not None:
        found["shapes of 3D Gaussians: solids of their mean size are shown"] = count
    elif cloud.normal is not None:
        found["discs of points without a normal: small solids are shown"] = int((cloud.normal == 0).all(1).sum())
    return tuple(Note(what, number) for what, number in found.items() if number)
