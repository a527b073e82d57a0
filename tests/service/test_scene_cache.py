"""Which scenes a renderer keeps loaded."""

from __future__ import annotations

import threading
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
        return SimpleNamespace(name=name, materials=(), geometry=SimpleNamespace(triangle_count=10))

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


def test_a_scene_that_another_thread_loads_is_loaded_once(loaded: list[object]) -> None:
    cache, source = SceneCache(), SceneSource(id="A")
    threads = [threading.Thread(target=cache.ahead(source)) for _ in range(3)]
    for thread in threads:
        thread.start()
    assert cache.get(source).name == "A"
    for thread in threads:
        thread.join()
    assert loaded == ["A"] and cache.has(source) and cache.ahead(source)().name == "A"


def test_a_scene_that_was_loaded_for_somebody_who_left_counts(loaded: list[object]) -> None:
    cache = SceneCache(max_bytes=20 * TREE_BYTES)
    assert cache.ahead(SceneSource(id="A"))().name == "A"
    assert cache.bytes == 0 and not cache.has(SceneSource(id="A"))
    cache.get(SceneSource(id="B"))
    assert cache.bytes == 20 * TREE_BYTES
    cache.get(SceneSource(id="A"))
    assert loaded == ["A", "B"]


def test_a_scene_that_cannot_be_loaded_ahead_says_why_where_it_is_wanted(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(scene_cache, "load", lambda _: {}["missing"])
    cache, source = SceneCache(), SceneSource(id="A")
    for get in (cache.ahead(source), lambda: cache.get(source), lambda: cache.get(source)):
        with pytest.raises(KeyError, match="missing"):
            get()
