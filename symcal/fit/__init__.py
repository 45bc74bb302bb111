"""The statistical fit: rows, plausible sizes, unknown variances, posterior, and what the data can see."""
