"""Motion in the circular restricted three-body problem."""
