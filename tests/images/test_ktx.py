"""Pictures of a real encoder: eight by eight texels of four colours, one of them half transparent."""

from __future__ import annotations

import base64
import io
import zlib
from pathlib import Path

import pytest
import torch
from PIL import Image

from gltf_builder import Glb
from torchrender.errors import ImageFileError, NotUsedWarning
from torchrender.images import ktx
from torchrender.images.files import read_image
from torchrender.scene.load import load

pytest.importorskip("opengl_basisu")

# Made by alktx2 0.1.7 (Basis Universal's own encoder) out of the picture below; packed by zlib.
FILES = {
    "etc1s": (
        "c-mX-9TK5nWU!l;ONxsD2pEBw1BzjQ5ea7iu?-L}0b&&(J^@uT8%ifLLTF|NRA2+8nHVe>7Bez2Fas5Ez%8+dtNRZG4h;7E$"
        "b5Mq4RmICQD#YM5rb1=ab~eXXkKPnYEf}wj)IY%p#cK}8_-5GpgLY4HbAqR35r2ZlW>q}08$PT7v+0n8G;#DK%5JC>_H5HV7"
        "6o9desgF7X|?!yJZJ=%09b^^ACiCgocK)0!3D=TD6La;h+n|+)ww_Js1rb9l&<%6krr&0-G=;yk-%D0iyy)xPgO(VYV<I0Qz"
        "7wzW"
    ),
    "uastc": (
        "c-mX-9TK5nWU!l;ONxsD2pEBw1BzjQ5sE<|1Bi8icnXw82M3_E0~!re%fz6;u#Az3fti_sK>)6+o*Bma4+Qc+8tAO@qRf)iA"
        "_k|#;>==&(7epD)S}|V90emiLjwi|7Lcxb1_p7-)<^bR;o2FdH%)t9FY*=6zuw&byI#f}u0UK)PEMfY9Lzfm09x)M=K"
    ),
}
COLORS = torch.tensor([[[200, 40, 20, 255], [20, 180, 60, 255]], [[30, 60, 220, 255], [240, 240, 240, 128]]])


def content(kind: str) -> bytes:
    return zlib.decompress(base64.b85decode(FILES[kind]))


@pytest.mark.parametrize(("kind", "error"), [("etc1s", 6), ("uastc", 0)])
def test_both_codecs(tmp_path: Path, kind: str, error: int) -> None:
    (tmp_path / "a.ktx2").write_bytes(content(kind))
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
    glb.json["images"] = [{"bufferView": glb.view(d)} for d in (plain.getvalue(), content("uastc"))]
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
        (tmp_path / "a.ktx2").write_bytes(content("uastc")[:size])
        with pytest.raises(ImageFileError, match="KTX2"):
            read_image(tmp_path / "a.ktx2")
