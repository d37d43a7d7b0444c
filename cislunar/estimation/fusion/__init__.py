"""Estimates of observers that each keep a catalogue of their own, and what they say together."""
