//! What every acceleration structure offers: to be built over triangles, and to be asked by one ray.
//!
//! A structure finds candidates; whether a triangle is hit is always decided by [`super::intersect`] or its SIMD
//! twin, so that all structures give the same hits, bit for bit.

use super::{Ray, TriangleHit};

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

/// Counts the work of a walk; `()` counts nothing and compiles to nothing.
pub trait Counters {
    /// A node, cell or plane was visited.
    fn node(&mut self);
    /// So many triangles were tested.
    fn triangles(&mut self, count: usize);
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
}

impl Counters for Work {
    fn node(&mut self) {
        self.nodes += 1;
    }
    fn triangles(&mut self, count: usize) {
        self.triangles += count as u64;
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

    /// True if the ray meets something up to `t_max` that is `accept`ed.
    fn occluded(
        &self,
        ray: &Ray,
        t_max: f32,
        accept: impl Fn(u32, &TriangleHit) -> bool,
        counters: &mut impl Counters,
    ) -> bool;
}

/// `nearest` and `occluded` of a [`Structure`] with a `soup` and a `walk`.
///
/// A walk is given the ray, where it ends, the counters, and what is done with the references of each leaf that it comes
/// to. That returns where the ray ends now, below zero to end the walk.
macro_rules! asked_by_walking {
    () => {
        fn nearest(
            &self,
            ray: &Ray,
            best: &mut Nearest,
            accept: impl Fn(u32, &TriangleHit) -> bool,
            counters: &mut impl Counters,
        ) {
            self.walk(ray, best.t, counters, |references, counters| {
                self.soup.nearest(references, ray, best, &accept, counters);
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
                found = self.soup.occluded(references, ray, t_max, &accept, counters);
                if found { -1.0 } else { t_max }
            });
            found
        }
    };
}

pub(super) use asked_by_walking;
