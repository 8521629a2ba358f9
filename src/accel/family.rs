//! What holds for every structure: it gives exactly the hits of brute force, whatever the mesh and the ray.

use std::{f32::consts::TAU, sync::Arc};

use super::{
    Accel, Blas, Brute, Bsp, Bvh2, Counters, Grid, InstanceRef, KdTree, Nearest, Obb, Octree, Ray, RayList, Solid,
    Structure, TriangleHit, Work,
    space::{Bounds, Soup, overlaps},
};

pub(super) type Triangles = Vec<[[f32; 3]; 3]>;

/// xorshift: enough to scatter triangles and rays.
pub(super) fn numbers(mut state: u64) -> impl FnMut() -> f32 {
    move || {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        (state >> 40) as f32 / 16_777_216.0
    }
}

fn add(a: [f32; 3], b: [f32; 3]) -> [f32; 3] {
    std::array::from_fn(|axis| a[axis] + b[axis])
}

fn mix(a: [f32; 3], b: [f32; 3], share: f32) -> [f32; 3] {
    std::array::from_fn(|axis| a[axis] + share * (b[axis] - a[axis]))
}

/// Triangles of a size scattered in the unit cube.
pub(super) fn soup(count: usize, size: f32, seed: u64) -> Triangles {
    let mut u = numbers(seed);
    let mut point = |spread: f32| [u() * spread, u() * spread, u() * spread];
    (0..count)
        .map(|_| {
            let base = point(1.0);
            [0, 1, 2].map(|_| add(base, point(size)))
        })
        .collect()
}

/// A closed torus of 2 · `around` · `about` triangles.
pub(super) fn torus(around: usize, about: usize) -> Triangles {
    let at = |i: usize, j: usize| {
        let (a, b) = (TAU * (i % around) as f32 / around as f32, TAU * (j % about) as f32 / about as f32);
        let r = 1.0 + 0.4 * b.cos();
        [r * a.cos(), r * a.sin(), 0.4 * b.sin()]
    };
    let quads = (0..around).flat_map(|i| (0..about).map(move |j| (i, j)));
    quads
        .flat_map(|(i, j)| {
            let [a, b, c, d] = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
            [[a, b, c], [a, c, d]]
        })
        .collect()
}

/// The twelve triangles of a box.
fn cuboid(lower: [f32; 3], upper: [f32; 3]) -> Triangles {
    let corner = |bits: usize| std::array::from_fn(|axis| [lower, upper][bits >> axis & 1][axis]);
    let faces = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    faces
        .iter()
        .flat_map(|face| {
            let [a, b, c, d] = face.map(corner);
            [[a, b, c], [a, c, d]]
        })
        .collect()
}

/// Boxes side by side, sharing planes, edges and corners.
fn city() -> Triangles {
    let blocks = (0..6).flat_map(|x| (0..6).map(move |y| (x as f32, y as f32)));
    blocks.flat_map(|(x, y)| cuboid([x, y, 0.0], [x + 1.0, y + 1.0, 1.0 + (x * 7.0 + y * 3.0) % 4.0])).collect()
}

/// A flat square of quads across an axis.
pub(super) fn floor(across: usize, quads: usize) -> Triangles {
    let at = |i: usize, j: usize| {
        let mut p = [0.25; 3];
        p[(across + 1) % 3] = i as f32 / quads as f32;
        p[(across + 2) % 3] = j as f32 / quads as f32;
        p
    };
    let places = (0..quads).flat_map(|i| (0..quads).map(move |j| (i, j)));
    places
        .flat_map(|(i, j)| {
            let [a, b, c, d] = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
            [[a, b, c], [a, c, d]]
        })
        .collect()
}

/// A small torus of many triangles in a large box of few.
pub(super) fn teapot_in_a_stadium(around: usize, about: usize) -> Triangles {
    let mut triangles = cuboid([-500.0, -500.0, -1.0], [500.0, 500.0, 400.0]);
    triangles.extend(torus(around, about));
    triangles
}

fn placed(mut triangles: Triangles, scale: f32, shift: [f32; 3]) -> Triangles {
    for corner in triangles.iter_mut().flatten() {
        *corner = add(corner.map(|x| x * scale), shift);
    }
    triangles
}

/// Every kind of mesh that has ever been hard on a tree or a grid.
pub(super) fn scenes() -> Vec<(&'static str, Triangles)> {
    let point = [[0.5; 3]; 3];
    let one = [[0.0, 0.0, 0.0], [1.0, 0.25, 0.0], [0.0, 1.0, 0.5]];
    let mut uneven = soup(300, 0.01, 3);
    uneven.extend(soup(20, 2.0, 4));
    let mut twice = soup(50, 0.4, 5);
    twice.extend(twice.clone());
    twice.extend([point; 5]);
    let fan = (0..200).map(|i| {
        let [a, b] = [i, i + 1].map(|i| TAU * i as f32 / 200.0);
        [[0.1, 0.2, 0.3], [a.cos(), a.sin(), 0.0], [b.cos(), b.sin(), 0.0]]
    });
    let needles = soup(200, 1.0, 6).into_iter().map(|[a, b, _]| [a, b, add(b, [1e-4, 2e-4, -1e-4])]);
    let stretched = |spread: [f32; 3]| {
        let mut triangles = soup(200, 0.2, 7);
        triangles.iter_mut().flatten().for_each(|p| (0..3).for_each(|axis| p[axis] *= spread[axis]));
        triangles
    };
    vec![
        ("nothing", Vec::new()),
        ("a point", vec![point; 20]),
        ("one triangle", vec![one]),
        ("one triangle, 100 times", vec![one; 100]),
        ("soup", soup(500, 0.15, 1)),
        ("large triangles that cross", soup(150, 1.0, 2)),
        ("uneven sizes", uneven),
        ("everything twice", twice),
        ("fan", fan.collect()),
        ("needles", needles.collect()),
        ("torus", torus(24, 16)),
        ("torus far away", placed(torus(24, 16), 1.0, [1e5, -1e5, 1e5])),
        ("tiny torus", placed(torus(24, 16), 1e-5, [0.0; 3])),
        ("tiny torus near", placed(torus(24, 16), 1e-5, [1.0, 2.0, 3.0])),
        ("huge torus", placed(torus(24, 16), 1e9, [0.0; 3])),
        ("boxes", city()),
        ("boxes far away", placed(city(), 1.0, [1e5; 3])),
        ("floor across x", floor(0, 8)),
        ("floor across y", floor(1, 8)),
        ("floor across z", floor(2, 8)),
        ("long", stretched([1e4, 1.0, 1.0])),
        ("flat", stretched([1.0, 1.0, 1e-4])),
        ("teapot in a stadium", teapot_in_a_stadium(24, 16)),
    ]
}

/// Rays for a mesh: through it at random, at its corners and edges, along axes through its corners, from on it, from
/// in it, and from far outside.
pub(super) fn rays(triangles: &[[[f32; 3]; 3]], count: usize, seed: u64) -> Vec<Ray> {
    let mut u = numbers(seed);
    let corners = triangles.iter().flatten();
    let lower = corners.clone().fold([f32::MAX; 3], |a, b| std::array::from_fn(|i| a[i].min(b[i])));
    let upper = corners.fold([f32::MIN; 3], |a, b| std::array::from_fn(|i| a[i].max(b[i])));
    let (lower, upper) = if triangles.is_empty() { ([0.0; 3], [1.0; 3]) } else { (lower, upper) };
    let largest = (0..3).fold(0.0, |most: f32, i| most.max(upper[i] - lower[i]));
    let mut made = Vec::new();
    while made.len() < count {
        let case = made.len();
        let mut inside = || [0, 1, 2].map(|i| lower[i] + (upper[i] - lower[i]) * u());
        let (p, q) = (inside(), inside());
        let triangle = triangles.get((u() * triangles.len() as f32) as usize).copied().unwrap_or([[0.5; 3]; 3]);
        let other = triangles.get((u() * triangles.len() as f32) as usize).copied().unwrap_or([[0.5; 3]; 3]);
        let target = match case % 5 {
            0 => q,
            1 => triangle[0],
            2 => mix(triangle[0], triangle[1], u()),
            3 => mix(triangle[2], triangle[0], 0.5),
            _ => mix(mix(triangle[0], triangle[1], 0.4), triangle[2], u()),
        };
        let away = [u() - 0.5, u() - 0.5, u() - 0.5];
        let from = |times: f32| -> [f32; 3] { std::array::from_fn(|i| target[i] + away[i] * times * largest) };
        let axis = (u() * 3.0) as usize;
        let along = |sign: f32| -> [f32; 3] { std::array::from_fn(|i| if i == axis { sign } else { 0.0 * sign }) };
        let sign = if u() < 0.5 { 1.0 } else { -1.0 };
        let to = |origin: [f32; 3]| Ray::new(origin, std::array::from_fn(|i| target[i] - origin[i]));
        let ray = match case % 9 {
            0 => to(from(3.0)),
            1 => to(p),
            2 => to(other[1]),
            3 => to(from(100.0)),
            4 => to(from(10_000.0)),
            5 => {
                let direction = along(sign);
                Ray::new(std::array::from_fn(|i| target[i] - 2.0 * largest * direction[i]), direction)
            }
            6 => Ray::new(target, along(sign)),
            7 => {
                // In a plane across an axis, through a corner.
                let mut origin = from(2.0);
                origin[axis] = target[axis];
                to(origin)
            }
            _ => {
                let mut origin = p;
                origin[axis] = other[2][axis];
                Ray::new(origin, std::array::from_fn(|i| if i == axis { 0.0 } else { away[i] }))
            }
        };
        if ray.direction != [0.0; 3] {
            made.push(ray);
        } else {
            made.push(Ray::new(p, along(sign)));
        }
    }
    made
}

/// Leaves cover the box of the mesh and do not overlap, and refer to the triangles that are in them.
#[track_caller]
pub(super) fn check_leaves(name: &str, soup: &Soup, leaves: &[(Bounds, Vec<u32>)]) {
    let mut u = numbers(17);
    let size = soup.bounds.size();
    let largest = size[0].max(size[1]).max(size[2]);
    for _ in 0..200 {
        let p: [f32; 3] =
            std::array::from_fn(|axis| (f64::from(soup.bounds.lower[axis]) + size[axis] * f64::from(u())) as f32);
        let holds = |(cell, _): &&(Bounds, Vec<u32>)| {
            let holds = |axis: usize| {
                let last = cell.upper[axis] >= soup.bounds.upper[axis];
                cell.lower[axis] <= p[axis] && (p[axis] < cell.upper[axis] || last)
            };
            (0..3).all(holds)
        };
        assert_eq!(leaves.iter().filter(holds).count(), 1, "{name}: leaves that hold {p:?}");
    }
    // Which leaves a triangle that only touches them belongs to is not said; nor what is rounded far from zero.
    let farthest = soup.bounds.lower.iter().chain(&soup.bounds.upper).fold(0.0, |most: f32, x| most.max(x.abs()));
    let touch = 1e-5 * largest + f64::from(farthest * f32::EPSILON);
    let mut overlapping = 0;
    for (cell, references) in leaves {
        let half = cell.size().map(|size| 0.5 * size);
        let center = std::array::from_fn(|axis| f64::from(cell.lower[axis]) + half[axis]);
        let mut referred = vec![false; soup.triangles.len()];
        references.iter().for_each(|&reference| referred[reference as usize] = true);
        assert_eq!(
            referred.iter().filter(|&&referred| referred).count(),
            references.len(),
            "{name}: referred to twice"
        );
        for (index, (_, corners)) in soup.triangles.iter().enumerate() {
            let within = |pad: f64| {
                let half = half.map(|half| half + pad);
                half.iter().all(|&half| half > 0.0) && overlaps(corners, center, half)
            };
            if referred[index] {
                let pad = half.iter().fold(touch, |pad: f64, half| pad.max(half / 8.0));
                assert!(within(pad + soup.blur(index)), "{name}: triangle {index} is not in {cell:?}");
                overlapping += 1;
            } else {
                assert!(!within(-touch), "{name}: triangle {index} is missing in {cell:?}");
            }
        }
    }
    assert!(overlapping >= soup.triangles.len());
}

/// What a structure says that brute force does not, in words; `None` if they agree on every ray.
fn disagreement(structure: &impl Structure, truth: &Brute, rays: &[Ray]) -> Option<String> {
    let everything = |_: u32, _: &TriangleHit| true;
    let evens = |row: u32, _: &TriangleHit| row.is_multiple_of(2);
    fn nearest(structure: &impl Structure, ray: &Ray, t: f32, accept: impl Fn(u32, &TriangleHit) -> bool) -> Nearest {
        let mut best = Nearest::none(t);
        structure.nearest(ray, &mut best, accept, &mut ());
        best
    }
    for (id, ray) in rays.iter().enumerate() {
        let want = nearest(truth, ray, f32::INFINITY, everything);
        let got = nearest(structure, ray, f32::INFINITY, everything);
        if got != want {
            return Some(format!("ray {id} {ray:?}: {got:?}, not {want:?}"));
        }
        let (got, want_even) = (nearest(structure, ray, 2.0, evens), nearest(truth, ray, 2.0, evens));
        if got != want_even {
            return Some(format!("ray {id} to 2, even rows {ray:?}: {got:?}, not {want_even:?}"));
        }
        for t_max in [f32::INFINITY, want.t, want.t.next_down(), 1.0] {
            let got = structure.occluded(ray, t_max, everything, &mut ());
            if got != truth.occluded(ray, t_max, everything, &mut ()) {
                return Some(format!("ray {id} to {t_max} {ray:?}: occluded {got}"));
            }
        }
    }
    None
}

#[track_caller]
fn check_agrees_with_brute_force<S: Structure>() {
    for (name, triangles) in scenes() {
        let (structure, truth) = (S::build(&triangles), Brute::build(&triangles));
        let found = disagreement(&structure, &truth, &rays(&triangles, 2000, 11));
        assert_eq!(found, None, "{} of {name}", S::NAME);
        assert!(structure.references() >= truth.references() && structure.bytes() >= structure.references() * 4);
    }
}

#[test]
fn every_structure_finds_exactly_what_brute_force_finds() {
    check_agrees_with_brute_force::<Bvh2>();
    check_agrees_with_brute_force::<KdTree>();
    check_agrees_with_brute_force::<Grid>();
    check_agrees_with_brute_force::<Octree>();
    check_agrees_with_brute_force::<Bsp>();
    check_agrees_with_brute_force::<Obb>();
}

/// The same of waves through the eight-wide tree, whose rays are in flight together.
///
/// Only of rays without end: its boxes are as thin as they are, and a ray that ends within rounding of a hit may miss it.
#[test]
fn waves_find_exactly_what_brute_force_finds() {
    for (name, triangles) in scenes() {
        let truth = Brute::build(&triangles);
        let only = InstanceRef::unmoved(Arc::new(Blas::build(&triangles)));
        let accel = Accel::build(vec![only]);
        let list: Vec<_> = rays(&triangles, 2000, 12).iter().map(|r| (r.origin, r.direction, f32::INFINITY)).collect();
        let list = RayList(&list);
        let mut answered = 0;
        accel.nearest_of(&list, &Solid, |index, hit| {
            let (origin, direction, t_max) = list.0[index];
            let mut want = Nearest::none(t_max);
            truth.nearest(&Ray::new(origin, direction), &mut want, |_, _| true, &mut ());
            let got = Nearest { t: hit.t, triangle: hit.triangle, b1: hit.b1, b2: hit.b2, back: hit.back };
            assert_eq!(got, want, "{name}, ray {index}");
            answered += 1;
        });
        assert_eq!(answered, list.0.len());
        accel.occluded_of(&list, &Solid, |index, occluded| {
            let (origin, direction, t_max) = list.0[index];
            let want = truth.occluded(&Ray::new(origin, direction), t_max, |_, _| true, &mut ());
            assert_eq!(occluded, want, "{name}, ray {index}");
        });
    }
}

/// A structure that has lost one triangle.
struct Lossy<S>(S);

impl<S: Structure> Structure for Lossy<S> {
    const NAME: &'static str = "lossy";
    fn build(triangles: &[[[f32; 3]; 3]]) -> Self {
        let mut triangles = triangles.to_vec();
        if let Some(lost) = triangles.get_mut(7) {
            *lost = [[0.0; 3]; 3];
        }
        Self(S::build(&triangles))
    }
    fn bytes(&self) -> usize {
        self.0.bytes()
    }
    fn references(&self) -> usize {
        self.0.references()
    }
    fn nearest(
        &self,
        ray: &Ray,
        best: &mut Nearest,
        accept: impl Fn(u32, &TriangleHit) -> bool,
        counters: &mut impl Counters,
    ) {
        self.0.nearest(ray, best, accept, counters);
    }
    fn occluded(
        &self,
        ray: &Ray,
        t_max: f32,
        accept: impl Fn(u32, &TriangleHit) -> bool,
        counters: &mut impl Counters,
    ) -> bool {
        self.0.occluded(ray, t_max, accept, counters)
    }
}

#[test]
fn the_comparison_with_brute_force_sees_that_one_triangle_is_lost() {
    let triangles = torus(24, 16);
    let truth = Brute::build(&triangles);
    let rays = rays(&triangles, 20_000, 12);
    assert_eq!(disagreement(&Bvh2::build(&triangles), &truth, &rays), None);
    assert!(disagreement(&Lossy::<Bvh2>::build(&triangles), &truth, &rays).is_some());
}

/// Work for 1,000 rays from around the torus to points on it.
fn work<S: Structure>(triangles: &[[[f32; 3]; 3]]) -> Work {
    let structure = S::build(triangles);
    let mut work = Work::default();
    let mut u = numbers(13);
    let targets = torus(50, 20);
    for _ in 0..1000 {
        let target = targets[(u() * 2000.0) as usize][0];
        let origin: [f32; 3] = std::array::from_fn(|axis| target[axis] + 5.0 * (u() - 0.5));
        let ray = Ray::new(origin, std::array::from_fn(|axis| target[axis] - origin[axis]));
        structure.nearest(&ray, &mut Nearest::none(f32::INFINITY), |_, _| true, &mut work);
    }
    work
}

/// Brute force tests all n triangles, a tree a few dozen; in the grid the whole "teapot" is in a few cells.
#[test]
fn the_work_is_as_the_theory_says() {
    let triangles = teapot_in_a_stadium(100, 40);
    let count = triangles.len() as u64;
    assert_eq!(work::<Brute>(&triangles), Work { triangles: 1000 * count, ..Work::default() });
    let [bvh2, kdtree, octree] = [work::<Bvh2>(&triangles), work::<KdTree>(&triangles), work::<Octree>(&triangles)];
    for tree in [bvh2, kdtree, octree] {
        assert!(tree.triangles < 1000 * 40 && tree.nodes < 1000 * 150, "{tree:?}");
    }
    let grid = work::<Grid>(&triangles);
    assert!(grid.triangles > 20 * kdtree.triangles, "{grid:?} {kdtree:?}");
}
