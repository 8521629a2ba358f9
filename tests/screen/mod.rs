//! How errors lie over the screen.

use wavecast::render::{RenderSettings, Renderer, SamplerKind, Sharing};

use crate::common::{load_scene, root, settings};

const SIZE: u32 = 128;
/// Edge of the blocks whose mean errors are looked at, pixels.
const BLOCK: usize = 4;

/// Relative errors of the pictures' green: their mean square, and that of the means over blocks, as a share of what it would be if
/// pixels erred independently of one another.
fn errors(renderer: &Renderer, sampler: SamplerKind, spp: u32, truth: &[[f32; 3]]) -> [f64; 2] {
    let (mut alone, mut together, seeds) = (0.0, 0.0, 4);
    for seed in 0..seeds {
        let settings =
            RenderSettings { sampler, seed, max_depth: Some(1), sharing: Sharing::Off, ..settings(SIZE, spp) };
        let picture = renderer.render(&settings, &()).picture;
        let error = |pixel: usize| {
            let [got, want] = [picture.rgb[pixel][1], truth[pixel][1]].map(f64::from);
            // Edges of the lamp would outweigh all else.
            if (0.01..2.0).contains(&want) { got / want - 1.0 } else { 0.0 }
        };
        let (edge, count) = (SIZE as usize, (SIZE * SIZE) as usize);
        alone += (0..count).map(|pixel| error(pixel).powi(2)).sum::<f64>() / count as f64;
        for block in 0..count / (BLOCK * BLOCK) {
            let (x, y) = (block % (edge / BLOCK) * BLOCK, block / (edge / BLOCK) * BLOCK);
            let places = (0..BLOCK * BLOCK).map(|i| (y + i / BLOCK) * edge + x + i % BLOCK);
            let sum: f64 = places.map(error).sum();
            together += sum * sum / count as f64;
        }
    }
    [alone / seeds as f64, together / alone]
}

/// Pixels that touch err in opposite directions, so that blocks of them err by much less than they otherwise would, the more so the fewer
/// samples there are, and each pixel by as much as otherwise.
#[test]
fn blue_noise_leaves_neighbouring_pixels_to_make_up_for_one_another() {
    let mut renderer = Renderer::new();
    renderer.sync(&mut load_scene(&root().join("scenes/cornell.gltf")));
    let long = RenderSettings { max_depth: Some(1), seed: 77, ..settings(SIZE, 1024) };
    let truth = renderer.render(&long, &()).picture.rgb;
    for (spp, most) in [(1, 0.5), (4, 0.75)] {
        let [plain, white] = errors(&renderer, SamplerKind::Sobol, spp, &truth);
        let [ordered, blue] = errors(&renderer, SamplerKind::BlueNoise, spp, &truth);
        println!("{spp} samples: errors {plain:.3e} and {ordered:.3e}, of blocks {white:.3} and {blue:.3}");
        assert!((0.8..1.25).contains(&white), "errors of pixels with sequences of their own are independent: {white}");
        assert!(blue < most * white, "{spp} samples: {blue} of {white}");
        assert!((0.8..1.25).contains(&(ordered / plain)), "{spp} samples: {ordered} of {plain}");
    }
}
