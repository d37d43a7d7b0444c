"""Figures of tasking and tracking."""
