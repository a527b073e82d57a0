"""What a renderer keeps counts in bytes, goes when there is no room, and is given up where memory is not enough."""

from __future__ import annotations

import gc
import io
import threading
import weakref
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
import torch
from PIL import Image as PilImage
from torch import Tensor

import torchrender as tr
from gltf_builder import Glb
from torchrender.errors import InputError
from torchrender.numerics.texels.coded import CodedTexture, codes_of
from torchrender.numerics.texture import build_pyramid, halved, halved_texture
from torchrender.pipeline.buffer import Buffer, Lasting
from torchrender.pipeline.history import Kept, RenderHistory
from torchrender.pipeline.options import RenderOptions
from torchrender.scene.camera import Cameras
from torchrender.scene.material import Material
from torchrender.wire.cameras import header_of
from torchrender.wire.messages import CameraHeader
from torchrender_service.errors import ServiceError
from torchrender_service.renderers import job_runner
from torchrender_service.renderers.job_runner import JobRunner
from torchrender_service.renderers.jobs import (
    Bounds,
    Describe,
    Forget,
    Locate,
    MakeKeyframe,
    Plan,
    Render,
    SceneSource,
    View,
)
from torchrender_service.renderers.keeping.lasting import SELDOM, LastingParts
from torchrender_service.renderers.keeping.sizes import bytes_of
from torchrender_service.renderers.keeping.textures import CODED_BYTES, bounded, bytes_of_levels, textures_of, within
from torchrender_service.renderers.streaming.ahead import first_keyframe
from torchrender_service.renderers.streaming.stream_renderer import STREAM

BOX = SceneSource(id="cornell_box")


def test_an_array_counts_once_and_wholly() -> None:
    texture = torch.zeros(64, 64, 3)
    materials = [Material(diffuse_texture=texture), Material(diffuse_texture=texture)]
    plain = bytes_of([Material(), Material()])
    assert bytes_of(materials) - plain == texture.nbytes
    assert bytes_of({"part": texture[:2]}) == texture.nbytes, "a part keeps all of it in memory"
    array = np.zeros(1000)
    assert bytes_of(array, array[3:], (array,)) == array.nbytes
    known: set[int] = set()
    assert bytes_of(texture, known=known) == texture.nbytes and bytes_of(texture, known=known) == 0


def test_a_scene_counts_its_textures() -> None:
    scene = tr.load("cornell_box")
    assert 0 < bytes_of(scene) < 2**20


def test_what_pictures_of_a_scene_left_goes_with_the_scene_that_was_not_used_for_longest() -> None:
    lasting = Lasting(lambda _: ())
    kept = {
        name: Kept(Buffer(name, Tensor, lasting=lasting), torch.zeros(100), (), (), RenderOptions(), 1)
        for name in "abc"
    }
    parts = LastingParts(max_bytes=900)
    for name in "abac":
        parts.put(name, "use", RenderHistory(kept={name: kept[name]}))
    assert [name for name in "abc" if parts.get(name, "use").kept] == ["a", "c"]
    assert parts.bytes == 800 and parts.evictions == 1
    parts.clear()
    assert parts.bytes == 0 and not parts.get("a", "use").kept


def test_pictures_that_are_like_the_one_before_are_seldom_counted() -> None:
    lasting = Lasting(lambda _: ())

    def left(name: str, count: int) -> RenderHistory:
        kept = Kept(Buffer(name, Tensor, lasting=lasting), torch.zeros(count), (), (), RenderOptions(), 1)
        return RenderHistory(kept={name: kept})

    parts = LastingParts(max_bytes=10**6)
    found = []
    for number in range(SELDOM + 1):
        parts.put("a", "use", left("map", 100 + number), whole=True)
        found.append(parts.bytes // 4)
    assert found == [100] * SELDOM + [100 + SELDOM]
    parts.put("a", "another use", left("map", 300), whole=True)
    assert parts.bytes == 1200, "pictures for another use may be larger"
    parts.put("a", "another use", left("tree", 500), whole=True)
    assert parts.bytes == 2000


def test_a_picture_leaves_its_maps_for_the_next_one() -> None:
    runner = JobRunner(2048)
    job = Render(scene=BOX, view=View(width=48, height=32), bounds=Bounds(), options={}, format="png")

    def maps() -> Any:
        return runner._lasting.get("cornell_box", "any").kept["shadow_map"].value

    first, drawn = runner.run(job), maps()
    second = runner.run(job)
    assert first["file"] == second["file"] and maps() is drawn
    assert runner.kept_bytes > bytes_of(tr.load("cornell_box")) + bytes_of(drawn)


def test_where_memory_is_not_enough_caches_go_and_it_is_tried_once_more(monkeypatch: pytest.MonkeyPatch) -> None:
    runner, calls = JobRunner(2048), []
    runner.run(Describe(scene=BOX))
    assert runner.kept_bytes > 0

    def failing(_: object) -> dict[str, Any]:
        calls.append(runner.kept_bytes)
        if len(calls) == 1:
            raise RuntimeError("[enforce fail at alloc_cpu.cpp:114] . DefaultCPUAllocator: can't allocate memory")
        return {"done": True}

    monkeypatch.setattr(job_runner, "describe", failing)
    assert runner.run(Describe(scene=BOX)) == {"done": True}
    assert len(calls) == 2 and runner.evictions == 1
    monkeypatch.setattr(job_runner, "describe", lambda _: (_ for _ in ()).throw(MemoryError))
    with pytest.raises(MemoryError):
        runner.run(Describe(scene=BOX))


@pytest.mark.filterwarnings("error::torchrender.errors.ViewWarning")
@pytest.mark.parametrize("still", [False, True])
def test_whoever_looks_about_is_not_warned(still: bool) -> None:
    runner = JobRunner(2048)
    header = header_of(Cameras.look_at((0.3, 0.3, -0.8), (0.3, 0.3, -2.0), width=64, height=48))
    job = MakeKeyframe(
        session="one", scene=BOX, id=0, pose=0, time_ms=0.0, camera=header, still=still,
        extra_layers=0, direction=(0.0, 0.0, 0.0), baseline=0.0, color="jpeg", quality=85, bounds=Bounds(),
    )  # fmt: skip
    assert runner._run(job)["typical_depth"] == 0.0


def test_textures_of_a_scene_take_no_more_than_they_may() -> None:
    """The largest ones lose their finest levels; colours stay, and what was done is said."""
    large, small = torch.rand(64, 128, 3), torch.rand(16, 16, 4)
    materials = (
        Material(name="a", diffuse_texture=large),
        Material(name="b", diffuse_texture=large, emission_texture=small),
        Material(name="c"),
    )
    scene = tr.Scene(materials=materials)
    all_bytes = int(7 / 3 * (large.nbytes + small.nbytes)) + 1
    assert within(scene, all_bytes) is scene
    cut = within(scene, all_bytes // 3)
    first, second, third = cut.materials
    assert first.diffuse_texture is second.diffuse_texture and third is materials[2]
    assert first.diffuse_texture is not None and first.diffuse_texture.shape == (32, 64, 3)
    assert torch.allclose(first.diffuse_texture[3, 5], large[6:8, 10:12].mean(dim=(0, 1)))
    assert torch.allclose(first.diffuse_texture.mean((0, 1)), large.mean((0, 1)), atol=1e-6)
    assert second.emission_texture is small
    assert cut.report.plain()["not_used"] == ["texels of a texture of 128 x 64: 64 x 32 are kept (1)"]
    kept = {id(t): t for m in within(scene, 700).materials for t in textures_of(m).values()}
    assert sum(7 / 3 * t.nbytes for t in kept.values()) <= 700
    assert within(scene, 1).materials[0].diffuse_texture.shape == (1, 1, 3), "a texel is always left"
    assert bytes_of_levels(scene) == int(4 / 3 * (large.nbytes + small.nbytes))


def test_textures_of_codes_count_as_what_they_take() -> None:
    codes = CodedTexture(np.zeros((64, 128, 3), np.uint8), 3)
    scene = tr.Scene(materials=(Material(diffuse_texture=codes),))
    assert bytes_of_levels(scene) == int(5 / 3 * codes.codes.nbytes) and bytes_of(scene) < 2 * codes.codes.nbytes
    render = tr.render(scene.replace(meshes=(tr.Mesh.plane(2),)), width=16, height=16)
    assert render.radiance.shape == (1, 16, 16, 3) and codes.codes is not None, "a picture leaves it as it is"
    assert within(scene, 64 * 128 * CODED_BYTES) is scene
    (cut,) = within(scene, 64 * 128 * CODED_BYTES - 1).materials
    assert codes_of(cut.diffuse_texture) is not None and cut.diffuse_texture.shape == (32, 64, 3)


@pytest.mark.parametrize("shape", [(7, 5, 3), (1, 9, 4), (600, 4, 1), (2, 2, 3)])
def test_halves_are_means(shape: tuple[int, int, int]) -> None:
    texture = torch.rand(*shape)
    made = halved(texture)
    assert made.shape == (max(shape[0] // 2, 1), max(shape[1] // 2, 1), shape[2])
    assert torch.allclose(
        made, build_pyramid(texture).texels[shape[0] * shape[1] :][: made[..., 0].numel()].view_as(made)
    )


@pytest.mark.parametrize("size", [(64, 48), (63, 48)])
def test_pictures_are_made_smaller_as_they_are_read(tmp_path: Path, size: tuple[int, int]) -> None:
    """The same texels as those of the whole picture, halved; also of files whose pictures are read side by side."""
    made = Glb(images=[], textures=[], materials=[], nodes=[], scenes=[{"nodes": [0, 1]}])
    uv = made.accessor([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
    for number, shade in enumerate((40, 200)):
        data = io.BytesIO()
        PilImage.effect_noise(size, shade).convert("RGB").save(data, "PNG")
        made.json["images"].append({"bufferView": made.view(data.getvalue()), "mimeType": "image/png"})
        made.json["textures"].append({"source": number})
        made.json["materials"].append({"pbrMetallicRoughness": {"baseColorTexture": {"index": number}}})
        made.json["nodes"].append({"mesh": made.mesh(material=number, TEXCOORD_0=uv)})
    path = made.write(tmp_path / "two.glb")
    whole, most = tr.load(path), 64 * 48 // 4 * CODED_BYTES
    with bounded(most) as bound:
        small = tr.load(path)
    assert sum(bound.lost.values()) == 2
    for before, after in zip(whole.materials, small.materials, strict=True):
        (large,), (little,) = textures_of(before).values(), textures_of(after).values()
        assert torch.equal(little, halved_texture(large)) and codes_of(little) is not None
    told = within(small, None, bound.lost).report.plain()["not_used"]
    assert told == [f"texels of a texture of {size[0]} x {size[1]}: {size[0] // 2} x {size[1] // 2} are kept (2)"]
    again = [textures_of(one)["diffuse_texture"].shape for one in tr.load(path).materials]
    assert again == [(size[1], size[0], 3)] * 2, "the bound is over"


WALKER = SceneSource(id="walker")


def render_at(runner: JobRunner, time: float | None, scene: SceneSource = WALKER, **more: Any) -> bytes:
    view = View(width=48, height=48)
    job = Render(scene=scene, view=view, bounds=Bounds(), options={}, format="png", time=time, **more)
    return bytes(runner.run(job)["file"])


def test_a_picture_is_of_the_time_that_was_asked_for_whatever_came_before() -> None:
    runner = JobRunner()
    asked = (None, 0.4, 0.8, 0.4, None, 1e6)
    pictures = [render_at(runner, time) for time in asked]
    assert pictures[1] != pictures[2] and pictures[1] == pictures[3] and pictures[0] == pictures[4]
    for time, picture in zip(asked, pictures, strict=True):
        assert picture == render_at(JobRunner(), time), "what an earlier picture left is of another time"
    end = max(tr.load("walker").animations.values())
    assert pictures[-1] == render_at(runner, end), "it stands still after its end"


def test_a_time_needs_an_animation() -> None:
    jobs = (
        Render(scene=BOX, view=View(width=8, height=8), bounds=Bounds(), options={}, format="png", time=1.5),
        Plan(scene=BOX, view=View(width=8, height=8), bounds=Bounds(), time=1.5),
    )
    for job in jobs:
        with pytest.raises(InputError, match=r"time is for scenes with an animation: 'cornell_box' has none, got 1\.5"):
            JobRunner().run(job)


def test_a_first_keyframe_takes_what_was_made_ahead_of_it() -> None:
    """In another thread, beside the keyframes of others."""
    runner, view = JobRunner(), View(width=48, height=32)
    ahead = runner.ahead(BOX, parts=True)
    assert ahead is not None
    thread = threading.Thread(target=ahead)
    thread.start()
    thread.join()
    assert runner.ahead(BOX) is not None, "nothing is taken before a job comes"
    camera = msgspec.convert(runner.run(Locate(scene=BOX, view=view))["camera"], CameraHeader)
    made = runner._lasting.get(BOX.id, STREAM).kept
    assert "occluders" in made
    runner.run(first_keyframe("session", BOX, camera))
    used = runner._lasting.get(BOX.id, STREAM).kept
    assert all(used[name].value is made[name].value for name in made), "it was made anew"
    assert runner.ahead(BOX, parts=True) is None and runner.ahead(None) is None


def test_what_cannot_be_made_ahead_is_said_by_the_job() -> None:
    missing = SceneSource(id="none", path="/nowhere/scene.glb")
    runner = JobRunner()
    ahead = runner.ahead(missing, parts=True)
    assert ahead is not None
    ahead()
    with pytest.raises(ServiceError, match="there is no scene"):
        runner.run(Locate(scene=missing, view=View(width=8, height=8)))


def test_a_scene_that_is_dropped_is_gone(tmp_path: Path) -> None:
    """Pictures leave cycles that would hold it, with its textures, until there is enough else to look for."""
    file = tmp_path / "box.toml"
    file.write_text('[[geometry]]\nshape = "box"\n')
    source, runner = SceneSource(id="box", path=str(file)), JobRunner()
    gc.disable()
    try:
        render_at(runner, None, source)
        held = weakref.ref(runner._scenes.get(source))
        job = Forget(scene="box")
        runner.run(job)
        runner.tidy(job)
        assert held() is None
    finally:
        gc.enable()
