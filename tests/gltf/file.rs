//! Small glTF files made in memory.

use std::{fs, sync::Arc};

use base64::{Engine, prelude::BASE64_STANDARD};
use serde_json::{Value, json};
use wavecast::{
    load::{LoadError, LoadOptions, Loaded, load},
    world::{Geometry, SceneKey, TriMesh},
};

pub const I8: u32 = 5120;
pub const U8: u32 = 5121;
pub const I16: u32 = 5122;
pub const U16: u32 = 5123;
pub const U32: u32 = 5125;
pub const F32: u32 = 5126;

/// A glTF file with one buffer.
#[derive(Clone)]
pub struct File {
    pub json: Value,
    pub bin: Vec<u8>,
}

impl File {
    pub fn new() -> Self {
        Self { json: json!({"asset": {"version": "2.0"}}), bin: Vec::new() }
    }

    /// Appends to a top-level array and returns the index.
    pub fn push(&mut self, key: &str, value: Value) -> usize {
        let array = self.json.as_object_mut().unwrap().entry(key).or_insert_with(|| json!([]));
        array.as_array_mut().unwrap().push(value);
        array.as_array().unwrap().len() - 1
    }

    /// A bufferView of the bytes.
    pub fn view(&mut self, bytes: &[u8]) -> usize {
        while !self.bin.len().is_multiple_of(4) {
            self.bin.push(0);
        }
        let offset = self.bin.len();
        self.bin.extend_from_slice(bytes);
        self.push("bufferViews", json!({"buffer": 0, "byteOffset": offset, "byteLength": bytes.len()}))
    }

    pub fn accessor(&mut self, component: u32, shape: &str, count: usize, bytes: &[u8]) -> usize {
        let view = self.view(bytes);
        let accessor = json!({"bufferView": view, "componentType": component, "type": shape, "count": count});
        self.push("accessors", accessor)
    }

    pub fn floats(&mut self, shape: &str, values: &[f32]) -> usize {
        let width = match shape {
            "SCALAR" => 1,
            "VEC2" => 2,
            "VEC3" => 3,
            "VEC4" => 4,
            _ => 16,
        };
        self.accessor(F32, shape, values.len() / width, &le(values))
    }

    pub fn indices(&mut self, values: &[u16]) -> usize {
        let bytes: Vec<u8> = values.iter().flat_map(|x| x.to_le_bytes()).collect();
        self.accessor(U16, "SCALAR", values.len(), &bytes)
    }

    /// The triangle (0,0,0), (1,0,0), (0,1,0).
    pub fn triangle(&mut self) -> usize {
        self.floats("VEC3", &[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0])
    }

    /// A mesh of one primitive at a node of its own in scene 0.
    pub fn show(&mut self, primitive: Value) -> usize {
        let mesh = self.push("meshes", json!({"primitives": [primitive]}));
        self.node(json!({"mesh": mesh}))
    }

    /// A root node of scene 0.
    pub fn node(&mut self, node: Value) -> usize {
        let index = self.push("nodes", node);
        if self.json.get("scenes").is_none() {
            self.push("scenes", json!({"nodes": []}));
        }
        self.json["scenes"][0]["nodes"].as_array_mut().unwrap().push(json!(index));
        index
    }

    /// The JSON with its buffer as a data URI.
    pub fn text(&self) -> String {
        let mut json = self.json.clone();
        if !self.bin.is_empty() {
            let uri = format!("data:application/octet-stream;base64,{}", BASE64_STANDARD.encode(&self.bin));
            json["buffers"] = json!([{"byteLength": self.bin.len(), "uri": uri}]);
        }
        json.to_string()
    }

    pub fn glb(&self) -> Vec<u8> {
        let mut json = self.json.clone();
        json["buffers"] = json!([{"byteLength": self.bin.len()}]);
        glb(json.to_string().as_bytes(), &self.bin)
    }

    pub fn load(&self) -> Result<Loaded, LoadError> {
        load_bytes(self.text().as_bytes())
    }

    /// The mesh of the only entity with geometry.
    #[track_caller]
    pub fn mesh(&self) -> Arc<TriMesh> {
        only_mesh(&self.load().unwrap())
    }
}

/// Little-endian bytes.
pub fn le(values: &[f32]) -> Vec<u8> {
    values.iter().flat_map(|x| x.to_le_bytes()).collect()
}

/// A GLB of the two chunks.
pub fn glb(json: &[u8], bin: &[u8]) -> Vec<u8> {
    let mut bytes = b"glTF\x02\0\0\0\0\0\0\0".to_vec();
    for (kind, body, pad) in [(b"JSON", json, b' '), (b"BIN\0", bin, 0)] {
        let length = body.len().next_multiple_of(4);
        bytes.extend((length as u32).to_le_bytes());
        bytes.extend(kind);
        bytes.extend(body);
        bytes.resize(bytes.len() + length - body.len(), pad);
    }
    let length = (bytes.len() as u32).to_le_bytes();
    bytes[8..12].copy_from_slice(&length);
    bytes
}

/// Loads a file of these bytes, alone in its folder.
pub fn load_bytes(bytes: &[u8]) -> Result<Loaded, LoadError> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("file.gltf");
    fs::write(&path, bytes).unwrap();
    load(&path, &LoadOptions::default())
}

#[track_caller]
pub fn only_mesh(loaded: &Loaded) -> Arc<TriMesh> {
    let keys = loaded.scene.keys_with::<Geometry>();
    assert_eq!(keys.len(), 1, "entities with geometry");
    mesh_of(loaded, keys[0])
}

pub fn mesh_of(loaded: &Loaded, key: SceneKey) -> Arc<TriMesh> {
    loaded.scene.get::<Geometry>(key).expect("the entity has geometry").0
}

/// The message of the error that loading must end in.
#[track_caller]
pub fn error_of(result: Result<Loaded, LoadError>) -> String {
    match result {
        Ok(_) => panic!("loading must fail"),
        Err(error) => error.to_string(),
    }
}

/// The messages of all warnings.
pub fn warnings(loaded: &Loaded) -> Vec<String> {
    loaded.warnings.iter().map(ToString::to_string).collect()
}

/// An eight-bit RGB PNG of the given texels.
pub fn png(width: u32, height: u32, color: png::ColorType, depth: png::BitDepth, data: &[u8]) -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, width, height);
    encoder.set_color(color);
    encoder.set_depth(depth);
    if color == png::ColorType::Indexed {
        encoder.set_palette(vec![255, 0, 0, 0, 0, 255]);
    }
    encoder.write_header().unwrap().write_image_data(data).unwrap();
    bytes
}
