"""Which scenes a renderer keeps loaded."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from torchrender_service.renderers import scene_cache
from torchrender_service.renderers.jobs import SceneSource
from torchrender_service.renderers.keeping.sizes import TREE_BYTES
from torchrender_service.renderers.scene_cache import SceneCache


@pytest.fixture
def loaded(monkeypatch: pytest.MonkeyPatch) -> list[object]:
    """Every scene that was loaded, in turn; all have ten triangles."""
    names: list[object] = []

    def load(name: object) -> object:
        names.append(name)
        return SimpleNamespace(name=name, geometry=SimpleNamespace(triangle_count=10))

    monkeypatch.setattr(scene_cache, "load", load)
    monkeypatch.setattr(scene_cache, "load_any", load)
    return names


def test_the_scene_that_was_not_used_for_longest_goes_first(loaded: list[object]) -> None:
    cache = SceneCache(max_bytes=20 * TREE_BYTES)
    for name in "ABAC":
        assert cache.get(SceneSource(id=name)).name == name
    assert loaded == ["A", "B", "C"]
    cache.get(SceneSource(id="A"))
    assert loaded == ["A", "B", "C"], "A was used after B"
    cache.get(SceneSource(id="B"))
    assert loaded == ["A", "B", "C", "B"]


def test_a_scene_larger_than_everything_allowed_is_kept_alone(loaded: list[object]) -> None:
    cache = SceneCache(max_bytes=9 * TREE_BYTES)
    for name in "AABB":
        cache.get(SceneSource(id=name))
    assert loaded == ["A", "B"]
    cache.forget("B")
    cache.get(SceneSource(id="B"))
    assert loaded == ["A", "B", "B"]
