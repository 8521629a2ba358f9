//! `wavecast info`: what is in a file, and what becomes of it.

use std::path::PathBuf;

use serde_json::{Map, Value, json};
use wavecast::{
    load::{self, FileInfo, LoadOptions},
    render::Renderer,
    world::{Camera, Name, Scene},
};

use super::{Outcome, console::Console, error::CliError, memory};

/// Say what is in a scene, what is ignored or approximated, and what it needs and skips
#[derive(clap::Args)]
#[command(after_help = "Example:\n  wavecast info scenes/cornell.gltf --json")]
pub struct Args {
    /// The scene, .gltf or .glb
    #[arg(value_name = "SCENE")]
    scene_file: PathBuf,
    /// Scene by name or index [default: the file's]
    #[arg(long, value_name = "NAME|INDEX")]
    scene: Option<String>,
}

/// Loads the scene, builds its tables and tells about both.
pub fn run(args: &Args, console: &mut Console) -> Result<Outcome, CliError> {
    let mut loaded = load::load(&args.scene_file, &LoadOptions { scene: args.scene.clone() })?;
    loaded.warnings.iter().for_each(|warning| console.warn(warning));
    let mut renderer = Renderer::new();
    let report = renderer.sync(&mut loaded.scene);
    report.warnings.iter().for_each(|warning| console.warn(warning));
    let flat = renderer.scene();
    let tables = memory::tables(flat);
    let triangles = |mesh: &u32| flat.meshes.get(*mesh as usize).map_or(0, |mesh| mesh.triangles.len());
    let counts = [
        ("meshes", flat.meshes.len()),
        ("triangles", flat.meshes.iter().map(|mesh| mesh.triangles.len()).sum()),
        ("instances", flat.instances.len()),
        ("triangles with instances", flat.instances.mesh.iter().take(flat.instances.len()).map(triangles).sum()),
        ("materials", flat.materials.len()),
        ("images", flat.textures.images.len()),
        ("emissive triangles", flat.lights.triangles.len()),
        ("point and spot lights", flat.lights.local.len()),
        ("directional lights", flat.lights.distant.len()),
    ];
    let file = file_info(&loaded.info);
    let cameras = camera_names(&loaded.scene);
    let (needs, skips) = (flat.needs.names(false), flat.needs.names(true));

    let mut text = format!("{}\n", args.scene_file.display());
    describe(&mut text, 1, &file);
    text.push_str(&format!("  cameras: {}\n", if cameras.is_empty() { "none".into() } else { cameras.join(", ") }));
    for (name, count) in counts {
        text.push_str(&format!("  {name}: {count}\n"));
    }
    text.push_str(&format!("needs: {}\n", list(&needs)));
    text.push_str(&format!("skips: {}\n", list(&skips)));
    if flat.lights.default_sky {
        text.push_str("no light: a uniform environment of 1 nit is used\n");
    }
    text.push_str("memory of tables:\n");
    for &(name, bytes) in tables.iter().filter(|(_, bytes)| *bytes > 0) {
        text.push_str(&format!("  {name}: {}\n", memory::human(bytes)));
    }
    let total = tables.iter().map(|(_, bytes)| bytes).sum();
    text.push_str(&format!("  total: {}\n", memory::human(total)));

    console.result(&text, || {
        let mut memory: Map<_, _> = tables.iter().map(|&(name, bytes)| (name.to_owned(), bytes.into())).collect();
        memory.insert("total".into(), total.into());
        json!({
            "file": args.scene_file.display().to_string(),
            "contents": file,
            "cameras": cameras,
            "counts": counts.iter().map(|&(name, count)| (name.replace(' ', "_"), count.into())).collect::<Map<_, _>>(),
            "needs": needs,
            "skips": skips,
            "default_sky": flat.lights.default_sky,
            "memory_bytes": memory,
            "warnings": console.warnings(),
        })
    });
    Ok(Outcome::Done)
}

/// What the loader says of the file.
fn file_info(_info: &FileInfo) -> Value {
    json!({})
}

/// Names of the cameras in the order of their indices.
fn camera_names(scene: &Scene) -> Vec<String> {
    let name = |key| scene.get::<Name>(key).map_or_else(|| "(no name)".into(), |name| name.0.to_string());
    scene.keys_with::<Camera>().into_iter().map(name).collect()
}

fn list(names: &[&str]) -> String {
    if names.is_empty() { "nothing".into() } else { names.join(", ") }
}

/// JSON as indented text.
fn describe(text: &mut String, indent: usize, value: &Value) {
    let pad = "  ".repeat(indent);
    let Value::Object(fields) = value else { return };
    for (key, value) in fields {
        match value {
            Value::Null => {}
            Value::Array(items) if items.is_empty() => text.push_str(&format!("{pad}{key}: none\n")),
            Value::Array(items) => {
                text.push_str(&format!("{pad}{key}:\n"));
                for item in items {
                    text.push_str(&format!("{pad}  {}\n", plain(item)));
                }
            }
            Value::Object(_) => {
                text.push_str(&format!("{pad}{key}:\n"));
                describe(text, indent + 1, value);
            }
            _ => text.push_str(&format!("{pad}{key}: {}\n", plain(value))),
        }
    }
}

fn plain(value: &Value) -> String {
    match value {
        Value::String(text) => text.clone(),
        Value::Object(fields) => {
            let parts: Vec<_> =
                fields.iter().filter(|(_, v)| !v.is_null()).map(|(k, v)| format!("{k} {}", plain(v))).collect();
            parts.join(", ")
        }
        other => other.to_string(),
    }
}
