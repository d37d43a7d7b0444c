"""Coverage of static targets: what an architecture really watches of them, and how often."""
