"""Which observer watches which target."""
