//! What a scene needs, so that the rest is not run.

/// A set of needs.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SceneNeeds(pub u32);

impl SceneNeeds {
    /// Some visible material looks into a texture.
    pub const TEXTURES: Self = Self(1);
    /// Some visible material has a normal texture.
    pub const NORMAL_MAPS: Self = Self(1 << 1);
    /// Some visible material covers only in part.
    pub const ALPHA: Self = Self(1 << 2);
    /// Some visible material has no back.
    pub const CULLING: Self = Self(1 << 3);
    /// Some visible material lets light through.
    pub const TRANSMISSION: Self = Self(1 << 4);
    /// Some visible material bounds a solid that absorbs.
    pub const VOLUMES: Self = Self(1 << 5);
    /// Something visible emits.
    pub const AREA_LIGHTS: Self = Self(1 << 6);
    /// There are point or spot lights.
    pub const LOCAL_LIGHTS: Self = Self(1 << 7);
    /// There are directional lights.
    pub const DISTANT_LIGHTS: Self = Self(1 << 8);
    /// The sky is a picture.
    pub const ENVIRONMENT_MAP: Self = Self(1 << 9);
    /// The sky is constant.
    pub const CONSTANT_SKY: Self = Self(1 << 10);
    /// Some mesh has shading normals.
    pub const SMOOTH_NORMALS: Self = Self(1 << 11);
    /// Some visible mesh has vertex colours.
    pub const VERTEX_COLORS: Self = Self(1 << 12);
    /// Some visible material is unlit.
    pub const UNLIT: Self = Self(1 << 13);
    /// There is more than one instance, or one with a transform.
    pub const INSTANCING: Self = Self(1 << 14);

    /// Something visible is given by a formula.
    pub const SHAPES: Self = Self(1 << 15);

    /// Something visible emits, and something is a mirror or clear glass, between which light is traced from the emitters.
    pub const CAUSTICS: Self = Self(1 << 16);

    /// Every need with its name.
    pub const ALL: [(Self, &'static str); 17] = [
        (Self::TEXTURES, "textures"),
        (Self::NORMAL_MAPS, "normal maps"),
        (Self::ALPHA, "alpha"),
        (Self::CULLING, "culling"),
        (Self::TRANSMISSION, "transmission"),
        (Self::VOLUMES, "volumes"),
        (Self::AREA_LIGHTS, "area lights"),
        (Self::LOCAL_LIGHTS, "local lights"),
        (Self::DISTANT_LIGHTS, "distant lights"),
        (Self::ENVIRONMENT_MAP, "environment map"),
        (Self::CONSTANT_SKY, "constant sky"),
        (Self::SMOOTH_NORMALS, "smooth normals"),
        (Self::VERTEX_COLORS, "vertex colors"),
        (Self::UNLIT, "unlit"),
        (Self::INSTANCING, "instancing"),
        (Self::SHAPES, "shapes"),
        (Self::CAUSTICS, "caustics"),
    ];

    /// True if all of `needs` are in the set.
    #[inline]
    pub const fn has(self, needs: Self) -> bool {
        self.0 & needs.0 == needs.0
    }

    /// Adds `needs` if `condition` holds.
    pub fn add_if(&mut self, needs: Self, condition: bool) {
        if condition {
            self.0 |= needs.0;
        }
    }

    /// Names of what is needed, or with `skipped` of what is not.
    pub fn names(self, skipped: bool) -> Vec<&'static str> {
        Self::ALL.iter().filter(|(need, _)| self.has(*need) != skipped).map(|(_, name)| *name).collect()
    }
}
