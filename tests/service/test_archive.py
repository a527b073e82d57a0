"""Scenes of several files: what an archive may hold, and what is made of it."""

from __future__ import annotations

import io
import zipfile
from pathlib import Path
from typing import Any

import pytest
import torch
from PIL import Image as PilImage

import torchrender as tr
from gltf_builder import Glb
from torchrender.errors import NotUsedWarning, SceneFileError, TorchRenderError
from torchrender_service.errors import ServiceError
from torchrender_service.renderers.jobs import SceneSource, Validate
from torchrender_service.renderers.scene_cache import SceneCache
from torchrender_service.renderers.upload import validate
from torchrender_service.renderers.uploads.archive import main_file, unpack

OBJ = b"mtllib sub/look.mtl\nv 0 0 0\nv 1 0 0\nv 1 1 0\nusemtl red\nf 1 2 3\n"


def archive(path: Path, files: dict[str, bytes], method: int = zipfile.ZIP_DEFLATED) -> Path:
    with zipfile.ZipFile(path, "w", method) as out:
        for name, data in files.items():
            out.writestr(name, data)
    return path


def checked(tmp_path: Path, files: dict[str, bytes], **limits: int) -> dict[str, Any]:
    path = archive(tmp_path / "scene.zip", files)
    job = {"max_triangles": 1000, "max_texture_pixels": 10_000, **limits}
    return validate(Validate(path=str(path), kind="zip", **job))


def picture(side: int) -> bytes:
    out = io.BytesIO()
    PilImage.new("RGB", (side, side), (200, 30, 30)).save(out, "PNG")
    return out.getvalue()


def test_a_set_of_files_is_one_scene(tmp_path: Path) -> None:
    mtl = b"newmtl red\nKd 1 1 1\nmap_Kd -s 1 1 1 red.png\n"
    files = {"a/b.obj": OBJ, "a/sub/look.mtl": mtl, "a/red.png": picture(8), "a/more.txt": b"x", ".hidden": b""}
    facts = checked(tmp_path, files)
    assert facts["main"] == "files/a/b.obj"
    assert facts["triangles"] == 1
    assert facts["report"]["not_used"] == ["file a/more.txt"]
    loaded = SceneCache().get(SceneSource(id="x", path=str(tmp_path / facts["main"])))
    red = next(m for m in loaded.materials if m.name == "red")
    assert red.diffuse_texture is not None and tuple(red.diffuse_texture.shape[:2]) == (8, 8)


def test_gltf_with_its_buffers(tmp_path: Path) -> None:
    made = Glb()
    made.mesh()
    made.json.setdefault("nodes", [{"mesh": 0}])
    whole = made.bytes()
    facts = checked(tmp_path, {"one.glb": whole})
    assert facts["triangles"] == 1 and facts["main"] == "files/one.glb"


def test_points_are_shown_as_discs(tmp_path: Path) -> None:
    head = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
    head += "".join(f"property uchar {name}\n" for name in ("red", "green", "blue", "alpha"))
    head += "property float wind\nend_header\n"
    with pytest.warns(NotUsedWarning, match="wind"):
        facts = checked(
            tmp_path, {"p.ply": (head + "0 0 0 9 9 9 255 0\n1 0 0 9 9 9 99 0\n0 1 0 9 9 9 255 0\n").encode()}
        )
    assert facts["triangles"] == 12
    assert any("points" in note for note in facts["report"]["read"])
    told = " ".join(facts["report"]["not_used"])
    assert "wind" in told and "opacity of points: opaque ones are shown (1)" in told


def test_a_cloud_of_a_body_is_orbited(tmp_path: Path) -> None:
    ball = tr.Mesh.sphere(1.0, segments=16)
    normals = torch.nn.functional.normalize(ball.vertices, dim=1)
    rows = "\n".join(" ".join(f"{v:.6f}" for v in (*p, *n)) for p, n in zip(ball.vertices, normals, strict=True))
    names = "".join(f"property float {name}\n" for name in ("x", "y", "z", "nx", "ny", "nz"))
    head = f"ply\nformat ascii 1.0\nelement vertex {len(normals)}\n{names}end_header\n"
    facts = checked(tmp_path, {"ball.ply": (head + rows).encode()})
    assert facts["controls"] == "orbit" and facts["report"]["not_used"] == []


@pytest.mark.parametrize(
    "name", ["../out.obj", "/out.obj", "a/../../out.obj", "c:/out.obj", "a\\..\\..\\out.obj", "n" * 300 + ".obj"]
)
def test_names_that_lead_elsewhere(tmp_path: Path, name: str) -> None:
    with pytest.raises(SceneFileError, match="plain files"):
        checked(tmp_path, {name: OBJ})
    assert not list(tmp_path.parent.glob("out.obj"))


def test_a_link_is_no_file(tmp_path: Path) -> None:
    info = zipfile.ZipInfo("link.obj")
    info.external_attr = 0o120777 << 16
    with zipfile.ZipFile(tmp_path / "scene.zip", "w") as out:
        out.writestr(info, "/etc/passwd")
    with pytest.raises(SceneFileError, match="plain files"):
        unpack(tmp_path / "scene.zip", tmp_path / "files", 10**6)


@pytest.mark.parametrize("line", [b"mtllib ../../secret.mtl", b"mtllib /etc/hosts", b"map_Kd ..\\..\\x.png"])
def test_scenes_do_not_name_files_elsewhere(tmp_path: Path, line: bytes) -> None:
    with pytest.raises(SceneFileError, match="elsewhere"):
        checked(tmp_path, {"a.obj": line + b"\n" + OBJ})


def test_an_archive_does_not_explode(tmp_path: Path) -> None:
    with pytest.raises(ServiceError, match="unpacks to more"):
        checked(tmp_path, {"a.obj": OBJ, "zeros.bin": bytes(2**24)})
    with pytest.raises(ServiceError, match="unpacks to more"):
        checked(tmp_path / "..", {"a.obj": OBJ}, max_bytes=10)


def test_limits_count_in_archives_too(tmp_path: Path) -> None:
    mtl = b"newmtl red\nmap_Kd red.png\n"
    with pytest.raises(ServiceError, match="texture pixels"):
        checked(tmp_path, {"a.obj": OBJ, "sub/look.mtl": mtl, "red.png": picture(128)})


def test_damage_is_named(tmp_path: Path) -> None:
    path = tmp_path / "scene.zip"
    path.write_bytes(b"PK\x03\x04 nothing")
    with pytest.raises(TorchRenderError, match="archive"):
        unpack(path, tmp_path / "files", 10**6)
    with pytest.raises(SceneFileError, match="holds no scene"):
        main_file(path, [Path("a.txt")])
