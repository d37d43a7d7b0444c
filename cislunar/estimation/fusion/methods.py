"""Methods to make one catalog from the measurements of several observers."""

FUSIONS = ("common", "alone", "covariance-intersection")
"""One estimate from all measurements; the best estimate of a single observer; the covariance
intersection of the observers' estimates."""
