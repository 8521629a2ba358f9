"""Mitsuba 3 in the variant that compiles its kernels with LLVM."""

import glob
import math
import os
import time

import numpy as np

from gltf import MAX_DEPTH, finer_environment


def find_llvm():
    """Dr.Jit takes the newest LLVM by name, but 15 crashes on processors with AVX-512."""
    for pattern in ("/usr/lib/*/libLLVM.so.19*", "/usr/lib/llvm-19/lib/libLLVM*.so*"):
        for path in sorted(glob.glob(pattern)):
            return path
    return None


def rgb(values):
    return {"type": "rgb", "value": [float(x) for x in values]}


class Peer:
    name = "mitsuba"

    def __init__(self, threads, sampler="independent", pass_spp=16, variant="llvm_ad_rgb"):
        llvm = find_llvm()
        if llvm is not None:
            os.environ.setdefault("DRJIT_LIBLLVM_PATH", llvm)
        import drjit as dr
        import mitsuba as mi

        self.dr, self.mi, self.sampler, self.pass_spp = dr, mi, sampler, pass_spp
        dr.set_thread_count(threads)
        mi.set_variant(variant)
        self.version = mi.__version__

    def cannot(self, flat):
        return None

    def load(self, flat, size):
        mi = self.mi
        start = time.monotonic()
        parts = {"type": "scene", "integrator": {"type": "path", "max_depth": MAX_DEPTH + 1}}
        for index, surface in enumerate(flat.surfaces):
            parts[f"surface-{index}"] = self.mesh(surface, f"surface-{index}")
        parts["sensor"] = self.sensor(flat, size)
        if isinstance(flat.sky, tuple):
            parts["sky"] = {"type": "constant", "radiance": rgb(flat.sky)}
        elif flat.sky is not None:
            # Mitsuba's middle column is +Z, and columns go on towards -X. It interpolates; half a texel's width of ramp
            # is little enough, and finer samples would make it slower.
            turn = mi.ScalarTransform4f().rotate([0.0, 1.0, 0.0], 90.0)
            texels = finer_environment(flat.sky, least_width=1).astype(np.float32)
            parts["sky"] = {"type": "envmap", "bitmap": mi.Bitmap(texels), "to_world": turn}
        self.scene = mi.load_dict(parts)
        self.dr.sync_thread()
        return time.monotonic() - start

    def mesh(self, surface, name):
        mi, material = self.mi, surface.material
        properties = mi.Properties()
        properties["bsdf"] = mi.load_dict(self.bsdf(material))
        if material.emission is not None:
            properties["emitter"] = mi.load_dict({"type": "area", "radiance": rgb(material.emission)})
        normals = surface.normals is not None
        if not normals:
            properties["face_normals"] = True
        counts = {"vertex_count": len(surface.positions), "face_count": len(surface.triangles)}
        mesh = mi.Mesh(name, **counts, has_vertex_normals=normals, props=properties)
        parameters = mi.traverse(mesh)
        parameters["vertex_positions"] = surface.positions.ravel()
        parameters["faces"] = surface.triangles.ravel().astype(np.uint32)
        if normals:
            parameters["vertex_normals"] = surface.normals.ravel()
        parameters.update()
        return mesh

    def bsdf(self, material):
        if material.kind == "glass":
            return {"type": "dielectric", "int_ior": material.ior, "ext_ior": 1.0}
        if material.kind == "lambert":
            bsdf = {"type": "diffuse", "reflectance": rgb(material.color)}
        elif material.alpha == 0.0:
            bsdf = {"type": "conductor", "material": "none"}
        else:
            bsdf = {"type": "roughconductor", "material": "none", "distribution": "ggx", "alpha": material.alpha}
        return {"type": "twosided", "bsdf": bsdf} if material.double_sided else bsdf

    def sensor(self, flat, size):
        # glTF: +X right, +Y up, -Z forward. Mitsuba: +X left, +Y up, +Z forward.
        to_world = self.mi.ScalarTransform4f(flat.camera @ np.diag([-1.0, 1.0, -1.0, 1.0]))
        film = {"type": "hdrfilm", "width": size, "height": size, "rfilter": {"type": "box"}}
        film |= {"pixel_format": "rgb", "component_format": "float32"}
        sensor = {"type": "perspective", "fov": math.degrees(flat.yfov), "fov_axis": "y", "to_world": to_world}
        return sensor | {"film": film, "sampler": {"type": self.sampler}, "near_clip": 1e-3, "far_clip": 1e5}

    def passes(self, spp):
        """Passes of one size, so that one compiled kernel serves all budgets."""
        whole, left = divmod(spp, self.pass_spp)
        return [self.pass_spp] * whole + [left] * (left > 0)

    def prepare(self, spps):
        """Compiles a kernel for each size of pass."""
        for size in sorted({size for spp in spps for size in self.passes(spp)}):
            np.array(self.mi.render(self.scene, spp=size, seed=0))

    def render(self, spp, seed):
        start, total = time.monotonic(), 0.0
        for index, size in enumerate(self.passes(spp)):
            picture = self.mi.render(self.scene, spp=size, seed=seed * 65536 + index)
            total = total + np.array(picture, np.float64) * size
        seconds = time.monotonic() - start
        return (total / spp).astype(np.float32), seconds, spp
