//! The tree against all triangles one by one.

use glam::DVec3;

use crate::reference::{
    Rng,
    geometry::{Bvh, Hit, Ray, Triangle},
};

fn vector(rng: &mut Rng) -> DVec3 {
    DVec3::new(rng.uniform(), rng.uniform(), rng.uniform()) * 2.0 - 1.0
}

fn brute(bvh: &Bvh, ray: &Ray, accept: impl Fn(&Hit) -> bool) -> Option<Hit> {
    let hits = bvh.triangles.iter().enumerate().filter_map(|(index, triangle)| {
        triangle.intersect(ray).map(|(t, b1, b2)| Hit { t, b1, b2, index }).filter(&accept)
    });
    hits.min_by(|a, b| {
        let key = |hit: &Hit| (bvh.triangles[hit.index].instance, bvh.triangles[hit.index].triangle);
        a.t.total_cmp(&b.t).then(key(a).cmp(&key(b)))
    })
}

/// Long, small, coplanar and doubled triangles; rays along axes and at random, long and short.
#[test]
fn tree_finds_what_brute_force_finds() {
    let mut rng = Rng::new(7, 0);
    let mut triangles = Vec::new();
    for i in 0..600 {
        let size = [0.02, 0.3, 2.0][i % 3];
        let (mut p0, mut e1, mut e2) = (vector(&mut rng), size * vector(&mut rng), size * vector(&mut rng));
        if i % 5 == 0 {
            (p0.y, e1.y, e2.y) = (0.25, 0.0, 0.0);
        }
        triangles.push(Triangle { p0, e1, e2, instance: (i % 2) as u32, triangle: i as u32 });
        if i % 7 == 0 {
            triangles.push(Triangle { p0, e1, e2, instance: 1, triangle: 1000 + i as u32 });
        }
    }
    let bvh = Bvh::new(triangles);
    let mut hits = 0;
    for i in 0..4000 {
        let direction = if i % 4 == 0 { DVec3::AXES[i / 4 % 3] } else { vector(&mut rng).normalize() };
        let t_max = if i % 3 == 0 { 0.5 } else { f64::INFINITY };
        let ray = Ray { origin: 1.5 * vector(&mut rng), direction, t_min: 0.0, t_max };
        let odd = |hit: &Hit| i % 2 == 0 || bvh.triangles[hit.index].triangle % 2 == 1;
        let hit = bvh.intersect(&ray, &mut |hit| odd(hit));
        assert_eq!(hit, brute(&bvh, &ray, odd), "ray {i}");
        hits += usize::from(hit.is_some());
    }
    assert!(hits > 500, "only {hits} rays hit anything");
}

#[test]
fn tree_without_triangles_is_never_hit() {
    let ray = Ray { origin: DVec3::ZERO, direction: DVec3::X, t_min: 0.0, t_max: f64::INFINITY };
    assert_eq!(Bvh::new(Vec::new()).intersect(&ray, &mut |_| true), None);
}
