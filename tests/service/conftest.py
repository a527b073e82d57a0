"""One real server for all tests that need one."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from service_server import RunningServer, start_server, stop_server


@pytest.fixture(scope="session")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[RunningServer]:
    """The server that tests share."""
    running = start_server(tmp_path_factory.mktemp("service"))
    yield running
    stop_server(running)
