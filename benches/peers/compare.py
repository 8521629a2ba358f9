#!/usr/bin/env python3
"""Time to equal error of wavecast and its peers, on the same scenes, in turn, in one run.

    python compare.py                                 all scenes of the table below that are there
    python compare.py cornell door --budget 5 --reference 15
    python compare.py my.glb --sky 1,1,1 --peers mitsuba,cycles-guided

See README.md for what is measured and how.
"""

import argparse
import sys
import time
from pathlib import Path

import numpy as np

import report
from errors import Reference, agreement, combined, pooled, relmse
from renderers import PEERS, Failed, Scene, Wavecast, Worker, render

ROOT = Path(__file__).resolve().parents[2]
# Name, file, and sky: a colour in nit or a lat-long picture.
SCENES = [
    ("cornell", "cornell.gltf", None),
    ("plates", "plates.gltf", None),
    ("caustic", "caustic.glb", None),
    ("lights", "lights.glb", None),
    ("outdoor", "outdoor.gltf", "sky.hdr"),
    ("door", "door.gltf", None),
    ("million", "million.glb", "0.6,0.8,1"),
]
# Each budget is this many times the one before.
STEP = 4
# Pictures that a reference is made of; their spread is its noise.
PARTS = 4
REFERENCE_SEED = 1000
# What two renderers' pictures may add to each other's relMSE and still serve as reference to each other.
HARMLESS = 0.05 * report.TARGET
# The same as a share of their own noise.
DROWNED = 0.1
# Share of the processors that others may have while a render is timed.
QUIET = 0.05


def note(text):
    print(text, file=sys.stderr, flush=True)


def sky_of(text, folder):
    if text is None:
        return None
    try:
        color = tuple(float(x) for x in text.split(","))
    except ValueError:
        return folder / text
    return color * 3 if len(color) == 1 else color


def scenes_of(options):
    known = {name: (name, options.scenes / file, sky_of(sky, options.scenes)) for name, file, sky in SCENES}
    if not options.names:
        chosen = [entry for entry in known.values() if entry[1].exists()]
    else:
        chosen = [known.get(n) or (Path(n).stem, Path(n), sky_of(options.sky, Path.cwd())) for n in options.names]
    for name, path, sky in chosen:
        for file in (path, sky):
            if isinstance(file, Path) and not file.exists():
                raise SystemExit(f"error: there is no {file}")
    return [Scene(name, path, sky, options.size) for name, path, sky in chosen]


# Rendering.


def largest_power(renderer, budget):
    """Samples per pixel that fit into a budget, as a power of two, which low-discrepancy sequences are best at.

    Beside it the first picture, and what it took longer than the next of as many samples: compiling.
    """
    first, spp, compiled = render(renderer, 1, 0), 1, None
    while True:
        seconds = render(renderer, spp, 0).seconds
        if compiled is None:
            compiled = max(first.seconds - seconds, 0.0)
        fitting = spp * budget / max(seconds, 1e-3)
        # Short renders are mostly overhead.
        if seconds >= 0.05 * budget or fitting < 2 * spp:
            return 2 ** int(np.log2(max(fitting, 1.0))), first, compiled
        spp = 2 ** max(int(np.log2(fitting * 0.1)), int(np.log2(spp)) + 1)


def ladder(top):
    rungs = [top]
    while rungs[-1] > 1:
        rungs.append(max(rungs[-1] // STEP, 1))
    return rungs[::-1]


def reference_parts(renderer, scene, spp, options):
    """Pictures of other seeds than those that are judged; kept on disk."""
    path = options.cache / f"{scene.name}-{renderer.name}-{scene.key()[:16]}-{renderer.key()[:16]}-{spp}.npz"
    if path.exists():
        return list(np.load(path)["pictures"])
    pictures = [render(renderer, spp, REFERENCE_SEED + part).picture for part in range(PARTS)]
    np.savez_compressed(path, pictures=np.array(pictures))
    return pictures


class Measured:
    """All there is of one renderer on one scene."""

    def __init__(self, renderer, build, compiled, rungs, parts, parts_spp):
        self.renderer, self.build, self.compiled, self.rungs = renderer, build, compiled, rungs
        self.parts, self.parts_spp = parts, parts_spp
        # Rung after rung, seed after seed.
        self.rendered = [[] for _ in rungs]

    def long(self):
        """Its pictures of most samples and their numbers."""
        tops = self.rendered[-1]
        return self.parts + [r.picture for r in tops], [self.parts_spp] * len(self.parts) + [r.spp for r in tops]

    def own_reference(self):
        return pooled(self.parts, [self.parts_spp] * len(self.parts))


def measure(scene, renderers, options):
    """Renders all of a scene; gives the renderers' `Measured` by name, and why the others have none."""
    measured, absent = {}, {}
    for renderer in renderers:
        started = time.monotonic()
        build, cannot = renderer.load(scene)
        if cannot is not None:
            absent[renderer.name] = cannot
            note(f"  {renderer.name} is left out: {cannot}")
            continue
        top, first, compiled = largest_power(renderer, options.budget)
        rungs = ladder(top)
        spp = max(int(rungs[-1] * options.reference / options.budget / PARTS), 1)
        renderer.prepare(rungs)
        parts = reference_parts(renderer, scene, spp, options)
        measured[renderer.name] = Measured(renderer, build + first.overhead, compiled, rungs, parts, spp)
        note(f"  {renderer.name}: {rungs} spp, reference {PARTS} x {spp} spp, {time.monotonic() - started:.0f} s")
    order = list(measured.values())
    for level in range(max(len(m.rungs) for m in order), 0, -1):
        for seed in range(1, options.seeds + 1):
            # None always goes first, or after the same one.
            for entry in order[seed % len(order) :] + order[: seed % len(order)]:
                if level <= len(entry.rungs):
                    rendered = render(entry.renderer, entry.rungs[-level], seed)
                    entry.rendered[-level].append(rendered)
        note(f"  level -{level} done")
    return measured, absent


# Judging.


def references(measured):
    """For each renderer the reference it is judged by, and what to say about it."""
    pools = {name: pooled(*entry.long()) for name, entry in measured.items()}
    agreements, different, notes = {}, set(), []
    names = list(measured)
    for i, a in enumerate(names):
        for b in names[i + 1 :]:
            if measured[a].renderer.family == measured[b].renderer.family:
                continue
            found = agreements[a, b] = agreement(*measured[a].long(), *measured[b].long())
            # What drowns in the noise of the pictures is harmless as well.
            if found.differs(max(HARMLESS, DROWNED * (pools[a].noise() + pools[b].noise()))):
                different |= {(a, b), (b, a)}
                apart = f"{found.cells:.1e} ± {found.cells_error:.0e} apart, blocks {100 * found.systematic:.2f} %"
                notes.append(f"**{a} and {b} show different pictures**: beyond noise they are a relMSE of {apart}")
    chosen = {}
    for name, entry in measured.items():
        others = [n for n in names if measured[n].renderer.family != entry.renderer.family]
        agreeing = [n for n in others if (name, n) not in different]
        if agreeing:
            chosen[name] = combined([pools[n] for n in agreeing]), " + ".join(agreeing)
        else:
            chosen[name] = entry.own_reference(), "its own long render of other seeds"
            notes.append(f"**{name} is judged by its own long render**: no other agrees with it")
    return chosen, agreements, notes


def rows_of(scene, measured, chosen, scale):
    rows = []
    for name, entry in measured.items():
        reference: Reference = chosen[name][0]
        for rung, rendered in zip(entry.rungs, entry.rendered):
            for seed, r in enumerate(rendered, 1):
                plain, trimmed = relmse(r.picture, reference, scale)
                row = {"scene": scene.name, "renderer": name, "seed": seed, "spp": r.spp, "rung": rung}
                row |= {"seconds": r.seconds, "relmse": plain, "relmse_trimmed": trimmed}
                row |= {"mpaths_per_second": r.spp * scene.size**2 / r.seconds / 1e6, "disturbed": r.disturbed}
                rows.append(row)
    return rows


def run_scene(scene, renderers, options):
    note(f"{scene.name}")
    measured, absent = measure(scene, renderers, options)
    chosen, agreements, notes = references(measured)
    # What errors are relative to is the best picture of all; they are taken from others' pictures only.
    scale = combined([pooled(*entry.long()) for entry in measured.values()]).scale()
    rows = rows_of(scene, measured, chosen, scale)
    restless = [row for row in rows if row["rung"] == measured[row["renderer"]].rungs[-1] and row["disturbed"] > QUIET]
    if restless:
        worst = max(row["disturbed"] for row in restless)
        share = f"up to {100 * worst:.0f} % of it in {len(restless)} of the longest renders"
        notes.append(f"**the machine was not quiet**: others had {share}")
    rough = max(reference.noise(scale) for reference, _ in chosen.values())
    if rough > report.TARGET:
        notes.append(
            f"**references are not converged**: their own relMSE is up to {rough:.2g}; --reference takes longer"
        )
    entries = {}
    for name, entry in measured.items():
        reference, source = chosen[name]
        entries[name] = {"build_seconds": entry.build, "compile_seconds": entry.compiled, "rungs": entry.rungs}
        entries[name] |= {
            "reference": source,
            "reference_noise": reference.noise(scale),
            "mean": float(pooled(*entry.long()).picture.mean()),
        }
    report.save_pictures(options.out, scene.name, {n: pooled(*m.long()).picture for n, m in measured.items()})
    result = {"scene": scene.name, "renderers": entries, "absent": absent, "notes": notes}
    result["agreement"] = {f"{a} / {b}": vars(found) for (a, b), found in agreements.items()}
    result["rows"] = rows
    return result


def main():
    parser = argparse.ArgumentParser(description="Compares times to equal error.")
    parser.add_argument("names", nargs="*", metavar="SCENE", help=f"of {', '.join(s[0] for s in SCENES)}; or a file")
    parser.add_argument("--scenes", type=Path, default=ROOT / "scenes", help="the folder of the named scenes")
    parser.add_argument("--sky", help="of scenes given as files: a lat-long picture, or R,G,B in nit")
    parser.add_argument("--wavecast", type=Path, default=ROOT / "target/release/wavecast", help="the program")
    parser.add_argument("--wavecast-option", action="append", default=[], metavar="X", help="more for its command line")
    parser.add_argument("--peers", default="mitsuba,cycles,luxcore", help=f"of {','.join(PEERS)}")
    parser.add_argument("--budget", type=float, default=20.0, help="seconds of the longest renders")
    parser.add_argument("--reference", type=float, default=60.0, help="seconds of each renderer's reference pictures")
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--size", type=int, default=400, help="side of the square pictures, a multiple of 20")
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("-o", "--out", type=Path, default=ROOT / "target/peers/latest", help="folder of the results")
    parser.add_argument("--cache", type=Path, default=ROOT / "target/peers/references", help="folder of the references")
    options = parser.parse_args()
    if not options.wavecast.exists():
        parser.error(f"there is no {options.wavecast}; cargo build --release makes one")
    if options.size % 20 or options.size <= 0:
        parser.error("--size must be a multiple of 20")
    if options.seeds < 2:
        parser.error("--seeds must be at least 2, or there is no interval")
    scenes = scenes_of(options)
    for folder in (options.out, options.cache):
        folder.mkdir(parents=True, exist_ok=True)
    names = [name for name in options.peers.split(",") if name]
    for name in names:
        if name not in PEERS:
            parser.error(f"there is no peer {name}")
    renderers = [Wavecast(options.wavecast, options.threads, options.out, options.wavecast_option)]
    try:
        renderers += [Worker(name, options.threads, options.out) for name in names]
        results = {"settings": report.settings(options, renderers), "scenes": []}
        for scene in scenes:
            results["scenes"].append(run_scene(scene, renderers, options))
            # After each scene, so that a run that is stopped leaves what it has.
            report.write(results, options.out)
    except Failed as error:
        raise SystemExit(f"error: {error}") from None
    finally:
        for renderer in renderers:
            renderer.close()
    print((options.out / "peers.md").read_text())


if __name__ == "__main__":
    main()
