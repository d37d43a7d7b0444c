"""Data sets and tables of observer architectures."""
