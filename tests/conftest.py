"""Shared fixtures."""

from __future__ import annotations

import gc
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

# Before torch is imported: threads that spin while they wait take the cores from those that work.
os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")
# Processes that share the tests have a core each: threads in them would only wait for one another, a third of the time.
if "PYTEST_XDIST_WORKER" in os.environ:
    os.environ.setdefault("OMP_NUM_THREADS", "1")
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


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Iterator[None]:
    """What is imported and collected stays to the end: no garbage is looked for there, neither now nor later."""
    gc.disable()
    try:
        return (yield)
    finally:
        gc.enable()
        gc.freeze()


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> Any:
    """With ``--dist loadfile``: parts of the tests for the processes that share them, which have sorted them."""
    if config.getoption("dist") != "loadfile":
        return None
    from parts import PartScheduling

    config.option.loadscopereorder = False
    return PartScheduling(config, log)


@pytest.hookimpl(trylast=True)
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """In one of several processes: in the order in which they take them."""
    if hasattr(config, "workerinput"):
        from parts import in_turn

        items[:] = [items[place] for place in in_turn([item.nodeid for item in items])]
