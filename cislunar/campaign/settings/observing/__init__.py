"""What the observers are: their telescopes, and where those on the ground stand."""
