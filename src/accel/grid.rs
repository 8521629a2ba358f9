//! A uniform grid: space cut into equal boxes, which a ray visits one after the other.
//!
//! The walk steps from cell to cell across whichever face is next (Amanatides, Woo 1987, "A Fast Voxel Traversal
//! Algorithm for Ray Tracing"). The grid knows nothing of where triangles are many: the "teapot in a stadium" is a single
//! cell of it.

use std::iter::{Once, once};

use rayon::prelude::*;

use super::{
    Cell, Counters, Nearest, Ray, Structure, TriangleHit,
    space::{Beam, Bounds, Soup, margin, overlaps},
    structure::asked_by_walking,
};

/// Cells for each triangle, if they are not forbidden by the limits below: λ of Cleary, Wyvill 1988, "Analysis of an
/// Algorithm for Fast Ray Tracing using Uniform Space Subdivision", also used by Wald et al. 2006, "Ray Tracing Animated
/// Scenes using Coherent Grid Traversal". Of 2, 5, 10 and 20 five made the fastest walks in a torus and in a soup of
/// 100,000 triangles.
const CELLS: f64 = 5.0;

/// Most cells along an axis.
const MOST_CELLS: f64 = 2048.0;

/// Most cells that the boxes of triangles reach into, for each triangle and for the whole; where triangles are large,
/// cells are made larger. This bounds memory.
const MOST_REFERENCES: usize = 64;

/// Part of a cell by which it is larger for what is put into it than for the walk, on all sides. It must be at least the
/// [`margin`] of a ray. That grows with the distance of the origin; rays from too far, about a hundred times the grid's
/// size, also look into neighbouring cells.
const PAD: f64 = 1.0 / 32.0;

/// Triangles that a walk remembers having tested.
const MAILBOX: usize = 64;

/// A uniform grid.
#[derive(Clone, Debug)]
pub struct Grid {
    soup: Soup,
    cells: Cells,
    /// Where each cell's references begin; one more than there are cells.
    offsets: Vec<u32>,
    references: Vec<u32>,
}

/// Where the cells are.
#[derive(Clone, Copy, Debug)]
struct Cells {
    lower: [f32; 3],
    upper: [f32; 3],
    size: [f32; 3],
    inverse_size: [f32; 3],
    counts: [usize; 3],
}

impl Cells {
    /// As near to cubes as they get, about as many as asked for.
    fn new(bounds: &Bounds, wanted: f64) -> Self {
        let size = bounds.size();
        let mut counts = [1.0; 3];
        // An axis too short for two cells has one, and the others share the cells among them.
        let mut long: Vec<usize> = (0..3).filter(|&axis| size[axis] > 0.0).collect();
        while !long.is_empty() {
            let volume: f64 = long.iter().map(|&axis| size[axis]).product();
            let per_length = (wanted / volume).powf(1.0 / long.len() as f64);
            let before = long.len();
            long.iter().for_each(|&axis| counts[axis] = (size[axis] * per_length).clamp(1.0, MOST_CELLS).round());
            let short = |axis: usize| size[axis] * per_length < 1.0;
            long.retain(|&axis| !short(axis));
            if long.len() == before {
                break;
            }
        }
        let size: [f32; 3] = std::array::from_fn(|axis| (size[axis] / counts[axis]) as f32);
        let inverse_size = size.map(|size| if size > 0.0 { 1.0 / size } else { 0.0 });
        Self {
            lower: bounds.lower,
            upper: bounds.upper,
            size,
            inverse_size,
            counts: counts.map(|count| count as usize),
        }
    }

    /// Coordinate of the lower face of the cells `at` along an axis.
    #[inline(always)]
    fn plane(&self, axis: usize, at: usize) -> f32 {
        self.lower[axis] + at as f32 * self.size[axis]
    }

    /// A guess, right to within rounding, of the cell that a coordinate is in.
    #[inline(always)]
    fn guess(&self, axis: usize, x: f32) -> usize {
        (((x - self.lower[axis]) * self.inverse_size[axis]) as usize).min(self.counts[axis] - 1)
    }

    #[inline(always)]
    fn index(&self, [x, y, z]: [usize; 3]) -> usize {
        (z * self.counts[1] + y) * self.counts[0] + x
    }

    fn pad(&self, axis: usize) -> f64 {
        f64::from(self.size[axis]) * PAD
    }

    /// First and last cell along each axis that the box reaches into.
    fn reached(&self, bounds: &Bounds) -> [[usize; 2]; 3] {
        std::array::from_fn(|axis| {
            let (lower, upper) = (f64::from(bounds.lower[axis]), f64::from(bounds.upper[axis]));
            let (pad, most) = (self.pad(axis), self.counts[axis] - 1);
            let plane = |at: usize| f64::from(self.plane(axis, at));
            let mut first = self.guess(axis, bounds.lower[axis]);
            while first < most && lower > plane(first + 1) + pad {
                first += 1;
            }
            while first > 0 && lower <= plane(first) + pad {
                first -= 1;
            }
            let mut last = self.guess(axis, bounds.upper[axis]).max(first);
            while last > first && upper < plane(last) - pad {
                last -= 1;
            }
            while last < most && upper >= plane(last + 1) - pad {
                last += 1;
            }
            [first, last]
        })
    }

    /// Those that a triangle overlaps, padded.
    fn overlapped(&self, corners: &[[f32; 3]; 3], blur: f64) -> impl Iterator<Item = usize> {
        let [[x0, x1], [y0, y1], [z0, z1]] = self.reached(&Bounds::of(corners).padded(blur));
        let only = x0 == x1 && y0 == y1 && z0 == z1;
        let all = (z0..=z1).flat_map(move |z| (y0..=y1).flat_map(move |y| (x0..=x1).map(move |x| [x, y, z])));
        let (cells, corners) = (*self, *corners);
        let overlapped = all.filter(move |cell| {
            let of = |axis: usize| {
                let from = f64::from(cells.plane(axis, cell[axis]));
                let to = f64::from(cells.plane(axis, cell[axis] + 1));
                // Far from zero the last plane may be rounded to before the end.
                let to = if cell[axis] + 1 == cells.counts[axis] { to.max(f64::from(cells.upper[axis])) } else { to };
                (0.5 * (from + to), 0.5 * (to - from) + cells.pad(axis) + blur)
            };
            let [(x, half_x), (y, half_y), (z, half_z)] = [0, 1, 2].map(of);
            only || overlaps(&corners, [x, y, z], [half_x, half_y, half_z])
        });
        overlapped.map(move |cell| cells.index(cell))
    }

    /// Calls `visit` for the cells that the ray goes through before `t_end`, in order; `visit` returns the new `t_end`.
    ///
    /// All hits up to where the ray leaves the last cell visited are in cells visited, and so the walk ends once
    /// `t_end` is there.
    #[inline(always)]
    fn walk(&self, ray: &Ray, bounds: &Bounds, mut t_end: f32, mut visit: impl FnMut([usize; 3]) -> f32) {
        let (from, to) = Beam::new(ray, bounds).within(bounds, t_end);
        if from > to {
            return;
        }
        // Beyond the outermost faces there is nothing to step into.
        let crossing = |axis: usize, at: usize| {
            let (first, last) = (at == 0, at == self.counts[axis]);
            if first || last {
                let ahead = last == (ray.negative(axis) == 0);
                return if ahead { f32::INFINITY } else { f32::NEG_INFINITY };
            }
            (self.plane(axis, at) - ray.origin[axis]) * ray.inverse[axis]
        };
        let forward = [0, 1, 2].map(|axis| 1 - ray.negative(axis));
        let mut cell = [0; 3];
        let mut next = [0.0; 3];
        for axis in 0..3 {
            let mut at = self.guess(axis, ray.origin[axis] + from * ray.direction[axis]);
            // By distance and not by place, so that this rounds as the steps do. A ray that runs along a face meets it
            // at infinity, or at NaN within it, which changes nothing.
            let (one_on, one_back) = (forward[axis], 1 - forward[axis]);
            while crossing(axis, at + one_back) > from {
                at = at + one_back - one_on;
            }
            while crossing(axis, at + one_on) <= from {
                at = at + one_on - one_back;
            }
            cell[axis] = at;
            next[axis] = crossing(axis, at + one_on);
        }
        // NaN must not stop a step along another axis.
        let next_or_never = |t: f32| if t.is_nan() { f32::INFINITY } else { t };
        let mut next = next.map(next_or_never);
        loop {
            t_end = visit(cell);
            let axis = if next[0] < next[1] {
                if next[0] < next[2] { 0 } else { 2 }
            } else if next[1] < next[2] {
                1
            } else {
                2
            };
            let leaves = next[axis];
            if leaves >= t_end || leaves >= to || leaves == f32::INFINITY {
                return;
            }
            cell[axis] = cell[axis] + forward[axis] - ray.negative(axis);
            next[axis] = crossing(axis, cell[axis] + forward[axis]);
        }
    }
}

impl Grid {
    /// Calls `test` with the references that the ray comes upon, one by one, and not those seen just before.
    #[inline(always)]
    fn walk<C: Counters>(
        &self,
        ray: &Ray,
        t_end: f32,
        counters: &mut C,
        mut test: impl FnMut(Once<u32>, &mut C) -> f32,
    ) {
        if self.references.is_empty() {
            return;
        }
        let mut mailbox = [u32::MAX; MAILBOX];
        let mut nearest = t_end;
        let mut look = |cell: [usize; 3]| {
            counters.node();
            let index = self.cells.index(cell);
            let of_cell = self.offsets[index] as usize..self.offsets[index + 1] as usize;
            for &reference in &self.references[of_cell] {
                let letter = &mut mailbox[reference as usize % MAILBOX];
                if *letter != reference {
                    *letter = reference;
                    nearest = test(once(reference), counters);
                    if nearest < 0.0 {
                        break;
                    }
                }
            }
            nearest
        };
        let margin = f64::from(margin(ray, &self.soup.bounds));
        let cells = &self.cells;
        if (0..3).all(|axis| margin <= cells.pad(axis) || cells.counts[axis] == 1) {
            cells.walk(ray, &self.soup.bounds, t_end, look);
            return;
        }
        let beside: [usize; 3] = std::array::from_fn(|axis| {
            let size = f64::from(cells.size[axis]);
            if size > 0.0 { (margin / size).ceil().min(MOST_CELLS) as usize } else { 0 }
        });
        cells.walk(ray, &self.soup.bounds, t_end, |cell| {
            let [xs, ys, zs] = [0, 1, 2].map(|axis| {
                let last = (cell[axis] + beside[axis]).min(cells.counts[axis] - 1);
                cell[axis].saturating_sub(beside[axis])..=last
            });
            let mut t_end = f32::INFINITY;
            for z in zs {
                for y in ys.clone() {
                    for x in xs.clone() {
                        t_end = look([x, y, z]);
                        if t_end < 0.0 {
                            return t_end;
                        }
                    }
                }
            }
            t_end
        });
    }
}

impl Structure for Grid {
    const NAME: &'static str = "grid";

    fn build(triangles: &[[[f32; 3]; 3]]) -> Self {
        let soup = Soup::new(triangles);
        let count = soup.triangles.len();
        if count == 0 {
            let cells =
                Cells { lower: [0.0; 3], upper: [0.0; 3], size: [0.0; 3], inverse_size: [0.0; 3], counts: [1; 3] };
            return Self { soup, cells, offsets: vec![0; 2], references: Vec::new() };
        }
        let mut wanted = CELLS * count as f64;
        let cells = loop {
            let cells = Cells::new(&soup.bounds, wanted);
            let reached = |index: usize| -> usize {
                cells.reached(&soup.bounds_of(index)).iter().map(|[first, last]| last - first + 1).product()
            };
            let reached: usize = (0..count).into_par_iter().map(reached).sum();
            if reached <= MOST_REFERENCES * (count + MOST_REFERENCES) || cells.counts == [1; 3] {
                break cells;
            }
            wanted *= 0.5;
        };
        let places: Vec<(u32, u32)> = (0..count)
            .into_par_iter()
            .flat_map_iter(|index| {
                let overlapped = cells.overlapped(&soup.triangles[index].1, soup.blur(index));
                overlapped.map(move |cell| (cell as u32, index as u32))
            })
            .collect();
        // Counting sort: how many are in each cell, where they end, then fill from the end.
        let mut offsets = vec![0_u32; cells.counts.iter().product::<usize>() + 1];
        places.iter().for_each(|&(cell, _)| offsets[cell as usize] += 1);
        let mut end = 0;
        for offset in &mut offsets {
            end += *offset;
            *offset = end;
        }
        let mut references = vec![0; places.len()];
        for &(cell, reference) in places.iter().rev() {
            let offset = &mut offsets[cell as usize];
            *offset -= 1;
            references[*offset as usize] = reference;
        }
        Self { soup, cells, offsets, references }
    }

    fn bytes(&self) -> usize {
        self.soup.bytes() + size_of_val(self.offsets.as_slice()) + size_of_val(self.references.as_slice())
    }

    fn references(&self) -> usize {
        self.references.len()
    }

    fn cells(&self, visit: &mut dyn FnMut(Cell)) {
        if self.references.is_empty() {
            return;
        }
        let counts = self.cells.counts;
        let all = (0..counts[2]).flat_map(|z| (0..counts[1]).flat_map(move |y| (0..counts[0]).map(move |x| [x, y, z])));
        for cell in all {
            let index = self.cells.index(cell);
            let held = (self.offsets[index + 1] - self.offsets[index]) as usize;
            let lower = std::array::from_fn(|axis| self.cells.plane(axis, cell[axis]));
            let upper = std::array::from_fn(|axis| self.cells.plane(axis, cell[axis] + 1));
            visit(Bounds { lower, upper }.cell(0, Some(held)));
        }
    }

    asked_by_walking!();
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::accel::family::{check_leaves, rays, scenes, soup};

    fn cell_bounds(cells: &Cells, cell: [usize; 3]) -> Bounds {
        let upper = |axis: usize| {
            let plane = cells.plane(axis, cell[axis] + 1);
            if cell[axis] + 1 == cells.counts[axis] { plane.max(cells.upper[axis]) } else { plane }
        };
        Bounds { lower: std::array::from_fn(|axis| cells.plane(axis, cell[axis])), upper: std::array::from_fn(upper) }
    }

    fn all(cells: &Cells) -> Vec<[usize; 3]> {
        let [x, y, z] = cells.counts;
        (0..z).flat_map(|k| (0..y).flat_map(move |j| (0..x).map(move |i| [i, j, k]))).collect()
    }

    #[test]
    fn cells_divide_space_and_refer_to_what_is_in_them() {
        for (name, triangles) in scenes() {
            let grid = Grid::build(&triangles);
            if !grid.references.is_empty() {
                let leaves: Vec<_> = all(&grid.cells)
                    .into_iter()
                    .map(|cell| {
                        let index = grid.cells.index(cell);
                        let range = grid.offsets[index] as usize..grid.offsets[index + 1] as usize;
                        (cell_bounds(&grid.cells, cell), grid.references[range].to_vec())
                    })
                    .collect();
                assert_eq!(leaves.len() + 1, grid.offsets.len());
                assert!(leaves.windows(2).enumerate().all(|(i, _)| grid.offsets[i] <= grid.offsets[i + 1]));
                check_leaves(name, &grid.soup, &leaves);
            }
        }
    }

    /// Each cell is beside the one before, on the side that the ray runs to, so that none comes twice; the ray is in it
    /// within the margin, later than in the one before; and the middle of the way through the grid is in some cell.
    #[test]
    fn cells_are_visited_once_and_in_order() {
        let triangles = soup(300, 0.1, 4);
        let grid = Grid::build(&triangles);
        let mut steps = 0;
        for ray in rays(&triangles, 3000, 5) {
            let mut visited = Vec::new();
            grid.cells.walk(&ray, &grid.soup.bounds, f32::INFINITY, |cell| {
                visited.push(cell);
                f32::INFINITY
            });
            let beam = Beam::new(&ray, &grid.soup.bounds);
            let mut entered = 0.0;
            for &cell in &visited {
                let (from, to) = beam.within(&cell_bounds(&grid.cells, cell), f32::INFINITY);
                assert!(from <= to && from >= entered, "{ray:?}: {cell:?} from {from} to {to}, after {entered}");
                entered = from;
            }
            for pair in visited.windows(2) {
                let steps: Vec<isize> = (0..3).map(|axis| pair[1][axis] as isize - pair[0][axis] as isize).collect();
                assert_eq!(steps.iter().map(|step| step.abs()).sum::<isize>(), 1);
                assert!((0..3).all(|axis| steps[axis] == 0 || (steps[axis] < 0) == (ray.negative(axis) == 1)));
            }
            let (from, to) = beam.within(&grid.soup.bounds, f32::INFINITY);
            let middle = [0, 1, 2].map(|axis| ray.origin[axis] + 0.5 * (from + to) * ray.direction[axis]);
            let margin = 2.0 * margin(&ray, &grid.soup.bounds);
            let holds = |cell: &[usize; 3]| {
                let bounds = cell_bounds(&grid.cells, *cell).padded(f64::from(margin));
                (0..3).all(|axis| bounds.lower[axis] <= middle[axis] && middle[axis] <= bounds.upper[axis])
            };
            assert_eq!(visited.iter().any(holds), from <= to);
            steps += visited.len();
        }
        assert!(steps > 15_000, "{steps}");
    }

    /// Counts along the axes are as the edges' lengths, and about five times as many cells as triangles.
    #[test]
    fn cells_are_as_many_as_the_heuristic_says_and_nearly_cubes() {
        let cells = |upper: [f32; 3]| Cells::new(&Bounds { lower: [0.0; 3], upper }, 1000.0).counts;
        assert_eq!(cells([1.0; 3]), [10; 3]);
        assert_eq!(cells([4.0, 2.0, 1.0]), [20, 10, 5]);
        assert_eq!(cells([10.0, 0.0, 1.0]), [100, 1, 10]);
        assert_eq!(cells([1000.0, 0.1, 0.1]), [1000, 1, 1]);
        assert_eq!(cells([0.0; 3]), [1; 3]);
    }

    #[test]
    fn large_triangles_have_bounded_memory() {
        let grid = Grid::build(&soup(5000, 1.0, 6));
        assert!(grid.references() <= MOST_REFERENCES * (5000 + MOST_REFERENCES), "{}", grid.references());
    }
}
