#!/usr/bin/env python3
"""The tables of a comparison, from its rows.

python report.py DIR            writes DIR's tables again from its peers.json
python report.py DIR PART…      writes them from those of several runs of some scenes each
"""

import csv
import json
import math
import os
import platform
import sys
import time
from pathlib import Path

import numpy as np

from errors import log_mean, ratio_of, span, time_to

# The relMSE that is wanted of a picture.
TARGET = 0.01
OURS = "wavecast"
STATISTICS = {"relmse_trimmed": "trimmed", "relmse": "plain"}
COLUMNS = ["scene", "renderer", "seed", "spp", "seconds", "relmse", "relmse_trimmed", "mpaths_per_second", "disturbed"]


def settings(options, renderers):
    cpu = [
        line.split(":", 1)[1].strip() for line in Path("/proc/cpuinfo").read_text().splitlines() if "model name" in line
    ]
    made = {
        "date": time.strftime("%Y-%m-%d"),
        "cpu": f"{cpu[0] if cpu else platform.processor()}, {os.cpu_count()} threads",
    }
    made |= {"threads": options.threads, "size": options.size, "budget_seconds": options.budget, "seeds": options.seeds}
    made |= {"reference_seconds": options.reference, "wavecast_options": options.wavecast_option}
    return made | {"versions": {renderer.name: renderer.version for renderer in renderers}}


def save_pictures(folder, name, pictures):
    """The mean pictures as EXR files, and all side by side to look at."""
    import mitsuba as mi

    for renderer, picture in pictures.items():
        mi.Bitmap(picture.astype(np.float32)).write(str(folder / f"{name}-{renderer}.exr"))
    strip = np.concatenate(list(pictures.values()), axis=1).astype(np.float32)
    strip *= 0.25 / max(float(np.median(strip)), 0.25 * float(strip.mean()))
    mi.Bitmap(strip).convert(mi.Bitmap.PixelFormat.RGB, mi.Struct.Type.UInt8, True).write(str(folder / f"{name}.png"))


# From rows to ratios.


def curves_of(result, statistic):
    """By renderer, a curve of (seconds, errors) for each seed; without what the reference's noise drowns."""
    curves = {}
    for row in result["rows"]:
        if row[statistic] > result["renderers"][row["renderer"]]["reference_noise"]:
            curve = curves.setdefault(row["renderer"], {}).setdefault(row["seed"], ([], []))
            curve[0].append(row["seconds"])
            curve[1].append(row[statistic])
    return {name: list(by_seed.values()) for name, by_seed in curves.items()}


def common_target(curves):
    """The error nearest to the wanted one that all curves pass through, and whether there is any."""
    least, greatest = span(curves)
    # A hair inside, so that rounding does not take an end away.
    return min(max(TARGET, least * 1.0001), greatest * 0.9999), least < greatest


def times(curves, target):
    found = [time_to(*curve, target) for curve in curves]
    return None if None in found else found


def duel(curves, peer):
    """Wavecast against one peer: the target, seconds of both, and the ratio with its interval."""
    ours, theirs = curves[OURS], curves[peer]
    target, possible = common_target(ours + theirs)
    if not possible:
        return None
    a, b = times(ours, target), times(theirs, target)
    if a is None or b is None:
        return None
    return {"target": target, "ours": log_mean(a)[0], "theirs": log_mean(b)[0], "ratio": ratio_of(a, b)}


def duels(result, statistic):
    curves = curves_of(result, statistic)
    return {
        peer: duel(curves, peer) for peer in result["renderers"] if peer != OURS and OURS in curves and peer in curves
    }


def top_rows(result, name):
    rows = [row for row in result["rows"] if row["renderer"] == name]
    most = max(row["rung"] for row in rows)
    return [row for row in rows if row["rung"] == most]


def mean_of(rows, value):
    return float(np.mean([value(row) for row in rows]))


def fastest(result, statistic):
    """The peer with the least ratio, and its duel."""
    found = [(d["ratio"][0], name, d) for name, d in duels(result, statistic).items() if d is not None]
    return min(found, default=(None, None, None), key=lambda f: f[0])


# Tables.


def three(x):
    """Three digits, without powers of ten where they can be helped."""
    if x is None:
        return "–"
    if not math.isfinite(x):
        return "∞"
    if x == 0 or not 1e-4 <= abs(x) < 1e5:
        return f"{x:.2g}"
    return f"{x:.{max(2 - math.floor(math.log10(abs(x))), 0)}f}"


def table(heads, rows):
    lines = ["| " + " | ".join(heads) + " |", "|" + "---|" * len(heads)]
    return "\n".join(lines + ["| " + " | ".join(map(str, row)) + " |" for row in rows])


def interval(ratio):
    return f"{three(ratio[0])} ({three(ratio[1])}–{three(ratio[2])})"


def scene_tables(result):
    trimmed, plain = duels(result, "relmse_trimmed"), duels(result, "relmse")
    rows = []
    for name, entry in result["renderers"].items():
        top = top_rows(result, name)
        spp, seconds = mean_of(top, lambda r: r["spp"]), mean_of(top, lambda r: r["seconds"])
        errors = [mean_of(top, lambda r: r[key]) for key in STATISTICS]
        paths = mean_of(top, lambda r: r["mpaths_per_second"])
        products = [mean_of(top, lambda r: r[key] * r["spp"]) for key in STATISTICS]
        built = three(entry["build_seconds"]) + " + " + three(entry["compile_seconds"])
        rows.append(
            [
                name,
                built,
                round(spp),
                three(seconds),
                *map(three, errors),
                three(paths),
                *map(three, products),
                entry["reference"],
                three(entry["reference_noise"]),
            ]
        )
    heads = [
        "renderer",
        "build + compile, s",
        "spp",
        "seconds",
        "relMSE trimmed",
        "plain",
        "Mpaths/s",
        "relMSE × spp trimmed",
        "plain",
        "judged by",
        "whose relMSE",
    ]
    parts = [f"### {result['scene']}", table(heads, rows)]
    rows = []
    for peer in trimmed:
        for label, d in (("trimmed", trimmed[peer]), ("plain", plain.get(peer))):
            if d is None:
                rows.append([peer, label, "–", "–", "–", "no error that both pass through"])
            else:
                rows.append(
                    [peer, label, three(d["target"]), three(d["theirs"]), three(d["ours"]), interval(d["ratio"])]
                )
    parts.append(table(["peer", "relMSE", "to reach", "its seconds", "wavecast's", "times as long"], rows))
    rows = []
    for pair, a in result["agreement"].items():
        rows.append(
            [
                pair,
                f"{a['ratio']:.5f} ± {a['ratio_error']:.5f}",
                f"{100 * a['noise']:.3f} %",
                f"{100 * a['systematic']:+.3f} %",
                f"{100 * a['upper']:.3f} %",
                f"{a['cells']:.1e} ± {a['cells_error']:.0e}",
            ]
        )
    parts.append(
        table(
            [
                "pictures of",
                "ratio of means",
                "joint noise of blocks",
                "apart beyond it",
                "at most (95 %)",
                "cells of 4 × 4 pixels apart, relMSE",
            ],
            rows,
        )
    )
    parts += [f"- {name} is left out: {why}" for name, why in result["absent"].items()]
    parts += [f"- {text}" for text in result["notes"]]
    return "\n\n".join(parts)


def summary(results):
    parts = []
    for statistic, label in STATISTICS.items():
        rows, ratios = [], []
        for result in results["scenes"]:
            _, name, d = fastest(result, statistic)
            if d is None:
                rows.append([result["scene"], "–", "–", "–", "–", "–", "–", "–"])
                continue
            ratios.append(d["ratio"][0])
            speeds = [mean_of(top_rows(result, n), lambda r: r["mpaths_per_second"]) for n in (name, OURS)]
            mitsuba = (
                mean_of(top_rows(result, "mitsuba"), lambda r: r["mpaths_per_second"])
                if "mitsuba" in result["renderers"]
                else None
            )
            rows.append(
                [
                    result["scene"],
                    name,
                    three(d["target"]),
                    three(d["theirs"]),
                    three(d["ours"]),
                    interval(d["ratio"]),
                    three(speeds[1]),
                    three(speeds[1] / mitsuba) if mitsuba else "–",
                ]
            )
        heads = [
            "scene",
            "fastest peer",
            f"relMSE ({label})",
            "its seconds",
            "wavecast's",
            "times as long",
            "wavecast's Mpaths/s",
            "over Mitsuba's",
        ]
        parts.append(table(heads, rows))
        if ratios:
            mean, least = three(log_mean(ratios)[0]), three(min(ratios))
            parts.append(f"Geometric mean of the ratios, {label}: {mean}; the least is {least}.")
    return "\n\n".join(parts)


def markdown(results):
    s = results["settings"]
    versions = ", ".join(f"{name} {version.removeprefix(name).strip()}" for name, version in s["versions"].items())
    size = f"{s['size']} × {s['size']}, budgets up to {s['budget_seconds']:g} s, {s['seeds']} seeds"
    head = f"{s['date']}; {s['cpu']}, {s['threads']} used; {size}. {versions}."
    parts = [f"# Times to equal error\n\n{head}", summary(results), *map(scene_tables, results["scenes"])]
    return "\n\n".join(parts) + "\n"


def write(results, folder):
    for result in results["scenes"]:
        result["duels"] = {label: duels(result, statistic) for statistic, label in STATISTICS.items()}
    (folder / "peers.json").write_text(json.dumps(results, indent=1, default=str))
    (folder / "peers.md").write_text(markdown(results))
    with open(folder / "peers.csv", "w", newline="") as file:
        writer = csv.DictWriter(file, COLUMNS, extrasaction="ignore", lineterminator="\n")
        writer.writeheader()
        for result in results["scenes"]:
            writer.writerows(result["rows"])


def main():
    folder, *parts = map(Path, sys.argv[1:])
    found = [json.loads((part / "peers.json").read_text()) for part in parts or [folder]]
    results = found[0] | {"scenes": [result for one in found for result in one["scenes"]]}
    folder.mkdir(parents=True, exist_ok=True)
    write(results, folder)


if __name__ == "__main__":
    main()
