"""Ways to make one catalogue of the measurements of several observers."""

FUSIONS = ("common", "alone", "covariance-intersection")
"""One estimate of all measurements; of those of single observers the best; their intersection."""
