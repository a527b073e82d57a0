"""The pass ``ambient_visibility``: by rays where a tree for them is cheap or there, else by depth images."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch

import torchrender as tr
from torchrender.passes.light import ambient_visibility
from torchrender.passes.light.ambient_visibility import AMBIENT_VISIBILITY
from torchrender.pipeline.options import RenderOptions
from torchrender.scene.environment import Environment

PLAIN = RenderOptions(reflections="off", buffers=(AMBIENT_VISIBILITY.name,))


def setting(scene: tr.Scene, options: RenderOptions = PLAIN, history: tr.RenderHistory | None = None) -> str:
    made = tr.plan(scene, scene.camera(width=64, height=64), options=options, history=history)
    return made.row("ambient_visibility").setting


def test_rays_are_cast_where_their_tree_is_small_or_there(monkeypatch: pytest.MonkeyPatch) -> None:
    scene = tr.load("cornell_box")
    assert setting(scene) == "8 rays, 4 x 4"
    monkeypatch.setattr(ambient_visibility, "TREE", 10)
    assert setting(scene) == "2 x 16"
    traced = replace(PLAIN, ambient_visibility="traced")
    assert setting(scene, traced) == "8 rays, 4 x 4"
    image = tr.render(scene, width=64, height=64, options=traced, history=tr.RenderHistory())
    assert setting(scene, history=image.history) == "8 rays, 4 x 4"  # the tree is there


def test_without_a_sky_nobody_looks_beyond_what_is_near() -> None:
    """What is near is found alike, and all that is farther away counts as open."""
    room = tr.load("cornell_box")
    lit = replace(room, environment=Environment.constant([0.1, 0.1, 0.1]))
    for way in ("traced", "horizon"):
        options = replace(PLAIN, ambient_visibility=way)
        near, sky = (
            tr.render(scene, width=96, height=96, options=options).buffers[AMBIENT_VISIBILITY.name]
            for scene in (room, lit)
        )
        assert torch.equal(near.sky, near.near)
        assert float(sky.sky.mean()) < float(sky.near.mean()) - 0.2
        assert float((near.near - sky.near).abs().mean()) < (1e-6 if way == "traced" else 0.05)
