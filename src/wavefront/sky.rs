//! Adds the light of the environment for paths that met nothing.

use super::{emit::add, queues::PathQueue, tally::Tally};
use crate::{
    flat::{EnvironmentLight, FlatScene},
    sampling::mis,
};

/// Radiance of the sky along a ray that left with density `pdf`, weighted against light sampling.
#[inline]
pub fn seen(scene: &FlatScene, sky: &EnvironmentLight, direction: [f32; 3], pdf: f32) -> ([f32; 3], f32) {
    match sky {
        EnvironmentLight::Constant(radiance) => (*radiance, 1.0),
        EnvironmentLight::Map(map) => {
            let (radiance, density) = map.look_up(direction);
            let choice = &scene.lights.choice;
            if pdf == 0.0 || choice.is_empty() {
                (radiance, 1.0)
            } else {
                (radiance, mis::power(pdf, density * choice.pmf(scene.lights.environment_row())))
            }
        }
    }
}

/// Adds what the paths in `rows` see of the sky; with `hidden`, camera rays see nothing of it.
pub fn sky(
    scene: &FlatScene,
    sky: &EnvironmentLight,
    rows: &[u32],
    hidden: bool,
    paths: &PathQueue,
    tally: &mut Tally,
) {
    for &row in rows {
        let i = row as usize;
        if hidden && paths.depth[i] == 0 {
            continue;
        }
        let direction = [paths.dx[i], paths.dy[i], paths.dz[i]];
        let (radiance, weight) = seen(scene, sky, direction, paths.pdf[i]);
        add(tally, paths, i, radiance, weight);
    }
}
