//! Discrete choices in constant time.

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
    /// A number of 24 bits draws a row of probability p with an error of up to 2⁻²⁴ in p: where the typical row has
    /// less than 2⁻¹², use [`AliasTable::sample_fine`].
    ///
    /// # Panics
    /// If the table is empty.
    #[inline(always)]
    pub fn sample(&self, u: f32) -> (u32, f32) {
        // The middle of the number's cell: at its lower end, rows too improbable for 24 bits would be drawn too often.
        self.draw(f64::from(u) + 0.5 * CELL)
    }

    /// As [`AliasTable::sample`], by the 48 bits of two numbers: right for any number of rows.
    ///
    /// The second number is used up with the first.
    #[inline(always)]
    pub fn sample_fine(&self, u: (f32, f32)) -> (u32, f32) {
        self.draw(f64::from(u.0) + (f64::from(u.1) + 0.5 * CELL) * CELL)
    }

    #[inline(always)]
    fn draw(&self, u: f64) -> (u32, f32) {
        let x = u * self.len() as f64;
        // A product with u < 1 may round up to the number of rows.
        let column = (x as usize).min(self.len() - 1);
        let u = x - column as f64;
        let threshold = f64::from(self.threshold[column]);
        let own = u < threshold;
        let (start, share) = if own { (0.0, threshold) } else { (threshold, 1.0 - threshold) };
        let row = if own { column as u32 } else { self.alias[column] };
        (row, (((u - start) / share) as f32).min(1.0 - f32::EPSILON / 2.0))
    }
}

/// Distance between neighbours among the numbers of 24 bits.
const CELL: f64 = 1.0 / 16_777_216.0;
