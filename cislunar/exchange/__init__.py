"""Formats other tools read and write: ephemeris messages, catalogue rows, tables; and axes."""
