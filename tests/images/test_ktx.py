"""Pictures of a real encoder: eight by eight texels of four colours, one of them half transparent."""

from __future__ import annotations

import io
from pathlib import Path

import pytest
import torch
from PIL import Image

from gltf_builder import Glb
from torchrender.errors import ImageFileError, NotUsedWarning
from torchrender.images import ktx
from torchrender.images.files import read_image
from torchrender.report.fuzz.coded import ktx2
from torchrender.scene.load import load

pytest.importorskip("opengl_basisu")

COLORS = torch.tensor([[[200, 40, 20, 255], [20, 180, 60, 255]], [[30, 60, 220, 255], [240, 240, 240, 128]]])


@pytest.mark.parametrize(("kind", "error"), [("etc1s", 6), ("uastc", 0)])
def test_both_codecs(tmp_path: Path, kind: str, error: int) -> None:
    (tmp_path / "a.ktx2").write_bytes(ktx2(kind))
    found = read_image(tmp_path / "a.ktx2", encoded=True)
    wanted = COLORS.repeat_interleave(4, 0).repeat_interleave(4, 1)
    assert found.shape == (8, 8, 4)
    assert float((found * 255 - wanted).abs().max()) < error + 0.5
    linear = read_image(tmp_path / "a.ktx2")
    assert float(linear[0, 0, 0]) == pytest.approx(((200 / 255 + 0.055) / 1.055) ** 2.4, abs=0.03)
    assert float(linear[7, 7, 3]) == pytest.approx(128 / 255, abs=0.01)


def textured(path: Path) -> Path:
    """A triangle with that picture, and a plain one for those who cannot read it."""
    plain = io.BytesIO()
    Image.new("RGB", (4, 4), (255, 0, 0)).save(plain, "PNG")
    glb = Glb(nodes=[{"mesh": 0}], extensionsUsed=["KHR_texture_basisu"])
    glb.json["images"] = [{"bufferView": glb.view(d)} for d in (plain.getvalue(), ktx2("uastc"))]
    glb.json["textures"] = [{"source": 0, "extensions": {"KHR_texture_basisu": {"source": 1}}}]
    glb.json["materials"] = [{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}]
    glb.mesh(material=0)
    return glb.write(path)


def test_gltf_files_take_it_and_say_where_they_cannot(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = textured(tmp_path / "a.glb")
    texture = load(path).materials[0].diffuse_texture
    assert texture is not None and texture.shape == (8, 8, 4)
    monkeypatch.setattr(ktx, "has_ktx2", lambda: False)
    with pytest.warns(NotUsedWarning, match=r"KHR_texture_basisu, the plain picture is taken.*torchrender\[ktx\]"):
        texture = load(path).materials[0].diffuse_texture
    assert texture is not None and texture.shape == (4, 4, 3)


def test_cut_off_files_are_refused(tmp_path: Path) -> None:
    for size in (90, 150, 200, 250):
        (tmp_path / "a.ktx2").write_bytes(ktx2("uastc")[:size])
        with pytest.raises(ImageFileError, match="KTX2"):
            read_image(tmp_path / "a.ktx2")
