//! JSON values that know where they stand, so that every complaint names its place.
//!
//! The `gltf` crate's typed view has no places, rejects extensions it could
//! skip and panics on bad indices; so the file is read through this cursor and
//! only what has been asked for is looked at.

use serde_json::{Map, Value};

use super::error::{LoadError, Place, Warnings, one_line};

/// The elements of an array, each with its pointer.
pub(super) type Items<'a> = Vec<Json<'a>>;

/// A value and its pointer.
#[derive(Clone, Debug)]
pub(super) struct Json<'a> {
    pub(super) value: &'a Value,
    pub(super) at: Place,
}

impl<'a> Json<'a> {
    pub(super) fn new(value: &'a Value, at: Place) -> Self {
        Self { value, at }
    }

    /// An error that says what was expected here and what is there instead.
    pub(super) fn expected(&self, what: impl Into<String>) -> LoadError {
        LoadError::Value { at: self.at.clone(), expected: what.into(), found: describe(self.value) }
    }

    pub(super) fn object(&self) -> Result<&'a Map<String, Value>, LoadError> {
        self.value.as_object().ok_or_else(|| self.expected("an object"))
    }

    /// The property of this name, if it is there.
    pub(super) fn get(&self, key: &str) -> Result<Option<Json<'a>>, LoadError> {
        Ok(self.object()?.get(key).map(|value| Json { value, at: self.at.join(key) }))
    }

    pub(super) fn required(&self, key: &str) -> Result<Json<'a>, LoadError> {
        self.get(key)?.ok_or_else(|| LoadError::Missing { at: self.at.clone(), key: key.to_owned() })
    }

    /// The data of an extension of this object, if it has any.
    pub(super) fn extension(&self, name: &str) -> Result<Option<Json<'a>>, LoadError> {
        match self.get("extensions")? {
            None => Ok(None),
            Some(extensions) => {
                let found = extensions.get(name)?;
                if let Some(extension) = &found {
                    extension.object()?;
                }
                Ok(found)
            }
        }
    }

    pub(super) fn array(&self) -> Result<&'a Vec<Value>, LoadError> {
        self.value.as_array().ok_or_else(|| self.expected("an array"))
    }

    pub(super) fn items(&self) -> Result<Items<'a>, LoadError> {
        let values = self.array()?;
        Ok(values.iter().enumerate().map(|(i, value)| Json { value, at: self.at.join(i) }).collect())
    }

    /// The elements of an array property; none if it is absent.
    pub(super) fn list(&self, key: &str) -> Result<Items<'a>, LoadError> {
        self.get(key)?.map_or(Ok(Vec::new()), |array| array.items())
    }

    pub(super) fn string(&self) -> Result<&'a str, LoadError> {
        self.value.as_str().ok_or_else(|| self.expected("a string"))
    }

    pub(super) fn boolean(&self) -> Result<bool, LoadError> {
        self.value.as_bool().ok_or_else(|| self.expected("true or false"))
    }

    /// A whole number that is not negative; `3.0` counts, as JSON does not tell it from `3`.
    pub(super) fn unsigned(&self) -> Result<u64, LoadError> {
        let whole = |x: f64| ((0.0..=9e15).contains(&x) && x.fract() == 0.0).then_some(x as u64);
        let number = self.value.as_u64().or_else(|| self.value.as_f64().and_then(whole));
        number.ok_or_else(|| self.expected("a whole number, not negative"))
    }

    /// An index into something with `count` elements.
    pub(super) fn index(&self, what: &'static str, count: usize) -> Result<usize, LoadError> {
        let index = self.unsigned()?;
        if index < count as u64 {
            Ok(index as usize)
        } else {
            Err(LoadError::Reference { at: self.at.clone(), what, index, count })
        }
    }

    /// A number of single precision; what overflows it is refused.
    pub(super) fn number(&self) -> Result<f64, LoadError> {
        let number = self.value.as_f64().filter(|x| (*x as f32).is_finite());
        number.ok_or_else(|| self.expected("a number within single precision"))
    }

    /// Exactly `N` numbers.
    pub(super) fn numbers<const N: usize>(&self) -> Result<[f64; N], LoadError> {
        let items = self.items()?;
        if items.len() != N {
            return Err(self.expected(format!("{N} numbers")));
        }
        let mut numbers = [0.0; N];
        for (number, item) in numbers.iter_mut().zip(&items) {
            *number = item.number()?;
        }
        Ok(numbers)
    }

    pub(super) fn unsigned_or(&self, key: &str, default: u64) -> Result<u64, LoadError> {
        self.get(key)?.map_or(Ok(default), |json| json.unsigned())
    }

    pub(super) fn boolean_or(&self, key: &str, default: bool) -> Result<bool, LoadError> {
        self.get(key)?.map_or(Ok(default), |json| json.boolean())
    }

    /// A factor, clamped with a warning to the range its specification gives.
    pub(super) fn factor(
        &self,
        key: &str,
        default: f32,
        range: [f32; 2],
        warnings: &mut Warnings,
    ) -> Result<f32, LoadError> {
        match self.get(key)? {
            None => Ok(default),
            Some(json) => Ok(json.clamped(json.number()? as f32, range, warnings)),
        }
    }

    /// As [`factor`](Self::factor), of `N` numbers.
    pub(super) fn factors<const N: usize>(
        &self,
        key: &str,
        default: [f32; N],
        range: [f32; 2],
        warnings: &mut Warnings,
    ) -> Result<[f32; N], LoadError> {
        match self.get(key)? {
            None => Ok(default),
            Some(json) => Ok(json.numbers::<N>()?.map(|x| json.clamped(x as f32, range, warnings))),
        }
    }

    fn clamped(&self, x: f32, [low, high]: [f32; 2], warnings: &mut Warnings) -> f32 {
        let clamped = x.clamp(low, high);
        if clamped != x {
            warnings.push(&self.at, format!("{x} is outside {low} to {high}, taken as {clamped}"));
        }
        clamped
    }

    /// The `name` property, or what the element is and where it stands.
    pub(super) fn name_or(&self, what: &str, index: usize) -> Result<String, LoadError> {
        match self.get("name")? {
            Some(name) => Ok(name.string()?.to_owned()),
            None => Ok(format!("{what} {index}")),
        }
    }
}

fn describe(value: &Value) -> String {
    match value {
        Value::Null => "null".to_owned(),
        Value::Bool(b) => b.to_string(),
        Value::Number(n) => n.to_string(),
        Value::String(s) => format!("{:?}", one_line(&s.chars().take(60).collect::<String>())),
        Value::Array(a) => format!("an array of {}", a.len()),
        Value::Object(_) => "an object".to_owned(),
    }
}
