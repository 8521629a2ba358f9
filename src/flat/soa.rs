//! One declaration for a table's row and its columns.

/// Declares a row struct and the struct of its columns.
///
/// ```text
/// soa! { /// doc
///        pub struct Columns of Row { /// doc
///                                    field: f32, } }
/// ```
///
/// The columns get `len`, `clear`, `reserve`, `push`, `set`, `row`, `append`
/// (gather rows of another table by index) and `pad` (to whole blocks of eight,
/// with the default of each field; `len` does not count padding).
#[macro_export]
macro_rules! soa {
    ($(#[$meta:meta])* pub struct $table:ident of $row:ident { $($(#[$fmeta:meta])* $field:ident: $ty:ty,)+ }) => {
        #[doc = concat!("One row of [`", stringify!($table), "`].")]
        #[derive(Clone, Copy, Debug, Default, PartialEq)]
        pub struct $row { $($(#[$fmeta])* pub $field: $ty,)+ }

        $(#[$meta])*
        #[derive(Clone, Debug, Default, PartialEq)]
        pub struct $table { len: usize, $($(#[$fmeta])* pub $field: Vec<$ty>,)+ }

        #[allow(dead_code)]
        impl $table {
            /// Rows, padding not counted.
            #[inline]
            pub fn len(&self) -> usize { self.len }

            /// True if there is no row.
            #[inline]
            pub fn is_empty(&self) -> bool { self.len == 0 }

            /// Removes all rows and keeps the memory.
            pub fn clear(&mut self) { self.len = 0; $(self.$field.clear();)+ }

            /// Makes room for `rows` in all, padding included.
            pub fn reserve(&mut self, rows: usize) {
                let rows = rows.next_multiple_of(8);
                $(self.$field.reserve(rows.saturating_sub(self.$field.len()));)+
            }

            /// Adds a row at the end. Padding must have been dropped by `clear` or `unpad`.
            #[inline]
            pub fn push(&mut self, row: $row) {
                debug_assert!(true $(&& self.$field.len() == self.len)+, "push onto padding");
                self.len += 1;
                $(self.$field.push(row.$field);)+
            }

            /// The row at `index`.
            #[inline]
            pub fn row(&self, index: usize) -> $row { $row { $($field: self.$field[index],)+ } }

            /// Replaces the row at `index`.
            #[inline]
            pub fn set(&mut self, index: usize, row: $row) { $(self.$field[index] = row.$field;)+ }

            /// Appends the rows of `other` at `indices`, column by column.
            pub fn append(&mut self, other: &Self, indices: &[u32]) {
                self.len += indices.len();
                $(self.$field.extend(indices.iter().map(|&i| other.$field[i as usize]));)+
            }

            /// Sets the number of rows; new ones hold each field's default.
            pub fn resize(&mut self, rows: usize) {
                self.len = rows;
                $(self.$field.resize(rows, <$ty>::default());)+
            }

            /// Pads all columns to whole blocks of eight with each field's default.
            pub fn pad(&mut self) {
                let rows = self.len.next_multiple_of(8);
                $(self.$field.resize(rows, <$ty>::default());)+
            }

            /// Drops the padding again.
            pub fn unpad(&mut self) { $(self.$field.truncate(self.len);)+ }

            /// Bytes that a row takes over all columns.
            pub const ROW_BYTES: usize = 0 $(+ std::mem::size_of::<$ty>())+;
        }
    };
}

#[cfg(test)]
mod tests {
    soa! {
        /// A table.
        pub struct Points of Point {
            /// Metres.
            x: f32,
            /// A name.
            id: u32,
        }
    }

    #[test]
    fn rows_survive_columns_and_padding_is_not_counted() {
        let mut points = Points::default();
        for i in 0..5 {
            points.push(Point { x: i as f32, id: i });
        }
        points.pad();
        assert_eq!((points.len(), points.x.len(), points.x[7]), (5, 8, 0.0));
        let mut other = Points::default();
        other.append(&points, &[4, 1]);
        assert_eq!(other.row(0), Point { x: 4.0, id: 4 });
        assert_eq!((other.len(), Points::ROW_BYTES), (2, 8));
    }
}
