//! What flows between the stages.

use crate::{
    simd::{Compress, LANES},
    soa,
};

/// Declares a table of 32-bit columns that blocks of eight rows are put into, some of their lanes at a time.
///
/// As `soa!`, with the struct of a block in addition. Behind the last row each column has room, so that a whole vector is written
/// where fewer lanes count.
macro_rules! queue {
    ($(#[$meta:meta])* pub struct $table:ident of $row:ident by $block:ident { $($(#[$fmeta:meta])* $field:ident: $ty:ty,)+ }) => {
        soa! { $(#[$meta])* pub struct $table of $row { $($(#[$fmeta])* $field: $ty,)+ } }

        #[doc = concat!("Eight rows of [`", stringify!($table), "`], lane by lane.")]
        #[derive(Clone, Copy, Debug)]
        pub struct $block { $($(#[$fmeta])* pub $field: [$ty; LANES],)+ }

        #[allow(dead_code)]
        impl $table {
            /// Forgets all rows and keeps the room for them.
            pub fn rewind(&mut self) { self.len = 0; }

            /// Makes room for so many rows.
            pub fn make_room(&mut self, rows: usize) {
                let room = rows.next_multiple_of(LANES) + 2 * LANES;
                $(if self.$field.len() < room { self.$field.resize(room, <$ty>::default()); })+
            }

            /// Adds the rows of the lanes whose bits are set, for which there must be room.
            #[inline(always)]
            pub fn put(&mut self, block: &$block, lanes: u32) {
                let compress = Compress::new(lanes);
                let at = self.len;
                $(self.$field[at..at + LANES].copy_from_slice(&compress.apply(block.$field));)+
                self.len = at + compress.count;
            }

            /// The eight rows from `first` on; those behind the last one hold anything.
            #[inline(always)]
            pub fn block(&self, first: usize) -> $block {
                $block { $($field: *self.$field[first..].first_chunk().expect("there is room behind the last row"),)+ }
            }
        }
    };
}

pub(super) use queue;

queue! {
    /// Paths under way, one row each. A row's ray starts at the path's last vertex.
    pub struct PathQueue of Path by PathBlock {
        /// Start of the ray, m; off the surface it leaves by more than its rounding error.
        ox: f32,
        /// As above.
        oy: f32,
        /// As above.
        oz: f32,
        /// Direction, unit length.
        dx: f32,
        /// As above.
        dy: f32,
        /// As above.
        dz: f32,
        /// Nothing is met beyond this, m.
        t_max: f32,
        /// Share of the light at the far end that reaches the pixel, red.
        throughput_r: f32,
        /// As above, green.
        throughput_g: f32,
        /// As above, blue.
        throughput_b: f32,
        /// Density per sr with which the BSDF drew the direction; 0 where no light sample competes
        /// with it: camera rays and deltas.
        pdf: f32,
        /// Product of η² along the path, which roulette must not take for a gain or loss. Its sign says whether the path's light
        /// may come [from the emitters](super::caustic).
        eta_scale: f32,
        /// Place of the pixel in the tile sums.
        slot: u32,
        /// Index of the sample.
        sample: u32,
        /// Place of its numbers in the sampler's sequence: that of the sample, or of all who share.
        index: u32,
        /// Stands for the pixel in the sampler, or for all who share.
        pixel_hash: u32,
        /// Scatterings behind it.
        depth: u32,
        /// Material row of the solid that the ray is inside, or `NONE`.
        medium: u32,
        /// The side of the surface that the ray left to, as a [`Receiver`](crate::light::Receiver) reads it.
        side: u32,
    }
}

soa! {
    /// What the rays of a [`PathQueue`] met, row by row.
    pub struct HitQueue of HitRow {
        /// Distance, m; infinite for none.
        t: f32,
        /// Barycentric of the second corner.
        b1: f32,
        /// Barycentric of the third corner.
        b2: f32,
        /// Row of the instance, or `NONE`.
        instance: u32,
        /// Row of the triangle in its mesh.
        triangle: u32,
        /// 1 if the back was met.
        back: u32,
    }
}

queue! {
    /// Rays towards lights, with the light that they carry if nothing is in the way.
    pub struct ShadowQueue of Shadow by ShadowBlock {
        /// Start, m.
        ox: f32,
        /// As above.
        oy: f32,
        /// As above.
        oz: f32,
        /// Direction, not of unit length.
        dx: f32,
        /// As above.
        dy: f32,
        /// As above.
        dz: f32,
        /// End, in units of the direction.
        t_max: f32,
        /// Decides about surfaces that cover in part.
        ray_id: u32,
        /// What the pixel gets, nit, red.
        light_r: f32,
        /// As above, green.
        light_g: f32,
        /// As above, blue.
        light_b: f32,
        /// Place of the pixel in the tile sums.
        slot: u32,
        /// Index of the sample.
        sample: u32,
    }
}

queue! {
    /// Rays from near vertices to far ones.
    pub struct LinkQueue of Link by LinkBlock {
        /// Start, m.
        ox: f32,
        /// As above.
        oy: f32,
        /// As above.
        oz: f32,
        /// Way to the end, m, or the direction.
        dx: f32,
        /// As above.
        dy: f32,
        /// As above.
        dz: f32,
        /// End, in units of the way.
        t_max: f32,
    }
}

/// Bytes that a path takes over all queues: two path rows (old and new), a hit, a shadow ray, a sort entry.
pub const BYTES_PER_PATH: usize =
    2 * PathQueue::ROW_BYTES + HitQueue::ROW_BYTES + ShadowQueue::ROW_BYTES + size_of::<u32>();
