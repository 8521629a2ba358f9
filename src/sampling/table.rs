//! Discrete choices in constant time.

use std::hint::select_unpredictable;

/// A discrete distribution sampled by Walker's alias method.
///
/// Columns are equally likely, and each belongs to one or two rows.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct AliasTable {
    /// Probability of each row; sums to 1, or empty.
    pub pmf: Vec<f32>,
    /// Share of the row's own column, 0 to 1; the rest belongs to `alias`.
    pub threshold: Vec<f32>,
    /// The other row in each column.
    pub alias: Vec<u32>,
}

impl AliasTable {
    /// Rows in proportion to their weights; empty if no weight is positive.
    ///
    /// A row of weight 0 has probability 0 and is never drawn. A weight that is negative or not a number counts as 0.
    ///
    /// Columns are filled in row order, so that rows that are neighbours stay near in the number that draws them
    /// (Hübschle-Schneider and Sanders 2022, "Parallel Weighted Random Sampling", section 4.1).
    pub fn new(weights: &[f32]) -> Self {
        debug_assert!(weights.iter().all(|w| *w >= 0.0 && w.is_finite()), "weights are finite and not negative");
        let weight = |row: usize| if weights[row] > 0.0 { f64::from(weights[row].min(f32::MAX)) } else { 0.0 };
        let n = weights.len();
        let sum: f64 = (0..n).map(weight).sum();
        if sum <= 0.0 {
            return Self::default();
        }
        let pmf = (0..n).map(|row| (weight(row) / sum) as f32).collect();
        // In units of the mean, a column holds 1.
        let per_mean = n as f64 / sum;
        let share = |row: usize| weight(row) * per_mean;
        let next = |from: usize, heavy: bool| (from..n).find(|&row| (share(row) > 1.0) == heavy);

        // Light rows fill their own column in part, heavy rows give what they have beyond their own to the rest of it.
        let mut threshold = vec![1.0f32; n];
        let mut alias: Vec<u32> = (0..n as u32).collect();
        let mut light = next(0, false);
        let mut heavy = next(0, true);
        let mut rest = heavy.map_or(0.0, share);
        let mut last_heavy = heavy;
        while let Some(giver) = heavy {
            last_heavy = heavy;
            if rest > 1.0 {
                let Some(column) = light else { break };
                threshold[column] = share(column) as f32;
                alias[column] = giver as u32;
                rest -= 1.0 - share(column);
                light = next(column + 1, false);
            } else {
                heavy = next(giver + 1, true);
                if let Some(follower) = heavy {
                    threshold[giver] = rest as f32;
                    alias[giver] = follower as u32;
                    rest += share(follower) - 1.0;
                }
            }
        }
        // What is left over is off from 1 by rounding only; but a row of weight 0 may not be drawn for that.
        while let Some(column) = light {
            if weight(column) == 0.0 {
                threshold[column] = 0.0;
                alias[column] = last_heavy.expect("where a row is below the mean another is above it") as u32;
            }
            light = next(column + 1, false);
        }
        Self { pmf, threshold, alias }
    }

    /// Number of rows.
    #[inline(always)]
    pub fn len(&self) -> usize {
        self.pmf.len()
    }

    /// True if there is no row to draw.
    #[inline(always)]
    pub fn is_empty(&self) -> bool {
        self.pmf.is_empty()
    }

    /// Probability of a row.
    #[inline(always)]
    pub fn pmf(&self, row: u32) -> f32 {
        self.pmf[row as usize]
    }

    /// A row, and what is left of `u` as a new number in [0, 1).
    ///
    /// Rows are drawn and the rest is spread as finely as `u` is: 24 bits are too few for thousands of rows, or for what
    /// is left to choose among thousands of others. [`lengthen`] makes 52 of them.
    ///
    /// # Panics
    /// If the table is empty.
    #[inline(always)]
    pub fn sample(&self, u: f64) -> (u32, f64) {
        let x = u * self.len() as f64;
        // A product with u < 1 may round up to the number of rows.
        let column = (x as usize).min(self.len() - 1);
        let u = x - column as f64;
        let (threshold, alias) = (f64::from(self.threshold[column]), self.alias[column]);
        // Which of the two is a matter of chance, so a branch would be mispredicted.
        let own = u < threshold;
        let row = select_unpredictable(own, column as u32, alias);
        let start = select_unpredictable(own, 0.0, threshold);
        let share = select_unpredictable(own, threshold, 1.0 - threshold);
        (row, ((u - start) / share).min(1.0 - f64::EPSILON / 2.0))
    }
}

/// A number of 24 bits with 28 of `more` behind them, in the middle of its cell.
///
/// The 24 may be stratified; the others need only be independent of them.
#[inline(always)]
pub fn lengthen(u: f32, more: u32) -> f64 {
    f64::from(u) + (f64::from(more >> 4) + 0.5) * (1.0 / (1_u64 << 52) as f64)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        measure::statistics::{Moments, chi_square_test},
        sampling::tests::numbers,
    };

    /// A long number of two short ones.
    fn long(u: (f32, f32)) -> f64 {
        lengthen(u.0, (f64::from(u.1) * f64::from(u32::MAX)) as u32)
    }

    /// Probability of each row that the columns hold, exactly as they would be drawn by a real number.
    fn drawn(table: &AliasTable) -> Vec<f64> {
        let mut p = vec![0.0; table.len()];
        for column in 0..table.len() {
            let own = f64::from(table.threshold[column]);
            p[column] += own / table.len() as f64;
            p[table.alias[column] as usize] += (1.0 - own) / table.len() as f64;
        }
        p
    }

    /// The columns hold the pmf, the pmf is the weights', it sums to 1, and rows of weight 0 are never drawn.
    #[track_caller]
    fn check_table(weights: &[f32]) {
        let table = AliasTable::new(weights);
        let sum: f64 = weights.iter().copied().map(f64::from).sum();
        let total: f64 = table.pmf.iter().copied().map(f64::from).sum();
        assert!((total - 1.0).abs() < 1e-6, "sums to {total}");
        for (row, p) in drawn(&table).into_iter().enumerate() {
            let want = f64::from(weights[row]) / sum;
            assert!((f64::from(table.pmf(row as u32)) - want).abs() <= 6e-8 * want + 1e-45, "pmf of {row}");
            // Thresholds are rounded to 2⁻²⁴ of a column at most, and a heavy row is in many columns.
            assert!((p - want).abs() <= 1e-7 * want + 1e-7 / weights.len() as f64, "{row}: {p} is not {want}");
            assert!(weights[row] > 0.0 || p == 0.0, "row {row} of weight 0 can be drawn");
        }
        for u in [0.0, f32::MIN_POSITIVE, 0.5, 1.0 - f32::EPSILON / 2.0] {
            for (row, rest) in [0, 1 << 31, u32::MAX].map(|more| table.sample(lengthen(u, more))) {
                assert!(table.pmf(row) > 0.0 && (0.0..1.0).contains(&rest), "{u}: {row} {rest}");
            }
        }
    }

    #[test]
    fn tables_of_all_shapes_hold_their_weights() {
        check_table(&[3.0]);
        check_table(&[1.0; 6]);
        check_table(&[0.1; 1000]);
        check_table(&[1.0, 0.0]);
        check_table(&[0.0, 0.0, 0.0, 1e-30, 0.0]);
        check_table(&[1e30, 1.0, 1e-30, 0.0]);
        check_table(&[f32::MAX, f32::MAX, f32::MAX, f32::MIN_POSITIVE]);
        check_table(&(0..1000).map(|i| (i % 7) as f32).collect::<Vec<_>>());
        check_table(&(0..1000).map(|i| 1.0 / (i + 1) as f32).collect::<Vec<_>>());
        check_table(&numbers(3, 5000).map(|u| (20.0 * u.0).exp()).collect::<Vec<_>>());
        let mut sun = vec![1e-3; 10_000];
        sun[7777] = 1e9;
        check_table(&sun);
        let mut hole = vec![1.0; 10_001];
        hole[5000] = 0.0;
        check_table(&hole);
    }

    #[test]
    fn nothing_to_choose_makes_an_empty_table() {
        assert!(AliasTable::new(&[]).is_empty());
        assert!(AliasTable::new(&[0.0; 5]).is_empty());
    }

    /// P = 1/6 each, mean 3.5; E[x²] = 91/6, E[1/x] = 49/120; what is left of u is uniform. Significance 1e-4 each.
    #[test]
    fn six_equal_rows_are_a_fair_die() {
        let die = AliasTable::new(&[1.0; 6]);
        let (mut counts, mut rest) = ([0u64; 6], [0u64; 32]);
        let mut moments = [Moments::default(); 3];
        for u in numbers(4, 600_000).map(long) {
            let (row, left) = die.sample(u);
            assert_eq!(die.pmf(row), 1.0 / 6.0);
            counts[row as usize] += 1;
            rest[(left * 32.0) as usize] += 1;
            let face = f64::from(row + 1);
            moments[0].push(face);
            moments[1].push(face * face);
            moments[2].push(1.0 / face);
        }
        assert!(chi_square_test(&counts, &[1.0; 6]).p > 1e-4, "{counts:?}");
        assert!(chi_square_test(&rest, &[1.0; 32]).p > 1e-4, "{rest:?}");
        for (moments, want) in moments.iter().zip([3.5, 91.0 / 6.0, 49.0 / 120.0]) {
            assert!(moments.p_value(want) > 1e-4, "{moments:?} is not {want}");
        }
    }

    #[test]
    fn loaded_dice_fall_as_loaded() {
        let weights: Vec<f32> = (0..100).map(|i| ((i * 37) % 101) as f32 * (i % 3) as f32).collect();
        let table = AliasTable::new(&weights);
        let expected: Vec<f64> = weights.iter().copied().map(f64::from).collect();
        let (mut counts, mut rest) = (vec![0u64; 100], [0u64; 32]);
        for u in numbers(5, 400_000).map(long) {
            let (row, left) = table.sample(u);
            counts[row as usize] += 1;
            rest[(left * 32.0) as usize] += 1;
        }
        assert!(chi_square_test(&counts, &expected).p > 1e-4);
        assert!(chi_square_test(&rest, &[1.0; 32]).p > 1e-4);
    }

    /// What is left of a choice makes another, among 2¹⁹ rows, half of them bright: as a light is chosen, and then a
    /// texel of the sky. A rest of too few bits draws the dark half a tenth too often, or too seldom.
    #[test]
    fn the_rest_of_a_choice_makes_another_rightly() {
        let texels: Vec<f32> = (0..1 << 19).map(|i| if i < 1 << 18 { 1.0 } else { 0.1 }).collect();
        let texels = AliasTable::new(&texels);
        for lights in [1, 2, 3, 16, 1000] {
            let lights = AliasTable::new(&vec![1.0; lights]);
            let mut halves = [0u64; 2];
            for u in numbers(8, 400_000).map(long) {
                let (_, rest) = lights.sample(u);
                halves[texels.sample(rest).0 as usize >> 18] += 1;
            }
            let test = chi_square_test(&halves, &[10.0, 1.0]);
            assert!(test.p > 1e-4, "{} lights: {halves:?}, {test:?}", lights.len());
        }
    }

    /// With more rows than 24 bits can tell apart, 52 still draw them rightly: checked over blocks of rows, within
    /// blocks, and by what is left over.
    #[test]
    fn a_million_rows_are_drawn_rightly() {
        let n = 3_000_000;
        let weights: Vec<f32> = (0..n).map(|i| if i % 5 == 0 { 0.0 } else { 1.0 + (i % 11) as f32 }).collect();
        let table = AliasTable::new(&weights);
        let mut expected = (vec![0.0; 64], vec![0.0; 55]);
        for (i, weight) in weights.iter().enumerate() {
            expected.0[i * 64 / n] += f64::from(*weight);
            expected.1[i % 55] += f64::from(*weight);
        }
        let mut observed = (vec![0u64; 64], vec![0u64; 55], [0u64; 64]);
        for u in numbers(6, 400_000).map(long) {
            let (row, left) = table.sample(u);
            assert!(table.pmf(row) > 0.0);
            observed.0[row as usize * 64 / n] += 1;
            observed.1[row as usize % 55] += 1;
            observed.2[(left * 64.0) as usize] += 1;
        }
        assert!(chi_square_test(&observed.0, &expected.0).p > 1e-4);
        assert!(chi_square_test(&observed.1, &expected.1).p > 1e-4);
        assert!(chi_square_test(&observed.2, &[1.0; 64]).p > 1e-4);
    }

    /// Neighbouring numbers draw neighbouring rows: among those lighter than the mean the row rises with u.
    #[test]
    fn light_rows_rise_with_the_number() {
        let weights: Vec<f32> =
            (0..1000).map(|i| if i % 10 == 0 { 20.0 } else { 0.5 + (i % 3) as f32 * 0.1 }).collect();
        let table = AliasTable::new(&weights);
        let mut last = 0;
        for i in 0..100_000 {
            let row = table.sample(f64::from(i) / 100_000.0).0;
            if !row.is_multiple_of(10) {
                assert!(row >= last, "{row} after {last}");
                last = row;
            }
        }
    }
}
