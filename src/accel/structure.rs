//! What every acceleration structure offers: to be built over triangles, and to be asked by one ray.
//!
//! A structure finds candidates; whether a triangle is hit is always decided by [`super::intersect`] or its SIMD
//! twin, so that all structures give the same hits, bit for bit.

use super::{Ray, TriangleHit};
use crate::simd::LANES;

/// What a ray meets first in one mesh.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Nearest {
    /// Nothing beyond it counts: the end of the ray, later the distance of the nearest hit so far.
    pub t: f32,
    /// Row of the triangle, or `u32::MAX`.
    pub triangle: u32,
    /// Barycentric of the second corner.
    pub b1: f32,
    /// Barycentric of the third corner.
    pub b2: f32,
    /// True if the back is met.
    pub back: bool,
}

impl Nearest {
    /// Nothing met on a ray that ends at `t`.
    pub fn none(t: f32) -> Self {
        Self { t, triangle: u32::MAX, b1: 0.0, b2: 0.0, back: false }
    }

    /// Takes a hit if it is nearer, or as near in an earlier row, and `accept`ed.
    #[inline(always)]
    pub fn offer(&mut self, triangle: u32, hit: &TriangleHit, accept: &impl Fn(u32, &TriangleHit) -> bool) {
        if (hit.t < self.t || hit.t == self.t && triangle < self.triangle) && accept(triangle, hit) {
            *self = Self { t: hit.t, triangle, b1: hit.b1, b2: hit.b2, back: hit.back };
        }
    }
}

/// A region that a structure looks at as a whole: a part of space, or what encloses a set of triangles.
#[derive(Clone, Copy, Debug)]
pub struct Cell<'a> {
    /// Regions that this one is in.
    pub depth: usize,
    /// Triangles that a leaf refers to; `None` for what is divided further.
    pub held: Option<usize>,
    /// Where it is.
    pub shape: Shape<'a>,
}

/// The shape of a [`Cell`].
#[derive(Clone, Copy, Debug)]
pub enum Shape<'a> {
    /// Between two corners, the faces across the axes.
    Box {
        /// Lowest coordinates.
        lower: [f32; 3],
        /// Highest coordinates.
        upper: [f32; 3],
    },
    /// A convex body by the corners of its faces.
    Convex(&'a [Vec<[f64; 3]>]),
}

/// Counts the work of a walk; `()` counts nothing and compiles to nothing.
pub trait Counters {
    /// A node, cell or plane was visited.
    fn node(&mut self);
    /// So many triangles were tested.
    fn triangles(&mut self, count: usize);
    /// A test of eight at once had so many to test; asked for only if it counts.
    #[inline(always)]
    fn lanes(&mut self, _used: impl FnOnce() -> usize) {}
}

impl Counters for () {
    #[inline(always)]
    fn node(&mut self) {}
    #[inline(always)]
    fn triangles(&mut self, _: usize) {}
}

/// Work of walks, added up.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Work {
    /// Nodes, cells or planes visited.
    pub nodes: u64,
    /// Triangles tested.
    pub triangles: u64,
    /// Lanes of all tests of eight at once, and those of them that had something to test; of structures that do not test
    /// eight at once, none.
    pub lanes: u64,
    /// See `lanes`.
    pub used_lanes: u64,
}

impl Counters for Work {
    fn node(&mut self) {
        self.nodes += 1;
    }
    fn triangles(&mut self, count: usize) {
        self.triangles += count as u64;
    }
    fn lanes(&mut self, used: impl FnOnce() -> usize) {
        self.lanes += LANES as u64;
        self.used_lanes += used() as u64;
    }
}

/// A way to find which of a mesh's triangles a ray meets.
pub trait Structure: Send + Sync + Sized {
    /// As the command line calls it.
    const NAME: &'static str;

    /// Over triangles by their corners, which must be finite. Those without area are left out.
    fn build(triangles: &[[[f32; 3]; 3]]) -> Self;

    /// Bytes held.
    fn bytes(&self) -> usize;

    /// Triangles held in leaves or cells; more than there are where space is divided and not the objects.
    fn references(&self) -> usize;

    /// Puts into `best` what the ray meets first, if that is nearer than `best.t`. Of hits at the same distance the
    /// one of the smaller row counts. Hits that `accept` refuses are not there.
    fn nearest(
        &self,
        ray: &Ray,
        best: &mut Nearest,
        accept: impl Fn(u32, &TriangleHit) -> bool,
        counters: &mut impl Counters,
    );

    /// Shows the regions that triangles are held in, for pictures; those of a structure without any are none.
    fn cells(&self, _visit: &mut dyn FnMut(Cell)) {}

    /// True if the ray meets something up to `t_max` that is `accept`ed.
    fn occluded(
        &self,
        ray: &Ray,
        t_max: f32,
        accept: impl Fn(u32, &TriangleHit) -> bool,
        counters: &mut impl Counters,
    ) -> bool;
}

/// `nearest` and `occluded` of a [`Structure`] with a `walk` and a soup, `soup` if nothing is said.
///
/// A walk is given the ray, where it ends, the counters, and what is done with the references of each leaf that it comes
/// to. That returns where the ray ends now, below zero to end the walk.
macro_rules! asked_by_walking {
    () => {
        asked_by_walking!(soup);
    };
    ($($soup:ident).+) => {
        fn nearest(
            &self,
            ray: &Ray,
            best: &mut Nearest,
            accept: impl Fn(u32, &TriangleHit) -> bool,
            counters: &mut impl Counters,
        ) {
            self.walk(ray, best.t, counters, |references, counters| {
                self.$($soup).+.nearest(references, ray, best, &accept, counters);
                best.t
            });
        }

        fn occluded(
            &self,
            ray: &Ray,
            t_max: f32,
            accept: impl Fn(u32, &TriangleHit) -> bool,
            counters: &mut impl Counters,
        ) -> bool {
            let mut found = false;
            self.walk(ray, t_max, counters, |references, counters| {
                found = self.$($soup).+.occluded(references, ray, t_max, &accept, counters);
                if found { -1.0 } else { t_max }
            });
            found
        }
    };
}

pub(super) use asked_by_walking;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::accel::{
        Blas, Bsp, Bvh2, Grid, KdTree, Obb, Octree,
        family::{soup, torus},
    };

    fn volume(shape: &Shape) -> f64 {
        match shape {
            Shape::Box { lower, upper } => (0..3).map(|axis| f64::from(upper[axis]) - f64::from(lower[axis])).product(),
            Shape::Convex(faces) => {
                let pyramid = |[a, b, c]: [&[f64; 3]; 3]| {
                    a[0] * (b[1] * c[2] - b[2] * c[1])
                        + a[1] * (b[2] * c[0] - b[0] * c[2])
                        + a[2] * (b[0] * c[1] - b[1] * c[0])
                };
                let of_face = |face: &Vec<[f64; 3]>| -> f64 {
                    face[1..].windows(2).map(|pair| pyramid([&face[0], &pair[0], &pair[1]]) / 6.0).sum()
                };
                faces.iter().map(of_face).sum()
            }
        }
    }

    /// Cells hold as many triangles as the structure refers to; those that divide space fill it, each level within the
    /// one above.
    #[track_caller]
    fn check_cells<S: Structure>(divides_space: bool) {
        for triangles in [torus(20, 12), soup(500, 0.1, 4), Vec::new()] {
            let structure = S::build(&triangles);
            let (mut held, mut leaves, mut whole, mut roots) = (0, 0.0, 0.0, 0);
            structure.cells(&mut |cell| {
                held += cell.held.unwrap_or(0);
                leaves += if cell.held.is_some() { volume(&cell.shape) } else { 0.0 };
                if cell.depth == 0 {
                    whole += volume(&cell.shape);
                    roots += 1;
                }
            });
            assert_eq!(held, structure.references(), "{}", S::NAME);
            assert_eq!(roots > 0, !triangles.is_empty(), "{}", S::NAME);
            if divides_space {
                assert!((leaves - whole).abs() <= 1e-5 * whole, "{}: {leaves} of {whole}", S::NAME);
            } else if roots > 0 {
                assert_eq!(roots, 1, "{}", S::NAME);
            }
        }
    }

    #[test]
    fn cells_are_where_triangles_are_held() {
        check_cells::<Grid>(true);
        check_cells::<Octree>(true);
        check_cells::<KdTree>(true);
        check_cells::<Bsp>(true);
        check_cells::<Bvh2>(false);
        check_cells::<Obb>(false);
        check_cells::<Blas>(false);
    }
}
