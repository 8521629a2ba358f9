//! What pixels share leaves the expectation of each as it is.

use std::path::Path;

use rayon::prelude::*;
use wavecast::{
    measure::{
        statistics::sidak,
        student::{Estimate, student_two_sided},
    },
    render::{RenderSettings, Renderer, Sharing},
};

use crate::common::{load_scene, root, settings, trials::scaled};

/// Edge of the pictures and of the blocks whose means are compared, pixels.
const SIZE: u32 = 64;
const BLOCK: u32 = 8;
/// Pictures of each kind.
const SEEDS: u64 = 16;
/// A right renderer fails a check with this probability.
const FALSE_ALARM: f64 = 1e-4;

/// Means of the blocks of each seed's picture, without pixels that see a lamp, whose edges would hide everything.
fn blocks(renderer: &Renderer, sharing: Sharing, spp: u32, dim: &[bool]) -> Vec<Vec<f64>> {
    let render = |seed: u64| {
        let settings = RenderSettings { sharing, seed, threads: 1, ..settings(SIZE, spp) };
        let picture = renderer.render(&settings, &()).picture.rgb;
        let across = SIZE / BLOCK;
        (0..across * across)
            .map(|block| {
                let (x, y) = (block % across * BLOCK, block / across * BLOCK);
                let pixels = (0..BLOCK * BLOCK).map(|i| ((y + i / BLOCK) * SIZE + x + i % BLOCK) as usize);
                let values = pixels.filter(|&pixel| dim[pixel]).map(|pixel| picture[pixel].map(f64::from));
                values.flatten().sum::<f64>() / f64::from(3 * BLOCK * BLOCK)
            })
            .collect()
    };
    (0..SEEDS).into_par_iter().map(render).collect()
}

/// Holds the means of blocks with everything shared against those with nothing shared.
#[track_caller]
fn check(scene: &Path, spp: u32) {
    let mut renderer = Renderer::new();
    renderer.sync(&mut load_scene(scene));
    let long = RenderSettings { sharing: Sharing::Off, seed: 1000, ..settings(SIZE, 256) };
    let dim: Vec<bool> =
        renderer.render(&long, &()).picture.rgb.iter().map(|rgb| rgb.iter().all(|&c| c < 1.0)).collect();
    let spp = scaled(spp);
    let [shared, apart] = [Sharing::Always, Sharing::Off].map(|sharing| blocks(&renderer, sharing, spp, &dim));
    let count = shared[0].len();
    let level = sidak(FALSE_ALARM, count);
    let (mut failed, mut worst, mut sums) = (Vec::new(), 1.0_f64, [0.0; 2]);
    for block in 0..count {
        let of = |pictures: &[Vec<f64>]| Estimate::of(pictures.iter().map(|blocks| blocks[block]));
        let [a, b] = [of(&shared), of(&apart)];
        let off = a.minus(b);
        sums[0] += a.value;
        sums[1] += b.value;
        if off.variance > 0.0 {
            let p = student_two_sided(off.value / off.variance.sqrt(), off.dof);
            worst = worst.min(p);
            if p < level {
                failed.push((block, a.value, b.value, p));
            }
        }
    }
    println!("{}: means {:?}, least p {worst:.1e} of {count}", scene.display(), sums.map(|sum| sum / count as f64));
    assert!(failed.is_empty(), "{}: block, shared, not shared, p: {failed:?}", scene.display());
}

/// A lamp that reflects nothing hangs among what does.
#[test]
fn blocks_beside_a_black_lamp_are_as_bright_as_without_sharing() {
    check(&root().join("scenes/cornell.gltf"), 32);
}

#[test]
fn blocks_are_as_bright_as_without_sharing() {
    for scene in ["lights.glb", "caustic.glb", "gallery.glb", "million.glb"] {
        check(&root().join("scenes").join(scene), 16);
    }
}
