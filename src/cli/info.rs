//! `wavecast info`: what is in a file, and what becomes of it.

use std::path::PathBuf;

use serde_json::{Map, Value, json};
use wavecast::{
    load::{self, ExtensionStatus, ExtensionUse, FileInfo, LoadOptions},
    render::Renderer,
};

use super::{Outcome, console::Console, error::CliError, memory, scene::camera_names, structure::AccelArgs};

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
    #[command(flatten)]
    accel: AccelArgs,
}

/// Loads the scene, builds its tables and tells about both.
pub fn run(args: &Args, console: &mut Console) -> Result<Outcome, CliError> {
    let accel = args.accel.kind()?;
    let mut loaded = load::load(&args.scene_file, &LoadOptions { scene: args.scene.as_deref().map(Into::into) })?;
    loaded.warnings.iter().for_each(|warning| console.warn(warning));
    let mut renderer = Renderer::new();
    renderer.accel = accel;
    let report = renderer.sync(&mut loaded.scene);
    report.warnings.iter().for_each(|warning| console.warn(warning));
    let flat = renderer.scene();
    let accel = args.accel.report(flat, report.build_time);
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
    let cameras = camera_names(&loaded.scene, &loaded.info.cameras);
    let (needs, skips) = (flat.needs.names(false), flat.needs.names(true));

    let mut text = format!("{}\n", args.scene_file.display());
    text.push_str(&file_text(&loaded.info));
    let names: Vec<_> = cameras.iter().enumerate().map(|(i, name)| format!("{i} {name:?}")).collect();
    text.push_str(&format!("cameras: {}\n", if names.is_empty() { "none".into() } else { names.join(", ") }));
    text.push_str("tables of the scene:\n");
    for (name, count) in counts {
        text.push_str(&format!("  {name}: {count}\n"));
    }
    text.push_str(&format!("needs: {}\n", list(&needs)));
    text.push_str(&format!("skips: {}\n", list(&skips)));
    if flat.lights.default_sky {
        text.push_str("no light: a uniform environment of 1 nit is used\n");
    }
    text.push_str(&format!("{}\n", accel.text()));
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
            "contents": file_info(&loaded.info),
            "cameras": cameras,
            "counts": counts.iter().map(|&(name, count)| (name.replace(' ', "_"), count.into())).collect::<Map<_, _>>(),
            "needs": needs,
            "skips": skips,
            "default_sky": flat.lights.default_sky,
            "accel": accel.json(),
            "memory_bytes": memory,
            "warnings": console.warnings(),
        })
    });
    Ok(Outcome::Done)
}

/// What the loader says of the file.
fn file_info(info: &FileInfo) -> Value {
    let extension = |extension: &ExtensionUse| {
        let (status, note) = match extension.status {
            ExtensionStatus::Read => ("read", None),
            ExtensionStatus::Approximated(note) => ("approximated", Some(note)),
            ExtensionStatus::Ignored(note) => ("ignored", Some(note)),
        };
        json!({ "name": extension.name, "required": extension.required, "status": status, "note": note })
    };
    let counts = &info.counts;
    json!({
        "gltf": info.version,
        "generator": info.generator,
        "scenes": info.scenes,
        "scene": info.scene,
        "counts": {
            "meshes": counts.meshes,
            "triangles": counts.triangles,
            "instanced_triangles": counts.instanced_triangles,
            "materials": counts.materials,
            "textures": counts.textures,
            "images": counts.images,
            "lights": counts.lights,
            "cameras": counts.cameras,
            "nodes": counts.nodes,
            "scenes": counts.scenes,
            "animations": counts.animations,
            "skins": counts.skins,
        },
        "extensions": info.extensions.iter().map(extension).collect::<Vec<_>>(),
    })
}

/// What becomes of the file, as a few lines for people.
fn file_text(info: &FileInfo) -> String {
    let counts = &info.counts;
    let mut text = format!(
        "  glTF {}, by {}\n  in the file: {} nodes, {} meshes, {} triangles, {} materials, {} textures, {} images, {} lights, \
         {} cameras, {} animations, {} skins\n",
        info.version,
        info.generator.as_deref().unwrap_or("an unnamed program"),
        counts.nodes,
        counts.meshes,
        counts.triangles,
        counts.materials,
        counts.textures,
        counts.images,
        counts.lights,
        counts.cameras,
        counts.animations,
        counts.skins,
    );
    if info.scenes.len() > 1 {
        let name =
            |(i, name): (usize, &String)| format!("{}{i} {name:?}", if info.scene == Some(i) { "*" } else { "" });
        let names: Vec<_> = info.scenes.iter().enumerate().map(name).collect();
        text.push_str(&format!("  scenes (* loaded): {}\n", names.join(", ")));
    }
    for extension in &info.extensions {
        let required = if extension.required { ", required" } else { "" };
        let status = match extension.status {
            ExtensionStatus::Read => "read".into(),
            ExtensionStatus::Approximated(note) => format!("approximated: {note}"),
            ExtensionStatus::Ignored(note) => format!("ignored: {note}"),
        };
        text.push_str(&format!("  {}{required}: {status}\n", extension.name));
    }
    text
}

fn list(names: &[&str]) -> String {
    if names.is_empty() { "nothing".into() } else { names.join(", ") }
}
