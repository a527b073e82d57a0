"""The study of all-frequency shadows: a ball as a mesh and as spheres, in small; Mitsuba beside it where it is."""

from __future__ import annotations

import importlib.util
from collections.abc import Iterator
from dataclasses import replace

import pytest
import torch

import torchrender.report.all_frequency.accuracy as accuracy_module
import torchrender.report.all_frequency.peers as peers
from torchrender.quality.machine import machine_record
from torchrender.rays import RayCaster
from torchrender.report.all_frequency.page import SHIFTED, page
from torchrender.report.all_frequency.stage import Stage
from torchrender.scene.environment import Environment
from torchrender.scene.mesh import concatenate
from torchrender.scene.shapes import sphere

SIDE = 24


@pytest.fixture
def ball(monkeypatch: pytest.MonkeyPatch) -> Iterator[Stage]:
    """A ball of many triangles over the plane, which one sphere stands for."""
    monkeypatch.setattr(peers, "SIDE", SIDE)
    shape = sphere(0.5, 48)
    shape = replace(shape, vertices=shape.vertices.double() + torch.tensor([0.3, 0.7, 0.1]).double())
    line = torch.linspace(-1.0, 1.0, SIDE, dtype=torch.float64)
    z, x = torch.meshgrid(line, line, indexing="ij")
    points = torch.stack([x, torch.zeros_like(x), z], dim=-1).reshape(-1, 3)
    alone = torch.tensor([[0.3, 0.7, 0.1, 0.5]]).double()
    yield Stage(
        name="ball",
        model=shape,
        points=points,
        normals=torch.tensor([0.0, 1.0, 0.0]).expand(len(points), 3),
        size=1.0,
        middle=torch.zeros(3).double(),
        caster=RayCaster(concatenate([shape])),
        spheres={64: alone},
        snug={64: alone},
        fits={64: 0.0},
    )


def dusk() -> Environment:
    """A window to one side: shadows tell directions apart."""
    radiance = torch.full((32, 64, 3), 0.2)
    radiance[4:10, 6:16] = torch.tensor([3.0, 2.0, 1.0])
    return Environment(radiance=radiance, name="dusk")


@pytest.mark.skipif(importlib.util.find_spec("mitsuba") is None, reason="needs Mitsuba")
def test_mitsuba_means_the_same(ball: Stage) -> None:
    found = peers.beside_mitsuba(ball, [dusk()], 2048)["skies"]["dusk"]
    for kind in ("spheres", "mesh"):
        row = found[kind]
        assert 0 < row["noise"] < 3.0
        assert row["agree"] < 1.2 and row["ours"] < 1.6, row
        assert row["mitsuba"]["samples"] >= 1 and row["mitsuba"]["rms"] > row["noise"]


def test_errors_by_spheres_vanish_where_spheres_are_the_model(ball: Stage, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(accuracy_module, "CHECKED", 60)
    row = accuracy_module.by_spheres(ball, dusk())["64"]
    assert row["covering"] == row["snug"] < 1.0


def test_the_page_says_what_was_asked_and_found() -> None:
    ms = {f"{n},{terms},{level}": n / 1.0 for n in (32, 64, 96, 128) for terms in (50, 200) for level in (1, 2)}
    stages = {"caps by table": 40.0, "caps one by one": 300.0, "light that turns": 12.0, "plain sum over texels": 640.0}
    rows = {
        name: {"rms": 1.0, "dark": 1.5, "most": 2.0, "psnr": 40.0}
        for name in ("ours, exact caps", "SHEXP", "best harmonics", SHIFTED)
    }
    rows["SHEXP"] = rows["SHEXP"] | {"rms": 9.0}
    peer = {"samples": 4, "ms": 50.0, "rms": 6.0, "rms_at_our_time": 6.0}
    one = {"noise": 0.1, "agree": 0.2, "ours": 1.5, "mitsuba": peer}
    lines = page(
        {
            "machine": machine_record(),
            "shared": True,
            "quick": True,
            "model": "ball",
            "times": {"all": ms, "stages": stages},
            "moving": {
                "frames": 4,
                "ms": {n: {"median": 150.0, "least": 140.0} for n in ("with", "without", "sky_shadow", "move")},
            },
            "settings": [{"name": "one level", "ms": 20.0, "all": 1.0, "shaded": 2.0, "close": 4.5}],
            "mitsuba": {
                "version": "3", "variant": "scalar_rgb", "samples": 64,
                "skies": {"dusk": {"ms": 64.0, "spheres": one, "mesh": one}},
            },
            "by_spheres": {"dusk": {"64": {"outside": 0.5, "covering": 3.0, "snug": 2.0}}},
            "accuracy": {"dusk,64": rows},
            "models": [{"name": "torus, 16", "error": 0.2, "asked": 0.3, "s": 9.0, "out": 0}],
        }
    )  # fmt: skip
    text = "\n".join(lines)
    assert "| pictures per second, 64 spheres, 200 terms, II | at least 10 | 15.6 |" in text
    assert "| one level | 20.0 | 1.00 | 2.00 | 4.50 |" in text
    assert "| time from 64 to 128 spheres, in that from 32 to 64 | 2 (linear) | 2.00 |" in text
    assert "| plain sum over texels, in our time | at least 6 | 10.0 |" in text
    assert "| error of SHEXP in ours (exact caps), dusk | at least 8 | 9.0 |" in text
    assert "| our error against the mesh in Mitsuba's at equal time, dusk | at most 0.33 | 0.25 |" in text
    assert "only ratios of rows within this run count" in text
