"""Fog, smoke and shafts of light put into photographs, by marks or depth.

``FogPhoto(photo, marks).foggy(FogMedium.of(visibility=80))``.
"""

from torchrender.photo.fog.insert import FogPhoto, add_fog
from torchrender.photo.fog.marks.file import parse_marks, read_marks, write_marks
from torchrender.photo.fog.marks.records import Marks
from torchrender.photo.fog.options import FogMedium, FogOptions, FogWarning
from torchrender.photo.fog.picture import FogPicture

__all__ = [
    "FogMedium", "FogOptions", "FogPhoto", "FogPicture", "FogWarning", "Marks", "add_fog", "parse_marks", "read_marks",
    "write_marks",
]  # fmt: skip
