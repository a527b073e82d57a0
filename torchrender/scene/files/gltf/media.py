"""Media in the ``extras`` of a glTF scene: the format has no place of its own for smoke and fog that fill a box."""

from __future__ import annotations

from typing import Any

from torchrender.errors import InputError, SceneFileError
from torchrender.scene.files.gltf.container import GltfFile, object_of
from torchrender.scene.medium import EXTRAS, Medium, medium_from_values

_NEEDED = {"low", "high"}


def read_media(file: GltfFile, number: int | None) -> tuple[Medium, ...]:
    """The media of scene ``number``, in world space.

    Extras are free for everybody: what has no boxes under that name is somebody else's, which is said.

    Raises:
        SceneFileError: a box with values that are none; names it.
    """
    scenes = file.entries("scenes")
    entry = object_of(scenes[number]) if number is not None and 0 <= number < len(scenes) else {}
    values: Any = object_of(entry.get("extras")).get(EXTRAS)
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
