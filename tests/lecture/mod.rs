//! What `docs/light.md` says, with the scenes that it says it of.

use glam::DVec3;
use wavecast::{
    film::LayerData,
    measure::{
        brdf::brdf,
        far_field::far_field,
        flux::flux,
        glare::glare,
        meter::{Effort, Meters, Reading, read},
        student::Estimate,
    },
    reference::{self, ReferenceSettings, Technique},
    render::{Integrator, LayerKind, PixelFilter, RenderSettings, Renderer, SamplerKind, Sharing},
    world::{Geometry, Material, MaterialSlots, Name, PointLight, Scene, SceneKey},
};

use crate::common::{load_scene, mean, root, settings, trials::scaled};

fn tables(file: &str) -> (Scene, Renderer) {
    let mut scene = load_scene(&root().join("scenes").join(file));
    let mut renderer = Renderer::new();
    let report = renderer.sync(&mut scene);
    assert!(report.warnings.is_empty(), "{:?}", report.warnings);
    (scene, renderer)
}

fn lux(renderer: &Renderer, p: DVec3, n: DVec3, max_depth: Option<u32>, samples: u64) -> Reading {
    let effort = Effort { error: None, samples: Some(samples), max_depth, ..Effort::default() };
    read(renderer.scene(), &Meters::Planes(vec![(p, n)]), &effort, &()).mean
}

/// What is shown under a name.
#[track_caller]
fn shown(scene: &Scene, name: &str) -> SceneKey {
    let has_it = |key: &SceneKey| scene.get::<Name>(*key).is_some_and(|of| &*of.0 == name);
    scene.keys_with::<Geometry>().into_iter().find(has_it).expect("it is there")
}

#[track_caller]
fn check(what: &str, got: f64, want: f64) {
    println!("{what}: {got:.4}, {want:.4}");
    assert!((got / want - 1.0).abs() < 1e-3, "{what}: {got} {want}");
}

/// 815 lm make 64.86 cd, 64.86 lx at 1 m, a quarter of that at 2 m, half of it where a plane is turned away by 60°.
#[test]
fn the_lamp_of_815_lumens() {
    let (scene, renderer) = tables("led.glb");
    let led = scene.keys_with::<PointLight>()[0];
    check("flux", flux(renderer.scene(), led.0).expect("a lamp").value.value, 815.0);
    check("intensity", f64::from(scene.get::<PointLight>(led).expect("a lamp").intensity.0), 64.8556);
    let direct = |p: DVec3, n: DVec3| lux(&renderer, p, n, Some(0), 1024).value.value;
    check("1 m", direct(DVec3::Y, -DVec3::Y), 64.86);
    check("2 m", direct(2.0 * DVec3::Y, -DVec3::Y), 16.21);
    check("the die's top", direct(-DVec3::Y, DVec3::new(-60_f64.to_radians().sin(), 0.5, 0.0)), 32.43);
    // On the floor beside the die: cos⁴ of the angle over h², h = 2 m.
    let angle = (1.0_f64 / 2.0).atan();
    check("the floor", direct(DVec3::new(-1.0, -2.0, 0.0), DVec3::Y), 64.8556 / 4.0 * angle.cos().powi(3));
    // The nearest points of the balls, a hair before them.
    let hair = 1e-3;
    check("near ball", direct((1.0 - hair) * DVec3::X, -DVec3::X) * (1.0 - hair).powi(2), 64.86);
    check("far ball", direct((2.0 - hair) * -DVec3::Z, DVec3::Z) * (1.0 - hair / 2.0).powi(2), 16.21);
}

/// At 45° of latitude the noon of June has sin 68.5° of the sun, that of December sin 21.5°: 2.54 times as much.
#[test]
fn the_seasons() {
    let (_, renderer) = tables("seasons.glb");
    // The normal of a place at noon lies in the plane of axis and sun, which is towards +X.
    let noon = |latitude: f64, tilt: f64| {
        let angle = (latitude - tilt).to_radians();
        DVec3::new(angle.cos(), angle.sin(), 0.0)
    };
    let at = |latitude: f64, tilt: f64, center: DVec3| {
        let n = noon(latitude, tilt);
        lux(&renderer, center + 1.001 * n, n, Some(0), 1024).value.value
    };
    let (june, december) = (DVec3::ZERO, DVec3::new(0.0, -3.0, 0.0));
    let sine = |degrees: f64| degrees.to_radians().sin();
    for latitude in [0.0, 23.5, 45.0, 60.0] {
        check(&format!("June, {latitude}°"), at(latitude, 23.5, june), 3.0 * sine(90.0 - latitude + 23.5));
        check(&format!("December, {latitude}°"), at(latitude, -23.5, december), 3.0 * sine(90.0 - latitude - 23.5));
    }
    check("June over December", at(45.0, 23.5, june) / at(45.0, -23.5, december), 2.5387);
    // Beyond the arctic circle the sun does not rise in December.
    assert_eq!(at(70.0, -23.5, december), 0.0);
}

/// In Kajiya's scene the light that glass gathers is green, and what comes back from the base is red: neither is in direct light.
#[test]
fn caustics_are_green_and_bleeding_is_red() {
    let (_, renderer) = tables("kajiya.glb");
    let share = |reading: &Reading, a: usize, b: usize| {
        let [a, b]: [Estimate; 2] = [reading.rgb[a], reading.rgb[b]];
        let relative = (a.variance / a.value.powi(2) + b.variance / b.value.powi(2)).sqrt();
        (a.value / b.value, 2.0 * relative * a.value / b.value)
    };
    // Where the small ball sends the lamp's light.
    let caustic = DVec3::new(-0.168, 5e-4, 1.421);
    let all = lux(&renderer, caustic, DVec3::Y, None, 1 << 21);
    let straight = lux(&renderer, caustic, DVec3::Y, Some(0), 1 << 16);
    let (green, half) = share(&all, 1, 0);
    println!(
        "caustic: {:.3} lx, G/R {green:.3} ± {half:.3}; straight from the lamp {:.3} lx",
        all.value.value, straight.value.value
    );
    assert!(green - half > 1.2, "{green} ± {half}");
    assert_eq!(straight.value.value, 0.0, "it lies in the ball's shadow");
    let beside = lux(&renderer, DVec3::new(0.8, 5e-4, 1.4), DVec3::Y, Some(0), 1 << 16);
    assert!(all.value.interval(0.95)[0] > beside.value.value, "and is brighter than the open base");
    // The wall, low down, where it sees the base.
    let low = DVec3::new(0.6, 0.15, -1.599);
    let (all, straight) =
        (lux(&renderer, low, DVec3::Z, None, 1 << 20), lux(&renderer, low, DVec3::Z, Some(0), 1 << 16));
    let (red, half) = share(&all, 0, 1);
    println!("wall: R/G {red:.4} ± {half:.4}, straight from the lamp {:.4}", share(&straight, 0, 1).0);
    assert!((share(&straight, 0, 1).0 - 1.0).abs() < 1e-4);
    assert!(red - half > 1.02, "{red} ± {half}");
}

/// What each integrator misses of the light, scene by scene: the table of `docs/light.md`.
#[test]
fn what_the_classic_integrators_leave_out() {
    // Share of the path tracer's light, %.
    for (file, direct, whitted) in [
        ("cornell.gltf", 78.3, 77.9),
        ("caustic.glb", 75.1, 78.2),
        ("plates.gltf", 97.9, 101.8),
        ("kajiya.glb", 71.7, 82.1),
    ] {
        let (_, renderer) = tables(file);
        let light = |integrator| {
            let settings = RenderSettings { integrator, ..settings(96, 64) };
            mean(&renderer.render(&settings, &()))[1]
        };
        let all = light(Integrator::Path);
        let [got_direct, got_whitted] = [Integrator::Direct, Integrator::Whitted].map(|kind| 100.0 * light(kind) / all);
        println!("{file}: direct {got_direct:.1} %, Whitted {got_whitted:.1} %");
        assert!((got_direct - direct).abs() < 3.0 && (got_whitted - whitted).abs() < 3.0, "{file}");
    }
}

/// Veach's plates: looking for lamps, meeting them and both have one mean; looking fails where plates are smooth and lamps large, meeting
/// where plates are rough and lamps small, and both together are nowhere much worse than the better one.
#[test]
fn both_techniques_together_are_nearly_as_good_as_the_better_one() {
    let (scene, renderer) = tables("plates.gltf");
    let flat = renderer.scene();
    let (width, height) = (60, 40);
    let spp = scaled(256);
    let [lights, bsdf, both] = [Technique::Lights, Technique::Bsdf, Technique::Both].map(|technique| {
        let settings = ReferenceSettings {
            width,
            height,
            spp,
            technique,
            filter: PixelFilter::Box,
            ..ReferenceSettings::default()
        };
        reference::render(flat, &settings)
    });
    let layers = vec![LayerKind::EntityId];
    let first = RenderSettings { width, height, spp: Some(1), layers, filter: PixelFilter::Box, ..settings(1, 1) };
    let seen = match renderer.render(&first, &()).picture.layers.remove(0).data {
        LayerData::Id(rows) => rows,
        other => panic!("{other:?}"),
    };
    // Mean and variance of a sample over all that shows an entity.
    let of = |picture: &reference::ReferencePicture, name: &str| {
        let shows = |row: u32| {
            let key = row.checked_sub(1).map(|row| SceneKey(flat.instances.key[row as usize]));
            key.and_then(|key| scene.get::<Name>(key)).is_some_and(|of| &*of.0 == name)
        };
        let pixels: Vec<usize> = (0..seen.len()).filter(|&pixel| shows(seen[pixel])).collect();
        assert!(pixels.len() > 50, "{name}");
        let sum = |values: &[glam::DVec3]| pixels.iter().map(|&i| values[i].element_sum() / 3.0).sum::<f64>();
        let (mean, variance) = (sum(&picture.rgb), sum(&picture.variance));
        Estimate { value: mean, variance, dof: f64::from(spp) }
    };
    for name in ["plate, alpha 0.02", "plate, alpha 0.045", "plate, alpha 0.1", "floor"] {
        let [lights, bsdf, both] = [&lights, &bsdf, &both].map(|picture| of(picture, name));
        println!("{name}: {:.2e} {:.2e} {:.2e}", lights.variance, bsdf.variance, both.variance);
        for (what, one) in [("lights", lights), ("BSDF", bsdf)] {
            let off = one.minus(both);
            assert!(off.value.abs() < 5.0 * off.variance.sqrt(), "{name} {what}: {off:?}");
        }
        assert!(both.variance < 1.2 * lights.variance.min(bsdf.variance), "{name}");
        if name.ends_with("0.1") {
            assert!(lights.variance < 0.2 * bsdf.variance, "lamps are found by looking for them on {name}");
        }
    }
    // The second smoothest is the other way round, by rare samples of very great weight.
    let [lights, bsdf] = [&lights, &bsdf].map(|picture| of(picture, "plate, alpha 0.008"));
    assert!(bsdf.variance < 0.7 * lights.variance, "{lights:?} {bsdf:?}");
}

/// The Cornell box's lamp is Lambertian: L A downwards, the cosine of it elsewhere, π L A in all; and its glare at the camera.
#[test]
fn the_lamp_of_the_cornell_box_by_direction_and_as_glare() {
    let (mut scene, renderer) = tables("cornell.gltf");
    let flat = renderer.scene();
    let camera = flat.camera;
    let samples = Effort { error: None, samples: Some(1 << 18), ..Effort::default() };
    let rated = glare(flat, camera.origin, camera.forward, camera.up, &samples, &());
    println!("UGR {} {:?}", rated.ugr, rated.interval);
    assert!((rated.ugr - 7.6).abs() < 0.05, "{rated:?}");
    let lamp = shown(&scene, "light");
    let lumens = flux(flat, lamp.0).expect("it is a light").value.value;
    check("lm", lumens, 1.208);
    scene.keep_only(lamp);
    let mut alone = Renderer::new();
    alone.sync(&mut scene);
    let effort = Effort { error: None, samples: Some(1 << 17), ..Effort::default() };
    let field = far_field(alone.scene(), 12, 4, &effort, &()).expect("it has an end");
    for (row, want) in [(0, 0.3845), (4, 0.5 * 0.3845)] {
        let got = field.intensity[row].value;
        println!("{} cd ± {}, {want}", got.value, got.variance.sqrt());
        assert!((got.value - want).abs() < 4.0 * got.variance.sqrt() + 1e-4 && got.variance.sqrt() < 2e-3, "{got:?}");
    }
    let [from, to] = field.flux().interval(0.999);
    assert!((from..to).contains(&lumens) && to - from < 0.02, "{from} {to}");
}

/// What the roughest of Veach's plates sends on in the mirror direction.
#[test]
fn the_brdf_of_a_plate() {
    let (scene, _) = tables("plates.gltf");
    let slots: MaterialSlots = scene.get(shown(&scene, "plate, alpha 0.1")).expect("it has materials");
    let material: Material = scene.get(slots.0[0]).expect("it is one");
    let effort = Effort { error: None, samples: Some(16), ..Effort::default() };
    let mirrored = brdf(&material, 30.0, &[30.0], &effort, &())[0];
    check("1/sr", mirrored.measured.value.value, 10.592);
    check("by the formula", mirrored.expected(), 10.592);
}

/// Error by independent numbers falls with the square root of their number; by scrambled Sobol points in the Cornell box almost with
/// the number itself.
#[test]
fn error_falls_faster_by_numbers_that_are_drawn_evenly() {
    let (_, renderer) = tables("cornell.gltf");
    let picture = |sampler, spp, seed| {
        let settings = RenderSettings { sampler, seed, sharing: Sharing::Off, ..settings(32, spp) };
        renderer.render(&settings, &()).picture.rgb
    };
    let truth = picture(SamplerKind::Sobol, 8192, 1 << 40);
    let error = |sampler, spp| {
        let of_seed = |seed| {
            let got = picture(sampler, spp, seed);
            let squares = got.iter().zip(&truth).flat_map(|(a, b)| (0..3).map(|c| f64::from(a[c] - b[c]).powi(2)));
            squares.sum::<f64>()
        };
        (0..4).map(of_seed).sum::<f64>().sqrt()
    };
    for (sampler, want) in [(SamplerKind::Independent, -0.50), (SamplerKind::Sobol, -0.84)] {
        let slope = (error(sampler, 256) / error(sampler, 4)).ln() / 64_f64.ln();
        println!("{sampler:?}: slope {slope:.3}");
        assert!((slope - want).abs() < 0.08, "{sampler:?}: {slope}, {want}");
    }
}
