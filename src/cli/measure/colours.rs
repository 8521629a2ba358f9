//! Readings as pictures in false colours.

use wavecast::measure::heat;

use crate::cli::label::{Canvas, LINE};

const PAPER: [u8; 3] = [255; 3];
const INK: [u8; 3] = [20; 3];
/// Least width and height of the picture, pixels.
const LEAST: u32 = 320;
const BAR: u32 = 18;
const MARGIN: u32 = 8;

/// How numbers become places between 0 and 1.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Scale {
    /// From zero to this.
    Linear(f64),
    /// From this by as many powers of ten, which eyes see as even steps.
    Log(f64, f64),
}

/// Powers of ten that a logarithmic scale has at most.
const MOST_DECADES: f64 = 5.0;

impl Scale {
    fn most(values: &[f64]) -> f64 {
        values.iter().copied().fold(0.0, f64::max).max(f64::MIN_POSITIVE)
    }

    /// From black to the brightest.
    pub fn linear(values: &[f64]) -> Self {
        Self::Linear(Self::most(values))
    }

    /// Down to the darkest hundredth of what is not black.
    pub fn log(values: &[f64]) -> Self {
        let most = Self::most(values);
        let mut lit: Vec<f64> = values.iter().copied().filter(|&value| value > 0.0).collect();
        lit.sort_unstable_by(f64::total_cmp);
        let least = lit.get(lit.len() / 100).map_or(most, |&least| least.min(most / 10.0));
        let decades = (most / least).log10().clamp(1.0, MOST_DECADES);
        Self::Log(most / 10_f64.powf(decades), decades)
    }

    fn place(self, value: f64) -> f64 {
        match self {
            Self::Linear(most) => value / most,
            Self::Log(least, decades) => (value.max(least) / least).log10() / decades,
        }
    }

    fn value(self, place: f64) -> f64 {
        match self {
            Self::Linear(most) => place * most,
            Self::Log(least, decades) => least * 10_f64.powf(place * decades),
        }
    }
}

/// Readings as colours from black over purple and orange to pale yellow beside a legend.
pub fn false_colours(size: [u32; 2], values: &[f64], unit: &str, scale: Scale) -> image::RgbImage {
    let color = |share: f64| heat::magma(share as f32).map(|c| (c * 255.0).round() as u8);
    let times = (LEAST / size[0].max(size[1]).max(1)).max(1);
    let (width, height) = (size[0] * times, size[1] * times);
    let ticks: Vec<String> = (0..=4).map(|i| format!("{:.4} {unit}", scale.value(f64::from(i) / 4.0))).collect();
    let words = ticks.iter().map(|text| Canvas::width_of(text)).max().unwrap_or(0);
    let bar_height = height.max(8 * LINE);
    let mut canvas = Canvas::new([width + BAR + words + 4 * MARGIN, bar_height + 2 * MARGIN], PAPER);
    let rows = (0..height).flat_map(|y| (0..width).map(move |x| (x / times, y / times)));
    let pixels: Vec<[u8; 3]> = rows.map(|(x, y)| color(scale.place(values[(y * size[0] + x) as usize]))).collect();
    canvas.paste([MARGIN, MARGIN], width, &pixels);
    let left = width + 2 * MARGIN;
    for y in 0..bar_height {
        let share = 1.0 - (f64::from(y) + 0.5) / f64::from(bar_height);
        canvas.paste([left, MARGIN + y], BAR, &[color(share); BAR as usize]);
    }
    for (i, tick) in (0..).zip(&ticks) {
        let y = MARGIN + (bar_height - LINE) - i * (bar_height - LINE) / 4;
        canvas.write([left + BAR + MARGIN, y], tick, INK);
    }
    canvas.into_image()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scales_go_from_the_dark_to_the_bright_end_and_back() {
        let values: Vec<f64> = (0..1000).map(|i| f64::from(i) * f64::from(i)).collect();
        for scale in [Scale::linear(&values), Scale::log(&values)] {
            assert!((scale.place(998_001.0) - 1.0).abs() < 1e-12);
            assert!([0.1, 0.5, 0.9].iter().all(|&place| (scale.place(scale.value(place)) - place).abs() < 1e-12));
        }
        assert_eq!(Scale::log(&[0.0, 100.0, 100.0]), Scale::Log(10.0, 1.0));
        assert_eq!(Scale::log(&[0.0; 4]).place(0.0), 0.0);
    }
}
