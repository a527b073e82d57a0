"""Sets of spheres: they cover, they improve step by step, they follow what moves, and they are kept."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import torch

from torchrender.effects.sky_shadows.fit import _begin, fit_spheres
from torchrender.effects.sky_shadows.loosened import loosened
from torchrender.effects.sky_shadows.moving import Binding
from torchrender.effects.sky_shadows.occluder import content_key, kept_spheres, read_spheres, write_spheres
from torchrender.effects.sky_shadows.options import SphereOptions
from torchrender.errors import InputError, OptionError, SceneFileError
from torchrender.scene.shapes import sphere, torus

QUICK = SphereOptions(spheres=16, resolution=40, starts=1, teleports=8)


@pytest.fixture(scope="module")
def ring():  # type: ignore[no-untyped-def]
    mesh = torus(1.0, 0.35, 32)
    return mesh, fit_spheres(mesh.vertices, mesh.faces, QUICK)


def test_every_point_of_the_surface_is_covered(ring) -> None:  # type: ignore[no-untyped-def]
    mesh, found = ring
    for points, labels in (
        (mesh.vertices.double(), found.vertex_sphere),
        (mesh.vertices.double()[mesh.faces].mean(1), found.face_sphere),
    ):
        assert float(((points - found.centres[labels]).norm(dim=-1) - found.radii[labels]).max()) <= 0


def test_little_stands_out_and_every_step_helps(ring) -> None:  # type: ignore[no-untyped-def]
    _, found = ring
    assert found.relative_error <= 0.35
    assert list(found.history) == sorted(found.history, reverse=True)
    assert found.volume == pytest.approx(2 * math.pi**2 * 0.35**2, rel=0.06)


def test_more_spheres_stand_out_less(ring) -> None:  # type: ignore[no-untyped-def]
    mesh, few = ring
    found = fit_spheres(mesh.vertices, mesh.faces, replace(QUICK, spheres=32))
    assert found.relative_error <= 0.15 and found.error < 0.8 * few.error


def test_every_other_start_reaches_thin_limbs() -> None:
    """A dense ball with a few points far out: drawn at random few begin there, spread evenly they do."""
    rng = np.random.default_rng(0)
    limb = np.linspace([1.0, 0.0, 0.0], [6.0, 0.0, 0.0], 30)
    model: Any = SimpleNamespace(points=np.concatenate([0.3 * rng.normal(size=(3000, 3)), limb]))
    farthest = {}
    for spread in (False, True):
        begin = _begin(model, 8, np.random.default_rng(1), spread=spread)
        assert begin.shape == (8, 3) and len(np.unique(begin, axis=0)) == 8
        away = np.linalg.norm(model.points[:, None] - begin[None], axis=-1).min(axis=1)
        farthest[spread] = float(away.max())
    assert 3.0 * farthest[True] < farthest[False]
    assert len(_begin(model, 5000, rng, spread=True)) == len(model.points)


def test_spheres_turn_and_grow_with_the_mesh(ring) -> None:  # type: ignore[no-untyped-def]
    mesh, found = ring
    bound = Binding(found, mesh.vertices, mesh.faces)
    still = bound.at(mesh.vertices)
    assert torch.allclose(still[:, :3], found.centres, atol=1e-9)
    assert bool((still[:, 3] <= found.radii * (1 + 1e-9)).all())
    c, s = math.cos(0.7), math.sin(0.7)
    turn = torch.tensor([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]).double()
    moved = 2.5 * mesh.vertices.double() @ turn.T + torch.tensor([3.0, -1.0, 4.0]).double()
    now = bound.at(moved)
    wanted = 2.5 * found.centres @ turn.T + torch.tensor([3.0, -1.0, 4.0]).double()
    assert torch.allclose(now[:, :3], wanted, atol=1e-6)
    away = (moved - now[found.vertex_sphere, :3]).norm(dim=-1) - now[found.vertex_sphere, 3]
    assert float(away.max()) < 1e-9


def test_points_of_two_bodies_that_part_get_spheres_of_their_own() -> None:
    """Two balls side by side, one sphere over both: when they part, each follows its own."""
    ball = sphere(0.5, 16)
    vertices = torch.cat([ball.vertices.double(), ball.vertices.double() + torch.tensor([1.02, 0.0, 0.0]).double()])
    faces = torch.cat([ball.faces, ball.faces + len(ball.vertices)])
    found = fit_spheres(vertices, faces, SphereOptions(spheres=3, resolution=24, starts=1, teleports=0, seed=3))
    apart = vertices.clone()
    apart[len(ball.vertices) :, 0] += 10.0
    cleaned = Binding(loosened(found, vertices, faces, [apart]), vertices, faces).at(apart)
    assert float(cleaned[:, 3].max()) < 1.5
    plain = loosened(found, vertices, faces, [])
    assert plain is found


def test_sets_are_kept_by_content(ring, tmp_path, monkeypatch) -> None:  # type: ignore[no-untyped-def]
    import torchrender.effects.sky_shadows.occluder as occluder

    mesh, found = ring
    write_spheres(tmp_path / "set.npz", found)
    again = read_spheres(tmp_path / "set.npz")
    assert torch.equal(again.spheres, found.spheres) and again.history == found.history
    key = content_key(mesh.vertices, mesh.faces, QUICK)
    assert key != content_key(mesh.vertices * 2, mesh.faces, QUICK)
    monkeypatch.setattr(occluder, "cache_folder", lambda: tmp_path)
    (tmp_path / "sky_shadows").mkdir()
    write_spheres(tmp_path / "sky_shadows" / f"spheres_{key}.npz", found)
    monkeypatch.setattr(occluder, "fit_spheres", None)  # not called
    assert torch.equal(kept_spheres(mesh.vertices, mesh.faces, QUICK).radii, found.radii)
    (tmp_path / "torn.npz").write_bytes(b"no")
    for name in ("torn.npz", "none.npz"):
        with pytest.raises(SceneFileError):
            read_spheres(tmp_path / name)


def test_meshes_without_inside_are_covered_all_the_same() -> None:
    flat = torch.tensor([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    faces = torch.tensor([[0, 1, 2], [0, 2, 3]])
    found = fit_spheres(flat, faces, SphereOptions(spheres=8, resolution=16, starts=1, teleports=2))
    away = (flat.double() - found.centres[found.vertex_sphere]).norm(dim=-1) - found.radii[found.vertex_sphere]
    assert float(away.max()) <= 1e-12 and bool(torch.isfinite(found.spheres).all())


def test_bad_input_is_named() -> None:
    with pytest.raises(InputError, match="faces"):
        fit_spheres(torch.zeros(3, 3), torch.zeros(0, 3, dtype=torch.int64))
    with pytest.raises(InputError, match="vertices"):
        fit_spheres(torch.full((3, 3), torch.nan), torch.tensor([[0, 1, 2]]))
    with pytest.raises(OptionError, match="spheres"):
        SphereOptions(spheres=0)
