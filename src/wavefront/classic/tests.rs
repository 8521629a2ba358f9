//! The classic integrators against what they are by definition.

use glam::{DVec2, DVec3, Vec3};

use crate::{
    film::LayerData,
    flat::FlatScene,
    reference::{ReferenceSettings, Tracer, camera_ray},
    render::{Integrator, LayerKind, PixelFilter, RenderSettings, Rendered, Renderer},
    sampling::{FilterTable, Sampler},
    simd::{Bits, Real},
    wavefront::dimensions,
    world::{
        Camera, DirectionalLight, Environment, Geometry, LocalTransform, Material, MaterialSlots, PointLight, Scene,
        TriMesh,
        units::{Candela, Lux},
    },
};

const SIZE: u32 = 96;

fn show(scene: &mut Scene, mesh: TriMesh, material: Material) {
    let material = scene.spawn((material,));
    scene.spawn((Geometry(mesh.into()), MaterialSlots::from(material)));
}

fn floor(scene: &mut Scene) {
    let quad = TriMesh::quad(Vec3::new(-4.0, 0.0, 4.0), Vec3::X * 8.0, Vec3::NEG_Z * 8.0);
    show(scene, quad, Material::lambert(Vec3::new(0.7, 0.6, 0.5)));
}

fn eye(scene: &mut Scene) {
    let at = LocalTransform::looking_at(DVec3::new(0.3, 2.2, 5.0), DVec3::new(0.0, 0.7, 0.0), DVec3::Y);
    scene.spawn((Camera::perspective(0.7), at));
}

/// A mirror, solid and thin glass, gloss, absorption, and lamps of every kind that the tree knows.
fn mirrors_and_glass() -> Scene {
    let mut scene = Scene::new();
    floor(&mut scene);
    let silver = Material { base_color: Vec3::new(0.9, 0.92, 0.95), roughness: 0.0, ..Material::default() };
    show(&mut scene, TriMesh::sphere(Vec3::new(-1.3, 0.8, -0.3), 0.8, 24), silver);
    let glass =
        Material { attenuation_distance: 0.7, attenuation_color: Vec3::new(0.4, 0.9, 0.6), ..Material::glass(1.5) };
    show(&mut scene, TriMesh::cuboid(Vec3::new(0.4, 0.01, 0.2), Vec3::new(1.4, 1.1, 1.2)), glass);
    let pane = Material { thickness: 0.0, ..Material::glass(1.5) };
    show(&mut scene, TriMesh::quad(Vec3::new(-0.6, 0.0, 1.4), Vec3::new(0.7, 0.0, -0.2), Vec3::Y * 1.2), pane);
    let paint = Material { base_color: Vec3::new(0.8, 0.2, 0.1), metallic: 0.0, roughness: 0.3, ..Material::default() };
    show(&mut scene, TriMesh::cuboid(Vec3::new(-0.4, 0.0, -2.0), Vec3::new(0.8, 1.6, -1.2)), paint);
    let lamp = Material { emissive: Vec3::splat(20.0), ..Material::lambert(Vec3::ZERO) };
    show(&mut scene, TriMesh::quad(Vec3::new(-0.4, 3.0, -0.4), Vec3::X * 0.8, Vec3::Z * 0.8), lamp);
    scene.spawn((
        PointLight { color: Vec3::new(0.5, 0.7, 1.0), intensity: Candela(6.0) },
        LocalTransform::from_translation(DVec3::new(2.5, 2.0, 2.0)),
    ));
    let sun = LocalTransform::looking_at(DVec3::new(-2.0, 3.0, 1.0), DVec3::ZERO, DVec3::Y);
    scene.spawn((DirectionalLight { color: Vec3::ONE, illuminance: Lux(0.8) }, sun));
    scene.spawn((Environment::constant(Vec3::new(0.2, 0.25, 0.4)),));
    eye(&mut scene);
    scene
}

fn tables(scene: &mut Scene) -> Renderer {
    let mut renderer = Renderer::new();
    let report = renderer.sync(scene);
    assert!(report.warnings.is_empty(), "{:?}", report.warnings);
    renderer
}

fn settings(integrator: Integrator, spp: u32) -> RenderSettings {
    RenderSettings {
        width: SIZE,
        height: SIZE,
        spp: Some(spp),
        filter: PixelFilter::Box,
        integrator,
        ..RenderSettings::default()
    }
}

/// The place on the film that the one sample of a pixel looks through.
fn film_of(settings: &RenderSettings, x: u32, y: u32) -> DVec2 {
    type Integer = <f32 as Real>::Bits;
    let sampler = Sampler::new(settings.sampler, settings.seed).for_samples(settings.spp);
    let (hash, index) = sampler.of_pixel(x, y, 0);
    let u = sampler.pair::<f32>(Integer::splat(hash), Integer::splat(index), Integer::splat(dimensions::FILTER));
    let filter = FilterTable::new(settings.filter);
    let place = |pixel: u32, u: f32| f64::from(pixel) + 0.5 + f64::from(filter.offset(u));
    DVec2::new(place(x, u.0), place(y, u.1))
}

fn tree(flat: &FlatScene, settings: &RenderSettings) -> Vec<DVec3> {
    let tracer = Tracer::new(flat, &ReferenceSettings::default());
    (0..SIZE * SIZE)
        .map(|i| {
            let film = film_of(settings, i % SIZE, i / SIZE);
            let (origin, direction) = camera_ray(&flat.camera, film, SIZE, SIZE);
            tracer.whitted(origin, direction, super::whitted::MOST_DEPTH)
        })
        .collect()
}

/// Ray by ray the tree of f32 has the light of that of f64, but where they pass an edge on different sides.
#[test]
fn whitteds_tree_agrees_with_its_twin_in_f64() {
    let renderer = tables(&mut mirrors_and_glass());
    let settings = settings(Integrator::Whitted, 1);
    let got = renderer.render(&settings, &());
    assert_eq!(got.stats.discarded, []);
    let want = tree(renderer.scene(), &settings);
    let off = |(got, want): (&[f32; 3], &DVec3)| {
        let got = DVec3::from_array(got.map(f64::from));
        ((got - *want).abs() / (want.abs() + 1e-2)).max_element()
    };
    let mut all: Vec<f64> = got.picture.rgb.iter().zip(&want).map(off).collect();
    all.sort_unstable_by(f64::total_cmp);
    let (most, edges) = (all[all.len() * 99 / 100], all.iter().filter(|&&off| off > 1e-4).count());
    println!("99 % of rays within {most:.1e}, {edges} of {} beyond 1e-4", all.len());
    assert!(most <= 1e-4, "{most}");
    // The picture as a whole is not off.
    let mean = |values: &mut dyn Iterator<Item = f64>| values.sum::<f64>() / all.len() as f64;
    let (own, twin) =
        (mean(&mut got.picture.rgb.iter().map(|rgb| f64::from(rgb[1]))), mean(&mut want.iter().map(|l| l.y)));
    assert!((own / twin - 1.0).abs() < 1e-3, "{own} {twin}");
}

/// Of a lamp as a point, a shadow has an edge of the one pixel that it goes through: what a lid leaves of the light on a floor.
#[test]
fn whitteds_shadows_are_hard() {
    let row = |integrator, lid: bool| {
        let mut scene = Scene::new();
        floor(&mut scene);
        if lid {
            let quad = TriMesh::quad(Vec3::new(-0.41, 1.0, -0.4), Vec3::X * 0.8, Vec3::Z * 0.8);
            show(&mut scene, quad, Material { double_sided: true, ..Material::lambert(Vec3::ZERO) });
        }
        let lamp = Material { emissive: Vec3::splat(30.0), ..Material::lambert(Vec3::ZERO) };
        show(&mut scene, TriMesh::quad(Vec3::new(-0.25, 3.0, -0.25), Vec3::X * 0.5, Vec3::Z * 0.5), lamp);
        // From below the lid, so that it hides nothing.
        let at = LocalTransform::looking_at(DVec3::new(0.0, 0.9, 0.01), DVec3::ZERO, DVec3::Z);
        scene.spawn((Camera::perspective(1.9), at));
        let picture = tables(&mut scene).render(&settings(integrator, 64), &()).picture.rgb;
        (0..SIZE).map(|x| picture[(SIZE / 2 * SIZE + x) as usize][1]).collect::<Vec<f32>>()
    };
    let width = |integrator| {
        let (lit, shaded) = (row(integrator, false), row(integrator, true));
        let left: Vec<f32> = lit.iter().zip(&shaded).map(|(lit, shaded)| shaded / lit).collect();
        assert!(left.iter().any(|&x| x < 0.01) && left.iter().any(|&x| x > 0.99), "{left:?}");
        left.iter().filter(|&&x| (0.01..0.99).contains(&x)).count()
    };
    let (hard, soft) = (width(Integrator::Whitted), width(Integrator::Direct));
    println!("both edges of a shadow: {hard} pixels under Whitted's lamp, {soft} under the real one");
    assert!(hard <= 2 && soft > 10, "{hard} {soft}");
}

fn mean(rendered: &Rendered) -> f64 {
    rendered.picture.rgb.iter().flatten().map(|&c| f64::from(c)).sum::<f64>() / (3 * rendered.picture.rgb.len()) as f64
}

/// Direct light is E + KE of the whole series, in all bits where nothing is shared or splatted.
#[test]
fn direct_light_is_the_first_two_terms() {
    let renderer = tables(&mut mirrors_and_glass());
    let direct = renderer.render(&settings(Integrator::Direct, 16), &());
    let cut = RenderSettings { max_depth: Some(1), ..settings(Integrator::Path, 16) };
    assert_eq!(direct.picture.rgb, renderer.render(&cut, &()).picture.rgb);
    let none = RenderSettings { max_depth: Some(0), ..settings(Integrator::Direct, 16) };
    assert!(mean(&renderer.render(&none, &())) < mean(&direct));
}

/// On a floor under the open sky nothing is closed; under a lid at a distance d, what a disc or plane leaves of the hemisphere is
/// known; and what is farther than the distance asked for is not there.
#[test]
fn ambient_occlusion_is_the_open_share_of_the_hemisphere() {
    let ambient = |lid: Option<f64>, distance: f32| {
        let mut scene = Scene::new();
        let shiny = Material { roughness: 0.1, ..Material::default() };
        show(&mut scene, TriMesh::quad(Vec3::new(-50.0, 0.0, 50.0), Vec3::X * 100.0, Vec3::NEG_Z * 100.0), shiny);
        if let Some(height) = lid {
            let glowing = Material { emissive: Vec3::splat(7.0), double_sided: true, ..Material::lambert(Vec3::ONE) };
            show(&mut scene, TriMesh::disc(Vec3::new(0.0, height as f32, 0.0), 1.0, 512), glowing);
        }
        let at = LocalTransform::looking_at(DVec3::new(0.0, 0.2, 0.0), DVec3::ZERO, DVec3::X);
        scene.spawn((Camera::perspective(1e-3), at));
        mean(&tables(&mut scene).render(&settings(Integrator::Ambient { distance }, 16), &()))
    };
    assert!((ambient(None, f32::INFINITY) - 1.0).abs() < 1e-6);
    // A disc of radius 1 at height h takes 1/(1 + h²) of the cosine-weighted hemisphere.
    for height in [0.5, 2.0] {
        let open = ambient(Some(height), f32::INFINITY);
        let want = 1.0 - 1.0 / (1.0 + height * height);
        assert!((open - want).abs() < 2e-3, "{height}: {open}, {want}");
    }
    assert!((ambient(Some(2.0), 1.9) - 1.0).abs() < 1e-6);
}

/// Layers by bounces tell what each leaves out, and sum to it.
#[test]
fn the_tree_has_layers_too() {
    let renderer = tables(&mut mirrors_and_glass());
    let layers = vec![LayerKind::Light(crate::film::Split::Bounces)];
    let with = RenderSettings { layers, ..settings(Integrator::Whitted, 4) };
    let picture = renderer.render(&with, &()).picture;
    let values = |name: &str| match picture.layers.iter().find(|layer| layer.name == name).map(|layer| &layer.data) {
        Some(LayerData::Rgb(values)) => values,
        _ => panic!("{name}"),
    };
    for (i, want) in picture.rgb.iter().enumerate() {
        let sum: f64 = (0..18).map(|n| f64::from(values(&format!("bounce{n:02}"))[i][1])).sum();
        assert!((sum - f64::from(want[1])).abs() <= 20.0 * 6e-8 * f64::from(want[1]));
    }
}
