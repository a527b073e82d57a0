"""Windows of a reference stand for the whole of it."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch

import torchrender as tr
from torchrender.quality.metrics import flip, flip_map
from torchrender.scene.load import load
from torchrender.tuning.windows import COUNT, MARGIN, SIDE, Windows


def test_small_pictures_are_compared_as_a_whole() -> None:
    scene = load("cornell_box")
    camera = scene.camera(width=40, height=30)
    windows, image = Windows.of(scene, camera), tr.render(scene, camera)
    assert [part[:2] for part in windows.parts] == [(0, 0)]
    wanted = windows.parts[0].wanted
    assert windows.error(image) == pytest.approx(float(flip(image.displayed().float(), wanted.displayed().float())[0]))


def test_windows_say_of_their_pixels_what_the_whole_picture_says(monkeypatch: pytest.MonkeyPatch) -> None:
    """Pictures made by hand: where they differ only between the windows, no window sees it."""
    scene = load("cornell_box")
    camera = scene.camera(width=300, height=300)
    ramp = torch.rand(1, 300, 300, 3, generator=torch.Generator().manual_seed(3))
    exact = replace(tr.render(scene, scene.camera(width=300, height=300)), radiance=ramp, history=None)

    def cut(_: object, window: tr.Cameras, **__: object) -> tr.Image:
        left, top = (int(camera.intrinsics[0, i, 2] - window.intrinsics[0, i, 2]) for i in (0, 1))
        part = ramp[:, top : top + window.height, left : left + window.width]
        return tr.Image(radiance=part, cameras=window, scene=scene)

    monkeypatch.setattr("torchrender.tuning.windows.render", cut)
    windows = Windows.of(scene, camera)
    assert len(windows.parts) == COUNT and windows.error(exact) == 0.0
    inside = torch.zeros(300, 300, dtype=torch.bool)
    for top, left, _, (rows, columns) in windows.parts:
        inside[top + rows.start : top + rows.stop, left + columns.start : left + columns.stop] = True
    assert int(inside.sum()) > 0.8 * COUNT * SIDE**2, "windows hardly lie upon each other"
    thirds = torch.nn.functional.avg_pool2d(inside.double()[None], 100)
    assert float(thirds.min()) > 0.6 * float(thirds.mean()), "nor leave a part of the picture out"
    changed = replace(exact, radiance=(0.8 * ramp).clamp(0, 1))
    whole = flip_map(changed.displayed(), exact.displayed())[0]
    assert windows.error(changed) == pytest.approx(float(whole[inside].mean()), rel=0.02)
    hidden = torch.zeros(300, 300, dtype=torch.bool)
    near = torch.nn.functional.max_pool2d(inside.float()[None], 2 * MARGIN + 1, 1, MARGIN)[0] > 0
    hidden[(~near).nonzero()[0].unbind()] = True
    assert windows.error(replace(exact, radiance=torch.where(hidden[None, ..., None], 1.0, ramp))) == 0.0
