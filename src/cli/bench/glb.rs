//! Scenes as files for other programs and for older versions of this one: those made by formula, and copies of files that
//! have the camera of `--view`.

use std::{fs, io::Write as _, path::Path};

use serde_json::{Value, json};
use wavecast::{
    film::write_file,
    glam::Vec3,
    load::LoadError,
    world::{
        Camera, DirectionalLight, EmissiveSurface, Environment, Geometry, LocalTransform, Material, MaterialSlots,
        Projection, Scene, SceneKey, Sky,
    },
};

use super::{
    Args,
    subject::{Source, Subject},
};
use crate::cli::{Outcome, console::Console, error::CliError};

/// glTF wants cameras to have a nearest distance above zero, m.
const NEAREST: f32 = 1e-3;

/// What cameras are called, for `--camera`.
const NAME: &str = "view";

/// Writes each scene as a .glb into a folder.
pub fn run(folder: &Path, args: &Args, console: &mut Console) -> Result<Outcome, CliError> {
    fs::create_dir_all(folder).map_err(|source| CliError::Output { path: folder.into(), source })?;
    let mut files = Vec::new();
    for source in &args.scenes {
        let mut scene = source.scene(console)?;
        if let Some(view) = args.view {
            view.take(&mut scene);
        }
        let name = match source {
            // Never that of the file itself, whose folder this may be.
            Source::File(path) => format!("{}-{NAME}", path.with_extension("").display()),
            Source::Generated(..) => source.to_string(),
        };
        let path = folder.join(Subject::file_name(&name)).with_extension("glb");
        let mut sky = None;
        match (source, args.view) {
            (Source::Generated(..), _) => {
                write(&scene, &path)?;
                sky = constant_sky(&scene);
            }
            (Source::File(from), Some(_)) => copy(from, &scene, &path)?,
            (Source::File(from), None) => {
                return Err(CliError::Usage(format!("{} is a file already: --view gives it a camera", from.display())));
            }
        }
        console.part(&format!("{}, its camera: {NAME}", path.display()));
        if let Some([r, g, b]) = sky {
            console.note(format!("glTF has no sky: render {} with --env {r},{g},{b}", path.display()));
        }
        files.push(json!({ "file": path, "camera": NAME, "sky": sky }));
    }
    console.end(|| json!({ "files": files }));
    Ok(Outcome::Done)
}

/// A copy of a file with the scene's camera in it.
fn copy(from: &Path, scene: &Scene, to: &Path) -> Result<(), CliError> {
    let bytes = fs::read(from).map_err(|source| LoadError::Read { path: from.into(), at: None, source })?;
    let wrong = || CliError::Usage(format!("{} is no .glb: --write-scenes copies no others", from.display()));
    // A header of twelve bytes, then the length of the first chunk, its kind and itself.
    let length = bytes.get(12..16).and_then(|length| length.try_into().ok()).map(u32::from_le_bytes);
    let end = 20 + length.ok_or_else(wrong)? as usize;
    let text = bytes.get(20..end).filter(|_| bytes.starts_with(b"glTF")).ok_or_else(wrong)?;
    let mut document: Value = serde_json::from_slice(text).map_err(|_| wrong())?;
    if let Some((camera, mut node)) = camera(scene) {
        let mut push = |key: &str, value| -> Option<usize> {
            let all = document.as_object_mut()?.entry(key).or_insert_with(|| json!([])).as_array_mut()?;
            all.push(value);
            Some(all.len() - 1)
        };
        node["camera"] = push("cameras", camera).ok_or_else(wrong)?.into();
        let node = push("nodes", node).ok_or_else(wrong)?;
        let shown = document["scene"].as_u64().unwrap_or(0) as usize;
        let roots = document.pointer_mut(&format!("/scenes/{shown}/nodes")).and_then(Value::as_array_mut);
        roots.ok_or_else(wrong)?.push(node.into());
    }
    write_chunks(to, document, &bytes[end..])
}

/// A camera and its node, without the index by which that refers to it.
fn camera(scene: &Scene) -> Option<(Value, Value)> {
    let key = scene.active_camera.or_else(|| scene.keys_with::<Camera>().first().copied())?;
    let Camera { projection: Projection::Perspective { yfov, .. }, znear, .. } = scene.get(key)? else { return None };
    let perspective = json!({ "yfov": yfov, "znear": znear.max(NEAREST) });
    let camera = json!({ "name": NAME, "type": "perspective", "perspective": perspective });
    Some((camera, json!({ "name": NAME, "matrix": matrix(scene, key) })))
}

/// A file of the document and the chunks that follow.
fn write_chunks(path: &Path, document: Value, rest: &[u8]) -> Result<(), CliError> {
    let mut text = document.to_string().into_bytes();
    text.resize(text.len().next_multiple_of(4), b' ');
    let length = |length: usize| {
        let too_large = || CliError::Usage(format!("{}: a .glb cannot be larger than 4 GiB", path.display()));
        u32::try_from(length).map(u32::to_le_bytes).map_err(|_| too_large())
    };
    let (whole, part) = (length(12 + 8 + text.len() + rest.len())?, length(text.len())?);
    let all = [b"glTF", &2_u32.to_le_bytes(), &whole, &part, b"JSON", text.as_slice(), rest];
    Ok(write_file(path, |file| all.iter().try_for_each(|bytes| file.write_all(bytes)))?)
}

/// The radiance of a constant sky, nit.
fn constant_sky(scene: &Scene) -> Option<[f32; 3]> {
    let environment: Environment = scene.get(*scene.keys_with::<Environment>().first()?)?;
    match environment.sky {
        Sky::Constant(radiance) => Some((radiance * environment.scale).to_array()),
        Sky::Map(_) => None,
    }
}

/// A document under construction.
#[derive(Default)]
struct Document {
    bytes: Vec<u8>,
    views: Vec<Value>,
    accessors: Vec<Value>,
    materials: Vec<Value>,
    meshes: Vec<Value>,
    nodes: Vec<Value>,
    cameras: Vec<Value>,
    lights: Vec<Value>,
}

impl Document {
    /// Numbers as an accessor, whose index is returned.
    fn numbers(&mut self, numbers: &[u8], mut accessor: Value) -> usize {
        accessor["bufferView"] = self.views.len().into();
        self.views.push(json!({ "buffer": 0, "byteOffset": self.bytes.len(), "byteLength": numbers.len() }));
        self.bytes.extend(numbers);
        self.accessors.push(accessor);
        self.accessors.len() - 1
    }

    /// Something shown by a material that does not depend on textures.
    fn show(&mut self, scene: &Scene, key: SceneKey, Geometry(mesh): &Geometry) {
        let slots: Option<MaterialSlots> = scene.get(key);
        let material: Option<Material> = slots.and_then(|slots| scene.get(*slots.0.first()?));
        let material = material.unwrap_or_default();
        let emitted = scene.get(key).map_or(material.emissive, |EmissiveSurface { radiance }| radiance);
        let strength = emitted.max_element();
        let mut paint = json!({
            "pbrMetallicRoughness": {
                "baseColorFactor": material.base_color.extend(material.base_alpha).to_array(),
                "metallicFactor": material.metallic,
                "roughnessFactor": material.roughness,
            },
            "doubleSided": material.double_sided,
            "extensions": { "KHR_materials_specular": { "specularFactor": material.specular } },
        });
        if strength > 0.0 {
            paint["emissiveFactor"] = json!((emitted / strength).to_array());
            paint["extensions"]["KHR_materials_emissive_strength"] = json!({ "emissiveStrength": strength });
        }
        let (lower, upper) = mesh.positions.iter().fold((Vec3::MAX, Vec3::MIN), |(a, b), p| (a.min(*p), b.max(*p)));
        let positions: Vec<u8> = mesh.positions.iter().flat_map(|p| p.to_array()).flat_map(f32::to_le_bytes).collect();
        let positions = self.numbers(
            &positions,
            json!({
                "componentType": 5126,
                "count": mesh.positions.len(),
                "type": "VEC3",
                "min": lower.to_array(),
                "max": upper.to_array(),
            }),
        );
        let rows: Vec<u8> = mesh.triangles.iter().flatten().flat_map(|row| row.to_le_bytes()).collect();
        let rows =
            self.numbers(&rows, json!({ "componentType": 5125, "count": 3 * mesh.triangles.len(), "type": "SCALAR" }));
        let primitive =
            json!({ "attributes": { "POSITION": positions }, "indices": rows, "material": self.materials.len() });
        self.nodes.push(json!({ "mesh": self.meshes.len() }));
        self.meshes.push(json!({ "primitives": [primitive] }));
        self.materials.push(paint);
    }

    /// As a .glb.
    fn write(self, path: &Path) -> Result<(), CliError> {
        let Self { mut bytes, views, accessors, materials, meshes, nodes, cameras, lights } = self;
        let mut used = vec!["KHR_materials_specular", "KHR_materials_emissive_strength"];
        let mut document = json!({
            "asset": { "version": "2.0", "generator": concat!("wavecast ", env!("CARGO_PKG_VERSION")) },
            "scene": 0,
            "scenes": [{ "nodes": (0..nodes.len()).collect::<Vec<_>>() }],
            "nodes": nodes,
            "meshes": meshes,
            "materials": materials,
            "accessors": accessors,
            "bufferViews": views,
            "buffers": [{ "byteLength": bytes.len() }],
        });
        if !cameras.is_empty() {
            document["cameras"] = cameras.into();
        }
        if !lights.is_empty() {
            used.push("KHR_lights_punctual");
            document["extensions"] = json!({ "KHR_lights_punctual": { "lights": lights } });
        }
        document["extensionsUsed"] = used.into();
        // One that does not fit is too large as a whole, which is found below.
        let length = u32::try_from(bytes.len()).unwrap_or(u32::MAX);
        bytes.splice(0..0, [length.to_le_bytes(), *b"BIN\0"].concat());
        write_chunks(path, document, &bytes)
    }
}

/// A node's place.
fn matrix(scene: &Scene, key: SceneKey) -> [f64; 16] {
    let place = scene.get(key).unwrap_or(LocalTransform::IDENTITY).to_affine();
    let [x, y, z, at] = [place.matrix3.x_axis, place.matrix3.y_axis, place.matrix3.z_axis, place.translation];
    [x.x, x.y, x.z, 0.0, y.x, y.y, y.z, 0.0, z.x, z.y, z.z, 0.0, at.x, at.y, at.z, 1.0]
}

/// Writes what generated scenes have: meshes of one plain material that stand where they are, lamps, suns, the camera;
/// a sky cannot be.
fn write(scene: &Scene, path: &Path) -> Result<(), CliError> {
    let mut document = Document::default();
    for key in scene.keys_with::<Geometry>() {
        if let Some(geometry) = scene.get(key) {
            document.show(scene, key, &geometry);
        }
    }
    for key in scene.keys_with::<DirectionalLight>() {
        let Some(DirectionalLight { color, illuminance }) = scene.get(key) else { continue };
        let light = json!({ "light": document.lights.len() });
        document.nodes.push(json!({ "matrix": matrix(scene, key), "extensions": { "KHR_lights_punctual": light } }));
        let color = color.to_array();
        document.lights.push(json!({ "type": "directional", "color": color, "intensity": illuminance.0 }));
    }
    if let Some((camera, mut node)) = camera(scene) {
        node["camera"] = 0.into();
        document.nodes.push(node);
        document.cameras.push(camera);
    }
    document.write(path)
}

#[cfg(test)]
mod tests {
    use wavecast::{
        load::{self, LoadOptions},
        render::{RenderSettings, Renderer},
    };

    use super::*;
    use crate::cli::bench::{rays::world_triangles, subject::Formula};

    /// What is read from the file are the same triangles, and their picture has the same light.
    #[test]
    fn scenes_come_back_from_their_files() {
        let folder = tempfile::tempdir().unwrap();
        for formula in [Formula::Hall, Formula::Foliage] {
            let mut console = Console::new(true, false);
            let mut scene = Source::Generated(formula, 3000).scene(&mut console).unwrap();
            let path = folder.path().join("scene.glb");
            write(&scene, &path).unwrap();
            let loaded = load::load(&path, &LoadOptions::default()).unwrap();
            assert!(loaded.warnings.is_empty(), "{:?}", loaded.warnings);
            let mut read = loaded.scene;
            if let Some(sky) = constant_sky(&scene) {
                assert_eq!(formula, Formula::Foliage);
                read.spawn((Environment::constant(Vec3::from_array(sky)),));
            }
            let seen = |scene: &mut Scene| {
                let mut renderer = Renderer::new();
                let report = renderer.sync(scene);
                assert!(report.warnings.is_empty(), "{:?}", report.warnings);
                let settings = RenderSettings { width: 32, height: 24, spp: Some(16), ..RenderSettings::default() };
                let rendered = renderer.render(&settings, &());
                (world_triangles(renderer.scene()), rendered.picture.rgb)
            };
            let ((triangles, picture), (again, its_picture)) = (seen(&mut scene), seen(&mut read));
            assert!(triangles.len() > 2500 && triangles == again);
            // The same rays, but for the rounding of the camera's matrix and what follows from it.
            let mean = |picture: &[[f32; 3]]| picture.iter().flatten().sum::<f32>() / (3 * picture.len()) as f32;
            let (mean, its_mean) = (mean(&picture), mean(&its_picture));
            assert!(mean > 0.01 && (its_mean / mean - 1.0).abs() < 0.05, "{mean} {its_mean}");
        }
    }

    /// The copy of a file is the file, but for a camera that looks from where it was told to.
    #[test]
    fn a_copy_has_one_camera_more() {
        let folder = tempfile::tempdir().unwrap();
        let read = |path: &Path| load::load(path, &LoadOptions::default()).unwrap();
        let from = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/gallery.glb");
        let (mut original, to) = (read(&from), folder.path().join("copy.glb"));
        crate::cli::scene::view("1,2,3,4,5,7").unwrap().take(&mut original.scene);
        copy(&from, &original.scene, &to).unwrap();
        let mut copied = read(&to);
        assert_eq!(copied.info.cameras.len(), original.info.cameras.len() + 1);
        copied.scene.active_camera = copied.scene.find(NAME);
        let [(triangles, view), (again, its_view)] = [&mut original.scene, &mut copied.scene].map(|scene| {
            let mut renderer = Renderer::new();
            renderer.sync(scene);
            (world_triangles(renderer.scene()), renderer.scene().camera)
        });
        assert!(triangles == again);
        assert!((view.origin - its_view.origin).length() < 1e-6 && view.forward.dot(its_view.forward) > 0.999_999);
        assert!((view.origin.x - 1.0).abs() < 1e-6);
        let json = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/cornell.gltf");
        assert!(matches!(copy(&json, &original.scene, &to), Err(CliError::Usage(_))));
    }
}
