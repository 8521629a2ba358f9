"""LuxCoreRender's path tracer."""

import math
import tempfile
import time
from pathlib import Path

import numpy as np

from gltf import MAX_DEPTH, write_ply

# Texels are made so much finer, as it interpolates between them.
FINER = 2
# From the sky's own axes, whose poles are ±Z, to the world's.
SKY = np.array([[-1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, -1.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]])
# How often it is asked whether it is done, in seconds.
POLL = 0.002


class Peer:
    name = "luxcore"

    def __init__(self, threads, sampler="SOBOL"):
        import pyluxcore

        self.lux, self.threads, self.sampler = pyluxcore, threads, sampler
        pyluxcore.Init(lambda message: None)
        self.version = pyluxcore.Version()
        self.folder = tempfile.TemporaryDirectory()

    def cannot(self, flat):
        if any(s.material.kind == "conductor" and s.material.alpha > 0.0 for s in flat.surfaces):
            return "its rough metals have Schlick's facets and not GGX's"
        return None

    def properties(self, prefix, values):
        made = self.lux.Properties()
        for name, value in values.items():
            if isinstance(value, tuple):
                # NumPy's numbers would be taken for bytes.
                value = [x if isinstance(x, int) else float(x) for x in value]
            made.Set(self.lux.Property(prefix + name, value))
        return made

    def load(self, flat, size):
        start = time.monotonic()
        self.size = size
        scene = self.scene = self.lux.Scene()
        eye, back = flat.camera[:3, 3], flat.camera[:3, 2]
        camera = {"type": "perspective", "lookat.orig": tuple(eye), "lookat.target": tuple(eye - back)}
        camera |= {"up": tuple(flat.camera[:3, 1]), "fieldofview": math.degrees(flat.yfov)}
        camera |= {"cliphither": 1e-3, "clipyon": 1e5, "lensradius": 0.0, "autovolume.enable": False}
        # Pictures come out one row too low, which is made up for here.
        row = 2.0 / size
        camera |= {"screenwindow": (-1.0, 1.0, -1.0 - row, 1.0 - row)}
        scene.Parse(self.properties("scene.camera.", camera))
        for index, surface in enumerate(flat.surfaces):
            self.surface(scene, surface, f"s{index}")
        self.sky(scene, flat.sky)
        return time.monotonic() - start

    def surface(self, scene, surface, name):
        path = Path(self.folder.name) / f"{name}.ply"
        write_ply(path, surface.positions, surface.normals, None, surface.triangles)
        scene.Parse(self.properties(f"scene.shapes.{name}.", {"type": "mesh", "ply": str(path)}))
        scene.Parse(self.properties(f"scene.materials.{name}.", self.material(surface.material)))
        scene.Parse(self.properties(f"scene.objects.{name}.", {"shape": name, "material": name}))

    def material(self, material):
        if material.kind == "glass":
            white = (1.0, 1.0, 1.0)
            made = {"type": "glass", "kr": white, "kt": white, "interiorior": material.ior, "exteriorior": 1.0}
        elif material.kind == "conductor":
            made = {"type": "mirror", "kr": (1.0, 1.0, 1.0)}
        else:
            made = {"type": "matte", "kd": material.color}
        if material.emission is not None:
            made |= {"emission": material.emission}
        return made

    def sky(self, scene, sky):
        if sky is None:
            return
        if isinstance(sky, tuple):
            scene.Parse(self.properties("scene.lights.sky.", {"type": "constantinfinite", "color": sky}))
            return
        texels = np.repeat(np.repeat(sky, FINER, axis=0), FINER, axis=1)
        height, width = texels.shape[:2]
        scene.DefineImageMap("sky", np.ascontiguousarray(texels, np.float32), 1.0, 3, width, height)
        light = {"type": "infinite", "file": "sky", "gamma": 1.0, "visibilitymapcache.enable": False}
        light |= {"transformation": tuple(SKY.T.ravel())}
        scene.Parse(self.properties("scene.lights.sky.", light))

    def config(self, spp, seed):
        values = {"renderengine.type": "PATHCPU", "renderengine.seed": seed, "native.threads.count": self.threads}
        values |= {"sampler.type": self.sampler, "sampler.sobol.adaptive.strength": 0.0}
        values |= {"sampler.random.adaptive.strength": 0.0}
        for kind in ("total", "diffuse", "glossy", "specular"):
            values[f"path.pathdepth.{kind}"] = MAX_DEPTH
        values |= {"path.clamping.variance.maxvalue": 0.0, "path.hybridbackforward.enable": False}
        values |= {"film.width": self.size, "film.height": self.size, "film.filter.type": "NONE"}
        values |= {
            "film.imagepipelines.0.0.type": "NOP",
            "film.outputs.0.type": "RGB",
            "film.outputs.0.filename": "x.exr",
        }
        values |= {"film.noiseestimation.warmup": 0, "batch.haltspp": (spp, 0), "screen.refresh.interval": 1}
        return self.properties("", values)

    def prepare(self, spps):
        pass

    def render(self, spp, seed):
        config = self.lux.RenderConfig(self.config(spp, seed), self.scene)
        session = self.lux.RenderSession(config)
        session.Start()
        while True:
            time.sleep(POLL)
            session.UpdateStats()
            if session.HasDone():
                break
        stats = session.GetStats()
        session.Stop()
        # Counted from when the accelerator stands.
        seconds = stats.Get("stats.renderengine.time").GetFloat()
        samples = stats.Get("stats.renderengine.total.samplecount").GetFloat()
        pixels = np.zeros(3 * self.size**2, np.float32)
        session.GetFilm().GetOutputFloat(self.lux.FilmOutputType.RGB, pixels, 0)
        return pixels.reshape(self.size, self.size, 3)[::-1], seconds, samples / self.size**2
