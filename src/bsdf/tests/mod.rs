//! The three versions against plain formulas, quadrature and statistics.
