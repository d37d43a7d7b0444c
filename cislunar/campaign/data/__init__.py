"""Data sets and tables on disk, where they come from, and the progress of making them."""
