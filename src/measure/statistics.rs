//! Tests of hypotheses about random numbers, for tests and for error bars.
//!
//! Everything is f64 and scalar. Probabilities are right to about ten digits, also far out in the tails where
//! that matters: upper tails are computed as such, not as one minus the lower.

use std::f64::consts::{PI, SQRT_2};

/// Logarithm of the gamma function for x > 0.
///
/// Lanczos's approximation with g = 7 and nine terms (Press et al. 2007, "Numerical Recipes", section 6.1).
pub fn ln_gamma(x: f64) -> f64 {
    const TERMS: [f64; 8] = [
        676.520_368_121_885_1,
        -1_259.139_216_722_402_8,
        771.323_428_777_653_1,
        -176.615_029_162_140_6,
        12.507_343_278_686_905,
        -0.138_571_095_265_720_12,
        9.984_369_578_019_572e-6,
        1.505_632_735_149_311_6e-7,
    ];
    if x < 0.5 {
        return (PI / (PI * x).sin()).ln() - ln_gamma(1.0 - x);
    }
    let x = x - 1.0;
    let sum = TERMS.iter().enumerate().fold(0.999_999_999_999_809_9, |sum, (i, c)| sum + c / (x + 1.0 + i as f64));
    let t = x + 7.5;
    0.5 * (2.0 * PI).ln() + (x + 0.5) * t.ln() - t + sum.ln()
}

/// Regularised lower and upper incomplete gamma functions P(a, x) and Q(a, x) = 1 − P, for a > 0 and x ≥ 0.
///
/// Series below x = a + 1, continued fraction above (Press et al. 2007, "Numerical Recipes", section 6.2).
pub fn gamma_pq(a: f64, x: f64) -> (f64, f64) {
    if x <= 0.0 {
        return (0.0, 1.0);
    }
    if x == f64::INFINITY {
        return (1.0, 0.0);
    }
    let front = (a * x.ln() - x - ln_gamma(a)).exp();
    if x < a + 1.0 {
        let (mut term, mut sum, mut n) = (1.0 / a, 1.0 / a, a);
        while term > sum * 1e-17 {
            n += 1.0;
            term *= x / n;
            sum += term;
        }
        let p = (front * sum).min(1.0);
        (p, 1.0 - p)
    } else {
        let mut b = x + 1.0 - a;
        let (mut c, mut d) = (1.0 / TINY, 1.0 / b);
        let mut h = d;
        for i in 1..100_000 {
            let i = f64::from(i);
            let an = -i * (i - a);
            b += 2.0;
            d = 1.0 / not_zero(an * d + b);
            c = not_zero(b + an / c);
            h *= d * c;
            if (d * c - 1.0).abs() < 1e-15 {
                break;
            }
        }
        let q = (front * h).min(1.0);
        (1.0 - q, q)
    }
}

const TINY: f64 = 1e-300;

fn not_zero(x: f64) -> f64 {
    if x.abs() < TINY { TINY } else { x }
}

/// Regularised incomplete beta function I_x(a, b), for a, b > 0 and x in [0, 1].
///
/// Lentz's continued fraction (Press et al. 2007, "Numerical Recipes", section 6.4).
pub fn beta_regularized(a: f64, b: f64, x: f64) -> f64 {
    if x <= 0.0 {
        return 0.0;
    }
    if x >= 1.0 {
        return 1.0;
    }
    if x > (a + 1.0) / (a + b + 2.0) {
        return 1.0 - beta_regularized(b, a, 1.0 - x);
    }
    let front = (ln_gamma(a + b) - ln_gamma(a) - ln_gamma(b) + a * x.ln() + b * (-x).ln_1p()).exp() / a;
    let mut c = 1.0;
    let mut d = 1.0 / not_zero(1.0 - (a + b) * x / (a + 1.0));
    let mut h = d;
    for m in 1..100_000 {
        let m = f64::from(m);
        for numerator in [
            m * (b - m) * x / ((a + 2.0 * m - 1.0) * (a + 2.0 * m)),
            -(a + m) * (a + b + m) * x / ((a + 2.0 * m) * (a + 2.0 * m + 1.0)),
        ] {
            d = 1.0 / not_zero(1.0 + numerator * d);
            c = not_zero(1.0 + numerator / c);
            h *= d * c;
        }
        if (d * c - 1.0).abs() < 1e-15 {
            break;
        }
    }
    (front * h).min(1.0)
}

/// Probability that a standard normal variable is at most `z`.
pub fn normal_cdf(z: f64) -> f64 {
    let (p, q) = gamma_pq(0.5, 0.5 * z * z);
    if z < 0.0 { 0.5 * q } else { 0.5 + 0.5 * p }
}

/// Probability that a standard normal variable is farther from 0 than `z`: the p-value of a two-sided Z-test.
pub fn normal_two_sided(z: f64) -> f64 {
    gamma_pq(0.5, 0.5 * z * z).1
}

/// The z that a standard normal variable stays below with probability `p`; infinite for 0 and 1.
///
/// Acklam's rational approximation (relative error 1e-9), then one step of Halley's method.
pub fn normal_quantile(p: f64) -> f64 {
    const A: [f64; 6] = [
        -3.969_683_028_665_376e1,
        2.209_460_984_245_205e2,
        -2.759_285_104_469_687e2,
        1.383_577_518_672_69e2,
        -3.066_479_806_614_716e1,
        2.506_628_277_459_239,
    ];
    const B: [f64; 5] = [
        -5.447_609_879_822_406e1,
        1.615_858_368_580_409e2,
        -1.556_989_798_598_866e2,
        6.680_131_188_771_972e1,
        -1.328_068_155_288_572e1,
    ];
    const C: [f64; 6] = [
        -7.784_894_002_430_293e-3,
        -3.223_964_580_411_365e-1,
        -2.400_758_277_161_838,
        -2.549_732_539_343_734,
        4.374_664_141_464_968,
        2.938_163_982_698_783,
    ];
    const D: [f64; 4] =
        [7.784_695_709_041_462e-3, 3.224_671_290_700_398e-1, 2.445_134_137_142_996, 3.754_408_661_907_416];
    let horner = |terms: &[f64], x: f64| terms.iter().fold(0.0, |sum, c| sum * x + c);
    if p <= 0.0 || p >= 1.0 {
        return if p <= 0.0 { f64::NEG_INFINITY } else { f64::INFINITY };
    }
    if p > 0.5 {
        return -normal_quantile(1.0 - p);
    }
    let z = if p < 0.024_25 {
        let q = (-2.0 * p.ln()).sqrt();
        horner(&C, q) / (horner(&D, q) * q + 1.0)
    } else {
        let q = p - 0.5;
        let r = q * q;
        horner(&A, r) * q / (horner(&B, r) * r + 1.0)
    };
    let error = (normal_cdf(z) - p) * (2.0 * PI).sqrt() * (0.5 * z * z).exp();
    z - error / (1.0 + 0.5 * z * error)
}

/// Probability that a chi-square variable with `dof` degrees of freedom exceeds `statistic`.
pub fn chi_square_upper(statistic: f64, dof: f64) -> f64 {
    gamma_pq(0.5 * dof, 0.5 * statistic).1
}

/// Significance for each of `tests` independent tests such that all pass with probability 1 − `alpha` if all
/// hypotheses hold (Šidák 1967).
pub fn sidak(alpha: f64, tests: usize) -> f64 {
    -((-alpha).ln_1p() / tests as f64).exp_m1()
}

/// Probability of at most `hits` successes in `trials` of probability `p` each.
pub fn binomial_cdf(hits: u64, trials: u64, p: f64) -> f64 {
    if hits >= trials { 1.0 } else { beta_regularized((trials - hits) as f64, hits as f64 + 1.0, 1.0 - p) }
}

/// Largest probability of success that `hits` in `trials` leave plausible: one with more would give as few with
/// probability below `alpha` (Clopper and Pearson 1934).
pub fn binomial_upper_bound(hits: u64, trials: u64, alpha: f64) -> f64 {
    if hits >= trials {
        return 1.0;
    }
    let (mut low, mut high) = (hits as f64 / trials as f64, 1.0);
    for _ in 0..200 {
        let middle = 0.5 * (low + high);
        if binomial_cdf(hits, trials, middle) > alpha { low = middle } else { high = middle }
    }
    high
}

/// Largest probability of an event that was not seen in `trials` independent trials, at 95 %: about 3/trials
/// (the rule of three).
pub fn rule_of_three(trials: u64) -> f64 {
    -(0.05f64.ln() / trials as f64).exp_m1()
}

/// Outcome of a chi-square test.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ChiSquare {
    /// Σ (observed − expected)²/expected.
    pub statistic: f64,
    /// Degrees of freedom.
    pub dof: usize,
    /// Probability of a statistic at least as large if the expectation is right.
    pub p: f64,
}

/// Expected count below which cells are pooled.
const POOL: f64 = 5.0;

/// Compares counts with what is expected of them (Pearson 1900).
///
/// Cells that expect fewer than five are pooled. The expectations are scaled so that both sums are equal, which takes
/// one degree of freedom; check beforehand that the density integrates to 1, since this cannot see it.
///
/// A count where exactly nothing is expected gives p = 0.
///
/// # Panics
/// If the slices differ in length or nothing is expected anywhere.
pub fn chi_square_test(observed: &[u64], expected: &[f64]) -> ChiSquare {
    assert_eq!(observed.len(), expected.len(), "a count for each expectation");
    let trials: u64 = observed.iter().sum();
    let total: f64 = expected.iter().sum();
    assert!(total > 0.0, "something is expected");
    if observed.iter().zip(expected).any(|(&count, &expect)| count > 0 && expect <= 0.0) {
        return ChiSquare { statistic: f64::INFINITY, dof: observed.len() - 1, p: 0.0 };
    }
    let scale = trials as f64 / total;
    let mut cells: Vec<(f64, f64)> =
        observed.iter().zip(expected).map(|(&count, &expect)| (expect * scale, count as f64)).collect();
    cells.retain(|(expect, _)| *expect > 0.0);
    cells.sort_by(|a, b| a.0.total_cmp(&b.0));
    let (mut statistic, mut count) = (0.0, 0usize);
    let (mut pool_expect, mut pool_seen) = (0.0, 0.0);
    let mut left: f64 = cells.iter().map(|(expect, _)| expect).sum();
    for (expect, seen) in cells {
        pool_expect += expect;
        pool_seen += seen;
        left -= expect;
        // The rest joins this pool if it would not fill one of its own.
        if pool_expect >= POOL && left >= POOL {
            statistic += (pool_seen - pool_expect) * (pool_seen - pool_expect) / pool_expect;
            count += 1;
            (pool_expect, pool_seen) = (0.0, 0.0);
        }
    }
    if pool_expect > 0.0 {
        statistic += (pool_seen - pool_expect) * (pool_seen - pool_expect) / pool_expect;
        count += 1;
    }
    let dof = count - 1;
    let p = if dof == 0 { 1.0 } else { chi_square_upper(statistic, dof as f64) };
    ChiSquare { statistic, dof, p }
}

/// Mean and variance of a stream of numbers (Welford 1962).
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Moments {
    /// How many.
    pub count: u64,
    /// Their mean.
    pub mean: f64,
    /// Sum of squared deviations from the mean.
    pub squares: f64,
}

impl Moments {
    /// Takes in one more number.
    pub fn push(&mut self, x: f64) {
        self.count += 1;
        let off = x - self.mean;
        self.mean += off / self.count as f64;
        self.squares += off * (x - self.mean);
    }

    /// Unbiased estimate of the variance of one number; 0 below two.
    pub fn variance(&self) -> f64 {
        if self.count < 2 { 0.0 } else { self.squares / (self.count - 1) as f64 }
    }

    /// Estimate of the standard deviation of the mean.
    pub fn standard_error(&self) -> f64 {
        (self.variance() / self.count as f64).sqrt()
    }

    /// Two-sided p-value of the hypothesis that the mean is `expected`, by the normal approximation.
    pub fn p_value(&self, expected: f64) -> f64 {
        let off = (self.mean - expected).abs();
        if off == 0.0 { 1.0 } else { normal_two_sided(off / self.standard_error()) }
    }
}

impl FromIterator<f64> for Moments {
    fn from_iter<I: IntoIterator<Item = f64>>(numbers: I) -> Self {
        let mut moments = Self::default();
        numbers.into_iter().for_each(|x| moments.push(x));
        moments
    }
}

/// Half the width of the interval around a mean that holds the expectation with probability `confidence`, in
/// standard errors.
pub fn confidence_factor(confidence: f64) -> f64 {
    -normal_quantile(0.5 * (1.0 - confidence))
}

/// Error function, by way of the incomplete gamma function.
pub fn erf(x: f64) -> f64 {
    2.0 * normal_cdf(x * SQRT_2) - 1.0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[track_caller]
    fn check_near(got: f64, want: f64, relative: f64) {
        assert!((got - want).abs() <= relative * want.abs(), "{got} is not {want}");
    }

    /// Γ(n) = (n − 1)!, Γ(1/2) = √π, and the reflection.
    #[test]
    fn gamma_continues_the_factorial() {
        check_near(ln_gamma(11.0), 3_628_800f64.ln(), 1e-14);
        check_near(ln_gamma(0.5), PI.sqrt().ln(), 1e-13);
        check_near(ln_gamma(0.25), 3.625_609_908_221_908f64.ln(), 1e-13);
        check_near(ln_gamma(171.0), 706.573_062_245_787_5, 1e-13);
        // P(1, x) = 1 − e⁻ˣ on both sides of the switch between series and fraction.
        for x in [0.1, 1.0, 1.9, 2.1, 10.0, 50.0] {
            check_near(gamma_pq(1.0, x).1, (-x).exp(), 1e-12);
            check_near(gamma_pq(1.0, x).0, -(-x).exp_m1(), 1e-12);
        }
    }

    /// Quantiles as printed in tables (NIST/SEMATECH e-Handbook, 1.3.6.7).
    #[test]
    fn quantiles_agree_with_the_published_tables() {
        for (z, p) in [(1.281_551_565_5, 0.90), (1.644_853_627, 0.95), (1.959_963_985, 0.975), (2.575_829_304, 0.995)] {
            check_near(normal_cdf(z), p, 1e-9);
            check_near(normal_quantile(p), z, 1e-9);
            check_near(normal_two_sided(z), 2.0 * (1.0 - p), 1e-7);
            check_near(normal_cdf(-z), 1.0 - p, 1e-7);
        }
        check_near(confidence_factor(0.95), 1.959_963_984_540_054, 1e-12);
        // Six sigma: the upper tail is not lost to cancellation.
        check_near(normal_two_sided(6.0), 1.973_175_290_075_4e-9, 1e-10);
        check_near(erf(0.5), 0.520_499_877_813_046_5, 1e-12);
        for p in [1e-12, 1e-5, 0.02, 0.3, 0.5 - 1e-9] {
            check_near(normal_cdf(normal_quantile(p)), p, 1e-11);
        }
        for (dof, at_95, at_99) in [
            (1.0, 3.841, 6.635),
            (2.0, 5.991, 9.210),
            (5.0, 11.070, 15.086),
            (10.0, 18.307, 23.209),
            (30.0, 43.773, 50.892),
            (100.0, 124.342, 135.807),
        ] {
            assert!((chi_square_upper(at_95, dof) - 0.05).abs() < 3e-5, "{dof}");
            assert!((chi_square_upper(at_99, dof) - 0.01).abs() < 1e-5, "{dof}");
        }
        // With two degrees of freedom the tail is e^(−x/2), with many it is nearly normal.
        check_near(chi_square_upper(60.0, 2.0), (-30.0f64).exp(), 1e-12);
        let (dof, z) = (1e6, 2.0);
        let hilferty = dof * (1.0 - 2.0 / (9.0 * dof) + z * (2.0 / (9.0f64 * dof)).sqrt()).powi(3);
        check_near(chi_square_upper(hilferty, dof), normal_cdf(-z), 1e-4);
    }

    /// Against sums of binomial probabilities, and the figures of Clopper and Pearson for 0 and 10 of 20.
    #[test]
    fn binomial_tails_are_sums() {
        let (n, p) = (20u64, 0.3f64);
        let mut sum = 0.0;
        for k in 0..=n {
            let choose = (0..k).fold(1.0, |c, i| c * (n - i) as f64 / (i + 1) as f64);
            sum += choose * p.powi(k as i32) * (1.0 - p).powi((n - k) as i32);
            check_near(binomial_cdf(k, n, p), sum, 1e-11);
        }
        check_near(binomial_upper_bound(0, 20, 0.05), 1.0 - 0.05f64.powf(1.0 / 20.0), 1e-10);
        check_near(binomial_upper_bound(10, 20, 0.025), 0.728_02, 1e-4);
        check_near(rule_of_three(20), binomial_upper_bound(0, 20, 0.05), 1e-9);
        check_near(rule_of_three(1000), 3.0 / 1000.0, 0.01);
    }

    #[test]
    fn sidak_keeps_the_family_at_its_level() {
        check_near((1.0 - sidak(0.01, 500)).powi(500), 0.99, 1e-12);
        check_near(sidak(0.05, 1), 0.05, 1e-14);
        check_near(sidak(1e-12, 1_000_000), 1e-18, 1e-9);
    }

    /// Mendel's peas: 315, 108, 101, 32 against 9:3:3:1 gives 0.470 with three degrees of freedom, p = 0.925.
    #[test]
    fn mendels_peas_are_as_he_expected() {
        let test = chi_square_test(&[315, 108, 101, 32], &[9.0, 3.0, 3.0, 1.0]);
        assert_eq!(test.dof, 3);
        assert!((test.statistic - 0.470).abs() < 5e-4 && (test.p - 0.925).abs() < 5e-4, "{test:?}");
    }

    #[test]
    fn small_cells_are_pooled_and_impossible_ones_fail() {
        let test = chi_square_test(&[50, 48, 1, 0, 1], &[49.0, 49.0, 0.7, 0.7, 0.6]);
        assert_eq!(test.dof, 1, "the three small ones cannot fill a pool and join the next");
        assert!(test.p > 0.5);
        assert_eq!(chi_square_test(&[50, 50, 1], &[1.0, 1.0, 0.0]).p, 0.0);
        assert_eq!(chi_square_test(&[50, 50, 0], &[1.0, 1.0, 0.0]).dof, 1);
        assert_eq!(chi_square_test(&[3], &[1.0]).p, 1.0);
        assert!(chi_square_test(&[600, 400], &[1.0, 1.0]).p < 1e-9);
    }

    #[test]
    fn moments_are_those_of_the_list() {
        let moments: Moments = [2.0, 4.0, 4.0, 4.0, 5.0, 5.0, 7.0, 9.0].into_iter().collect();
        assert_eq!((moments.count, moments.mean, moments.squares), (8, 5.0, 32.0));
        check_near(moments.standard_error(), (32.0f64 / 7.0 / 8.0).sqrt(), 1e-15);
        assert_eq!(moments.p_value(5.0), 1.0);
        assert!(moments.p_value(8.0) < 1e-4);
    }
}
