"""Cells of tasking and tracking: their data sets, statistics and tables."""
