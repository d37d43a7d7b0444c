"""Sun and Moon from SPICE, sampled once."""
