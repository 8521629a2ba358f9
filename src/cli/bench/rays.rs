//! The rays that a path tracer asks about, by kind, over the triangles of a scene.

use wavecast::{
    accel::{Accel, Hit, NO_HIT, RayList, Solid},
    flat::{CameraView, FlatScene, ViewProjection},
    glam::{DVec3, Vec3},
};

use super::contender::Question;

/// A triangle by its corners, m.
pub type Corners = [[f32; 3]; 3];

/// A ray: start, direction, end in units of the direction.
pub type OneRay = ([f32; 3], [f32; 3], f32);

/// Rays of one kind.
pub struct Batch {
    /// As `--json` calls it.
    pub kind: &'static str,
    /// What is asked about them.
    pub question: Question,
    /// The rays, in the order in which a path tracer comes to them.
    pub rays: Vec<OneRay>,
}

/// All triangles of a scene where they stand in the world.
pub fn world_triangles(scene: &FlatScene) -> Vec<Corners> {
    let mut all = Vec::new();
    for row in 0..scene.instances.len() {
        let m = &scene.instances.world_from_local[row];
        let place = |p: [f32; 3]| -> [f32; 3] {
            std::array::from_fn(|i| m[4 * i] * p[0] + m[4 * i + 1] * p[1] + m[4 * i + 2] * p[2] + m[4 * i + 3])
        };
        let mesh = &scene.meshes[scene.instances.mesh[row] as usize];
        all.extend((0..mesh.triangles.len()).map(|triangle| mesh.corners(triangle as u32).map(place)));
    }
    all
}

/// splitmix64: numbers in [0, 1) that are the same on every machine.
struct Numbers(u64);

impl Numbers {
    fn next(&mut self) -> f32 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ z >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ z >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ z >> 31) >> 40) as f32 / 16_777_216.0
    }

    /// Uniform over the unit sphere.
    fn direction(&mut self) -> Vec3 {
        let z = 1.0 - 2.0 * self.next();
        let (sin, cos) = (std::f32::consts::TAU * self.next()).sin_cos();
        let radius = (1.0 - z * z).max(0.0).sqrt();
        Vec3::new(radius * cos, radius * sin, z)
    }
}

/// Pictures that are looked at to get as many rays of every kind; where most light leaves the scene, some kinds have fewer.
const PICTURES: usize = 16;

/// So many camera rays, rays after one and after three diffuse bounces, and rays towards random points. The kinds may
/// be empty, if the camera sees nothing.
pub fn batches(view: &CameraView, triangles: &[Corners], accel: &Accel, count: u32) -> Vec<Batch> {
    let mut numbers = Numbers(1);
    let mut kinds = [
        ("primary", Question::NearestOfNeighbours),
        ("bounce1", Question::Nearest),
        ("bounce3", Question::Nearest),
        ("shadow", Question::Any),
    ]
    .map(|(kind, question)| Batch { kind, question, rays: Vec::new() });
    for _ in 0..PICTURES {
        let primary = camera_rays(view, count, &mut numbers);
        let bounce1 = bounced(triangles, accel, &primary, &mut numbers);
        let bounce2 = bounced(triangles, accel, &bounce1, &mut numbers);
        let bounce3 = bounced(triangles, accel, &bounce2, &mut numbers);
        let shadow = shadow_rays(&bounce1, accel, &mut numbers);
        for (batch, rays) in kinds.iter_mut().zip([primary, bounce1, bounce3, shadow]) {
            batch.rays.extend(rays);
            batch.rays.truncate(count as usize);
        }
        if kinds.iter().all(|batch| batch.rays.len() == count as usize) {
            break;
        }
    }
    kinds.into()
}

/// The even bits of a number, side by side.
fn even_bits(bits: u32) -> u32 {
    bits & 1 | bits >> 1 & 2 | bits >> 2 & 4
}

/// Through random places of a 4:3 picture, by tiles of 8×8 pixels, in them by 4×4, in those by 2×2: neighbours in the
/// list are neighbours in the picture, whatever the size of a packet.
fn camera_rays(view: &CameraView, count: u32, numbers: &mut Numbers) -> Vec<OneRay> {
    let tiles = count.div_ceil(64);
    let across = (f64::from(tiles) * 4.0 / 3.0).sqrt().ceil() as u32;
    let (width, height) = (f64::from(across * 8), f64::from(tiles.div_ceil(across) * 8));
    let ray = |i: u32, numbers: &mut Numbers| {
        let (tile, pixel) = (i / 64, i % 64);
        let x = f64::from(tile % across * 8 + even_bits(pixel)) + f64::from(numbers.next());
        let y = f64::from(tile / across * 8 + even_bits(pixel >> 1)) + f64::from(numbers.next());
        let (s, t) = ((2.0 * x - width) / height, 1.0 - 2.0 * y / height);
        let aside = s * view.right + t * view.up;
        let (origin, direction): (DVec3, DVec3) = match view.projection {
            ViewProjection::Perspective { tan_half_yfov } => (view.origin, view.forward + tan_half_yfov * aside),
            ViewProjection::Orthographic { half_height } => (view.origin + half_height * aside, view.forward),
        };
        (origin.as_vec3().to_array(), direction.normalize().as_vec3().to_array(), f32::INFINITY)
    };
    (0..count).map(|i| ray(i, numbers)).collect()
}

/// What each ray meets first.
fn hits(accel: &Accel, rays: &[OneRay]) -> Vec<Hit> {
    let mut hits = vec![NO_HIT; rays.len()];
    accel.nearest_of(&RayList(rays), &Solid, |index, hit| hits[index] = *hit);
    hits
}

/// A cosine-distributed ray from each place that is hit.
fn bounced(triangles: &[Corners], accel: &Accel, rays: &[OneRay], numbers: &mut Numbers) -> Vec<OneRay> {
    let mut next = Vec::with_capacity(rays.len());
    for (hit, &(_, direction, _)) in hits(accel, rays).iter().zip(rays) {
        let Some([a, b, c]) = triangles.get(hit.triangle as usize).map(|corners| corners.map(Vec3::from_array)) else {
            continue;
        };
        let normal = (b - a).cross(c - a).normalize_or_zero();
        let normal = if normal.dot(Vec3::from_array(direction)) > 0.0 { -normal } else { normal };
        let place = a + hit.b1 * (b - a) + hit.b2 * (c - a);
        // Far enough off the surface for the rounding of the place; the benchmark needs rays, not light.
        let origin = place + normal * (8.0 * f32::EPSILON * place.abs().max_element().max(1e-6));
        let out = normal * 1.0001 + numbers.direction();
        next.push((origin.to_array(), out.normalize_or(normal).to_array(), f32::INFINITY));
    }
    next.retain(|(_, direction, _)| *direction != [0.0; 3]);
    next
}

/// From where rays start to points in the middle of the scene's box.
fn shadow_rays(rays: &[OneRay], accel: &Accel, numbers: &mut Numbers) -> Vec<OneRay> {
    let (lower, upper) = accel.bounds().unwrap_or(([0.0; 3], [1.0; 3]));
    let ray = |&(origin, _, _): &OneRay| {
        let target: [f32; 3] = std::array::from_fn(|i| lower[i] + (0.1 + 0.8 * numbers.next()) * (upper[i] - lower[i]));
        (origin, std::array::from_fn(|i| target[i] - origin[i]), 0.999)
    };
    rays.iter().map(ray).filter(|(_, direction, _)| *direction != [0.0; 3]).collect()
}
