"""Frames and angles between bodies."""
