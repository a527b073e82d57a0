"""Rays through Embree's boxes against the float64 tree, and the library's lookup."""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np
import pytest

from torchrender.kernels.raster.records import NO_HOLES
from torchrender.kernels.rays import embree as records
from torchrender.kernels.rays import embree_library
from torchrender.kernels.rays.bvh import trace
from torchrender.kernels.rays.bvh_build import build_bvh
from torchrender.kernels.rays.embree_library import EmbreeWarning, bundled_library, check_version, embree
from torchrender.kernels.rays.embree_scene import QUICK, USUAL, EmbreeScene
from torchrender.kernels.rays.plain_embree import PlainEmbree
from torchrender.kernels.rays.watertight import Rays

NEEDS_EMBREE = pytest.mark.skipif(embree() is None, reason="embreex is not installed")


def soup(count: int, seed: int, size: float) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    corners = rng.random((count, 1, 3)) + size * rng.standard_normal((count, 3, 3))
    return corners.reshape(-1, 3), np.arange(3 * count, dtype=np.int32).reshape(-1, 3)


def rays_of(count: int, seed: int, **changes: object) -> Rays:
    rng = np.random.default_rng(seed)
    d = rng.standard_normal((count, 3)) * 10.0 ** rng.uniform(-3, 3, (count, 1))
    span = np.stack([np.zeros(count), np.full(count, np.inf)], 1)
    rays = Rays(rng.random((count, 3)), d, span, rng.integers(-1, 300, count).astype(np.int32), False, False)
    return rays._replace(**changes)


@NEEDS_EMBREE
@pytest.mark.parametrize("quality", [QUICK, USUAL])
@pytest.mark.parametrize("size", [0.3, 0.01])
def test_every_ray_equals_the_tree(quality: int, size: float) -> None:
    vertices, faces = soup(3000, 1, size)
    scene, bvh = EmbreeScene(vertices, faces, quality), build_bvh(vertices, faces)
    far = rays_of(5000, 2)
    for rays in (
        rays_of(20000, 3),
        rays_of(20000, 4, cull=True),
        far._replace(origins=far.origins - 1e4 * far.directions),
        far._replace(span=np.stack([np.full(5000, -2.0), np.linspace(-1, 5, 5000)], 1)),
    ):
        for one, other in zip(scene.cast(rays), trace(bvh, rays, faces, NO_HOLES), strict=True):
            np.testing.assert_array_equal(one, other)
        blocked = rays._replace(any_hit=True)
        np.testing.assert_array_equal(scene.cast(blocked)[1] >= 0, trace(bvh, blocked, faces, NO_HOLES)[1] >= 0)


@NEEDS_EMBREE
def test_records_have_the_sizes_of_embree() -> None:
    """Sizes and offsets in rtcore_ray.h and rtcore_common.h of Embree 4.0 to 4.4."""
    assert records.RAY_HIT.itemsize == 96 and records.CALL.itemsize == 48 and records.BOUNDS_CALL.itemsize == 24
    place = {
        n: records.RAY_HIT.fields[n][1] for n in ("near", "dx", "far", "nx", "u", "primitive", "geometry", "instance")
    }
    assert place == {
        "near": 12,
        "dx": 16,
        "far": 32,
        "nx": 48,
        "u": 60,
        "primitive": 68,
        "geometry": 72,
        "instance": 76,
    }
    assert records.STATE.fields["packed"][1] == 8


@NEEDS_EMBREE
def test_plain_embree_agrees_where_float32_suffices() -> None:
    vertices, faces = soup(800, 5, 0.05)
    rays = rays_of(20000, 6, ignore=np.full(20000, -1, np.int32))
    t, triangle = PlainEmbree(vertices, faces).cast(rays)
    exact = EmbreeScene(vertices, faces).cast(rays)
    same = triangle == exact[1]
    assert same.mean() > 0.999
    hit = same & (triangle >= 0)
    assert np.median(np.abs(t[hit] / exact[0][hit] - 1)) < 1e-5
    blocked = PlainEmbree(vertices, faces).cast(rays._replace(any_hit=True))[1]
    assert ((blocked >= 0) == (exact[1] >= 0)).mean() > 0.999


@pytest.mark.parametrize(
    ("platform", "place"),
    [
        ("linux", "embreex.libs/libembree4-4aef3270.so.4"),
        ("darwin", "embreex/.dylibs/libembree4.4.dylib"),
        ("win32", "embreex.libs/embree4.dll"),
        ("win32", "embreex/embree4.dll"),
        ("linux", "embreex/libembree4.so.4"),
    ],
)
def test_the_library_is_found_where_wheels_put_it(tmp_path: Path, platform: str, place: str) -> None:
    package = tmp_path / "embreex"
    package.mkdir()
    assert bundled_library(package, platform) is None
    for name in (place, "embreex.libs/libtbb.so.12", "embreex/.dylibs/libtbb.12.dylib", "embreex.libs/tbb12.dll"):
        (tmp_path / name).parent.mkdir(exist_ok=True, parents=True)
        (tmp_path / name).touch()
    assert bundled_library(package, platform) == tmp_path / place
    other = "darwin" if platform != "darwin" else "linux"
    assert bundled_library(package, other) is None


@pytest.mark.parametrize("version", [(3, 13), (4, 5), (5, 0)])
def test_unknown_versions_are_refused(version: tuple[int, int]) -> None:
    for minor in range(5):
        check_version(4, minor)
    with pytest.raises(RuntimeError, match=f"{version[0]}.{version[1]}"):
        check_version(*version)


@NEEDS_EMBREE
def test_what_cannot_be_used_is_said_once(monkeypatch: pytest.MonkeyPatch) -> None:
    embree.cache_clear()
    monkeypatch.setattr(embree_library, "_MINORS", range(3))
    try:
        with pytest.warns(EmbreeWarning, match="4.4"):
            assert embree() is None
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            assert embree() is None
    finally:
        embree.cache_clear()


def test_kernels_that_call_embree_say_so_before_they_are_compiled(monkeypatch: pytest.MonkeyPatch) -> None:
    """A process that compiles them without the library would be ended by the compiler."""
    from torchrender.kernels.rays import embree as module

    module.load_library()
    monkeypatch.setattr(module, "embree", lambda: None)
    with pytest.raises(ImportError, match="no Embree"):
        module.load_library()
