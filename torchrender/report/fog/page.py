"""The page of the fog study."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from torchrender.quality.machine import machine_line
from torchrender.quality.pages import table, write_text
from torchrender.report.fog.measures import PATCH_LIMIT, PUBLISHED

GAIN_DB = 6.0


def write_page(record: dict[str, Any], folder: Path) -> None:
    """``fog.md`` in ``folder``."""
    lines = [
        "# Fog, smoke and light shafts in a photograph, measured", "",
        f"`python -m torchrender.report.fog` on {machine_line(record['machine'])}; photos' times are"
        " the least of three.", "", *([record["note"], ""] if "note" in record else []),
        "![Cornell box and photos](fog.jpg)", "",
        "First row: the box in even air, clear, with fog by the reference, by the method, and twice their difference;"
        " second row: in uneven air. Then photos, before and after.", "",
        "![The page for marks](../fog-page.jpg)", "",
        "Marks are made in the browser, at `/fog.html` of `torchrender serve`: here by five strokes.", "",
    ]  # fmt: skip
    for part in (_asked, _verification, _centroid, _indirect, _kappa, _photos):
        lines += part(record)
    write_text(folder / "fog.md", lines)


def _percent(value: float, digits: int = 2) -> str:
    return f"{100 * value:.{digits}f} %"


def _best(record: dict[str, Any], varied: bool) -> dict[str, Any]:
    return next(r for r in record["verification"] if r["way"] == "patches" and r["varied"] == varied)


def _asked(record: dict[str, Any]) -> list[str]:
    even, uneven = _best(record, False), _best(record, True)
    rivals = [r for r in record["verification"] if "mean" not in r]
    least = min(
        next(r["psnr"] for r in record["verification"] if r["way"] == "patches" and r["varied"] == v)
        - max(r["psnr"] for r in rivals if r["varied"] == v)
        for v in (False, True)
    )
    rows = [
        ["direct light, even air: error of T", "mean 1 %, most 4 %",
         f"{_percent(even['mean'])}, {_percent(even['max'])}"],
        ["the same: PSNR", "45 dB", f"{even['psnr']:.1f} dB"],
        ["direct light, uneven air: error of T", "mean 2 %, most 8 %",
         f"{_percent(uneven['mean'])}, {_percent(uneven['max'])}"],
        ["the same: PSNR", "40 dB", f"{uneven['psnr']:.1f} dB"],
        ["better than every baseline by", f"{GAIN_DB:.0f} dB", f"{least:.1f} dB"],
        ["with bounces, ratio T: mean error", "5 %", _percent(max(r["ratio"] for r in record["indirect"]))],
        ["cuboids a tenth too small and turned, for the true boxes: PSNR", "report",
         ", ".join(f"{v:.1f} dB" for v in record["proxies"].values())],
        ["direction of the sun", "2 degrees", f"{record['sun']['deg']:.2f} degrees"],
        ["overlap at the start, and found", "not worse",
         f"{record['sun']['start_iou']:.3f}, {record['sun']['iou']:.3f}"],
        ["halo of a lamp over the median", "1.5", f"{record['halo']:.1f}"],
    ]  # fmt: skip
    if "labels" in record:
        rows.append(["labels beside LiDAR at 100 m: mean difference of T", "0.05", f"{record['labels']['mean']:.3f}"])
    if record["recovered"]:
        rows.append(
            ["extinction from own composites", "10 %", _percent(max(r["kappa_error"] for r in record["recovered"]), 0)]
        )
        rows.append(["airlight from own composites", "10 %",
                     _percent(max(r["airlight_error"] for r in record["recovered"]), 0)])  # fmt: skip
    if record["fade"]:
        rising = sum(all(a < b for a, b in zip(f["values"], f["values"][1:], strict=False)) for f in record["fade"])
        rows.append(["photos on which FADE rises with extinction", "all", f"{rising} of {len(record['fade'])}"])
    for name, first, again in (("room with a shaft", 1500, 300), ("road", 1000, 1000)):
        for row in record["photos"]:
            if row["name"] == name:
                rows.append([f"{name}, {row['size']}: first picture, another medium", f"{first} ms, {again} ms",
                             f"{row['ms']['first_ms']:.0f} ms, {row['ms']['again_ms']:.0f} ms (of all cores together"
                             f" {row['ms']['first_cpu_ms']:.0f} ms, {row['ms']['again_cpu_ms']:.0f} ms)"])  # fmt: skip
    return ["## Asked and measured", "", *table(["figure", "asked", "measured"], rows)]


def _verification(record: dict[str, Any]) -> list[str]:
    rows = []
    for r in record["verification"]:
        errors = (
            [_percent(r["mean"]), _percent(r["most"]), _percent(r["max"]), _percent(r["V"])]
            if "mean" in r
            else ["-"] * 4
        )
        rows.append([f"{r['way']}, {'uneven' if r['varied'] else 'even'} air", *errors, f"{r['psnr']:.1f}"])
    return [
        "## The box beside a reference renderer", "",
        "Extinction 0.1 per metre, scattering alone, direct light. The reference takes one random sample in each of"
        " 14 x 14 cells of the light at every pixel: the largest errors hold its noise. Patches are so small that"
        f" extinction times their diameter is at most {PATCH_LIMIT:g}.", "",
        *table(["way", "T mean", "T 99.9 %", "T largest", "V", "PSNR dB"], rows),
    ]  # fmt: skip


def _centroid(record: dict[str, Any]) -> list[str]:
    rows = []
    for (half, kappa), (even, uneven) in PUBLISHED.items():
        for varied, published in ((False, even), (True, uneven)):
            found = [r for r in record["centroid"] if (r["half"], r["kappa"], r["varied"]) == (half, kappa, varied)]
            means = [_percent(r["mean"]) for r in sorted(found, key=lambda r: r["patches"])]
            rows.append([f"{half} m, {kappa}, {'uneven' if varied else 'even'}", f"{published} %", *means])
    return [
        "## Lights by their centres", "",
        "Mean error of T for a square light of that half-width, one centre and 2 x 2 to 4 x 4 patches. Where the"
        " density's waves lie in the box is not told, so that uneven air can only be about alike.", "",
        *table(["half-width, extinction, air", "specification", "centre", "2 x 2", "3 x 3", "4 x 4"], rows),
    ]  # fmt: skip


def _indirect(record: dict[str, Any]) -> list[str]:
    rows = [[str(r["kappa"]), _percent(r["centroid_bias"], 0), _percent(r["ratio"], 1)] for r in record["indirect"]]
    return ["## With four bounces", "", "Closed box, albedo 0.7: how far T exceeds the survival of all light.", "",
            *table(["extinction", "centre: too bright by", "ratio: mean error"], rows)]  # fmt: skip


def _kappa(record: dict[str, Any]) -> list[str]:
    rows = [[f"{r['kappa']:g}", f"{r['T']:.3f}", f"{r['V']:.4f}", f"{r['T_ms']:.0f}", f"{r['V_ms']:.0f}"]
            for r in record["kappa"]]  # fmt: skip
    return ["## Means against extinction", "", *table(["1/m", "mean T", "mean V", "T ms", "V ms"], rows)]


def _photos(record: dict[str, Any]) -> list[str]:
    if not record["photos"]:
        return ["No photo was found.", ""]
    rows = [[r["name"], r["depth"], r["size"], f"{r['T']:.2f}", f"{r['V']:.2f}", f"{r['ms']['first_ms']:.0f}",
             f"{r['ms']['again_ms']:.0f}"] for r in record["photos"]]  # fmt: skip
    lines = ["## Photos", "", *table(["photo", "depth from", "size", "mean T", "mean V", "first ms", "again ms"], rows)]
    if record["fade"]:
        rows = [[f["photo"], *(f"{v:.2f}" for v in f["values"])] for f in record["fade"]]
        lines += [
            "FADE without fog, and with 0.3, 1 and 2 times the photo's own:",
            "",
            *table(["photo", "0", "0.3", "1", "2"], rows),
        ]
    rows = [[r["photo"], f"{r['visibility']:.0f} m", f"{r['kappa']:.4f}", f"{r['found']:.4f}",
             _percent(r["kappa_error"], 1),
             _percent(r["airlight_error"], 1)] for r in record["recovered"]]  # fmt: skip
    return [*lines, "Medium found again in own composites:", "",
            *table(["photo", "visibility", "extinction", "found", "error", "airlight"], rows)]  # fmt: skip
