"""The page of formats is that of the table, and the table is that of the readers."""

from __future__ import annotations

import dataclasses
import io
import re
from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image

from torchrender.errors import ImageFileError
from torchrender.images.files import READ_SUFFIXES, read_image, read_image_bytes
from torchrender.images.ktx import has_ktx2
from torchrender.scene.files.formats import FORMATS, page
from torchrender.scene.files.gltf import materials
from torchrender.scene.files.gltf.extensions import SUPPORTED, unused_extensions
from torchrender.scene.files.plain import mtl
from torchrender.scene.files.source import MESH_SUFFIXES, SCENE_SUFFIX
from torchrender.scene.files.volume_file import SUFFIXES as VOLUMES
from torchrender.scene.material import Material

ROOT = Path(__file__).resolve().parents[3]


def test_the_page_is_that_of_the_table() -> None:
    assert (ROOT / "docs" / "formats.md").read_text() == page()


def test_the_table_lists_what_is_read() -> None:
    listed = {suffix for entry in FORMATS for suffix in entry.suffixes}
    assert {*MESH_SUFFIXES, SCENE_SUFFIX, *READ_SUFFIXES, *VOLUMES} <= listed


def test_every_material_extension_of_the_table_is_read() -> None:
    """By name in the reader's source, and fields of a material are all filled by it."""
    source = Path(materials.__file__).read_text()
    for name in SUPPORTED:
        if name.startswith("KHR_materials_") and name != "KHR_materials_variants":
            short = name.removeprefix("KHR_materials_")
            assert f'"{short}"' in source or name in source, name
    phong = {"specular", "gloss", "shininess", "name", "samplers"}
    for field in dataclasses.fields(Material):
        if field.name not in phong:
            assert re.search(rf"\b{field.name}\b", source), field.name


def test_every_mtl_word_of_the_table_is_read() -> None:
    source = Path(mtl.__file__).read_text().lower()
    entry = next(f for f in FORMATS if ".mtl" in f.suffixes)
    for word in re.findall(r"\b(?:map_\w+|K[dse]|N[si]|P\w{1,2}|Tr|illum|norm)\b", entry.read):
        assert f'"{word.lower()}"' in source, word


def test_unknown_extensions_are_found_at_any_depth() -> None:
    document = {
        "extensions": {"A": {}, "KHR_lights_punctual": {"lights": [{"extensions": {"B": {}}}]}},
        "nodes": [{"extensions": {"A": {}}, "extras": {"extensions": {"C": {}}}}],
    }
    assert unused_extensions(document) == {"A": 2, "B": 1}
    deep: dict[str, object] = {}
    for _ in range(10_000):
        deep = {"x": deep}
    assert not unused_extensions(deep)


# --------------------------------------------------------------------- pictures


def radiance(size: str, codes: np.ndarray) -> bytes:
    return b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n" + size.encode() + b"\n" + codes.tobytes()


@pytest.mark.parametrize(
    ("size", "lie"),
    [
        ("-Y 3 +X 2", lambda p: p), ("+Y 3 +X 2", lambda p: p[::-1]), ("-Y 3 -X 2", lambda p: p[:, ::-1]),
        ("+Y 3 -X 2", lambda p: p[::-1, ::-1]), ("+X 2 -Y 3", lambda p: p.transpose(1, 0, 2)),
        ("+X 2 +Y 3", lambda p: p[::-1].transpose(1, 0, 2)), ("-X 2 -Y 3", lambda p: p[:, ::-1].transpose(1, 0, 2)),
        ("-X 2 +Y 3", lambda p: p[::-1, ::-1].transpose(1, 0, 2)),
    ],
)  # fmt: skip
def test_radiance_pictures_of_every_orientation(size: str, lie: object) -> None:
    """The same picture, its scan lines stored as the size line says: X and Y, up and down, left and right."""
    codes = np.full((3, 2, 4), 129, np.uint8)
    codes[..., 0] = [[10, 20], [30, 40], [50, 60]]
    expected = read_image_bytes(radiance("-Y 3 +X 2", codes), "a.hdr")
    stored = np.ascontiguousarray(lie(codes))  # type: ignore[operator]
    torch.testing.assert_close(read_image_bytes(radiance(size, stored), "a.hdr"), expected)
    assert expected[:, :, 0].argmax() == 5


def test_other_radiance_pictures_are_refused() -> None:
    codes = np.zeros((3, 2, 4), np.uint8)
    with pytest.raises(ImageFileError, match="without a size line"):
        read_image_bytes(radiance("-Y 3 +Y 2", codes), "a.hdr")
    with pytest.raises(ImageFileError, match="XYZE"):
        read_image_bytes(radiance("-Y 3 +X 2", codes).replace(b"rgbe", b"xyze"), "a.hdr")


def test_codes_can_be_read_as_they_are(tmp_path: Path) -> None:
    Image.new("RGBA", (2, 2), (51, 102, 204, 153)).save(tmp_path / "a.png")
    assert read_image(tmp_path / "a.png", encoded=True)[0, 0].tolist() == pytest.approx([0.2, 0.4, 0.8, 0.6])


def test_ktx2_pictures() -> None:
    with pytest.raises(ImageFileError, match="cut off KTX2"):
        read_image_bytes(b"\xabKTX 20\xbb\r\n\x1a\n" + bytes(20), "a.ktx2")
    head = b"\xabKTX 20\xbb\r\n\x1a\n" + (0).to_bytes(4, "little") + (1).to_bytes(4, "little")
    wide = head + (2**20).to_bytes(4, "little") * 2 + bytes(60)
    with pytest.raises(ImageFileError, match="declares 1048576 x 1048576 pixels"):
        read_image_bytes(wide, "a.ktx2")
    small = head + (4).to_bytes(4, "little") * 2 + bytes(60)
    with pytest.raises(ImageFileError, match="damaged or unsupported KTX2" if has_ktx2() else "pip install"):
        read_image_bytes(small, "a.ktx2")


def test_webp_bmp_and_tga() -> None:
    for kind in ("WEBP", "BMP", "TGA"):
        file = io.BytesIO()
        Image.new("RGB", (3, 2), (255, 0, 0)).save(file, kind)
        assert read_image_bytes(file.getvalue(), f"a.{kind.lower()}").shape == (2, 3, 3)
