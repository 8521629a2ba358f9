//! Materials to what is known of the triangles that show them.

use std::{collections::HashMap, sync::Arc};

use super::{geometry::Form, least_alpha::LeastAlpha};
use crate::{
    accel::Opacity,
    flat::{COVERS, FlatImage, FlatScene, Materials, NONE, Textures, flags},
    world::TriMesh,
};

/// What is known of a mesh's triangles, whichever entity shows them. All are solid by default.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct MeshOpacity {
    /// By material slot; empty if all are solid.
    slots: Vec<Opacity>,
    /// By triangle, where textures or vertices tell more; empty if they do not.
    triangles: Vec<Opacity>,
}

impl MeshOpacity {
    /// Of a mesh shown by several entities, given the rows of the materials that each of them has in the mesh's slots.
    pub fn of_users(form: &Form, users: &[&[u32]], flat: &FlatScene, images: &mut AlphaCache) -> Self {
        let Some((first, others)) = users.split_first() else { return Self::default() };
        let materials = &flat.materials;
        let mut slots: Vec<Opacity> = first.iter().map(|&row| of_material(materials, row)).collect();
        for rows in others {
            let own = rows.iter().map(|&row| of_material(materials, row));
            slots.iter_mut().zip(own).for_each(|(known, own)| *known = known.and(own));
        }
        if slots.iter().all(|&slot| slot == Opacity::Solid) {
            return Self::default();
        }
        // Where all agree upon a material whose alpha varies, it may yet cover the whole of a triangle.
        let agreed = |slot: usize| {
            let row = first[slot];
            let varies = materials.flags[row as usize] & (flags::MASK | flags::BLEND) != 0;
            (varies && others.iter().all(|rows| rows[slot] == row)).then_some(row)
        };
        let varying: Vec<Option<Veil>> = (0..first.len())
            .map(|slot| agreed(slot).map(|row| Veil::new(&flat.textures, materials, row, images)))
            .collect();
        let mut this = Self { slots, triangles: Vec::new() };
        if let Form::Mesh(mesh) = form
            && varying.iter().any(Option::is_some)
        {
            let rows = 0..mesh.triangles.len() as u32;
            let known = rows.map(|row| {
                let slot = mesh.slots.get(row as usize).copied().unwrap_or_default();
                let wholly = varying[usize::from(slot)].as_ref().and_then(|veil| veil.covered(mesh, row as usize));
                wholly.unwrap_or_else(|| this.of(&mesh.slots, row))
            });
            this.triangles = known.collect();
        }
        this
    }

    /// That of a triangle, given the slots of all triangles.
    pub fn of(&self, slots: &[u16], triangle: u32) -> Opacity {
        self.triangles.get(triangle as usize).copied().unwrap_or_else(|| {
            let slot = slots.get(triangle as usize).copied().unwrap_or_default();
            self.slots.get(usize::from(slot)).copied().unwrap_or_default()
        })
    }
}

/// What a material's flags say without a look at any texture.
fn of_material(materials: &Materials, row: u32) -> Opacity {
    let bits = materials.flags[row as usize];
    if bits & (flags::MASK | flags::BLEND) != 0 { Opacity::Asked } else { where_it_covers(bits) }
}

/// That of a surface where it covers.
fn where_it_covers(bits: u32) -> Opacity {
    if bits & (flags::DOUBLE_SIDED | flags::TRANSMISSION) == 0 { Opacity::FrontOnly } else { Opacity::Solid }
}

/// Least alphas of images by their identity.
///
/// Those of images that are gone are forgotten when the next one is made.
#[derive(Default)]
pub struct AlphaCache(HashMap<usize, (Arc<FlatImage>, Arc<LeastAlpha>)>);

impl AlphaCache {
    fn of(&mut self, image: &Arc<FlatImage>) -> Arc<LeastAlpha> {
        let id = Arc::as_ptr(image) as usize;
        if let Some((_, known)) = self.0.get(&id) {
            return Arc::clone(known);
        }
        self.0.retain(|_, (image, _)| Arc::strong_count(image) > 1);
        let made = Arc::new(LeastAlpha::new(image));
        self.0.insert(id, (Arc::clone(image), Arc::clone(&made)));
        made
    }
}

/// A material whose alpha varies over the surface.
struct Veil<'a> {
    textures: &'a Textures,
    slot: u32,
    tex_coord: usize,
    texels: Option<Arc<LeastAlpha>>,
    base: f32,
    /// Alpha that covers everything.
    enough: f32,
    covering: Opacity,
}

/// What rounding may take from an alpha on the way to a hit, as a share.
const ROUNDING: f32 = 1e-6;

impl<'a> Veil<'a> {
    fn new(textures: &'a Textures, materials: &Materials, row: u32, images: &mut AlphaCache) -> Self {
        let row = row as usize;
        let (bits, slot) = (materials.flags[row], materials.base_color_texture[row]);
        let image = |slot: u32| &textures.images[textures.slots.image[slot as usize] as usize];
        Self {
            textures,
            slot,
            tex_coord: if slot == NONE { 0 } else { textures.slots.tex_coord[slot as usize] as usize },
            texels: (slot != NONE).then(|| images.of(image(slot))),
            base: materials.base_alpha[row],
            enough: if bits & flags::MASK != 0 { materials.alpha_cutoff[row] } else { COVERS },
            covering: where_it_covers(bits),
        }
    }

    /// What is known of a triangle if the surface covers the whole of it.
    fn covered(&self, mesh: &TriMesh, triangle: usize) -> Option<Opacity> {
        let corners = mesh.triangles[triangle];
        let mut least = self.base;
        if !mesh.colors.is_empty() {
            least *= corners.iter().map(|&corner| mesh.colors[corner as usize].w).fold(f32::INFINITY, f32::min);
        }
        if least > 0.0
            && let Some(texels) = &self.texels
        {
            let uvs = mesh.uvs.get(self.tex_coord).filter(|uvs| !uvs.is_empty());
            let uv = |corner: u32| uvs.map_or([0.0; 2], |uvs| uvs[corner as usize].to_array());
            least *= texels.over(self.textures, self.slot, corners.map(uv));
        }
        (least * (1.0 - ROUNDING) >= self.enough && least > 0.0).then_some(self.covering)
    }
}

#[cfg(test)]
mod tests {
    use glam::{Vec3, Vec4};

    use super::*;
    use crate::flat::MaterialRow;

    const SOLID: Opacity = Opacity::Solid;
    const FRONT: Opacity = Opacity::FrontOnly;
    const ASKED: Opacity = Opacity::Asked;

    /// Four triangles in slots 0, 1, 2 and 0.
    fn mesh() -> TriMesh {
        let mut mesh = TriMesh::new(vec![Vec3::ZERO, Vec3::X, Vec3::Y], vec![[0, 1, 2]; 4]);
        mesh.slots = vec![0, 1, 2, 0];
        mesh
    }

    fn flat(rows: impl IntoIterator<Item = MaterialRow>) -> FlatScene {
        let mut flat = FlatScene::default();
        rows.into_iter().for_each(|row| flat.materials.push(row));
        flat
    }

    fn each(mesh: &TriMesh, flat: &FlatScene, users: &[&[u32]]) -> [Opacity; 4] {
        let form = Form::Mesh(Arc::new(mesh.clone()));
        let opacity = MeshOpacity::of_users(&form, users, flat, &mut AlphaCache::default());
        [0, 1, 2, 3].map(|triangle| opacity.of(&mesh.slots, triangle))
    }

    #[test]
    fn what_entities_do_not_agree_upon_is_asked() {
        let bits = [0, flags::DOUBLE_SIDED, flags::MASK | flags::DOUBLE_SIDED, flags::TRANSMISSION];
        let row = |flags| MaterialRow { flags, alpha_cutoff: 0.5, base_color_texture: NONE, ..MaterialRow::default() };
        let (flat, mesh) = (flat(bits.map(row)), mesh());
        assert_eq!(each(&mesh, &flat, &[&[0, 1, 2]]), [FRONT, SOLID, ASKED, FRONT]);
        assert_eq!(each(&mesh, &flat, &[&[0, 1, 2], &[0, 3, 2]]), [FRONT, SOLID, ASKED, FRONT]);
        assert_eq!(each(&mesh, &flat, &[&[0, 1, 2], &[1, 1, 1]]), [ASKED, SOLID, ASKED, ASKED]);
        let none = MeshOpacity::of_users(
            &Form::Mesh(Arc::new(mesh)),
            &[&[1, 3, 1], &[3, 3, 1]],
            &flat,
            &mut AlphaCache::default(),
        );
        assert_eq!(none, MeshOpacity::default());
    }

    /// By vertices: where alpha is nowhere below the cutoff, or below one, nothing has to be asked.
    #[test]
    fn triangles_that_are_wholly_covered_are_not_asked() {
        let row = |flags, alpha_cutoff| MaterialRow {
            flags,
            alpha_cutoff,
            base_alpha: 1.0,
            base_color_texture: NONE,
            ..MaterialRow::default()
        };
        let flat = flat([row(flags::MASK, 0.5), row(flags::BLEND | flags::DOUBLE_SIDED, 0.0), row(flags::MASK, 0.8)]);
        let mut mesh = mesh();
        let users: [&[u32]; 1] = [&[0, 1, 2]];
        assert_eq!(each(&mesh, &flat, &users), [FRONT, SOLID, FRONT, FRONT]);
        mesh.colors = [1.0, 0.7, 0.9].map(|alpha| Vec4::new(1.0, 1.0, 1.0, alpha)).to_vec();
        assert_eq!(each(&mesh, &flat, &users), [FRONT, ASKED, ASKED, FRONT]);
        assert_eq!(each(&mesh, &flat, &[&[0, 1, 2], &[0, 1, 0]]), [FRONT, ASKED, ASKED, FRONT]);
    }
}
