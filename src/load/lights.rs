//! `KHR_lights_punctual`.

use std::f32::consts::{FRAC_PI_2, FRAC_PI_4};

use glam::Vec3;

use super::{
    document::Document,
    error::{LoadError, Warnings},
    json::{Items, Json},
};
use crate::world::{
    DirectionalLight, PointLight, SpotLight,
    units::{Candela, Lux},
};

/// Name of the extension.
pub(super) const NAME: &str = "KHR_lights_punctual";

/// Any of the extension's lights.
#[derive(Clone, Copy, Debug)]
pub(super) enum Light {
    Point(PointLight),
    Spot(SpotLight),
    Directional(DirectionalLight),
}

/// The lights that nodes refer to.
pub(super) fn all<'a>(document: &Document<'a>) -> Result<Items<'a>, LoadError> {
    document.root.extension(NAME)?.map_or(Ok(Vec::new()), |extension| extension.list("lights"))
}

/// The light a node carries, if any.
pub(super) fn light_of(
    node: &Json<'_>,
    lights: &[Json<'_>],
    warnings: &mut Warnings,
) -> Result<Option<Light>, LoadError> {
    let Some(extension) = node.extension(NAME)? else { return Ok(None) };
    let index = extension.required("light")?.index("light", lights.len())?;
    read_light(&lights[index], warnings).map(Some)
}

fn read_light(json: &Json<'_>, warnings: &mut Warnings) -> Result<Light, LoadError> {
    let color = Vec3::from(json.factors("color", [1.0; 3], [0.0, f32::MAX], warnings)?);
    let intensity = json.factor("intensity", 1.0, [0.0, f32::MAX], warnings)?;
    if !(color * intensity).is_finite() {
        return Err(json.expected("colour times intensity within single precision"));
    }
    if json.get("range")?.is_some() {
        warnings.push(&json.at.join("range"), "a light's range is not read: light falls off with the square alone");
    }
    let kind = json.required("type")?;
    Ok(match kind.string()? {
        "point" => Light::Point(PointLight { color, intensity: Candela(intensity) }),
        "directional" => Light::Directional(DirectionalLight { color, illuminance: Lux(intensity) }),
        "spot" => {
            let (inner, outer) = read_cone(json, warnings)?;
            Light::Spot(SpotLight { color, intensity: Candela(intensity), inner, outer })
        }
        _ => return Err(kind.expected("point, spot or directional")),
    })
}

fn read_cone(light: &Json<'_>, warnings: &mut Warnings) -> Result<(f32, f32), LoadError> {
    let Some(spot) = light.get("spot")? else { return Ok((0.0, FRAC_PI_4)) };
    // An outer angle of zero would shine nowhere and leave no room for the inner one.
    let outer = spot.factor("outerConeAngle", FRAC_PI_4, [1e-4, FRAC_PI_2], warnings)?;
    let inner = spot.factor("innerConeAngle", 0.0, [0.0, FRAC_PI_2], warnings)?;
    if inner < outer {
        return Ok((inner, outer));
    }
    let clamped = outer * (1.0 - 1e-3);
    let text = format!("{inner} is not less than the outer angle {outer}, taken as {clamped}");
    warnings.push(&spot.at.join("innerConeAngle"), text);
    Ok((clamped, outer))
}
