"""Static targets: missions, zero-velocity surfaces, clustering."""
