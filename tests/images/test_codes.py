"""Codes through tables, against division and the table itself."""

from __future__ import annotations

import numpy as np
import pytest

from torchrender.images.coded import linear, scaled
from torchrender.numerics.color import srgb_table
from torchrender.numerics.texels import coded


@pytest.mark.parametrize("kind", [np.uint8, np.uint16])
@pytest.mark.parametrize("channels", [1, 2, 3, 4])
def test_every_channel_has_its_table(monkeypatch: pytest.MonkeyPatch, kind: type, channels: int) -> None:
    monkeypatch.setattr(coded, "_CACHED", 10)
    most = np.iinfo(kind).max
    rng = np.random.default_rng(channels)
    codes = rng.integers(0, most + 1, (7, 5, channels)).astype(kind)
    codes[0, 0], codes[0, 1] = 0, most
    shares = codes.astype(np.float32) / np.float32(most)
    assert (scaled(codes).numpy() == shares).all()
    found, colors = linear(codes).numpy(), 1 if channels <= 2 else 3
    assert (found[..., :colors] == srgb_table(8 * codes.itemsize).numpy()[codes[..., :colors]]).all()
    assert (found[..., colors:] == shares[..., colors:]).all()
