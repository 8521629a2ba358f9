//! Numbers in [0, 1) and what they are bent into.

mod table;
pub use table::AliasTable;
