//! Cameras.

use super::{error::LoadError, json::Json};
use crate::world::{Camera, Projection};

/// Reads one camera.
pub(super) fn read_camera(json: &Json<'_>) -> Result<Camera, LoadError> {
    let kind = json.required("type")?;
    match kind.string()? {
        "perspective" => read_perspective(&json.required("perspective")?),
        "orthographic" => read_orthographic(&json.required("orthographic")?),
        _ => Err(kind.expected("perspective or orthographic")),
    }
}

fn read_perspective(json: &Json<'_>) -> Result<Camera, LoadError> {
    let yfov = positive(&json.required("yfov")?)?;
    if yfov >= std::f32::consts::PI {
        return Err(json.required("yfov")?.expected("an angle less than π"));
    }
    let aspect = json.get("aspectRatio")?.map(|aspect| positive(&aspect)).transpose()?;
    let znear = positive(&json.required("znear")?)?;
    let zfar = json.get("zfar")?.map(|zfar| farther(&zfar, znear)).transpose()?.unwrap_or(f32::INFINITY);
    Ok(Camera { projection: Projection::Perspective { yfov, aspect }, znear, zfar })
}

fn read_orthographic(json: &Json<'_>) -> Result<Camera, LoadError> {
    let magnitude = |key: &str| -> Result<f32, LoadError> {
        let value = json.required(key)?;
        let number = value.number()? as f32;
        if number == 0.0 { Err(value.expected("a number other than zero")) } else { Ok(number) }
    };
    let projection = Projection::Orthographic { xmag: magnitude("xmag")?, ymag: magnitude("ymag")? };
    let near = json.required("znear")?;
    let znear = near.number()? as f32;
    if znear < 0.0 {
        return Err(near.expected("a distance, not negative"));
    }
    Ok(Camera { projection, znear, zfar: farther(&json.required("zfar")?, znear)? })
}

fn positive(json: &Json<'_>) -> Result<f32, LoadError> {
    let number = json.number()? as f32;
    if number > 0.0 { Ok(number) } else { Err(json.expected("a number greater than zero")) }
}

fn farther(json: &Json<'_>, znear: f32) -> Result<f32, LoadError> {
    let zfar = json.number()? as f32;
    if zfar > znear { Ok(zfar) } else { Err(json.expected(format!("a distance greater than the {znear} of znear"))) }
}
