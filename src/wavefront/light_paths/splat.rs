//! Light seen at a place of the film goes to the pixels around it, by their filter.

use super::queues::Sight;
use crate::{
    film::{Label, Splat, Splats},
    sampling::FilterDensity,
};

/// Adds what all pixels of the rendered part get of a sight.
#[inline]
pub fn splat(filter: &FilterDensity, film: &Splats, sight: &Sight, label: Label, splats: &mut Vec<Splat>) {
    let reach = filter.radius;
    let light = [sight.light_r, sight.light_g, sight.light_b];
    if reach <= 0.5 {
        // Pixels that share no light; at an edge, rounding must not give it to two.
        if let Some((tile, slot)) = film.place(sight.x.floor() as i32, sight.y.floor() as i32) {
            splats.push(Splat { tile, slot, light, label });
        }
        return;
    }
    let pixels = |x: f32| (x - reach - 0.5).ceil() as i32..=(x + reach - 0.5).floor() as i32;
    for y in pixels(sight.y) {
        let down = filter.at(y as f32 + 0.5 - sight.y);
        for x in pixels(sight.x) {
            let weight = down * filter.at(x as f32 + 0.5 - sight.x);
            if weight > 0.0
                && let Some((tile, slot)) = film.place(x, y)
            {
                splats.push(Splat { tile, slot, light: light.map(|c| c * weight), label });
            }
        }
    }
}
