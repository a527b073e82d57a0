"""The page of results of walkthroughs."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from torchrender.images.files import write_atomically
from torchrender.quality.machine import machine_line
from torchrender.quality.pages import text_writer


def write_page(record: dict[str, Any], folder: Path) -> None:
    """Write ``walkthrough.md``."""
    write_atomically(folder / "walkthrough.md", text_writer("\n".join(_lines(record)) + "\n"))


def _lines(record: dict[str, Any]) -> Iterator[str]:
    yield "# Walkthroughs from RGB-D photos"
    yield ""
    yield (
        "Planes with textures and points, each piece of surface from the photo that sampled it best (specification 13)."
    )
    yield f"Measured on {machine_line(record['machine'])}"
    yield (
        f"The machine was shared: load {record['load'][0]:.1f} when it began, so wall times are upper bounds "
        "and processor"
        " time stands beside them. PSNR is of sRGB values over the pixels that show something; the empty rim of"
        " undistorted photos does not count."
    )
    yield ""
    if "synthetic" in record:
        yield from _synthetic(record["synthetic"])
    for part, title, text in _REAL:
        if part in record:
            yield from _real(title, record[part], text)
    yield from _notes()


def _synthetic(found: dict[str, Any]) -> Iterator[str]:
    r, frames, planar = found["report"], found["frames"], found["planar"]
    first = found["rows"][0]
    yield (
        f"## Our living room, {r['photos']} exact views of {r['size'][0]}x{r['size'][1]}, "
        f"{20 if r['photos'] > 20 else 2} held out"
    )
    yield ""
    yield "| | asked | source | measured |"
    yield "|---|---|---|---|"
    sizes = r["bytes"]
    yield (
        f"| size against 7 bytes a pixel | ≤ 40 % | 39.8 % | **{100 * r['size_share']:.1f} %** (textures"
        f" {sizes['textures'] / 1e6:.1f} MB, points {sizes['points'] / 1e6:.1f}, view colours"
        f" {sizes['view_colors'] / 1e6:.1f}) |"
    )
    yield (
        f"| planar pixels, precision | ≥ 0.98 | | **{planar['precision']:.3f}** "
        f"({planar['precision_any_size']:.4f} if flat pieces of any size count) |"
    )
    yield f"| planar pixels, recall | ≥ 0.90 | | **{planar['recall']:.3f}** |"
    yield f"| PSNR at held-out views | ≥ 28 dB | | **{first['psnr_db']:.1f} dB** |"
    before, after = found["uncovered"]["before"], found["uncovered"]["after"]
    yield f"| uncovered before / after filling | after ≤ 1 % | | {100 * before:.2f} % / **{100 * after:.2f} %** |"
    yield f"| pixels changed by culling | 0 | | **{frames['differing_pixels']}** |"
    yield (
        f"| worst frame of {frames['poses']} poses | ≤ 40 ms (source 83) | 83 ms | **{frames['worst_ms']:.0f} ms**;"
        f" median {frames['median_ms']:.0f}, 95 % below {frames['p95_ms']:.0f} |"
    )
    if "worst_cpu_ms" in frames:
        yield (
            f"| the same, processor time of both threads together | | | {frames['worst_cpu_ms']:.0f} ms; median"
            f" {frames['median_cpu_ms']:.0f} |"
        )
    flicker = found["flicker"]
    yield (
        "| change of filled places from frame to frame (MSE) | below screen-space filling | | "
        f"**{flicker['ours']:.2e}**"
        f" against {flicker['screen']:.2e} on {flicker['pixels']:.0f} pixels |"
    )
    yield ""
    yield (
        f"{r['planes']} planes, {r['points']:,} points in {r['objects']:,} objects; "
        f"{100 * r['kept_share']:.0f} % of pixels kept"
        f" after comparing photos; outlines of {r['corners']['raw']:,} corners simplified to {r['corners']['kept']:,};"
        f" {r['texels']['seen']:,} texels seen, {r['texels']['filled']:,} filled, {r['texels']['holes']:,} true holes."
        f" Culling leaves out {100 * frames['outside']:.0f} % of points as outside the view and "
        f"{100 * frames['hidden']:.1f} %"
        " as behind planes."
    )
    yield f"A frame, median: {', '.join(f'{k} {v:.0f} ms' for k, v in frames['steps_ms'].items())}."
    yield ""
    yield from _stages(found)
    yield from _origin(found)
    yield ""
    yield from _table(found["rows"])
    yield ""


def _stages(found: dict[str, Any]) -> Iterator[str]:
    ms = found["report"]["ms"]
    yield (
        f"Built in {found['seconds']:.0f} s ({found['cpu_seconds']:.0f} s of processor time): "
        + ", ".join(f"{k} {v / 1e3:.1f}" for k, v in ms.items())
        + " s."
    )


def _origin(found: dict[str, Any]) -> Iterator[str]:
    """Parts may be measured one by one: each says on what."""
    if found.get("commit"):
        yield f"Measured on commit {found['commit']}, with load {found['load']:.1f} on the machine when that run began."


def _table(rows: list[dict[str, Any]]) -> Iterator[str]:
    yield "| held-out views | PSNR, dB | covered, % | a frame, ms | size, MB | fuse, s |"
    yield "|---|---|---|---|---|---|"
    for row in rows:
        cells = [_number(row["psnr_db"], 1), _number(100 * row["coverage"], 2), _number(row["frame_ms"], 0)]
        cells += [_number(row["size_bytes"] / 1e6, 1), _number(row["build_s"], 1)]
        yield f"| {row['name']} | " + " | ".join(cells) + " |"


def _number(value: float | None, digits: int) -> str:
    return "" if value is None or math.isnan(value) else f"{value:.{digits}f}"


def _real(title: str, found: dict[str, Any], text: str) -> Iterator[str]:
    r = found["report"]
    yield f"## {title}"
    yield ""
    yield f"{r['photos']} photos of {r['size'][0]}x{r['size'][1]} to build from. {text}".rstrip()
    yield ""
    ours = found["rows"][0]
    tsdf = [row for row in found["rows"] if "TSDF" in row["name"] and not math.isnan(row["psnr_db"])]
    yield "| | asked | measured |"
    yield "|---|---|---|"
    if tsdf:
        best = max(tsdf, key=lambda row: row["psnr_db"])
        worst = min(tsdf, key=lambda row: row["psnr_db"])
        yield (
            f"| PSNR over TSDF | + 3 dB | **{ours['psnr_db'] - worst['psnr_db']:+.1f} dB** over {worst['name']},"
            f" **{ours['psnr_db'] - best['psnr_db']:+.1f} dB** over {best['name']} |"
        )
        quick = min(row["frame_ms"] for row in tsdf)
        yield f"| a frame | ≤ Open3D's ray cast | **{ours['frame_ms']:.0f} ms** against {quick:.0f} ms |"
    yield f"| coverage | ≥ 96 % | **{100 * ours['coverage']:.1f} %** |"
    yield f"| size against 7 bytes a pixel | ≤ 25 % | **{100 * r['size_share']:.1f} %** |"
    total = sum(r["ms"].values()) / 1e3
    yield (
        f"| preprocessing | ≤ 60 s for 88 photos of 640x480 | **{total:.0f} s** on the wall,"
        f" {found['cpu_seconds']:.0f} s of processor time with the held-out comparison |"
    )
    yield ""
    yield (
        f"Depths of photos agreed within {100 * r['disagreement_before']:.3f} % before and "
        f"{100 * r['disagreement_after']:.3f} %"
        f" after registration, which moved cameras by up to {1e3 * r['camera_moved']:.0f} mm. "
        f"{100 * r['planar_share']:.0f} % of"
        f" pixels lie on {r['planes']} planes; {r['points']:,} points; {100 * r['kept_share']:.0f} % kept."
    )
    yield from _origin(found)
    yield ""
    yield from _table([*found["rows"], *found["rows_as_given"]])
    yield ""


_REAL = (
    (
        "livingroom1",
        "`livingroom1`",
        "Every eighth photo held out. Its floor and chrome mirror: what photos saw differently is what the "
        "nearest photo"
        " gets right by itself. Windows have no depth.",
    ),
    (
        "slambook2",
        "`slambook2`",
        "Five photos only, half a metre apart, a third of their depth missing, poses by visual odometry: too "
        "few for any of"
        " the figures, shown because it is there.",
    ),
    (
        "noisy",
        "The room through a bad depth camera",
        "The living room with noise that grows with the square of depth, steps of disparity, holes at edges, drifting"
        " exposure, poses off by 4 mm and 0.1 degrees, and noise and blur of colour, along a walk. Every "
        "eighth photo is held"
        " out. Nothing was tuned on it.",
    ),
)


def _notes() -> Iterator[str]:
    yield "## What the rows mean"
    yield ""
    yield (
        "Held-out photos were not used. Where registration moved cameras, held-out cameras are located among "
        "the repaired ones"
        " by their own depth and brightness, and every row of the table uses these cameras and the repaired "
        "photos, Open3D's"
        " TSDF and the warps included; rows *as given* use what was in the files, all through."
    )
    yield ""
    yield (
        "*Colours that depend on the view* are residual pictures of each photo, a quarter of its size, that "
        "are added near it."
        " They count in the sizes. The size of points is 15 bytes each, of texels 4, as the source counts."
    )
