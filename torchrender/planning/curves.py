"""Measured curves: what each setting of each pass costs, and how far its picture is from the reference.

They ship with the package; ``torchrender calibrate`` measures them again and keeps them for this user. A file that is
damaged or of another version is ignored with a warning.
"""

from __future__ import annotations

import json
import math
import os
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from importlib.resources import files
from pathlib import Path
from typing import Any

from torchrender.passes.senses import closely
from torchrender.pipeline.options import RenderOptions
from torchrender.planning.foresight import Expected, Joint, Line, parse_joint, parse_lines, together
from torchrender.scene.camera import Cameras
from torchrender.scene.model import Scene

FORMAT = 4
MAX_BYTES = 8 << 20
ENVIRONMENT = "TORCHRENDER_CURVES"

MEASURED_SPREAD = 0.1
"""Of the logarithm of an error in another view of a scene that was measured."""

UNKNOWN_SPREAD = 1.0
"""The same, where nothing is known but the mean of others."""

JOINT_SPREAD, UNTOLD_SPREAD = 0.08, 0.15
"""The same, of how errors of passes add up, where whole pictures of the scene were measured and where they were not."""

UNSEEN_SPREAD = 0.3
"""The same, in scenes that were not measured."""


MEASURED_SIDE = 512
"""Of the pictures that errors of scenes were measured in, where curves say nothing else."""

ALIKE = 2.0
"""So many times more or fewer pixels: outlines, borders of shadows and noise take another share of the picture then."""

AS_ADDED_UP = Joint()


class CurvesWarning(UserWarning):
    """A file of curves cannot be used; the shipped ones are."""


@dataclass(frozen=True, eq=False)
class Curves:
    """Weights of the amounts of work by pass and setting, and errors by scene, pass and setting."""

    weights: Mapping[str, Mapping[str, Sequence[float]]]
    scenes: Mapping[str, Mapping[str, Any]]
    norm: float  # exponent with which errors of several passes add up
    machine: Mapping[str, Any]
    source: str
    lines: Mapping[str, Mapping[str, Line]] = field(default_factory=dict)  # for scenes that are not among these
    fine: Joint = AS_ADDED_UP  # whole pictures of such scenes, beside what their passes add up to,
    coarse: Joint = AS_ADDED_UP  # and those with fewer rendered pixels than the picture has
    side: int = MEASURED_SIDE  # of pictures in which errors were measured

    def time_ms(self, name: str, setting: str, amounts: Sequence[float], scene: str | None = None) -> float | None:
        """Predicted time; None for what was never measured."""
        weights = self.weights.get(name, {}).get(setting)
        if weights is None:
            return None
        if len(weights) != len(amounts):
            raise ValueError(f"{name}, {setting}: {len(weights)} weights for {len(amounts)} amounts")
        usual = 0.0
        for weight, amount in zip(weights, amounts):
            usual += weight * amount
        own = self.scenes.get(scene or "")
        return usual if own is None else usual * float(own.get("ratios", {}).get(name, {}).get(setting, 1.0))

    def error(
        self,
        name: str,
        setting: str,
        scene: str | None = None,
        sensed: float | None = None,
        probed: float | None = None,
    ) -> Expected:
        """Mean FLIP between a picture with this setting and one with the pass's reference, all else equal.

        Of the scene itself if it was measured; else by what a probe found in an earlier picture of it, where errors of
        this setting follow that better, or by what the pass sensed there (:mod:`torchrender.planning.foresight`); else
        the mean of the scenes that the pass applied to.
        """
        own = self.record(name, setting, scene)
        if own is not None:
            return Expected(float(own["flip"]), MEASURED_SPREAD)
        closer = None if probed is None else self.lines.get(closely(name), {}).get(setting)
        if closer is not None:
            return closer.expected(probed)
        line = self.lines.get(name, {}).get(setting)
        if line is not None:
            return line.expected(sensed)
        found = [self.record(name, setting, known) for known in self.scenes]
        values = [float(record["flip"]) for record in found if record is not None]
        return Expected(sum(values) / len(values) if values else 0.0, UNKNOWN_SPREAD)

    def like_measured(self, cameras: Cameras) -> bool:
        """Errors of measured scenes hold for pictures of about that size."""
        return 1.0 / ALIKE <= cameras.width * cameras.height / self.side**2 <= ALIKE

    def record(self, name: str, setting: str, scene: str | None) -> Mapping[str, Any] | None:
        """What was measured; None if it was not."""
        found = self.scenes.get(scene or "", {}).get("passes", {}).get(name, {}).get(setting)
        return found if isinstance(found, dict) else None

    def joint(self, options: RenderOptions) -> Joint:
        """How pictures of scenes that were not measured lie about what their passes add up to."""
        return self.coarse.at(options.supersample) if options.supersample < 1.0 else self.fine

    def own_factor(self, scene: str) -> float:
        """What pictures of a scene that was measured err by, over what their passes add up to."""
        return float(self.scenes.get(scene, {}).get("joint", 1.0))

    def together(self, errors: Sequence[Expected], *, scene: str = "", unseen: RenderOptions | None = None) -> Expected:
        """The error of a picture whose passes have these.

        Args:
            scene: that was measured.
            unseen: options of the picture, of a scene that was not.
        """
        if unseen is None:
            told = "joint" in self.scenes.get(scene, {})
            found = together(errors, self.norm, JOINT_SPREAD if told else UNTOLD_SPREAD)
            return found._replace(error=min(found.error, 1.0))
        joint = self.joint(unseen)
        found = together(errors, self.norm, UNSEEN_SPREAD)
        return found._replace(error=min(found.error, 1.0), below=joint.below, above=joint.above)


def scene_key(scene: Scene) -> str:
    """Name under which curves know a scene: its own, and its number of triangles."""
    return f"{scene.name}/{scene.geometry.triangle_count}"


def user_file() -> Path:
    """Where ``torchrender calibrate`` keeps this user's curves: ``$TORCHRENDER_CURVES``, else the cache folder."""
    named = os.environ.get(ENVIRONMENT)
    if named:
        return Path(named)
    cache = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return Path(cache) / "torchrender" / "curves.json"


def load_curves() -> Curves:
    """This user's curves where there are good ones, else those of the package."""
    path = user_file()
    try:
        stamp = path.stat().st_mtime_ns
    except OSError:
        return shipped_curves()
    return _user_curves(path, stamp) or shipped_curves()


@lru_cache(maxsize=1)
def shipped_curves() -> Curves:
    """The curves that come with the package."""
    text = (files("torchrender") / "data" / "curves.json").read_text()
    return parse_curves(json.loads(text), "the package")


@lru_cache(maxsize=4)
def _user_curves(path: Path, stamp: int) -> Curves | None:
    del stamp  # a file that changes is read anew
    try:
        if path.stat().st_size > MAX_BYTES:
            raise ValueError(f"larger than {MAX_BYTES} bytes")
        return parse_curves(json.loads(path.read_text()), str(path))
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        reason = f"{type(error).__name__}: {error}"
        warnings.warn(f"{path}: curves ignored, those of the package are used ({reason})", CurvesWarning, stacklevel=3)
        return None


def parse_curves(data: Mapping[str, Any], source: str) -> Curves:
    """Curves out of a JSON object.

    Raises:
        ValueError: another format, or numbers that are not finite and positive.
    """
    if not isinstance(data, dict) or data.get("format") != FORMAT:
        raise ValueError(f"not curves of format {FORMAT}")
    for name, settings in data["weights"].items():
        for setting, weights in settings.items():
            if not all(isinstance(w, float | int) and math.isfinite(w) and w >= 0 for w in weights):
                raise ValueError(f"weights of {name}, {setting} must be finite and not negative")
    for scene, record in data["scenes"].items():
        if not 0.25 <= float(record.get("joint", 1.0)) <= 4.0:
            raise ValueError(f"joint of {scene} must be in [0.25, 4], got {record['joint']}")
        for name, settings in record["passes"].items():
            for setting, measured in settings.items():
                if not 0.0 <= float(measured["flip"]) <= 1.0:
                    raise ValueError(f"error of {scene}, {name}, {setting} must be in [0, 1]")
    norm = float(data["norm"])
    if not 0.5 <= norm <= 8.0:
        raise ValueError(f"norm must be in [0.5, 8], got {norm}")
    told = data.get("joint", {})
    fine, coarse = (parse_joint(told.get(name, []) if isinstance(told, dict) else told) for name in ("fine", "coarse"))
    lines, side = parse_lines(data.get("foresight", {})), int(data.get("side", MEASURED_SIDE))
    if side < 1:
        raise ValueError(f"side must be positive, got {side}")
    return Curves(data["weights"], data["scenes"], norm, data.get("machine", {}), source, lines, fine, coarse, side)
