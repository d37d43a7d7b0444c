"""Configuration, data sets and provenance of a campaign."""
