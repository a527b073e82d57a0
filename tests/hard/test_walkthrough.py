"""Walkthroughs where numbers or photos are at their worst: specification 13, sections 11 and 13."""

from __future__ import annotations

import contextlib
import json
import warnings
import zipfile
from dataclasses import replace

import cv2
import numpy as np
import pytest
import torch

from torchrender.errors import CameraError, OptionError, SceneFileError
from torchrender.scene.camera import Cameras
from torchrender.scene.model import Scene
from torchrender.walkthrough.build import build_stages, build_walkthrough
from torchrender.walkthrough.classify import crease, fit_plane
from torchrender.walkthrough.density import Samples
from torchrender.walkthrough.draw import FILLED, PLANE, draw_walkthrough
from torchrender.walkthrough.drawing.culling import Occluders, visible_runs
from torchrender.walkthrough.file import read_walkthrough, write_walkthrough
from torchrender.walkthrough.frames.depth import step_edges
from torchrender.walkthrough.frames.exposure import apply_gain
from torchrender.walkthrough.frames.record import RgbdSequence
from torchrender.walkthrough.holes import fill_holes
from torchrender.walkthrough.model import Walkthrough, no_points
from torchrender.walkthrough.options import DrawOptions, WalkthroughOptions
from torchrender.walkthrough.points.clusters import box_around, build_points, cluster_points
from walkthrough_scenes import capture, photos, quad, room, views

OPTIONS = WalkthroughOptions(n_min=80)


@pytest.fixture(autouse=True)
def quiet():
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        yield


# ------------------------------------------------------------------ section 13


def test_inverse_depth_is_affine_on_planes():
    rng = np.random.default_rng(0)
    u, v = np.meshgrid(np.arange(64) + 0.5, np.arange(48) + 0.5)
    for _ in range(50):
        n = rng.normal(size=3)
        n /= np.linalg.norm(n)
        ray = np.stack([(u - 32) / 60, (v - 24) / 60, np.ones_like(u)], -1)
        q = ray @ n / rng.uniform(0.5, 3)
        assert np.abs(q[:, 2:] - 2 * q[:, 1:-1] + q[:, :-2]).max() <= 1e-12
        assert crease(q, np.ones_like(q), 1.0, 1).max() <= 1e-12


def test_creases_and_steps_are_detected():
    u = np.arange(64) + 0.5
    z = np.tile(np.where(u < 32, 2.0, 2.0 + 0.5 * (u - 32) * 2 / 60), (48, 1))
    assert (crease(1 / z, z, 60.0, 1)[24, 30:34] > 0.08).any() and crease(1 / z, z, 60.0, 1)[24, 5:28].max() < 0.01
    step = np.tile(np.where(u < 32, 2.0, 2.2), (48, 1)).astype(np.float32)
    assert step_edges(step, 0.03)[24, 31:33].all() and not step_edges(step, 0.2).any()
    step[:, 40:] = np.inf
    assert step_edges(step, 0.2)[:, 39:41].all()


def test_plane_fits_to_the_last_digit():
    rng = np.random.default_rng(1)
    for _ in range(20):
        n = rng.normal(size=3)
        n /= np.linalg.norm(n)
        a = np.linalg.svd(n[None])[2][1:]
        p = rng.normal(size=(300, 2)) @ a + 2.5 * n
        normal, offset, centroid = fit_plane(p)
        turn = np.sign(normal @ n)
        assert np.degrees(np.arccos(min(abs(normal @ n), 1.0))) < 0.01 and abs(turn * offset - 2.5) < 1e-6
        assert np.allclose(centroid, p.mean(0))


def test_density_ratio_is_the_jacobian():
    """From the homography, from densities, and by finite differences (section 4)."""
    rng = np.random.default_rng(2)
    k = np.array([[300.0, 0, 160], [0, 310.0, 120], [0, 0, 1]])
    done = 0
    while done < 100:
        turn, _ = cv2.Rodrigues(rng.normal(size=3) * 0.3)
        shift = rng.normal(size=3) * 0.4
        n = np.array([0, 0, -1.0]) + rng.normal(size=3) * 0.4
        n /= np.linalg.norm(n)
        d = n @ [0, 0, rng.uniform(1.5, 3)]
        pixel = np.array([rng.uniform(60, 260), rng.uniform(40, 200), 1.0])
        ray = np.linalg.inv(k) @ pixel
        z = d / (n @ ray)
        q = turn @ (ray * z) + shift
        if z < 0.3 or q[2] < 0.3 or n @ ray > -0.15 or (turn @ n) @ q > -0.1:
            continue
        h = k @ (turn + np.outer(shift, n) / d) @ np.linalg.inv(k)
        w = (h @ pixel)[2]
        by_homography = abs(np.linalg.det(h)) / abs(w) ** 3
        own = k[0, 0] * k[1, 1] * abs(n @ (ray * z)) / z**3
        other = k[0, 0] * k[1, 1] * abs((turn @ n) @ q) / q[2] ** 3
        assert other / own == pytest.approx(by_homography, rel=1e-6)

        def to(u: float, v: float, h: np.ndarray = h) -> np.ndarray:
            r = h @ [u, v, 1.0]
            return r[:2] / r[2]

        e = 1e-4
        du = (to(pixel[0] + e, pixel[1]) - to(pixel[0] - e, pixel[1])) / (2 * e)
        dv = (to(pixel[0], pixel[1] + e) - to(pixel[0], pixel[1] - e)) / (2 * e)
        assert abs(du[0] * dv[1] - du[1] * dv[0]) == pytest.approx(by_homography, rel=1e-6)
        done += 1


def table_with_a_hole() -> tuple[Scene, RgbdSequence]:
    """A floor, a table with a window in it, and a lid above a part of it that hides it from every photo."""
    ring = [
        quad([[-1, 1, 0], [-1, 1, 2], [-0.5, 1, 2], [-0.5, 1, 0]], 1),
        quad([[0.1, 1, 0], [0.1, 1, 2], [1.2, 1, 2], [1.2, 1, 0]], 1),
        quad([[-0.5, 1, 0], [-0.5, 1, 0.6], [0.1, 1, 0.6], [0.1, 1, 0]], 1),
        quad([[-0.5, 1, 1.3], [-0.5, 1, 2], [0.1, 1, 2], [0.1, 1, 1.3]], 1),
    ]
    lid = quad([[0.5, 1.15, 0.7], [0.5, 1.15, 1.2], [0.9, 1.15, 1.2], [0.9, 1.15, 0.7]], 2)
    floor = quad([[-3, 0, -3], [-3, 0, 4], [3, 0, 4], [3, 0, -3]], 0)
    scene = Scene(meshes=(floor, *ring, lid))
    cameras = [
        Cameras.look_at(
            (x, 3.2, 1.0 + dz), (0.1 + 0.1 * x, 1, 1), width=160, height=160, fov_deg=60, up=(0, 0, 1), near=0.1
        )
        for x, dz in ((0.4, -0.3), (0.7, 0.0), (0.9, -0.1), (0.6, 0.2))
    ]
    return scene, photos(scene, Cameras.cat(cameras))


def test_a_true_hole_stays_open_and_a_shadowed_part_is_filled():
    scene, sequence = table_with_a_hole()
    made = build_walkthrough(sequence, replace(OPTIONS, upright=False))
    del scene
    table = [p for p in made.planes if abs(abs(p.normal[1]) - 1) < 1e-3 and abs(abs(p.origin @ p.normal) - 1.0) < 1e-3]
    right = wrong = filled = 0
    for patch in table:
        rows, columns = np.mgrid[0 : patch.texture.shape[0], 0 : patch.texture.shape[1]].reshape(2, -1)
        world = patch.world(np.stack([columns + 0.5, rows + 0.5], 1))
        alpha = patch.texture[rows, columns, 3]
        x, z = world[:, 0], world[:, 2]
        border = np.minimum.reduce([np.abs(x + 0.5), np.abs(x - 0.1)]) < patch.step
        border |= np.minimum(np.abs(z - 0.6), np.abs(z - 1.3)) < patch.step
        window = (x > -0.5) & (x < 0.1) & (z > 0.6) & (z < 1.3) & ~border
        whole = (x > -0.9) & (x < 1.1) & (z > 0.1) & (z < 1.9) & ~border & ~window
        whole &= ~((x > -0.5 - 2 * patch.step) & (x < 0.1 + 2 * patch.step) & (z > 0.5) & (z < 1.4))
        right += int((alpha[window] == 0).sum() + (alpha[whole] > 0).sum())
        wrong += int((alpha[window] > 0).sum() + (alpha[whole] == 0).sum())
        shadow = (x > 0.62) & (x < 0.78) & (z > 0.85) & (z < 1.05)
        filled += int((alpha[shadow] == 254).sum())
    assert right / (right + wrong) >= 0.98
    assert filled > 20


@pytest.mark.parametrize("fill", ["exemplar", "inpaint"])
def test_filling_never_changes_what_is_known(fill):
    rng = np.random.default_rng(3)
    color = rng.integers(0, 256, (40, 50, 3)).astype(np.uint8)
    known = rng.random((40, 50)) < 0.95
    known[10:25, 12:30] = False
    options = replace(OPTIONS, fill=fill)
    one = fill_holes(color, known, ~known, options, 5)
    assert np.array_equal(one[known], color[known])
    assert np.array_equal(one, fill_holes(color, known, ~known, options, 5))
    plain = np.full((40, 50, 3), 90, np.uint8)
    # OpenCV's inpainting is off by a few codes even on one colour.
    assert np.abs(fill_holes(plain, known, ~known, options, 1).astype(int) - 90).max() <= 3


def test_largest_distance_of_adjacent_cubes():
    """The table of section 7 by random search: the published edge is too long for edges and corners in space."""
    rng = np.random.default_rng(4)
    a = np.round(rng.random((200_000, 3)))
    for offset, worst in (((1, 0, 0), 6**0.5), ((1, 1, 0), 3.0), ((1, 1, 1), 12**0.5)):
        b = np.round(rng.random((200_000, 3))) + offset
        assert np.linalg.norm(a - b, axis=1).max() == pytest.approx(worst)
    assert 12**0.5 / (2 * 3**0.5) <= 1 + 1e-12 and 2**0.5 / 4 * 6**0.5 < 1 < 2**0.5 / 4 * 3.0


def test_objects_against_brute_force():
    rng = np.random.default_rng(5)
    for epsilon in (0.08, 0.15):
        p = rng.random((220, 3))
        close = np.linalg.norm(p[:, None] - p[None], axis=2) <= epsilon
        reach = close.copy()
        for _ in range(9):
            reach = (reach.astype(np.float32) @ reach.astype(np.float32)) > 0
        exact = cluster_points(p, epsilon)
        assert np.array_equal(exact[:, None] == exact, reach)
        for edge in ("safe", "source"):
            grid = cluster_points(p, epsilon, exact=False, edge=edge)
            if edge == "safe":
                # Condition (1): in an object, each point has another within epsilon, through cubes that hold points.
                sizes = np.bincount(grid)
                lonely = ~(close & (grid[:, None] == grid) & ~np.eye(len(p), dtype=bool)).any(1)
                assert (sizes[grid[lonely]] == 1).all()
                assert (exact[:, None] == exact)[grid[:, None] == grid].all()
    assert len(cluster_points(np.zeros((0, 3)), 1.0)) == 0
    with pytest.raises(OptionError, match="epsilon"):
        cluster_points(np.zeros((2, 3)), 0.0)


def test_a_box_around_the_view_is_not_culled():
    camera = Cameras.look_at((0, 0, 0), (0, 0, 1), width=64, height=64, fov_deg=60, near=0.1)
    node = np.concatenate([[0, 0, 1.0], np.eye(3).reshape(-1), [50.0, 50, 0.2]])[None]
    planes = camera.frustum_planes()[0].numpy()[:5]
    corners = np.array([[x, y, z] for x in (-50, 50) for y in (-50, 50) for z in (0.8, 1.2)])
    assert ((corners @ planes[:, :3].T + planes[:, 3]) < 0).any(1).all()  # every corner is outside the view
    for node_, seen in ((node, 7), (node + np.array([0, 0, -10.0, *np.zeros(12)]), 0)):
        tree = replace(no_points(), nodes=node_, links=np.array([[0, 7, 0, 0]]), roots=np.zeros(1, np.int64))
        found = visible_runs(tree, camera, np.zeros((0, 5, 4)))
        assert int((found.runs[:, 1] - found.runs[:, 0]).sum()) == seen and found.outside == 7 - seen


def test_an_occluder_with_a_window_hides_nothing_behind_it():
    _, sequence = table_with_a_hole()
    made = build_walkthrough(sequence, OPTIONS)
    for eye in made.cameras.eye.numpy():
        for patch in made.planes:
            holes = patch.world(np.argwhere(patch.texture[..., 3] == 0)[:, ::-1] + 0.5)
            solid = patch.world(np.array([patch.solid[:2] + patch.solid[2:]]) / 2)
            for shadow in Occluders.of((patch,)).shadows(eye, 1):
                # What lies behind the middle of the occluder is hidden, what lies behind its holes is not.
                for places, expected in ((holes, False), (solid, True)):
                    beyond = eye + 1.3 * (places - eye)
                    hidden = ((beyond @ shadow[:, :3].T + shadow[:, 3]) > 0).all(1)
                    assert (hidden == expected).all()


# ------------------------------------------------------------------ section 11


def test_one_photo():
    made = build_walkthrough(capture(1, 96), OPTIONS)
    drawn = draw_walkthrough(made, made.cameras)
    assert float(drawn.covered.float().mean()) > 0.99


def test_identical_cameras_keep_one():
    frame = capture(1, 64).frames[0]
    other = replace(frame, name="z", color=apply_gain(frame.color, 1.001) ^ np.uint8(1))
    made = build_stages(RgbdSequence((frame, other)), OPTIONS)
    keep = made.comparisons.keep
    inner = made.capture.guard[0] == 0
    assert keep[0][inner].all() and not keep[1][inner].any()


def test_all_pixels_planar_or_none():
    wall = Scene(meshes=(quad([[-9, -9, 2], [9, -9, 2], [9, 9, 2], [-9, 9, 2]]),))
    cameras = Cameras.look_at((0, 0, 0), (0.1, 0.05, 2), width=64, height=64, fov_deg=60, near=0.1)
    flat = build_walkthrough(photos(wall, cameras), OPTIONS)
    assert len(flat.planes) == 1 and flat.report["planar_share"] > 0.95
    rough = photos(wall, cameras).frames[0]
    y, x = np.mgrid[0:64, 0:64]
    k = rough.intrinsics
    bowl = 2 / np.sqrt(1 + ((x + 0.5 - k[0, 2]) / k[0, 0]) ** 2 + ((y + 0.5 - k[1, 2]) / k[1, 1]) ** 2)
    bumpy = replace(rough, depth=bowl.astype(np.float32))
    none = build_walkthrough(RgbdSequence((bumpy,)), OPTIONS)
    assert not none.planes and len(none.points) > 1000
    for made in (flat, none):
        drawn = draw_walkthrough(made, made.cameras)
        assert bool(torch.isfinite(drawn.image).all()) and float(drawn.covered.float().mean()) > 0.9


def test_a_plane_through_the_eye_and_a_grazing_one():
    """h -> 0: nothing divides by it, and the best photo is kept."""
    scene = Scene(meshes=(quad([[-2, 0, 0.5], [-2, 0, 9], [2, 0, 9], [2, 0, 0.5]]),
                          quad([[-3, -2, 9], [3, -2, 9], [3, 3, 9], [-3, 3, 9]], 1)))  # fmt: skip
    eyes = ((0, 0.0, -1), (0, 0.02, -1), (0, 0.9, -1))
    cameras = Cameras.cat([Cameras.look_at(e, (0, 0, 5), width=96, height=96, fov_deg=60, near=0.05) for e in eyes])
    made = build_walkthrough(photos(scene, cameras), OPTIONS)
    for n in range(3):
        drawn = draw_walkthrough(made, cameras[n])
        assert bool(torch.isfinite(drawn.image).all()) and not bool(torch.isnan(drawn.depth).any())


def test_colour_that_disagrees_keeps_the_winner():
    """Something shines in one photo: no mean of the two."""
    frame = capture(1, 64, ball=True).frames[0]
    pose = frame.world_from_camera.copy()
    pose[:3, 3] += 1e-3 * pose[:3, 2]
    bright = replace(frame, name="b", color=np.full_like(frame.color, 255), world_from_camera=pose)
    options = replace(OPTIONS, n_min=5000, exposure="off", registration="off", view_detail=0)
    made = build_walkthrough(RgbdSequence((frame, bright)), options)
    codes = made.points.color.astype(int)
    mixed = (codes.max(1) < 250) & (codes.min(1) > 238)
    assert mixed.mean() < 0.02


def test_coplanar_objects_that_are_apart_stay_two():
    scene = Scene(meshes=(quad([[-1.5, 0, 1], [-1.5, 0, 2], [-0.6, 0, 2], [-0.6, 0, 1]]),
                          quad([[0.6, 0, 1], [0.6, 0, 2], [1.5, 0, 2], [1.5, 0, 1]], 1)))  # fmt: skip
    cameras = Cameras.look_at((0, 1.5, 0), (0, 0, 1.5), width=128, height=128, fov_deg=80, near=0.1)
    made = build_walkthrough(photos(scene, cameras), OPTIONS)
    assert len({p.plane for p in made.planes}) == 2


def test_duplicate_points_and_empty_objects():
    position = np.concatenate([np.zeros((600, 3)), np.ones((1, 3))])
    samples = Samples(position, np.tile([0, 0, 1.0], (601, 1)).astype(np.float32), np.zeros((601, 3), np.uint8),
                      np.full(601, 4.0, np.float32))  # fmt: skip
    made = build_points(samples, OPTIONS)
    assert len(made.roots) == 2 and (made.nodes[:, 12:] >= 1e-6).all()
    centre, axes, half = box_around(np.zeros((5, 3)))
    assert np.allclose(axes @ axes.T, np.eye(3)) and (half == 1e-6).all() and (centre == 0).all()
    empty = Walkthrough(planes=(), points=no_points())
    drawn = draw_walkthrough(empty, views(1, 32), DrawOptions(background=(0.1, 0.2, 0.3)))
    assert not bool(drawn.covered.any()) and torch.allclose(drawn.image[0, 0, 0], torch.tensor([0.1, 0.2, 0.3]))
    assert (
        len(
            build_points(
                Samples(*(a[:0] for a in (position, samples.normal, samples.color, samples.log_density))), OPTIONS
            )
        )
        == 0
    )


def test_repeatable_under_the_seed():
    one, two = (build_walkthrough(capture(4, 64), OPTIONS) for _ in range(2))
    assert np.array_equal(one.points.position, two.points.position)
    assert all(np.array_equal(a.texture, b.texture) for a, b in zip(one.planes, two.planes, strict=True))


# ------------------------------------------------------------------ captures


def test_a_blurred_and_a_burnt_out_photo_among_good_ones():
    sequence = capture(6, 96)
    rng = np.random.default_rng(7)
    noise = rng.integers(0, 60, (96, 96, 1)).astype(np.uint8)
    sharp = [replace(f, color=np.clip(f.color.astype(int) + noise, 0, 255).astype(np.uint8)) for f in sequence.frames]
    blurred = list(sharp)
    blurred[2] = replace(sharp[2], color=cv2.GaussianBlur(sharp[2].color, (0, 0), 3.0))
    quality = build_stages(RgbdSequence(tuple(blurred)), OPTIONS).capture.log_quality
    assert quality[2] < -0.3 and quality[2] == quality.min()
    burnt = list(sharp)
    burnt[3] = replace(sharp[3], color=np.clip(sharp[3].color.astype(int) * 2 + 60, 0, 255).astype(np.uint8))
    made = build_stages(RgbdSequence(tuple(burnt)), OPTIONS)
    assert made.capture.log_quality[3] < -1 and made.capture.log_quality[3] == made.capture.log_quality.min()


def test_many_frames_need_bounded_memory(tmp_path):
    """A thousand frames: as many are used as asked for, read as they are needed, kept in a file beyond the limit."""
    frame = capture(1, 64).frames[0]
    color, depth = tmp_path / "c.png", tmp_path / "d.npy"
    cv2.imwrite(str(color), np.ascontiguousarray(frame.color[..., ::-1]))
    np.save(depth, frame.depth)
    rng = np.random.default_rng(8)
    frames = []
    for n in range(1000):
        pose = frame.world_from_camera.copy()
        pose[:3, 3] += rng.normal(size=3) * 1e-5
        frames.append(replace(frame, name=f"{n:04d}", color=color, depth=depth, world_from_camera=pose))
    options = replace(OPTIONS, max_frames=12, memory_mb=16)
    stages = build_stages(RgbdSequence(tuple(frames)), options)
    assert len(stages.capture) == 12 and stages.walkthrough.report["photos"] == 12
    large = replace(OPTIONS, max_frames=300, memory_mb=16, max_partners=2, view_detail=0)
    from torchrender.walkthrough.frames.prepare import prepare

    prepared = prepare(RgbdSequence(tuple(frames[:300])), large)
    assert isinstance(prepared.depth, np.memmap)


def test_wrong_intrinsics_are_named():
    frame = capture(1, 64).frames[0]
    wrong = frame.intrinsics.copy()
    wrong[0, 2] = 640.0
    with pytest.raises(Exception, match="do not belong to a picture"):
        build_walkthrough(RgbdSequence((replace(frame, intrinsics=wrong),)))
    with pytest.raises(CameraError, match="skew"):
        replace(frame, intrinsics=np.array([[60.0, 5, 32], [0, 60, 32], [0, 0, 1]]))


@pytest.mark.parametrize("wrong", ["intrinsics", "poses", "scale", None])
def test_inconsistent_poses_are_said(wrong):
    """Photos that look through what others show: said once, with what to check; right ones raise no warning."""
    moved = []
    for n, frame in enumerate(capture(5, 96).frames):
        k, pose, depth = frame.intrinsics.copy(), frame.world_from_camera.copy(), frame.depth
        if wrong == "intrinsics":
            k[:2, :2] *= 1.0 + 0.25 * n
        elif wrong == "poses":
            pose[:3, 3] += (0.3 * (-1) ** n, 0.0, 0.4 * (n % 3))
        elif wrong == "scale":
            depth = depth * np.float32(1.0 + 0.15 * (n % 2))
        moved.append(replace(frame, intrinsics=k, world_from_camera=pose, depth=depth))
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        made = build_walkthrough(RgbdSequence(tuple(moved)), OPTIONS)
    texts = [str(w.message) for w in said if "look" in str(w.message)]
    assert len(texts) == (0 if wrong is None else 1), made.report["seen_through"]
    assert wrong is None or "check poses, intrinsics and depth scale" in texts[0]


# ------------------------------------------------------------------ files


def test_hostile_files_are_typed_errors(tmp_path):
    made = build_walkthrough(capture(2, 64), OPTIONS)
    good = tmp_path / "a.trw"
    write_walkthrough(good, made)
    again = read_walkthrough(good)
    assert np.abs(again.points.position - made.points.position).max() < 1e-6
    assert all(np.array_equal(a.texture, b.texture) for a, b in zip(made.planes, again.planes, strict=True))
    one, two = (draw_walkthrough(m, made.cameras[0]) for m in (made, again))
    assert float((one.image - two.image).abs().max(-1).values.gt(0.01).float().mean()) < 0.01

    data = good.read_bytes()
    bad = tmp_path / "b.trw"
    rng = np.random.default_rng(9)
    for length in (0, 1, 30, len(data) // 2, len(data) - 5):
        bad.write_bytes(data[:length])
        with pytest.raises(SceneFileError):
            read_walkthrough(bad)
    for _ in range(60):
        broken = bytearray(data)
        for place in rng.integers(0, len(data), 3):
            broken[place] ^= int(rng.integers(1, 256))
        bad.write_bytes(bytes(broken))
        with contextlib.suppress(SceneFileError):
            read_walkthrough(bad)
    with pytest.raises(SceneFileError, match="no such file"):
        read_walkthrough(tmp_path / "missing.trw")
    with pytest.raises(SceneFileError, match="written to"):
        write_walkthrough(tmp_path / "a.zip", made)


def edited(source, target, change) -> None:
    """A copy of a walkthrough's file with another header."""
    with zipfile.ZipFile(source) as old, zipfile.ZipFile(target, "w") as new:
        for name in old.namelist():
            value = old.read(name)
            if name == "header.json":
                header = json.loads(value)
                change(header)
                value = json.dumps(header).encode()
            new.writestr(name, value)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda h: h.update(version=99), "version"),
        (lambda h: h.update(format="zip"), "no walkthrough"),
        (lambda h: h["planes"][0].update(size=[10**6, 10**6]), "texture"),
        (lambda h: h["planes"][0].update(step=-1.0), "axes"),
        (lambda h: h["planes"][0]["triangles"].append([0, 1, 10**9]), "corners"),
        (lambda h: h["planes"][0].update(frame=[[0, 0, 0]] * 4), "axes"),
        (lambda h: h.pop("name"), "damaged"),
        (lambda h: h.update(world_from_input=[[float("nan")] * 4] * 4), "damaged"),
        (lambda h: h.update(camera_size=[-1, 5]), "width"),
    ],
)
def test_headers_that_lie(tmp_path, change, message):
    good, bad = tmp_path / "a.trw", tmp_path / "b.trw"
    write_walkthrough(good, build_walkthrough(capture(1, 64), OPTIONS))
    edited(good, bad, change)
    with pytest.raises(SceneFileError, match=message):
        read_walkthrough(bad)


def test_planes_take_shadows_like_other_meshes():
    """A light added to the scene: the lid's shadow falls on what is below it."""
    import torchrender as tr
    from torchrender.scene.light import PointLight

    made = build_walkthrough(capture(5, 128), replace(OPTIONS, upright=False))
    scene = made.scene(points=False)
    light = PointLight(position=torch.tensor([0.0, 2.3, 0.7]), intensity=torch.full((3,), 6.0))
    lit = replace(scene, lights=(light,), ambient=torch.full((3,), 0.05))
    camera = made.cameras[2]
    with_shadow = tr.render(lit, camera).radiance[0]
    without = tr.render(lit, camera, options=tr.RenderOptions(shadows=False)).radiance[0]
    darker = without - with_shadow
    assert float((darker > 0.05).any(-1).float().mean()) > 0.01 and float(darker.min()) > -0.05
    assert {FILLED, PLANE} and room()
