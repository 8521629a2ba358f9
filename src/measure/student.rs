//! Means of few numbers, how far they may be off, and whether two of them differ (Student 1908; Welch 1947, "The
//! Generalization of 'Student's' Problem when Several Different Population Variances are Involved").

use super::statistics::{Moments, beta_regularized};

/// Two-sided p-value of Student's t (Press et al. 2007, "Numerical Recipes", section 6.14.3).
pub fn student_two_sided(t: f64, dof: f64) -> f64 {
    beta_regularized(0.5 * dof, 0.5, dof / (dof + t * t))
}

/// Half the width of the interval around a mean that holds the expectation with probability `confidence`, in standard
/// errors; infinite without degrees of freedom.
pub fn student_factor(confidence: f64, dof: f64) -> f64 {
    let p = 1.0 - confidence;
    if p <= 0.0 || dof.is_nan() || dof <= 0.0 {
        return f64::INFINITY;
    }
    let mut high = 1.0;
    while student_two_sided(high, dof) > p && high < 1e300 {
        high *= 2.0;
    }
    let mut low = 0.0;
    // As many halvings as a mantissa has bits.
    for _ in 0..f64::MANTISSA_DIGITS {
        let middle = f64::midpoint(low, high);
        if student_two_sided(middle, dof) > p { low = middle } else { high = middle }
    }
    high
}

/// A number with the variance of its error, and the degrees of freedom that this was estimated with.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Estimate {
    /// The number.
    pub value: f64,
    /// Estimated variance of its error.
    pub variance: f64,
    /// Degrees of freedom of that estimate.
    pub dof: f64,
}

impl Estimate {
    /// The mean of independent numbers of one distribution.
    pub fn of(numbers: impl IntoIterator<Item = f64>) -> Self {
        let moments: Moments = numbers.into_iter().collect();
        let count = moments.count as f64;
        Self { value: moments.mean, variance: moments.variance() / count, dof: count - 1.0 }
    }

    /// The sum of independent estimates, each times its weight; the degrees of freedom are Satterthwaite's (1946, "An
    /// Approximate Distribution of Estimates of Variance Components").
    pub fn sum(terms: impl IntoIterator<Item = (f64, Self)>) -> Self {
        let (mut value, mut variance, mut spread, mut least) = (0.0, 0.0, 0.0, f64::INFINITY);
        for (weight, term) in terms {
            let share = weight * weight * term.variance;
            value += weight * term.value;
            variance += share;
            spread += share * share / term.dof;
            least = term.dof.min(least);
        }
        // Below that of the term with the fewest it never is; where nothing varies the formula says nothing.
        let dof = if variance > 0.0 { variance * variance / spread } else { least };
        Self { value, variance, dof }
    }

    /// The difference to an independent estimate (Welch).
    pub fn minus(self, other: Self) -> Self {
        Self::sum([(1.0, self), (-1.0, other)])
    }

    /// Where the truth is with probability `confidence`: from, to.
    pub fn interval(&self, confidence: f64) -> [f64; 2] {
        let half = match self.variance {
            _ if self.dof.is_nan() || self.dof <= 0.0 => f64::INFINITY,
            0.0 => 0.0,
            variance => student_factor(confidence, self.dof) * variance.sqrt(),
        };
        [self.value - half, self.value + half]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Quantiles as printed (NIST/SEMATECH e-Handbook, 1.3.6.7.2).
    #[test]
    fn factors_agree_with_the_published_table() {
        for (dof, at_95, at_99, at_998) in [
            (1.0, 12.706, 63.657, 318.309),
            (4.0, 2.776, 4.604, 7.173),
            (8.0, 2.306, 3.355, 4.501),
            (30.0, 2.042, 2.750, 3.385),
        ] {
            for (confidence, want) in [(0.95, at_95), (0.99, at_99), (0.998, at_998)] {
                let got = student_factor(confidence, dof);
                assert!((got - want).abs() < 6e-4 * want.max(1.0), "{dof} {confidence}: {got}");
            }
        }
        // Many degrees of freedom are the normal distribution.
        assert!((student_factor(0.95, 1e7) - 1.959_964).abs() < 1e-5);
        assert_eq!(student_factor(0.95, 0.0), f64::INFINITY);
        assert!((student_two_sided(2.131_45, 15.0) - 0.05).abs() < 1e-6);
        assert!((student_two_sided(0.0, 7.0) - 1.0).abs() < 1e-12);
    }

    /// Of 1, 2, 3, 4: mean 2.5, variance of a number 5/3. Two such samples: Welch's degrees of freedom are 2(n − 1).
    #[test]
    fn means_and_differences_are_as_by_hand() {
        let sample = Estimate::of([1.0, 2.0, 3.0, 4.0]);
        assert_eq!((sample.value, sample.variance, sample.dof), (2.5, 5.0 / 12.0, 3.0));
        let difference = Estimate::of([11.0, 12.0, 13.0, 14.0]).minus(sample);
        assert!((difference.value - 10.0).abs() < 1e-12 && (difference.dof - 6.0).abs() < 1e-9);
        assert!((difference.variance - 5.0 / 6.0).abs() < 1e-12);
        let [from, to] = difference.interval(0.95);
        // t with 6 degrees of freedom at 97.5 %: 2.4469.
        assert!((0.5 * (to - from) - 2.4469 * (5.0f64 / 6.0).sqrt()).abs() < 1e-3);
    }

    /// The variance that dominates brings its degrees of freedom along.
    #[test]
    fn unlike_variances_are_not_pooled() {
        let (loud, still) = (Estimate::of([-1.0, 0.0, 1.0]), Estimate::of((0..100).map(|i| f64::from(i % 2) * 1e-6)));
        let difference = loud.minus(still);
        assert!((difference.dof - 2.0).abs() < 1e-6, "{difference:?}");
    }

    #[test]
    fn one_number_says_nothing_of_its_error_and_equal_ones_say_it_is_none() {
        assert_eq!(Estimate::of([3.0]).interval(0.95), [f64::NEG_INFINITY, f64::INFINITY]);
        assert_eq!(Estimate::of([3.0; 4]).interval(0.95), [3.0, 3.0]);
        assert_eq!(Estimate::of([3.0; 4]).minus(Estimate::of([2.0; 4])).interval(0.99), [1.0, 1.0]);
    }
}
