#!/usr/bin/env python3
"""Holds wavecast's values against those of Mitsuba 3, a renderer that shares nothing with it.

    pip install mitsuba numpy          # written against mitsuba 3.9.1
    cargo build --release
    python3 tests/oracle/against_mitsuba.py
    python3 tests/oracle/against_mitsuba.py --control
    python3 tests/oracle/against_mitsuba.py --only glass --spp 2048

Each scene is a glTF file: the Cornell box of `scenes/`, and others that this script writes. Wavecast reads the file
itself; for Mitsuba it is read and translated here, by code that knows the glTF specification and not wavecast. Only
what both can say exactly is translated, anything else is an error:

  surfaces   Lambert (metallic 0, specularFactor 0), perfect mirrors (metallic 1, white, roughness 0), clear and
             absorbing solids of glass (transmission 1, white, roughness 0, thickness above 0), base colour textures
  light      emissive meshes, point and directional lights, the inside of spots, lat-long environments
  cameras    perspective and orthographic, of any shape

What cannot be compared, because the two mean different things by it:

  rough metal and glass   wavecast: Schlick's Fresnel term with height-correlated masking and shadowing; Mitsuba: the
                          exact Fresnel term with a product of two terms. Schlick's term of a white metal is 1, but
                          roughness 0 is then the only one where masking does not matter.
  coats, thin walls       Mitsuba's plastics and thin walls know about the light that is reflected within them
  edges of spots          glTF's falloff is the square of what is linear in the cosine, and at least 0.001 of it wide;
                          Mitsuba's is linear in the angle. So everything has to lie within the inner cone.
  single-sided surfaces   wavecast's cannot be seen from behind, Mitsuba's are black there. The scenes show no backs,
                          but for that of the Cornell box's lamp, 1 mm below the ceiling, which matters to a strip of
                          that width.
  smooth normals          differ where the normal faces away from the eye, and wavecast's shadow-terminator fix has no
                          counterpart. Spheres with smooth normals are fine enough for the first not to matter
                          (0.04 % of the disc), and are rendered without the second.
  environments            wavecast's have texels, Mitsuba interpolates between samples. So Mitsuba gets a finer
                          picture of the same texels.

Each renderer makes several pictures from different seeds, and their differences say how noisy the mean is. Compared are
the mean of the picture and the means of blocks of 8 by 8 pixels, for each channel: the difference over its standard
error, as a standard normal number (few degrees of freedom are accounted for). The limit is such that all comparisons
of one run together fail with a probability of 1 % if the renderers agree.

With `--control` wavecast gets each scene with one light brighter by 2 %, or the environment turned by 3°. All scenes
have to fail then.

The exit code is 0 if all is as it should be, 1 if not. All light is in nit, as in wavecast; Mitsuba has no units.
"""

import argparse
import base64
import copy
import json
import math
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path


import drjit as dr
import mitsuba as mi
import numpy as np

mi.set_variant("scalar_rgb")

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "benches/peers"))
from gltf import Document, emission, finer_environment, unscaled, write_ply  # noqa: E402

# Not part of the repository; the scene that wants it is left out if it is not there.
SKY_ASSET = ROOT / "../shared/assets/_hdr/venice_sunset_1k.hdr"

BLOCK = 8
# Pictures per renderer.
RUNS = 4
CONFIDENCE = 0.99
# Share of a mean by which it may be off where there is no noise: rounding to single precision, and what is left of the
# interpolation where the edge of a texel of the sky runs along that of a block.
TOLERANCE = 1e-4
BRIGHTER = 1.02
TURN_DEGREES = 3.0


# Geometry: positions, normals (None: flat), texture coordinates (None: none) and triangles.


def quad(a, b, c, d, uv_scale=None):
    """A flat quadrilateral, seen from where its corners run counter-clockwise."""
    positions = np.array([a, b, c, d], np.float32)
    normal = np.cross(positions[1] - positions[0], positions[2] - positions[0])
    normals = np.tile(normal / np.linalg.norm(normal), (4, 1))
    uv = None if uv_scale is None else np.array([[0, 1], [1, 1], [1, 0], [0, 0]]) * uv_scale
    return positions, normals, uv, np.array([[0, 1, 2], [0, 2, 3]])


def box():
    """The cube from -1 to 1, without normals, which means flat."""
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], np.float32)
    sides = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    triangles = [t for a, b, c, d in sides for t in ((a, b, c), (a, c, d))]
    return corners, None, None, np.array(triangles)


def icosphere(level, smooth):
    """The unit sphere: an icosahedron whose triangles are cut in four `level` times."""
    g = (1 + math.sqrt(5)) / 2
    points = [(-1, g, 0), (1, g, 0), (-1, -g, 0), (1, -g, 0), (0, -1, g), (0, 1, g)]
    points += [(0, -1, -g), (0, 1, -g), (g, 0, -1), (g, 0, 1), (-g, 0, -1), (-g, 0, 1)]
    points = [np.array(p) / np.linalg.norm(p) for p in points]
    triangles = [(0, 11, 5), (0, 5, 1), (0, 1, 7), (0, 7, 10), (0, 10, 11), (1, 5, 9), (5, 11, 4)]
    triangles += [(11, 10, 2), (10, 7, 6), (7, 1, 8), (3, 9, 4), (3, 4, 2), (3, 2, 6), (3, 6, 8), (3, 8, 9)]
    triangles += [(4, 9, 5), (2, 4, 11), (6, 2, 10), (8, 6, 7), (9, 8, 1)]
    for _ in range(level):
        middles, finer = {}, []

        def middle(i, j):
            key = (min(i, j), max(i, j))
            if key not in middles:
                middles[key] = len(points)
                points.append((points[i] + points[j]) / np.linalg.norm(points[i] + points[j]))
            return middles[key]

        for a, b, c in triangles:
            ab, bc, ca = middle(a, b), middle(b, c), middle(c, a)
            finer += [(a, ab, ca), (b, bc, ab), (c, ca, bc), (ab, bc, ca)]
        triangles = finer
    positions = np.array(points, np.float32)
    return positions, positions if smooth else None, None, np.array(triangles)


# Writing glTF.


class Gltf:
    """A glTF file in the making, with all data inside."""

    def __init__(self):
        self.doc = {"asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": []}]}
        self.data = b""

    def add(self, kind, value):
        self.doc.setdefault(kind, []).append(value)
        return len(self.doc[kind]) - 1

    def extend(self, owner, name, value):
        owner.setdefault("extensions", {})[name] = value
        used = self.doc.setdefault("extensionsUsed", [])
        if name not in used:
            used.append(name)

    def view(self, data):
        view = self.add("bufferViews", {"buffer": 0, "byteOffset": len(self.data), "byteLength": len(data)})
        self.data += data + b"\0" * (-len(data) % 4)
        return view

    def accessor(self, array, kind):
        code = 5126 if array.dtype == np.float32 else 5125
        accessor = {"bufferView": self.view(array.tobytes()), "componentType": code, "count": len(array), "type": kind}
        if kind == "VEC3":
            accessor |= {"min": array.min(0).tolist(), "max": array.max(0).tolist()}
        return self.add("accessors", accessor)

    def node(self, **node):
        self.doc["scenes"][0]["nodes"].append(self.add("nodes", node))

    def diffuse(self, color, emission=None, **more):
        """A Lambertian material, which may also shine with `emission` nit."""
        pbr = {"baseColorFactor": [*color, 1.0], "metallicFactor": 0.0, "roughnessFactor": 1.0}
        material = {"pbrMetallicRoughness": pbr} | more
        self.extend(material, "KHR_materials_specular", {"specularFactor": 0.0})
        if emission is not None:
            # The factor ends at 1, the rest is the strength.
            strength = max(emission)
            material["emissiveFactor"] = [x / strength for x in emission]
            self.extend(material, "KHR_materials_emissive_strength", {"emissiveStrength": strength})
        return self.add("materials", material)

    def mirror(self, **more):
        pbr = {"metallicFactor": 1.0, "roughnessFactor": 0.0}
        return self.add("materials", {"pbrMetallicRoughness": pbr} | more)

    def glass(self, ior, color=None, distance=None):
        """A solid; light is down to `color` after `distance` metres within it."""
        material = {"pbrMetallicRoughness": {"metallicFactor": 0.0, "roughnessFactor": 0.0}}
        self.extend(material, "KHR_materials_transmission", {"transmissionFactor": 1.0})
        self.extend(material, "KHR_materials_ior", {"ior": ior})
        volume = {"thicknessFactor": 1.0}
        if distance is not None:
            volume |= {"attenuationColor": color, "attenuationDistance": distance}
        self.extend(material, "KHR_materials_volume", volume)
        return self.add("materials", material)

    def texture(self, pixels, nearest):
        """A texture of bytes, which stand for sRGB."""
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "texture.png"
            mi.Bitmap(pixels).write(str(path))
            view = self.view(path.read_bytes())
        image = self.add("images", {"bufferView": view, "mimeType": "image/png"})
        kind = 9728 if nearest else 9729
        sampler = self.add("samplers", {"magFilter": kind, "minFilter": kind})
        return self.add("textures", {"source": image, "sampler": sampler})

    def mesh(self, geometry, material, **node):
        positions, normals, uv, triangles = geometry
        attributes = {"POSITION": self.accessor(positions.astype(np.float32), "VEC3")}
        if normals is not None:
            attributes["NORMAL"] = self.accessor(normals.astype(np.float32), "VEC3")
        if uv is not None:
            attributes["TEXCOORD_0"] = self.accessor(uv.astype(np.float32), "VEC2")
        indices = self.accessor(triangles.astype(np.uint32).reshape(-1), "SCALAR")
        primitive = {"attributes": attributes, "indices": indices, "material": material}
        self.node(mesh=self.add("meshes", {"primitives": [primitive]}), **node)

    def light(self, light, position=(0.0, 0.0, 0.0), towards=(0.0, 0.0, 0.0)):
        node = {"matrix": looking(position, towards)}
        owner = self.doc.setdefault("extensions", {}).setdefault("KHR_lights_punctual", {"lights": []})
        owner["lights"].append(light)
        self.extend(node, "KHR_lights_punctual", {"light": len(owner["lights"]) - 1})
        self.node(**node)

    def camera(self, position, towards, yfov_degrees=None, xmag=None, ymag=None):
        if yfov_degrees is not None:
            camera = {"type": "perspective", "perspective": {"yfov": math.radians(yfov_degrees), "znear": 0.01}}
        else:
            orthographic = {"xmag": xmag, "ymag": ymag, "znear": 0.01, "zfar": 1000.0}
            camera = {"type": "orthographic", "orthographic": orthographic}
        self.node(camera=self.add("cameras", camera), matrix=looking(position, towards))

    def finish(self):
        uri = "data:application/octet-stream;base64," + base64.b64encode(self.data).decode()
        self.doc["buffers"] = [{"uri": uri, "byteLength": len(self.data)}]
        return self.doc


def looking(position, towards):
    """The matrix of a node whose -Z axis points at something, column after column as glTF has it."""
    back = np.subtract(position, towards).astype(float)
    back /= np.linalg.norm(back)
    right = np.cross([0.0, 1.0, 0.0], back)
    right /= np.linalg.norm(right)
    up = np.cross(back, right)
    return [float(x) for column in (right, up, back) for x in (*column, 0.0)] + [float(x) for x in position] + [1.0]


# Translating to Mitsuba.


def rgb(values):
    return {"type": "rgb", "value": [float(x) for x in values]}


def bsdf_of(document, material, folder):
    """The BSDF of a material, and the medium behind it if there is one."""
    pbr, extensions = material.get("pbrMetallicRoughness", {}), material.get("extensions", {})
    color = pbr.get("baseColorFactor", [1.0] * 4)[:3]
    metallic, roughness = pbr.get("metallicFactor", 1.0), pbr.get("roughnessFactor", 1.0)
    medium = None
    assert "normalTexture" not in material and "metallicRoughnessTexture" not in pbr
    assert material.get("alphaMode", "OPAQUE") == "OPAQUE"
    if extensions.get("KHR_materials_transmission", {}).get("transmissionFactor", 0.0) == 1.0:
        volume = extensions["KHR_materials_volume"]
        assert metallic == 0.0 and roughness == 0.0 and color == [1.0] * 3 and volume["thicknessFactor"] > 0.0
        assert "KHR_materials_specular" not in extensions
        ior = extensions.get("KHR_materials_ior", {}).get("ior", 1.5)
        bsdf = {"type": "dielectric", "int_ior": ior, "ext_ior": 1.0}
        if "attenuationDistance" in volume:
            absorption = -np.log(volume["attenuationColor"]) / volume["attenuationDistance"]
            # A colour may not be above 1 there, the scale may.
            scale = absorption.max()
            medium = {"type": "homogeneous", "albedo": 0.0, "sigma_t": rgb(absorption / scale), "scale": float(scale)}
        return bsdf, medium
    if metallic == 1.0:
        assert roughness == 0.0 and color == [1.0] * 3, "only a perfect mirror is the same in both"
        bsdf = {"type": "conductor", "material": "none"}
    else:
        assert metallic == 0.0 and extensions["KHR_materials_specular"]["specularFactor"] == 0.0, "exactly Lambert"
        reflectance = rgb(color)
        if "baseColorTexture" in pbr:
            assert color == [1.0] * 3 and pbr["baseColorTexture"].get("texCoord", 0) == 0
            reflectance = texture_of(document, pbr["baseColorTexture"]["index"], folder)
        bsdf = {"type": "diffuse", "reflectance": reflectance}
    if material.get("doubleSided", False):
        assert "emissiveFactor" not in material, "Mitsuba's surfaces shine to one side"
        bsdf = {"type": "twosided", "bsdf": bsdf}
    return bsdf, medium


def texture_of(document, index, folder):
    texture = document.doc["textures"][index]
    path = folder / f"texture-{index}.png"
    path.write_bytes(document.view(document.doc["images"][texture["source"]]["bufferView"]))
    nearest = document.doc["samplers"][texture["sampler"]]["magFilter"] == 9728
    return {"type": "bitmap", "filename": str(path), "filter_type": "nearest" if nearest else "bilinear"}


def shape_of(document, primitive, world, path):
    positions, normals = document.positions(primitive, world), document.normals(primitive, world)
    uv = None
    if "TEXCOORD_0" in primitive["attributes"]:
        # Both count v downwards from the first row.
        uv = document.accessor(primitive["attributes"]["TEXCOORD_0"])
    triangles = document.triangles(primitive, world)
    write_ply(path, positions, normals, uv, triangles)
    material = document.doc["materials"][primitive["material"]]
    bsdf, medium = bsdf_of(document, material, path.parent)
    shape = {"type": "ply", "filename": str(path), "face_normals": normals is None, "bsdf": bsdf}
    if medium is not None:
        shape["interior"] = medium
    radiance = emission(material)
    if radiance is not None:
        shape["emitter"] = {"type": "area", "radiance": rgb(radiance)}
    return shape


def light_of(light, world, points):
    """A light; `points` are the corners of all there is."""
    value = np.multiply(light.get("color", (1.0, 1.0, 1.0)), light.get("intensity", 1.0))
    assert "range" not in light
    if light["type"] == "point":
        return {"type": "point", "position": [float(x) for x in world[:3, 3]], "intensity": rgb(value)}
    # glTF's lights shine along -Z.
    if light["type"] == "directional":
        direction = -world[:3, 2] / np.linalg.norm(world[:3, 2])
        return {"type": "directional", "direction": [float(x) for x in direction], "irradiance": rgb(value)}
    inner, outer = light["spot"]["innerConeAngle"], light["spot"]["outerConeAngle"]
    to_points = points - world[:3, 3]
    cosines = -to_points @ world[:3, 2] / np.linalg.norm(to_points, axis=1) / np.linalg.norm(world[:3, 2])
    assert cosines.min() > math.cos(inner), "the edge of a spot is not the same in both"
    return {
        "type": "spot",
        "to_world": mi.ScalarTransform4f(unscaled(world) @ np.diag([-1.0, 1.0, -1.0, 1.0])),
        "intensity": rgb(value),
        "beam_width": math.degrees(inner),
        "cutoff_angle": math.degrees(outer),
    }


def sensor_of(camera, world, width, height):
    # glTF: +X right, +Y up, -Z forward. Mitsuba: +X left, +Y up, +Z forward.
    to_world = unscaled(world) @ np.diag([-1.0, 1.0, -1.0, 1.0])
    film = {"type": "hdrfilm", "width": width, "height": height, "rfilter": {"type": "box"}}
    film |= {"pixel_format": "rgb", "component_format": "float32"}
    sensor = {"film": film, "sampler": {"type": "independent"}}
    if camera["type"] == "perspective":
        fov = math.degrees(camera["perspective"]["yfov"])
        sensor |= {"type": "perspective", "fov": fov, "fov_axis": "y"}
    else:
        # The view is from -1 to 1 across, and as high as the film's shape makes it.
        orthographic = camera["orthographic"]
        xmag, ymag = orthographic["xmag"], orthographic["ymag"]
        assert abs(xmag / ymag * height / width - 1.0) < 1e-6, "the camera has the picture's shape"
        to_world = to_world @ np.diag([xmag, xmag, 1.0, 1.0])
        sensor |= {"type": "orthographic"}
    return sensor | {"to_world": mi.ScalarTransform4f(to_world), "near_clip": 0.01, "far_clip": 1000.0}


def environment_of(path, rotation_degrees):
    """The environment of a lat-long picture.

    Wavecast: constant texels; the middle column is +X, and columns go on towards +Z.
    Mitsuba: bilinear between samples; the middle column is +Z, and columns go on towards -X. Around, samples are the
    middles of texels; downwards, the first and last sample are the poles themselves.
    """
    texels = np.array(mi.Bitmap(str(path)).convert(mi.Bitmap.PixelFormat.RGB, mi.Struct.Type.Float32, False))
    fine = finer_environment(texels)
    turn = mi.ScalarTransform4f().rotate([0.0, 1.0, 0.0], 90.0 + rotation_degrees)
    return {"type": "envmap", "bitmap": mi.Bitmap(fine.astype(np.float32)), "to_world": turn}


def to_mitsuba(scene, folder, width, height):
    """A glTF scene as `mi.load_dict` takes it."""
    document = Document(scene.doc)
    parts, media, points, lights = {"type": "scene"}, False, [], []
    for node, world in document.nodes():
        if "mesh" in node:
            for primitive in document.doc["meshes"][node["mesh"]]["primitives"]:
                name = f"shape-{len(parts)}"
                parts[name] = shape_of(document, primitive, world, folder / f"{name}.ply")
                points.append(document.positions(primitive, world))
                media |= "interior" in parts[name]
        if "camera" in node:
            parts["sensor"] = sensor_of(document.doc["cameras"][node["camera"]], world, width, height)
        if "KHR_lights_punctual" in node.get("extensions", {}):
            all_lights = document.doc["extensions"]["KHR_lights_punctual"]["lights"]
            lights.append((all_lights[node["extensions"]["KHR_lights_punctual"]["light"]], world))
    for light, world in lights:
        parts[f"light-{len(parts)}"] = light_of(light, world, np.concatenate(points))
    if scene.sky is not None:
        parts["sky"] = environment_of(scene.sky, scene.rotation)
    parts["integrator"] = {"type": "volpath" if media else "path", "max_depth": -1}
    return parts


# The scenes.


class Scene:
    """A glTF document, and what the command line has to say besides."""

    def __init__(self, name, doc, control, sky=None, rotation=0.0, shape=(1, 1), spp=256, smooth=False):
        self.name, self.doc, self.sky, self.rotation = name, doc, sky, rotation
        self.shape, self.spp, self.smooth = shape, spp, smooth
        # The light that `--control` makes brighter: an emissive material, a punctual light, or None for the sky.
        self.control = control

    def spoil(self):
        """The same, a little wrong."""
        other = copy.copy(self)
        other.doc = copy.deepcopy(self.doc)
        if self.control is None:
            other.rotation += TURN_DEGREES
            return other
        kind, index = self.control
        if kind == "material":
            extensions = other.doc["materials"][index]["extensions"]
            extensions["KHR_materials_emissive_strength"]["emissiveStrength"] *= BRIGHTER
        else:
            other.doc["extensions"]["KHR_lights_punctual"]["lights"][index]["intensity"] *= BRIGHTER
        return other


def room(gltf):
    """A closed room of 4 by 3 by 4 m with a lamp of 3 by 3 m below the ceiling; gives the lamp's material."""
    white, red, blue = (gltf.diffuse(c) for c in ((0.7, 0.7, 0.7), (0.7, 0.2, 0.15), (0.2, 0.3, 0.7)))
    lamp = gltf.diffuse((0.0, 0.0, 0.0), (4.5, 4.0, 3.2))
    x, y, z = 2.0, 3.0, 2.0
    gltf.mesh(quad((-x, 0, z), (x, 0, z), (x, 0, -z), (-x, 0, -z)), white)
    gltf.mesh(quad((-x, y, -z), (x, y, -z), (x, y, z), (-x, y, z)), white)
    gltf.mesh(quad((-x, 0, -z), (x, 0, -z), (x, y, -z), (-x, y, -z)), white)
    gltf.mesh(quad((x, 0, z), (-x, 0, z), (-x, y, z), (x, y, z)), white)
    gltf.mesh(quad((-x, 0, z), (-x, 0, -z), (-x, y, -z), (-x, y, z)), red)
    gltf.mesh(quad((x, 0, -z), (x, 0, z), (x, y, z), (x, y, -z)), blue)
    # Sides up to the ceiling hide the lamp's back, as nothing may be seen from behind.
    r, low = 1.5, 2.9
    gltf.mesh(quad((-r, low, -r), (r, low, -r), (r, low, r), (-r, low, r)), lamp)
    corners = [(-r, r), (r, r), (r, -r), (-r, -r)]
    for (x0, z0), (x1, z1) in zip(corners, corners[1:] + corners[:1]):
        gltf.mesh(quad((x0, low, z0), (x1, low, z1), (x1, y, z1), (x0, y, z0)), white)
    return lamp


def cornell(folder):
    doc = json.loads((ROOT / "scenes/cornell.gltf").read_text())
    lamp = next(i for i, m in enumerate(doc["materials"]) if "emissiveFactor" in m)
    return Scene("cornell", doc, ("material", lamp))


def outdoors():
    """A box and a sphere on a floor, seen from above so that the sky shows as well; smooth normals."""
    gltf = Gltf()
    ground, orange, green = (gltf.diffuse(c) for c in ((0.5, 0.5, 0.5), (0.8, 0.4, 0.1), (0.2, 0.6, 0.3)))
    # The floor is a slab, since a single-sided sheet would be seen from below.
    gltf.mesh(box(), ground, translation=(0.0, -0.1, 0.0), scale=(4.0, 0.1, 4.0))
    turn = math.radians(25.0) / 2
    rotation = (0.0, math.sin(turn), 0.0, math.cos(turn))
    gltf.mesh(box(), orange, translation=(-1.2, 0.6, 0.3), rotation=rotation, scale=(0.6, 0.6, 0.8))
    gltf.mesh(icosphere(5, smooth=True), green, translation=(1.1, 0.9, 0.0), scale=(0.9, 0.9, 0.9))
    gltf.camera((1.5, 2.2, 6.5), (0.0, 1.0, 0.0), yfov_degrees=50.0)
    return gltf.finish()


def sky_texels(folder):
    """A sky of few texels without any symmetry, three suns of different colours in it."""
    height, width = 32, 64
    v, u = np.mgrid[0:height, 0:width]
    texels = np.stack([0.2 + 0.5 * u / width, 0.3 + 0.3 * v / height, 0.9 - 0.6 * u / width], axis=-1)
    for row, column, color in ((7, 5, (40, 12, 4)), (10, 30, (3, 25, 6)), (13, 50, (4, 8, 45))):
        texels[row : row + 2, column : column + 3] += color
    path = folder / "sky.exr"
    mi.Bitmap(texels.astype(np.float32)).write(str(path))
    return Scene("sky", outdoors(), None, sky=path, rotation=40.0, smooth=True)


def sky_asset(folder):
    return Scene("sky photograph", outdoors(), None, sky=SKY_ASSET, shape=(4, 3), smooth=True)


def glass(folder):
    gltf = Gltf()
    lamp = room(gltf)
    gltf.mesh(icosphere(3, smooth=False), gltf.glass(1.5), translation=(0.5, 0.85, 0.2), scale=(0.8, 0.8, 0.8))
    gltf.mesh(box(), gltf.glass(1.8), translation=(-1.0, 0.65, -0.4), scale=(0.4, 0.6, 0.4))
    gltf.camera((0.0, 1.5, 1.9), (0.0, 1.1, 0.0), yfov_degrees=70.0)
    return Scene("glass", gltf.finish(), ("material", lamp))


def absorbing(folder):
    gltf = Gltf()
    lamp = room(gltf)
    # The channels are alike: Mitsuba draws distances for one of them, and on paths that are held within the glass by
    # total reflection the weights of a channel that is absorbed far less would have no finite variance.
    amber, bottle = gltf.glass(1.4, [0.6, 0.5, 0.4], 0.8), gltf.glass(1.0, [0.3, 0.5, 0.4], 0.5)
    gltf.mesh(icosphere(3, smooth=False), amber, translation=(0.5, 0.85, 0.2), scale=(0.8, 0.8, 0.8))
    gltf.mesh(box(), bottle, translation=(-1.0, 0.65, -0.4), scale=(0.4, 0.6, 0.4))
    gltf.camera((0.0, 1.5, 1.9), (0.0, 1.1, 0.0), yfov_degrees=70.0)
    return Scene("absorbing glass", gltf.finish(), ("material", lamp))


def mirrors(folder):
    gltf = Gltf()
    lamp = room(gltf)
    mirror, orange = gltf.mirror(), gltf.diffuse((0.8, 0.4, 0.1))
    gltf.mesh(icosphere(3, smooth=False), mirror, translation=(0.6, 0.85, 0.0), scale=(0.8, 0.8, 0.8))
    gltf.mesh(box(), orange, translation=(-0.9, 0.5, 0.3), scale=(0.4, 0.5, 0.4))
    sheet = quad((-1.9, 0.3, -1.6), (-0.3, 0.3, -1.9), (-0.3, 2.3, -1.9), (-1.9, 2.3, -1.6))
    gltf.mesh(sheet, gltf.mirror(doubleSided=True))
    gltf.camera((0.0, 1.5, 1.9), (0.0, 1.1, 0.0), yfov_degrees=70.0)
    return Scene("mirrors", gltf.finish(), ("material", lamp), spp=128)


def punctual(folder):
    """All kinds of lights, and transforms that mirror and stretch."""
    gltf = Gltf()
    gray, orange, green = (gltf.diffuse(c) for c in ((0.5, 0.5, 0.5), (0.8, 0.4, 0.1), (0.2, 0.6, 0.3)))
    sheet = gltf.diffuse((0.6, 0.6, 0.2), doubleSided=True)
    gltf.mesh(box(), gray, translation=(0.0, -0.1, 0.0), scale=(5.0, 0.1, 5.0))
    gltf.mesh(box(), orange, translation=(-1.2, 0.6, 0.3), scale=(-0.6, 0.6, 0.8))
    gltf.mesh(icosphere(3, smooth=False), green, translation=(1.3, 1.0, 0.0), scale=(0.7, 1.0, 0.5))
    gltf.mesh(quad((-2.5, 0, -1.5), (2.5, 0, -2.5), (2.5, 2.5, -2.5), (-2.5, 2.5, -1.5)), sheet)
    gltf.mesh(quad((-0.4, 0.2, 1), (0.5, 0.1, 1.4), (0.5, 1.0, 1.0), (-0.4, 1.1, 0.6)), sheet)
    gltf.light({"type": "point", "color": [1.0, 0.8, 0.6], "intensity": 12.0}, position=(-0.3, 2.2, 0.9))
    gltf.light({"type": "directional", "color": [0.4, 0.6, 1.0], "intensity": 2.0}, (3.0, 4.0, 2.0))
    cone = {"innerConeAngle": math.radians(50.0), "outerConeAngle": math.radians(60.0)}
    spot = {"type": "spot", "color": [0.5, 1.0, 0.5], "intensity": 150.0, "spot": cone}
    gltf.light(spot, (2.0, 9.0, 3.0), (0.0, 0.0, 0.0))
    gltf.camera((0.5, 3.0, 6.0), (0.0, 0.7, 0.0), yfov_degrees=45.0)
    return Scene("punctual lights", gltf.finish(), ("light", 0))


def emitters(folder):
    """Surfaces of several sizes and strengths that shine, some of which reflect as well."""
    gltf = Gltf()
    gray = gltf.diffuse((0.6, 0.6, 0.6))
    large = gltf.diffuse((0.3, 0.5, 0.7), (2.0, 2.5, 3.5))
    small, faint = gltf.diffuse((0.0, 0.0, 0.0), (90.0, 50.0, 20.0)), gltf.diffuse((0.8, 0.8, 0.8), (0.4, 0.1, 0.3))
    gltf.mesh(box(), gray, translation=(0.0, -0.1, 0.0), scale=(5.0, 0.1, 5.0))
    gltf.mesh(box(), gray, translation=(0.0, 1.0, -2.5), scale=(3.0, 1.0, 0.1))
    gltf.mesh(icosphere(2, smooth=False), large, translation=(1.2, 0.8, -0.5), scale=(0.8, 0.6, 0.8))
    gltf.mesh(box(), faint, translation=(-0.3, 0.5, 0.8), scale=(0.4, -0.5, 0.4))
    for i in range(4):
        gltf.mesh(icosphere(0, smooth=False), small, translation=(-2.0 + 0.7 * i, 1.5, -1.5), scale=(0.12,) * 3)
    gltf.camera((0.5, 2.5, 6.0), (0.0, 0.7, 0.0), yfov_degrees=45.0)
    return Scene("emitters", gltf.finish(), ("material", large))


def orthographic(folder):
    gltf = Gltf()
    lamp = room(gltf)
    gltf.mesh(icosphere(3, smooth=False), gltf.diffuse((0.8, 0.4, 0.1)), translation=(0.7, 0.8, 0.0), scale=(0.7,) * 3)
    gltf.mesh(box(), gltf.diffuse((0.2, 0.6, 0.3)), translation=(-0.8, 0.5, 0.3), scale=(0.4, 0.5, 0.4))
    gltf.camera((0.3, 1.6, 1.3), (0.1, 1.4, 0.0), xmag=1.5, ymag=1.0)
    return Scene("orthographic", gltf.finish(), ("material", lamp), shape=(3, 2))


def textures(folder):
    """Few large texels, repeated: nearest on the floor, bilinear on the wall."""
    gltf = Gltf()
    random = np.random.default_rng(7)
    pixels = [random.integers(10, 250, (h, w, 3)).astype(np.uint8) for h, w in ((5, 7), (4, 6))]
    sheets = []
    for pixel, nearest in zip(pixels, (True, False)):
        sheets.append(gltf.diffuse((1.0, 1.0, 1.0), doubleSided=True))
        pbr = gltf.doc["materials"][-1]["pbrMetallicRoughness"]
        pbr["baseColorTexture"] = {"index": gltf.texture(pixel, nearest)}
    lamp = gltf.diffuse((0.0, 0.0, 0.0), (8.0, 8.0, 8.0))
    gltf.mesh(quad((-2, 0, 2), (2, 0, 2), (2, 0, -2), (-2, 0, -2), uv_scale=(2.3, 1.6)), sheets[0])
    gltf.mesh(quad((-2, 0, -2), (2, 0, -2), (2, 3, -2), (-2, 3, -2), uv_scale=(1.7, 1.4)), sheets[1])
    gltf.mesh(box(), lamp, translation=(0.5, 3.5, 1.5), scale=(0.8, 0.05, 0.8))
    gltf.camera((0.0, 2.5, 5.0), (0.0, 0.9, 0.0), yfov_degrees=45.0)
    return Scene("textures", gltf.finish(), ("material", lamp))


SCENES = [cornell, sky_texels, sky_asset, glass, absorbing, mirrors, punctual, emitters, orthographic, textures]


# Rendering.


def render_wavecast(program, scene, folder, width, height, spp):
    path, picture = folder / "scene.gltf", folder / "picture.exr"
    path.write_text(json.dumps(scene.doc))
    command = [program, "render", path, "-o", picture, "--size", f"{width}x{height}", "--spp", str(spp)]
    command += ["--filter", "box", "--threads", "1", "--quiet"]
    if scene.smooth:
        command.append("--no-terminator-fix")
    if scene.sky is not None:
        command += ["--env", scene.sky, "--env-rotate", str(scene.rotation)]
    pictures = []
    for seed in range(1, RUNS + 1):
        subprocess.run([*command, "--seed", str(seed)], check=True)
        pictures.append(np.array(mi.Bitmap(str(picture)), dtype=np.float64)[:, :, :3])
    return np.array(pictures)


def render_mitsuba(scene, folder, width, height, spp):
    parts = to_mitsuba(scene, folder, width, height)
    # Not for the whole program: EXR files wait forever for a second thread.
    threads = dr.thread_count()
    dr.set_thread_count(1)
    try:
        world = mi.load_dict(parts, parallel=False)
        return np.array([np.array(mi.render(world, spp=spp, seed=seed), np.float64) for seed in range(1, RUNS + 1)])
    finally:
        dr.set_thread_count(threads)


# Comparing.


def block_sums(picture):
    height, width, channels = picture.shape
    return picture.reshape(height // BLOCK, BLOCK, width // BLOCK, BLOCK, channels).sum((1, 3))


def z_scores(ours, theirs, sums):
    """Differences of sums over pixels, as standard normal numbers.

    The numbers of different pixels are independent of each other in both renderers, so their variances add up.
    """
    difference, variance, quartic = 0.0, 0.0, 0.0
    for sign, pictures in ((1.0, ours), (-1.0, theirs)):
        noise = pictures.var(0, ddof=1) / RUNS
        mean = sums(pictures.mean(0))
        difference = difference + sign * mean
        variance = variance + sums(noise)
        quartic = quartic + sums(noise**2) / (RUNS - 1)
        slack = (TOLERANCE * mean) ** 2
    # Welch and Satterthwaite: how many degrees of freedom the sum of variances has.
    freedom = np.maximum(variance**2 / np.maximum(quartic, 1e-300), 1.0)
    t_squared = difference**2 / np.maximum(variance + slack, 1e-300)
    # From Student's t to the normal distribution (Wallace 1959, "Bounds on normal approximations to Student's and the
    # chi-square distributions"), which leaves t as it is where there is no noise at all.
    z = np.sqrt(freedom * np.log1p(t_squared / freedom)) * (8 * freedom + 1) / (8 * freedom + 3)
    return np.where(variance > slack, z, np.sqrt(t_squared)) * np.sign(difference)


def ratio(ours, theirs):
    """Ratio of the means of all channels, and its standard error."""
    means, errors = [], []
    for pictures in (ours, theirs):
        gray = pictures.mean(3)
        means.append(gray.mean())
        errors.append(math.sqrt((gray.var(0, ddof=1) / RUNS).sum()) / gray[0].size / gray.mean())
    return means[0] / means[1], means[0] / means[1] * math.hypot(*errors)


def size_of(scene, size):
    """Width and height, whole blocks."""
    return size, max(round(size * scene.shape[1] / scene.shape[0] / BLOCK), 1) * BLOCK


def sidak(count):
    """The |z| that `count` standard normal numbers together exceed with the chosen probability only."""
    each = -math.expm1(math.log(CONFIDENCE) / count)
    return -statistics.NormalDist().inv_cdf(each / 2)


def main():
    parser = argparse.ArgumentParser(description="Compares wavecast's values with Mitsuba's.")
    parser.add_argument("--wavecast", type=Path, default=ROOT / "target/release/wavecast", help="the program")
    parser.add_argument("--spp", type=int, help="samples per pixel and picture, the same for all scenes")
    parser.add_argument("--size", type=int, default=96, help="width of the pictures, a multiple of 8")
    parser.add_argument("--only", metavar="NAME", help="only scenes whose name begins so")
    parser.add_argument("--control", action="store_true", help="spoil wavecast's scenes and expect to notice")
    options = parser.parse_args()
    if options.size <= 0 or options.size % BLOCK:
        parser.error(f"--size must be a multiple of {BLOCK}")
    if not options.wavecast.exists():
        parser.error(f"there is no {options.wavecast}; cargo build --release makes one")
    with tempfile.TemporaryDirectory() as folder:
        folder = Path(folder)
        scenes = [make(folder) for make in SCENES if make is not sky_asset or SKY_ASSET.exists()]
        if len(scenes) < len(SCENES):
            print(f"left out, as it is not there: {SKY_ASSET.name}", file=sys.stderr)
        scenes = [s for s in scenes if options.only is None or s.name.startswith(options.only)]
        if not scenes:
            parser.error(f"no scene is called {options.only}")
        return compare_all(scenes, options, folder)


def compare_all(scenes, options, folder):
    sizes = [size_of(scene, options.size) for scene in scenes]
    limit = sidak(sum(3 * (1 + w // BLOCK * (h // BLOCK)) for w, h in sizes))
    print(f"mitsuba {mi.__version__}, {RUNS} pictures per renderer and scene; |z| at most {limit:.2f}\n")
    print("| scene | size | spp | wavecast / mitsuba | z of the mean, RGB | worst block | at x, y | seconds | |")
    print("|---|---|---|---|---|---|---|---|---|", flush=True)
    agreeing = 0
    for scene, (width, height) in zip(scenes, sizes):
        spp = options.spp or scene.spp
        given = scene.spoil() if options.control else scene
        start = time.monotonic()
        ours = render_wavecast(options.wavecast, given, folder, width, height, spp)
        middle = time.monotonic()
        theirs = render_mitsuba(scene, folder, width, height, spp)
        seconds = f"{middle - start:.1f} + {time.monotonic() - middle:.1f}"
        whole = z_scores(ours, theirs, lambda picture: picture.sum((0, 1)))
        blocks = z_scores(ours, theirs, block_sums)
        row, column, _ = np.unravel_index(np.abs(blocks).argmax(), blocks.shape)
        worst = blocks.flat[np.abs(blocks).argmax()]
        agrees = max(np.abs(whole).max(), abs(worst)) <= limit
        agreeing += agrees
        share, error = ratio(ours, theirs)
        cells = [scene.name, f"{width}x{height}", spp, f"{share:.5f} ± {error:.5f}"]
        cells += [" ".join(f"{z:+.1f}" for z in whole), f"{worst:+.2f}", f"{column * BLOCK}, {row * BLOCK}", seconds]
        print("| " + " | ".join(map(str, cells)) + (" | agrees |" if agrees else " | **differs** |"), flush=True)
        if not np.isfinite(whole).all():
            raise ValueError(f"{scene.name}: a picture has values that are not finite")
    if options.control:
        print(f"\ncontrol: {len(scenes) - agreeing} of {len(scenes)} spoilt scenes were noticed")
        return 1 if agreeing else 0
    print(f"\n{agreeing} of {len(scenes)} scenes agree")
    return 0 if agreeing == len(scenes) else 1


if __name__ == "__main__":
    sys.exit(main())
