//! One mesh in the structure chosen for it.
//!
//! The eight-wide tree is the one that waves of rays go through, and which the top level looks into; its memory is read
//! without asking which structure it is. The others are asked ray by ray.

use std::time::{Duration, Instant};

use obvhs::aabb::Aabb;
use rayon::prelude::*;

use super::{
    Brute, Bsp, Bvh2, Grid, KdTree, Nearest, Octree, Ray, Structure, TriangleBlock, TriangleHit,
    bvh8::{Bvh8, LEAF, Quality},
    space::{Bounds, blurred, covered},
    triangle::has_area,
};
use crate::simd::LANES;

/// The structure that triangles are put into. All give the same hits, bit for bit.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum AccelKind {
    /// Boxes, eight to a node; the fastest.
    Bvh8(Quality),
    /// Boxes, two to a node.
    Bvh2,
    /// Space halved by planes across the axes.
    KdTree,
    /// Cubes cut into eight.
    Octree,
    /// Space halved by planes of any direction.
    Bsp,
    /// Equal boxes.
    Grid,
    /// None: every triangle is tested.
    Brute,
}

impl Default for AccelKind {
    fn default() -> Self {
        Self::Bvh8(Quality::Good)
    }
}

impl AccelKind {
    /// All of them, the default first.
    pub const ALL: [Self; 7] =
        [Self::Bvh8(Quality::Good), Self::Bvh2, Self::KdTree, Self::Octree, Self::Bsp, Self::Grid, Self::Brute];

    /// As the command line calls it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Bvh8(_) => "bvh8",
            Self::Bvh2 => Bvh2::NAME,
            Self::KdTree => KdTree::NAME,
            Self::Octree => Octree::NAME,
            Self::Bsp => Bsp::NAME,
            Self::Grid => Grid::NAME,
            Self::Brute => Brute::NAME,
        }
    }
}

/// Rays against the triangles of one mesh, in its local space.
#[derive(Clone, Debug)]
pub struct Blas {
    /// The eight-wide tree; without nodes if the triangles are in another structure.
    pub(super) tree: Bvh8,
    /// The other structure, in its place.
    pub(super) other: Option<Other>,
    pub(super) bounds: Aabb,
    /// Triangles with an area.
    triangles: usize,
    build_time: Duration,
}

impl Default for Blas {
    fn default() -> Self {
        Self {
            tree: Bvh8::default(),
            other: None,
            bounds: Aabb::empty(),
            triangles: 0,
            build_time: Duration::default(),
        }
    }
}

impl Blas {
    /// In the default structure, over triangles given by their corners, which must be finite. Those without area are
    /// left out.
    pub fn build(triangles: &[[[f32; 3]; 3]]) -> Self {
        Self::build_as(AccelKind::default(), triangles)
    }

    /// [`Blas::build`], in the structure asked for.
    pub fn build_as(kind: AccelKind, triangles: &[[[f32; 3]; 3]]) -> Self {
        let start = Instant::now();
        let whole = triangles.iter().flatten().fold(Bounds::EMPTY, |all, &corner| all.union(&Bounds::of(&[corner])));
        let covered = covered(&whole);
        let bounds_of = |corners: &[[f32; 3]; 3]| {
            let Bounds { lower, upper } = if has_area(corners) { blurred(corners, covered) } else { Bounds::EMPTY };
            Aabb::new(lower.into(), upper.into())
        };
        let boxes: Vec<Aabb> = triangles.par_iter().map(bounds_of).collect();
        let mut blas = Self {
            // Of all structures alike: the size of the scene is found by it.
            bounds: boxes.iter().fold(Aabb::empty(), |all, one| all.union(one)),
            triangles: boxes.iter().filter(|one| one.valid()).count(),
            ..Self::default()
        };
        if let AccelKind::Bvh8(quality) = kind {
            blas.tree = Bvh8::build(&boxes, quality, LANES, |rows, arena| {
                // In order of rows, so that the block does not depend on how the tree came to it.
                rows.sort_unstable();
                LEAF | TriangleBlock::new(rows.iter().map(|&row| (row, triangles[row as usize]))).store(arena)
            });
        } else {
            drop(boxes);
            blas.other = Other::build(kind, triangles);
        }
        blas.build_time = start.elapsed();
        blas
    }

    /// Bytes held.
    pub fn bytes(&self) -> usize {
        self.tree.bytes() + self.other.as_ref().map_or(0, Other::bytes)
    }

    /// Triangles held in leaves or cells; more than there are where space is divided and not the objects.
    pub fn references(&self) -> usize {
        self.other.as_ref().map_or(self.triangles, Other::references)
    }

    /// Time that building took. Meshes are built at the same time, so the times of several may overlap.
    pub fn build_time(&self) -> Duration {
        self.build_time
    }

    /// The part of [`Blas::build_time`] in which boxes were paired, before the pairs were collapsed to eight boxes to a
    /// node; `None` if this is not an eight-wide tree.
    pub fn binary_time(&self) -> Option<Duration> {
        self.other.is_none().then_some(self.tree.binary_time)
    }

    /// Lowest and highest corner; lowest above highest if there is no triangle.
    pub fn bounds(&self) -> ([f32; 3], [f32; 3]) {
        (self.bounds.min.to_array(), self.bounds.max.to_array())
    }

    /// What the top level refers to, if there is anything: a node or a leaf of the eight-wide tree. Other structures are
    /// a leaf to it, which it cannot open.
    pub(super) fn root(&self) -> Option<u32> {
        if self.other.is_some() { self.bounds.valid().then_some(LEAF) } else { self.tree.root }
    }
}

/// A structure other than the eight-wide tree.
#[derive(Clone, Debug)]
pub(super) enum Other {
    Bvh2(Bvh2),
    KdTree(KdTree),
    Octree(Octree),
    Bsp(Bsp),
    Grid(Grid),
    Brute(Brute),
}

/// Does the same with whichever structure it is.
macro_rules! whichever {
    ($other:expr, $structure:ident => $what:expr) => {
        match $other {
            Other::Bvh2($structure) => $what,
            Other::KdTree($structure) => $what,
            Other::Octree($structure) => $what,
            Other::Bsp($structure) => $what,
            Other::Grid($structure) => $what,
            Other::Brute($structure) => $what,
        }
    };
}

impl Other {
    /// `None` for the eight-wide tree, which is none of these.
    fn build(kind: AccelKind, triangles: &[[[f32; 3]; 3]]) -> Option<Self> {
        Some(match kind {
            AccelKind::Bvh8(_) => return None,
            AccelKind::Bvh2 => Self::Bvh2(Bvh2::build(triangles)),
            AccelKind::KdTree => Self::KdTree(KdTree::build(triangles)),
            AccelKind::Octree => Self::Octree(Octree::build(triangles)),
            AccelKind::Bsp => Self::Bsp(Bsp::build(triangles)),
            AccelKind::Grid => Self::Grid(Grid::build(triangles)),
            AccelKind::Brute => Self::Brute(Brute::build(triangles)),
        })
    }

    fn bytes(&self) -> usize {
        whichever!(self, structure => structure.bytes())
    }

    fn references(&self) -> usize {
        whichever!(self, structure => structure.references())
    }

    /// As [`Structure::nearest`].
    pub fn nearest(&self, ray: &Ray, best: &mut Nearest, accept: impl Fn(u32, &TriangleHit) -> bool) {
        whichever!(self, structure => structure.nearest(ray, best, accept, &mut ()));
    }

    /// As [`Structure::occluded`].
    pub fn occluded(&self, ray: &Ray, t_max: f32, accept: impl Fn(u32, &TriangleHit) -> bool) -> bool {
        whichever!(self, structure => structure.occluded(ray, t_max, accept, &mut ()))
    }
}
