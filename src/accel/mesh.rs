//! One mesh in the structure chosen for it.
//!
//! The eight-wide tree is the one that waves of rays go through, and which the top level looks into; its memory is read
//! without asking which structure it is. The others are asked ray by ray.

use std::time::{Duration, Instant};

use obvhs::aabb::Aabb;
use rayon::prelude::*;

use super::{
    Brute, Bsp, Bvh2, Cell, Counters, Grid, KdTree, Nearest, Octree, Ray, Shape, Structure, TriangleHit,
    arena::Granule,
    binary::{SHARE, union},
    bvh8::{Bvh8, KIND, LEAF, Node, Quality, Stack},
    collapse::Leaves,
    leaf::Block,
    opacity::{Opacity, ROW},
    shape::Formula,
    space::{Bounds, blurred, covered},
    triangle::has_area,
};
use crate::{
    simd::{LANES, prefetch},
    world,
};

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

/// Rays against the triangles of one mesh, or against a surface given by a formula, in its local space.
#[derive(Clone, Debug)]
pub struct Blas {
    /// The eight-wide tree; without nodes if the triangles are in another structure.
    pub(super) tree: Bvh8,
    /// The other structure, or the formula, in its place.
    pub(super) other: Option<Other>,
    pub(super) bounds: Aabb,
    /// Triangles given, and rows of those among them that are left out for having no area.
    given: usize,
    left_out: Vec<u32>,
    /// Some triangle does not stop every ray.
    pub(super) asks: bool,
    build_time: Duration,
}

impl Default for Blas {
    fn default() -> Self {
        Self {
            tree: Bvh8::default(),
            other: None,
            bounds: Aabb::empty(),
            given: 0,
            left_out: Vec::new(),
            asks: false,
            build_time: Duration::default(),
        }
    }
}

/// The box around triangles and where their hits may be, if they have an area. `covered` is that of all of them.
fn box_of(corners: &[[f32; 3]; 3], covered: f64) -> Aabb {
    let Bounds { lower, upper } = blurred(corners, covered);
    Aabb::new(lower.into(), upper.into())
}

/// [`covered`] by the rays at triangles.
fn covered_at(triangles: &[[[f32; 3]; 3]]) -> f64 {
    let corners = |part: &[[[f32; 3]; 3]]| part.iter().fold(Bounds::EMPTY, |all, one| all.union(&Bounds::of(one)));
    let parts: Vec<Bounds> = triangles.par_chunks(SHARE).map(corners).collect();
    covered(&parts.iter().fold(Bounds::EMPTY, |all, part| all.union(part)))
}

/// Boxes of triangles; empty where one has no area.
fn boxes_of(triangles: &[[[f32; 3]; 3]]) -> Vec<Aabb> {
    let covered = covered_at(triangles);
    let bounds_of = |one: &[[f32; 3]; 3]| if has_area(one) { box_of(one, covered) } else { Aabb::empty() };
    triangles.par_iter().with_min_len(SHARE).map(bounds_of).collect()
}

/// Rows of triangles that have no area.
fn without_area(triangles: &[[[f32; 3]; 3]]) -> Vec<u32> {
    let rows = triangles.par_iter().enumerate().with_min_len(SHARE);
    rows.filter(|(_, one)| !has_area(one)).map(|(row, _)| row as u32).collect()
}

/// The triangles that leaves are made of.
struct Triangles<'a>(&'a [[[f32; 3]; 3]]);

impl Leaves for Triangles<'_> {
    const MOST: usize = LANES;

    fn granules(count: usize) -> usize {
        Block::granules(count)
    }

    fn write(&self, rows: &mut [u32], place: u32, into: &mut [Granule]) -> u32 {
        // In order of rows, so that the block does not depend on how the tree came to it.
        rows.sort_unstable();
        LEAF | Block::write(rows.iter().map(|&row| (row, self.0[row as usize])), place, into)
    }

    fn prefetch(&self, row: u32) {
        prefetch::<1, _>(self.0, row as usize);
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
        let boxes = boxes_of(triangles);
        let parts: Vec<Aabb> = boxes.par_chunks(SHARE).map(|part| union(part.iter().copied())).collect();
        let mut blas = Self {
            // Of all structures alike: the size of the scene is found by it.
            bounds: union(parts.into_iter()),
            given: triangles.len(),
            left_out: without_area(triangles),
            ..Self::default()
        };
        if let AccelKind::Bvh8(quality) = kind {
            blas.tree = Bvh8::build(&boxes, quality, &Triangles(triangles));
        } else {
            drop(boxes);
            blas.other = Other::build(kind, triangles);
        }
        blas.build_time = start.elapsed();
        blas
    }

    /// Puts the same tree around triangles that have moved, several times as fast as building another, and says whether
    /// that was done. Afterwards the hits are those of a tree built for them; but if neighbours have parted, boxes overlap
    /// and rays take longer, of which [`Blas::cost`] tells.
    ///
    /// It is not done, and nothing is changed, if there is another number of triangles, if some have lost or gained their
    /// area, or if they are in another structure than the eight-wide tree.
    ///
    /// A top level over meshes that were refitted is built anew: [`super::Accel::build`] looks into their trees.
    pub fn refit(&mut self, triangles: &[[[f32; 3]; 3]]) -> bool {
        if self.other.is_some() || triangles.len() != self.given || without_area(triangles) != self.left_out {
            return false;
        }
        let covered = covered_at(triangles);
        self.bounds = self.tree.refit(&|leaf: &mut [Granule], kind| {
            let (mut rows, mut count) = ([0; LANES], 0);
            for row in Block::at(leaf, kind).marked_rows() {
                prefetch::<1, _>(triangles, (row & ROW) as usize);
                (rows[count], count) = (row, count + 1);
            }
            let own = rows[..count].iter().map(|&row| (row, triangles[(row & ROW) as usize]));
            Block::write(own.clone(), 0, &mut leaf[..Block::granules(count)]);
            union(own.map(|(_, corners)| box_of(&corners, covered)))
        });
        true
    }

    /// Steps that a ray through the box around the mesh is expected to take, of nodes and leaves, if nothing stops it: the
    /// surface area heuristic. Zero if the triangles are in another structure than the eight-wide tree.
    pub fn cost(&self) -> f32 {
        let area = self.bounds.half_area();
        if self.tree.root.is_some() && area > 0.0 { self.tree.cost / area } else { 0.0 }
    }

    /// Of a surface given by a formula; there is nothing to build.
    pub fn of_shape(shape: world::Shape) -> Self {
        Self { other: Some(Other::Shape(Formula(shape))), bounds: shape.bounds(), given: 1, ..Self::default() }
    }

    /// It is given by a formula.
    pub(super) fn is_shape(&self) -> bool {
        matches!(self.other, Some(Other::Shape(_)))
    }

    /// It goes on for ever, and is in no box.
    pub(super) fn is_unbounded(&self) -> bool {
        matches!(self.other, Some(Other::Shape(Formula(world::Shape::Plane))))
    }

    /// Bytes held.
    pub fn bytes(&self) -> usize {
        self.tree.bytes() + self.other.as_ref().map_or(0, Other::bytes)
    }

    /// Triangles held in leaves or cells; more than there are where space is divided and not the objects.
    pub fn references(&self) -> usize {
        self.other.as_ref().map_or(self.given - self.left_out.len(), Other::references)
    }

    /// Time that building took. Meshes are built at the same time, so the times of several may overlap.
    pub fn build_time(&self) -> Duration {
        self.build_time
    }

    /// The part of [`Blas::build_time`] in which boxes were paired, before the pairs were collapsed to eight boxes to a
    /// node; `None` if the triangles are in another structure.
    pub fn binary_time(&self) -> Option<Duration> {
        (self.other.is_none() || self.is_shape()).then_some(self.tree.binary_time)
    }

    /// Lowest and highest corner; lowest above highest if there is no triangle.
    pub fn bounds(&self) -> ([f32; 3], [f32; 3]) {
        (self.bounds.min.to_array(), self.bounds.max.to_array())
    }

    /// Says what is known of each triangle's opacity, by its row; without it all are solid.
    pub fn set_opacity(&mut self, of: impl Fn(u32) -> Opacity) {
        let mut asks = false;
        for leaf in self.leaf_references().collect::<Vec<_>>() {
            Block::mark(self.tree.arena.granules_mut(), leaf, |row| {
                let opacity = of(row);
                asks |= opacity != Opacity::Solid;
                opacity
            });
        }
        self.asks = asks || self.other.is_some() && (0..self.given as u32).any(|row| of(row) != Opacity::Solid);
    }

    /// References of the leaves of the eight-wide tree, without what makes them leaves.
    fn leaf_references(&self) -> impl Iterator<Item = u32> {
        let arena = self.tree.arena.granules();
        let mut pending: Vec<u32> = self.tree.root.into_iter().collect();
        std::iter::from_fn(move || {
            loop {
                let reference = pending.pop()?;
                if reference & KIND == LEAF {
                    return Some(reference & !KIND);
                }
                pending.extend(Node::at(arena, reference).boxes().map(|(_, child)| child));
            }
        })
    }

    /// The leaves of the eight-wide tree.
    pub(super) fn leaves(&self) -> impl Iterator<Item = Block<'_>> {
        self.leaf_references().map(|leaf| Block::at(self.tree.arena.granules(), leaf))
    }

    /// What the top level refers to, if there is anything: a node or a leaf of the eight-wide tree. Other structures are
    /// a leaf to it, which it cannot open.
    pub(super) fn root(&self) -> Option<u32> {
        if self.other.is_some() { self.bounds.valid().then_some(LEAF) } else { self.tree.root }
    }
}

/// The eight-wide tree as one of the family; nothing if the triangles are in another structure.
impl Structure for Blas {
    const NAME: &'static str = "bvh8";

    fn build(triangles: &[[[f32; 3]; 3]]) -> Self {
        Self::build(triangles)
    }

    fn bytes(&self) -> usize {
        self.bytes()
    }

    fn references(&self) -> usize {
        self.references()
    }

    fn cells(&self, visit: &mut dyn FnMut(Cell)) {
        let root = self.tree.root.map(|root| (root, self.bounds, 0));
        let mut pending: Vec<_> = root.into_iter().collect();
        while let Some((reference, bounds, depth)) = pending.pop() {
            let arena = self.tree.arena.granules();
            let leaf = reference & KIND == LEAF;
            let held = leaf.then(|| Block::at(arena, reference & !KIND).triangles().len());
            let (lower, upper) = (bounds.min.to_array(), bounds.max.to_array());
            visit(Cell { depth, held, shape: Shape::Box { lower, upper } });
            if !leaf {
                let children = Node::at(arena, reference).boxes();
                pending.extend(children.map(|(bounds, child)| (child, bounds, depth + 1)));
            }
        }
    }

    /// One ray alone, for comparison; waves go through [`super::Accel::nearest_of`].
    fn nearest(
        &self,
        ray: &Ray,
        best: &mut Nearest,
        accept: impl Fn(u32, &TriangleHit) -> bool,
        counters: &mut impl Counters,
    ) {
        let arena = self.tree.arena.granules();
        let (mut t_max, mut tested) = (best.t, 0);
        self.tree.walk::<true>(self.tree.root, ray, &mut t_max, &mut Stack::default(), counters, |block, t_max| {
            let block = Block::at(arena, block);
            tested += LANES;
            let met = block.intersect(ray, *t_max);
            for lane in (0..LANES).filter(|lane| met.hits >> lane & 1 == 1) {
                best.offer(block.row(lane), &met.hit(lane), &accept);
            }
            *t_max = best.t;
            false
        });
        counters.triangles(tested);
    }

    fn occluded(
        &self,
        ray: &Ray,
        t_max: f32,
        accept: impl Fn(u32, &TriangleHit) -> bool,
        counters: &mut impl Counters,
    ) -> bool {
        let arena = self.tree.arena.granules();
        let (mut t_max, mut tested, mut found) = (t_max, 0, false);
        self.tree.walk::<false>(self.tree.root, ray, &mut t_max, &mut Stack::default(), counters, |block, t_max| {
            let block = Block::at(arena, block);
            tested += LANES;
            let met = block.intersect(ray, *t_max);
            found = (0..LANES).any(|lane| met.hits >> lane & 1 == 1 && accept(block.row(lane), &met.hit(lane)));
            found
        });
        counters.triangles(tested);
        found
    }
}

/// What is not an eight-wide tree: another structure, or a surface that needs none.
#[derive(Clone, Debug)]
pub(super) enum Other {
    Bvh2(Bvh2),
    KdTree(KdTree),
    Octree(Octree),
    Bsp(Bsp),
    Grid(Grid),
    Brute(Brute),
    Shape(Formula),
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
            Other::Shape($structure) => $what,
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

#[cfg(test)]
mod tests;
