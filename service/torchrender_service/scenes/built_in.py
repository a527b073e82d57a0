"""What clients are told about the built-in scenes, which are always the same: no renderer is asked, however busy.

``python -m torchrender_service.scenes.built_in`` writes the file again where a scene has changed.
"""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path
from typing import Any

FILE = Path(__file__).with_suffix(".json")


@cache
def built_in_facts() -> dict[str, dict[str, Any]]:
    """Facts by the name of the scene."""
    return dict(json.loads(FILE.read_text()))


def described() -> dict[str, dict[str, Any]]:
    """The same, found out from the scenes themselves; this loads the renderer and takes seconds."""
    from torchrender.scene.load import load
    from torchrender_service.renderers.scene_cache import describe
    from torchrender_service.settings import BUILT_IN

    return {name: describe(load(name)) for name in BUILT_IN}


if __name__ == "__main__":
    FILE.write_text(json.dumps(described(), indent=1) + "\n")
