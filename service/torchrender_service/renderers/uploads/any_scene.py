"""A scene out of any file that is one: surfaces, or points as small solids."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import torch

from torchrender.points.load import holds_points, load_points
from torchrender.points.solids import MAX_POINTS, point_mesh
from torchrender.scene.files.report import LoadReport, Note
from torchrender.scene.load import load
from torchrender.scene.material import Material
from torchrender.scene.model import Scene


def load_any(path: Path) -> Scene:
    """The scene of a file. Errors as :func:`torchrender.load` and :func:`torchrender.load_points`."""
    if not holds_points(path):
        return load(path)
    cloud = replace(load_points(path), name=path.stem)
    count = len(cloud.position)
    step = -(-count // MAX_POINTS)
    left_out = count - len(range(0, count, step))
    report = LoadReport(
        source=str(path),
        read=(Note("points", count),),
        not_used=(Note(f"points: every {step}. is shown", left_out),) if left_out else (),
    )
    white = Material(name="points", diffuse=torch.ones(3))
    return Scene(meshes=(point_mesh(cloud),), materials=(white,), name=path.stem, report=report)
