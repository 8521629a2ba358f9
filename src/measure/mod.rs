//! Image metrics, and the statistics that tests and error bars stand on.

pub mod statistics;
