"""From photos to a walkthrough and back to pictures."""

from __future__ import annotations

import warnings
from dataclasses import replace

import numpy as np
import pytest
import torch

from torchrender.errors import CameraError, InputError, OptionError
from torchrender.scene.camera import Cameras
from torchrender.walkthrough.build import build_stages, build_walkthrough
from torchrender.walkthrough.draw import FILLED, PLANE, POINT, draw_walkthrough
from torchrender.walkthrough.frames.record import CaptureWarning, RgbdSequence
from torchrender.walkthrough.options import DrawOptions, WalkthroughOptions
from torchrender.walkthrough.review.held_out import code_psnr, held_out_error
from torchrender.walkthrough.review.next_view import next_views
from walkthrough_scenes import capture, pattern, photos, room, views

OPTIONS = WalkthroughOptions(n_min=100)


@pytest.fixture(scope="module")
def stages():
    return build_stages(capture(6, 160), OPTIONS)


def test_planes_are_found_where_they_are(stages):
    """Floor, table and walls; the ball stays points."""
    made = stages.walkthrough
    assert 5 <= len(stages.planes) <= 9
    turn = made.world_from_input[:3, :3].numpy()
    truth = [((0, 1, 0), 0.0), ((0, 1, 0), 0.5), ((0, 0, -1), -2.0), ((1, 0, 0), -2.0), ((-1, 0, 0), -2.0)]
    for normal, offset in truth:
        n = turn @ np.array(normal, float)
        best = min(stages.planes, key=lambda p: np.abs(p.normal - n).max() + abs(p.offset - offset))
        assert np.degrees(np.arccos(min(best.normal @ n, 1.0))) < 0.01 and abs(best.offset - offset) < 2e-5
    distance = np.linalg.norm(made.points.position @ turn - [0.0, 0.76, 0.7], axis=1)
    assert (np.abs(distance - 0.25) < 0.02).mean() > 0.8


def test_a_reference_camera_sees_its_photo(stages):
    made = stages.walkthrough
    for n in (0, 3):
        drawn = draw_walkthrough(made, made.cameras[n])
        assert float(drawn.covered.float().mean()) > 0.995
        assert code_psnr(drawn.image[0], stages.capture.color[n], drawn.covered[0]) >= 35.0


def test_a_new_camera_sees_what_is_there(stages):
    camera = views(4, 160, seed=11)[1:3]
    held = photos(room(), camera)
    error = held_out_error(stages.walkthrough, held)
    assert error.mean_psnr_db > 30 and error.mean_coverage > 0.99
    assert max(error.depth_error) < 1e-3


def test_the_order_of_photos_does_not_matter():
    sequence = capture(4, 64)
    mixed = RgbdSequence(tuple(sequence.frames[k] for k in (2, 0, 3, 1)), sequence.name)
    one, other = (build_walkthrough(s, OPTIONS) for s in (sequence, mixed))
    assert np.array_equal(one.points.position, other.points.position)
    assert all(np.array_equal(a.texture, b.texture) for a, b in zip(one.planes, other.planes, strict=True))


def test_sizes_add_up(stages):
    made = stages.walkthrough
    parts = made.report["bytes"]
    assert made.size_bytes == parts["textures"] + parts["points"] + parts["view_colors"]
    assert parts["photos"] == 7 * 6 * 160 * 160
    assert made.report["kept_share"] < 0.6


def test_texels_as_many_as_pixels_that_were_kept(stages):
    """rho^2 times the area that the kept pixels cover is their number."""
    from torchrender.walkthrough.textures import texel_density

    found = stages.comparisons
    for count, area in zip(found.count, found.area):
        if count:
            assert texel_density(int(count), float(area), 1.0) ** 2 * area == pytest.approx(count, rel=1e-9)


def test_every_surface_point_has_one_keeper(stages):
    """Up to the border guard: a kept pixel away from edges is seen as densely by no other photo."""
    from torchrender.walkthrough.frames.pairs import match

    capture_, keep = stages.capture, stages.comparisons.keep
    double = total = 0
    for i in range(len(capture_)):
        rows, columns = np.nonzero((keep[i] != 0) & (capture_.guard[i] == 0))
        for j in range(len(capture_)):
            if j != i:
                m = match(capture_, i, j, (rows, columns), 0.005)
                double += int((keep[j, m.v.astype(int), m.u.astype(int)] != 0).sum())
        total += len(rows)
    assert double < 0.08 * total


def test_culling_never_changes_a_picture(stages):
    made = stages.walkthrough
    cameras = Cameras.cat([made.cameras[1], *(views(1, 160, seed=s) for s in range(6))])
    for grow in (1.0, 2.0):
        on = draw_walkthrough(made, cameras, DrawOptions(splat_grow=grow))
        off = draw_walkthrough(made, cameras, DrawOptions(splat_grow=grow, cull=False))
        assert torch.equal(on.image, off.image) and torch.equal(on.kind, off.kind)
    assert sum(s.outside + s.hidden for s in on.statistics) > 0


def test_planes_are_counted_of_which_something_is_drawn(stages):
    assert stages.walkthrough.report["planes"] == len({patch.plane for patch in stages.walkthrough.planes})


def test_points_and_planes_share_a_depth_buffer(stages):
    drawn = draw_walkthrough(stages.walkthrough, stages.walkthrough.cameras[2])
    kinds = {int(k) for k in drawn.kind.unique()}
    assert {PLANE, POINT} <= kinds
    truth = torch.from_numpy(stages.capture.depth[2])
    off = ((drawn.depth[0] - truth).abs() / truth)[drawn.covered[0]]
    assert float(off.median()) < 1e-4 and float((off < 0.02).float().mean()) > 0.98


def test_the_batch_is_the_single_pictures(stages):
    made = stages.walkthrough
    both = draw_walkthrough(made, made.cameras[:2])
    assert torch.equal(both.image[1], draw_walkthrough(made, made.cameras[1]).image[0])
    none = draw_walkthrough(made, made.cameras[:0])
    assert none.image.shape == (0, 160, 160, 3)


def test_a_scene_of_this_project(stages):
    """The planner draws it: planes and squares in place of points, colours as the photos have them."""
    import torchrender as tr

    made = stages.walkthrough
    picture = tr.render(made.scene(), made.cameras[0])
    assert [row.reason for row in picture.plan.rows if row.name == "ambient_visibility"] == [
        "colours of photos hold the shadows of their light already"
    ]
    image = picture.displayed()[0]
    assert code_psnr(image, stages.capture.color[0], torch.ones(160, 160, dtype=torch.bool)) > 35


def test_held_out_error_is_part_of_the_report():
    made = build_walkthrough(capture(9, 128), OPTIONS, hold_out=3)
    held = made.report["held_out"]
    assert held["photos"] == ["00001", "00004", "00007"] and held["psnr_db"] > 28 and held["coverage"] > 0.95
    with pytest.raises(OptionError, match="hold_out"):
        build_walkthrough(capture(2, 48), OPTIONS, hold_out=1)


def test_the_next_view_looks_where_nothing_is_known(stages):
    first, second = next_views(stages.walkthrough, 2, candidates=60)
    shown = draw_walkthrough(stages.walkthrough, stages.walkthrough.cameras)
    usual = float((shown.kind == 0).float().mean() + (shown.kind == FILLED).float().mean())
    assert first.missing + first.filled > usual + 0.1 and first.score > 0
    assert float((first.camera.eye - second.camera.eye).norm()) > 0


def test_exposure_is_repaired():
    sequence = capture(6)
    from torchrender.walkthrough.frames.exposure import apply_gain

    gains = (1.0, 0.8, 1.15, 1.0, 0.9, 1.05)
    drifted = tuple(replace(f, color=apply_gain(f.color, g)) for f, g in zip(sequence.frames, gains))
    found = build_stages(RgbdSequence(drifted), OPTIONS).capture.gain
    product = found * np.array(gains)
    assert np.abs(product / np.exp(np.log(product).mean()) - 1).max() < 0.02


def test_poses_are_repaired():
    sequence = capture(6)
    rng = np.random.default_rng(1)
    moved = []
    for n, frame in enumerate(sequence.frames):
        pose = frame.world_from_camera.copy()
        pose[:3, 3] += rng.normal(size=3) * 0.01 * (n > 0)
        moved.append(replace(frame, world_from_camera=pose))
    made = build_stages(RgbdSequence(tuple(moved)), OPTIONS)
    report = made.walkthrough.report
    assert report["disagreement_after"] < 0.35 * report["disagreement_before"]
    off = build_walkthrough(RgbdSequence(tuple(moved)), replace(OPTIONS, registration="off"))
    assert off.report["camera_moved"] == 0


def test_color_over_depth_is_repaired():
    """Colours that step where depth does, moved by whole pixels: the shift is found, and none where there is none."""
    from torchrender.walkthrough.frames.prepare import prepare
    from torchrender.walkthrough.frames.registration import color_shift, shift_color

    rng = np.random.default_rng(0)
    frames = []
    for frame in capture(6, 256).frames:
        shade = np.repeat(255 - 70 * np.minimum(frame.depth, 3.5)[..., None], 3, 2) + rng.integers(0, 6, (256, 256, 3))
        frames.append(replace(frame, color=np.clip(shade, 0, 255).astype(np.uint8)))
    for across, down in ((3, 2), (-2, 4), (0, 0)):
        moved = tuple(replace(f, color=np.roll(f.color, (down, across), (0, 1))) for f in frames)
        prepared = prepare(RgbdSequence(moved), OPTIONS)
        found = color_shift(prepared)
        assert np.array_equal(found, [[1, 0, across], [0, 1, down]])
        shift_color(prepared, found)
        for n, frame in enumerate(frames):
            assert np.array_equal(prepared.color[n, 8:-8, 8:-8], frame.color[8:-8, 8:-8])


def test_wrong_input_is_named():
    sequence = capture(2, 48)
    frame = sequence.frames[0]
    with pytest.raises(CameraError, match="rigid"):
        replace(frame, world_from_camera=2 * np.eye(4))
    with pytest.raises(CameraError, match="focal"):
        replace(frame, intrinsics=np.zeros((3, 3)))
    with pytest.raises(InputError, match="no frame has depth"):
        build_walkthrough(RgbdSequence((replace(frame, depth=None),)))
    with pytest.raises(OptionError, match="tau_z"):
        WalkthroughOptions(tau_z=1.0)
    with pytest.raises(CameraError, match="perspective"):
        draw_walkthrough(
            build_walkthrough(sequence, OPTIONS), replace(views(1, 48), orthographic=True, far=torch.tensor(9.0))
        )


def test_what_is_left_out_is_said():
    sequence = capture(3, 48)
    a, b, c = sequence.frames
    mixed = RgbdSequence((a, replace(b, depth=None), replace(c, name="z", color=a.color, depth=a.depth,
                          world_from_camera=a.world_from_camera)))  # fmt: skip
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        made = build_walkthrough(mixed, OPTIONS)
    texts = [str(w.message) for w in said if issubclass(w.category, CaptureWarning)]
    assert len(texts) == 2 and "no depth: 00001" in texts[0] + texts[1] and "a duplicate: z" in texts[0] + texts[1]
    assert made.report["photos"] == 1 and set(made.report["left_out"]) == {"00001", "z"}
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        build_walkthrough(sequence, OPTIONS)
    assert pattern(torch.zeros(1, 3)).shape == (1, 3)


@pytest.mark.parametrize("share", [0.3, 0.15])
def test_a_named_size_is_kept(share):
    capture_ = capture(4, size=96)
    free, held = (build_walkthrough(capture_, WalkthroughOptions(n_min=80, size_share=s)) for s in (None, share))
    raw = free.report["bytes"]["photos"]
    assert free.size_bytes > 0.3 * raw
    assert held.size_bytes <= share * raw
    assert len(held.points) < len(free.points) and held.texel_count < free.texel_count
    error = [code_psnr(draw_walkthrough(m, m.cameras[0]).image[0], *_first(capture_)) for m in (free, held)]
    assert error[0] - error[1] < 8.0


def _first(sequence):
    color = sequence.frames[0].read_color()
    return color, torch.ones(color.shape[:2], dtype=torch.bool)


def test_a_size_that_leaves_no_room_is_named():
    with pytest.raises(OptionError, match="size_share"):
        build_walkthrough(capture(2, size=64), WalkthroughOptions(n_min=80, size_share=0.05, view_detail=2))


def test_the_empty_rim_of_a_held_out_photo_does_not_count(stages):
    frame = capture(6, size=160).frames[2]
    rimmed = frame.read_color().copy()
    rimmed[:4], rimmed[-4:], rimmed[:, :4], rimmed[:, -4:] = 255, 255, 255, 255
    plain, other = (
        held_out_error(stages.walkthrough, RgbdSequence((replace(frame, color=color),), "held"))
        for color in (frame.read_color(), rimmed)
    )
    assert abs(plain.mean_psnr_db - other.mean_psnr_db) < 1.0
    assert other.mean_coverage > 0.99


@pytest.mark.parametrize("files", [False, True])
def test_a_depth_picture_of_another_size_does_not_decide_for_all(files, tmp_path):
    """Neither where the first one is it, nor where sizes are read from files."""
    sequence = capture(3, 48)
    frames = [replace(sequence.frames[0], depth=sequence.frames[0].depth[::2, ::2].copy()), *sequence.frames[1:]]
    if files:
        for k, frame in enumerate(frames):
            np.save(tmp_path / f"{k}.npy", frame.depth)
            frames[k] = replace(frame, depth=tmp_path / f"{k}.npy")
    with pytest.warns(CaptureWarning, match="1 frames left out, depth is 24x24, that of most is 48x48: 00000"):
        made = build_walkthrough(RgbdSequence(tuple(frames)), OPTIONS)
    assert made.report["photos"] == 2 and set(made.report["left_out"]) == {"00000"}
