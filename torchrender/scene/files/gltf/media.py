"""What glTF has no place of its own for, in the ``extras`` of a scene: smoke and fog in boxes, how light is meant."""

from __future__ import annotations

from typing import Any

from torchrender.errors import InputError, SceneFileError
from torchrender.scene.files.gltf.container import GltfFile, object_of
from torchrender.scene.medium import EXTRAS, Medium, medium_from_values

_NEEDED = {"low", "high"}
FLAGS = ("photometric", "photo_light")
"""Fields of a scene that are true or false, as its extras name them."""


def read_media(file: GltfFile, number: int | None) -> tuple[Medium, ...]:
    """The media of scene ``number``, in world space.

    Extras are free for everybody: what has no boxes under that name is somebody else's, which is said.

    Raises:
        SceneFileError: a box with values that are none; names it.
    """
    values: Any = _extras(file, number).get(EXTRAS)
    if values is None:
        return ()
    if not isinstance(values, list) or not all(object_of(v).keys() >= _NEEDED for v in values):
        file.notes.not_used(f"extras.{EXTRAS} of the scene, which are no boxes")
        return ()
    found = []
    for place, value in enumerate(values):
        try:
            found.append(medium_from_values(value))
        except InputError as error:
            raise SceneFileError(file.path, str(error), key=f"scenes[{number}].extras.{EXTRAS}[{place}]") from error
    return tuple(found)


def read_flags(file: GltfFile, number: int | None) -> dict[str, bool]:
    """Those of :data:`FLAGS` that the extras of scene ``number`` say; values that are no flags are somebody else's."""
    extras = _extras(file, number)
    found = {name: extras[name] for name in FLAGS if name in extras}
    for name, value in found.items():
        if not isinstance(value, bool):
            file.notes.not_used(f"extras.{name} of the scene, which is neither true nor false")
    return {name: value for name, value in found.items() if isinstance(value, bool)}


def _extras(file: GltfFile, number: int | None) -> dict[str, Any]:
    scenes = file.entries("scenes")
    entry = object_of(scenes[number]) if number is not None and 0 <= number < len(scenes) else {}
    return object_of(entry.get("extras"))
