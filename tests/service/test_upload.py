"""What is asked of a scene before it is kept, and the store that keeps it."""

from __future__ import annotations

import asyncio
import base64
import io
import json
import struct
import time
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Any

import pytest
from PIL import Image as PilImage

from gltf_builder import Glb
from torchrender.errors import InputError, NotUsedWarning, SceneFileError, TorchRenderError
from torchrender.report.fuzz.seeds import seeds
from torchrender.scene.load import load
from torchrender_service.errors import ServiceError
from torchrender_service.load_test.files import large_texture_glb
from torchrender_service.renderers.jobs import SceneSource, Validate, View
from torchrender_service.renderers.scene_cache import SceneCache
from torchrender_service.renderers.upload import check_toml_text, validate
from torchrender_service.renderers.views import camera_of_view
from torchrender_service.renderers.worker import failure_of
from torchrender_service.scenes.store import SceneStore
from torchrender_service.settings import Settings, read_settings
from torchrender_service.web.schemas import SceneFacts

BOX = b'name = "box"\n[[geometry]]\nshape = "box"\nsize = 1.0\n'


def checked(tmp_path: Path, data: bytes, kind: str = "glb", **limits: int) -> dict[str, Any]:
    path = tmp_path / f"scene.{kind}"
    path.write_bytes(data)
    return validate(
        Validate(path=str(path), kind=kind, **{"max_triangles": 1000, "max_texture_pixels": 10_000, **limits})
    )


def glb(**json_parts: Any) -> Glb:
    made = Glb(**json_parts)
    made.mesh()
    made.json.setdefault("nodes", [{"mesh": 0}])
    return made


def test_good_files_are_described(tmp_path):
    facts = checked(tmp_path, glb().bytes())
    assert facts["triangles"] == 1
    facts = checked(tmp_path, BOX, "toml")
    assert (facts["triangles"], facts["name"]) == (12, "box")


def test_what_a_file_was_read_as_is_told(tmp_path):
    made = glb(
        materials=[{"extensions": {"KHR_materials_volume": {}}}], nodes=[{"mesh": 0}, {}], scenes=[{"nodes": [0, 1]}]
    )
    made.json["meshes"][0]["primitives"][0]["material"] = 0
    sampler = {"input": made.accessor([0.0, 2.0]), "output": made.accessor([[0.0, 0, 0], [1.0, 0, 0]])}
    channel = {"sampler": 0, "target": {"node": 0, "path": "translation"}}
    made.json["animations"] = [{"name": "Walk", "channels": [channel], "samplers": [sampler]}]
    with pytest.warns(NotUsedWarning, match="KHR_materials_volume"):
        facts = checked(tmp_path, made.bytes())
    assert facts["report"]["not_used"] == ["KHR_materials_volume (1)"] and facts["animations"] == {"Walk": 2.0}
    assert "meshes (1)" in facts["report"]["read"]
    SceneFacts(id="a" * 64, built_in=False, kind="glb", bytes=1, **facts)


@pytest.mark.parametrize("name", ["glb draco", "glb meshopt", "glb moving"])
def test_compressed_and_moving_files_are_kept_within_limits(tmp_path, name):
    assert checked(tmp_path, seeds()[name][1])["triangles"] >= 1
    with pytest.raises((ServiceError, SceneFileError), match="may have at most"):
        checked(tmp_path, seeds()[name][1], max_triangles=0 if name == "glb moving" else 1)


@pytest.mark.parametrize(
    ("group", "entry"),
    [
        ("buffers", {"uri": "../../../etc/passwd", "byteLength": 10}),
        ("buffers", {"uri": "/etc/passwd", "byteLength": 10}),
        ("buffers", {"uri": "file:///etc/passwd", "byteLength": 10}),
        ("images", {"uri": "..%2f..%2fsecret.png"}),
        ("images", {"uri": "http://example.org/a.png"}),
        ("images", {"uri": 7}),
    ],
)
def test_nothing_outside_the_file_is_read(tmp_path, group, entry):
    made = glb()
    made.json[group] = [*made.json.get(group, []), entry]
    with pytest.raises(SceneFileError, match="inside the file"):
        checked(tmp_path, made.bytes())


@pytest.mark.parametrize("key", ["file", "texture", "density_file"])
@pytest.mark.parametrize(
    "text", ["[[geometry]]\n{} = '{}'", "[[material]]\nname = 'a'\n{} = '{}'", "[environment]\n{} = '{}'", "{} = '{}'"]
)
def test_scene_files_must_not_name_files(tmp_path, key, text):
    (tmp_path / "other.glb").write_bytes(glb().bytes())
    for name in ("other.glb", "../../etc/passwd", "/etc/passwd"):
        with pytest.raises(SceneFileError, match="must not name files"):
            checked(tmp_path, text.format(key, name).encode(), "toml")


def test_one_mesh_placed_a_thousand_times(tmp_path):
    """A small file that declares more than it may."""
    many = glb(nodes=[{"mesh": 0}] * 1001, scenes=[{"nodes": list(range(1001))}])
    with pytest.raises(ServiceError, match="at most 1000 triangles, this one declares 1001"):
        checked(tmp_path, many.bytes())


def test_vertices_without_triangles_count_too(tmp_path):
    made = Glb()
    made.mesh([[0.0, 0.0, float(k)] for k in range(900)], [[0, 1, 2]])
    made.json["nodes"] = [{"mesh": 0}] * 10
    made.json["scenes"] = [{"nodes": list(range(10))}]
    with pytest.raises(ServiceError, match="vertices, this one declares 9000"):
        checked(tmp_path, made.bytes())


@pytest.mark.parametrize("count", [2**31, 2**40, 10**30, -5, 1.5])
def test_huge_counts(tmp_path, count):
    made = glb()
    made.json["accessors"][0]["count"] = count
    with pytest.raises(TorchRenderError):
        checked(tmp_path, made.bytes())


def test_sparse_accessors_without_data(tmp_path):
    made = glb()
    made.json["accessors"][0] = {"componentType": 5126, "count": 10**9, "type": "VEC3", "sparse": {"count": 0}}
    with pytest.raises(TorchRenderError):
        checked(tmp_path, made.bytes())


@pytest.mark.parametrize("inside", [True, False])
def test_pictures_that_unpack_to_too_much(tmp_path, inside):
    out = io.BytesIO()
    PilImage.new("L", (400, 300)).save(out, format="PNG")
    made = glb()
    if inside:
        made.json["images"] = [{"bufferView": made.view(out.getvalue()), "mimeType": "image/png"}]
    else:
        made.json["images"] = [{"uri": "data:image/png;base64," + base64.b64encode(out.getvalue()).decode()}]
    with pytest.raises(ServiceError, match="texture pixels, this one declares 120000"):
        checked(tmp_path, made.bytes())


def test_procedural_geometry_is_counted_before_it_is_built(tmp_path):
    for text in (
        '[[geometry]]\nprocedural = "city"\ntriangles = 3000000\n',
        '[[geometry]]\nprocedural = "city"\n',
        '[[geometry]]\nshape = "sphere"\nsegments = 2048\n',
        BOX.decode() + '[[geometry]]\nprocedural = "cornell_box"\n' * 12,
    ):
        with pytest.raises(ServiceError, match="at most 1000 triangles"):
            checked(tmp_path, text.encode(), "toml")


@pytest.mark.parametrize(
    "data",
    [
        b"",
        b"glTF",
        b"\0" * 100,
        b"glTF" + struct.pack("<II", 2, 2**31),
        b'{"asset": {"version": "2.0"}}',
        struct.pack("<4sII", b"glTF", 2, 28) + struct.pack("<II", 8, 0x4E4F534A) + b"[[[[[[[[",
    ],
)
def test_files_that_are_no_glb(tmp_path, data):
    with pytest.raises(TorchRenderError):
        checked(tmp_path, data)


@pytest.mark.parametrize(
    "change",
    [
        {"nodes": 7},
        {"nodes": [{"mesh": 0, "children": 5}]},
        {"nodes": [{"mesh": 0, "children": ["x"]}]},
        {"nodes": [{"mesh": [0]}]},
        {"meshes": [{"primitives": [{"attributes": {"POSITION": "a"}}]}]},
        {"meshes": [{"primitives": [7]}]},
        {"nodes": [{"mesh": 0, "matrix": "abc"}]},
        {"nodes": [{"mesh": 0, "scale": [1e308, 1e308, 1e308]}]},
        {"nodes": [{"mesh": 0, "translation": [1e300, 0, 0]}]},
        {"accessors": {"a": 1}},
        {"bufferViews": [[]]},
        {"materials": ["x"]},
        {"images": ["x"]},
        {"extensionsRequired": [{"a": []}]},
        {"asset": {"version": {"a": 1}}},
        {"scene": "x"},
        {"scenes": [{"nodes": None}]},
    ],
)
def test_every_kind_of_nonsense_is_a_typed_error_or_harmless(tmp_path, change):
    made = glb()
    made.json |= change
    try:
        checked(tmp_path, made.bytes())
    except TorchRenderError as error:
        assert failure_of(error).status == 422


def test_dotted_keys_nest_without_limit(tmp_path):
    deep = ".".join("a" * 3000)
    with pytest.raises(TorchRenderError):
        checked(tmp_path, f"{deep} = 1\n".encode(), "toml")


@pytest.mark.parametrize(
    "line",
    [
        "a" + ".a" * 45_000 + " = 1",
        "[" + ".".join(["'a'"] * 30_000) + "]",
        "x = {a = 1, " + 'a . "b c" .' * 9_000 + "c = 1}",
    ],
    ids=["key", "table", "inline"],
)
def test_keys_of_many_parts_are_refused_before_they_are_parsed(tmp_path, line):
    """Parsing one of 90 KB takes ten seconds."""
    begin = time.process_time()
    with pytest.raises(SceneFileError, match="line 2: a key may have at most 16 parts"):
        check_toml_text(tmp_path, f"name = 'x'\n{line}\n".encode())
    assert time.process_time() - begin < 0.5


def test_what_looks_like_a_long_key_is_refused_in_linear_time(tmp_path):
    texts = ["a." * 15 + "a = 1\n", 'name = "' + "a.b" * 20 + '"\n', "a" * 500_000, ", " * 250_000, '"' * 100_001]
    for text in texts:
        begin = time.process_time()
        check_toml_text(tmp_path, text.encode())
        assert time.process_time() - begin < 0.5


def test_long_names_are_shown_cut_and_cameras_found_by_what_is_shown(tmp_path):
    name = "n" * 3_000_000
    camera = {"type": "perspective", "perspective": {"yfov": 1.0, "znear": 0.1}, "name": name}
    made = glb(cameras=[camera], nodes=[{"mesh": 0, "name": name}, {"camera": 0, "name": name}])
    made.json |= {"scenes": [{"nodes": [0, 1], "name": name}], "scene": 0}
    facts = checked(tmp_path, made.bytes())
    assert len(json.dumps(facts)) < 20_000 and [len(one) for one in facts["cameras"]] == [80]
    scene = load(tmp_path / "scene.glb")
    view = View(width=8, height=8, name=facts["cameras"][0])
    assert camera_of_view(scene, view).width == 8
    with pytest.raises(InputError):
        camera_of_view(scene, View(width=8, height=8, name="nobody"))


def test_a_texture_that_is_small_as_a_file_counts_by_its_texels(tmp_path):
    assert checked(tmp_path, large_texture_glb(64))["triangles"] == 1
    data = large_texture_glb(2048)
    assert len(data) < 40_000
    with pytest.raises(ServiceError, match="texture pixels"):
        checked(tmp_path, data)


def test_a_scene_that_goes_while_it_is_wanted_is_not_found(tmp_path):
    with pytest.raises(ServiceError) as caught:
        SceneCache().get(SceneSource(id="a" * 64, path=str(tmp_path / "gone.glb")))
    assert caught.value.status == 404 and "a" * 64 in caught.value.detail


def test_empty_scenes_and_too_many_lights(tmp_path):
    with pytest.raises(ServiceError, match="no triangles"):
        checked(tmp_path, b'name = "nothing"\n', "toml")
    lights = '[[light]]\ntype = "point"\nposition = [0, 2, 0]\n' * 65
    with pytest.raises(ServiceError, match="64 lights"):
        checked(tmp_path, BOX + lights.encode(), "toml")


def test_messages_do_not_name_paths_of_the_server(tmp_path):
    try:
        checked(tmp_path, b"nonsense = [", "toml")
    except SceneFileError as error:
        assert str(tmp_path) in str(error)
        assert str(tmp_path) not in failure_of(error).detail


# ------------------------------------------------------------------ the store


class NoPool:
    """Stands in for the renderers: agrees to everything but what starts with ``bad``."""

    async def inspect(self, job: Validate) -> dict[str, Any]:
        if Path(job.path).read_bytes().startswith(b"bad"):
            raise ServiceError(422, "scene-file", "bad")
        bounds = [[0.0] * 3, [1.0] * 3]
        return {"name": "x", "triangles": 1, "lights": 0, "cameras": [], "bounds": bounds, "diagonal": 1.0}

    def forget(self, job: Any) -> None:
        del job


async def chunks(data: bytes) -> AsyncIterator[bytes]:
    for at in range(0, len(data), 5):
        yield data[at : at + 5]


def store_in(folder: Path, **settings: Any) -> SceneStore:
    made = SceneStore(read_settings(None, {}, data_dir=str(folder), **settings), NoPool())  # type: ignore[arg-type]
    made.open()
    return made


def keep(store: SceneStore, data: bytes, kind: str = "glb", name: str | None = None) -> tuple[dict[str, Any], bool]:
    return asyncio.run(store.keep(chunks(data), kind, name))


def test_scenes_survive_a_restart(tmp_path):
    facts, new = keep(store_in(tmp_path), b"some scene", name="../../name")
    assert new and facts["name"] == "../../name"
    again = store_in(tmp_path)
    assert facts["id"] in again.names
    assert asyncio.run(again.facts(facts["id"])) == facts
    source = again.source(facts["id"])
    assert source.path is not None and Path(source.path).read_bytes() == b"some scene"
    assert Path(source.path).resolve().is_relative_to(tmp_path.resolve())


def test_the_same_scene_is_kept_once(tmp_path):
    store = store_in(tmp_path)
    first, second = keep(store, b"abc"), keep(store, b"abc", name="other")
    assert (first[1], second[1]) == (True, False)
    assert first[0] == second[0]
    assert keep(store, b"abc", "toml")[0]["id"] != first[0]["id"]
    assert len(list((tmp_path / "scenes").iterdir())) == 2


def test_at_once(tmp_path):
    store = store_in(tmp_path)

    async def both() -> list[tuple[dict[str, Any], bool]]:
        return list(await asyncio.gather(*(store.keep(chunks(b"same"), "glb", None) for _ in range(4))))

    made = asyncio.run(both())
    assert sum(new for _, new in made) == 1
    assert len(list((tmp_path / "scenes").iterdir())) == 1


def test_what_is_refused_leaves_nothing(tmp_path):
    store = store_in(tmp_path, max_upload_bytes=20)
    for data, status in ((b"bad", 422), (b"", 422), (b"x" * 21, 413)):
        with pytest.raises(ServiceError) as caught:
            keep(store, data)
        assert caught.value.status == status
    assert list((tmp_path / "scenes").iterdir()) == []


def test_what_was_not_finished_is_removed(tmp_path):
    store_in(tmp_path)
    (tmp_path / "scenes" / ".unfinished-1").mkdir()
    (tmp_path / "scenes" / ("a" * 64)).mkdir()
    half = tmp_path / "scenes" / ("b" * 64)
    half.mkdir()
    (half / "facts.json").write_text(json.dumps({"id": "b" * 64, "kind": "glb", "bytes": 5}))
    (half / "scene.glb").write_bytes(b"cut")
    store = store_in(tmp_path)
    assert not (tmp_path / "scenes" / ".unfinished-1").exists()
    assert store.names == list(Settings().built_in)


def test_deleting(tmp_path):
    store = store_in(tmp_path)
    facts, _ = keep(store, b"abc")
    asyncio.run(store.delete(facts["id"]))
    assert list((tmp_path / "scenes").iterdir()) == []
    for scene, status in ((facts["id"], 404), ("cornell_box", 403), ("..", 404), ("scenes", 404)):
        with pytest.raises(ServiceError) as caught:
            asyncio.run(store.delete(scene))
        assert caught.value.status == status


def test_a_full_store(tmp_path):
    store = store_in(tmp_path, max_scenes=1)
    keep(store, b"abc")
    with pytest.raises(ServiceError, match="full") as caught:
        keep(store, b"abcd")
    assert caught.value.status == 409
    small = store_in(tmp_path / "b", max_store_bytes=4)
    with pytest.raises(ServiceError, match="full"):
        keep(small, b"abcde")
