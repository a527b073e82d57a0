"""Single measurements of the walkthrough study."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import torch
from torch import Tensor

from torchrender.images.files import write_atomically
from torchrender.numerics.color import srgb_from_linear, srgb_table
from torchrender.report.walkthrough.peers import Draw
from torchrender.report.walkthrough.synthetic import SyntheticCapture, photos_of, without_highlights
from torchrender.scene.camera import Cameras
from torchrender.scene.cameras.path import built_in_path, walks_of
from torchrender.scene.model import Scene
from torchrender.walkthrough.build import Stages
from torchrender.walkthrough.draw import NOTHING, draw_walkthrough
from torchrender.walkthrough.frames.exposure import apply_gain
from torchrender.walkthrough.frames.prepare import read_frame
from torchrender.walkthrough.frames.record import Array, RgbdSequence
from torchrender.walkthrough.frames.registration import shifted
from torchrender.walkthrough.frames.rim import empty_rim
from torchrender.walkthrough.model import Walkthrough
from torchrender.walkthrough.options import DrawOptions
from torchrender.walkthrough.review.held_out import code_psnr, held_out_error, photo_camera

REPEATS = 4


@dataclass(frozen=True)
class Row:
    """One way to show held-out views."""

    name: str
    psnr_db: float = float("nan")
    coverage: float = float("nan")
    frame_ms: float = float("nan")
    uncovered: float = float("nan")
    size_bytes: float = float("nan")
    build_s: float = float("nan")


def drawn_row(
    name: str,
    model: Walkthrough,
    held: RgbdSequence,
    options: DrawOptions | None = None,
    *,
    poses: dict[str, Array] | None = None,
) -> Row:
    """A walkthrough on held-out photos."""
    found = held_out_error(model, held, options, poses=poses)
    return Row(
        name=name,
        psnr_db=found.mean_psnr_db,
        coverage=found.mean_coverage,
        frame_ms=float(np.median(found.ms)),
        uncovered=1.0 - found.mean_coverage,
        size_bytes=float(model.size_bytes),
    )


def peer_row(
    name: str, draw: Draw, held: RgbdSequence, model: Walkthrough, poses: dict[str, Array] | None = None
) -> Row:
    """Something else on the same photos and cameras."""
    world = model.world_from_input.numpy()
    affine = np.array(model.report.get("color_shift", np.eye(2, 3).tolist()))
    psnr, coverage, ms = [], [], []
    for frame in held.frames:
        if frame.depth is None:
            continue
        color, depth, lens = read_frame(frame)
        color = color if np.array_equal(affine, np.eye(2, 3)) else shifted(color, affine)
        pose = world @ frame.world_from_camera
        if poses is not None:
            pose = poses.get(frame.name, pose)
        camera = photo_camera(lens, pose, (depth.shape[0], depth.shape[1]), 1e-3 * max(model.diagonal, 1e-9))
        begin = time.perf_counter()
        image, mask = draw(camera)
        ms.append(1e3 * (time.perf_counter() - begin))
        shown = torch.from_numpy(~empty_rim(color))
        psnr.append(code_psnr(image, color, mask & shown))
        coverage.append(float(mask[shown].float().mean()))
    share = float(np.mean(coverage))
    return Row(name, float(np.mean(psnr)), share, float(np.median(ms)), 1.0 - share)


def planar_truth(stages: Stages, made: SyntheticCapture) -> dict[str, float]:
    """Precision and recall of planar pixels against the triangles that were drawn."""
    found = torch.from_numpy(np.stack([stages.capture.plane[i] >= 0 for i in range(len(stages.capture))]))
    return {
        "precision": float((found & made.truth).sum() / found.sum().clamp_min(1)),
        "precision_any_size": float((found & made.near_flat).sum() / found.sum().clamp_min(1)),
        "recall": float((found & made.truth).sum() / made.truth.sum().clamp_min(1)),
        "truth_share": float(made.truth.float().mean()),
    }


def frame_times(model: Walkthrough, poses: int, size: int) -> dict[str, Any]:
    """Times over many poses, each drawn ``REPEATS`` times and the quickest kept; culling against none.

    Processor time is summed over threads: what the wall clock would show on one core that nobody else uses.
    """
    assert model.cameras is not None
    base = model.cameras
    rows = torch.linspace(0, len(base) - 1, poses).long()
    rng = np.random.default_rng(3)
    ms, cpu, steps, outside, hidden, differing = [], [], [], [], [], 0
    for n, row in enumerate(rows.tolist()):
        eye = base.eye[row].numpy() + rng.normal(size=3) * 0.15
        yaw = rng.uniform(-np.pi, np.pi)
        forward = np.array([np.sin(yaw), -0.15, np.cos(yaw)])
        camera = Cameras.look_at(
            eye.tolist(), (eye + forward).tolist(), width=size, height=size, fov_deg=75, near=1e-3 * model.diagonal
        )
        tries, spent = [], []
        for _ in range(REPEATS):
            begin = time.process_time()
            first = draw_walkthrough(model, camera)
            spent.append(1e3 * (time.process_time() - begin))
            tries.append(first.statistics[0])
        quickest = min(tries, key=lambda t: sum(t.ms.values()))
        ms.append(sum(quickest.ms.values()))
        cpu.append(min(spent))
        steps.append(quickest.ms)
        points = max(quickest.points, 1)
        outside.append(quickest.outside / points)
        hidden.append(quickest.hidden / points)
        if n % 10 == 0:
            plain = draw_walkthrough(model, camera, DrawOptions(cull=False))
            differing += int((plain.image != first.image).any(-1).sum() + (plain.kind != first.kind).sum())
    return {
        "poses": poses,
        "median_ms": float(np.median(ms)),
        "p95_ms": float(np.percentile(ms, 95)),
        "worst_ms": float(np.max(ms)),
        "median_cpu_ms": float(np.median(cpu)),
        "worst_cpu_ms": float(np.max(cpu)),
        "steps_ms": {k: float(np.median([s[k] for s in steps])) for k in steps[0]},
        "outside": float(np.mean(outside)),
        "hidden": float(np.mean(hidden)),
        "differing_pixels": differing,
    }


def flicker(model: Walkthrough, unfilled: Walkthrough, size: int, frames: int = 24) -> dict[str, float]:
    """Mean squared change of colour from frame to frame, of places that nothing photographed: filled beforehand, or
    on the
    screen.

    A place is followed from one frame to the next by its depth in the filled model; it counts where it is a hole in
    both.
    """
    assert model.cameras is not None
    camera = model.cameras[len(model.cameras) // 2]
    ours, screen, masks, views, depths = [], [], [], [], []
    for n in range(frames):
        eye = camera.eye[0] + 0.01 * n * camera.rotation[0, 0]
        view = Cameras.look_at(eye, eye + camera.forward[0], width=size, height=size, fov_deg=90, near=0.005)
        hole = draw_walkthrough(unfilled, view, DrawOptions(view_colors=False)).kind[0] == NOTHING
        masks.append(hole)
        drawn = draw_walkthrough(model, view, DrawOptions(view_colors=False))
        ours.append(_codes(drawn.image[0]))
        views.append(view)
        depths.append(drawn.depth)
        screen.append(_codes(draw_walkthrough(unfilled, view, DrawOptions(view_colors=False, gap_pixels=64)).image[0]))
    total = {"ours": 0.0, "screen": 0.0, "pixels": 0.0}
    for n in range(frames - 1):
        chosen = masks[n + 1] & torch.isfinite(depths[n + 1][0])
        rows, columns = chosen.nonzero(as_tuple=True)
        pixels = views[n + 1].pixel_centres()[rows, columns]
        place = views[n + 1].unproject(pixels[None], depths[n + 1][:, rows, columns])
        at, z = views[n].project(place)
        u, v = at[0, :, 0].nan_to_num(-1.0), at[0, :, 1].nan_to_num(-1.0)
        inside = (z[0] > 0) & (u >= 1) & (v >= 1) & (u < size - 1) & (v < size - 1)
        hole = masks[n][v.clamp(0, size - 1).long(), u.clamp(0, size - 1).long()] & inside
        grid = torch.stack([2 * u / size - 1, 2 * v / size - 1], dim=-1)[None, None].float()
        total["pixels"] += float(hole.sum())
        for name, pictures in (("ours", ours), ("screen", screen)):
            before = torch.nn.functional.grid_sample(
                pictures[n].permute(2, 0, 1)[None].float(), grid, align_corners=False
            )
            change = pictures[n + 1][rows, columns] - before[0, :, 0].T
            total[name] += float(change.square().mean(-1)[hole].sum())
    count = max(total["pixels"], 1.0)
    return {"ours": total["ours"] / count, "screen": total["screen"] / count, "pixels": total["pixels"] / (frames - 1)}


def _codes(image: Tensor) -> Tensor:
    return srgb_from_linear(image.clamp(0, 1))


def kinect(scene: Scene, views: int, size: tuple[int, int], seed: int = 5) -> RgbdSequence:
    """The room through a bad camera: depth noise that grows with its square and comes in steps of disparity, holes at
    edges, exposure that drifts by up to a fifth, poses off by millimetres, a little noise and blur of colour."""
    rng = np.random.default_rng(seed)
    path = built_in_path(scene, (*walks_of(scene), "orbit")[0])
    cameras = path.cameras(views, width=size[0], height=size[1], near=1e-3 * scene.diagonal)
    sequence, *_ = photos_of(without_highlights(scene), cameras, None)
    frames = []
    drift = np.exp(0.18 * np.cumsum(rng.normal(size=views)) / max(views**0.5, 1))
    for n, frame in enumerate(sequence.frames):
        depth = np.asarray(frame.depth).astype(np.float64)
        noise = cv2.GaussianBlur(rng.normal(size=depth.shape), (0, 0), 1.0) * 3.5
        disparity = np.round(8 * (580 * 0.075 / depth + 0.12 * noise)) / 8
        depth = np.where(disparity > 0.5, 580 * 0.075 / np.maximum(disparity, 0.5), 0.0)
        edge = np.abs(cv2.Laplacian(np.asarray(frame.depth), cv2.CV_32F)) > 0.15
        depth[edge & (rng.random(depth.shape) < 0.6)] = 0.0
        depth[depth > 8.0] = 0.0
        color = cv2.GaussianBlur(apply_gain(np.asarray(frame.color), float(drift[n])), (0, 0), 0.6)
        color = np.clip(color + rng.normal(size=color.shape) * 2.0, 0, 255).astype(np.uint8)
        pose = frame.world_from_camera.copy()
        turn, _ = cv2.Rodrigues(rng.normal(size=3) * 0.0015)
        pose[:3, :3] = turn @ pose[:3, :3]
        pose[:3, 3] += rng.normal(size=3) * 0.004
        frames.append(replace(frame, color=color, depth=depth.astype(np.float32), world_from_camera=pose))
    return RgbdSequence(tuple(frames), "noisy room")


def save_picture(path: Path, model: Walkthrough, held: RgbdSequence, stages: Stages) -> None:
    """A held-out photo, the walkthrough from its camera, and what of it are planes (their own colours) and points."""
    del stages
    table = torch.from_numpy(srgb_table(8).numpy())
    rows = []
    for frame in held.frames[9:15:5] or held.frames[:1]:
        color, depth, lens = read_frame(frame)
        camera = photo_camera(lens, model.world_from_input.numpy() @ frame.world_from_camera, depth.shape, 1e-3)
        drawn = draw_walkthrough(model, camera)
        tint = torch.tensor([[1.0, 0, 1], [0.25, 0.6, 0.3], [0.95, 0.65, 0.15], [0.2, 0.35, 0.85], [0, 0, 0]])
        kinds = 0.35 * drawn.image[0] + 0.65 * tint[drawn.kind[0].long()] * (
            0.25 + drawn.image[0].mean(-1, keepdim=True)
        )
        rows.append(torch.cat([table[torch.from_numpy(color).long()], drawn.image[0], kinds.clamp(0, 1)], dim=1))
    codes = (srgb_from_linear(torch.cat(rows).clamp(0, 1)) * 255 + 0.5).to(torch.uint8).numpy()
    data = cv2.imencode(".jpg", codes[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, 88])[1].tobytes()

    def write(temporary: Path) -> None:
        temporary.write_bytes(data)

    write_atomically(path, write)
