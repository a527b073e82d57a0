"""Objects along paths: where a thing stands in each picture of a film.

A path file is TOML or JSON with an array ``pose`` of tables ``offset`` (three numbers, scene units from where the
object stands) and, if wanted, ``turn`` (degrees about its upright axis); ``ends = "closed"`` returns to the first pose.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import torch
from torch import Tensor

from torchrender.checks import as_array, check_finite, check_tensor
from torchrender.errors import InputError, SceneFileError
from torchrender.scene.cameras.spline import even_times, spline_at
from torchrender.scene.files.content import json_values, read_bytes
from torchrender.scene.files.toml_table import Table, parse_toml


@dataclass(frozen=True, eq=False, kw_only=True)
class ObjectPath:
    """K key poses of an object, joined by a Catmull-Rom spline at constant speed.

    Raises:
        InputError: fewer than two poses, wrong shapes, or values that are not finite.
    """

    offsets: Tensor  # (K,3) float64 scene units, from where the object stands
    turns_deg: Tensor  # (K,) about the y axis through the middle of its box
    closed: bool = False

    def __post_init__(self) -> None:
        for name in ("offsets", "turns_deg"):
            value = as_array(name, getattr(self, name)).double()
            object.__setattr__(self, name, check_finite(name, value))
        check_tensor("offsets", self.offsets, ("K", 3))
        check_tensor("turns_deg", self.turns_deg, (len(self.offsets),))
        if len(self.offsets) < 2:
            raise InputError(f"a path must have at least 2 poses, got {len(self.offsets)}")

    def matrices(self, frames: int, bounds: Tensor) -> Tensor:
        """(frames,4,4) float64 matrices for :meth:`torchrender.Scene.moved`, from where the object stands.

        Args:
            frames: at least one.
            bounds: (2,3) box of the object, about whose middle it turns.

        Raises:
            InputError: fewer than one frame.
        """
        if frames < 1:
            raise InputError(f"frames must be >= 1, got {frames}")
        time = even_times(self.offsets, frames, self.closed)
        offset = spline_at(self.offsets, time, self.closed)
        angle = torch.deg2rad(spline_at(self.turns_deg[:, None], time, self.closed)[:, 0])
        made = torch.eye(4, dtype=torch.float64).repeat(frames, 1, 1)
        made[:, 0, 0] = made[:, 2, 2] = angle.cos()
        made[:, 0, 2], made[:, 2, 0] = angle.sin(), -angle.sin()
        middle = bounds.double().mean(0)
        made[:, :3, 3] = middle + offset - made[:, :3, :3] @ middle
        return made


def straight(offset: list[float], turn_deg: float = 0.0) -> ObjectPath:
    """From where the object stands by ``offset`` (3,), turning on the way."""
    return ObjectPath(offsets=torch.tensor([[0.0, 0, 0], offset]), turns_deg=torch.tensor([0.0, turn_deg]))


def load_object_path(path: str | Path) -> ObjectPath:
    """The path in a TOML or JSON file.

    Raises:
        SceneFileError: the file or a key in it cannot be used; says which and why.
    """
    path = Path(path)
    data = read_bytes(path)
    if path.suffix.lower() == ".json":
        try:
            values = json_values(data)
        except ValueError as error:
            raise SceneFileError(path, f"not a JSON file ({error})") from error
        if not isinstance(values, dict):
            raise SceneFileError(path, "must hold a JSON object")
        table = Table(path, "", values)
    else:
        table = parse_toml(path, data)
    poses = table.tables("pose")
    ends = table.choice("ends", ("open", "closed"), "open")
    table.finish()
    rows = [(pose.vector("offset"), pose.number("turn", 0.0, -36000.0, 36000.0)) for pose in poses]
    for pose in poses:
        pose.finish()
    with table.reporting("pose"):
        if len(rows) < 2:
            raise InputError(f"a path must have at least 2 poses, got {len(rows)}")
        offsets, turns = zip(*rows, strict=True)
        return ObjectPath(offsets=torch.stack(offsets), turns_deg=torch.tensor(turns), closed=ends == "closed")
