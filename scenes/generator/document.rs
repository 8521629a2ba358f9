//! A glTF document under construction, and its two file forms.

use std::collections::BTreeSet;

use base64::{Engine, engine::general_purpose::STANDARD};
use glam::{Mat3, Quat, Vec3};
use serde_json::{Map, Value, json};

use super::{
    material::{Color, Material},
    shape::Shape,
};

/// Index of a material.
#[derive(Clone, Copy)]
pub struct MaterialId(pub usize);

/// Index of a texture.
#[derive(Clone, Copy)]
pub struct TextureId(pub usize);

/// Index of a mesh.
#[derive(Clone, Copy)]
pub struct MeshId(pub usize);

/// Index of a node.
#[derive(Clone, Copy)]
pub struct NodeId(pub usize);

/// A shape in the buffer, to be used by any number of meshes.
#[derive(Clone)]
pub struct ShapeId {
    attributes: Value,
    indices: usize,
    triangles: usize,
}

impl ShapeId {
    /// The same shape with fewer attributes, from the same bytes.
    pub fn only(&self, wanted: Attributes) -> Self {
        let mut shape = self.clone();
        let attributes = shape.attributes.as_object_mut().expect("attributes are an object");
        attributes.retain(|key, _| match key.as_str() {
            "TANGENT" => wanted == Attributes::Bumpy,
            "TEXCOORD_0" => matches!(wanted, Attributes::Textured | Attributes::Bumpy),
            "NORMAL" => wanted != Attributes::Flat,
            _ => true,
        });
        shape
    }
}

/// Which attributes besides positions a shape needs.
#[derive(Clone, Copy, PartialEq, Eq)]
pub enum Attributes {
    /// None, so that every triangle is flat.
    Flat,
    /// Normals.
    Plain,
    /// Normals and texture coordinates.
    Textured,
    /// Normals, texture coordinates and tangents.
    Bumpy,
}

/// Where a node is. Written only where it differs from doing nothing.
#[derive(Clone, Copy)]
pub struct Place {
    /// Metres.
    pub translation: Vec3,
    /// Unit.
    pub rotation: Quat,
    /// Per axis; negative mirrors.
    pub scale: Vec3,
}

impl Place {
    /// Nothing moved.
    pub const ORIGIN: Self = Self { translation: Vec3::ZERO, rotation: Quat::IDENTITY, scale: Vec3::ONE };

    /// Moved only.
    pub fn at(x: f32, y: f32, z: f32) -> Self {
        Self { translation: Vec3::new(x, y, z), ..Self::ORIGIN }
    }

    /// At `eye`, local −Z towards `target`, as cameras and lights look.
    pub fn looking(eye: Vec3, target: Vec3) -> Self {
        let back = (eye - target).normalize();
        let up = if back.y.abs() > 0.999 { Vec3::Z } else { Vec3::Y };
        let right = up.cross(back).normalize();
        let rotation = Quat::from_mat3(&Mat3::from_cols(right, back.cross(right), back)).normalize();
        Self { translation: eye, rotation, scale: Vec3::ONE }
    }

    /// Turned about the vertical, degrees.
    pub fn turned(self, degrees: f32) -> Self {
        Self { rotation: Quat::from_rotation_y(degrees.to_radians()), ..self }
    }

    fn write(&self, node: &mut Value) {
        if self.translation != Vec3::ZERO {
            node["translation"] = numbers(&self.translation.to_array(), 3);
        }
        if self.rotation != Quat::IDENTITY {
            node["rotation"] = numbers(&self.rotation.to_array(), 5);
        }
        if self.scale != Vec3::ONE {
            node["scale"] = numbers(&self.scale.to_array(), 3);
        }
    }
}

/// Everything a file will hold.
#[derive(Default)]
pub struct Document {
    nodes: Vec<Value>,
    roots: Vec<usize>,
    cameras: Vec<Value>,
    lights: Vec<Value>,
    meshes: Vec<Value>,
    mesh_triangles: Vec<usize>,
    materials: Vec<Value>,
    textures: Vec<Value>,
    images: Vec<Value>,
    samplers: Vec<Value>,
    accessors: Vec<Value>,
    views: Vec<Value>,
    bytes: Vec<u8>,
}

impl Document {
    /// Adds a material.
    pub fn material(&mut self, material: Material) -> MaterialId {
        self.materials.push(material.into_value());
        MaterialId(self.materials.len() - 1)
    }

    /// Adds a PNG as a repeated, bilinear texture.
    pub fn texture(&mut self, name: &str, png: &[u8]) -> TextureId {
        self.sampled_texture(name, png, 10497)
    }

    /// Adds a PNG whose edge goes on for ever.
    pub fn clamped_texture(&mut self, name: &str, png: &[u8]) -> TextureId {
        self.sampled_texture(name, png, 33071)
    }

    fn sampled_texture(&mut self, name: &str, png: &[u8], wrap: u32) -> TextureId {
        let view = self.view(png, None);
        let sampler = json!({"magFilter": 9729, "minFilter": 9987, "wrapS": wrap, "wrapT": wrap});
        let row = self.samplers.iter().position(|s| *s == sampler).unwrap_or_else(|| {
            self.samplers.push(sampler);
            self.samplers.len() - 1
        });
        self.images.push(json!({"name": name, "mimeType": "image/png", "bufferView": view}));
        self.textures.push(json!({"sampler": row, "source": self.images.len() - 1}));
        TextureId(self.textures.len() - 1)
    }

    /// Puts a shape into the buffer.
    pub fn shape(&mut self, shape: &Shape, wanted: Attributes) -> ShapeId {
        let floats = |vectors: &[Vec3]| vectors.iter().flat_map(|v| v.to_array()).collect::<Vec<f32>>();
        let low = shape.positions.iter().copied().fold(Vec3::INFINITY, Vec3::min);
        let high = shape.positions.iter().copied().fold(Vec3::NEG_INFINITY, Vec3::max);
        let position = self.attribute(&floats(&shape.positions), "VEC3", 3);
        // The bounds must be those of the stored numbers, to the bit.
        let exact = |v: Vec3| v.to_array().map(f64::from);
        self.accessors[position]["min"] = json!(exact(low));
        self.accessors[position]["max"] = json!(exact(high));
        let mut attributes = json!({"POSITION": position});
        if wanted != Attributes::Flat {
            attributes["NORMAL"] = json!(self.attribute(&floats(&shape.normals), "VEC3", 3));
        }
        if wanted == Attributes::Bumpy {
            let tangents: Vec<f32> = shape.tangents.iter().flat_map(|t| [t.x, t.y, t.z, 1.0]).collect();
            attributes["TANGENT"] = json!(self.attribute(&tangents, "VEC4", 4));
        }
        if matches!(wanted, Attributes::Textured | Attributes::Bumpy) {
            let uvs: Vec<f32> = shape.uvs.iter().flat_map(|uv| uv.to_array()).collect();
            attributes["TEXCOORD_0"] = json!(self.attribute(&uvs, "VEC2", 2));
        }
        let corners = shape.triangles.iter().flatten();
        let (kind, bytes): (u32, Vec<u8>) = if shape.positions.len() < 65_536 {
            (5123, corners.flat_map(|&i| (i as u16).to_le_bytes()).collect())
        } else {
            (5125, corners.flat_map(|i| i.to_le_bytes()).collect())
        };
        let view = self.view(&bytes, Some(34963));
        let count = 3 * shape.triangles.len();
        self.accessors.push(json!({"bufferView": view, "componentType": kind, "count": count, "type": "SCALAR"}));
        ShapeId { attributes, indices: self.accessors.len() - 1, triangles: shape.triangles.len() }
    }

    fn attribute(&mut self, values: &[f32], kind: &str, components: usize) -> usize {
        let bytes: Vec<u8> = values.iter().flat_map(|v| v.to_le_bytes()).collect();
        let view = self.view(&bytes, Some(34962));
        let count = values.len() / components;
        self.accessors.push(json!({"bufferView": view, "componentType": 5126, "count": count, "type": kind}));
        self.accessors.len() - 1
    }

    fn view(&mut self, bytes: &[u8], target: Option<u32>) -> usize {
        let mut view = json!({"buffer": 0, "byteOffset": self.bytes.len(), "byteLength": bytes.len()});
        if let Some(target) = target {
            view["target"] = json!(target);
        }
        self.bytes.extend(bytes);
        self.bytes.resize(self.bytes.len().next_multiple_of(4), 0);
        self.views.push(view);
        self.views.len() - 1
    }

    /// Makes a mesh of shapes in the buffer, each with its material.
    pub fn mesh(&mut self, name: &str, parts: &[(&ShapeId, MaterialId)]) -> MeshId {
        let primitives: Vec<Value> = parts
            .iter()
            .map(|(shape, material)| {
                json!({"attributes": shape.attributes, "indices": shape.indices, "material": material.0})
            })
            .collect();
        self.meshes.push(json!({"name": name, "primitives": primitives}));
        self.mesh_triangles.push(parts.iter().map(|(shape, _)| shape.triangles).sum());
        MeshId(self.meshes.len() - 1)
    }

    /// Shows a shape without texture once, under a name of its own.
    pub fn show(&mut self, name: &str, shape: &Shape, material: MaterialId) -> NodeId {
        self.show_with(name, shape, Attributes::Plain, material)
    }

    /// Shows a shape of flat triangles once.
    pub fn show_flat(&mut self, name: &str, shape: &Shape, material: MaterialId) -> NodeId {
        self.show_with(name, shape, Attributes::Flat, material)
    }

    /// Shows a shape once, with other attributes.
    pub fn show_with(&mut self, name: &str, shape: &Shape, wanted: Attributes, material: MaterialId) -> NodeId {
        let shape = self.shape(shape, wanted);
        let mesh = self.mesh(name, &[(&shape, material)]);
        self.place(name, mesh, Place::ORIGIN)
    }

    /// Shows a mesh at the root of the scene.
    pub fn place(&mut self, name: &str, mesh: MeshId, place: Place) -> NodeId {
        let node = self.child(name, mesh, place);
        self.roots.push(node.0);
        node
    }

    /// A node with a mesh, to be listed by a [`group`](Self::group).
    pub fn child(&mut self, name: &str, mesh: MeshId, place: Place) -> NodeId {
        self.node(name, place, "mesh", json!(mesh.0))
    }

    /// A node at the root that holds others.
    pub fn group(&mut self, name: &str, place: Place, children: &[NodeId]) -> NodeId {
        let rows: Vec<usize> = children.iter().map(|child| child.0).collect();
        let node = self.node(name, place, "children", json!(rows));
        self.roots.push(node.0);
        node
    }

    fn node(&mut self, name: &str, place: Place, key: &str, value: Value) -> NodeId {
        let mut node = json!({"name": name});
        node[key] = value;
        place.write(&mut node);
        self.nodes.push(node);
        NodeId(self.nodes.len() - 1)
    }

    /// A perspective camera; `yfov` in degrees.
    pub fn camera(&mut self, name: &str, yfov: f64, aspect: f64, place: Place) {
        let yfov = rounded(yfov.to_radians(), 6);
        let lens = json!({"aspectRatio": rounded(aspect, 6), "yfov": yfov, "znear": 0.01});
        self.cameras.push(json!({"name": name, "type": "perspective", "perspective": lens}));
        let node = self.node(name, place, "camera", json!(self.cameras.len() - 1));
        self.roots.push(node.0);
    }

    /// A point light, cd.
    pub fn point_light(&mut self, name: &str, color: Color, candela: f64, at: Vec3) {
        let light = json!({"name": name, "type": "point", "color": color, "intensity": candela});
        self.light(name, light, Place { translation: at, ..Place::ORIGIN });
    }

    /// A spot light, cd; half angles in degrees.
    pub fn spot_light(&mut self, name: &str, color: Color, candela: f64, half_angles: [f64; 2], place: Place) {
        let [inner, outer] = half_angles.map(|angle| rounded(angle.to_radians(), 6));
        let cone = json!({"innerConeAngle": inner, "outerConeAngle": outer});
        let light = json!({"name": name, "type": "spot", "color": color, "intensity": candela, "spot": cone});
        self.light(name, light, place);
    }

    /// A directional light, lx, shining from `place` along its −Z.
    pub fn directional_light(&mut self, name: &str, color: Color, lux: f64, place: Place) {
        let light = json!({"name": name, "type": "directional", "color": color, "intensity": lux});
        self.light(name, light, place);
    }

    fn light(&mut self, name: &str, light: Value, place: Place) {
        self.lights.push(light);
        let extension = json!({"KHR_lights_punctual": {"light": self.lights.len() - 1}});
        let node = self.node(name, place, "extensions", extension);
        self.roots.push(node.0);
    }

    /// Its size in words: nodes that show a mesh, and triangles stored and shown.
    pub fn counts(&self) -> String {
        let shown: Vec<usize> =
            self.nodes.iter().filter_map(|node| node.get("mesh")?.as_u64()).map(|m| m as usize).collect();
        let stored: usize =
            self.accessors.iter().filter(|a| a["type"] == "SCALAR").filter_map(|a| a["count"].as_u64()).sum::<u64>()
                as usize
                / 3;
        let triangles: usize = shown.iter().map(|&mesh| self.mesh_triangles[mesh]).sum();
        format!(
            "{} instances, {stored} triangles stored, {triangles} shown, {} punctual lights",
            shown.len(),
            self.lights.len()
        )
    }

    fn json(&mut self, uri: Option<String>) -> Value {
        let mut buffer = Map::new();
        if let Some(uri) = uri {
            buffer.insert("uri".into(), json!(uri));
        }
        buffer.insert("byteLength".into(), json!(self.bytes.len()));
        let mut root = json!({
            "asset": {"version": "2.0", "generator": "wavecast scenes"},
            "scene": 0,
            "scenes": [{"nodes": self.roots}],
        });
        if !self.lights.is_empty() {
            root["extensions"] = json!({"KHR_lights_punctual": {"lights": self.lights}});
        }
        let lists = [
            ("nodes", std::mem::take(&mut self.nodes)),
            ("cameras", std::mem::take(&mut self.cameras)),
            ("meshes", std::mem::take(&mut self.meshes)),
            ("materials", std::mem::take(&mut self.materials)),
            ("textures", std::mem::take(&mut self.textures)),
            ("images", std::mem::take(&mut self.images)),
            ("samplers", std::mem::take(&mut self.samplers)),
            ("accessors", std::mem::take(&mut self.accessors)),
            ("bufferViews", std::mem::take(&mut self.views)),
            ("buffers", vec![Value::Object(buffer)]),
        ];
        for (name, list) in lists {
            if !list.is_empty() {
                root[name] = Value::Array(list);
            }
        }
        let mut used = BTreeSet::new();
        collect_extensions(&root, &mut used);
        if !used.is_empty() {
            root["extensionsUsed"] = json!(used);
        }
        root
    }

    /// As text with everything inside, one element to a line.
    pub fn into_gltf(mut self) -> Vec<u8> {
        let uri = format!("data:application/octet-stream;base64,{}", STANDARD.encode(&self.bytes));
        let Value::Object(root) = self.json(Some(uri)) else { unreachable!("the root is an object") };
        let mut text = String::from("{\n");
        let last = root.len() - 1;
        for (i, (key, value)) in root.iter().enumerate() {
            let body = match value {
                Value::Array(list) if key != "extensionsUsed" => {
                    let lines: Vec<String> = list.iter().map(|element| format!("    {element}")).collect();
                    format!("[\n{}\n  ]", lines.join(",\n"))
                }
                other => other.to_string(),
            };
            text += &format!("  \"{key}\": {body}{}\n", if i == last { "" } else { "," });
        }
        text += "}\n";
        text.into_bytes()
    }

    /// As a binary container.
    pub fn into_glb(mut self) -> Vec<u8> {
        let mut text = self.json(None).to_string().into_bytes();
        text.resize(text.len().next_multiple_of(4), b' ');
        let total = 12 + 8 + text.len() + 8 + self.bytes.len();
        let mut file = Vec::with_capacity(total);
        file.extend(b"glTF");
        file.extend(2u32.to_le_bytes());
        file.extend((total as u32).to_le_bytes());
        for (kind, chunk) in [(b"JSON", &text), (b"BIN\0", &self.bytes)] {
            file.extend((chunk.len() as u32).to_le_bytes());
            file.extend(kind);
            file.extend(chunk);
        }
        file
    }
}

fn collect_extensions(value: &Value, used: &mut BTreeSet<String>) {
    match value {
        Value::Object(object) => {
            for (key, inner) in object {
                if let ("extensions", Value::Object(extensions)) = (key.as_str(), inner) {
                    used.extend(extensions.keys().cloned());
                }
                collect_extensions(inner, used);
            }
        }
        Value::Array(list) => list.iter().for_each(|inner| collect_extensions(inner, used)),
        _ => {}
    }
}

/// With so many decimals, and without a fraction where there is none.
fn rounded(x: f64, decimals: i32) -> Value {
    let unit = 10f64.powi(decimals);
    let scaled = (x * unit).round();
    if scaled % unit == 0.0 { json!((scaled / unit) as i64) } else { json!(scaled / unit) }
}

fn numbers(values: &[f32], decimals: i32) -> Value {
    values.iter().map(|&v| rounded(f64::from(v), decimals)).collect()
}
