"""3D Gaussians and half-transparent points: against closed forms, and a slow loop."""

from __future__ import annotations

import math
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import torch

import torchrender as tr
from torchrender.errors import CameraError, InputError, NotUsedWarning, OptionError
from torchrender.kernels.points.blended import ENOUGH, LEAST, MOST, TILE, blend_tiles, count_tiles, fill_tiles
from torchrender.numerics.color import srgb_from_linear
from torchrender.points.gaussians import LOW_PASS, covariances, is_blended, project
from torchrender.scene.files.plain.ply import Gaussians

CAMERA = tr.Cameras.look_at([0.0, 0.0, 4.0], [0.0, 0.0, 0.0], width=33, height=33, fov_deg=40.0)


def ball(
    opacity: float, sigma: float = 0.4, z: float = 0.0, color: tuple[float, ...] = (1.0, 0.0, 0.0)
) -> tr.PointCloud:
    return tr.PointCloud(
        position=torch.tensor([[0.0, 0.0, z]]), color=torch.tensor([color]), opacity=torch.tensor([opacity]),
        spread=sigma**2 * torch.eye(3)[None],
    )  # fmt: skip


def test_a_gaussian_seen_from_the_front_is_its_own_profile() -> None:
    """Opacity times exp(-r^2 / 2 s^2), with s the projected width and the screen filter."""
    picture = tr.render_points(ball(0.8), CAMERA)
    focal = float(CAMERA.intrinsics[0, 0, 0])
    variance = (0.4 * focal / 4.0) ** 2 + LOW_PASS
    x = torch.arange(33) + 0.5 - 16.5
    expected = 0.8 * torch.exp(-(x**2) / (2 * variance))
    torch.testing.assert_close(
        picture.weight[0, 16], torch.where(expected > LEAST, expected, 0.0), atol=1e-5, rtol=1e-4
    )
    red = srgb_from_linear(picture.image[0, 16, :, 0])
    torch.testing.assert_close(red, picture.weight[0, 16], atol=1e-4, rtol=1e-3)
    assert float(picture.depth[0, 16, 16]) == pytest.approx(4.0) and math.isinf(float(picture.depth[0, 0, 0]))


def test_the_nearer_one_covers_whatever_the_order() -> None:
    near, far = ball(0.5, z=1.0, color=(1.0, 0.0, 0.0)), ball(0.5, z=-1.0, color=(0.0, 1.0, 0.0))
    for first, second in ((near, far), (far, near)):
        both = tr.PointCloud(
            **{
                name: torch.cat([getattr(first, name), getattr(second, name)])
                for name in ("position", "color", "opacity", "spread")
            }
        )
        middle = srgb_from_linear(tr.render_points(both, CAMERA).image[0, 16, 16])
        assert middle.tolist() == pytest.approx([0.5, 0.25, 0.0], abs=2e-2)


def test_covariances_turn_with_their_quaternion() -> None:
    """Long along x, turned by a quarter about z: long along y."""
    quarter = [math.cos(math.pi / 4), 0.0, 0.0, math.sin(math.pi / 4)]
    model = Gaussians(
        scale=np.array([[3.0, 1.0, 2.0]], np.float32), rotation=np.array([quarter], np.float32),
        opacity=np.ones(1, np.float32), color=np.ones((1, 3), np.float32),
    )  # fmt: skip
    np.testing.assert_allclose(covariances(model)[0], np.diag([1.0, 9.0, 4.0]), atol=1e-5)


def slow(records: np.ndarray, height: int, width: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """All Gaussians at all pixels, from the front."""
    image, depth, cover = np.zeros((height, width, 3)), np.full((height, width), np.inf), np.zeros((height, width))
    for y in range(height):
        for x in range(width):
            through, far = 1.0, 0.0
            for u, v, a, b, c, z, opacity, *color in records.astype(np.float64):
                dx, dy = x + 0.5 - u, y + 0.5 - v
                alpha = min(MOST, opacity * math.exp(-(0.5 * (a * dx * dx + c * dy * dy) + b * dx * dy)))
                if alpha < LEAST or through < ENOUGH:
                    continue
                image[y, x] += alpha * through * np.array(color)
                cover[y, x] += alpha * through
                far += alpha * through * z
                through *= 1 - alpha
            if cover[y, x] > 0:
                depth[y, x] = far / cover[y, x]
    return image, depth, cover


def cloud(count: int = 60, seed: int = 0) -> tr.PointCloud:
    random = torch.Generator().manual_seed(seed)
    axes = 0.3 * torch.randn(count, 3, 3, generator=random)
    return tr.PointCloud(
        position=torch.randn(count, 3, generator=random), color=torch.rand(count, 3, generator=random),
        opacity=torch.rand(count, generator=random), spread=axes @ axes.transpose(1, 2),
    )  # fmt: skip


def test_tiles_against_the_slow_loop() -> None:
    model = cloud()
    records, boxes = project(model, model.spread.double(), CAMERA)  # type: ignore[union-attr]
    across = -(-33 // TILE)
    counts = np.zeros(across * across, np.int64)
    count_tiles(boxes, across, counts)
    start = np.concatenate([[0], counts.cumsum()])
    entries = np.empty(int(start[-1]), np.int32)
    fill_tiles(boxes, across, start[:-1].copy(), entries)
    image, depth, cover = (
        np.zeros((33, 33, 3), np.float32),
        np.zeros((33, 33), np.float32),
        np.zeros((33, 33), np.float32),
    )
    blend_tiles(records, entries, start, image, depth, cover)
    expected = slow(records, 33, 33)
    # Beyond their box Gaussians cover less than a code; the slow loop has no boxes.
    for found, meant in zip((image, depth, cover), expected, strict=True):
        np.testing.assert_allclose(found, meant, atol=6e-3)


def test_half_transparent_points_without_a_covariance_are_discs() -> None:
    flat = tr.PointCloud(
        position=torch.zeros(1, 3), normal=torch.tensor([[0.0, 0.0, 1.0]]), radius=torch.tensor([1.0]),
        color=torch.ones(1, 3), opacity=torch.tensor([0.5]),
    )  # fmt: skip
    assert is_blended(flat) and not is_blended(tr.PointCloud(position=torch.zeros(1, 3), opacity=torch.ones(1)))
    picture = tr.render_points(flat, CAMERA)
    assert float(picture.weight.max()) == pytest.approx(0.5, abs=1e-3)
    side = tr.Cameras.look_at([4.0, 0.0, 0.0], [0.0, 0.0, 0.0], width=33, height=33, fov_deg=40.0)
    # Seen on edge it is a line as thin as the screen filter.
    covered = (tr.render_points(flat, side).weight[0] > 0.1).sum(dim=1)
    assert 0 < int(covered.max()) <= 3


def test_files_of_gaussians(tmp_path: Path) -> None:
    names = ["x", "y", "z", *(f"f_dc_{k}" for k in range(3)), "f_rest_0", "opacity"]
    names += [*(f"scale_{k}" for k in range(3)), *(f"rot_{k}" for k in range(4))]
    head = "ply\nformat binary_little_endian 1.0\nelement vertex 1\n" + "".join(f"property float {n}\n" for n in names)
    row = np.array([0, 0, 0, 1.7725, 0, -1.7725, 9, 0, *np.log([0.4, 0.4, 0.4]), 2, 0, 0, 0], "<f4")
    (tmp_path / "gs.ply").write_bytes(head.encode() + b"end_header\n" + row.tobytes())
    with pytest.warns(NotUsedWarning, match=r"colours that change with the direction of view .*\(1\)"):
        model = tr.load_points(tmp_path / "gs.ply")
    assert model.opacity is not None and model.spread is not None and model.color is not None
    assert model.opacity.tolist() == [0.5] and model.color[0].tolist() == pytest.approx([1.0, 0.2140, 0.0], abs=1e-3)
    torch.testing.assert_close(model.spread[0], 0.16 * torch.eye(3), atol=1e-5, rtol=0)
    assert float(tr.render_points(model, CAMERA).weight.max()) == pytest.approx(0.5, abs=1e-3)


def test_a_spread_that_no_gaussian_has_is_refused() -> None:
    """With the number of the first such point; products of float32 scales and rotations pass."""
    axes = torch.randn(5000, 3, 3, generator=torch.Generator().manual_seed(7))
    axes *= torch.logspace(-6, 6, 5000)[:, None, None] * torch.tensor([1.0, 1e-4, 0.0])
    good = (axes @ axes.transpose(1, 2)).float()
    place = torch.zeros(5000, 3)
    assert len(tr.PointCloud(position=place, spread=good)) == 5000
    crooked, negative, saddle = good.clone(), good.clone(), good.clone()
    crooked[7, 0, 1] += 0.01 * good[7].trace()
    negative[9] = -negative[9]
    turn = torch.linalg.qr(torch.randn(3, 3, generator=torch.Generator().manual_seed(8)))[0]
    saddle[11] = turn @ torch.diag(torch.tensor([1.0, 2.0, -0.05])) @ turn.T
    with pytest.raises(InputError, match=r"spread must be symmetric: 1 of 5000 points' are not, first at 7"):
        tr.PointCloud(position=place, spread=crooked)
    for wrong, first in ((negative, 9), (saddle, 11)):
        with pytest.raises(InputError, match=rf"spread must be a covariance, .*: 1 of 5000 points' .* at {first}"):
            tr.PointCloud(position=place, spread=wrong)


def test_covariances_of_huge_gaussians_stay_covariances() -> None:
    turn = np.random.default_rng(1).normal(size=(50, 4)).astype(np.float32)
    scale = np.float32(10) ** np.random.default_rng(2).uniform(18, 30, (50, 3)).astype(np.float32)
    model: Any = SimpleNamespace(rotation=turn, scale=scale)
    spread = torch.from_numpy(covariances(model))
    assert bool(torch.isfinite(spread).all())
    assert len(tr.PointCloud(position=torch.zeros(50, 3), spread=spread)) == 50


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"color": [[0.5, -0.1, 0.2]]}, r"color must not be negative: 1 of 3 values are, first at 1"),
        ({"two_sided": [True]}, "two_sided must be True or False, got"),
        ({"name": 3}, "name of a point cloud must be text"),
    ],
)
def test_clouds_say_what_is_wrong(wrong: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        tr.PointCloud(position=[[0.0, 0.0, 0.0]], **wrong)


@pytest.mark.parametrize("count", [10.5, "9", True, 0])
def test_samples_are_counted_in_whole_numbers(count: Any) -> None:
    with pytest.raises(OptionError, match=r"samples must be (an integer|in \[1, )"):
        tr.load_points("cornell_box", samples=count)


def test_orthographic_cameras_are_refused() -> None:
    from dataclasses import replace

    with pytest.raises(CameraError, match="perspective"):
        tr.render_points(ball(0.5), replace(CAMERA, orthographic=True, far=torch.tensor([50.0])))
