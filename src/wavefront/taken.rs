//! Eight rows of a queue, wherever they are, as vectors.

use wide::u32x8;

use crate::simd::LANES;

/// Eight rows of columns; lanes beyond the rows repeat the last one.
#[derive(Clone, Copy)]
pub struct Taken {
    /// The rows.
    pub index: [u32; LANES],
    /// Where each lane's row is behind the first.
    offset: u32x8,
}

impl Taken {
    /// Rows ascend.
    #[inline(always)]
    pub fn new(rows: &[u32]) -> Self {
        // Whole blocks come whole: what is written lane by lane has to reach memory before it is read as a vector.
        let index = match rows.first_chunk() {
            Some(rows) => *rows,
            None => std::array::from_fn(|lane| rows[lane.min(rows.len() - 1)]),
        };
        Self { index, offset: u32x8::new(index) - u32x8::splat(index[0]) }
    }

    /// All are among the sixteen rows from the first one on, of so many.
    #[inline(always)]
    pub fn is_near(&self, rows: usize) -> bool {
        let [first, .., last] = self.index.map(|row| row as usize);
        last < first + 2 * LANES && first + 2 * LANES <= rows
    }

    /// Of a column; if they are `NEAR` each other, by whole vectors.
    #[inline(always)]
    pub fn of<const NEAR: bool, T: bytemuck::Pod>(&self, column: &[T]) -> [T; LANES] {
        if !NEAR {
            return self.index.map(|row| column[row as usize]);
        }
        let first = self.index[0] as usize;
        let window = &column[first..first + 2 * LANES];
        let [near, far] = [0, 1].map(|half| {
            let half: [T; LANES] = *window[half * LANES..].first_chunk().expect("two vectors are there");
            bytemuck::cast::<_, u32x8>(half).shuffle_wrapping(self.offset)
        });
        let is_near = self.offset.simd_lt(u32x8::splat(LANES as u32));
        bytemuck::cast(is_near.bitselect(near, far))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_are_the_same_taken_by_vectors_and_one_by_one() {
        let column: Vec<u32> = (0..100).map(|i| i * i + 7).collect();
        let whole: [&[u32]; 4] = [
            &[0, 1, 2, 3, 4, 5, 6, 7],
            &[3, 5, 6, 9, 10, 11, 17, 18],
            &[84, 85, 86, 87, 88, 89, 90, 99],
            &[40, 41, 55],
        ];
        for rows in whole {
            let taken = Taken::new(rows);
            let want: [u32; LANES] = std::array::from_fn(|lane| column[rows[lane.min(rows.len() - 1)] as usize]);
            assert!(taken.is_near(column.len()), "{rows:?}");
            assert_eq!((taken.of::<true, u32>(&column), taken.of::<false, u32>(&column)), (want, want));
        }
        assert!(!Taken::new(&[0, 1, 2, 3, 4, 5, 6, 16]).is_near(column.len()), "too far apart");
        assert!(!Taken::new(&[85, 86]).is_near(column.len()), "too few behind");
    }
}
