//! One path at a time: the same kernels with one lane and no queues, as a measure of what the wavefront gains.

use crate::{
    flat::FlatScene,
    render::{Observer, RenderSettings, Rendered},
};

/// Makes the picture of [`render`](super::render) one path at a time. For benchmarks and tests.
pub fn render_one_path(scene: &FlatScene, settings: &RenderSettings, observer: &dyn Observer) -> Rendered {
    super::schedule::render(scene, settings, observer)
}
