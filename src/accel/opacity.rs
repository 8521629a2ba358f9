//! Which rays a triangle stops, as far as that is known beforehand.
//!
//! Most surfaces stop all rays, or all that meet their front. That is kept in two bits of a triangle's row, where the test
//! itself can look; only what depends on a texture or on chance is asked of a [`Coverage`](super::Coverage).

/// What is known of a triangle before any ray meets it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Opacity {
    /// It stops every ray.
    #[default]
    Solid,
    /// It stops every ray that meets its front, and is not there for others.
    FrontOnly,
    /// It has to be asked.
    Asked,
}

/// The bits of a row that are its own.
pub(super) const ROW: u32 = (1 << 30) - 1;
/// Marks a row whose triangle has no back.
pub(super) const FRONT_ONLY: u32 = 1 << 30;
/// Marks a row whose triangle has to be asked.
pub(super) const ASKED: u32 = 1 << 31;

impl Opacity {
    /// As the bits of a row that are not its own.
    pub(super) fn bits(self) -> u32 {
        match self {
            Self::Solid => 0,
            Self::FrontOnly => FRONT_ONLY,
            Self::Asked => ASKED,
        }
    }

    /// From a row with its bits.
    #[inline(always)]
    pub(super) fn of(row: u32) -> Self {
        if row & ASKED != 0 {
            Self::Asked
        } else if row & FRONT_ONLY != 0 {
            Self::FrontOnly
        } else {
            Self::Solid
        }
    }

    /// What is known of a triangle that is to have both: the same, or nothing.
    pub fn and(self, other: Self) -> Self {
        if self == other { self } else { Self::Asked }
    }
}
