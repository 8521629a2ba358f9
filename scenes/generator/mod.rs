//! The scenes as code: each module gives one [`Document`](document::Document) or a sky, [`files`] their bytes.
//!
//! The bytes depend on this code, the locked versions of the encoders of PNG and HDR and the last bits of the
//! platform's sines and powers. Randomness is a hash of a counter.

mod alpha;
mod caustic;
mod cornell;
mod document;
mod door;
mod emitters;
mod gallery;
mod images;
mod instances;
mod kajiya;
mod led;
mod lights;
mod material;
mod million;
mod noise;
mod outdoor;
mod plates;
mod punctual;
mod seasons;
mod shape;
mod sky;
mod window;

use document::Document;

/// A scene file as it is on disk.
pub struct File {
    /// Name within the folder.
    pub name: &'static str,
    /// All of its content.
    pub bytes: Vec<u8>,
    /// Its size in words, for people.
    pub counts: String,
    /// What `--env` has to say for a scene whose light is not in the file.
    pub env: Option<&'static str>,
}

/// All scenes of the folder.
pub fn files() -> Vec<File> {
    let file = |name: &'static str, scene: Document| {
        let counts = scene.counts();
        let bytes = if name.ends_with(".glb") { scene.into_glb() } else { scene.into_gltf() };
        File { name, bytes, counts, env: None }
    };
    let under = |env: &'static str, file: File| File { env: Some(env), ..file };
    vec![
        file("cornell.gltf", cornell::scene()),
        file("gallery.glb", gallery::scene()),
        file("window.gltf", window::scene()),
        file("punctual.gltf", punctual::scene()),
        file("instances.glb", instances::scene()),
        file("emitters.gltf", emitters::scene()),
        file("alpha.gltf", alpha::scene()),
        file("plates.gltf", plates::scene()),
        file("caustic.glb", caustic::scene()),
        file("lights.glb", lights::scene()),
        under("sky.hdr", file("outdoor.gltf", outdoor::scene())),
        file("door.gltf", door::scene()),
        under("0.6,0.8,1", file("million.glb", million::scene())),
        file("led.glb", led::scene()),
        file("seasons.glb", seasons::scene()),
        file("kajiya.glb", kajiya::scene()),
        File { name: "sky.hdr", bytes: sky::file(), counts: String::from("512 × 256 texels"), env: None },
    ]
}
