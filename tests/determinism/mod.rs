//! The same scene, settings and seed give the same bits, however the work is cut.

use wavecast::render::{RenderSettings, Renderer, SamplerKind, Sharing};

use crate::common::{settings, varied};

/// 1, 2 and 7 threads; tiles of 5, 32 and 200 pixels; waves of 1, 8, 100 and 5000 paths: one picture.
#[test]
fn threads_tiles_and_waves_do_not_change_a_bit() {
    let mut renderer = Renderer::new();
    renderer.sync(&mut varied());
    let base = RenderSettings { sharing: Sharing::Always, ..settings(48, 6) };
    let want = renderer.render(&base, &()).picture;
    assert!(want.rgb.iter().any(|rgb| rgb[0] > 0.0));
    let variants = [
        RenderSettings { threads: 1, ..base.clone() },
        RenderSettings { threads: 2, ..base.clone() },
        RenderSettings { threads: 7, ..base.clone() },
        RenderSettings { tile_size: 5, ..base.clone() },
        RenderSettings { tile_size: 200, ..base.clone() },
        RenderSettings { wave_size: 1, ..base.clone() },
        RenderSettings { wave_size: 8, ..base.clone() },
        RenderSettings { wave_size: 100, threads: 7, tile_size: 7, ..base.clone() },
        RenderSettings { wave_size: 5000, ..base.clone() },
        RenderSettings { sort: false, ..base.clone() },
    ];
    for variant in variants {
        let got = renderer.render(&variant, &()).picture;
        assert!(got == want, "threads {}, tile {}, wave {}", variant.threads, variant.tile_size, variant.wave_size);
    }
}

/// Two renderers that load and build on their own, with trees that may differ, still agree.
#[test]
fn a_fresh_renderer_makes_the_same_picture() {
    let base = settings(32, 4);
    let pictures: Vec<_> = (0..3)
        .map(|_| {
            let mut renderer = Renderer::new();
            renderer.sync(&mut varied());
            renderer.render(&base, &()).picture
        })
        .collect();
    assert!(pictures.windows(2).all(|pair| pair[0] == pair[1]));
}

/// Samples 0..8 are those of a run of 8; a crop is a part of the whole; another seed is another picture.
#[test]
fn a_pixel_does_not_know_what_else_is_rendered() {
    let mut renderer = Renderer::new();
    renderer.sync(&mut varied());
    let base = RenderSettings { sharing: Sharing::Always, ..settings(40, 8) };
    let whole = renderer.render(&base, &()).picture;
    let range = RenderSettings { spp: None, samples: Some(0..8), ..base.clone() };
    assert!(renderer.render(&range, &()).picture == whole);
    // In the middle of blocks of eight pixels, a pixel, a block, and the last corner, which is no whole block.
    for (crop, tile_size) in [([13, 7, 20, 11], 32), ([17, 3, 1, 1], 1), ([8, 16, 8, 8], 9), ([33, 29, 4, 8], 16)] {
        let part = RenderSettings { width: 37, height: 37, tile_size, ..base.clone() };
        let whole = renderer.render(&part, &()).picture;
        let [x, y, w, h] = crop.map(|length| length as usize);
        let crop = renderer.render(&RenderSettings { crop: Some(crop), ..part }, &()).picture;
        assert_eq!((crop.width, crop.height), (w, h));
        for row in 0..h {
            let start = (y + row) * 37 + x;
            assert_eq!(whole.rgb[start..start + w], crop.rgb[row * w..(row + 1) * w], "{w} x {h}, row {row}");
        }
    }
    for other in [
        RenderSettings { seed: 1, ..base.clone() },
        RenderSettings { sampler: SamplerKind::Independent, ..base.clone() },
    ] {
        assert!(renderer.render(&other, &()).picture.rgb != whole.rgb);
    }
}

/// Asking for layers or coverage changes no bit of the light.
#[test]
fn layers_leave_the_beauty_picture_alone() {
    use wavecast::render::LayerKind::{Albedo, Depth, EntityId, Error, MaterialId, Normal, Position, SampleCount, Uv};
    let mut renderer = Renderer::new();
    renderer.sync(&mut varied());
    let base = settings(24, 4);
    let plain = renderer.render(&base, &()).picture;
    let layers = vec![Albedo, Normal, Depth, Position, Uv, EntityId, MaterialId, SampleCount, Error];
    let with = renderer.render(&RenderSettings { layers, ..base }, &()).picture;
    assert_eq!(plain.rgb, with.rgb);
    assert_eq!(with.layers.len(), 9);
}

/// Light between two facing perfect mirrors, and inside a ball of white glass seen from within, never fades; the
/// render still ends.
#[test]
fn trapped_light_does_not_hang_the_render() {
    use glam::{DVec3, Vec3};
    use wavecast::world::{Material, Scene, TriMesh};
    let mut scene = Scene::new();
    let mirror = Material { roughness: 0.0, double_sided: true, ..Material::default() };
    crate::common::show(&mut scene, TriMesh::cuboid(Vec3::splat(-1.0), Vec3::ONE), mirror);
    crate::common::show(&mut scene, TriMesh::cuboid(Vec3::splat(-0.2), Vec3::splat(0.2)), Material::glass(2.0));
    crate::common::look(&mut scene, DVec3::new(0.0, 0.3, 0.9), DVec3::ZERO, 60.0);
    let rendered = crate::common::picture(&mut scene, &settings(16, 4));
    assert!(rendered.stats.rays.bounce > 16 * 16 * 4 * 20, "the paths are long: {:?}", rendered.stats.rays);
}

/// Samples that go where the error is go there whatever the threads, tiles and waves; a limit of samples per pixel is the
/// mean's, and is not passed.
#[test]
fn pictures_of_a_given_error_do_not_depend_on_how_the_work_is_cut() {
    use wavecast::film::LayerData;
    let mut renderer = Renderer::new();
    renderer.sync(&mut varied());
    let layers = vec![wavecast::render::LayerKind::SampleCount];
    let base = RenderSettings { error: Some(0.02), layers, threads: 1, ..settings(37, 64) };
    let want = renderer.render(&base, &());
    assert!(want.stats.error.is_some_and(|error| error.upper95 > error.relmse), "{:?}", want.stats.error);
    let LayerData::Id(counts) = &want.picture.layers[0].data else { panic!("counts are whole numbers") };
    let (least, most) = (counts.iter().min().unwrap(), counts.iter().max().unwrap());
    assert!(most > &(2 * least), "some blocks are easier than others: {least} to {most}");
    for variant in [
        RenderSettings { threads: 2, ..base.clone() },
        RenderSettings { threads: 7, tile_size: 64, wave_size: 100, ..base.clone() },
    ] {
        let got = renderer.render(&variant, &());
        assert!(got.picture == want.picture && got.stats.error == want.stats.error, "threads {}", variant.threads);
    }
    for most in [1, 3, 30] {
        let stats = renderer.render(&RenderSettings { error: Some(0.01), spp: Some(most), ..base.clone() }, &()).stats;
        let spp = stats.spp;
        assert!(spp <= f64::from(most) && spp >= 0.8 * f64::from(most), "{spp} of {most}");
    }
}
