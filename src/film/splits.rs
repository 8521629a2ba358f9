//! How the light of a picture is split into layers: by the scatterings behind it, by the light that it came from, or by both.
//!
//! The rendering equation's solution is the series L = E + KE + K²E + … (Kajiya 1986, "The Rendering Equation", section 3): the light
//! with n scatterings behind it is Kⁿ E. Each contribution to a picture is one of these terms, of one light; so each split
//! is a partition of the picture's light, and its layers add up to the picture. What happened to it on its way is a word of a
//! regular language, see [`Expression`]: by the first scattering these are a partition too.

use std::sync::Arc;

use super::{
    automaton::Automaton,
    expression::{Expression, ExpressionError},
};

/// Scatterings of the last layer of its own, where nothing bounds them: E to K¹⁷E, which is sixteen bounces of indirect light.
const OWN_LAYERS: u32 = 17;

/// What is known of a piece of light.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Label {
    /// Scatterings behind it.
    pub scatterings: u32,
    /// Which of the scene's lights it came from, as [`LightGroups`](crate::flat::LightGroups) counts them.
    pub light: u32,
    /// By channel, the state of the [`Automaton`] after what happened to it on the way from the camera.
    pub way: [u16; 3],
}

/// A layer of the light that came on certain paths.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PathLayer {
    /// Of the layer.
    pub name: String,
    /// Which paths.
    pub expression: Expression,
}

/// A way of splitting light.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Split {
    /// By the number of scatterings behind it: `bounce00` is E, `bounce01` is KE and so on. Without a bound on the depth,
    /// what has more than 17 behind it is `bounce18-on`.
    Bounces,
    /// By the entity that it was emitted from: `light.<name>`.
    Lights,
    /// `direct` is E + KE, `indirect` all else.
    Direct,
    /// By both: `light.<name>.bounce00` and so on.
    LightsByBounces,
    /// By both: `light.<name>.direct` and `light.<name>.indirect`.
    LightsByDirect,
    /// By what the first surface does to it: `emission` is what the camera sees of lights, `diffuse.direct` and
    /// `diffuse.indirect` what matt parts reflect, `specular.…` what coats, metals and mirrors do, `transmission.…` what comes
    /// through.
    Lobes,
    /// By both: `diffuse.bounce01` and so on; what the camera sees of lights is `emission.bounce00`.
    LobesByBounces,
    /// By expressions of [`RenderSettings::paths`](crate::render::RenderSettings::paths): light may be in several of these layers,
    /// or in none.
    Paths,
}

/// What lobes are called, and which scatterings they are.
const LOBES: [(&str, &str); 3] = [("diffuse", "<RD>"), ("specular", "<R[GS]>"), ("transmission", "<T.>")];

/// All the layers of light of a picture.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Splits {
    kinds: Vec<Split>,
    /// Scatterings of the last layer that has no others in it.
    deepest: u32,
    /// Paths may have more scatterings.
    open: bool,
    /// Lights in the scene.
    lights: u32,
    /// Of the expressions.
    path_names: Vec<String>,
    /// Reads paths, where that is asked for.
    pub automaton: Option<Arc<Automaton>>,
    /// Layer of each expression that it knows.
    of_expression: Vec<u32>,
}

impl Splits {
    /// For paths of so many scatterings, in a scene with so many lights.
    pub fn new(kinds: impl IntoIterator<Item = Split>, max_depth: Option<u32>, lights: u32) -> Self {
        let deepest = max_depth.unwrap_or(u32::MAX).min(OWN_LAYERS.max(max_depth.unwrap_or(0).min(99)));
        let mut all = Vec::new();
        for kind in kinds {
            if !all.contains(&kind) {
                all.push(kind);
            }
        }
        let open = max_depth.is_none_or(|most| most > deepest);
        Self { kinds: all, deepest, open, lights, ..Self::default() }
    }

    /// For a scene with so many lights.
    pub fn of_lights(self, lights: u32) -> Self {
        Self { lights, ..self }
    }

    /// With layers for paths, of lights with such keys.
    ///
    /// # Errors
    ///
    /// Expressions whose automaton is too large.
    pub fn with_paths(mut self, paths: &[PathLayer], keys: &[u64]) -> Result<Self, ExpressionError> {
        self.path_names = paths.iter().map(|path| path.name.clone()).collect();
        let mut expressions = Vec::new();
        for kind in self.kinds.clone() {
            let texts: Vec<String> = match kind {
                Split::Paths => {
                    expressions.extend(paths.iter().map(|path| path.expression.clone()));
                    Vec::new()
                }
                Split::Lobes => {
                    let of_lobe = |(_, lobe): (_, &str)| [format!("C{lobe}[LB]"), format!("C{lobe}.+[LB]")];
                    std::iter::once("C[LB]".to_owned()).chain(LOBES.into_iter().flat_map(of_lobe)).collect()
                }
                Split::LobesByBounces => {
                    let of_lobe = |(_, lobe): (_, &str)| {
                        let last = self.depths() - 1;
                        let more = if self.open { "," } else { "" };
                        let more = move |depth: u32| if depth == last { more } else { "" };
                        (1..=last).map(|n| format!("C{lobe}.{{{}{}}}[LB]", n - 1, more(n))).collect::<Vec<_>>()
                    };
                    std::iter::once("C[LB]".to_owned()).chain(LOBES.into_iter().flat_map(of_lobe)).collect()
                }
                _ => continue,
            };
            let first = self.first_of(kind) as u32;
            self.of_expression.extend((first..).take(self.layers_of(kind)));
            for text in texts {
                expressions.push(text.parse()?);
            }
        }
        if !expressions.is_empty() {
            let all: Vec<&Expression> = expressions.iter().collect();
            self.automaton = Some(Arc::new(Automaton::new(&all, keys)?));
        }
        Ok(self)
    }

    /// Without the layers for paths.
    pub fn without_paths(mut self) -> Self {
        self.kinds.retain(|kind| !kind.by_path());
        self
    }

    /// True if light is not split.
    pub fn is_empty(&self) -> bool {
        self.kinds.is_empty()
    }

    /// True if some layer depends on which light it came from.
    pub fn by_light(&self) -> bool {
        self.kinds.iter().any(|kind| kind.by_light() || kind.by_path())
    }

    /// Layers by the number of scatterings.
    fn depths(&self) -> u32 {
        self.deepest + 1 + u32::from(self.open)
    }

    /// Layers of a split; none of one that the light is not split by.
    pub fn layers_of(&self, kind: Split) -> usize {
        if !self.kinds.contains(&kind) {
            return 0;
        }
        let parts = match kind {
            Split::Bounces | Split::LightsByBounces => self.depths(),
            Split::Direct | Split::LightsByDirect => 2,
            Split::Lights => 1,
            Split::Lobes => 1 + 2 * LOBES.len() as u32,
            Split::LobesByBounces => 1 + LOBES.len() as u32 * (self.depths() - 1),
            Split::Paths => self.path_names.len() as u32,
        };
        parts as usize * if kind.by_light() { self.lights as usize } else { 1 }
    }

    /// All layers.
    pub fn layers(&self) -> usize {
        self.kinds.iter().map(|&kind| self.layers_of(kind)).sum()
    }

    /// First layer of a split.
    pub fn first_of(&self, kind: Split) -> usize {
        self.kinds.iter().take_while(|&&other| other != kind).map(|&other| self.layers_of(other)).sum()
    }

    /// Calls `add` for each layer that light belongs to, with the channels of it that do, as bits.
    #[inline]
    pub fn each(&self, label: Label, mut add: impl FnMut(usize, u32)) {
        self.of(label).for_each(|layer| add(layer, 0b111));
        let Some(automaton) = &self.automaton else { return };
        let [r, g, b] = label.way;
        let mut met = |way: u16, channels: u32| {
            automaton
                .met(way, label.light)
                .iter()
                .for_each(|&expression| add(self.of_expression[usize::from(expression)] as usize, channels));
        };
        if r == g && g == b {
            met(r, 0b111);
        } else {
            met(r, 0b001);
            met(g, 0b010);
            met(b, 0b100);
        }
    }

    /// The layers that all channels belong to: one of each split, but for those by paths.
    #[inline]
    fn of(&self, label: Label) -> impl Iterator<Item = usize> + '_ {
        let mut first = 0;
        self.kinds.iter().filter_map(move |&kind| {
            let depth = label.scatterings.min(self.depths() - 1);
            let late = u32::from(label.scatterings > 1);
            let layer = match kind {
                Split::Bounces => depth,
                Split::Direct => late,
                Split::Lights => label.light,
                Split::Lobes | Split::LobesByBounces | Split::Paths => {
                    first += self.layers_of(kind);
                    return None;
                }
                Split::LightsByBounces => label.light * self.depths() + depth,
                Split::LightsByDirect => label.light * 2 + late,
            };
            let before = first;
            first += self.layers_of(kind);
            Some(before + layer as usize)
        })
    }

    /// Scatterings of the layers of [`Split::Bounces`]: of the last one at least as many, if it is open.
    pub fn depth(&self) -> (u32, bool) {
        (self.depths() - 1, self.open)
    }

    /// Names of the layers of a split, of lights with such names.
    pub fn names(&self, kind: Split, lights: &[String]) -> Vec<String> {
        if !self.kinds.contains(&kind) {
            return Vec::new();
        }
        let bounces = || {
            let own = (0..=self.deepest).map(|n| format!("bounce{n:02}"));
            own.chain(self.open.then(|| format!("bounce{:02}-on", self.deepest + 1)))
        };
        let direct = || ["direct", "indirect"].map(str::to_owned).into_iter();
        let light =
            |row: u32| format!("light.{}", lights.get(row as usize).cloned().unwrap_or_else(|| row.to_string()));
        let rows = 0..self.lights;
        match kind {
            Split::Bounces => bounces().collect(),
            Split::Direct => direct().collect(),
            Split::Lights => rows.map(light).collect(),
            Split::LightsByBounces => {
                rows.flat_map(|row| bounces().map(move |part| format!("{}.{part}", light(row)))).collect()
            }
            Split::LightsByDirect => {
                rows.flat_map(|row| direct().map(move |part| format!("{}.{part}", light(row)))).collect()
            }
            Split::Lobes => {
                let of_lobe = |(lobe, _): (&str, _)| ["direct", "indirect"].map(|part| format!("{lobe}.{part}"));
                std::iter::once("emission".to_owned()).chain(LOBES.into_iter().flat_map(of_lobe)).collect()
            }
            Split::LobesByBounces => {
                let of_lobe =
                    |(lobe, _): (&'static str, _)| bounces().skip(1).map(move |part| format!("{lobe}.{part}"));
                std::iter::once("emission.bounce00".to_owned()).chain(LOBES.into_iter().flat_map(of_lobe)).collect()
            }
            Split::Paths => self.path_names.clone(),
        }
    }
}

impl Split {
    /// True if its layers say which light they came from.
    pub fn by_light(self) -> bool {
        matches!(self, Self::Lights | Self::LightsByBounces | Self::LightsByDirect)
    }

    /// True if its layers depend on what happened to light on its way.
    pub fn by_path(self) -> bool {
        matches!(self, Self::Lobes | Self::LobesByBounces | Self::Paths)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const ALL: [Split; 5] =
        [Split::Bounces, Split::LightsByDirect, Split::Direct, Split::Lights, Split::LightsByBounces];

    /// Each piece of light has one layer of each split, which has the name that says what it is.
    #[test]
    fn every_split_is_a_partition_and_its_layers_are_named_after_what_is_in_them() {
        let lights = ["lamp".to_owned(), "sky".into(), "lamp.001".into()];
        for (max_depth, last) in [(None, "bounce18-on"), (Some(4), "bounce04"), (Some(30), "bounce30")] {
            let splits = Splits::new(ALL, max_depth, 3);
            let names: Vec<String> = ALL.iter().flat_map(|&kind| splits.names(kind, &lights)).collect();
            assert_eq!(names.len(), splits.layers());
            let mut met = vec![false; names.len()];
            for scatterings in 0..=max_depth.unwrap_or(40) {
                for light in 0..3 {
                    let layers: Vec<usize> = splits.of(Label { scatterings, light, ..Label::default() }).collect();
                    let name = &lights[light as usize];
                    let depth = format!("bounce{scatterings:02}");
                    let depth = if max_depth.is_none() && scatterings > 17 { last } else { &depth };
                    let direct = if scatterings < 2 { "direct" } else { "indirect" };
                    let want = [
                        depth.to_owned(),
                        format!("light.{name}.{direct}"),
                        direct.into(),
                        format!("light.{name}"),
                        format!("light.{name}.{depth}"),
                    ];
                    assert_eq!(layers.iter().map(|&layer| names[layer].clone()).collect::<Vec<_>>(), want);
                    layers.iter().for_each(|&layer| met[layer] = true);
                }
            }
            assert!(met.iter().all(|&met| met), "no layer is without use");
            for kind in ALL {
                assert_eq!(names[splits.first_of(kind)], splits.names(kind, &lights)[0]);
            }
        }
    }

    #[test]
    fn nothing_is_split_where_nothing_is_asked_for() {
        let splits = Splits::new([], None, 7);
        assert!(splits.is_empty() && !splits.by_light());
        assert_eq!((splits.layers(), splits.of(Label::default()).count()), (0, 0));
    }
}
