//! All integration tests as one binary, a module per kind of evidence.

mod scenes;
