//! Words on pictures of pixels.

use embedded_graphics::Drawable;
use embedded_graphics::{
    Pixel,
    draw_target::DrawTarget,
    geometry::{Dimensions, OriginDimensions, Point, Size},
    mono_font::{MonoFont, MonoTextStyle, iso_8859_1::FONT_7X13},
    pixelcolor::Rgb888,
    prelude::RgbColor,
    primitives::{Line, Primitive, PrimitiveStyle, Rectangle},
    text::{Alignment, Baseline, Text, TextStyleBuilder},
};

/// Eight bits of each channel, rows from the top.
#[derive(Clone, Debug)]
pub struct Canvas {
    width: usize,
    rgb: Vec<[u8; 3]>,
}

const FONT: MonoFont = FONT_7X13;
/// Height of a line of text, pixels.
pub const LINE: u32 = 16;

impl Canvas {
    /// All of one colour.
    pub fn new([width, height]: [u32; 2], color: [u8; 3]) -> Self {
        Self { width: width as usize, rgb: vec![color; width as usize * height as usize] }
    }

    /// Copies rows of such a width to a place.
    pub fn paste(&mut self, [x, y]: [u32; 2], width: u32, pixels: &[[u8; 3]]) {
        for (row, pixels) in pixels.chunks(width as usize).enumerate() {
            let start = (y as usize + row) * self.width + x as usize;
            self.rgb[start..start + pixels.len()].copy_from_slice(pixels);
        }
    }

    /// A line of text, in Latin-1, from its upper left corner on.
    pub fn write(&mut self, [x, y]: [u32; 2], text: &str, color: [u8; 3]) {
        let style = MonoTextStyle::new(&FONT, rgb(color));
        let place = TextStyleBuilder::new().baseline(Baseline::Top).alignment(Alignment::Left).build();
        let Ok(_) = Text::with_text_style(text, Point::new(x as i32, y as i32), style, place).draw(self);
    }

    /// The width of a line of text, pixels.
    pub fn width_of(text: &str) -> u32 {
        text.chars().count() as u32 * (FONT.character_size.width + FONT.character_spacing)
    }

    /// A cross with nothing in its middle, so that what it marks can be seen.
    pub fn mark(&mut self, [x, y]: [i32; 2], color: [u8; 3]) {
        for (a, b) in [((-9, 0), (-3, 0)), ((3, 0), (9, 0)), ((0, -9), (0, -3)), ((0, 3), (0, 9))] {
            for (shift, color) in [(1, [0; 3]), (0, color)] {
                let at = |(dx, dy): (i32, i32)| Point::new(x + dx + shift, y + dy + shift);
                let style = PrimitiveStyle::with_stroke(rgb(color), 1);
                let Ok(()) = Line::new(at(a), at(b)).into_styled(style).draw(self);
            }
        }
    }

    /// The pixels as an image file has them.
    pub fn into_image(self) -> image::RgbImage {
        let height = self.rgb.len() / self.width.max(1);
        image::RgbImage::from_raw(self.width as u32, height as u32, self.rgb.concat()).unwrap_or_default()
    }
}

fn rgb([r, g, b]: [u8; 3]) -> Rgb888 {
    Rgb888::new(r, g, b)
}

impl OriginDimensions for Canvas {
    fn size(&self) -> Size {
        Size::new(self.width as u32, (self.rgb.len() / self.width.max(1)) as u32)
    }
}

impl DrawTarget for Canvas {
    type Color = Rgb888;
    type Error = std::convert::Infallible;

    fn draw_iter<I: IntoIterator<Item = Pixel<Rgb888>>>(&mut self, pixels: I) -> Result<(), Self::Error> {
        let all: Rectangle = self.bounding_box();
        for Pixel(at, color) in pixels.into_iter().filter(|pixel| all.contains(pixel.0)) {
            self.rgb[at.y as usize * self.width + at.x as usize] = [color.r(), color.g(), color.b()];
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_are_there_and_stay_on_the_canvas() {
        let mut canvas = Canvas::new([40, 20], [0; 3]);
        canvas.write([2, 2], "K²E and much more", [255; 3]);
        canvas.mark([39, 19], [255, 0, 0]);
        let lit = |canvas: &Canvas, x: usize| (0..20).any(|y| canvas.rgb[y * 40 + x] != [0; 3]);
        assert!((2..9).any(|x| lit(&canvas, x)) && !lit(&canvas, 0));
        let image = canvas.into_image();
        assert_eq!((image.width(), image.height()), (40, 20));
        assert_eq!(Canvas::width_of("K²E"), 21);
    }
}
