//! What is in a file, for people.

use super::{
    document::{ANIMATIONS, CAMERAS, Document, IMAGES, Kind, MATERIALS, MESHES, NODES, SCENES, SKINS, TEXTURES},
    error::LoadError,
    extensions::ExtensionUse,
    json::Json,
    lights, meshes, nodes,
};
use crate::world::SceneKey;

/// What a scene file holds, and what becomes of its extensions.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct FileInfo {
    /// The program that wrote the file.
    pub generator: Option<String>,
    /// Version of glTF.
    pub version: String,
    /// How many there are of everything, in the whole file.
    pub counts: Counts,
    /// Extensions the file names, required ones first.
    pub extensions: Vec<ExtensionUse>,
    /// The file's cameras.
    pub cameras: Vec<CameraInfo>,
    /// Names of the file's scenes.
    pub scenes: Vec<String>,
    /// Index of the scene that was loaded; `None` if the file has no scenes and all nodes were.
    pub scene: Option<usize>,
}

/// Numbers of things in a file.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counts {
    /// Meshes.
    pub meshes: usize,
    /// Triangles of all meshes, each once.
    pub triangles: u64,
    /// Triangles of the loaded scene, as often as they are shown.
    pub instanced_triangles: u64,
    /// Materials.
    pub materials: usize,
    /// Textures.
    pub textures: usize,
    /// Images.
    pub images: usize,
    /// Punctual lights.
    pub lights: usize,
    /// Cameras.
    pub cameras: usize,
    /// Nodes.
    pub nodes: usize,
    /// Scenes.
    pub scenes: usize,
    /// Animations.
    pub animations: usize,
    /// Skins.
    pub skins: usize,
}

/// A camera of a file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct CameraInfo {
    /// Its own name, else that of the first node that carries it, else `camera` and its index.
    pub name: String,
    /// The entities of the loaded scene that carry it, ascending.
    pub keys: Vec<SceneKey>,
}

impl FileInfo {
    /// All but the extensions, the cameras' keys and what depends on the loaded scene.
    pub(super) fn read(document: &Document<'_>) -> Result<Self, LoadError> {
        let asset = document.root.required("asset")?;
        let text = |json: Json<'_>| json.string().map(str::to_owned);
        let count = |kind: Kind| document.count(kind);
        let triangles =
            document.elements(MESHES).map(|mesh| meshes::count_triangles(&mesh, document)).fold(0, u64::saturating_add);
        Ok(Self {
            generator: asset.get("generator")?.map(text).transpose()?,
            version: asset.required("version").and_then(text)?,
            counts: Counts {
                meshes: count(MESHES),
                triangles,
                instanced_triangles: 0,
                materials: count(MATERIALS),
                textures: count(TEXTURES),
                images: count(IMAGES),
                lights: lights::all(document)?.len(),
                cameras: count(CAMERAS),
                nodes: count(NODES),
                scenes: count(SCENES),
                animations: count(ANIMATIONS),
                skins: count(SKINS),
            },
            extensions: Vec::new(),
            cameras: camera_names(document)?,
            scenes: nodes::scene_names(document)?,
            scene: None,
        })
    }
}

fn camera_names(document: &Document<'_>) -> Result<Vec<CameraInfo>, LoadError> {
    let mut carriers: Vec<Option<String>> = vec![None; document.count(CAMERAS)];
    for node in document.elements(NODES) {
        if let (Some((camera, _)), Some(name)) = (document.follow_key(&node, "camera", CAMERAS)?, node.get("name")?) {
            carriers[camera].get_or_insert(name.string()?.to_owned());
        }
    }
    let cameras = document.elements(CAMERAS).zip(carriers).enumerate();
    cameras
        .map(|(index, (camera, carrier))| {
            let name = match (camera.get("name")?, carrier) {
                (None, Some(carrier)) => carrier,
                _ => camera.name_or("camera", index)?,
            };
            Ok(CameraInfo { name, keys: Vec::new() })
        })
        .collect()
}
