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
======================  ==================  ===========  ================================================
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from torchrender.errors import InputError
from torchrender.scene.model import Scene
from torchrender.scene.procedural import city as _city
from torchrender.scene.procedural import cornell_box as _cornell_box
from torchrender.scene.procedural import grass as _grass
from torchrender.scene.procedural import living_room as _living_room
from torchrender.scene.procedural import nest as _nest
from torchrender.scene.procedural import tree as _tree
from torchrender.scene.procedural import washroom as _washroom

MAX_TRIANGLES = 3_000_000


@dataclass(frozen=True)
class Builder:
    """Makes one scene; ``make(triangles, seed)``."""

    make: Callable[[int, int], Scene]
    usual: int  # triangles if no count is asked for
    fewest: int  # below this the scene would lose its character


SCENES: dict[str, Builder] = {
    "nest": Builder(_nest.nest, _nest.USUAL, _nest.FEWEST),
    "grass": Builder(_grass.grass, _grass.USUAL, _grass.FEWEST),
    "city": Builder(_city.city, _city.USUAL, _city.FEWEST),
    "tree": Builder(_tree.tree, _tree.USUAL, _tree.FEWEST),
    "living_room": Builder(_living_room.living_room, _living_room.USUAL, _living_room.FEWEST),
    "washroom": Builder(_washroom.washroom, _washroom.USUAL, _washroom.FEWEST),
    "cornell_box": Builder(_cornell_box.cornell_box, _cornell_box.USUAL, _cornell_box.FEWEST),
}


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
    if not isinstance(count, int) or not builder.fewest <= count <= MAX_TRIANGLES:
        raise InputError(f"triangles of {name!r} must be in [{builder.fewest}, {MAX_TRIANGLES}], got {triangles!r}")
    if not isinstance(seed, int) or seed < 0:
        raise InputError(f"seed must be an integer >= 0, got {seed!r}")
    return builder.make(count, seed)
