"""Measures walkthroughs: ``python -m torchrender.report.walkthrough``."""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
import warnings
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import torch

from torchrender.checks import checked_fields
from torchrender.images.files import write_atomically
from torchrender.quality.machine import machine_record
from torchrender.quality.pages import text_writer
from torchrender.report.walkthrough.measures import (
    Row,
    drawn_row,
    flicker,
    frame_times,
    kinect,
    peer_row,
    planar_truth,
    save_picture,
)
from torchrender.report.walkthrough.page import write_page
from torchrender.report.walkthrough.peers import all_points, open3d_tsdf, warp_nearest
from torchrender.report.walkthrough.synthetic import synthetic_capture
from torchrender.scene.load import load
from torchrender.walkthrough.build import Stages, build_stages
from torchrender.walkthrough.frames.layouts import load_rgbd
from torchrender.walkthrough.frames.record import RgbdSequence
from torchrender.walkthrough.options import DrawOptions, WalkthroughOptions
from torchrender.walkthrough.textures import make_textures

SHARED: dict[str, tuple[tuple[float, ...] | None, int]] = {
    "livingroom1": (None, 8),
    "slambook2": ((518.0, 519.0, 325.5, 253.5), 5),
}
"""Intrinsics where the folder has none, and every how manieth photo is held out."""

SHARE = 0.25
"""Of raw size that the shared sequences are kept to, as asked."""

PARTS = ("synthetic", "livingroom1", "slambook2", "noisy")


@dataclass(frozen=True)
@checked_fields
class StudyOptions:
    """How large."""

    views: int = 88
    held: int = 20
    size: int = 400
    poses: int = 200
    triangles: int | None = None
    points: int = 3_000_000  # of the baseline that keeps every pixel
    noisy: tuple[int, int, int] = (88, 640, 480)
    voxels: tuple[float, ...] = (0.02, 0.01)


QUICK = StudyOptions(
    views=6, held=2, size=80, poses=4, triangles=10_000, points=20_000, noisy=(5, 96, 72), voxels=(0.05,)
)


def run(study: StudyOptions, folder: Path, data: Path | None, parts: Sequence[str] = PARTS) -> dict[str, Any]:
    """Measure the parts asked for and write the page after each; what an earlier run measured of the others stays."""
    folder.mkdir(parents=True, exist_ok=True)
    file = folder / "walkthrough.json"
    record: dict[str, Any] = json.loads(file.read_text()) if file.is_file() and len(parts) < len(PARTS) else {}
    record |= {"machine": machine_record(), "load": os.getloadavg(), "study": asdict(study)}
    for part in parts:
        found = _step(part, partial(_part, part, study, folder, data))
        if found is not None:
            record[part] = found | {"commit": record["machine"].get("commit"), "load": record["load"][0]}
        write_atomically(file, text_writer(json.dumps(record, indent=1) + "\n"))
        write_page(record, folder)
    return record


def _part(part: str, study: StudyOptions, folder: Path, data: Path | None) -> dict[str, Any] | None:
    if part == "synthetic":
        return synthetic(study, folder)
    if part == "noisy":
        return noisy(study)
    lens, hold = SHARED[part]
    place = None if data is None else data / "rgbd" / part
    if place is None or not place.is_dir():
        return None
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        return real(load_rgbd(place, intrinsics=lens), hold, study, WalkthroughOptions(size_share=SHARE))


def _step(name: str, work: Callable[[], Any]) -> Any:
    sys.stderr.write(f"{name} ...\n")
    begin = time.perf_counter()
    found = work()
    sys.stderr.write(f"{name}: {time.perf_counter() - begin:.1f} s\n")
    return found


def synthetic(study: StudyOptions, folder: Path) -> dict[str, Any]:
    """Specification 13, section 10: 88 exact views, 20 held out, and the source's baselines."""
    made = synthetic_capture(
        load("living_room", size=study.triangles), views=study.views, held=study.held, size=study.size
    )
    options = WalkthroughOptions(n_min=400 if study.size >= 300 else 50)
    begin, cpu = time.perf_counter(), time.process_time()
    stages = build_stages(made.sequence, options)
    seconds, cpu_seconds = time.perf_counter() - begin, time.process_time() - cpu
    model = stages.walkthrough
    capture = stages.capture
    unfilled = _without_filling(stages, options)
    average = _averaged(stages, options)
    rows: list[Row] = [
        drawn_row("this walkthrough", model, made.held),
        drawn_row("the same, EWA points", model, made.held, DrawOptions(splats="ewa")),
        drawn_row(
            "the same, without colours that depend on the view", model, made.held, DrawOptions(view_colors=False)
        ),
        peer_row("(a) the 4 nearest photos warped", warp_nearest(capture, 4), made.held, model),
        drawn_row("(b) every pixel a point, no comparison", all_points(capture, model, study.points), made.held),
        drawn_row("(c) planes averaged over all photos", average, made.held),
        drawn_row("(d) no filling", unfilled, made.held),
        drawn_row("(e) no filling, holes closed on the screen", unfilled, made.held, DrawOptions(gap_pixels=64)),
        peer_row("the nearest photo warped", warp_nearest(capture, 1), made.held, model),
    ]
    for voxel in study.voxels:
        rows.append(_tsdf(stages, voxel, made.held))
    save_picture(folder.parent / "walkthrough.jpg", model, made.held, stages)
    return {
        "report": {k: v for k, v in model.report.items() if k not in ("left_out", "gains")},
        "seconds": seconds,
        "cpu_seconds": cpu_seconds,
        "planar": planar_truth(stages, made),
        "rows": [asdict(r) for r in rows],
        "uncovered": {"before": rows[6].uncovered, "after": rows[0].uncovered},
        "frames": frame_times(model, study.poses, study.size),
        "flicker": flicker(model, unfilled, study.size),
        "raw_bytes_b": 15 * study.views * study.size**2,
    }


def _without_filling(stages: Stages, options: WalkthroughOptions) -> Any:
    return _textured(stages, replace(options, fill="off"), average=False)


def _averaged(stages: Stages, options: WalkthroughOptions) -> Any:
    return _textured(stages, options, average=True)


def _textured(stages: Stages, options: WalkthroughOptions, *, average: bool) -> Any:
    """The same model with other textures."""
    patches, _ = make_textures(
        stages.capture, stages.planes, stages.comparisons, options, near=stages.tolerances.largest, average=average
    )
    return replace(
        stages.walkthrough, planes=tuple(patches), view_colors=None if average else stages.walkthrough.view_colors
    )


def _tsdf(stages: Stages, voxel: float, held: RgbdSequence, poses: Any = None) -> Row:
    capture = stages.capture
    name = f"Open3D TSDF, voxels {100 * voxel:g} cm"
    found = open3d_tsdf(capture, capture.pose, voxel, 1.5 * stages.tolerances.diagonal)
    if isinstance(found, str):
        return Row(name=f"{name}: {found}")
    draw, seconds = found
    return replace(peer_row(name, draw, held, stages.walkthrough, poses), build_s=seconds)


def noisy(study: StudyOptions) -> dict[str, Any]:
    """The room as a depth camera of the Kinect's kind would see it: a check on data that nothing was tuned on."""
    views, width, height = study.noisy
    sequence = kinect(load("living_room", size=study.triangles), views, (width, height))
    return real(sequence, 8 if views > 8 else 3, study)


def real(
    sequence: RgbdSequence, hold_out: int, study: StudyOptions, options: WalkthroughOptions | None = None
) -> dict[str, Any]:
    """A capture with every so manieth photo held out, beside TSDF and warps, at the poses given and at the repaired
    ones."""
    begin, cpu = time.perf_counter(), time.process_time()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        stages = build_stages(sequence, options, hold_out=hold_out)
    seconds, cpu_seconds = time.perf_counter() - begin, time.process_time() - cpu
    model, held = stages.walkthrough, stages.held
    assert held is not None
    poses = stages.held_poses or None
    rows = [
        drawn_row("this walkthrough", model, held, poses=poses),
        drawn_row("the same, gaps of up to 8 pixels closed", model, held, DrawOptions(gap_pixels=8), poses=poses),
        drawn_row(
            "the same, without colours that depend on the view",
            model,
            held,
            DrawOptions(view_colors=False),
            poses=poses,
        ),
    ]
    rows += [_tsdf(stages, voxel, held, poses) for voxel in study.voxels]
    rows += [
        peer_row("the nearest photo warped", warp_nearest(stages.capture, 1), held, model, poses),
        peer_row("the 4 nearest photos warped", warp_nearest(stages.capture, 4), held, model, poses),
    ]
    given = build_given(sequence, hold_out)
    given_rows = [_tsdf(given, voxel, held) for voxel in study.voxels] if poses else []
    return {
        "report": {k: v for k, v in model.report.items() if k not in ("left_out", "gains")},
        "seconds": seconds,
        "cpu_seconds": cpu_seconds,
        "rows": [asdict(r) for r in rows],
        "rows_as_given": [asdict(replace(r, name=f"{r.name}, poses as given")) for r in given_rows],
    }


def build_given(sequence: RgbdSequence, hold_out: int) -> Stages:
    """The photos with their own poses and colours, for what is compared with."""
    options = WalkthroughOptions(
        registration="off", exposure="off", n_min=5000, view_detail=0, fill="off", max_points=1000
    )
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return build_stages(sequence, options, hold_out=hold_out)


def main() -> None:
    """The command line."""
    parser = argparse.ArgumentParser(prog="python -m torchrender.report.walkthrough", description=__doc__)
    parser.add_argument("-o", "--output", default="docs/results", metavar="FOLDER", help="default docs/results")
    parser.add_argument("--only", nargs="+", choices=PARTS, default=PARTS, help="measure these parts alone")
    parser.add_argument("--quick", action="store_true", help="small pictures, to see that it runs")
    arguments = parser.parse_args()
    root = Path(__file__).resolve().parents[3]
    data = Path(os.environ.get("TORCHRENDER_DATA", root.parent / "shared" / "data"))
    torch.manual_seed(0)
    study = QUICK if arguments.quick else StudyOptions()
    run(study, Path(arguments.output), data if data.is_dir() else None, arguments.only)
