"""The strip of an animated character: as many pictures as asked for, each of another moment."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from torchrender.errors import SceneFileError
from torchrender.report.gallery.animated import main


def test_a_strip_of_moments(data_dir: Path, tmp_path: Path) -> None:
    walker = str(data_dir / "characters" / "RiggedSimple.glb")
    assert main([walker, "-o", str(tmp_path / "a.jpg"), "--pictures", "2", "--size", "40x48"]) == 0
    strip = np.asarray(Image.open(tmp_path / "a.jpg"), np.float64)
    assert strip.shape == (48, 80, 3)
    # The floor stands still in the corner; the figure does not.
    first, second = strip[:, :40], strip[:, 40:]
    assert np.abs(first - second)[-6:, :6].mean() < 6.0 < np.abs(first - second).max()
    with pytest.raises(SceneFileError, match="no animation"):
        main([str(data_dir / "meshes" / "spot_textured.glb"), "-o", str(tmp_path / "b.jpg")])
