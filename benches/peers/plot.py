#!/usr/bin/env python3
"""Error over time of all renderers, a panel for each scene, as an SVG.

python plot.py DIR/peers.csv OUT.svg
"""

import csv
import math
import sys
from collections import defaultdict
from pathlib import Path

# Dark enough on white, light enough on black; the dash tells them apart in grey as well.
STYLES = {
    "wavecast": ("#d9480f", ""),
    "mitsuba": ("#1c7ed6", "6 3"),
    "cycles": ("#2b8a3e", "2 2"),
    "luxcore": ("#9c36b5", "8 2 2 2"),
}
SPARE = ("#868e96", "1 3")
PANEL, GAP, COLUMNS = (220, 190), (44, 52), 4


def curves(path):
    """By scene and renderer, geometric means over the seeds: (seconds, relMSE), in the order of the file."""
    seen = defaultdict(lambda: defaultdict(lambda: defaultdict(list)))
    with open(path, newline="") as file:
        for row in csv.DictReader(file):
            error = float(row["relmse_trimmed"])
            if error > 0:
                values = (math.log10(float(row["seconds"])), math.log10(error))
                seen[row["scene"]][row["renderer"]][float(row["spp"])].append(values)
    mean = lambda values: tuple(sum(of) / len(values) for of in zip(*values))
    return {
        scene: {name: [mean(rungs[spp]) for spp in sorted(rungs)] for name, rungs in renderers.items()}
        for scene, renderers in seen.items()
    }


def panel(out, at, scene, renderers):
    (x0, y0), (width, height) = at, PANEL
    points = [point for line in renderers.values() for point in line]
    (left, right), (bottom, top) = [
        (math.floor(min(of) * 2 - 0.2) / 2, math.ceil(max(of) * 2 + 0.2) / 2) for of in zip(*points)
    ]
    place = lambda t, e: (x0 + (t - left) / (right - left) * width, y0 + (top - e) / (top - bottom) * height)
    out.append(f'<rect x="{x0}" y="{y0}" width="{width}" height="{height}" class="frame"/>')
    out.append(f'<text x="{x0}" y="{y0 - 6}" class="name">{scene}</text>')
    for power in range(math.ceil(left), math.floor(right) + 1):
        x, _ = place(power, top)
        out.append(f'<line x1="{x:.1f}" y1="{y0}" x2="{x:.1f}" y2="{y0 + height}" class="grid"/>')
        out.append(f'<text x="{x:.1f}" y="{y0 + height + 13}" class="tick" text-anchor="middle">{10.0**power:g} s</text>')
    for power in range(math.ceil(bottom), math.floor(top) + 1):
        _, y = place(left, power)
        out.append(f'<line x1="{x0}" y1="{y:.1f}" x2="{x0 + width}" y2="{y:.1f}" class="grid"/>')
        out.append(f'<text x="{x0 - 4}" y="{y + 4:.1f}" class="tick" text-anchor="end">{10.0**power:g}</text>')
    for name, line in renderers.items():
        color, dash = STYLES.get(name, SPARE)
        path = " ".join("{:.1f},{:.1f}".format(*place(*point)) for point in line)
        width_of = 2.5 if name == "wavecast" else 1.6
        out.append(
            f'<polyline points="{path}" fill="none" stroke="{color}" stroke-width="{width_of}" stroke-dasharray="{dash}"/>'
        )
        out += ['<circle cx="{:.1f}" cy="{:.1f}" r="2.4" fill="{}"/>'.format(*place(*p), color) for p in line]


def draw(scenes):
    rows = math.ceil(len(scenes) / COLUMNS)
    width = COLUMNS * (PANEL[0] + GAP[0]) + GAP[0] / 2
    height = rows * (PANEL[1] + GAP[1]) + 40
    out = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width:.0f} {height:.0f}" font-family="sans-serif">',
        "<style>.frame{fill:none;stroke:#888}.grid{stroke:#8886;stroke-width:.5}.tick{font-size:10px;fill:#777}"
        ".name{font-size:13px;font-weight:bold;fill:#777}</style>",
    ]
    for i, (scene, renderers) in enumerate(scenes.items()):
        at = (GAP[0] + i % COLUMNS * (PANEL[0] + GAP[0]), 24 + i // COLUMNS * (PANEL[1] + GAP[1]))
        panel(out, at, scene, renderers)
    names = list(dict.fromkeys(name for renderers in scenes.values() for name in renderers))
    for i, name in enumerate(names):
        x, y = GAP[0] + 130 * i, height - 16
        color, dash = STYLES.get(name, SPARE)
        out.append(f'<line x1="{x}" y1="{y}" x2="{x + 28}" y2="{y}" stroke="{color}" stroke-width="2.5" stroke-dasharray="{dash}"/>')
        out.append(f'<text x="{x + 34}" y="{y + 4}" class="name">{name}</text>')
    where = f'<text x="{width - 12:.0f}" y="{height - 12}" class="tick" text-anchor="end">relMSE, without the worst 0.1 % of pixels, over seconds</text>'
    return "\n".join([*out, where, "</svg>"]) + "\n"


if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    Path(sys.argv[2]).write_text(draw(curves(sys.argv[1])))
