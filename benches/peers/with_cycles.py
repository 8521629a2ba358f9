"""Cycles, as Blender's Python module has it."""

import math
import tempfile
import time
from pathlib import Path

import numpy as np

from gltf import MAX_DEPTH

# From glTF's axes to Blender's, whose up is +Z.
TO_BLENDER = np.array([[1.0, 0.0, 0.0, 0.0], [0.0, 0.0, -1.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]])


class Peer:
    name = "cycles"

    def __init__(self, threads, guiding=False):
        import bpy

        self.bpy, self.threads, self.guiding = bpy, threads, guiding
        self.version = f"{bpy.app.version_string} (Blender)"
        self.folder = tempfile.TemporaryDirectory()

    def cannot(self, flat):
        return None

    def load(self, flat, size):
        bpy = self.bpy
        start = time.monotonic()
        bpy.ops.wm.read_factory_settings(use_empty=True)
        scene, self.size = bpy.context.scene, size
        self.scene = scene
        self.settings(scene, size)
        for index, surface in enumerate(flat.surfaces):
            self.mesh(scene, surface, f"surface-{index}")
        data = bpy.data.cameras.new("camera")
        data.sensor_fit, data.angle, data.clip_start, data.clip_end = "VERTICAL", flat.yfov, 1e-3, 1e5
        camera = bpy.data.objects.new("camera", data)
        camera.matrix_world = (TO_BLENDER @ flat.camera).T.tolist()
        scene.collection.objects.link(camera)
        scene.camera = camera
        self.world(scene, flat.sky)
        return time.monotonic() - start

    def settings(self, scene, size):
        render, cycles = scene.render, scene.cycles
        render.engine = "CYCLES"
        render.resolution_x = render.resolution_y = size
        render.resolution_percentage, render.use_border = 100, False
        render.threads_mode, render.threads = "FIXED", self.threads
        render.use_persistent_data, render.use_compositing, render.use_sequencer = False, False, False
        render.dither_intensity = 0.0
        render.image_settings.media_type = "IMAGE"
        render.image_settings.file_format, render.image_settings.color_depth = "OPEN_EXR", "32"
        render.image_settings.color_mode, render.image_settings.exr_codec = "RGB", "NONE"
        cycles.device, cycles.use_denoising, cycles.use_adaptive_sampling = "CPU", False, False
        cycles.pixel_filter_type, cycles.filter_width = "BOX", 1.0
        cycles.sample_clamp_direct = cycles.sample_clamp_indirect = cycles.blur_glossy = 0.0
        cycles.caustics_reflective = cycles.caustics_refractive = True
        cycles.use_light_tree, cycles.use_auto_tile, cycles.use_fast_gi = True, False, False
        cycles.min_light_bounces = cycles.min_transparent_bounces = 0
        for kind in ("max", "diffuse", "glossy", "transmission"):
            setattr(cycles, f"{kind}_bounces", MAX_DEPTH)
        cycles.transparent_max_bounces, cycles.film_exposure = MAX_DEPTH, 1.0
        cycles.use_guiding = self.guiding

    def mesh(self, scene, surface, name):
        bpy = self.bpy
        mesh = bpy.data.meshes.new(name)
        positions = surface.positions @ TO_BLENDER[:3, :3].T
        count = len(surface.triangles)
        mesh.vertices.add(len(positions))
        mesh.vertices.foreach_set("co", positions.astype(np.float32).ravel())
        mesh.loops.add(3 * count)
        mesh.loops.foreach_set("vertex_index", surface.triangles.ravel())
        mesh.polygons.add(count)
        mesh.polygons.foreach_set("loop_start", np.arange(0, 3 * count, 3, dtype=np.int32))
        mesh.update(calc_edges=False)
        if surface.normals is None:
            mesh.shade_flat()
        else:
            mesh.shade_smooth()
            mesh.normals_split_custom_set_from_vertices((surface.normals @ TO_BLENDER[:3, :3].T).tolist())
        mesh.materials.append(self.material(surface.material, name))
        shape = bpy.data.objects.new(name, mesh)
        shape.cycles.shadow_terminator_offset = shape.cycles.shadow_terminator_geometry_offset = 0.0
        scene.collection.objects.link(shape)

    def material(self, material, name):
        made = self.bpy.data.materials.new(name)
        made.use_nodes = True
        tree = made.node_tree
        nodes, links = tree.nodes, tree.links
        nodes.clear()
        output = nodes.new("ShaderNodeOutputMaterial")
        if material.kind == "glass":
            shader = nodes.new("ShaderNodeBsdfGlass")
            shader.distribution = "GGX"
            shader.inputs["Roughness"].default_value = 0.0
            shader.inputs["IOR"].default_value = material.ior
        elif material.kind == "conductor":
            shader = nodes.new("ShaderNodeBsdfAnisotropic")
            shader.distribution = "GGX"
            shader.inputs["Roughness"].default_value = math.sqrt(material.alpha)
        else:
            shader = nodes.new("ShaderNodeBsdfDiffuse")
            shader.inputs["Roughness"].default_value = 0.0
        color = material.color if material.kind == "lambert" else (1.0, 1.0, 1.0)
        shader.inputs["Color"].default_value = (*color, 1.0)
        surface = shader.outputs[0]
        if material.emission is not None:
            surface = self.emission(nodes, links, material, surface, any(color))
            made.cycles.emission_sampling = "FRONT"
        links.new(surface, output.inputs["Surface"])
        return made

    def emission(self, nodes, links, material, surface, reflects):
        """Light from the front only: Cycles' own shines to both sides.

        A mix of shaders leaves the light tree its estimate of the power, which a calculated strength would not.
        """
        shining = nodes.new("ShaderNodeEmission")
        strength = max(material.emission)
        shining.inputs["Color"].default_value = (*(x / strength for x in material.emission), 1.0)
        shining.inputs["Strength"].default_value = strength
        geometry, emission = nodes.new("ShaderNodeNewGeometry"), nodes.new("ShaderNodeMixShader")
        links.new(geometry.outputs["Backfacing"], emission.inputs[0])
        links.new(shining.outputs[0], emission.inputs[1])
        if not reflects:
            return emission.outputs[0]
        both = nodes.new("ShaderNodeAddShader")
        links.new(surface, both.inputs[0])
        links.new(emission.outputs[0], both.inputs[1])
        return both.outputs[0]

    def world(self, scene, sky):
        bpy = self.bpy
        world = scene.world = bpy.data.worlds.new("sky")
        world.use_nodes = True
        nodes, links = world.node_tree.nodes, world.node_tree.links
        nodes.clear()
        output, background = nodes.new("ShaderNodeOutputWorld"), nodes.new("ShaderNodeBackground")
        links.new(background.outputs[0], output.inputs["Surface"])
        color = sky if isinstance(sky, tuple) else (0.0, 0.0, 0.0)
        background.inputs["Color"].default_value = (*color, 1.0)
        if sky is None or isinstance(sky, tuple):
            return
        height, width = sky.shape[:2]
        image = bpy.data.images.new("sky", width, height, alpha=False, float_buffer=True)
        image.colorspace_settings.name = "Linear Rec.709"
        # Blender's first row is the lowest.
        texels = np.concatenate([sky[::-1], np.ones((height, width, 1))], axis=2)
        image.pixels.foreach_set(texels.astype(np.float32).ravel())
        image.update()
        texture = nodes.new("ShaderNodeTexEnvironment")
        texture.image, texture.interpolation = image, "Closest"
        links.new(texture.outputs["Color"], background.inputs["Color"])

    def prepare(self, spps):
        pass

    def render(self, spp, seed):
        scene, path = self.scene, Path(self.folder.name) / "picture.exr"
        scene.cycles.samples, scene.cycles.seed = spp, seed
        scene.render.filepath, scene.render.use_file_extension = str(path), False
        self.bpy.ops.render.render(write_still=True)
        data = path.read_bytes()
        done = int(attribute(data, "samples"))
        image = self.bpy.data.images.load(str(path))
        pixels = np.empty(self.size**2 * 4, np.float32)
        image.pixels.foreach_get(pixels)
        self.bpy.data.images.remove(image)
        return pixels.reshape(self.size, self.size, 4)[::-1, :, :3], seconds_of(attribute(data, "render_time")), done


def attribute(data, name):
    """A text that Cycles leaves in the head of an EXR file."""
    key = f"cycles.ViewLayer.{name}\0string\0".encode()
    at = data.index(key) + len(key)
    length = int.from_bytes(data[at : at + 4], "little")
    return data[at + 4 : at + 4 + length].decode()


def seconds_of(time):
    """Seconds of `[hours:]minutes:seconds`; those of rendering alone, without moving the scene and building trees."""
    seconds = 0.0
    for part in time.split(":"):
        seconds = 60.0 * seconds + float(part)
    return seconds
