"""From photos to a walkthrough, stage by stage."""

from __future__ import annotations

import warnings
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np
import torch

from torchrender.checks import check_range, options_of
from torchrender.clock import StepClock
from torchrender.errors import OptionError
from torchrender.scene.camera import Cameras
from torchrender.walkthrough.classify import Fit, Tolerances, classify_all
from torchrender.walkthrough.density import Comparisons, compare_density
from torchrender.walkthrough.draw import draw_walkthrough
from torchrender.walkthrough.frames.exposure import solve_exposure
from torchrender.walkthrough.frames.pairs import overlaps, partners, seen_through
from torchrender.walkthrough.frames.prepare import Capture, Progress, prepare, quiet
from torchrender.walkthrough.frames.record import Array, CaptureWarning, Frame, RgbdSequence
from torchrender.walkthrough.frames.registration import color_shift, disagreement, register, shift_color
from torchrender.walkthrough.frames.rim import empty_rim
from torchrender.walkthrough.model import PIXEL_BYTES, POINT_BYTES, TEXEL_BYTES, PlanePatch, Walkthrough
from torchrender.walkthrough.options import DrawOptions, WalkthroughOptions
from torchrender.walkthrough.planes import Plane, assign_pixels, merge_fits
from torchrender.walkthrough.points.budget import within_budget
from torchrender.walkthrough.points.clusters import build_points
from torchrender.walkthrough.review.held_out import held_out_error, located_poses
from torchrender.walkthrough.textures import TextureReport, make_textures
from torchrender.walkthrough.view_colors import ViewColors, pack, residual_picture

SUSPICIOUS = 0.02
"""Median disagreement of depths between photos, share of depth, from which on poses or intrinsics must be wrong."""

LOOKED_PAST = 0.08
"""Share of what photos show that others look through, from which on the same must hold."""


@dataclass(frozen=True, eq=False)
class Stages:
    """Everything on the way, for studies and tests."""

    capture: Capture
    near: list[Array]
    tolerances: Tolerances
    fits: list[Fit]
    planes: list[Plane]
    comparisons: Comparisons
    textures: TextureReport
    walkthrough: Walkthrough
    held: RgbdSequence | None
    held_poses: dict[str, Array]  # of held-out photos that had to be located


def build_walkthrough(
    sequence: RgbdSequence,
    options: WalkthroughOptions | None = None,
    *,
    hold_out: int = 0,
    progress: Progress = quiet,
) -> Walkthrough:
    """A walkthrough from RGB-D photos with poses.

    Large planes become textured polygons, the rest points; each piece of surface is kept from the photo that sampled it
    best, and parts of planes that no photo saw are filled in. The result depends on the photos and the seed alone, not
    on the order of the photos. Frames that cannot be used are left out with a :class:`CaptureWarning` that names them.
    Memory: 16 bytes for each pixel of up to ``max_frames`` photos, in a temporary file beyond ``memory_mb``.

    Args:
        hold_out: every so manieth photo is not used; the walkthrough is compared with it, and ``report["held_out"]``
        tells
            how well it fits. 0: all are used.
        progress: called as ``progress(items, stage)`` around each stage's loop, to show a bar.

    Raises:
        InputError: no frame is usable. OptionError: an option out of range.
    """
    return build_stages(sequence, options, hold_out=hold_out, progress=progress).walkthrough


def build_stages(
    sequence: RgbdSequence,
    options: WalkthroughOptions | None = None,
    *,
    hold_out: int = 0,
    progress: Progress = quiet,
) -> Stages:
    """As :func:`build_walkthrough`, with what the stages made."""
    options = options_of(options, WalkthroughOptions)
    check_range("hold_out", hold_out, 0, 10**6)
    if hold_out == 1:
        raise OptionError("hold_out must not be 1: no photo would be left")
    # Ties between photos go by number: the numbers must not depend on how the photos came.
    ordered = sorted(sequence.frames, key=lambda f: (f.time is None, f.time or 0.0, f.name))
    turn = upright(ordered) if options.upright else np.eye(4)
    used, held = RgbdSequence(tuple(ordered), sequence.name).split(hold_out)
    ordered = list(used.frames)
    frames = tuple(replace(f, world_from_camera=turn @ f.world_from_camera) for f in ordered)
    clock = StepClock()
    with clock.measure("read"):
        capture = prepare(RgbdSequence(frames, sequence.name), options, progress)
    with clock.measure("repair"):
        near, repair = _repair(capture, options, progress)
    tolerances = Tolerances.of(capture, options, repair["disagreement_after"])
    with clock.measure("classify"):
        fits = classify_all(capture, options, tolerances, progress)
    with clock.measure("merge planes"):
        planes, owner = merge_fits(fits, options, tolerances)
        assign_pixels(capture, planes, owner, tolerances, progress)
    with clock.measure("compare density"):
        found = compare_density(capture, near, len(planes), options, progress)
    with clock.measure("textures"):

        def texture(how: WalkthroughOptions) -> tuple[list[PlanePatch], TextureReport]:
            return make_textures(capture, planes, found, how, progress, near=tolerances.largest)

        patches, textures, samples = within_budget(capture, found.samples, texture, options)
    with clock.measure("points"):
        points = build_points(samples, options)
    walkthrough = Walkthrough(
        planes=tuple(patches),
        points=points,
        cameras=cameras_of(capture),
        world_from_input=torch.from_numpy(turn.copy()),
        name=sequence.name,
    )
    if options.view_detail:
        with clock.measure("view colours"):
            walkthrough = replace(walkthrough, view_colors=_view_colors(capture, walkthrough, options, progress))
    made = Stages(capture, near, tolerances, fits, planes, found, textures, walkthrough, held, {})
    report = _report(made) | repair | {"ms": {k: round(v, 1) for k, v in clock.elapsed_ms.items()}}
    made = replace(made, walkthrough=replace(walkthrough, report=report))
    return made if held is None else _compared(made, options, progress)


def _report(made: Stages) -> dict[str, Any]:
    """What there is to say of a build, as plain values."""
    capture, walkthrough, found = made.capture, made.walkthrough, made.comparisons
    height, width = capture.size
    pixels = len(capture) * height * width
    patches, points, colors = walkthrough.planes, walkthrough.points, walkthrough.view_colors
    return {
        "photos": len(capture),
        "size": [width, height],
        "left_out": dict(list(capture.left_out.items())[:200]),
        "planes": len({patch.plane for patch in patches}),  # of which something is drawn
        "patches": len(patches),
        "points": len(points),
        "objects": len(points.roots),
        "planar_share": float(np.mean([(capture.plane[i] >= 0).mean() for i in range(len(capture))])),
        "kept_share": found.kept_share,
        "restored": found.restored,
        "hanging": found.hanging,
        "texels": {"seen": made.textures.seen, "filled": made.textures.filled, "holes": made.textures.holes},
        "corners": {"raw": sum(p.raw_corners for p in patches), "kept": sum(len(p.corners) for p in patches)},
        "bytes": {
            "photos": PIXEL_BYTES * pixels,
            "textures": TEXEL_BYTES * walkthrough.texel_count,
            "points": POINT_BYTES * len(points),
            "view_colors": 0 if colors is None else colors.size_bytes,
        },
        "size_share": walkthrough.size_bytes / (PIXEL_BYTES * pixels),
        "depth_noise": capture.relative_noise,
        "color_shift": np.asarray(capture.color_shift).tolist(),
        "gains": [round(float(g), 4) for g in capture.gain],
        "tau_max": made.tolerances.largest,
    }


def _compared(made: Stages, options: WalkthroughOptions, progress: Progress) -> Stages:
    """With the error on held-out photos in the report."""
    walkthrough, held = made.walkthrough, made.held
    report, poses = dict(walkthrough.report), made.held_poses
    report["held_out"] = held_out_error(walkthrough, held, progress=progress).record()
    if report["camera_moved"] > 0 and held is not None:
        # The poses of the others have moved: where it stood among them as given is not where it stands now.
        report["held_out_as_given"] = report["held_out"]
        poses = located_poses(made.capture, held, walkthrough.world_from_input.numpy(), options, progress)
        report["held_out"] = held_out_error(walkthrough, held, poses=poses, progress=progress).record()
    return replace(made, walkthrough=replace(walkthrough, report=report), held_poses=poses)


def upright(frames: Iterable[Frame]) -> Array:
    """(4,4) rotation that turns the mean of the cameras' up directions to +y; none if they have no common one."""
    up = -np.mean([f.world_from_camera[:3, 1] for f in frames], axis=0)
    length = float(np.linalg.norm(up))
    made = np.eye(4)
    if length < 0.2:
        return made
    a, b = up / length, np.array([0.0, 1.0, 0.0])
    v, c = np.cross(a, b), float(a @ b)
    if c < -1 + 1e-9:
        made[:3, :3] = np.diag([1.0, -1.0, -1.0])
        return made
    k = np.array([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]])
    made[:3, :3] = np.eye(3) + k + k @ k / (1 + c)
    return made


def _repair(capture: Capture, options: WalkthroughOptions, progress: Progress) -> tuple[list[Array], dict[str, Any]]:
    near = partners(overlaps(capture), options.max_partners)
    before = after = disagreement(capture, near, options.seed)
    moved = 0.0
    if options.registration == "auto" and len(capture) > 1:
        if not capture.exact:
            shift_color(capture, color_shift(capture))
        before, after, moved = register(capture, near, options.seed, progress)
        if moved > 0:
            near = partners(overlaps(capture), options.max_partners)
    if options.exposure == "auto":
        solve_exposure(capture, near, options.seed)
    past = seen_through(capture, near, options.seed)
    if after > SUSPICIOUS or past > LOOKED_PAST:
        warnings.warn(
            f"depths of photos disagree by {100 * after:.1f} % of depth, and {100 * past:.0f} % of what one photo shows"
            " another looks through: check poses, intrinsics and depth scale",
            CaptureWarning,
            stacklevel=4,
        )
    found = {"disagreement_before": before, "disagreement_after": after, "seen_through": past, "camera_moved": moved}
    return near, found


def _view_colors(
    capture: Capture, walkthrough: Walkthrough, options: WalkthroughOptions, progress: Progress
) -> ViewColors:
    """What each photo saw differently from the model, at the resolution asked for.

    The model is drawn at twice that resolution: finer detail would be averaged away.
    """
    height, width = capture.size
    coarse = max(options.view_detail // 2, 1)
    size = (-(-width // coarse), -(-height // coarse))
    cameras = cameras_of(capture).scaled(size[0] / width)
    pictures = []
    for i in progress(range(len(capture)), "view colours"):
        drawn = draw_walkthrough(walkthrough, cameras[i], DrawOptions(cull=True))
        small = (cameras.width, cameras.height)
        color = cv2.resize(capture.color[i], small, interpolation=cv2.INTER_AREA)
        # What shows nothing counts as background: no colour of it is kept.
        depth = np.where(empty_rim(capture.color[i]), np.float32(np.inf), capture.depth[i])
        depth = cv2.resize(depth, small, interpolation=cv2.INTER_NEAREST)
        factor = max(options.view_detail // coarse, 1)
        pictures.append(residual_picture(color, depth, drawn.image[0].numpy(), drawn.depth[0].numpy(), factor))
    lens = cameras.intrinsics[:, (0, 1, 0, 1), (0, 1, 2, 2)].numpy()
    return pack(pictures, lens, capture.camera_from_world, (cameras.height, cameras.width))


def cameras_of(capture: Capture) -> Cameras:
    """The photos' cameras."""
    k = np.zeros((len(capture), 3, 3))
    k[:, 0, 0], k[:, 1, 1], k[:, 0, 2], k[:, 1, 2], k[:, 2, 2] = *capture.lens.T, 1.0
    near = torch.full((len(capture),), 1e-3 * capture.diagonal(), dtype=torch.float64)
    far = torch.full((len(capture),), torch.inf, dtype=torch.float64)
    pose = torch.from_numpy(capture.camera_from_world)
    return Cameras(pose, torch.from_numpy(k), capture.size[1], capture.size[0], near, far)
