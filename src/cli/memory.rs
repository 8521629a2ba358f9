//! How much memory the tables of a scene take, and how much there is.

use std::mem::size_of_val;

use wavecast::{
    flat::{
        DistantLights, EmissiveShapes, EmissiveTriangles, EnvironmentLight, FlatMesh, FlatScene, ImageTexels,
        Instances, LocalLights, Materials, TextureSlots,
    },
    render::{RenderSettings, Renderer},
};

use super::error::CliError;

/// Bytes that the system has to give, where it says; else what most machines have.
fn available() -> u64 {
    const USUAL: u64 = 16 << 30;
    let Ok(text) = std::fs::read_to_string("/proc/meminfo") else { return USUAL };
    let line = text.lines().find_map(|line| line.strip_prefix("MemAvailable:"));
    let kibibytes = line.and_then(|line| line.trim().strip_suffix("kB")?.trim().parse::<u64>().ok());
    kibibytes.map_or(USUAL, |kibibytes| kibibytes * 1024)
}

/// Refuses layers of light in parts that do not fit.
pub fn check_parts(renderer: &Renderer, settings: &RenderSettings) -> Result<(), CliError> {
    let needed = renderer.bytes_of_parts(settings).map_err(|error| CliError::Usage(error.to_string()))?;
    let there = available();
    if needed <= there {
        return Ok(());
    }
    let gigabytes = |bytes: u64| bytes as f64 / f64::from(1 << 30);
    Err(CliError::Usage(format!(
        "light in so many parts takes {:.1} GiB at {} × {} pixels, and {:.1} GiB are free; ask for fewer layers or a smaller --size",
        gigabytes(needed),
        settings.width,
        settings.height,
        gigabytes(there)
    )))
}

/// Bytes by table, in the order of [`FlatScene`].
pub fn tables(scene: &FlatScene) -> Vec<(&'static str, usize)> {
    let images = scene.textures.images.iter().map(|image| match &image.texels {
        ImageTexels::Rgba8(texels) => size_of_val(&texels[..]),
        ImageTexels::Rgba16(texels) => size_of_val(&texels[..]),
    });
    let lights = &scene.lights;
    let environment = match &lights.environment {
        Some(EnvironmentLight::Map(map)) => {
            size_of_val(&map.texels[..])
                + size_of_val(&map.choice.pmf[..])
                + size_of_val(&map.choice.threshold[..])
                + size_of_val(&map.choice.alias[..])
        }
        _ => 0,
    };
    vec![
        ("meshes", scene.meshes.iter().map(|mesh| mesh_bytes(mesh)).sum()),
        (
            "instances",
            scene.instances.len() * Instances::ROW_BYTES
                + size_of_val(&scene.material_rows[..])
                + size_of_val(&scene.light_rows[..]),
        ),
        ("materials", scene.materials.len() * Materials::ROW_BYTES),
        ("textures", images.sum::<usize>() + scene.textures.slots.len() * TextureSlots::ROW_BYTES),
        (
            "lights",
            lights.triangles.len() * EmissiveTriangles::ROW_BYTES
                + size_of_val(&lights.facets[..])
                + lights.shapes.len() * EmissiveShapes::ROW_BYTES
                + lights.local.len() * LocalLights::ROW_BYTES
                + lights.distant.len() * DistantLights::ROW_BYTES,
        ),
        ("environment", environment),
        ("trees of meshes", scene.meshes.iter().map(|mesh| mesh.blas.bytes()).sum()),
        ("tree of instances", scene.accel.bytes()),
    ]
}

fn mesh_bytes(mesh: &FlatMesh) -> usize {
    size_of_val(&mesh.positions[..])
        + size_of_val(&mesh.triangles[..])
        + size_of_val(&mesh.normals[..])
        + size_of_val(&mesh.tangents[..])
        + mesh.uvs.iter().map(|uvs| size_of_val(&uvs[..])).sum::<usize>()
        + size_of_val(&mesh.colors[..])
        + size_of_val(&mesh.slots[..])
}

/// Bytes as people read them.
pub fn human(bytes: usize) -> String {
    const UNITS: [&str; 4] = ["KiB", "MiB", "GiB", "TiB"];
    let mut value = bytes as f64;
    let mut unit = "B";
    for larger in UNITS {
        if value < 1024.0 {
            break;
        }
        value /= 1024.0;
        unit = larger;
    }
    if unit == "B" { format!("{bytes} B") } else { format!("{value:.1} {unit}") }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bytes_are_written_as_people_read_them() {
        assert_eq!(human(0), "0 B");
        assert_eq!(human(1023), "1023 B");
        assert_eq!(human(1536), "1.5 KiB");
        assert_eq!(human(3 << 30), "3.0 GiB");
    }

    /// Two positions of 12 bytes, one triangle of 12; nothing else has any rows.
    #[test]
    fn tables_count_their_columns() {
        let mesh = FlatMesh { positions: vec![[0.0; 3]; 2], triangles: vec![[0; 3]], ..FlatMesh::default() };
        let scene = FlatScene { meshes: vec![mesh.into()], ..FlatScene::default() };
        assert_eq!(tables(&scene)[0], ("meshes", 36));
        assert_eq!(tables(&scene).iter().map(|(_, bytes)| bytes).sum::<usize>(), 36);
    }
}
