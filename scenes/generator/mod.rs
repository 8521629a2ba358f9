//! The scenes as code: each module gives one [`Document`](document::Document), [`files`] their bytes.
//!
//! The bytes depend on this code, the locked version of the PNG encoder and the last bits of the
//! platform's sines and powers. Randomness is a hash of a counter.

mod alpha;
mod cornell;
mod document;
mod emitters;
mod gallery;
mod images;
mod instances;
mod material;
mod noise;
mod punctual;
mod shape;
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
}

/// All scenes of the folder.
pub fn files() -> Vec<File> {
    let file = |name: &'static str, scene: Document| {
        let counts = scene.counts();
        let bytes = if name.ends_with(".glb") { scene.into_glb() } else { scene.into_gltf() };
        File { name, bytes, counts }
    };
    vec![
        file("cornell.gltf", cornell::scene()),
        file("gallery.glb", gallery::scene()),
        file("window.gltf", window::scene()),
        file("punctual.gltf", punctual::scene()),
        file("instances.glb", instances::scene()),
        file("emitters.gltf", emitters::scene()),
        file("alpha.gltf", alpha::scene()),
    ]
}
