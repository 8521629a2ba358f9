#!/usr/bin/env python3
"""Holds wavecast's light meters against Radiance's `rtrace -I`, and its glare ratings against `evalglare`; they share nothing.

    pip install pyradiance numpy       # written against pyradiance 1.3.1
    cargo build --release
    python3 tests/oracle/against_radiance.py

The scene is an office that this script writes twice, as glTF and as Radiance polygons, from the same boxes: matt floor,
walls and ceiling, four luminous panels under the ceiling, desks, screens and a cabinet. Illuminance is read at 20 points:
on desks, on the floor, under a desk, on walls, behind the cabinet.

Radiance cuts indirect light off after a number of bounces, and so does wavecast here; and it interpolates it between
places where it has been gathered, which is set so fine that little is left of that. It says no error, so it is run three times
with other random numbers, and the spread of these is taken for it. A point agrees if the two are within 1 %, or if the difference
is within their joint 95 % interval. Radiance's units are watts; the same numbers are taken for lumens here.

Glare is rated at three places, in Radiance from fisheye pictures of 800 x 800 pixels; UGR agrees if the two are within 0.3, of
which the pixels of the panels' rims alone are 0.1.

The exit code is 0 if all agree, 1 if not.
"""

import argparse
import base64
import json
import math
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
import pyradiance

ROOT = Path(__file__).resolve().parents[2]
# Behind the cabinet a tenth of the light has been scattered more often; both leave it out.
BOUNCES = 6
LUMINANCE = np.array([0.2126, 0.7152, 0.0722])

# Boxes: name, colour, corner, opposite corner; metres, up is +Y.
FLOOR, WALL, CEILING = [0.25, 0.22, 0.20], [0.6, 0.62, 0.6], [0.8, 0.8, 0.8]
WOOD, DARK, GREY = [0.45, 0.33, 0.22], [0.08, 0.08, 0.09], [0.5, 0.5, 0.52]
BOXES = []
for x in (-2.0, 1.0):
    for z in (-1.2, 1.2):
        BOXES.append((f"desk {x} {z}", WOOD, [x - 0.8, 0.70, z - 0.4], [x + 0.8, 0.73, z + 0.4]))
        BOXES.append((f"screen {x} {z}", DARK, [x - 0.3, 0.75, z - 0.03], [x + 0.3, 1.15, z + 0.03]))
        for side in (-0.75, 0.75):
            BOXES.append((f"leg {x} {z} {side}", GREY, [x + side - 0.03, 0.001, z - 0.35], [x + side + 0.03, 0.699, z + 0.35]))
BOXES.append(("cabinet", GREY, [2.3, 0.001, -1.9], [2.75, 1.8, 0.9]))
ROOM = ([-3.0, 0.0, -2.0], [3.0, 2.8, 2.0])
PANELS = [[x, z] for x in (-1.8, 1.2) for z in (-1.0, 1.0)]
PANEL_NIT, PANEL_EDGE, PANEL_DROP = 4000.0, 0.6, 0.02

UP = [0, 1, 0]
POINTS = (
    [([x + dx, 0.7305, z + dz], UP) for x in (-2.0, 1.0) for z in (-1.2, 1.2) for dx, dz in ((-0.5, 0.2), (0.4, -0.25))]
    + [([x, 0.0005, z], UP) for x, z in ((-0.5, 0.0), (2.0, 0.0), (-2.8, 1.8), (0.0, -1.9))]
    + [([-2.0, 0.0005, 1.2], UP), ([1.0, 0.4, -1.2], UP)]
    + [([-2.9995, y, 0.3], [1, 0, 0]) for y in (0.5, 1.6)]
    + [([2.9995, 1.0, -0.5], [-1, 0, 0]), ([0.2, 2.7995, 0.1], [0, -1, 0])]
    + [([0.0, 1.2, 1.9995], [0, 0, -1]), ([0.0, 1.2, 0.0], [1, 0, 0])]
)


# Eyes and what they look at.
VIEWS = [([-2.7, 1.2, 0.0], [2.0, 1.2, 0.0]), ([-2.0, 1.25, 1.8], [-2.0, 1.0, -1.2]), ([2.0, 1.6, 1.7], [-2.0, 1.4, -1.5])]
FISHEYE = 800
GLARE = 0.3


def faces(low, high, inside_out=False):
    """The six quads of a box, their corners counter-clockwise seen from outside."""
    corner = lambda i: [high[a] if i >> a & 1 else low[a] for a in range(3)]
    quads = [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]]
    return [[corner(i) for i in (reversed(quad) if inside_out else quad)] for quad in quads]


def surfaces():
    """Name, colour, emission and quads of all that is there."""
    room = faces(*ROOM, inside_out=True)
    for name, color, quads in (("walls", WALL, room[:2] + room[4:]), ("floor", FLOOR, [room[2]]), ("ceiling", CEILING, [room[3]])):
        yield name, color, 0.0, quads
    for name, color, low, high in BOXES:
        yield name, color, 0.0, faces(low, high)
    y = ROOM[1][1] - PANEL_DROP
    half = PANEL_EDGE / 2
    for x, z in PANELS:
        quad = [[x - half, y, z - half], [x + half, y, z - half], [x + half, y, z + half], [x - half, y, z + half]]
        yield f"panel {x} {z}", [0.0, 0.0, 0.0], PANEL_NIT, [quad]


def write_gltf(path):
    gltf = {"asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": []}], "nodes": [], "meshes": [], "materials": [],
            "accessors": [], "bufferViews": [], "extensionsUsed": ["KHR_materials_specular", "KHR_materials_emissive_strength"]}
    data = bytearray()

    def accessor(array, kind, component):
        gltf["bufferViews"].append({"buffer": 0, "byteOffset": len(data), "byteLength": array.nbytes})
        data.extend(array.tobytes())
        entry = {"bufferView": len(gltf["bufferViews"]) - 1, "componentType": component, "count": len(array), "type": kind}
        if kind == "VEC3":
            entry |= {"min": array.min(0).tolist(), "max": array.max(0).tolist()}
        gltf["accessors"].append(entry)
        return len(gltf["accessors"]) - 1

    for name, color, nit, quads in surfaces():
        positions = np.array([corner for quad in quads for corner in quad], np.float32)
        indices = np.array([4 * q + i for q in range(len(quads)) for i in (0, 1, 2, 0, 2, 3)], np.uint32)
        material = {"name": name, "pbrMetallicRoughness": {"baseColorFactor": [*color, 1.0], "metallicFactor": 0.0},
                    "extensions": {"KHR_materials_specular": {"specularFactor": 0.0}}}
        if nit > 0:
            material["emissiveFactor"] = [1.0, 1.0, 1.0]
            material["extensions"]["KHR_materials_emissive_strength"] = {"emissiveStrength": nit}
        gltf["materials"].append(material)
        gltf["meshes"].append({"primitives": [{"attributes": {"POSITION": accessor(positions, "VEC3", 5126)},
                                               "indices": accessor(indices, "SCALAR", 5125), "material": len(gltf["meshes"])}]})
        gltf["nodes"].append({"name": name, "mesh": len(gltf["meshes"]) - 1})
        gltf["scenes"][0]["nodes"].append(len(gltf["nodes"]) - 1)
    uri = "data:application/octet-stream;base64," + base64.b64encode(bytes(data)).decode()
    gltf["buffers"] = [{"byteLength": len(data), "uri": uri}]
    path.write_text(json.dumps(gltf))


def write_radiance(path):
    lines = []
    for i, (name, color, nit, quads) in enumerate(surfaces()):
        if nit > 0:
            lines.append(f"void light m{i} 0 0 3 {nit} {nit} {nit}")
        else:
            lines.append(f"void plastic m{i} 0 0 5 {color[0]} {color[1]} {color[2]} 0 0")
        for q, quad in enumerate(quads):
            numbers = " ".join(f"{c:.9g}" for corner in quad for c in corner)
            lines.append(f"m{i} polygon f{i}_{q} 0 0 12 {numbers}")
    path.write_text("\n".join(lines) + "\n")


def by_radiance(folder, rounds):
    """Illuminance by round and point."""
    scene, octree = folder / "office.rad", folder / "office.oct"
    write_radiance(scene)
    octree.write_bytes(pyradiance.oconv(scene))
    results = []
    for seed in range(rounds):
        # A tiny shift of the points starts other random numbers.
        shift = 1e-4 * seed
        rays = "".join(f"{p[0] + shift * (1 - abs(n[0]))} {p[1] + shift * (1 - abs(n[1]))} {p[2] + shift * (1 - abs(n[2]))} "
                       f"{n[0]} {n[1]} {n[2]}\n" for p, n in POINTS)
        parameters = (f"-ab {BOUNCES} -ad 1024 -as 256 -aa 0.15 -ar 128 -lr 8 -lw 1e-4 -ds 0.05 -dj 0.9 -dt 0 -dc 1 -st 0 -u+").split()
        out = pyradiance.rtrace(rays.encode(), octree, header=False, irradiance=True, params=parameters)
        results.append([float(np.array(line.split(), float)[:3] @ LUMINANCE) for line in out.decode().splitlines() if line.strip()])
    return np.array(results)


def by_wavecast(binary, folder, error):
    scene = folder / "office.gltf"
    write_gltf(scene)
    text = lambda v: ",".join(f"{c:.9g}" for c in v)
    words = [str(binary), "measure", str(scene), "--json", "--quiet", "--error", error, "--max-depth", str(BOUNCES)]
    for p, n in POINTS:
        words += ["--lux", text(p), text(n)]
    meters = json.loads(subprocess.run(words, check=True, capture_output=True, text=True).stdout)["meters"]
    return [(meter["value"], meter["interval"], meter["seconds"]) for meter in meters]


def glare_by_wavecast(binary, folder):
    """UGR by view."""
    ratings = []
    for eye, target in VIEWS:
        words = [str(binary), "measure", str(folder / "office.gltf"), "--json", "--quiet", "--error", "0.2%", "--glare", "--view",
                 ",".join(f"{c:.9g}" for c in eye + target), "--max-depth", str(BOUNCES)]
        meter = json.loads(subprocess.run(words, check=True, capture_output=True, text=True).stdout)["meters"][0]
        ratings.append((meter["value"], meter["interval"], len(meter["lamps"])))
    return ratings


def glare_by_radiance(folder):
    """UGR by view."""
    programs = Path(pyradiance.__file__).parent / "bin"
    ratings = []
    for eye, target in VIEWS:
        ahead = np.array(target) - np.array(eye)
        view = ["-vta", "-vp", *map(str, eye), "-vd", *map(str, ahead), "-vu", "0", "1", "0", "-vh", "180", "-vv", "180"]
        quality = f"-ab {BOUNCES} -ad 512 -as 128 -aa 0.2 -ar 64 -lr 8 -lw 1e-4 -dt 0 -dc 1 -ds 0.1 -dj 0.9 -pj 0 -ps 1 -pt 0".split()
        picture = folder / "fisheye.hdr"
        size = ["-x", str(FISHEYE), "-y", str(FISHEYE)]
        with picture.open("wb") as file:
            subprocess.run([programs / "rpict", *view, *size, *quality, folder / "office.oct"], check=True, stdout=file)
        # What is more than 1,000 nit is a source; all numbers are taken for watts, 179 lm each.
        line = subprocess.run([programs / "evalglare", "-b", str(1000 * 179), picture], check=True, capture_output=True, text=True).stdout
        names, values = line.strip().splitlines()[-1].split(": ")
        rating = dict(zip(names.split(","), map(float, values.split())))
        # UGR grows by 8 for each power of ten in the unit.
        ratings.append(rating["ugr"] - 8 * math.log10(179))
    return ratings


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--wavecast", type=Path, default=ROOT / "target/release/wavecast")
    parser.add_argument("--error", default="0.2%")
    parser.add_argument("--rounds", type=int, default=3)
    args = parser.parse_args()
    assert len(POINTS) == 20
    with tempfile.TemporaryDirectory() as name:
        own = by_wavecast(args.wavecast, Path(name), args.error)
        theirs = by_radiance(Path(name), args.rounds)
        own_glare = glare_by_wavecast(args.wavecast, Path(name))
        their_glare = glare_by_radiance(Path(name))
    bad = 0
    print(f"{'point':24} {'normal':10} {'wavecast lx':>12} {'±':>7} {'Radiance lx':>12} {'±':>7} {'off':>8}")
    for i, ((p, n), (value, (low, high), _)) in enumerate(zip(POINTS, own)):
        mean = theirs[:, i].mean()
        half = 4.303 * statistics.stdev(theirs[:, i]) / math.sqrt(args.rounds)
        off = value / mean - 1
        joint = math.hypot((high - low) / 2, half) / mean
        agrees = abs(off) <= max(0.01, joint)
        bad += not agrees
        print(f"{','.join(f'{c:g}' for c in p):24} {','.join(f'{c:g}' for c in n):10} {value:12.3f} {(high - low) / 2:7.3f} {mean:12.3f} "
              f"{half:7.3f} {100 * off:7.2f}%{'' if agrees else '  DIFFERS'}")
    print(f"{bad} of {len(POINTS)} points differ; mean of all: {100 * (sum(v for v, _, _ in own) / theirs.mean(0).sum() - 1):+.2f} %; "
          f"wavecast took {sum(s for _, _, s in own):.1f} s")
    dazzled = 0
    for (eye, target), (ugr, (low, high), lamps), theirs_ugr in zip(VIEWS, own_glare, their_glare):
        agrees = abs(ugr - theirs_ugr) <= GLARE
        dazzled += not agrees
        print(f"UGR at {eye} towards {target}: wavecast {ugr:.2f} ({low:.2f} to {high:.2f}, {lamps} lamps), evalglare {theirs_ugr:.2f}"
              f"{'' if agrees else '  DIFFERS'}")
    return 1 if bad or dazzled else 0


if __name__ == "__main__":
    sys.exit(main())
