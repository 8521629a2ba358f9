//! `measure --glare`: how much lamps dazzle at the camera's place.

use std::fmt::Write as _;

use serde_json::{Value, json};
use wavecast::{
    measure::{
        glare::{DEFINED, Glare, glare},
        meter::Effort,
    },
    render::Renderer,
    world::{Name, Scene, SceneKey},
};

use super::text_of;
use crate::cli::progress::Watcher;

/// A rating, and where.
pub struct Rated {
    at: String,
    glare: Glare,
    names: Vec<String>,
}

/// Rates what the camera sees.
pub fn read(scene: &Scene, renderer: &Renderer, effort: &Effort, watcher: &Watcher) -> Rated {
    let camera = &renderer.scene().camera;
    let glare = glare(renderer.scene(), camera.origin, camera.forward, camera.up, effort, watcher);
    let name = |key: u64| scene.get::<Name>(SceneKey(key)).map_or_else(|| key.to_string(), |name| name.0.to_string());
    let names = glare.sources.iter().map(|source| name(source.key)).collect();
    Rated { at: format!("{} along {}", text_of(camera.origin), text_of(camera.forward)), glare, names }
}

/// Lamps that are told in words.
const TOLD: usize = 10;

impl Rated {
    /// What there is to warn of.
    pub fn warnings(&self) -> Vec<String> {
        let Glare { sources, without_extent, reached, .. } = &self.glare;
        let mut warnings = Vec::new();
        let outside = sources.iter().filter(|s| !(DEFINED[0]..=DEFINED[1]).contains(&s.solid_angle)).count();
        if outside > 0 {
            warnings.push(format!(
                "--glare: {outside} of {} lamps fill less than {} or more than {} sr, for which UGR is not defined",
                sources.len(),
                DEFINED[0],
                DEFINED[1]
            ));
        }
        if *without_extent > 0 {
            warnings.push(format!("--glare: {without_extent} lamps without extent are left out of the sum"));
        }
        if !reached {
            warnings.push("--glare: stopped before the error that was asked for".to_owned());
        }
        warnings
    }

    /// In words.
    pub fn text(&self) -> String {
        let Glare { ugr, interval: [from, to], background, vertical, sources, samples, seconds, .. } = &self.glare;
        let mut text = format!("glare {}\n", self.at);
        if sources.is_empty() {
            text.push_str("  no lamp is in sight\n");
        } else {
            writeln!(text, "  UGR {ugr:.2}   95 %: {from:.2} .. {to:.2}   {samples} samples, {seconds:.2} s")
                .expect(TAKES);
        }
        writeln!(text, "  background {:.6} nit, vertical {:.6} lx", background.value, vertical.value.value)
            .expect(TAKES);
        for (source, name) in sources.iter().zip(&self.names).take(TOLD) {
            writeln!(
                text,
                "  {name}: {:.6} nit, {:.6} sr, position index {:.3}",
                source.luminance, source.solid_angle, source.position_index
            )
            .expect(TAKES);
        }
        if sources.len() > TOLD {
            writeln!(text, "  and {} more", sources.len() - TOLD).expect(TAKES);
        }
        text
    }

    /// As JSON.
    pub fn json(&self) -> Value {
        let Glare { ugr, interval, background, vertical, sources, without_extent, samples, seconds, reached } =
            &self.glare;
        let lamp = |(source, name): (&wavecast::measure::glare::GlareSource, &String)| {
            json!({
                "name": name,
                "key": source.key,
                "luminance": source.luminance,
                "solid_angle": source.solid_angle,
                "position_index": source.position_index,
                "illuminance": source.illuminance,
            })
        };
        json!({
            "kind": "glare",
            "at": self.at,
            "unit": "UGR",
            "value": ugr.is_finite().then_some(ugr),
            "interval": ugr.is_finite().then_some(interval),
            "background": { "value": background.value, "interval": background.interval(0.95), "unit": "nit" },
            "vertical": { "value": vertical.value.value, "interval": vertical.value.interval(0.95), "unit": "lx" },
            "lamps": sources.iter().zip(&self.names).map(lamp).collect::<Vec<_>>(),
            "without_extent": without_extent,
            "samples": samples,
            "seconds": seconds,
            "reached": reached,
        })
    }
}

const TAKES: &str = "a string takes it";
