//! The rendering equation as a matrix equation against the path tracer.

use glam::{DVec3, Vec3};
use wavecast::{
    film::{Split, luminance},
    measure::student::Estimate,
    reference::{Transport, TransportError, TransportSettings},
    render::{LayerKind, RenderSettings, Renderer, Sharing},
    world::{Environment, Material, Scene, Shape, TriMesh},
};

use crate::common::{load_scene, look, root, settings, show, show_shape};

const SIZE: u32 = 64;

/// By number of scatterings, and all that have at least one: the mean luminance of the picture, from paths.
fn by_paths(renderer: &Renderer) -> (Vec<Estimate>, Estimate) {
    let layers = vec![LayerKind::Light(Split::Bounces)];
    let settings = RenderSettings { layers, sharing: Sharing::Off, ..settings(SIZE, 256) };
    let stats = renderer.render(&settings, &()).stats;
    let terms: Vec<Estimate> = stats.parts.iter().map(|part| part.luminance).collect();
    // E itself is the same patch by patch: what differs is what has been scattered.
    let all = Estimate::sum(terms[1..].iter().map(|term| (1.0, *term)));
    (terms, all)
}

/// The same from patches with edges up to `edge` m: terms 1 to 3 and all together, over those of the path tracer.
fn by_patches(renderer: &Renderer, edge: f64, rays: u32, paths: &(Vec<Estimate>, Estimate)) -> [f64; 4] {
    let scene = renderer.scene();
    let transport = Transport::new(scene, &TransportSettings { edge, rays, seed: 1 }).expect("it is matt");
    let view = |radiance: &[DVec3]| luminance(transport.mean_of_view(scene, radiance, [SIZE; 2], 16, false).to_array());
    let terms = transport.terms(3);
    let (solution, sweeps) = transport.solve();
    let scattered: Vec<DVec3> = solution.iter().zip(transport.emission()).map(|(all, e)| *all - e).collect();
    let ratio = |own: f64, paths: Estimate| own / paths.value;
    let all = ratio(view(&scattered), paths.1);
    let got = [1, 2, 3].map(|n| ratio(view(&terms[n]), paths.0[n]));
    println!(
        "  edge {edge}: {} sides, {sweeps} sweeps, spectral radius {:.4}; K E {:.4}, K² E {:.4}, K³ E {:.4}, all {all:.4} of paths'",
        transport.len(),
        transport.spectral_radius(),
        got[0],
        got[1],
        got[2]
    );
    assert!(transport.spectral_radius() < 1.0);
    [got[0], got[1], got[2], all]
}

fn matt(color: Vec3) -> Material {
    Material { double_sided: false, ..Material::lambert(color) }
}

/// A box in an open hall under a sky.
fn hall() -> Scene {
    let mut scene = Scene::new();
    let room = TriMesh::cuboid(Vec3::new(-2.0, 0.0, -2.0), Vec3::new(2.0, 3.0, 2.0));
    // Without its ceiling.
    let triangles = room.triangles.iter().filter(|t| t.iter().any(|&v| room.positions[v as usize].y < 2.0));
    let room = TriMesh { triangles: triangles.map(|&[a, b, c]| [a, c, b]).collect(), normals: Vec::new(), ..room };
    show(&mut scene, room, matt(Vec3::new(0.7, 0.6, 0.5)));
    let block = TriMesh::cuboid(Vec3::new(-0.6, 0.0, -0.8), Vec3::new(0.4, 1.1, 0.2));
    show(&mut scene, block, matt(Vec3::new(0.2, 0.4, 0.8)));
    scene.spawn((Environment::constant(Vec3::new(0.5, 0.8, 1.0)),));
    look(&mut scene, DVec3::new(0.3, 1.5, 1.9), DVec3::new(0.0, 0.8, 0.0), 75.0);
    scene
}

/// A shell that emits everywhere and is dark on one side.
fn shell() -> Scene {
    let mut scene = Scene::new();
    let sides = TriMesh::cuboid(Vec3::splat(-1.0), Vec3::ONE);
    let of = |floor: bool| {
        let is_floor = |t: &&[u32; 3]| t.iter().all(|&v| sides.positions[v as usize].y < 0.0) == floor;
        let triangles = sides.triangles.iter().filter(is_floor).map(|&[a, b, c]| [a, c, b]);
        TriMesh { triangles: triangles.collect(), normals: Vec::new(), ..sides.clone() }
    };
    let walls = Material { emissive: Vec3::splat(0.4), ..matt(Vec3::splat(0.75)) };
    show(&mut scene, of(false), walls);
    show(&mut scene, of(true), matt(Vec3::splat(0.1)));
    look(&mut scene, DVec3::new(0.0, 0.5, 0.9), DVec3::new(0.0, -0.6, -0.5), 80.0);
    scene
}

/// (I − K)L = E solved for patches, and its partial sums, give the light that paths find; the gap closes as patches are halved.
#[test]
fn patches_and_paths_find_the_same_light() {
    for (name, mut scene, coarse) in [
        ("cornell", load_scene(&root().join("scenes/cornell.gltf")), 0.4),
        ("hall", hall(), 2.4),
        ("shell", shell(), 1.6),
    ] {
        let mut renderer = Renderer::new();
        renderer.sync(&mut scene);
        let paths = by_paths(&renderer);
        println!("{name}: scattered light {:.5} ± {:.5} nit", paths.1.value, paths.1.variance.sqrt());
        let got: Vec<[f64; 4]> = [(1.0, 32_768), (0.5, 16_384), (0.25, 4096), (0.125, 1024)]
            .map(|(share, rays)| by_patches(&renderer, coarse * share, rays, &paths))
            .to_vec();
        let gap = |row: usize, term: usize| (got[row][term] - 1.0).abs();
        // What noise there is in both: of paths, and of rays between patches.
        let noise = 3.0 * paths.1.variance.sqrt() / paths.1.value + 1e-3;
        assert!(gap(3, 3) <= 5e-3, "{name}: {got:?}");
        assert!((0..3).all(|term| gap(3, term) <= 1.5e-2), "{name}: {got:?}");
        assert!((1..4).all(|row| gap(row, 3) <= gap(row - 1, 3) + noise), "{name}: {got:?}");
        // Halved three times, the gap is much smaller: at least in the term that the patches see most coarsely.
        let worst = |row: usize| (0..4).map(|term| gap(row, term)).fold(0.0, f64::max);
        assert!(worst(3) <= 0.5 * worst(0) + noise, "{name}: {got:?}");
    }
}

/// Inside a closed matt shell every term is ρ times the one before.
#[test]
fn in_a_furnace_the_matrix_is_its_albedo() {
    let mut scene = Scene::new();
    let wall = Material { emissive: Vec3::splat(2.0), double_sided: true, ..Material::lambert(Vec3::splat(0.6)) };
    show(&mut scene, TriMesh::cuboid(Vec3::splat(-1.0), Vec3::ONE), wall);
    let mut renderer = Renderer::new();
    renderer.sync(&mut scene);
    let settings = TransportSettings { edge: 0.8, rays: 4096, seed: 3 };
    let transport = Transport::new(renderer.scene(), &settings).expect("it is matt");
    assert!((transport.spectral_radius() - f64::from(0.6_f32)).abs() < 2e-3, "{}", transport.spectral_radius());
    let mean = |values: &[DVec3]| values.iter().map(|l| l.y).sum::<f64>() / values.len() as f64;
    // The backs of the shell see nothing, and send off what they emit alone.
    let (fronts, solution) = (transport.len() / 2, transport.solve().0);
    let lit: Vec<DVec3> = solution.iter().copied().filter(|l| l.y > 2.5).collect();
    assert_eq!(lit.len(), fronts);
    assert!((mean(&lit) / (2.0 / (1.0 - f64::from(0.6_f32))) - 1.0).abs() < 2e-3, "{}", mean(&lit));
}

#[test]
fn what_has_no_matrix_is_refused_by_name() {
    let tables = |scene: &mut Scene| {
        let mut renderer = Renderer::new();
        renderer.sync(scene);
        renderer
    };
    let settings = TransportSettings { edge: 1.0, rays: 4, seed: 0 };
    let mut shiny = Scene::new();
    show(&mut shiny, TriMesh::cuboid(Vec3::splat(-1.0), Vec3::ONE), Material::default());
    let error = Transport::new(tables(&mut shiny).scene(), &settings).unwrap_err();
    assert_eq!(error, TransportError::NotMatt { instance: 0 });
    let mut ball = Scene::new();
    show_shape(&mut ball, Shape::Sphere { radius: 1.0 }, Material::lambert(Vec3::ONE), glam::DAffine3::IDENTITY);
    assert!(Transport::new(tables(&mut ball).scene(), &settings).unwrap_err().to_string().contains("formulas"));
    let mut large = Scene::new();
    show(&mut large, TriMesh::cuboid(Vec3::splat(-1.0), Vec3::ONE), Material::lambert(Vec3::ONE));
    let fine = TransportSettings { edge: 1e-3, ..settings };
    assert!(matches!(Transport::new(tables(&mut large).scene(), &fine), Err(TransportError::TooMany(_))));
}
