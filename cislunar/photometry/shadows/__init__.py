"""Shadows that the facets of a body cast on each other, precomputed over all directions."""
