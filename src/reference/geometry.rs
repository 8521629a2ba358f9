//! Rays against triangles: Möller–Trumbore, and the textbook's recursive tree.

use glam::{DAffine3, DMat3, DVec3};

use crate::flat::FlatScene;

/// A half-line, of which the part from `t_min` to `t_max` counts.
#[derive(Clone, Copy, Debug)]
pub struct Ray {
    /// m.
    pub origin: DVec3,
    /// Unit length.
    pub direction: DVec3,
    /// Hits must lie beyond, m.
    pub t_min: f64,
    /// Hits must lie before, m.
    pub t_max: f64,
}

/// A triangle in world space.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Triangle {
    /// First corner, m.
    pub p0: DVec3,
    /// Second corner minus first.
    pub e1: DVec3,
    /// Third corner minus first.
    pub e2: DVec3,
    /// Row of the instance.
    pub instance: u32,
    /// Row of the triangle in its mesh.
    pub triangle: u32,
}

/// Where a ray crosses a triangle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// Distance, m.
    pub t: f64,
    /// Weight of the second corner.
    pub b1: f64,
    /// Weight of the third corner.
    pub b2: f64,
    /// Index in [`Bvh::triangles`].
    pub index: usize,
}

impl Triangle {
    /// Twice the area times the normal of the side from which the corners run counter-clockwise.
    pub fn cross(&self) -> DVec3 {
        self.e1.cross(self.e2)
    }

    /// The point of these barycentrics.
    pub fn point(&self, b1: f64, b2: f64) -> DVec3 {
        self.p0 + b1 * self.e1 + b2 * self.e2
    }

    /// Distance and barycentrics at which the ray's line crosses the triangle
    /// (Möller, Trumbore 1997, "Fast, Minimum Storage Ray/Triangle Intersection").
    pub fn intersect(&self, ray: &Ray) -> Option<(f64, f64, f64)> {
        let s = ray.origin - self.p0;
        let s1 = ray.direction.cross(self.e2);
        let s2 = s.cross(self.e1);
        let determinant = s1.dot(self.e1);
        if determinant == 0.0 {
            return None;
        }
        let t = s2.dot(self.e2) / determinant;
        let b1 = s1.dot(s) / determinant;
        let b2 = s2.dot(ray.direction) / determinant;
        (b1 >= 0.0 && b2 >= 0.0 && b1 + b2 <= 1.0 && t > ray.t_min && t < ray.t_max).then_some((t, b1, b2))
    }

    fn bounds(&self) -> Bounds {
        let mut bounds = Bounds::EMPTY;
        for p in [self.p0, self.p0 + self.e1, self.p0 + self.e2] {
            bounds.min = bounds.min.min(p);
            bounds.max = bounds.max.max(p);
        }
        bounds
    }
}

/// World from local space of an instance, and what turns its normals into world space.
pub fn transforms(scene: &FlatScene, instance: u32) -> (DAffine3, DMat3) {
    let m = scene.instances.world_from_local[instance as usize].map(f64::from);
    let world_from_local = DAffine3::from_cols(
        DVec3::new(m[0], m[4], m[8]),
        DVec3::new(m[1], m[5], m[9]),
        DVec3::new(m[2], m[6], m[10]),
        DVec3::new(m[3], m[7], m[11]),
    );
    (world_from_local, world_from_local.matrix3.inverse().transpose())
}

/// All triangles of a scene in world space; those without area are left out.
pub fn world_triangles(scene: &FlatScene) -> Vec<Triangle> {
    let mut triangles = Vec::new();
    for instance in 0..scene.instances.len() as u32 {
        let mesh = &scene.meshes[scene.instances.mesh[instance as usize] as usize];
        let (world_from_local, _) = transforms(scene, instance);
        for triangle in 0..mesh.triangles.len() as u32 {
            let corner = |p: [f32; 3]| world_from_local.transform_point3(DVec3::from_array(p.map(f64::from)));
            let [p0, p1, p2] = mesh.corners(triangle).map(corner);
            let triangle = Triangle { p0, e1: p1 - p0, e2: p2 - p0, instance, triangle };
            if triangle.cross() != DVec3::ZERO {
                triangles.push(triangle);
            }
        }
    }
    triangles
}

/// An axis-aligned box.
#[derive(Clone, Copy, Debug)]
struct Bounds {
    min: DVec3,
    max: DVec3,
}

impl Bounds {
    const EMPTY: Self = Self { min: DVec3::INFINITY, max: DVec3::NEG_INFINITY };

    fn join(self, other: Self) -> Self {
        Self { min: self.min.min(other.min), max: self.max.max(other.max) }
    }

    fn half_area(&self) -> f64 {
        let d = self.max - self.min;
        d.x * d.y + d.y * d.z + d.z * d.x
    }

    /// Where the ray enters the box, if it does before `t_max`.
    fn enter(&self, ray: &Ray, t_max: f64) -> Option<f64> {
        let (mut near, mut far) = (ray.t_min, t_max);
        for axis in 0..3 {
            let (o, d, min, max) = (ray.origin[axis], ray.direction[axis], self.min[axis], self.max[axis]);
            if d == 0.0 {
                if o < min || o > max {
                    return None;
                }
                continue;
            }
            let (t0, t1) = ((min - o) / d, (max - o) / d);
            near = near.max(t0.min(t1));
            far = far.min(t0.max(t1));
        }
        // Wider than three roundings, so that a triangle in a face of its box is not lost.
        (near <= far + 1e-14 * far.abs()).then_some(near)
    }
}

#[derive(Debug)]
enum Children {
    Leaf(std::ops::Range<usize>),
    Pair(Box<[Node; 2]>),
}

#[derive(Debug)]
struct Node {
    bounds: Bounds,
    children: Children,
}

/// A tree of boxes over triangles.
#[derive(Debug)]
pub struct Bvh {
    /// In the order of the tree's leaves.
    pub triangles: Vec<Triangle>,
    root: Option<Node>,
}

impl Bvh {
    /// Splits by the surface area heuristic, tried between every two centroids along each axis.
    pub fn new(mut triangles: Vec<Triangle>) -> Self {
        let root = (!triangles.is_empty()).then(|| build(&mut triangles, 0));
        Self { triangles, root }
    }

    /// The nearest crossing that `accept` takes; at equal `t` the smaller (instance, triangle).
    ///
    /// `accept` is asked at most once per triangle, in no particular order.
    pub fn intersect(&self, ray: &Ray, accept: &mut impl FnMut(&Hit) -> bool) -> Option<Hit> {
        let mut nearest = None;
        if let Some(root) = &self.root {
            self.intersect_node(ray, root, &mut nearest, accept);
        }
        nearest
    }

    fn intersect_node(&self, ray: &Ray, node: &Node, nearest: &mut Option<Hit>, accept: &mut impl FnMut(&Hit) -> bool) {
        match &node.children {
            Children::Leaf(range) => {
                for index in range.clone() {
                    let Some((t, b1, b2)) = self.triangles[index].intersect(ray) else { continue };
                    let hit = Hit { t, b1, b2, index };
                    if nearest.is_none_or(|n| self.is_before(&hit, &n)) && accept(&hit) {
                        *nearest = Some(hit);
                    }
                }
            }
            Children::Pair(pair) => {
                let t_max = |nearest: &Option<Hit>| nearest.map_or(ray.t_max, |hit| hit.t);
                let enter = |child: &Node, nearest: &Option<Hit>| child.bounds.enter(ray, t_max(nearest));
                let [left, right] = &**pair;
                let swap = match (enter(left, nearest), enter(right, nearest)) {
                    (Some(a), Some(b)) => b < a,
                    (a, _) => a.is_none(),
                };
                for child in if swap { [right, left] } else { [left, right] } {
                    if enter(child, nearest).is_some() {
                        self.intersect_node(ray, child, nearest, accept);
                    }
                }
            }
        }
    }

    fn is_before(&self, a: &Hit, b: &Hit) -> bool {
        let key = |hit: &Hit| (self.triangles[hit.index].instance, self.triangles[hit.index].triangle);
        a.t < b.t || (a.t == b.t && key(a) < key(b))
    }

    /// The largest coordinate of any corner, m.
    pub fn scale(&self) -> f64 {
        self.root.as_ref().map_or(0.0, |root| root.bounds.min.abs().max(root.bounds.max.abs()).max_element())
    }
}

/// `first` is the index of `triangles[0]` in the whole.
fn build(triangles: &mut [Triangle], first: usize) -> Node {
    const LEAF: usize = 4;
    let bounds = triangles.iter().fold(Bounds::EMPTY, |b, t| b.join(t.bounds()));
    let count = triangles.len();
    if count <= LEAF {
        return Node { bounds, children: Children::Leaf(first..first + count) };
    }
    let centroid = |t: &Triangle, axis: usize| 3.0 * t.p0[axis] + t.e1[axis] + t.e2[axis];
    let sort = |triangles: &mut [Triangle], axis: usize| {
        triangles.sort_by(|a, b| centroid(a, axis).total_cmp(&centroid(b, axis)));
    };
    let mut best = (f64::INFINITY, 0, count / 2);
    for axis in 0..3 {
        sort(triangles, axis);
        let mut right = vec![0.0; count];
        let mut sweep = Bounds::EMPTY;
        for i in (1..count).rev() {
            sweep = sweep.join(triangles[i].bounds());
            right[i] = sweep.half_area() * (count - i) as f64;
        }
        let mut sweep = Bounds::EMPTY;
        for i in 1..count {
            sweep = sweep.join(triangles[i - 1].bounds());
            let cost = sweep.half_area() * i as f64 + right[i];
            if cost < best.0 {
                best = (cost, axis, i);
            }
        }
    }
    let (_, axis, mut split) = best;
    // Equal boxes cost the same wherever they are split; never let such a heap grow a chain.
    if split.min(count - split) < count / 64 {
        split = count / 2;
    }
    sort(triangles, axis);
    let (left, right) = triangles.split_at_mut(split);
    Node { bounds, children: Children::Pair(Box::new([build(left, first), build(right, first + split)])) }
}
