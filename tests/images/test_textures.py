"""Pictures read as textures: the numbers of the picture, kept as codes where these have 8 bits."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image as PilImage

from torchrender.images import coded
from torchrender.images.bounded import at_most
from torchrender.images.files import as_texture, read_image, read_texture
from torchrender.numerics.texels.coded import codes_of, is_followed
from torchrender.numerics.texture import halved_texture


@pytest.mark.parametrize("encoded", [True, False])
@pytest.mark.parametrize("mode", ["L", "LA", "RGB", "RGBA", "P", "1"])
def test_textures_have_the_numbers_of_their_pictures(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, mode: str, encoded: bool
) -> None:
    monkeypatch.setattr(coded, "_STRIP", 100)
    codes = np.random.default_rng(1).integers(0, 256, (24, 17, 4), dtype=np.uint8)
    path = tmp_path / "a.png"
    PilImage.fromarray(codes).convert(mode).save(path)
    found, wanted = read_texture(path, encoded=encoded), as_texture(read_image(path, encoded=encoded))
    monkeypatch.setattr(coded, "_STRIP", 1 << 20)
    whole = as_texture(read_image(path, encoded=encoded))
    assert torch.equal(found, wanted) and torch.equal(whole, wanted)
    kept = codes_of(found)
    assert kept is not None and is_followed(kept) and found.shape[2] == (4 if mode in ("LA", "RGBA", "P") else 3)


def test_deep_pictures_are_numbers(tmp_path: Path) -> None:
    path = tmp_path / "deep.png"
    PilImage.fromarray(np.arange(600, dtype=np.uint16).reshape(20, 30) * 100).save(path)
    found = read_texture(path)
    assert codes_of(found) is None and torch.equal(found, as_texture(read_image(path)))


def test_bounds_of_codes_are_their_own(tmp_path: Path) -> None:
    path = tmp_path / "a.png"
    PilImage.effect_noise((40, 32), 90).convert("RGB").save(path)
    whole = read_texture(path)
    with at_most(10, 40 * 32) as bound:
        assert read_texture(path).shape == (32, 40, 3) and not bound.lost
    with at_most(10, 40 * 32 - 1) as bound:
        assert torch.equal(read_texture(path), halved_texture(whole))
    assert dict(bound.lost) == {"texels of a texture of 40 x 32: 20 x 16 are kept": 1}
