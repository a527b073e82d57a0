"""The voxel study: its baselines are right, and a tiny run from end to end."""

from __future__ import annotations

from pathlib import Path

import pytest
import torch

from torchrender.errors import OptionError
from torchrender.report.voxels.baselines import layered_depths, slices, three_sheets
from torchrender.report.voxels.models import bumpy_ring
from torchrender.report.voxels.peers import SURFACES, agreement, peer_solid, peer_surface
from torchrender.report.voxels.study import QUICK, run
from torchrender.voxels.grid import make_grid
from torchrender.voxels.solid import voxelize_solid
from torchrender.voxels.surface import SurfaceOptions, voxelize_surface

THIN = SurfaceOptions(mode="thin")


def test_baselines_find_the_same_cells() -> None:
    ring = bumpy_ring(3000)
    for dims in ((40, 40, 40), (30, 64, 17)):
        grid = make_grid(ring.bounds[None], dims)
        thin = voxelize_surface(ring.vertices[None], ring.faces, grid, THIN)
        assert slices(ring.vertices, ring.faces, grid).equals(thin)
        sheets = three_sheets(ring.vertices, ring.faces, grid)
        assert sheets.voxels.equals(thin) and sheets.pairs >= thin.stats["pairs"]
        for chunk in (1000, 5001):
            again = three_sheets(ring.vertices, ring.faces, grid, pair_chunk=chunk)
            assert again.voxels.equals(thin) and again.pairs == sheets.pairs
        solid, _ = voxelize_solid(ring.vertices[None], ring.faces, grid)
        layered = layered_depths(ring, grid)
        assert (solid - layered).count + (layered - solid).count <= 0.003 * solid.count
    with pytest.raises(OptionError, match="pair_chunk must be"):
        three_sheets(ring.vertices, ring.faces, grid, pair_chunk=1)


def test_the_ring_is_closed_and_of_the_size_asked_for() -> None:
    ring = bumpy_ring(5000)
    assert 4500 < ring.triangle_count <= 5000
    _, report = voxelize_solid(ring.vertices[None], ring.faces, make_grid(ring.bounds[None], 16))
    assert report.closed and report.leaking_share == 0


@pytest.mark.parametrize("name", SURFACES)
def test_peers_are_measured_or_say_why_not(name: str) -> None:
    ring = bumpy_ring(400)
    for measure, solid in ((peer_surface, False), (peer_solid, True)):
        found, seconds, why = measure(name, ring, 0.1)
        assert (found is None) == bool(why)
        if found is not None:
            shares = agreement(found, ring, solid)
            assert seconds > 0 and shares["cells"] > 0
            assert shares["missing"] < 0.3 and shares["extra"] < 0.4  # their grids are understood


@pytest.mark.filterwarnings("ignore:.*stanford_dragon.*repaired")
def test_study_writes_its_page(tmp_path: Path) -> None:
    torch.manual_seed(0)
    record = run(QUICK, tmp_path)
    page = (tmp_path / "voxels.md").read_text()
    for heading in ("Table 2.1", "Table 2.2", "Other programs", "Baselines", "Solids", "by triangles", "collision"):
        assert heading in page
    assert "DIFFER" not in page and "OTHER CELLS" not in page
    assert (tmp_path / "voxels.json").exists() and (tmp_path / "voxels.jpg").stat().st_size > 5000
    for row in record["solids"]:
        if row["closed"]:
            assert row["winding"] < 0.005 < row["toggle"]
            assert abs(row["error"]["32"]) < 0.02
    assert record["uses"]["collision"]["shared"] > 0
