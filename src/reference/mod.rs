//! A plain recursive path tracer in f64.
