//! The operator series L = E + KE + K²E + …, as its terms are measured.

use super::student::Estimate;

/// What follows the last of the terms, by channel, if each further one is the same share of the one before.
///
/// K is a positive operator whose spectral radius is below one, so its powers come to fall like a geometric series (Kajiya 1986,
/// "The Rendering Equation", section 3; Arvo 1995, "Analytic Methods for Simulated Light Transport", section 4.4); how soon, depends
/// on the scene. The share is taken from the last term and the one two before, so that a scene of two parts that send light
/// back and forth is judged by a whole turn. None if there are not two terms, or if they do not fall.
pub fn tail(terms: &[[Estimate; 3]]) -> Option<[f64; 3]> {
    let [before_last @ .., last] = terms else { return None };
    let mut rest = [0.0; 3];
    for (c, rest) in rest.iter_mut().enumerate() {
        let value = |term: &[Estimate; 3]| term[c].value;
        let last = value(last);
        if last <= 0.0 {
            continue;
        }
        // The terms that each further turn repeats, and the share that it leaves of them.
        let (turn, first) = match before_last {
            [.., first, middle] => (value(middle) + last, value(first)),
            [first] => (last, value(first)),
            [] => return None,
        };
        let share = last / first;
        if !(first > 0.0 && share < 1.0) {
            return None;
        }
        *rest = turn * share / (1.0 - share);
    }
    Some(rest)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn term(value: f64) -> [Estimate; 3] {
        [Estimate { value, variance: 0.0, dof: 3.0 }; 3]
    }

    #[test]
    fn the_tail_of_a_geometric_series_is_exact() {
        // 1 + 1/2 + 1/4 + …: what follows a term is as much as the term.
        assert_eq!(tail(&[term(1.0), term(0.5), term(0.25)]), Some([0.25; 3]));
        assert_eq!(tail(&[term(0.5), term(0.25)]), Some([0.25; 3]));
        // Two rooms: 1, 0.1, 0.25, 0.025, 0.0625, …; a third of 0.35.
        let rest = tail(&[term(1.0), term(0.1), term(0.25)]).unwrap();
        assert!((rest[0] - 0.35 / 3.0).abs() < 1e-12);
        assert_eq!(tail(&[term(0.0), term(0.0), term(0.0)]), Some([0.0; 3]));
    }

    #[test]
    fn what_does_not_fall_has_no_tail_that_could_be_told() {
        assert_eq!(tail(&[term(1.0)]), None);
        assert_eq!(tail(&[term(1.0), term(2.0), term(1.0)]), None);
        assert_eq!(tail(&[term(0.0), term(1.0)]), None);
    }
}
