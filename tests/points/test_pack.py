"""Models packed on disk: the same points and the same picture as of a model that was made at once."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch

import torchrender as tr
from torchrender.errors import NotUsedWarning, OptionError, PointFileError, RepairedWarning, SceneFileError
from torchrender.points import pack, pieces
from torchrender.points.pack import PackOptions, Splits, pack_points

COLUMNS = ["x", "y", "z", "nx", "ny", "nz", "red", "green", "blue", "radius"]
TYPES = ["float"] * 6 + ["uchar"] * 3 + ["float"]


def ball(count: int, seed: int = 0) -> np.ndarray:
    """Rows of points on a ball, with normals, colours and radii."""
    rng = np.random.default_rng(seed)
    normal = rng.normal(size=(count, 3))
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    radius = np.full((count, 1), 4.0 / np.sqrt(count))
    return np.concatenate([2.0 * normal + [5, 0, 0], normal, np.rint(127 + 120 * normal), radius], axis=1)


def write(path: Path, rows: np.ndarray, *, text: bool = False, names: list[str] = COLUMNS, first: bool = False) -> Path:
    """A PLY file; ``first`` puts another element in front of the points."""
    types = [TYPES[COLUMNS.index(n)] if n in COLUMNS else "float" for n in names]
    properties = "".join(f"property {t} {n}\n" for t, n in zip(types, names, strict=True))
    order = "ascii" if text else "binary_little_endian"
    camera = "element camera 1\nproperty float f\n" if first else ""
    head = f"ply\nformat {order} 1.0\n{camera}element vertex {len(rows)}\n{properties}"
    if text:
        body = "0.5\n" * first + "\n".join(" ".join(f"{v:.7g}" for v in row) for row in rows)
        path.write_text(head + "end_header\n" + body + "\n")
        return path
    table = np.zeros(len(rows), [(n, "<f4" if t == "float" else "u1") for n, t in zip(names, types, strict=True)])
    for k, name in enumerate(names):
        table[name] = rows[:, k]
    path.write_bytes((head + "end_header\n").encode() + np.float32(0.5).tobytes() * first + table.tobytes())
    return path


@pytest.mark.parametrize("text", [False, True])
def test_many_blocks_look_like_one(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, text: bool) -> None:
    source = write(tmp_path / "ball.ply", ball(24_000), text=text, first=True)
    monkeypatch.setattr(pieces, "ROWS", 5_000)
    monkeypatch.setattr(pack, "SAMPLE", 3_000)
    monkeypatch.setattr(pack, "POINT_BYTES", 5_000)
    built: list[int] = []
    make = pack.build_patches
    monkeypatch.setattr(pack, "build_patches", lambda cloud, o: built.append(len(cloud)) or make(cloud, o))
    options = PackOptions(memory_mb=135)
    said: list[tuple[str, float]] = []
    with pytest.warns(NotUsedWarning, match="camera"):
        size = pack_points(source, tmp_path / "a.trp", options, progress=lambda *step: said.append(step))
    assert size == (tmp_path / "a.trp").stat().st_size
    # As many blocks as the memory asks for, none larger, and nothing lost.
    assert len(built) >= 4 and max(built) <= options.block_points == 10_000 and sum(built) == 24_000
    assert [name for name, share in said if share == 1.0] == ["reading", "building", "writing"]
    packed = tr.open_points(tmp_path / "a.trp")
    with pytest.warns(NotUsedWarning, match="camera"):
        whole = tr.build_patches(tr.load_points(source))
    assert packed.point_count == 24_000 and not packed.two_sided
    torch.testing.assert_close(packed.bounds, whole.bounds, rtol=0, atol=1e-6)
    camera = whole.camera(width=128, height=128)
    first, second = (tr.render_points(p, camera) for p in (whole, packed))
    assert torch.equal(first.mask, second.mask) or float((first.mask != second.mask).float().mean()) < 2e-3
    assert float((first.image - second.image).abs().mean()) < 5e-3
    seen = first.mask & second.mask
    # Levels of detail differ where patches end: by less than a quarter of a point.
    assert float((first.depth - second.depth)[seen].abs().mean()) < 0.25 * 4.0 / 24_000**0.5
    assert not list(tmp_path.glob(".a-*"))


def test_one_block_is_the_model_itself(tmp_path: Path) -> None:
    source = write(tmp_path / "ball.ply", ball(3_000), names=["x", "y", "z"])
    pack_points(source, tmp_path / "a.trp")
    tr.write_points(tmp_path / "b.trp", tr.build_patches(tr.load_points(source)))
    assert (tmp_path / "a.trp").read_bytes() == (tmp_path / "b.trp").read_bytes()


def test_points_that_are_not_finite(tmp_path: Path) -> None:
    rows = ball(2_000)
    rows[::100, 1] = np.nan
    source = write(tmp_path / "nan.ply", rows)
    with pytest.raises(PointFileError, match="20 of 2000 points are NaN"):
        pack_points(source, tmp_path / "a.trp")
    with pytest.warns(RepairedWarning, match=r"dropped \(20\)"):
        pack_points(source, tmp_path / "a.trp", PackOptions(drop_invalid=True))
    assert tr.open_points(tmp_path / "a.trp").point_count == 1_980
    rows[:, 0] = np.inf
    with pytest.raises(PointFileError, match="no points that are finite"):
        pack_points(write(tmp_path / "inf.ply", rows), tmp_path / "b.trp", PackOptions(drop_invalid=True))
    assert not (tmp_path / "b.trp").exists()


def test_points_all_at_one_place_cannot_be_split(tmp_path: Path) -> None:
    assert Splits(np.zeros((1_000, 3)), 10**6, 100).leaves == 1
    rows = ball(500)
    rows[:, :3] = 1.0
    pack_points(write(tmp_path / "one.ply", rows), tmp_path / "a.trp")
    assert tr.open_points(tmp_path / "a.trp").point_count == 500


def test_what_is_not_packed_is_said(tmp_path: Path) -> None:
    source = write(tmp_path / "a.ply", ball(100))
    with pytest.raises(PointFileError, match=r"\.trp"):
        pack_points(source, tmp_path / "a.png")
    with pytest.raises(SceneFileError, match="no such file"):
        pack_points(tmp_path / "b.ply", tmp_path / "a.trp")
    with pytest.raises(OptionError, match="memory_mb"):
        PackOptions(memory_mb=1)
    clear = np.concatenate([ball(100)[:, :9], np.full((100, 1), 0.5)], axis=1)
    with pytest.raises(PointFileError, match="not opaque"):
        pack_points(write(tmp_path / "c.ply", clear, names=[*COLUMNS[:9], "alpha"]), tmp_path / "a.trp")
    cut = source.read_bytes()[:-5]
    (tmp_path / "d.ply").write_bytes(cut)
    with pytest.raises(SceneFileError, match="cut off"):
        pack_points(tmp_path / "d.ply", tmp_path / "a.trp")
    (tmp_path / "e.ply").write_text(
        "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
        "element face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n"
    )
    with pytest.raises(PointFileError, match="surfaces"):
        pack_points(tmp_path / "e.ply", tmp_path / "a.trp")
