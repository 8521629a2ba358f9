//! Memory that trees lie in: one piece, in units of half a cache line, on huge pages where the system gives them.

use memmap2::MmapMut;
use rayon::prelude::*;

use crate::simd::LANES;

/// Eight numbers of 32 bits, the unit of an [`Arena`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C, align(32))]
pub struct Granule(pub [u32; LANES]);

impl Granule {
    /// Of single-precision numbers.
    pub fn of(values: [f32; LANES]) -> Self {
        Self(values.map(f32::to_bits))
    }

    /// As single-precision numbers.
    #[inline(always)]
    pub fn values(self) -> [f32; LANES] {
        bytemuck::cast(self.0)
    }
}

/// From here on huge pages are asked for: below, a tree touches few ordinary ones.
const HUGE: usize = 1 << 21;

/// An array of granules, written as a tree is built or refitted.
///
/// A tree of a million triangles lies on some 20,000 ordinary pages, more than a core remembers the places of.
#[derive(Debug)]
pub enum Arena {
    /// Ordinary memory.
    Heap(Vec<Granule>),
    /// Pages of its own, huge if the system gives them.
    Pages(MmapMut),
}

impl Default for Arena {
    fn default() -> Self {
        Self::Heap(Vec::new())
    }
}

impl Arena {
    /// So many granules of zeros.
    pub fn zeroed(granules: usize) -> Self {
        let bytes = granules * size_of::<Granule>();
        let heap = || Self::Heap(vec![Granule::default(); granules]);
        if bytes < HUGE {
            return heap();
        }
        // Without pages of its own it lies elsewhere, which is slower and as right.
        let Ok(mut pages) = MmapMut::map_anon(bytes) else { return heap() };
        #[cfg(target_os = "linux")]
        let _ = pages.advise(memmap2::Advice::HugePage);
        // The system clears a page when it is touched first: by all threads, not by whoever writes the first nodes.
        pages.par_chunks_mut(HUGE).for_each(|page| page[0] = 0);
        Self::Pages(pages)
    }

    /// The granules.
    pub fn granules(&self) -> &[Granule] {
        match self {
            Self::Heap(granules) => granules,
            Self::Pages(pages) => bytemuck::cast_slice(pages),
        }
    }

    /// The granules, while a tree is written.
    pub fn granules_mut(&mut self) -> &mut [Granule] {
        match self {
            Self::Heap(granules) => granules,
            Self::Pages(pages) => bytemuck::cast_slice_mut(pages),
        }
    }

    /// Bytes held.
    pub fn bytes(&self) -> usize {
        size_of_val(self.granules())
    }
}

impl Clone for Arena {
    fn clone(&self) -> Self {
        let mut copy = Self::zeroed(self.granules().len());
        copy.granules_mut().copy_from_slice(self.granules());
        copy
    }
}
