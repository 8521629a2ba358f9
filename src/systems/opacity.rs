//! Materials to what is known of the triangles that show them.

use crate::{
    accel::Opacity,
    flat::{Materials, flags},
};

/// What is known of a mesh's triangles, whichever entity shows them. All are solid by default.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct MeshOpacity {
    /// By material slot; empty if all are solid.
    slots: Vec<Opacity>,
}

impl MeshOpacity {
    /// Of a mesh shown by several entities, given the rows of the materials that each of them has in the mesh's slots.
    pub fn of_users<'a>(materials: &Materials, users: impl Iterator<Item = &'a [u32]>) -> Self {
        let mut slots: Vec<Opacity> = Vec::new();
        for rows in users {
            let own = rows.iter().map(|&row| of_material(materials.flags[row as usize]));
            if slots.is_empty() {
                slots.extend(own);
            } else {
                slots.iter_mut().zip(own).for_each(|(known, own)| *known = known.and(own));
            }
        }
        if slots.iter().all(|&slot| slot == Opacity::Solid) { Self::default() } else { Self { slots } }
    }

    /// That of a triangle, given the slots of all triangles.
    pub fn of(&self, slots: &[u16], triangle: u32) -> Opacity {
        let slot = slots.get(triangle as usize).copied().unwrap_or_default();
        self.slots.get(usize::from(slot)).copied().unwrap_or_default()
    }
}

/// What a material's flags say without a look at any texture.
fn of_material(bits: u32) -> Opacity {
    if bits & (flags::MASK | flags::BLEND) != 0 {
        Opacity::Asked
    } else if bits & (flags::DOUBLE_SIDED | flags::TRANSMISSION) == 0 {
        Opacity::FrontOnly
    } else {
        Opacity::Solid
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::flat::MaterialRow;

    #[test]
    fn what_entities_do_not_agree_upon_is_asked() {
        let mut materials = Materials::default();
        for bits in [0, flags::DOUBLE_SIDED, flags::MASK | flags::DOUBLE_SIDED, flags::TRANSMISSION] {
            materials.push(MaterialRow { flags: bits, ..MaterialRow::default() });
        }
        let of = |users: &[&[u32]]| MeshOpacity::of_users(&materials, users.iter().copied());
        let slots = [0, 1, 2, 0];
        let each = |opacity: &MeshOpacity| [0, 1, 2, 3].map(|triangle| opacity.of(&slots, triangle));
        let (solid, front, asked) = (Opacity::Solid, Opacity::FrontOnly, Opacity::Asked);
        assert_eq!(each(&of(&[&[0, 1, 2]])), [front, solid, asked, front]);
        assert_eq!(each(&of(&[&[0, 1, 2], &[0, 3, 2]])), [front, solid, asked, front]);
        assert_eq!(each(&of(&[&[0, 1, 2], &[1, 1, 1]])), [asked, solid, asked, asked]);
        assert_eq!(of(&[&[1, 3, 1], &[3, 3, 1]]), MeshOpacity::default());
    }
}
