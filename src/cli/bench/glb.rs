//! Generated scenes as files, for other programs and for older versions of this one.

use std::{fs, io::Write as _, path::Path};

use serde_json::{Value, json};
use wavecast::{
    film::write_file,
    glam::Vec3,
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

/// Writes each generated scene as a .glb into a folder.
pub fn run(folder: &Path, args: &Args, console: &mut Console) -> Result<Outcome, CliError> {
    fs::create_dir_all(folder).map_err(|source| CliError::Output { path: folder.into(), source })?;
    let mut files = Vec::new();
    for source in &args.scenes {
        if let Source::File(path) = source {
            return Err(CliError::Usage(format!("{} is a file already (--write-scenes)", path.display())));
        }
        let mut scene = source.scene(console)?;
        if let Some(view) = args.view {
            view.take(&mut scene);
        }
        let path = folder.join(Subject::file_name(&source.to_string())).with_extension("glb");
        let triangles = write(&scene, &path)?;
        console.part(&format!("{}: {triangles} triangles", path.display()));
        let sky = sky(&scene);
        if let Some([r, g, b]) = sky {
            console.note(format!("glTF has no sky: render it with --env {r},{g},{b}"));
        }
        files.push(json!({ "file": path, "triangles": triangles, "sky": sky }));
    }
    console.end(|| json!({ "files": files }));
    Ok(Outcome::Done)
}

/// The radiance of a constant sky, nit.
fn sky(scene: &Scene) -> Option<[f32; 3]> {
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

    /// Something shown by a material that does not depend on textures; returns its triangles.
    fn show(&mut self, scene: &Scene, key: SceneKey, Geometry(mesh): &Geometry) -> usize {
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
        mesh.triangles.len()
    }

    /// The chunks of a .glb.
    fn chunks(self) -> (Vec<u8>, Vec<u8>) {
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
        let mut text = document.to_string().into_bytes();
        text.resize(text.len().next_multiple_of(4), b' ');
        bytes.resize(bytes.len().next_multiple_of(4), 0);
        (text, bytes)
    }
}

/// A node's place.
fn matrix(scene: &Scene, key: SceneKey) -> [f64; 16] {
    let place = scene.get(key).unwrap_or(LocalTransform::IDENTITY).to_affine();
    let [x, y, z, at] = [place.matrix3.x_axis, place.matrix3.y_axis, place.matrix3.z_axis, place.translation];
    [x.x, x.y, x.z, 0.0, y.x, y.y, y.z, 0.0, z.x, z.y, z.z, 0.0, at.x, at.y, at.z, 1.0]
}

/// Writes what generated scenes have: meshes of one plain material that stand where they are, lamps, suns, the camera;
/// a sky cannot be. Returns the number of triangles.
fn write(scene: &Scene, path: &Path) -> Result<usize, CliError> {
    let mut document = Document::default();
    let mut triangles = 0;
    for key in scene.keys_with::<Geometry>() {
        if let Some(geometry) = scene.get(key) {
            triangles += document.show(scene, key, &geometry);
        }
    }
    for key in scene.keys_with::<DirectionalLight>() {
        let Some(DirectionalLight { color, illuminance }) = scene.get(key) else { continue };
        let light = json!({ "light": document.lights.len() });
        document.nodes.push(json!({ "matrix": matrix(scene, key), "extensions": { "KHR_lights_punctual": light } }));
        let color = color.to_array();
        document.lights.push(json!({ "type": "directional", "color": color, "intensity": illuminance.0 }));
    }
    let camera = scene.active_camera.or_else(|| scene.keys_with::<Camera>().first().copied());
    if let Some((key, camera)) = camera.and_then(|key| Some((key, scene.get::<Camera>(key)?)))
        && let Projection::Perspective { yfov, .. } = camera.projection
    {
        document.nodes.push(json!({ "camera": 0, "matrix": matrix(scene, key) }));
        let perspective = json!({ "yfov": yfov, "znear": camera.znear.max(NEAREST) });
        document.cameras.push(json!({ "type": "perspective", "perspective": perspective }));
    }
    let (text, bytes) = document.chunks();
    let whole = 12 + 8 + text.len() + 8 + bytes.len();
    let length = |length: usize| {
        let too_large = || CliError::Usage(format!("{}: a .glb cannot be larger than 4 GiB", path.display()));
        u32::try_from(length).map(u32::to_le_bytes).map_err(|_| too_large())
    };
    let (whole, text_length, bytes_length) = (length(whole)?, length(text.len())?, length(bytes.len())?);
    write_file(path, |file| {
        for part in [b"glTF".as_slice(), &2_u32.to_le_bytes(), &whole] {
            file.write_all(part)?;
        }
        for part in [&text_length, b"JSON".as_slice(), &text, &bytes_length, b"BIN\0", &bytes] {
            file.write_all(part)?;
        }
        Ok(())
    })?;
    Ok(triangles)
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
            let count = write(&scene, &path).unwrap();
            let loaded = load::load(&path, &LoadOptions::default()).unwrap();
            assert!(loaded.warnings.is_empty(), "{:?}", loaded.warnings);
            let mut read = loaded.scene;
            if let Some(sky) = sky(&scene) {
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
            assert_eq!(triangles.len(), count);
            assert!(triangles == again);
            // The same rays, but for the rounding of the camera's matrix and what follows from it.
            let mean = |picture: &[[f32; 3]]| picture.iter().flatten().sum::<f32>() / (3 * picture.len()) as f32;
            let (mean, its_mean) = (mean(&picture), mean(&its_picture));
            assert!(mean > 0.01 && (its_mean / mean - 1.0).abs() < 0.05, "{mean} {its_mean}");
        }
    }
}
