"""Arguments of the wrong kind: every public function refuses them by name, with an error of the package."""

from __future__ import annotations

import inspect
import warnings
from pathlib import Path
from typing import Any

import pytest
import torch

import torchrender as tr
from torchrender.errors import LightWarning, TorchRenderError

BOX = tr.Scene(meshes=(tr.Mesh.box(),), lights=(tr.PointLight(position=[0.0, 3.0, 0.0]),))
CAMERA = BOX.camera(width=16, height=12)
IMAGES = tr.sample_depth_images(BOX, CAMERA)
SEEN = tr.rasterize(BOX, CAMERA)
CLOUD = tr.PointCloud(position=torch.rand(20, 3, dtype=torch.float64, generator=torch.Generator().manual_seed(1)))
AREA = tr.RectLight(corner=[0.0, 3.0, 0.0], edge_u=[1.0, 0.0, 0.0], edge_v=[0.0, 0.0, 1.0])
VOXELS = tr.voxelize_surface(BOX, 8)
FILE = "no/such/file"
CALLS: dict[str, tuple[Any, ...]] = {
    "render": (BOX, CAMERA),
    "plan": (BOX, CAMERA),
    "rasterize": (BOX, CAMERA),
    "rasterize_depth": (BOX, CAMERA),
    "visibility": (CAMERA, SEEN),
    "flow": (SEEN, SEEN),
    "sample_depth_images": (BOX, CAMERA),
    "sample_offset_images": (BOX, IMAGES),
    "reproject": (IMAGES, CAMERA),
    "reconstruct_hybrid": (IMAGES,),
    "soft_shadow": (BOX, AREA, SEEN),
    "approximate_occluders": (BOX, AREA),
    "reflective_pixels": (BOX, SEEN),
    "enhance_picture": (CAMERA, torch.rand(1, 12, 16, 3), torch.rand(1, 12, 16)),
    "render_points": (CLOUD, CAMERA),
    "build_patches": (CLOUD,),
    "voxelize_surface": (BOX, 8),
    "voxelize_solid": (BOX, 8),
    "voxelize_scene": (BOX, 8),
    "voxel_mesh": (VOXELS,),
    "collide": (BOX, BOX),
    "scene_info": (BOX,),
    "load": (FILE,),
    "load_points": (FILE,),
    "load_path": (FILE,),
    "load_rgbd": (FILE,),
    "open_points": (FILE,),
    "pack_points": (FILE, "file.trp"),
    "read_voxels": (FILE,),
    "read_walkthrough": (FILE,),
    "write_voxels": (FILE, VOXELS),
    "write_points": (FILE, tr.build_patches(CLOUD)),
    "write_scene": (FILE, BOX),
    "draw_walkthrough": (None, CAMERA),
    "next_views": (None,),
}
"""What each function is called with where everything is right."""
WRONG: tuple[Any, ...] = ("no such thing", [], {}, 0, object())
MAY_BE = {("render", 1): (None,), ("soft_shadow", 0): ([],), ("write_scene", 0): ("no such thing",)}


def _places() -> list[Any]:
    return [
        pytest.param(name, place, wrong, id=f"{name}-{place}-{type(wrong).__name__}")
        for name, right in CALLS.items()
        for place in range(len(right))
        for wrong in (*WRONG, None)
        if wrong not in MAY_BE.get((name, place), ())
    ]


@pytest.mark.parametrize(("name", "place", "wrong"), _places())
def test_arguments_of_the_wrong_kind_are_refused(
    name: str, place: int, wrong: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)  # for what should not be written
    arguments = list(CALLS[name])
    arguments[place] = wrong
    with pytest.raises(TorchRenderError):
        getattr(tr, name)(*arguments)


@pytest.mark.parametrize("name", sorted(CALLS))
@pytest.mark.parametrize("wrong", [{}, [], 0, False, "", "fast"])
def test_options_that_are_none_are_refused_also_where_they_are_empty(name: str, wrong: Any) -> None:
    function = getattr(tr, name)
    if "options" not in inspect.signature(function).parameters or name == "draw_walkthrough":
        pytest.skip("takes no options")
    with pytest.raises(TorchRenderError, match="options"):
        function(*CALLS[name], options=wrong)


def test_one_side_keeps_the_shape() -> None:
    assert tuple(tr.render(BOX, height=24).radiance.shape[1:3]) == (24, 32)
    assert tuple(tr.render(BOX, CAMERA, width=8).radiance.shape[1:3]) == (6, 8)
    assert tuple(tr.render(CLOUD, height=3).image.shape[1:3]) == (3, 4)


def test_a_light_without_area_is_named_once() -> None:
    flat = tr.RectLight(corner=[0.0, 3.0, 0.0], edge_u=[1.0, 0.0, 0.0], edge_v=[0.0, 0.0, 0.0], name="tube")
    with pytest.warns(LightWarning, match="tube"):
        tr.soft_shadow(BOX, flat, SEEN)
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        tr.render(BOX.replace(lights=(flat,)), CAMERA)
    assert sum(issubclass(one.category, LightWarning) and "no area" in str(one.message) for one in said) == 1
