//! Scene to FlatScene.

/// The change trackers of a scene.
#[derive(Default)]
pub struct Watches;
