"""The one equation: rows (terms), priors, and the solve."""
