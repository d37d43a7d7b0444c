"""Autonomous cislunar space domain awareness: observer architecture, tasking and estimation."""

__version__ = "0.1.0"
