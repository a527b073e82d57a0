"""What the local service on Ray Serve is told on its input."""

from __future__ import annotations

from typing import Any

import pytest

pytest.importorskip("ray.serve")

from torchrender.errors import OptionError
from torchrender_service import ray_local


def test_lines_change_how_many_replicas_there_are(monkeypatch: pytest.MonkeyPatch, capsys: Any) -> None:
    asked: list[int] = []
    monkeypatch.setattr(ray_local, "set_replicas", asked.append)
    ray_local.listen(["replicas 3\n", "\n", "replicas 0\n", "replicas x\n", "stop\n", "replicas 1"])
    assert asked == [3, 1] and capsys.readouterr().err.count("not understood") == 3


def test_other_addresses_need_a_key() -> None:
    with pytest.raises(OptionError, match="api_key is required"):
        ray_local.run({}, "0.0.0.0", 8000)
