//! Numbers as colours, for pictures of errors.

/// Sixteen even steps of matplotlib's `magma` (CC0), sRGB; linear in between, off by at most 0.02.
const MAGMA: [[f32; 3]; 16] = [
    [0.001, 0.0, 0.014],
    [0.044, 0.034, 0.142],
    [0.124, 0.067, 0.296],
    [0.232, 0.06, 0.438],
    [0.341, 0.081, 0.493],
    [0.445, 0.123, 0.507],
    [0.55, 0.161, 0.506],
    [0.658, 0.196, 0.49],
    [0.767, 0.234, 0.458],
    [0.869, 0.288, 0.409],
    [0.944, 0.378, 0.365],
    [0.981, 0.498, 0.37],
    [0.995, 0.624, 0.427],
    [0.997, 0.748, 0.517],
    [0.993, 0.87, 0.626],
    [0.987, 0.991, 0.75],
];

/// Black over purple and orange to pale yellow for 0 to 1, as sRGB numbers.
pub fn magma(value: f32) -> [f32; 3] {
    let at = value.clamp(0.0, 1.0) * (MAGMA.len() - 1) as f32;
    // A value that is not a number goes to the dark end.
    let low = (at as usize).min(MAGMA.len() - 2);
    let share = (at - low as f32).max(0.0);
    [0, 1, 2].map(|c| MAGMA[low][c] + share * (MAGMA[low + 1][c] - MAGMA[low][c]))
}

/// White for 0, towards red for positive and blue for negative numbers up to ±1, as sRGB numbers.
pub fn signed(value: f32) -> [f32; 3] {
    let full = if value < 0.0 { [0.1, 0.25, 0.75] } else { [0.75, 0.1, 0.1] };
    let share = value.abs().min(1.0);
    full.map(|c: f32| 1.0 + share * (c - 1.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn maps_start_and_end_where_they_should() {
        assert_eq!(magma(0.0), MAGMA[0]);
        assert_eq!(magma(2.0), MAGMA[15]);
        assert_eq!(magma(f32::NAN), MAGMA[0]);
        assert_eq!(signed(0.0), [1.0; 3]);
        assert!(signed(1.0)[0] > signed(1.0)[2] && signed(-1.0)[2] > signed(-1.0)[0]);
    }
}
