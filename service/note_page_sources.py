"""Notes what the bundles of the page were made from, so that a test can tell when they are old."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path

STATIC = Path(__file__).parent / "torchrender_service" / "static"
NOTE = STATIC / "bundle" / "sources.json"


def sources() -> dict[str, str]:
    """Hash of every module of the page, by its path."""
    files = sorted(file for folder in ("js", "vendor") for file in (STATIC / folder).rglob("*.*js"))
    return {file.relative_to(STATIC).as_posix(): hashlib.sha256(file.read_bytes()).hexdigest() for file in files}


if __name__ == "__main__":
    NOTE.write_text(json.dumps(sources(), indent=1) + "\n")
