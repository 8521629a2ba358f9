//! Small meshes that stand where they were made, in one tree.
//!
//! A tree for each of a room's twelve walls is twelve trees to enter and to leave. Their triangles need no transform, so that
//! they can lie in one tree: as another instance, whose rows stand for rows of the others.

use std::sync::Arc;

use super::{
    AccelKind, Blas, Hit, InstanceRef,
    bvh8::Quality,
    opacity::{Opacity, ROW},
};

/// Triangles that are put together at most. The tree is built again with the top level, whatever it was that moved.
const MOST: usize = 1 << 14;

/// The row of the merged instance where there is none; not that of "no hit".
const NOBODY: u32 = u32::MAX - 1;

/// Whose triangles the merged instance holds.
#[derive(Clone, Debug)]
pub(super) struct Merged {
    /// Row of the merged instance, after all others.
    row: u32,
    /// Rows of instance and triangle, in ascending order, of each of its triangles.
    names: Vec<(u32, u32)>,
}

impl Default for Merged {
    fn default() -> Self {
        Self { row: NOBODY, names: Vec::new() }
    }
}

impl Merged {
    /// The instance to add to others, and which of them it stands for.
    pub fn of(instances: &[InstanceRef]) -> Option<(Self, InstanceRef)> {
        let here = |one: &InstanceRef| one.identity && one.blas.other.is_none();
        let mut small: Vec<(usize, usize)> = instances
            .iter()
            .enumerate()
            .filter(|(_, one)| here(one))
            .map(|(row, one)| (one.blas.references(), row))
            .filter(|&(triangles, _)| triangles > 0)
            .collect();
        small.sort_unstable();
        let mut left = MOST;
        let kept = small.iter().take_while(|&&(triangles, _)| {
            let fits = triangles <= left;
            left -= triangles.min(left);
            fits
        });
        let mut rows: Vec<usize> = kept.map(|&(_, row)| row).collect();
        if rows.len() < 2 {
            return None;
        }
        rows.sort_unstable();
        let (mut names, mut corners, mut opacity) = (Vec::new(), Vec::new(), Vec::new());
        for row in rows {
            let mut own: Vec<_> = instances[row].blas.leaves().flat_map(|block| block.triangles()).collect();
            own.sort_unstable_by_key(|&(triangle, _)| triangle & ROW);
            names.extend(own.iter().map(|&(triangle, _)| (row as u32, triangle & ROW)));
            opacity.extend(own.iter().map(|&(triangle, _)| Opacity::of(triangle)));
            corners.extend(own.into_iter().map(|(_, corners)| corners));
        }
        let mut blas = Blas::build_as(AccelKind::Bvh8(Quality::Good), &corners);
        blas.set_opacity(|row| opacity[row as usize]);
        let together = InstanceRef::unmoved(Arc::new(blas));
        Some((Self { row: instances.len() as u32, names }, together))
    }

    /// True if it holds nobody's triangles.
    pub fn is_empty(&self) -> bool {
        self.names.is_empty()
    }

    /// True if the instance's triangles are in the merged one.
    pub fn holds(&self, row: usize) -> bool {
        let first = self.names.partition_point(|&(instance, _)| (instance as usize) < row);
        self.names.get(first).is_some_and(|&(instance, _)| instance as usize == row)
    }

    /// The rows that an instance and a triangle of it go by outside.
    #[inline(always)]
    pub fn name(&self, instance: u32, triangle: u32) -> (u32, u32) {
        if instance == self.row { self.names[triangle as usize] } else { (instance, triangle) }
    }

    /// The hit by the rows that it goes by outside.
    #[inline(always)]
    pub fn named(&self, hit: Hit) -> Hit {
        let (instance, triangle) = self.name(hit.instance, hit.triangle);
        Hit { instance, triangle, ..hit }
    }

    /// Bytes held.
    pub fn bytes(&self) -> usize {
        size_of_val(self.names.as_slice())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::accel::{Accel, RayList, Solid, family, tests::placed};

    #[test]
    fn small_meshes_are_merged_and_others_are_not() {
        let [small, large] = [family::torus(24, 16), family::floor(1, 100)].map(|mesh| Arc::new(Blas::build(&mesh)));
        assert!(large.references() > MOST && small.references() < MOST / 2);
        let instances =
            [placed(&small, 1.0, 0.0), placed(&large, 1.0, 0.0), placed(&small, 1.0, 0.5), placed(&small, 1.0, 0.0)];
        let (merged, together) = Merged::of(&instances).unwrap();
        assert_eq!([0, 1, 2, 3, 4].map(|row| merged.holds(row)), [true, false, false, true, false]);
        assert_eq!(together.blas.references(), 2 * small.references());
        let rows = small.references() as u32;
        assert_eq!([merged.name(4, 0), merged.name(4, rows), merged.name(1, 7)], [(0, 0), (3, 0), (1, 7)]);
        // One alone gains nothing.
        assert!(Merged::of(&instances[..3]).is_none() && Merged::of(&[]).is_none());
        // A scene of nothing else has no top level to go through.
        let accel = Accel::build(vec![instances[0].clone(), instances[3].clone()]);
        assert_eq!((accel.parts.len(), accel.instances().len()), (1, 2));
        // Of two in the same place the first is hit, by its own rows.
        let rays = family::rays(&family::torus(24, 16), 500, 31);
        let rays = RayList(rays.iter().map(|ray| (ray.origin, ray.direction, f32::INFINITY)).collect::<Vec<_>>());
        let mut hits = 0;
        accel.nearest_of(&rays, &Solid, |_, hit| {
            assert!(hit.t == f32::INFINITY || hit.instance == 0 && hit.triangle < rows);
            hits += u32::from(hit.instance == 0);
        });
        assert!(hits > 100, "{hits}");
    }
}
