"""The page of the study of shading."""

from __future__ import annotations

from typing import Any

from torchrender.quality.machine import machine_line
from torchrender.quality.pages import table


def page(record: dict[str, Any]) -> list[str]:
    """Lines of the Markdown page."""
    lines = ["# Shading", "", f"`python -m torchrender.report.shading` on {machine_line(record['machine'])}", ""]
    lines += [
        "Direct light by the compiled kernel, from the visibility buffer, beside what torch took from a whole G-buffer",
        "before there was a kernel. Both take turns in one run; milliseconds, medians. The third column is what the",
        "attributes of the G-buffer take, which the kernel does not need; the ratio with them counts them on torch's",
        "side. Pixels that differ by more than 1e-4 are counted under ambient light, as the irradiance of environments",
        "was an approximation before. Goal: 12 times at 512, 15 times at 1024 pixels.",
        "",
    ]
    head = ["scene", "side", "torch", "attributes", "kernel", "ratio", "with attributes", "pixels that differ"]
    rows = [_direct(row) for row in record["direct_light"]]
    lines += table(head, rows)
    lines += _limit(record)
    lines += [
        "Metallic-roughness with five maps (colour, occlusion, roughness and metallic, normals, emission) beside the",
        "plain model with its colour texture alone. Goal: 1.6 times.",
        "",
    ]
    maps = [
        [r["scene"], str(r["side"]), f"{r['plain']['median']:.1f}", f"{r['all maps']['median']:.1f}", _ratio(r)]
        for r in record["all_maps"]
    ]
    lines += table(["scene", "side", "plain", "all maps", "ratio"], maps)
    lines += ["A white metal in a white surrounding; 1 is all of the light:", ""]
    balls = [[f"{r['roughness']:g}", f"{r['least']:.4f}", f"{r['most']:.4f}"] for r in record["furnace"]]
    return lines + table(["roughness", "least", "most"], balls)


def _direct(row: dict[str, Any]) -> list[str]:
    torch_ms, attributes, kernel = (row[name]["median"] for name in ("torch", "attributes", "kernel"))
    differ = "none" if not row["differ"] else f"{row['differ']}, by up to {row['largest']:.1e}"
    return [
        row["scene"], str(row["side"]), f"{torch_ms:.1f}", f"{attributes:.1f}", f"{kernel:.1f}",
        f"{torch_ms / kernel:.1f}", f"{(torch_ms + attributes) / kernel:.1f}", differ,
    ]  # fmt: skip


def _ratio(row: dict[str, Any]) -> str:
    return f"{row['all maps']['median'] / row['plain']['median']:.2f}"


def _limit(record: dict[str, Any]) -> list[str]:
    """How far from what memory and gathers alone would take."""
    limits, each = record["limits"], record["per_pixel"]
    last = [row for row in record["direct_light"] if row["side"] == record["direct_light"][-1]["side"]]
    shares = []
    for row in last:
        pixels = row["side"] ** 2
        bound = max(
            pixels * each["bytes"] / limits["bytes_per_s"],
            pixels * row["covered"] * each["gathers"] / limits["gathers_per_s"],
        )
        shares.append(row["kernel"]["median"] / (1e3 * bound))
    return [
        f"At {last[0]['side']} pixels a side the kernel takes {min(shares):.1f} to {max(shares):.1f} times what its",
        f"{each['gathers']} gathers and {each['bytes']} bytes per pixel would take alone at this machine's rates "
        f"({limits['bytes_per_s'] / 1e9:.0f} GB/s,",
        f"{limits['gathers_per_s'] / 1e9:.2f} G gathers/s).",
        "",
    ]
