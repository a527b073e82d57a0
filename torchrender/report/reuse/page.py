"""The page of the study of reused reflections: tables beside the published numbers, and plots."""

from __future__ import annotations

import statistics
from collections.abc import Callable
from pathlib import Path
from typing import Any

from torchrender.images.files import write_atomically
from torchrender.quality.machine import machine_line
from torchrender.quality.pages import write_text
from torchrender.report.reuse.whole_page import whole_section

Frames = list[dict[str, Any]]

PUBLISHED_22 = {  # reflective %, ray tracing fps, reuse fps (max/min/mean), interval (max/mean), traced % (mean)
    "washroom walk1": ("55/45", "23.0/13.4/18.5", "54.9/13.0/33.4", "51/20.6", "20.8"),
    "washroom walk2": ("58/44", "22.4/14.0/18.0", "49.5/12.6/34.9", "63/20.0", "18.9"),
    "living_room walk1": ("62/50", "18.6/7.5/9.4", "50.8/7.0/34.7", "164/53.1", "18.4"),
    "living_room walk2": ("58/44", "12.8/6.4/8.8", "48.4/6.6/32.0", "92/24.2", "18.5"),
}
PUBLISHED_23 = {  # mean ms
    "washroom": {"diffuse": 0.6, "match": 3.4, "shift": 1.3, "warp": 2.7, "trace": 20.3, "blend": 0.9, "total": 29.3},
    "living_room": {
        "diffuse": 0.7,
        "match": 2.2,
        "shift": 1.7,
        "warp": 2.1,
        "trace": 23.2,
        "blend": 0.7,
        "total": 30.5,
    },
}
STEPS = ("match", "shift", "warp", "trace", "merge")
BINS = 6  # of distance from the key frame


def write_page(record: dict[str, Any], folder: Path) -> None:
    """``reflection-reuse.md`` and its plots in ``folder``."""
    walks: dict[str, dict[str, Any]] = record["walks"]
    study = record["study"]
    _plot(walks, folder / "reflection-reuse.png")
    lines = [
        "# Reflections used again, measured",
        "",
        f"`python -m torchrender.report.reuse` on {machine_line(record['machine'])}",
        "",
        f"{study['frames']} frames from the middle of each walk of {study['walk_frames']}, {study['size']}² pixels. "
        "Times are of the reflections alone unless said otherwise, with ray caster and shadow maps ready; tracing and "
        "reuse take turns frame by frame. Errors are those of the displayed picture, 0 to 255, against tracing every "
        "reflective pixel of every frame. The published numbers are from a graphics processor at 1024².",
        "",
        *_table_22(walks),
        *_table_23(walks),
        *_baselines(walks),
        *_errors(walks),
        *whole_section(walks, study),
        *_search(walks),
        *_whole(walks),
        *_pictures(walks),
        *_limits(),
    ]
    write_text(folder / "reflection-reuse.md", lines)


def _mean(frames: Frames, value: str | Callable[[dict[str, Any]], float]) -> float:
    """Mean of an entry, or of what is computed from a frame; 0 without frames."""
    values = [f[value] if isinstance(value, str) else value(f) for f in frames]
    return statistics.fmean(values) if values else 0.0


def _step(frames: Frames, name: str) -> float:
    return statistics.fmean([f["report"]["times_ms"].get(name, 0.0) for f in frames]) if frames else 0.0


def _baseline(frames: Frames, method: str, entry: str) -> float:
    return statistics.fmean([f["baselines"][method][entry] for f in frames]) if frames else 0.0


def _others(frames: Frames) -> Frames:
    """Frames that are not key frames."""
    return [f for f in frames if not f["report"]["key_frame"]]


def intervals(frames: Frames) -> list[int]:
    """Numbers of frames from a key frame to the next, the last one up to the end."""
    places = [k for k, f in enumerate(frames) if f["report"]["key_frame"]]
    return [b - a for a, b in zip(places, [*places[1:], len(frames)], strict=True)]


def _fps(frames: Frames, name: str) -> str:
    rates = [1e3 / (f["diffuse_ms"] + f[name]) for f in frames]
    return f"{max(rates):.1f}/{min(rates):.1f}/{1e3 / _mean(frames, lambda f: f['diffuse_ms'] + f[name]):.1f}"


def _table_22(walks: dict[str, dict[str, Any]]) -> list[str]:
    lines = [
        "## Walks (table 22)",
        "",
        "| Walk | Reflective %, max/mean | Tracing fps, max/min/mean | Reuse fps | Key-frame interval, max/mean "
        "| Traced anew %, mean | Tracing ms | Reuse ms | Less time |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    for label, walk in walks.items():
        frames: Frames = walk["frames"]
        shares = [100 * f["reflective_share"] for f in frames]
        gaps = intervals(frames)
        tracing, reuse = (_mean(frames, n) for n in ("trace_ms", "reuse_ms"))
        traced = 100 * _mean(_others(frames), lambda f: f["report"]["traced_share"])
        lines.append(
            f"| {label} | {max(shares):.0f}/{statistics.fmean(shares):.0f} | {_fps(frames, 'trace_ms')} "
            f"| {_fps(frames, 'reuse_ms')} | {max(gaps)}/{statistics.fmean(gaps):.1f} | {traced:.1f} | {tracing:.0f} "
            f"| {reuse:.0f} | {tracing / reuse:.2f}× |"
        )
        if label in PUBLISHED_22:
            cells = " | ".join(PUBLISHED_22[label])
            lines.append(f"| published | {cells} | | | |")
    lines += [
        "",
        "Frames per second hold the diffuse picture, too. Traced anew: without key frames, of which every pixel is "
        "traced; with them the mean shares are "
        + ", ".join(f"{100 * _mean(w['frames'], lambda f: f['report']['traced_share']):.1f} %" for w in walks.values())
        + ".",
        "",
    ]
    return lines


def _table_23(walks: dict[str, dict[str, Any]]) -> list[str]:
    lines = [
        "## Steps (table 23)",
        "",
        "Mean ms of frames that are no key frames.",
        "",
        "| Walk | Diffuse | Match | Shift | Warp | Trace | Merge and blend | Total | Key frame |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    for label, walk in walks.items():
        frames: Frames = walk["frames"]
        others = _others(frames)
        diffuse = _mean(others, lambda f: f["diffuse_ms"])
        steps = [_step(others, s) for s in STEPS]
        keys = [f for f in frames if f["report"]["key_frame"]]
        total = diffuse + _mean(others, lambda f: f["reuse_ms"])
        cells = " | ".join(f"{v:.1f}" for v in (diffuse, *steps, total, _mean(keys, lambda f: f["reuse_ms"])))
        lines.append(f"| {label} | {cells} |")
    for room, values in PUBLISHED_23.items():
        if any(label.startswith(room) for label in walks):
            cells = " | ".join(f"{v}" for v in values.values())
            lines.append(f"| published, {room} | {cells} | |")
    return [*lines, ""]


def _baselines(walks: dict[str, dict[str, Any]]) -> list[str]:
    lines = [
        "## Beside other ways to reuse",
        "",
        "All start from the same key frames; what a way does not find counts as traced, without error. *Depth* warps "
        "the old picture as if it were painted on the mirrors. *Motion vectors* follow the virtual picture behind the "
        "mirror's tangent plane, after Zeng et al. 2021.",
        "",
        "| Walk | Error: reuse | depth | motion vectors | Traced %: reuse | depth | motion vectors | Depth/reuse |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for label, walk in walks.items():
        frames = [f for f in walk["frames"] if "baselines" in f]
        own = _mean(frames, lambda f: f["error"])
        errors = [_baseline(frames, b, "error") for b in ("depth", "motion_vectors")]
        shares = [_baseline(frames, b, "traced_share") for b in ("depth", "motion_vectors")]
        traced = _mean(frames, lambda f: f["report"]["traced_share"])
        ratio = errors[0] / own if own else 0.0
        lines.append(
            f"| {label} | {own:.2f} | {errors[0]:.2f} | {errors[1]:.2f} | {100 * traced:.1f} | {100 * shares[0]:.1f} "
            f"| {100 * shares[1]:.1f} | {ratio:.1f}× |"
        )
    return [*lines, ""]


def _errors(walks: dict[str, dict[str, Any]]) -> list[str]:
    lines = [
        "## Errors",
        "",
        "Published mean absolute intensity errors of three pictures: 0.13, 0.45, 0.12. Occlusion error: share of the "
        "reflective pixels that are reused although the ray meets something more than 2 % nearer or farther. Change "
        "of the error: mean difference, over the picture, between the errors of a frame and of the one before: what "
        "pops, most of all where a key frame takes all error away at once.",
        "",
        "| Walk | Error over reflective pixels | over the picture | greatest of a frame | Occlusion error % "
        "| Change of the error | at key frames |",
        "|---|---|---|---|---|---|---|",
    ]
    for label, walk in walks.items():
        frames: Frames = walk["frames"]
        lines.append(
            f"| {label} | {_mean(frames, lambda f: f['error']):.2f} | {_mean(frames, lambda f: f['image_error']):.2f} "
            f"| {max(f['image_error'] for f in frames):.2f} "
            f"| {100 * _mean(frames, lambda f: f['occlusion_error']):.2f} "
            f"| {_popping(_others(frames))} | {_popping([f for f in frames if f['report']['key_frame']])} |"
        )
    lines += ["", "![Error and reuse against the distance from the key frame](reflection-reuse.png)", ""]
    return lines


def _popping(frames: Frames) -> str:
    changes = [f["popping"] for f in frames if "popping" in f]
    return f"{statistics.fmean(changes):.2f}" if changes else "–"


def _search(walks: dict[str, dict[str, Any]]) -> list[str]:
    lines = [
        "## Search",
        "",
        "Steps of the walk over neighbours alone, with and without the last frame's matches to start from; and what "
        "became of the key frame's pixels with the search that is used (Gauss-Newton steps, then the walk).",
        "",
        "| Walk | Steps, started | cold | Same end % | Match % | Border % | Silhouette % | No minimum % | Cut off % |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    for label, walk in walks.items():
        searched = [f["search"] for f in walk["frames"] if "search" in f]
        others = [f["report"]["matches"] for f in _others(walk["frames"])]
        total = sum(sum(m.values()) for m in others) or 1
        causes = [100 * sum(m[c] for m in others) / total for c in ("valid", "border", "silhouette", "ratio", "steps")]
        steps = [_mean(searched, n) for n in ("warm", "cold", "unchanged")]
        cells = " | ".join(f"{c:.1f}" for c in causes)
        lines.append(f"| {label} | {steps[0]:.2f} | {steps[1]:.2f} | {100 * steps[2]:.1f} | {cells} |")
    lines += ["", "Why pixels of the new picture are traced, % of the reflective ones:", ""]
    fates = [k for k in next(iter(_fates(walks).values()), {}) if k != "found"]
    lines += ["| Walk | " + " | ".join(fates) + " |", "|---" * (len(fates) + 1) + "|"]
    for label, row in _fates(walks).items():
        lines.append(f"| {label} | " + " | ".join(f"{row[k]:.1f}" for k in fates) + " |")
    return [*lines, ""]


def _fates(walks: dict[str, dict[str, Any]]) -> dict[str, dict[str, float]]:
    out = {}
    for label, walk in walks.items():
        counts = [f["report"]["pixels"] for f in _others(walk["frames"])]
        total = sum(sum(c.values()) for c in counts) or 1
        out[label] = {k: 100 * sum(c[k] for c in counts) / total for k in (counts[0] if counts else {})}
    return out


def _whole(walks: dict[str, dict[str, Any]]) -> list[str]:
    lines = [
        "## Whole pictures",
        "",
        "`render(scene, camera, history=image.history)` also keeps ray caster and shadow maps of a scene that stands "
        "still. Median ms of a picture:",
        "",
        "| Walk | Without history | With history | Less time |",
        "|---|---|---|---|",
    ]
    for label, walk in walks.items():
        alone, kept = walk["rendered"]["alone"], walk["rendered"]["with_history"]
        lines.append(f"| {label} | {alone:.0f} | {kept:.0f} | {alone / kept:.1f}× |")
    return [*lines, ""]


def _pictures(walks: dict[str, dict[str, Any]]) -> list[str]:
    lines = ["## Pictures", "", "Reused picture; its error × 50; error × 50 of a warp by depth.", ""]
    for label in walks:
        name = label.replace(" ", "-")
        lines += [f"![{label}](reflection-reuse-{name}.png)", ""]
    lines += ["Frames along the walks:", ""]
    for label in walks:
        name = label.replace(" ", "-")
        lines += [f"![{label}, frames](reflection-reuse-{name}-frames.png)", ""]
    return lines


def _limits() -> list[str]:
    return [
        "## Limits",
        "",
        "What a mirrored mirror shows, and highlights on what is mirrored, depend on the eye: they are reused as the "
        "key frame saw them, and make most of what error is left. Edges that are mirrored are traced where the "
        "difference is seen (`ReuseOptions.contrast`), which bounds the error and costs rays.",
        "",
    ]


def _plot(walks: dict[str, dict[str, Any]], path: Path) -> None:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10, 3.6), layout="constrained")
    left, right = figure.subplots(1, 2)
    for label, walk in walks.items():
        frames = [f for f in walk["frames"] if "key_distance" in f]
        if not frames:
            continue
        far = max(f["key_distance"] for f in frames) or 1.0
        points = []
        for k in range(BINS):
            inside = [f for f in frames if k * far / BINS <= f["key_distance"] <= (k + 1) * far / BINS]
            if inside:
                distance = _mean(inside, lambda f: f["key_distance"])
                error, traced = (
                    _mean(inside, v) for v in (lambda f: f["error"], lambda f: f["report"]["traced_share"])
                )
                painted = _mean(inside, lambda f: f["baselines"]["depth"]["error"])
                points.append((distance, error, painted, 100 * traced))
        x, own, depth, traced_share = zip(*points, strict=True)
        (line,) = left.plot(x, own, marker="o", label=label)
        left.plot(x, depth, linestyle=":", color=line.get_color())
        right.plot(x, traced_share, marker="o", color=line.get_color(), label=label)
    left.set_yscale("log")
    left.set_xlabel("distance of the eye from the key frame")
    left.set_ylabel("error, 0-255 (dotted: warp by depth)")
    right.set_xlabel("distance of the eye from the key frame")
    right.set_ylabel("traced anew, %")
    right.set_ylim(bottom=0)
    right.legend(fontsize=8)
    write_atomically(path, lambda temporary: figure.savefig(temporary, dpi=110))
