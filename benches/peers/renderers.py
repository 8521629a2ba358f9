"""The renderers as the comparison sees them, each in a process of its own and all with the same few calls."""

import hashlib
import json
import os
import resource
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import mitsuba as mi
import numpy as np

from gltf import MAX_DEPTH

mi.set_variant("scalar_rgb")

HERE = Path(__file__).resolve().parent
# By name: the module, its options, and whose pictures are no independent witness.
PEERS = {
    "mitsuba": ("with_mitsuba", {}, "mitsuba"),
    "mitsuba-multijitter": ("with_mitsuba", {"sampler": "multijitter", "pass_spp": 64}, "mitsuba"),
    "cycles": ("with_cycles", {}, "cycles"),
    "cycles-guided": ("with_cycles", {"guiding": True}, "cycles"),
    "luxcore": ("with_luxcore", {}, "luxcore"),
}


class Failed(RuntimeError):
    """A renderer that did not do what it was asked."""


@dataclass
class Scene:
    """A file, its sky (None, a colour or the path of a lat-long picture), and the side of the square pictures."""

    name: str
    path: Path
    sky: object = None
    size: int = 400

    def key(self):
        digest = hashlib.sha256(self.path.read_bytes())
        digest.update(self.sky.read_bytes() if isinstance(self.sky, Path) else repr(self.sky).encode())
        digest.update(str(self.size).encode())
        return digest.hexdigest()


@dataclass
class Rendered:
    picture: np.ndarray
    seconds: float
    spp: float
    # Seconds beside rendering: moving the scene, building trees.
    overhead: float = 0.0
    # Share of the processors that others had meanwhile.
    disturbed: float = 0.0


def read_picture(path):
    bitmap = mi.Bitmap(str(path)).convert(mi.Bitmap.PixelFormat.RGB, mi.Struct.Type.Float32, False)
    return np.array(bitmap)


class Worker:
    """A peer, held in a worker process."""

    def __init__(self, name, threads, folder):
        module, options, self.family = PEERS[name]
        self.name, self.folder = name, folder
        command = [sys.executable, HERE / "worker.py", module, json.dumps({"threads": threads} | options)]
        self.log = open(folder / f"{name}.log", "ab")
        pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "stderr": self.log}
        self.process = subprocess.Popen(command, text=True, bufsize=1, **pipes)
        self.version = self.answer()["version"]

    def answer(self):
        line = self.process.stdout.readline()
        if not line:
            raise Failed(f"{self.name} ended; see {self.log.name}")
        answered = json.loads(line)
        if "error" in answered:
            raise Failed(f"{self.name}: {answered['error']}; see {self.log.name}")
        return answered

    def ask(self, **request):
        print(json.dumps(request), file=self.process.stdin, flush=True)
        return self.answer()

    def key(self):
        sources = [(HERE / f"{name}.py").read_bytes() for name in ("gltf", PEERS[self.name][0])]
        return hashlib.sha256(b"".join([self.name.encode(), self.version.encode(), *sources])).hexdigest()

    def load(self, scene):
        """Seconds that building the scene took, or why the scene cannot be rendered."""
        sky = scene.sky
        if isinstance(sky, Path):
            sky = str(self.folder / "sky.npy")
            np.save(sky, read_picture(scene.sky))
        answered = self.ask(do="load", scene=str(scene.path), sky=sky, size=scene.size)
        return answered.get("build"), answered.get("cannot")

    def prepare(self, spps):
        """Compiles what renders of so many samples need."""
        self.ask(do="prepare", spps=list(spps))

    def render(self, spp, seed):
        path = self.folder / f"{self.name}.npy"
        answered = self.ask(do="render", spp=spp, seed=seed, picture=str(path))
        return Rendered(np.load(path), answered["seconds"], answered["spp"], answered["overhead"])

    def cpu_seconds(self):
        text = Path(f"/proc/{self.process.pid}/stat").read_text()
        user, system = text.rsplit(")", 1)[1].split()[11:13]
        return (int(user) + int(system)) / os.sysconf("SC_CLK_TCK")

    def close(self):
        self.process.stdin.close()
        self.process.wait()


class Wavecast:
    """The program itself, started anew for each picture; its own clock tells loading from rendering."""

    name = family = "wavecast"

    def __init__(self, program, threads, folder, options=()):
        self.program, self.threads, self.folder, self.options = program, threads, folder, list(options)
        self.version = subprocess.run([program, "--version"], check=True, capture_output=True, text=True).stdout.strip()

    def key(self):
        return hashlib.sha256(Path(self.program).read_bytes() + repr(self.options).encode()).hexdigest()

    def load(self, scene):
        self.scene = scene
        return 0.0, None

    def prepare(self, spps):
        pass

    def render(self, spp, seed):
        picture, stats, scene = self.folder / "wavecast.exr", self.folder / "wavecast.json", self.scene
        command = [self.program, "render", scene.path, "-o", picture, "--size", f"{scene.size}x{scene.size}"]
        command += ["--filter", "box", "--max-depth", MAX_DEPTH, "--no-terminator-fix", "--threads", self.threads]
        command += ["--spp", spp, "--seed", seed, "--stats", stats, "--quiet", *self.options]
        if scene.sky is not None:
            command += ["--env", scene.sky if isinstance(scene.sky, Path) else ",".join(map(str, scene.sky))]
        done = subprocess.run(list(map(str, command)), capture_output=True, text=True)
        if done.returncode != 0:
            raise Failed(f"wavecast: {done.stderr.strip()}")
        said = json.loads(stats.read_text())
        seconds = said["seconds"]
        return Rendered(read_picture(picture), seconds["render"], said["spp"], seconds["load"] + seconds["sync"])

    def cpu_seconds(self):
        used = resource.getrusage(resource.RUSAGE_CHILDREN)
        return used.ru_utime + used.ru_stime

    def close(self):
        pass


def busy_seconds():
    """What all processors together have worked so far."""
    fields = list(map(int, Path("/proc/stat").read_text().split("\n", 1)[0].split()[1:9]))
    user, nice, system, idle, wait, irq, softirq, steal = fields
    return (user + nice + system + irq + softirq + steal) / os.sysconf("SC_CLK_TCK")


def render(renderer, spp, seed):
    """A picture, and how much else the machine did meanwhile."""
    before = busy_seconds() - renderer.cpu_seconds()
    rendered = renderer.render(spp, seed)
    others = busy_seconds() - renderer.cpu_seconds() - before
    rendered.disturbed = max(others, 0.0) / max(rendered.seconds, 0.01) / os.cpu_count()
    if not np.isfinite(rendered.picture).all():
        raise Failed(f"{renderer.name}: a picture has values that are not finite")
    return rendered
