"""What a batch is to make: a scene by its source, cameras with names, and what is written of each.

A job is plain values and arrays, so that it travels to other processes and machines: they load the scene themselves.
"""

from __future__ import annotations

import hashlib
import json
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

from torchrender.checks import check_choice
from torchrender.errors import InputError, OptionError, RepairedWarning
from torchrender.pipeline.options import RenderOptions, shadow_choices
from torchrender.raster import OUTPUTS as ARRAYS
from torchrender.scene.camera import Cameras
from torchrender.scene.load import load
from torchrender.scene.model import Scene

KINDS = ("pictures", "depth", "film")
FORMATS = {"pictures": ("png", "exr", "npz"), "depth": ("npz",), "film": ("png",)}
OUTPUTS = ("depth", "normal", "object_id")
WISHES = ("reflections", "supersample", "tone_map", "exposure", "background", "shadows", "shadow_size", "cascades")
JOB, CAMERAS, MANIFEST = "job.json", "cameras.npz", "manifest.jsonl"
"""Files of a batch's folder beside its results."""
LONGEST = 200
"""Bytes of a name: file systems take 255, endings and temporary names included."""
FORBIDDEN = '/\\:*?"<>|'
DEVICES = ("CON", "PRN", "AUX", "NUL", *(f"{kind}{number}" for kind in ("COM", "LPT") for number in range(1, 10)))
"""Of Windows: no file there can be called so."""
CHUNK = 32
"""Cameras that one process makes in a row, and that one shard or one part of a film holds."""


@dataclass(frozen=True)
class SceneSource:
    """Where a scene comes from, as :func:`torchrender.load` takes it."""

    path_or_name: str
    choices: Mapping[str, Any] = field(default_factory=dict)  # size, time, animation, variant, subscene, drop_invalid

    def load(self) -> Scene:
        """The scene, read or built anew."""
        return load(self.path_or_name, **self.choices)


@dataclass(frozen=True, eq=False)
class Job:
    """What is to be made.

    Args:
        scene: where each process loads it from.
        cameras: B of one size, B >= 1.
        names: of the B pictures, as files will be called; default: their numbers.
        what: "pictures", "depth" (arrays of ``outputs``), or "film" (pictures that reuse reflections of the one before;
            every chunk begins with a key frame, so that chunks do not depend on each other).
        format: "png" (default of pictures and films), "exr" or "npz" (the only one of depth).
        shards: write one tar file for each chunk, as WebDataset reads them, in place of single files. It takes a
            member's name up to the first dot: dots of names become "_", which a warning says.
        outputs: attributes of :class:`~torchrender.buffers.GBuffer` that depth images hold.
        wishes: options of pictures: reflections, supersample, tone_map, exposure, background, shadows, shadow_size,
            cascades. Time limits are none of them: what they choose depends on the machine.
        chunk: cameras of a chunk.

    Raises:
        InputError: no camera, names that are not one for each camera, empty, repeated or no plain file names.
        OptionError: an unknown kind, format or wish, a chunk below 1, outputs of what has none.
    """

    scene: SceneSource
    cameras: Cameras
    names: tuple[str, ...] = ()
    what: str = "pictures"
    format: str = ""
    shards: bool = False
    outputs: tuple[str, ...] = OUTPUTS
    wishes: Mapping[str, Any] = field(default_factory=dict)
    chunk: int = CHUNK

    def __post_init__(self) -> None:
        check_choice("what", self.what, KINDS)
        object.__setattr__(self, "format", self.format or FORMATS[self.what][0])
        check_choice(f"format of {self.what}", self.format, FORMATS[self.what])
        if self.what == "film" and self.shards:
            raise OptionError("shards: a film is one file; give what='pictures' for shards")
        check_outputs(self.what, self.outputs)
        if self.chunk < 1:
            raise OptionError(f"chunk must be >= 1, got {self.chunk}")
        count = len(self.cameras)
        if count < 1:
            raise InputError("cameras: a batch needs at least one")
        names = tuple(self.names) or tuple(f"{number:06d}" for number in range(count))
        if len(names) != count:
            raise InputError(f"names: there must be one for each of {count} cameras, got {len(names)}")
        if self.shards:
            names = _undotted(names)
        object.__setattr__(self, "names", names)
        _check_names(names)
        if not self.shards:
            _check_files(names, self.format)
        self.options()

    @property
    def chunks(self) -> int:
        """How many there are."""
        return -(-len(self.cameras) // self.chunk)

    def rows(self, chunk: int) -> range:
        """Numbers of the cameras of a chunk."""
        return range(chunk * self.chunk, min((chunk + 1) * self.chunk, len(self.cameras)))

    def options(self) -> RenderOptions:
        """As :func:`torchrender.render` takes them."""
        return options_of(self.wishes)

    def described(self) -> dict[str, Any]:
        """All but the cameras as plain values."""
        told = {name: getattr(self, name) for name in ("what", "format", "shards", "outputs", "chunk")}
        return {"scene": asdict(self.scene), "wishes": dict(self.wishes), "names": list(self.names), **told}

    def key(self) -> str:
        """Digest of all that decides what is written, except what the scene's source holds."""
        digest = hashlib.sha256(json.dumps(self.described(), sort_keys=True).encode())
        cameras = self.cameras
        for values in (cameras.camera_from_world, cameras.intrinsics, cameras.near, cameras.far):
            digest.update(values.numpy().tobytes())
        digest.update(repr((cameras.width, cameras.height, cameras.orthographic)).encode())
        return digest.hexdigest()


def _check_files(names: tuple[str, ...], ending: str) -> None:
    for name in names:
        if f"{name}.{ending}".casefold() in (JOB, CAMERAS, MANIFEST):
            raise InputError(f"names: {name!r} would overwrite {name}.{ending}, which the folder of a batch needs")


def check_outputs(what: str, outputs: Sequence[str]) -> None:
    """Refuse arrays that depth images do not have, and arrays for anything else.

    Raises:
        OptionError: names them; or there is none.
    """
    if not outputs:
        raise OptionError(f"outputs must name at least one of {', '.join(ARRAYS)}")
    for name in outputs:
        check_choice("outputs", name, ARRAYS)
    if what != "depth" and tuple(outputs) != OUTPUTS:
        raise OptionError(f"outputs: they are arrays of what='depth', not of {what!r}")


def options_of(wishes: Mapping[str, Any]) -> RenderOptions:
    """Options of pictures by their wishes.

    Raises:
        OptionError: an unknown wish, or a value that it cannot have.
    """
    unknown = [name for name in wishes if name not in WISHES]
    if unknown:
        raise OptionError(f"wishes: unknown {unknown[0]!r}; known: {', '.join(WISHES)}")
    plain = {name: value for name, value in wishes.items() if not name.startswith("shadow") and name != "cascades"}
    return RenderOptions(
        **shadow_choices(wishes.get("shadows"), wishes.get("shadow_size"), wishes.get("cascades")), **plain
    )


def plain_name(name: str) -> bool:
    """Whether a file can be called so everywhere."""
    if not name or name[0] == "." or name[-1] in ". " or any(c in FORBIDDEN or c < " " for c in name):
        return False
    try:
        return len(name.encode()) <= LONGEST and name.partition(".")[0].upper() not in DEVICES
    except UnicodeEncodeError:  # half a character
        return False


def _undotted(names: tuple[str, ...]) -> tuple[str, ...]:
    """Names of samples of WebDataset."""
    dotted = [name for name in names if "." in name]
    if dotted:
        more = f" and {len(dotted) - 1} more" if len(dotted) > 1 else ""
        said = f"names: {dotted[0]!r}{more}: WebDataset takes names up to the first dot: '_' stands for dots in shards"
        warnings.warn(RepairedWarning(said), stacklevel=4)
    return tuple(name.replace(".", "_") for name in names)


def _check_names(names: tuple[str, ...]) -> None:
    seen: set[str] = set()
    for name in names:
        if not plain_name(name):
            raise InputError(f"names: {name!r} is no plain file name")
        if name.casefold() in seen:
            raise InputError(f"names: {name!r} is there twice")
        seen.add(name.casefold())
