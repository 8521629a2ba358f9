//! The lanes of a block that go on, side by side.

use wide::u32x8;

use super::LANES;

/// Which lanes to take, in order, for each set of lanes.
static ORDER: [[u32; LANES]; 1 << LANES] = {
    let mut all = [[0; LANES]; 1 << LANES];
    let mut lanes = 0;
    while lanes < 1 << LANES {
        let (mut lane, mut place) = (0, 0);
        while lane < LANES {
            if lanes >> lane & 1 == 1 {
                all[lanes][place] = lane as u32;
                place += 1;
            }
            lane += 1;
        }
        lanes += 1;
    }
    all
};

/// Brings some lanes of blocks to the front.
#[derive(Clone, Copy, Debug)]
pub struct Compress {
    order: u32x8,
    /// How many.
    pub count: usize,
}

impl Compress {
    /// The lanes whose bits are set.
    #[inline(always)]
    pub fn new(lanes: u32) -> Self {
        let lanes = lanes & 0xff;
        Self { order: u32x8::new(ORDER[lanes as usize]), count: lanes.count_ones() as usize }
    }

    /// Those lanes first, in their order; behind them repetitions.
    #[inline(always)]
    pub fn apply<T: bytemuck::Pod>(self, block: [T; LANES]) -> [T; LANES] {
        const { assert!(size_of::<T>() == 4, "lanes of 32 bits") };
        bytemuck::cast::<[u32; LANES], _>(bytemuck::cast::<_, u32x8>(block).shuffle_wrapping(self.order).to_array())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lanes_come_in_order() {
        let block: [f32; LANES] = std::array::from_fn(|lane| lane as f32 + 0.5);
        for lanes in 0..1 << LANES {
            let compress = Compress::new(lanes);
            let want: Vec<f32> = (0..LANES).filter(|lane| lanes >> lane & 1 == 1).map(|lane| block[lane]).collect();
            assert_eq!(compress.apply(block)[..compress.count], want);
        }
    }
}
