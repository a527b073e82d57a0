"""Shared fixtures."""

from __future__ import annotations

import os
from pathlib import Path

# Before torch is imported: threads that spin while they wait take the cores from those that work.
os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")
# Curves that somebody measured on this machine must not change what is tested.
os.environ["TORCHRENDER_CURVES"] = os.devnull + "/none"

import pytest
from hypothesis import settings

# The same examples in every run: a change that breaks a law fails where it is made, and nowhere by chance.
settings.register_profile("repeatable", derandomize=True)
settings.load_profile("repeatable")

ROOT = Path(__file__).resolve().parent.parent


@pytest.fixture(scope="session")
def data_dir() -> Path:
    """Folder of real meshes, scenes and pictures; tests that need it skip where it is absent."""
    folder = Path(os.environ.get("TORCHRENDER_DATA", ROOT.parent / "shared" / "data"))
    if not folder.is_dir():
        pytest.skip(f"real test data not found at {folder}; set TORCHRENDER_DATA")
    return folder
