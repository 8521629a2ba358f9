//! Pictures whose every pixel is known from a formula.

mod coverage;
mod enclosures;
mod glossy;
mod lights;
mod oracle;
mod transparent;

use std::f64::consts::PI;

use glam::{DVec3, Vec3};
use wavecast::{
    render::{RenderSettings, SamplerKind},
    world::{Camera, Environment, LocalTransform, Material, Projection, Scene, TriMesh},
};

use crate::common::{
    look, picture, settings, show,
    trials::{Trial, check_family, means},
};

/// A scene of which the mean over the picture is known.
pub struct Case {
    name: String,
    scene: Scene,
    /// Mean of all pixels, nit.
    truth: [f64; 3],
    settings: RenderSettings,
    /// Samples from Sobol's sequence; those of `settings` are independent.
    sobol: u32,
}

impl Case {
    /// A picture of 4×4 pixels with this many independent samples, and a quarter of them from Sobol's sequence.
    fn new(name: &str, scene: Scene, truth: [f64; 3], spp: u32) -> Self {
        Self { name: name.to_owned(), scene, truth, settings: settings(4, spp), sobol: (spp / 4).max(2) }
    }

    /// The same in all channels.
    fn gray(name: &str, scene: Scene, truth: f64, spp: u32) -> Self {
        Self::new(name, scene, [truth; 3], spp)
    }

    fn max_depth(mut self, max_depth: u32) -> Self {
        self.settings.max_depth = Some(max_depth);
        self
    }
}

/// All of them; the seeds below are fixed beforehand.
fn cases() -> Vec<Case> {
    let mut cases = lights::cases();
    cases.extend(enclosures::cases());
    cases.extend(glossy::cases());
    cases.extend(transparent::cases());
    cases.extend(coverage::cases());
    cases
}

/// Seeds of the pictures of each case.
const SEEDS: std::ops::Range<u64> = 1000..1016;

/// Measures a case: a trial per channel, or one if the channels are alike.
fn trials(case: &mut Case, sampler: SamplerKind) -> Vec<Trial> {
    let spp = if sampler == SamplerKind::Sobol { Some(case.sobol) } else { case.settings.spp };
    let pictures = means(&mut case.scene, &RenderSettings { sampler, spp, ..case.settings.clone() }, SEEDS);
    let name = |channel: &str| format!("{}{channel} · {sampler:?}", case.name);
    let [r, g, b] = case.truth;
    if r == g && g == b {
        let got = pictures.iter().map(|rgb| rgb.iter().sum::<f64>() / 3.0).collect();
        return vec![Trial { name: name(""), truth: r, got }];
    }
    (0..3)
        .map(|i| Trial {
            name: name([" red", " green", " blue"][i]),
            truth: case.truth[i],
            got: pictures.iter().map(|rgb| rgb[i]).collect(),
        })
        .collect()
}

/// Every closed form within 0.1 %, with both samplers, and the family of them at 99 % (Šidák): of a hundred
/// repetitions with other seeds, one may fail by chance.
#[test]
fn closed_forms_hold_to_a_thousandth_and_to_the_noise() {
    let mut family = Vec::new();
    for mut case in cases() {
        for sampler in [SamplerKind::Sobol, SamplerKind::Independent] {
            family.extend(trials(&mut case, sampler));
        }
    }
    match check_family(&family, 0.01) {
        Ok(table) => println!("{table}"),
        Err(table) => panic!("{table}"),
    }
}

/// Negative control: an albedo that is off by half a per cent, and a missing bounce that brings as little, are found;
/// the statistics alone, without the tolerance, find 0.1 % where there is next to no noise.
#[test]
fn the_check_of_closed_forms_finds_small_errors() {
    let of = |scale: f64, max_depth: u32| {
        let mut case = enclosures::shell(0.5, Some(max_depth), 8192);
        case.truth = case.truth.map(|l| l * scale);
        case.settings.max_depth = Some(7);
        check_family(&trials(&mut case, SamplerKind::Sobol), 0.01)
    };
    assert!(of(1.0, 7).is_ok(), "{:?}", of(1.0, 7));
    assert!(of(1.005, 7).is_err(), "albedo");
    assert!(of(1.0, 8).is_err(), "one bounce less than the truth has, 0.2 %");
    let mut case = lights::point_over_plane(0.0);
    case.truth = case.truth.map(|l| l * 1.0009);
    assert!(check_family(&trials(&mut case, SamplerKind::Sobol), 0.01).is_err(), "within 0.1 %, but not by chance");
}

/// A large facet through the origin: a point on it rounds by nothing there, but the test against it does, so that rays
/// which left the point's own error alone met the facet again and the sun at 80° lost a third of its light.
#[test]
fn a_facet_through_the_origin_does_not_shade_itself() {
    for degrees in [0.0, 60.0, 80.0, 89.0] {
        let mut case = lights::sun(degrees);
        let rendered = picture(&mut case.scene, &settings(16, 16));
        for rgb in &rendered.picture.rgb {
            assert!((f64::from(rgb[0]) / case.truth[0] - 1.0).abs() < 1e-5, "{degrees}°: {rgb:?}");
        }
    }
}

/// What a white furnace and clear glass leave of a uniform sky: all of it, in every single pixel.
#[track_caller]
fn check_vanishes(name: &str, mesh: TriMesh, material: Material, spp: u32) {
    let radiance = Vec3::new(0.8, 0.5, 0.3);
    let mut scene = Scene::new();
    show(&mut scene, mesh, material);
    scene.spawn((Environment::constant(radiance),));
    // Of a sphere the part where a ray that entered is far from being reflected totally: facets by the rim can trap it
    // for longer than roulette spares it, and then the pixel is right only in the mean.
    let eye = DVec3::new(3.0, 2.0, 4.0);
    look_at_square(&mut scene, eye, DVec3::ZERO, DVec3::Y, 0.5);
    let rendered = picture(&mut scene, &settings(32, spp));
    let off = |rgb: &&[f32; 3]| (Vec3::from(**rgb) / radiance - 1.0).abs().max_element() > 1e-4;
    let pixels: Vec<_> = rendered.picture.rgb.iter().filter(off).collect();
    println!("{name}: {} pixels off", pixels.len());
    // A facet may turn a ray within dense glass beyond the critical angle for so long that roulette has its say.
    assert!(pixels.len() <= 2, "{name}: {pixels:?}");
}

/// A white diffuse object in a uniform sky reflects what it hides.
#[test]
fn white_diffuse_objects_vanish_in_a_uniform_sky() {
    check_vanishes("white box", TriMesh::cuboid(Vec3::splat(-1.0), Vec3::ONE), Material::lambert(Vec3::ONE), 16);
    check_vanishes("white sphere", flat_sphere(1.0, 12), Material::lambert(Vec3::ONE), 16);
}

/// Glass shows the sky that it hides, wherever the light goes, through however many total reflections.
#[test]
fn clear_glass_vanishes_in_a_uniform_sky() {
    for ior in [1.1, 1.5, 2.4] {
        check_vanishes(&format!("ball, index {ior}"), flat_sphere(1.0, 48), Material::glass(ior), 64);
        check_vanishes(
            &format!("block, index {ior}"),
            TriMesh::cuboid(Vec3::splat(-1.0), Vec3::ONE),
            Material::glass(ior),
            64,
        );
        check_vanishes(
            &format!("bubble, index {ior}"),
            flat_sphere(1.0, 48),
            Material { thickness: 0.0, ..Material::glass(ior) },
            64,
        );
    }
    // Silver without loss.
    check_vanishes("mirror", flat_sphere(1.0, 12), Material { roughness: 0.0, ..Material::default() }, 16);
}

/// A sphere of flat facets.
fn flat_sphere(radius: f32, rings: u32) -> TriMesh {
    TriMesh { normals: Vec::new(), ..TriMesh::sphere(Vec3::ZERO, radius, rings) }
}

/// A large square at height `y` that faces up.
fn plane(y: f32) -> TriMesh {
    TriMesh::quad(Vec3::new(-8.0, y, 8.0), Vec3::X * 16.0, Vec3::NEG_Z * 16.0)
}

/// A camera that sees so little about the target that it may be taken for a point.
fn look_at_point(scene: &mut Scene, eye: DVec3, target: DVec3) {
    look(scene, eye, target, 0.02);
}

/// A camera that sees a square of the given half side, in parallel rays.
fn look_at_square(scene: &mut Scene, eye: DVec3, target: DVec3, up: DVec3, half: f32) {
    let projection = Projection::Orthographic { xmag: half, ymag: half };
    let camera = Camera { projection, znear: 0.0, zfar: f32::INFINITY };
    scene.spawn((camera, LocalTransform::looking_at(eye, target, up)));
}

/// Black, and emits from its front.
fn lamp(radiance: f32) -> Material {
    Material {
        base_color: Vec3::ZERO,
        metallic: 0.0,
        specular: 0.0,
        emissive: Vec3::splat(radiance),
        ..Material::default()
    }
}

/// Shown as it is, on both sides.
fn unlit(radiance: f32) -> Material {
    Material { base_color: Vec3::splat(radiance), unlit: true, double_sided: true, ..Material::default() }
}

/// An axis-aligned square that faces down, and its corners.
fn ceiling(min: Vec3, side: f32) -> (TriMesh, [DVec3; 3]) {
    let mesh = TriMesh::quad(min, Vec3::X * side, Vec3::Z * side);
    (mesh, [min.as_dvec3(), DVec3::X * f64::from(side), DVec3::Z * f64::from(side)])
}

/// The radiance of a diffuse surface of albedo `rho` at an irradiance, lx.
fn lambert(rho: f32, irradiance: f64) -> f64 {
    f64::from(rho) * irradiance / PI
}
