//! Aiming, seeing and remembering, each by itself; that light and camera paths agree is for `tests/caustics`.

use glam::{DAffine3, DVec3, Vec3};

use super::{History, LightPaths, Node, Targets, splat};
use crate::{
    film::{Film, Label, Splats, Unit},
    flat::{FlatScene, MaterialRow, NONE, flags},
    reference::Rng,
    render::{PixelFilter, RenderSettings, Renderer},
    sampling::{FilterDensity, Sampler},
    wavefront::generate::Lens,
    world::{Camera, Geometry, LocalTransform, Material, MaterialSlots, Projection, Scene, Shape, TriMesh, units::Nit},
};

/// Through where a camera sees a point it sends a ray there, of the length that it says; and what a pixel's worth of film sees
/// has the area that it says.
#[test]
fn what_the_lens_sees_its_rays_meet() {
    let mut rng = Rng::new(3, 0);
    let orthographic = Projection::Orthographic { xmag: 2.0, ymag: 1.5 };
    for projection in [Camera::perspective(0.8).projection, orthographic] {
        let mut scene = Scene::new();
        let eye = DVec3::new(1.0, 2.0, -3.0);
        let place = LocalTransform::looking_at(eye, DVec3::new(0.4, 0.1, 0.2), DVec3::Y);
        scene.spawn((Camera { projection, znear: 0.5, zfar: 9.0 }, place));
        let mut renderer = Renderer::new();
        renderer.sync(&mut scene);
        let lens = Lens::new(renderer.scene().camera, 64, 48);
        let mut between = |lo: f64, hi: f64| lo + (hi - lo) * rng.uniform();
        let double = |v: [f32; 3]| DVec3::from_array(v.map(f64::from));
        for _ in 0..1000 {
            let (x, y) = (between(0.0, 64.0), between(0.0, 48.0));
            let (origin, direction, length) = lens.ray(x, y);
            let t = between(0.01, 0.99) * f64::from(length);
            let p = double(origin) + t * double(direction);
            let seen = lens.see(p.as_vec3().to_array()).expect("it lies between the planes");
            assert!((seen.film[0] - x).abs() + (seen.film[1] - y).abs() < 1e-3, "{:?} {x} {y}", seen.film);
            assert!((double(seen.origin) - double(origin)).length() < 1e-5);
            assert!((double(seen.direction) - double(direction)).length() < 1e-5);
            assert!((f64::from(seen.distance) - t).abs() < 1e-5 * t.max(1.0));
            // Two points beside it, in the plane across the ray.
            let a = double(direction).any_orthonormal_vector();
            let b = double(direction).cross(a);
            let film = |p: DVec3| lens.see(p.as_vec3().to_array()).expect("nor these").film;
            let h = 1e-2;
            let step = |v: DVec3| [0, 1].map(|i: usize| (film(p + h * v)[i] - film(p - h * v)[i]) / (2.0 * h));
            let ([ax, ay], [bx, by]) = (step(a), step(b));
            let area = (ax * by - ay * bx).abs();
            assert!((f64::from(seen.pixels) / area - 1.0).abs() < 0.02, "{} {area}", seen.pixels);
        }
        for outside in [-0.1, 0.49, 9.01] {
            let forward = renderer.scene().camera.forward;
            assert!(lens.see((eye + outside * forward).as_vec3().to_array()).is_none(), "{outside}");
        }
    }
}

/// Of light on the film each pixel gets the value of its filter there; pixels far from all edges get all of it.
#[test]
fn splats_fall_on_the_pixels_whose_filters_reach_them() {
    let settings =
        RenderSettings { width: 40, height: 30, crop: Some([7, 3, 21, 17]), tile_size: 5, ..RenderSettings::default() };
    let unit = Unit::for_emission(Nit(1.0));
    for kind in [PixelFilter::Box, PixelFilter::Gaussian, PixelFilter::BlackmanHarris] {
        let filter = FilterDensity::new(kind);
        for (x, y) in [(15.3, 9.8), (7.1, 3.2), (27.9, 19.9), (6.6, 10.0), (3.0, 10.0)] {
            let mut film = Film::new(&settings, unit);
            film.keep_splats();
            let sight = super::queues::Sight { light_r: 1.0, light_g: 2.0, x, y, ..Default::default() };
            let splats: &Splats = film.splats.as_ref().expect("kept");
            let mut list = Vec::new();
            splat::splat(&filter, splats, &sight, Label::default(), &mut list);
            splats.add(1, &mut list);
            splats.finish(1);
            assert_eq!((splats.samples(), splats.discarded(), list.len()), ([0, 1, 0, 0], 0, 0));
            let picture = film.resolve();
            for (i, rgb) in picture.rgb.iter().enumerate() {
                let center = [7 + i % 21, 3 + i / 21].map(|c| c as f32 + 0.5);
                let want = if kind == PixelFilter::Box {
                    f32::from((center[0] - x).abs() < 0.5 && (center[1] - y).abs() < 0.5)
                } else {
                    filter.at(center[0] - x) * filter.at(center[1] - y)
                };
                assert!(
                    (rgb[0] - want).abs() < 1e-6 && (rgb[1] - 2.0 * want).abs() < 1e-6,
                    "{kind:?} {i}: {rgb:?} {want}"
                );
            }
        }
    }
}

fn glass_at(scene: &mut Scene, count: u32) {
    let material = scene.spawn((Material::glass(1.5),));
    for i in 0..count {
        let mesh = TriMesh::sphere(Vec3::new(i as f32 * 3.0, (i * i % 7) as f32, (i % 5) as f32), 0.5, 4);
        scene.spawn((Geometry(mesh.into()), MaterialSlots::from(material)));
    }
}

/// Every vertex of what has a delta is within its ball, and no ball is for anything else; a plane's has no end.
#[test]
fn balls_hold_what_they_are_for() {
    for count in [1, 5, 100] {
        let mut scene = Scene::new();
        glass_at(&mut scene, count);
        let dull = scene.spawn((Material::lambert(Vec3::ONE),));
        scene.spawn((Geometry(TriMesh::sphere(Vec3::ZERO, 9.0, 3).into()), MaterialSlots::from(dull)));
        let mut renderer = Renderer::new();
        renderer.sync(&mut scene);
        let flat = renderer.scene();
        let targets = Targets::new(flat, flags::DELTA);
        assert_eq!(targets.len(), count.min(32) as usize);
        for instance in 0..flat.instances.len() {
            let mesh = &flat.meshes[flat.instances.mesh[instance] as usize];
            let row = targets.of(flat, instance as u32, 0);
            assert_eq!(row == NONE, instance as u32 == count);
            for &p in mesh.positions.iter().filter(|_| row != NONE) {
                // From outside a ball all of it is within the cone.
                let from = Vec3::new(-40.0, 3.0, 2.0);
                let aim = targets.aim(row as usize, from, Vec3::X);
                let cos = aim.towards.expect("from outside").dot((Vec3::from(p) - from).normalize());
                assert!(1.0 - cos <= aim.one_minus_cos, "{cos}");
                assert!(aim.weight > 0.0);
            }
        }
    }
    let mut scene = Scene::new();
    let mirror = scene.spawn((Material { roughness: 0.0, ..Material::default() },));
    scene.spawn((Shape::Plane, MaterialSlots::from(mirror), LocalTransform::Matrix(DAffine3::IDENTITY)));
    let mut renderer = Renderer::new();
    renderer.sync(&mut scene);
    let targets = Targets::new(renderer.scene(), flags::DELTA);
    assert!(targets.len() == 1 && targets.aim(0, Vec3::ONE, Vec3::Y).towards.is_none());
}

/// The mean flux of paths that are sent out is what the lamp sends into the ball: π·L·A times the form factor of a ball as
/// seen from far below a small lamp, (r/d)².
#[test]
fn paths_stand_for_the_light_that_goes_to_the_glass() {
    let mut scene = Scene::new();
    glass_at(&mut scene, 1);
    let (d, area) = (20.0_f32, 0.01_f64);
    let lamp = Material { emissive: Vec3::new(1.0, 2.0, 3.0), ..Material::lambert(Vec3::ZERO) };
    let lamp = scene.spawn((Material { double_sided: false, ..lamp },));
    let mesh = TriMesh::quad(Vec3::new(-0.05, d, -0.05), Vec3::X * 0.1, Vec3::Z * 0.1);
    scene.spawn((Geometry(mesh.into()), MaterialSlots::from(lamp)));
    let mut renderer = Renderer::new();
    renderer.sync(&mut scene);
    let flat = renderer.scene();
    let settings = RenderSettings { width: 64, height: 64, ..RenderSettings::default() };
    let light = LightPaths::new(flat, &settings).expect("a lamp and glass");
    assert_eq!(light.count, 1024);
    let sampler = Sampler::new(settings.sampler, 1);
    let mut sum = 0.0;
    for index in 0..light.count {
        if let Some(path) = light.emitters.start(flat, &light.targets, &sampler, 7, index, &mut 0) {
            let [o, v] = [[path.ox, path.oy, path.oz], [path.dx, path.dy, path.dz]].map(Vec3::from);
            let within = o.length_squared() - o.dot(v).powi(2) < 0.25;
            sum += if within { f64::from(path.flux_g) } else { 0.0 };
        }
    }
    let want = std::f64::consts::PI * 2.0 * area * (0.5 / f64::from(d)).powi(2);
    let got = sum / f64::from(light.count);
    assert!((got / want - 1.0).abs() < 0.02, "{got} {want}");
    for off in
        [RenderSettings { caustics: false, ..settings.clone() }, RenderSettings { max_depth: Some(1), ..settings }]
    {
        assert!(LightPaths::new(flat, &off).is_none());
    }
}

/// Glass of 2/m from the way in to the way out; before and after there is air, whatever surface without a back was passed.
#[test]
fn light_is_absorbed_between_the_walls_of_a_solid() {
    let mut scene = FlatScene::default();
    let dull = MaterialRow::default();
    scene.materials.push(MaterialRow {
        flags: flags::SOLID | flags::TRANSMISSION,
        absorption: [2.0, 0.0, 1.0],
        ..dull
    });
    scene.materials.push(dull);
    let mut history = History::default();
    let events = [crate::film::Event::SingularTransmission; 3];
    let node = |before, material, back, transmitted, t| Node { before, material, back, transmitted, t, events };
    let lamp = history.push(node(NONE, 1, false, false, 0.0));
    let passed = history.push(node(lamp, NONE, false, false, 0.7));
    // Met from outside; on the way from the camera it is left there.
    let inward = history.push(node(passed, 0, true, true, 0.3));
    let passed = history.push(node(inward, NONE, false, false, 0.1));
    let outward = history.push(node(passed, 0, false, true, 0.4));
    let keep = history.transmittance(&scene, node(outward, 1, false, false, 0.6), 5.0);
    for (got, want) in keep.into_iter().zip([-2.0 * 0.5, 0.0, -0.5_f32]) {
        assert!((got - want.exp()).abs() < 1e-6, "{keep:?}");
    }
}
