"""Facts about the built-in scenes: told by a file, however busy the renderers are."""

from __future__ import annotations

import asyncio
from pathlib import Path
from typing import Any

import numpy as np

from torchrender_service.metrics import Metrics
from torchrender_service.renderers.pool import Pool
from torchrender_service.scenes.built_in import built_in_facts, described
from torchrender_service.scenes.store import SceneStore
from torchrender_service.settings import BUILT_IN, read_settings


def test_the_file_says_what_the_scenes_are() -> None:
    told = built_in_facts()
    assert list(told) == list(BUILT_IN)
    for name, facts in described().items():
        kept = dict(told[name])
        for exact in ("bounds", "diagonal"):  # processors differ in the last digits
            np.testing.assert_allclose(facts.pop(exact), kept.pop(exact), rtol=1e-4, atol=1e-4, err_msg=name)
        assert facts == kept, f"{name}: write the file again"


def test_no_renderer_is_asked(tmp_path: Path) -> None:
    settings = read_settings(None, {}, data_dir=str(tmp_path))

    async def listed() -> list[dict[str, Any]]:
        store = SceneStore(settings, Pool(settings, Metrics()))  # nobody works in this pool
        return [await asyncio.wait_for(store.facts(name), 1.0) for name in store.names]

    found = asyncio.run(listed())
    assert [facts["id"] for facts in found] == list(settings.built_in)
    assert all(facts["built_in"] and facts["triangles"] > 0 for facts in found)
