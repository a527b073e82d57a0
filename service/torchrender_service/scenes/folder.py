"""The folder of a scene, as a server keeps it."""

from __future__ import annotations

import contextlib
import json
import os
from pathlib import Path
from typing import Any

from torchrender_service.errors import ServiceError

KINDS = {"glb": "scene.glb", "toml": "scene.toml", "zip": "scene.zip"}
LINK = "files"
"""In the folder of a scene that the service was started with: a link to where its file lies."""
UNFINISHED = ".unfinished-"
FACTS = "facts.json"
MAX_SHOWN = 80
"""Characters of a name in what an earlier server has kept."""


def read_facts(folder: Path) -> dict[str, Any] | None:
    try:
        facts = json.loads((folder / FACTS).read_text())
        facts = _cut(dict(facts))
        main = str(facts.get("main", ""))
        file = folder / (main if main.startswith(f"{LINK}/") else KINDS[facts["kind"]])
        whole = facts["id"] == folder.name and file.stat().st_size == facts["bytes"]
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        return None
    return facts if whole else None


def _cut(facts: dict[str, Any]) -> dict[str, Any]:
    """Without names and lists that are longer than clients are shown; earlier servers kept them whole."""
    cut = dict(facts) | {"name": str(facts["name"])[:MAX_SHOWN]}
    cut["cameras"] = [str(name)[:MAX_SHOWN] for name in facts.get("cameras", [])[:64]]
    if "animations" in facts:
        cut["animations"] = {str(name)[:MAX_SHOWN]: s for name, s in list(facts["animations"].items())[:64]}
    return cut


def finish(folder: Path, facts: dict[str, Any], target: Path) -> None:
    """Make sure that everything is on the disk, then give the folder its name."""
    (folder / FACTS).write_text(json.dumps(facts))
    for path in (*folder.rglob("*"), folder):
        handle = os.open(path, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)
    # Somebody else has uploaded the same meanwhile: both are the same scene.
    with contextlib.suppress(OSError):
        os.rename(folder, target)
    if not target.is_dir():
        raise ServiceError(503, "store", "the scene cannot be kept: the disk refuses", retry_after_s=10.0)
