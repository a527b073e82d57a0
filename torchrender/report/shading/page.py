"""The page of the study of shading."""

from __future__ import annotations

from typing import Any

from torchrender.quality.machine import machine_line
from torchrender.quality.pages import table
from torchrender.report.shading.mitsuba import SKY_SAMPLES


def page(record: dict[str, Any]) -> list[str]:
    """Lines of the Markdown page."""
    lines = ["# Shading", "", f"`python -m torchrender.report.shading` on {machine_line(record['machine'])}", ""]
    kept = record.get("kept", {})
    for commit in dict.fromkeys(kept.values()):
        names = ", ".join(name.replace("_", " ") for name, other in kept.items() if other == commit)
        lines.append(f"Kept from commit {commit}: {names}.")
    lines += [
        "",
        "Direct light by the compiled kernel, from the visibility buffer, beside what torch took from a whole G-buffer",
        "before there was a kernel. Both take turns in one run; milliseconds, medians. The third column is what the",
        "attributes of the G-buffer take, which the kernel does not need; the ratio with them counts them on torch's",
        "side. Pixels that differ by more than 1e-4 are those of today's twin in torch. Goal: 12 times at 512,",
        "15 times at 1024 pixels.",
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
    lines += _opengl(record["opengl"])
    lines += ["A white metal in a white surrounding; 1 is all of the light:", ""]
    balls = [[f"{r['roughness']:g}", f"{r['least']:.4f}", f"{r['most']:.4f}"] for r in record["furnace"]]
    lines += table(["roughness", "least", "most"], balls)
    lines += _mitsuba(record) + _skies(record["skies"]) + _glossy(record.get("glossy", []))
    return lines + _settings(record.get("settings", [])) + _rooms(record["rooms"])


def _mitsuba(record: dict[str, Any]) -> list[str]:
    """Balls of both programs, and pictures of Mitsuba's test suite."""
    found = record["mitsuba"]
    lines = ["## Beside Mitsuba", ""]
    if "missing" in found:
        lines += [found["missing"], ""]
    else:
        lines += [
            f"Balls of one material under one light, beside Mitsuba {found['version']} (`direct`, {found['samples']}",
            f"samples a pixel under lights with an area, {SKY_SAMPLES} times as many under environments): the ratio of",
            "the means over the ball, and PSNR against its brightest pixel; PSNR of Mitsuba's own noise, by two halves",
            "of its samples. Mitsuba counts one bounce between microfacets, so that its rough metals lose light; ours",
            "gives it back, as a white furnace asks. The last two columns leave that out. Grey plastics: the colour",
            "below Mitsuba's varnish is the one that shows ours from outside, along the normal.",
            "Goal: within 3 %, 35 dB.",
            "",
        ]
        head = ["ball", "light", "ratio", "PSNR dB", "noise dB", "one bounce: ratio", "PSNR dB"]
        lines += table(
            head,
            [
                [
                    r["ball"], r["light"], f"{r['ratio']:.3f}", f"{r['psnr']:.1f}", f"{r['noise']:.1f}",
                    *_once(r),
                ]
                for r in found["rows"]
            ],
        )  # fmt: skip
        lines += _short(found["rows"])
    if record["references"]:
        lines += ["Pictures that come with Mitsuba's test suite, eight by eight of our pixels on each of theirs:", ""]
        rows = [[r["name"], r["what"], f"{r['ratio']:.3f}", f"{r['psnr']:.1f}"] for r in record["references"]]
        lines += table(["scene", "what", "ratio", "PSNR dB"], rows)
    return lines


def _once(row: dict[str, Any]) -> tuple[str, str]:
    once = row["once"]
    return (f"{once['ratio']:.3f}", f"{once['psnr']:.1f}") if "conductor" in row["ball"] else ("", "")


def _short(rows: list[dict[str, Any]]) -> list[str]:
    """Which balls miss the goal, and why."""
    worst = [
        f"{r['ball']} under {r['light']} light"
        for r in rows
        if abs(r["once"]["ratio"] - 1.0) > 0.03 or r["once"]["psnr"] < 35.0
    ]
    if not worst:
        return ["All are within the goal.", ""]
    return [
        f"{len(worst)} of {len(rows)} miss it: {', '.join(worst)}.",
        "",
        "Where that comes from: glossy light of environments is the split-sum approximation, in which two round",
        "lobes, fitted in direction, width and share, stand for one that is long in the plane of the eye and cut by",
        "the horizon; highlights of area lights are linearly transformed cosines, with shorter tails than facets.",
        "",
    ]


def _skies(rows: list[dict[str, Any]]) -> list[str]:
    if not rows:
        return []
    lines = [
        "## Environment maps",
        "",
        "Diffuse irradiance by direction beside the sum over all pixels: relative errors over directions spread",
        "evenly and all colours. Pictures take a sun out as a light and read the rest from an octahedral map.",
        "Goal: 2 %.",
        "",
    ]
    head = ["map", "has a sun", "irradiance: mean", "largest", "pictures: mean", "largest"]
    cells = [
        [
            r["map"],
            "yes" if r["sun"] else "no",
            *(f"{100 * r[which][name]:.2f} %" for which in ("irradiance", "pictures") for name in ("mean", "largest")),
        ]
        for r in rows
    ]
    return lines + table(head, cells)


def _glossy(rows: list[dict[str, Any]]) -> list[str]:
    if not rows:
        return []
    lines = [
        "Glossy light of maps on balls, beside the sum of all pixels of the map over the lobe; right: the lobe",
        "seen along its normal, about the mirrored direction, summed over all pixels, too. Black plastic, white metal.",
        "",
    ]
    head = ["map", "material", "roughness", "ratio", "PSNR dB", "split sum: ratio", "PSNR dB"]
    cells = [
        [r["map"], r["material"], f"{r['roughness']:g}"]
        + [text for way in ("ours", "split_sum") for text in (f"{r[way]['ratio']:.3f}", f"{r[way]['psnr']:.1f}")]
        for r in rows
    ]
    return lines + table(head, cells)


def _settings(rows: list[dict[str, Any]]) -> list[str]:
    if not rows:
        return []
    lines = [
        "Error against time of ways to read the map, the same balls against the same sum over all of its pixels. Maps",
        "of mirrored light by the compiled kernel, with the whole of shading in their time; rays about the lobe in",
        "torch, the light of the map alone. What the maps take is spent once for each environment.",
        "",
    ]
    head = ["setting", "PSNR dB", "worst ratio", "ns a pixel", "once, ms"]
    cells = [
        [
            r["setting"],
            f"{r['psnr']:.1f}",
            f"{r['ratio']:.3f}",
            f"{r['each']:.0f}",
            f"{r['first']:.0f}" if r["first"] else "",
        ]
        for r in rows
    ]
    return lines + table(head, cells)


def _rooms(rows: list[dict[str, Any]]) -> list[str]:
    if not rows:
        return []
    lines = [
        "## Ambient visibility",
        "",
        "Pictures without mirrors by the usual search in depth images, beside 256 rays for each pixel: FLIP and",
        "PSNR of the picture; the same where ambient light is not hidden at all; mean error of the visibility of",
        "what is near and of the sky; time of the pass. Goal: FLIP 0.03, 60 ms at 512 pixels a side.",
        "",
    ]
    head = ["room", "FLIP", "PSNR dB", "FLIP without", "near", "sky", "ms", "rays: ms"]
    cells = [
        [
            r["room"], f"{r['flip']:.4f}", f"{r['psnr']:.1f}", *(f"{r[n]:.4f}" for n in ("without", "near", "sky")),
            f"{r['ms']:.1f}", f"{r['rays_ms']:.0f}",
        ]
        for r in rows
    ]  # fmt: skip
    return lines + table(head, cells)


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


def _opengl(rows: list[dict[str, Any]]) -> list[str]:
    """Whole pictures beside OpenGL in software."""
    if not rows:
        return ["OpenGL in software was not measured: VTK is not installed here.", ""]
    lines = [
        "Rasterising and shading with all lights of the scene, without shadows, beside VTK's textured picture with one",
        f"light on {rows[0]['renderer']}; milliseconds:",
        "",
    ]
    cells = [
        [
            r["scene"],
            f"{r['opengl']['median']:.1f}",
            f"{r['ours']['median']:.1f}",
            f"{r['opengl']['median'] / r['ours']['median']:.1f}",
        ]
        for r in rows
    ]
    return lines + table(["scene", "OpenGL", "here", "ratio"], cells)
