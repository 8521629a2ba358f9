"""Reads glTF for renderers that do not, as far as the scenes of this repository go.

Written from the glTF specification and not from wavecast. `Document` says what a file contains; `flatten` makes of it
what every renderer can take: triangles in world space and one kind of material for each of them. Anything that would
not mean the same everywhere is a `NotExact` error, which names it.
"""

import base64
import json
import math
import struct
from dataclasses import dataclass
from pathlib import Path

import numpy as np


class NotExact(ValueError):
    """Something that the renderers would not show alike."""


def expect(condition, what):
    if not condition:
        raise NotExact(what)


def local_matrix(node):
    if "matrix" in node:
        return np.array(node["matrix"], float).reshape(4, 4).T
    x, y, z, w = node.get("rotation", (0.0, 0.0, 0.0, 1.0))
    rotation = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )
    matrix = np.eye(4)
    matrix[:3, :3] = rotation * np.array(node.get("scale", (1.0, 1.0, 1.0)))
    matrix[:3, 3] = node.get("translation", (0.0, 0.0, 0.0))
    return matrix


def unscaled(world):
    """A matrix without its scale, as cameras and lights have it."""
    axes = world[:3, :3] / np.linalg.norm(world[:3, :3], axis=0)
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = axes, world[:3, 3]
    return matrix


def read_container(path):
    """The JSON of a .gltf or .glb file, and the binary chunk of the latter."""
    data = Path(path).read_bytes()
    if data[:4] != b"glTF":
        return json.loads(data), None
    chunks, at = {}, 12
    while at < len(data):
        length, kind = struct.unpack_from("<I4s", data, at)
        chunks[kind] = data[at + 8 : at + 8 + length]
        at += 8 + length
    return json.loads(chunks[b"JSON"]), chunks.get(b"BIN\0")


class Document:
    """A glTF document that can be asked for what it means."""

    def __init__(self, doc, binary=None, folder=None):
        self.doc = doc
        self.buffers = [self.buffer(buffer, binary, folder) for buffer in doc.get("buffers", [])]

    @staticmethod
    def open(path):
        doc, binary = read_container(path)
        return Document(doc, binary, Path(path).parent)

    @staticmethod
    def buffer(buffer, binary, folder):
        if "uri" not in buffer:
            return binary
        if buffer["uri"].startswith("data:"):
            return base64.b64decode(buffer["uri"].split(",", 1)[1])
        expect(folder is not None, "buffers outside the file")
        return (folder / buffer["uri"]).read_bytes()

    def view(self, index):
        view = self.doc["bufferViews"][index]
        expect("byteStride" not in view, "interleaved data")
        start = view.get("byteOffset", 0)
        return self.buffers[view["buffer"]][start : start + view["byteLength"]]

    def accessor(self, index):
        accessor = self.doc["accessors"][index]
        expect(not accessor.get("normalized") and "sparse" not in accessor, "packed accessors")
        kind = {5121: np.uint8, 5123: np.uint16, 5125: np.uint32, 5126: np.float32}[accessor["componentType"]]
        width = {"SCALAR": 1, "VEC2": 2, "VEC3": 3}[accessor["type"]]
        count = accessor["count"] * width
        return np.frombuffer(self.view(accessor["bufferView"]), kind, count, accessor.get("byteOffset", 0)).reshape(
            -1, width
        )

    def nodes(self):
        """All nodes of the scene with their matrices."""
        stack = [(index, np.eye(4)) for index in self.doc["scenes"][self.doc.get("scene", 0)]["nodes"]]
        while stack:
            index, above = stack.pop()
            node = self.doc["nodes"][index]
            world = above @ local_matrix(node)
            stack += [(child, world) for child in node.get("children", [])]
            yield node, world

    def positions(self, primitive, world):
        return self.accessor(primitive["attributes"]["POSITION"]) @ world[:3, :3].T + world[:3, 3]

    def normals(self, primitive, world):
        """Normals of unit length; None: the surface is flat."""
        if "NORMAL" not in primitive["attributes"]:
            return None
        normals = self.accessor(primitive["attributes"]["NORMAL"]) @ np.linalg.inv(world[:3, :3])
        return normals / np.linalg.norm(normals, axis=1, keepdims=True)

    def triangles(self, primitive, world):
        expect(primitive.get("mode", 4) == 4, "points and lines")
        if "indices" in primitive:
            triangles = self.accessor(primitive["indices"]).reshape(-1, 3)
        else:
            count = self.doc["accessors"][primitive["attributes"]["POSITION"]]["count"]
            triangles = np.arange(count, dtype=np.uint32).reshape(-1, 3)
        # glTF: a mirroring transform turns front to back, which is undone, so that the front stays the front.
        return triangles[:, ::-1] if np.linalg.det(world[:3, :3]) < 0.0 else triangles


def emission(material):
    """What a material shines with, in nit; None: it does not."""
    strength = material.get("extensions", {}).get("KHR_materials_emissive_strength", {}).get("emissiveStrength", 1.0)
    radiance = np.multiply(material.get("emissiveFactor", (0.0, 0.0, 0.0)), strength)
    return tuple(map(float, radiance)) if radiance.max() > 0.0 else None


def finer_environment(texels, least_width=4096):
    """Samples that interpolate to constant texels.

    Columns lie at the middles of finer texels. Rows are the edges of finer texels, the poles among them; a row on the
    edge of two texels gets their mean, so that the ramp between them lies about the edge.
    """
    height, width = texels.shape[:2]
    finer = max(least_width // width, 2)
    row = np.arange(height * finer + 1)
    above, below = np.maximum(row - 1, 0) // finer, np.minimum(row // finer, height - 1)
    return np.repeat(0.5 * (texels[above] + texels[below]), finer, axis=1)


def write_ply(path, positions, normals, uv, triangles):
    columns, names = [positions], ["x", "y", "z"]
    if normals is not None:
        columns, names = columns + [normals], names + ["nx", "ny", "nz"]
    if uv is not None:
        columns, names = columns + [uv], names + ["u", "v"]
    header = ["ply", "format binary_little_endian 1.0", f"element vertex {len(positions)}"]
    header += [f"property float {name}" for name in names]
    header += [f"element face {len(triangles)}", "property list uchar int vertex_indices", "end_header", ""]
    faces = np.empty(len(triangles), [("count", "u1"), ("rows", "<i4", 3)])
    faces["count"], faces["rows"] = 3, triangles
    path.write_bytes("\n".join(header).encode() + np.hstack(columns).astype("<f4").tobytes() + faces.tobytes())


# Scenes for all renderers.

# Most scatterings along a path.
MAX_DEPTH = 64


@dataclass(frozen=True)
class Material:
    """`lambert` of a colour, a white `conductor` with GGX facets of width `alpha`, or a clear `glass`."""

    kind: str
    color: tuple = (1.0, 1.0, 1.0)
    alpha: float = 0.0
    ior: float = 1.5
    # In nit, from the front only; None: the surface does not shine.
    emission: tuple = None
    double_sided: bool = False


@dataclass
class Surface:
    """Triangles of one material; `normals` is None where they are flat."""

    positions: np.ndarray
    normals: np.ndarray
    triangles: np.ndarray
    material: Material


@dataclass
class Flat:
    """A scene in world space, +Y up."""

    surfaces: list
    # From the camera, which looks along its -Z, to the world.
    camera: np.ndarray
    yfov: float
    # Texels of a lat-long picture, a colour as a tuple, or None.
    sky: object = None

    def triangle_count(self):
        return sum(len(surface.triangles) for surface in self.surfaces)


def material_of(material):
    pbr, extensions = material.get("pbrMetallicRoughness", {}), material.get("extensions", {})
    name = material.get("name", "a material")
    for texture in ("normalTexture", "emissiveTexture"):
        expect(texture not in material, f"{name}: {texture}")
    for texture in ("baseColorTexture", "metallicRoughnessTexture"):
        expect(texture not in pbr, f"{name}: {texture}")
    expect(material.get("alphaMode", "OPAQUE") == "OPAQUE", f"{name}: alpha")
    known = {"specular", "emissive_strength", "transmission", "ior", "volume"}
    for extension in extensions:
        expect(extension.removeprefix("KHR_materials_") in known, f"{name}: {extension}")
    color = tuple(map(float, pbr.get("baseColorFactor", [1.0] * 4)[:3]))
    metallic, roughness = pbr.get("metallicFactor", 1.0), pbr.get("roughnessFactor", 1.0)
    shared = {"emission": emission(material), "double_sided": material.get("doubleSided", False)}
    expect(not (shared["emission"] and shared["double_sided"]), f"{name}: shines to both sides")
    specular = extensions.get("KHR_materials_specular", {}).get("specularFactor", 1.0)
    if extensions.get("KHR_materials_transmission", {}).get("transmissionFactor", 0.0) > 0.0:
        expect(extensions["KHR_materials_transmission"]["transmissionFactor"] == 1.0, f"{name}: part transmission")
        volume = extensions.get("KHR_materials_volume", {})
        expect(volume.get("thicknessFactor", 0.0) > 0.0, f"{name}: thin walls")
        expect(math.isinf(volume.get("attenuationDistance", math.inf)), f"{name}: absorbing glass")
        expect((metallic, roughness, specular, color) == (0.0, 0.0, 1.0, (1.0,) * 3), f"{name}: glass, but not clear")
        return Material("glass", ior=extensions.get("KHR_materials_ior", {}).get("ior", 1.5), **shared)
    if metallic == 1.0:
        # Only of white is Schlick's Fresnel term the same as any other: 1.
        expect(color == (1.0,) * 3, f"{name}: a metal that is not white")
        return Material("conductor", alpha=roughness**2, **shared)
    expect(metallic == 0.0, f"{name}: part metal")
    expect(specular == 0.0, f"{name}: plastic")
    return Material("lambert", color=color, **shared)


def flatten(path, sky=None):
    """Reads a file for all renderers; `sky` as in `Flat`."""
    document = Document.open(path)
    materials = [material_of(material) for material in document.doc.get("materials", [])]
    groups, camera = {}, None
    for node, world in document.nodes():
        expect("KHR_lights_punctual" not in node.get("extensions", {}), "punctual lights")
        expect("skin" not in node and "EXT_mesh_gpu_instancing" not in node.get("extensions", {}), "skins, instancing")
        if "mesh" in node:
            for primitive in document.doc["meshes"][node["mesh"]]["primitives"]:
                expect("targets" not in primitive, "morph targets")
                normals = document.normals(primitive, world)
                key = (materials[primitive["material"]], normals is None)
                positions, triangles = document.positions(primitive, world), document.triangles(primitive, world)
                groups.setdefault(key, []).append((positions, normals, triangles))
        if "camera" in node and camera is None:
            perspective = document.doc["cameras"][node["camera"]].get("perspective")
            expect(perspective is not None, "an orthographic camera")
            camera = unscaled(world), perspective["yfov"]
    expect(camera is not None, "no camera")
    return Flat([joined(*group) for group in groups.items()], *camera, sky)


def joined(key, parts):
    """One surface of many parts."""
    material, flat = key
    counts = [len(positions) for positions, _, _ in parts]
    starts = np.concatenate([[0], np.cumsum(counts)[:-1]]).astype(np.int64)
    positions = np.concatenate([p for p, _, _ in parts]).astype(np.float32)
    normals = None if flat else np.concatenate([n for _, n, _ in parts]).astype(np.float32)
    triangles = np.concatenate([t.astype(np.int64) + start for (_, _, t), start in zip(parts, starts)])
    return Surface(positions, normals, triangles.astype(np.int32), material)
