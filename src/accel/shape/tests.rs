//! Shapes against whole numbers, and against each other in every structure.

use std::sync::Arc;

use super::*;
use crate::accel::{
    Accel, AccelKind, Blas, Hit, InstanceRef, NO_HIT, Opacity, Solid, Stacks,
    tests::{Sieve, Wave, check_wave, numbers, placed, sieved_as, wave},
};

/// Coordinates are whole multiples of 2⁻¹⁶ of at most 24 bits, so that whole numbers of 128 bits decide.
const UNIT: f64 = 65536.0;

fn whole(x: f32) -> i128 {
    let units = f64::from(x) * UNIT;
    assert_eq!(units, units.trunc());
    units as i128
}

/// Rays from near and far, most of them past the silhouette of a ball, or of a tube, as near as rounding aims.
fn rays(count: usize, radius: f32, tube: bool, seed: u64) -> impl Iterator<Item = Ray> {
    let mut u = numbers(seed);
    let radius = f64::from(radius);
    let mut point = move || DVec3::from_array([0; 3].map(|_| f64::from(2.0 * u() - 1.0)));
    (0..count).map(move |i| {
        let origin = radius * [0.7, 1.5, 8.0, 100.0][i % 4] * point();
        // Towards the edge of what is seen from there, a little inside or outside.
        let from = if tube { origin.with_y(0.0) } else { origin };
        let sideways = if tube { DVec3::Y * point().x.signum() } else { point() }.cross(from).normalize_or(DVec3::X);
        let distance = from.length();
        let edge = radius * distance / (distance * distance - radius * radius).abs().sqrt();
        let share = [1.0, 1.0 - 1e-6, 1.0 + 1e-6, 0.9, 0.3][i % 5];
        let target = share * edge * sideways + 0.01 * point() * (i % 2) as f64;
        let target = if tube { target + radius * point() * DVec3::Y } else { target };
        let round = |v: DVec3| v.to_array().map(|x| ((x * UNIT).round() / UNIT).clamp(-100.0, 100.0) as f32);
        Ray::new(round(origin), round((target - origin).normalize() * 15.0))
    })
}

/// What whole numbers say of a ray and a shape: od, dd, oo − r², and dd r² − |o × d|², of x and z alone for a tube.
fn exact(shape: &Shape, ray: &Ray) -> [i128; 4] {
    let ([ox, oy, oz], [dx, dy, dz]) = (ray.origin.map(whole), ray.direction.map(whole));
    let (radius, flat) = match *shape {
        Shape::Sphere { radius } => (whole(radius), false),
        Shape::Cylinder { radius, .. } => (whole(radius), true),
        _ => unreachable!(),
    };
    let (oy, dy) = if flat { (0, 0) } else { (oy, dy) };
    let cross = [oy * dz - oz * dy, oz * dx - ox * dz, ox * dy - oy * dx];
    let dd = dx * dx + dy * dy + dz * dz;
    let past = cross.iter().map(|x| x * x).sum::<i128>();
    [ox * dx + oy * dy + oz * dz, dd, ox * ox + oy * oy + oz * oz - radius * radius, dd * radius * radius - past]
}

/// A million rays: hit or miss is what whole numbers say, but for rays that pass the silhouette as near as 10⁻¹⁵ of the
/// distances involved; t is within 0.501 units in the last place, and what that same error of the silhouette makes of
/// it; and the hit's numbers give the point back to half a unit in the last place of the radius, on the surface.
#[track_caller]
fn check_round(shape: Shape, radius: f32, rays: impl Iterator<Item = Ray>) {
    let (mut hits, mut misses, mut undecided) = (0, 0, 0);
    for ray in rays {
        let [od, dd, c, discriminant] = exact(&shape, &ray);
        let (root, r) = ((discriminant.max(0) as f64).sqrt(), f64::from(radius) * UNIT);
        let (o, d) = (DVec3::from_array(ray.origin.map(f64::from)), DVec3::from_array(ray.direction.map(f64::from)));
        // What rounding may make of the discriminant, and that of t.
        let size = o.length() * UNIT + r;
        let doubt = 1e-15 * size * r * dd as f64;
        let both = if dd == 0 || discriminant < 0 {
            [f64::NAN; 2]
        } else if od > 0 {
            let q = -(od as f64) - root;
            [q / dd as f64, c as f64 / q]
        } else {
            let q = -(od as f64) + root;
            [c as f64 / q, q / dd as f64]
        };
        let height = |t: f64| match shape {
            Shape::Cylinder { half_height, .. } => f64::from(half_height) - (o.y + t * d.y).abs(),
            _ => f64::INFINITY,
        };
        let slip = doubt / (root * dd as f64);
        let counts = |t: f64| t > 0.0 && height(t) >= 0.0;
        let unsure = (discriminant as f64).abs() <= doubt
            || both.iter().any(|&t| t.abs() < 1e-300 + slip || height(t).abs() < (slip + 1e-15) * 100.0);
        let want: Vec<f64> = both.into_iter().filter(|&t| counts(t)).collect();
        let got: Vec<ShapeHit> = shape.meet(&ray).into_iter().flatten().collect();
        if unsure {
            undecided += 1;
            continue;
        }
        assert_eq!(got.len(), want.len(), "{shape:?} {ray:?}: {got:?} {want:?}");
        misses += usize::from(want.is_empty());
        for (ShapeHit { face, hit }, t) in got.into_iter().zip(want) {
            hits += 1;
            let ulp = f64::from((t as f32).next_up()) - f64::from(t as f32);
            assert!((f64::from(hit.t) - t).abs() <= 0.501 * ulp + slip, "{shape:?} {ray:?}: {hit:?} {t}");
            let p = shape.point(face, hit.b1, hit.b2);
            let off = (p - (o + t * d)).abs().max_element();
            let rounding = f64::from(f32::EPSILON) * (0.5 * f64::from(radius)).max(0.5 * p.y.abs());
            assert!(off <= 1.05 * rounding + slip * d.length(), "{shape:?} {ray:?}: {p} is {off} away");
            assert!(hit.b1.abs() <= 1.0);
            let n = shape.normal(p);
            assert!(hit.back == (n.dot(d) > 0.0) || n.dot(d).abs() < 1e-6 * d.length(), "{shape:?} {ray:?}");
            let across = if let Shape::Cylinder { .. } = shape { p.with_y(0.0) } else { p };
            assert!((across.length() / f64::from(radius) - 1.0).abs() < 1e-15);
            assert!((n * f64::from(radius) - across).length() < 1e-15 * f64::from(radius));
        }
    }
    assert!(hits > 200_000 && misses > 50_000 && undecided < 20_000, "{hits} {misses} {undecided}");
}

#[test]
fn spheres_are_met_where_whole_numbers_say() {
    for (seed, radius) in [(1, 1.0), (2, 0.25)] {
        check_round(Shape::Sphere { radius }, radius, rays(500_000, radius, false, seed));
    }
}

#[test]
fn cylinders_are_met_where_whole_numbers_say() {
    for (seed, radius, half_height) in [(3, 1.0, 0.75), (4, 0.25, 4.0)] {
        check_round(Shape::Cylinder { radius, half_height }, radius, rays(500_000, radius, true, seed));
    }
}

/// A million rays: y = 0 is met at −o_y/d_y, within the circle if whole numbers say so.
#[test]
fn discs_and_planes_are_met_where_whole_numbers_say() {
    let radius = 1.0;
    let (mut hits, mut misses) = (0, 0);
    for (i, ray) in rays(1_000_000, radius, false, 5).enumerate() {
        let shape = if i % 8 == 0 { Shape::Plane } else { Shape::Disc { radius } };
        let ([ox, oy, oz], [dx, dy, dz]) = (ray.origin.map(whole), ray.direction.map(whole));
        let (x, z) = (ox * dy - oy * dx, oz * dy - oy * dz);
        let (past, edge) = (x * x + z * z, whole(radius) * whole(radius) * dy * dy);
        let ahead = dy != 0 && oy != 0 && (oy > 0) != (dy > 0);
        if matches!(shape, Shape::Disc { .. }) && (past - edge).abs() < edge / (1 << 48) {
            continue;
        }
        let want = ahead && (shape == Shape::Plane || past <= edge);
        let [got, none] = shape.meet(&ray);
        assert_eq!((got.is_some(), none), (want, None), "{shape:?} {ray:?}");
        misses += usize::from(!want);
        if let Some(ShapeHit { face, hit }) = got {
            hits += 1;
            let t = -oy as f64 / dy as f64;
            assert!((f64::from(hit.t) / t - 1.0).abs() <= 0.501 * f64::from(f32::EPSILON));
            assert_eq!((hit.back, face), (dy > 0, 0));
            let want = [x, z].map(|x| x as f64 / dy as f64 / UNIT);
            let p = shape.point(face, hit.b1, hit.b2);
            assert!((p.x - want[0]).abs() <= 0.51 * f64::from(f32::EPSILON) * want[0].abs() && p.y == 0.0);
            assert!((p.z - want[1]).abs() <= 0.51 * f64::from(f32::EPSILON) * want[1].abs());
        }
    }
    assert!(hits > 100_000 && misses > 100_000, "{hits} {misses}");
}

#[test]
fn sizes_may_be_extreme_and_rays_may_lie_along_surfaces() {
    for radius in [1e-30, 1e-10, 1e10, 1e18] {
        let ray = Ray::new([3.0 * radius, 0.0, 0.0], [-1.0, 0.0, 0.0]);
        for shape in [Shape::Sphere { radius }, Shape::Cylinder { radius, half_height: radius }] {
            let [first, last] = shape.meet(&ray).map(|hit| hit.unwrap().hit.t);
            assert!((first / radius - 2.0).abs() < 1e-6 && (last / radius - 4.0).abs() < 1e-6, "{first} {last}");
        }
    }
    let tube = Shape::Cylinder { radius: 1.0, half_height: 1.0 };
    assert_eq!(tube.meet(&Ray::new([1.0, 5.0, 0.0], [0.0, -1.0, 0.0])), [None; 2], "in the surface");
    assert_eq!(tube.meet(&Ray::new([0.0, 5.0, 0.0], [0.0, -1.0, 0.0])), [None; 2], "through both ends");
    let inside = tube.meet(&Ray::new([0.0, 2.0, 0.0], [1.0, -2.0, 0.0]));
    assert!(inside[0].is_some_and(|hit| hit.hit.back && hit.hit.b2 == 0.0) && inside[1].is_none());
    for flat in [Shape::Plane, Shape::Disc { radius: 1.0 }] {
        assert_eq!(flat.meet(&Ray::new([-3.0, 0.0, 0.0], [1.0, 0.0, 0.0])), [None; 2]);
        assert_eq!(flat.meet(&Ray::new([0.0, 0.0, 0.0], [1.0, 1.0, 0.0])), [None; 2], "from where it stands");
    }
}

/// Texture coordinates grow along the tangent, and the bitangent points to smaller v.
#[test]
fn tangents_follow_texture_coordinates() {
    let shapes = [
        Shape::Sphere { radius: 2.0 },
        Shape::Cylinder { radius: 2.0, half_height: 1.5 },
        Shape::Disc { radius: 2.0 },
        Shape::Plane,
    ];
    for shape in shapes {
        for face in 0..shape.faces() as u32 {
            let p = shape.point(face, 0.4, -0.3);
            let [x, y, z, sign] = shape.tangent(p).map(f64::from);
            let tangent = DVec3::new(x, y, z);
            let bitangent = sign * shape.normal(p).cross(tangent);
            let uv = |step: DVec3| shape.uv(p + 1e-3 * step).map(f64::from);
            let ([u0, v0], [u1, v1], [u2, v2]) = (uv(DVec3::ZERO), uv(tangent), uv(bitangent));
            assert!(u1 - u0 > 1e-5 && (v1 - v0).abs() < 1e-6, "{shape:?} {face}");
            assert!((u2 - u0).abs() < 1e-6 && v2 - v0 < -1e-5, "{shape:?} {face}");
        }
    }
}

fn turned(blas: &Arc<Blas>, scale: DVec3, at: DVec3) -> InstanceRef {
    let turn = glam::DQuat::from_axis_angle(DVec3::new(1.0, 2.0, -3.0).normalize(), 0.7);
    let world = glam::DAffine3::from_scale_rotation_translation(scale, turn, at);
    let rows = |m: glam::DAffine3| -> [f32; 12] {
        let [x, y, z, w] = [m.matrix3.x_axis, m.matrix3.y_axis, m.matrix3.z_axis, m.translation];
        std::array::from_fn(|i| [x, y, z, w][i % 4][i / 4] as f32)
    };
    let [world_from_local, local_from_world] = [world, world.inverse()].map(rows);
    InstanceRef { blas: Arc::clone(blas), world_from_local, local_from_world, identity: false }
}

/// A shape that is asked whether it is there.
fn sieved_shape(shape: Shape) -> Arc<Blas> {
    let mut blas = Blas::of_shape(shape);
    blas.set_opacity(|_| Opacity::Asked);
    Arc::new(blas)
}

/// Shapes among meshes of a kind: where they were made, moved, stretched, mirrored, and one twice.
fn scene(kind: AccelKind, plane: bool) -> Vec<InstanceRef> {
    let [soup, small] = [(200, 21), (20, 22)].map(|(count, seed)| {
        let mut u = numbers(seed);
        let mut point = |spread: f32| [0; 3].map(|_| u() * spread);
        let triangles: Vec<[[f32; 3]; 3]> = (0..count)
            .map(|_| {
                let base = point(4.0);
                [0; 3].map(|_| std::array::from_fn(|axis| base[axis] + point(1.0)[axis]))
            })
            .collect();
        sieved_as(kind, &triangles)
    });
    let [ball, tube, disc, floor] = [
        Shape::Sphere { radius: 1.0 },
        Shape::Cylinder { radius: 0.5, half_height: 1.0 },
        Shape::Disc { radius: 1.5 },
        Shape::Plane,
    ]
    .map(sieved_shape);
    let mut instances = vec![
        placed(&ball, 1.0, 0.0),
        placed(&soup, 1.0, 0.0),
        turned(&tube, DVec3::new(1.5, 1.0, -0.8), DVec3::new(1.0, 2.0, 3.0)),
        placed(&small, 1.0, 0.0),
        turned(&disc, DVec3::new(1.0, -1.0, 0.6), DVec3::new(3.0, 1.0, 2.0)),
        turned(&ball, DVec3::new(0.5, 1.4, 0.9), DVec3::new(3.5, 3.0, 1.0)),
        turned(&ball, DVec3::new(0.5, 1.4, 0.9), DVec3::new(3.5, 3.0, 1.0)),
    ];
    instances.extend(plane.then(|| turned(&floor, DVec3::ONE, DVec3::new(2.0, 1.0, 2.5))));
    instances
}

/// In a wave or alone, in any structure, with every surface there or some: the same hits, bit for bit, which are those
/// of the nearest among all instances asked one by one.
#[test]
fn shapes_among_meshes_are_hit_alike_in_every_structure() {
    for plane in [false, true] {
        let accel = Accel::build(scene(AccelKind::default(), plane));
        assert!(!accel.others && !accel.deep && accel.unbounded.len() == usize::from(plane));
        let wave = wave(20_000, 17);
        check_wave(&accel, &wave, &Solid);
        check_wave(&accel, &wave, &Sieve);
        let answers = |accel: &Accel| {
            let mut answers = vec![[NO_HIT; 2]; wave.0.len()];
            accel.nearest_of(&wave, &Solid, |i, hit| answers[i][0] = *hit);
            accel.nearest_of(&wave, &Sieve, |i, hit| answers[i][1] = *hit);
            answers
        };
        let want = answers(&accel);
        for kind in AccelKind::ALL {
            assert!(answers(&Accel::build(scene(kind, plane))) == want, "{}", kind.name());
        }
        let of = |row: u32| want.iter().filter(|hits| hits[0].instance == row).count();
        let shapes = if plane { vec![0, 2, 4, 5, 7] } else { vec![0, 2, 4, 5] };
        assert!(
            shapes.iter().all(|&row| of(row) > 20) && of(1) > 500 && of(6) == 0,
            "{:?}",
            [0, 1, 2, 3, 4, 5, 6, 7].map(of)
        );
        let instances = scene(AccelKind::default(), plane);
        for (index, &(origin, direction, t_max)) in wave.0.iter().enumerate() {
            let mut nearest = NO_HIT;
            for (row, one) in instances.iter().enumerate() {
                let alone = Accel::build(vec![one.clone()]);
                let hit = alone.nearest(origin, direction, t_max, 0, &Solid, &mut Stacks::default());
                if hit.t < nearest.t {
                    nearest = Hit { instance: row as u32, ..hit };
                }
            }
            assert_eq!(want[index][0], nearest, "ray {index}");
        }
    }
}

/// One shape, or one plane, or both, are a scene; the plane has no part in its size.
#[test]
fn shapes_alone_are_a_scene() {
    let [ball, floor] = [Shape::Sphere { radius: 4.0 }, Shape::Plane].map(sieved_shape);
    let of = |rows: &[&Arc<Blas>]| Accel::build(rows.iter().map(|blas| placed(blas, 0.5, 1.0)).collect());
    assert_eq!(of(&[&floor]).bounds(), None);
    let (lower, upper) = of(&[&floor, &ball]).bounds().unwrap();
    assert!(lower.iter().all(|x| (x + 1.0).abs() < 1e-5) && upper.iter().all(|x| (x - 3.0).abs() < 1e-5));
    for rows in [&[&ball][..], &[&floor], &[&ball, &floor]] {
        check_wave(&of(rows), &wave(500, 3), &Solid);
        check_wave(&of(rows), &wave(500, 3), &Sieve);
    }
    let looking_down = Wave(vec![([50.0, 3.0, 50.0], [0.0, -1.0, 0.0], f32::INFINITY)]);
    of(&[&ball, &floor]).nearest_of(&looking_down, &Solid, |_, hit| assert_eq!((hit.t, hit.instance), (2.0, 1)));
}

/// A disc in the plane of two merged meshes: whichever instance comes first is hit, in a wave and alone, bit for bit.
#[test]
fn at_equal_distance_the_earlier_instance_is_hit_whether_shape_or_mesh() {
    let disc = Arc::new(Blas::of_shape(Shape::Disc { radius: 4.0 }));
    let mesh = |x: f32| Arc::new(Blas::build(&[[[x, 0.0, -3.0], [x, 0.0, 3.0], [x + 2.0, 0.0, 0.0]]]));
    let [left, right] = [-2.0, 0.0].map(mesh);
    let mut u = numbers(3);
    let down = (0..500).map(|_| ([4.0 * u() - 2.0, 3.0, 2.0 * u() - 1.0], [0.0, -1.0, 0.0], f32::INFINITY));
    let wave = Wave(down.collect());
    for order in [[&disc, &left, &right], [&left, &disc, &right], [&left, &right, &disc]] {
        let accel = Accel::build(order.map(|blas| InstanceRef::unmoved(Arc::clone(blas))).to_vec());
        assert!(accel.merged.holds(usize::from(Arc::ptr_eq(order[0], &disc))), "the meshes are merged");
        let one_by_one = order.map(|blas| Accel::build(vec![InstanceRef::unmoved(Arc::clone(blas))]));
        let mut ties = 0;
        accel.nearest_of(&wave, &Solid, |index, hit| {
            let (origin, direction, t_max) = wave.0[index];
            let ask = |accel: &Accel| accel.nearest(origin, direction, t_max, 0, &Solid, &mut Stacks::default());
            assert_eq!(*hit, ask(&accel));
            let distances: [f32; 3] = std::array::from_fn(|row| ask(&one_by_one[row]).t);
            let least = distances.into_iter().fold(f32::INFINITY, f32::min);
            ties += usize::from(distances.iter().filter(|t| **t == least).count() > 1);
            let want = distances.iter().position(|t| *t == least).unwrap();
            assert_eq!((hit.instance, hit.t), (want as u32, least));
        });
        assert!(ties > 100, "{ties}");
    }
}
