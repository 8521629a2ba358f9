//! Accessors: typed elements out of bytes, every length checked before anything is allocated.

use gltf::json::accessor::{BYTE, FLOAT, SHORT, UNSIGNED_BYTE, UNSIGNED_INT, UNSIGNED_SHORT};

use super::{
    buffers::{Buffers, View},
    error::LoadError,
    json::Json,
};

/// Which elements to read.
#[derive(Clone, Copy, Debug)]
pub(super) enum Rows<'r> {
    /// Every one.
    All,
    /// These, in this order.
    Some(&'r [u32]),
}

/// How a component is stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Component {
    I8,
    U8,
    I16,
    U16,
    U32,
    F32,
}

impl Component {
    fn read(json: &Json<'_>) -> Result<Self, LoadError> {
        Ok(match u32::try_from(json.unsigned()?).unwrap_or(0) {
            BYTE => Self::I8,
            UNSIGNED_BYTE => Self::U8,
            SHORT => Self::I16,
            UNSIGNED_SHORT => Self::U16,
            UNSIGNED_INT => Self::U32,
            FLOAT => Self::F32,
            _ => return Err(json.expected("a component type: 5120 to 5123, 5125 or 5126")),
        })
    }

    fn size(self) -> u64 {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::U32 | Self::F32 => 4,
        }
    }
}

/// Rows and columns of an element.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Shape {
    rows: u64,
    columns: u64,
}

impl Shape {
    fn read(json: &Json<'_>) -> Result<Self, LoadError> {
        let (rows, columns) = match json.string()? {
            "SCALAR" => (1, 1),
            "VEC2" => (2, 1),
            "VEC3" => (3, 1),
            "VEC4" => (4, 1),
            "MAT2" => (2, 2),
            "MAT3" => (3, 3),
            "MAT4" => (4, 4),
            _ => return Err(json.expected("SCALAR, VEC2 to VEC4 or MAT2 to MAT4")),
        };
        Ok(Self { rows, columns })
    }

    /// Bytes from one column to the next; columns of matrices start on multiples of four.
    fn column(self, component: Component) -> u64 {
        let packed = self.rows * component.size();
        if self.columns > 1 { packed.next_multiple_of(4) } else { packed }
    }

    /// Bytes of an element, padding included.
    fn size(self, component: Component) -> u64 {
        self.columns * self.column(component)
    }
}

/// Elements at equal distances in a slice that is known to hold them all.
#[derive(Clone, Debug)]
struct Run<'b> {
    bytes: &'b [u8],
    stride: usize,
}

impl<'b> Run<'b> {
    /// `count` elements of `size` bytes from `offset` on.
    fn new(view: View<'b>, offset: u64, size: u64, count: u64, json: &Json<'_>) -> Result<Self, LoadError> {
        let stride = view.stride.unwrap_or(size);
        if stride < size {
            return Err(LoadError::Value {
                at: view.at.join("byteStride"),
                expected: format!("at least the {size} bytes of an element of {}", json.at.part),
                found: stride.to_string(),
            });
        }
        let available = view.bytes.len() as u64;
        let needed = match count {
            0 => offset,
            _ => (count - 1).saturating_mul(stride).saturating_add(size).saturating_add(offset),
        };
        if needed > available {
            return Err(LoadError::Bounds { at: json.at.clone(), needed, available });
        }
        Ok(Self { bytes: &view.bytes[offset as usize..], stride: stride as usize })
    }
}

/// Values that replace those of some elements.
#[derive(Clone, Debug)]
struct Sparse<'b> {
    rows: Vec<usize>,
    values: Run<'b>,
}

/// An accessor whose data is known to be there.
#[derive(Clone, Debug)]
pub(super) struct Accessor<'a, 'b> {
    json: Json<'a>,
    pub(super) count: usize,
    pub(super) component: Component,
    pub(super) normalized: bool,
    shape: Shape,
    base: Option<Run<'b>>,
    sparse: Option<Sparse<'b>>,
}

impl<'a, 'b> Accessor<'a, 'b> {
    /// # Errors
    /// If a property is wrong, the data is not all there, or the count is out of proportion to the buffers.
    pub(super) fn new(json: Json<'a>, buffers: &'b Buffers<'_>) -> Result<Self, LoadError> {
        let count = json.required("count")?.unsigned()?;
        let component = Component::read(&json.required("componentType")?)?;
        let shape = Shape::read(&json.required("type")?)?;
        let offset = json.unsigned_or("byteOffset", 0)?;
        let base = match buffers.view_of(&json)? {
            None => None,
            Some(view) => Some(Run::new(view, offset, shape.size(component), count, &json)?),
        };
        if base.is_none() {
            buffers.charge(&json.at, count)?;
        }
        let sparse = match json.get("sparse")? {
            None => None,
            Some(sparse) => Some(read_sparse(&sparse, count, component, shape, buffers)?),
        };
        let normalized = json.boolean_or("normalized", false)? && !matches!(component, Component::U32 | Component::F32);
        Ok(Self { json, count: count as usize, component, normalized, shape, base, sparse })
    }

    /// An error about the accessor itself.
    pub(super) fn expected(&self, what: &str) -> LoadError {
        let [rows, columns] = [self.shape.rows, self.shape.columns];
        let normalized = if self.normalized { "normalised " } else { "" };
        LoadError::Value {
            at: self.json.at.clone(),
            expected: what.to_owned(),
            found: format!("{columns} × {rows} {normalized}{:?}", self.component),
        }
    }

    /// Numbers to an element.
    pub(super) fn width(&self) -> usize {
        (self.shape.rows * self.shape.columns) as usize
    }

    /// Elements as floats: those of the given rows, each less than `count`, or all.
    ///
    /// Integers are mapped to 0..1 or −1..1 if normalised, else taken as they are.
    ///
    /// # Errors
    /// If an element does not have `N` numbers.
    pub(super) fn floats<const N: usize>(&self, rows: Rows<'_>) -> Result<Vec<[f32; N]>, LoadError> {
        match (self.component, self.normalized) {
            (Component::I8, true) => self.elements(rows, |[b]: [u8; 1]| (f32::from(b as i8) / 127.0).max(-1.0)),
            (Component::I8, false) => self.elements(rows, |[b]: [u8; 1]| f32::from(b as i8)),
            (Component::U8, true) => self.elements(rows, |[b]: [u8; 1]| f32::from(b) / 255.0),
            (Component::U8, false) => self.elements(rows, |[b]: [u8; 1]| f32::from(b)),
            (Component::I16, true) => self.elements(rows, |b| (f32::from(i16::from_le_bytes(b)) / 32767.0).max(-1.0)),
            (Component::I16, false) => self.elements(rows, |b| f32::from(i16::from_le_bytes(b))),
            (Component::U16, true) => self.elements(rows, |b| f32::from(u16::from_le_bytes(b)) / 65535.0),
            (Component::U16, false) => self.elements(rows, |b| f32::from(u16::from_le_bytes(b))),
            (Component::U32, _) => self.elements(rows, |b| u32::from_le_bytes(b) as f32),
            (Component::F32, _) => self.elements(rows, f32::from_le_bytes),
        }
    }

    /// Elements as unsigned integers; see [`floats`](Self::floats).
    ///
    /// # Errors
    /// If an element does not have `N` numbers or they are not unsigned integers.
    pub(super) fn integers<const N: usize>(&self, rows: Rows<'_>) -> Result<Vec<[u32; N]>, LoadError> {
        match (self.component, self.normalized) {
            (Component::U8, false) => self.elements(rows, |[b]: [u8; 1]| u32::from(b)),
            (Component::U16, false) => self.elements(rows, |b| u32::from(u16::from_le_bytes(b))),
            (Component::U32, _) => self.elements(rows, u32::from_le_bytes),
            _ => Err(self.expected("unsigned integers")),
        }
    }

    fn elements<const N: usize, const S: usize, T: Copy + Default>(
        &self,
        rows: Rows<'_>,
        convert: impl Fn([u8; S]) -> T + Copy,
    ) -> Result<Vec<[T; N]>, LoadError> {
        if self.width() != N {
            return Err(self.expected(&format!("{N} numbers to an element")));
        }
        let (height, column) = (self.shape.rows as usize, self.shape.column(self.component) as usize);
        let element = |run: &Run<'_>, row: usize| {
            let bytes = &run.bytes[row * run.stride..];
            std::array::from_fn(|i| {
                let start = (i / height) * column + (i % height) * S;
                let component = bytes[start..].first_chunk::<S>();
                convert(*component.expect("the accessor's bounds were checked when it was made"))
            })
        };
        let zero = [T::default(); N];
        let base = |row: usize| self.base.as_ref().map_or(zero, |run| element(run, row));
        let mut all: Vec<[T; N]> = match rows {
            Rows::All => (0..self.count).map(base).collect(),
            Rows::Some(rows) => rows.iter().map(|&row| base(row as usize)).collect(),
        };
        let Some(sparse) = &self.sparse else { return Ok(all) };
        match rows {
            Rows::All => {
                for (i, &row) in sparse.rows.iter().enumerate() {
                    all[row] = element(&sparse.values, i);
                }
            }
            Rows::Some(rows) => {
                for (value, &row) in all.iter_mut().zip(rows) {
                    if let Ok(i) = sparse.rows.binary_search(&(row as usize)) {
                        *value = element(&sparse.values, i);
                    }
                }
            }
        }
        Ok(all)
    }
}

fn read_sparse<'b>(
    json: &Json<'_>,
    total: u64,
    component: Component,
    shape: Shape,
    buffers: &'b Buffers<'_>,
) -> Result<Sparse<'b>, LoadError> {
    let count_json = json.required("count")?;
    let count = count_json.unsigned()?;
    if count > total {
        return Err(count_json.expected(format!("at most the {total} elements of the accessor")));
    }
    let run = |key: &str, component: Component, shape: Shape| {
        let part = json.required(key)?;
        let offset = part.unsigned_or("byteOffset", 0)?;
        let view = buffers.view_of(&part)?;
        let view = view.ok_or_else(|| LoadError::Missing { at: part.at.clone(), key: "bufferView".to_owned() })?;
        Run::new(view, offset, shape.size(component), count, &part)
    };
    let indices = json.required("indices")?;
    let index_type = indices.required("componentType")?;
    let index_component = Component::read(&index_type)?;
    let run_of_indices = run("indices", index_component, Shape { rows: 1, columns: 1 })?;
    let index = |i: usize| {
        let bytes = &run_of_indices.bytes[i * run_of_indices.stride..];
        match index_component {
            Component::U8 => Some(u32::from(bytes[0])),
            Component::U16 => Some(u32::from(u16::from_le_bytes([bytes[0], bytes[1]]))),
            Component::U32 => Some(u32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]])),
            _ => None,
        }
    };
    let mut rows: Vec<usize> = Vec::with_capacity(count as usize);
    for i in 0..count as usize {
        let row = index(i).ok_or_else(|| index_type.expected("5121, 5123 or 5125"))?;
        if u64::from(row) >= total {
            let at = indices.at.clone();
            return Err(LoadError::Reference { at, what: "element", index: row.into(), count: total as usize });
        }
        if rows.last().is_some_and(|&last| last >= row as usize) {
            return Err(LoadError::Value {
                at: indices.at.clone(),
                expected: "strictly increasing indices".to_owned(),
                found: format!("{row} after {}", rows[i - 1]),
            });
        }
        rows.push(row as usize);
    }
    Ok(Sparse { rows, values: run("values", component, shape)? })
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use base64::{Engine, prelude::BASE64_STANDARD};
    use serde_json::json;

    use super::*;
    use crate::load::{
        document::{ACCESSORS, Document},
        error::Place,
    };

    #[track_caller]
    fn check_matrices<const N: usize>(component: u32, shape: &str, bytes: &[u8], expected: &[[f32; N]]) {
        let uri = format!("data:;base64,{}", BASE64_STANDARD.encode(bytes));
        let json = json!({
            "asset": {"version": "2.0"},
            "buffers": [{"byteLength": bytes.len(), "uri": uri}],
            "bufferViews": [{"buffer": 0, "byteLength": bytes.len()}],
            "accessors": [{"bufferView": 0, "componentType": component, "type": shape, "count": expected.len()}],
        });
        let document = Document::new(&json, Place::file(Path::new("test"))).unwrap();
        let buffers = Buffers::new(&document, Path::new(""), None);
        let accessor = Accessor::new(document.element(ACCESSORS, 0), &buffers).unwrap();
        assert_eq!(accessor.floats::<N>(Rows::All).unwrap(), expected);
    }

    /// glTF 2.0 section 3.6.2.4: each column starts on a multiple of four bytes.
    #[test]
    fn columns_of_small_matrices_are_padded() {
        let bytes = [1, 2, 99, 99, 3, 4, 99, 99, 5, 6, 99, 99, 7, 8, 99, 99];
        check_matrices(5121, "MAT2", &bytes, &[[1.0, 2.0, 3.0, 4.0], [5.0, 6.0, 7.0, 8.0]]);
        let bytes = [1, 2, 3, 99, 4, 5, 6, 99, 7, 8, 255, 99];
        check_matrices(5120, "MAT3", &bytes, &[[1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, -1.0]]);
        let shorts = [1i16, 2, 3, 99, 4, 5, 6, 99, 7, 8, -9, 99].map(i16::to_le_bytes).concat();
        check_matrices(5122, "MAT3", &shorts, &[[1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, -9.0]]);
        let floats: [f32; 16] = std::array::from_fn(|i| i as f32);
        check_matrices(5126, "MAT4", &floats.map(f32::to_le_bytes).concat(), &[floats]);
        let floats: [f32; 4] = std::array::from_fn(|i| i as f32);
        check_matrices(5126, "MAT2", &floats.map(f32::to_le_bytes).concat(), &[floats]);
    }
}
