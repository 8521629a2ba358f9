//! Evidence, a module per kind.

mod cli;
