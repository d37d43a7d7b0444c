"""The command `cislunar`: orbits, who sees what, and the campaign; each imports what it needs."""
