"""Built-in procedural scenes: seeded, repeatable, and scalable to any triangle count up to three million.

======================  ==================  ===========  ================================================
name                    usual triangles     fewest       what it shows
======================  ==================  ===========  ================================================
``nest``                67,000              3,000        woven rods: thin, deep, many layers
``grass``               56,000              3,000        thin curved blades on rolling ground
``city``                50,000              2,000        boxes along streets, towers, a park
``tree``                113,000             3,000        recursive branches with leaves
``living_room``         280,000             10,000       closed interior, 25 and more reflecting objects
``washroom``            90,000              7,000        closed tiled interior, mirrors and chrome
``cornell_box``         96                  96           the classic box with an area light
``hall``                40,000              3,000        dust in the air, sun through barred windows
``street_lamp``         30,000              3,000        lamps in ground fog at night
``panes``               4,800               192          coloured glass, up to sixteen layers deep
``walker``              14,000              3,000        a figure that walks: moving, under a sky
======================  ==================  ===========  ================================================
"""

from __future__ import annotations

from dataclasses import dataclass
from importlib import import_module
from types import ModuleType

from torchrender.checks import is_whole
from torchrender.errors import InputError
from torchrender.scene.model import Scene

MAX_TRIANGLES = 3_000_000


@dataclass(frozen=True)
class Builder:
    """Makes one scene. Its module is imported when it is used: a picture needs one of them at most."""

    name: str

    @property
    def _module(self) -> ModuleType:
        return import_module(f"{__name__}.{self.name}")

    def make(self, triangles: int, seed: int) -> Scene:
        """The scene with about as many triangles."""
        made: Scene = getattr(self._module, self.name)(triangles, seed)
        return made

    @property
    def usual(self) -> int:
        """Triangles if no count is asked for."""
        return int(self._module.USUAL)

    @property
    def fewest(self) -> int:
        """Below this the scene would lose its character."""
        return int(self._module.FEWEST)


NAMES = (
    "nest",
    "grass",
    "city",
    "tree",
    "living_room",
    "washroom",
    "cornell_box",
    "hall",
    "street_lamp",
    "panes",
    "walker",
)
SCENES: dict[str, Builder] = {name: Builder(name) for name in NAMES}


def build(name: str, *, triangles: int | None = None, seed: int = 0) -> Scene:
    """The built-in scene ``name`` with about ``triangles`` triangles (within 10 %; None: its usual count).

    More triangles mean more content or finer surfaces. The same arguments always give the same tensors.

    Raises:
        InputError: unknown name, a count outside [fewest, 3,000,000], or a negative seed.
    """
    if name not in SCENES:
        raise InputError(f"unknown procedural scene {name!r}; known scenes: {', '.join(SCENES)}")
    builder = SCENES[name]
    count = builder.usual if triangles is None else triangles
    if not is_whole(count) or not builder.fewest <= count <= MAX_TRIANGLES:
        raise InputError(f"triangles of {name!r} must be in [{builder.fewest}, {MAX_TRIANGLES}], got {triangles!r}")
    if not is_whole(seed) or seed < 0:
        raise InputError(f"seed must be an integer >= 0, got {seed!r}")
    return builder.make(int(count), int(seed))
