"""Files that users sent in."""

from __future__ import annotations

from pathlib import Path

import pytest


@pytest.fixture(scope="module")
def cases(data_dir: Path) -> Path:
    folder = data_dir.parent / "cases" / "files"
    if not folder.is_dir():
        pytest.skip(f"no cases at {folder}")
    return folder
