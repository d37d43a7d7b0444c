"""Which target is observable from which satellite, and when."""
