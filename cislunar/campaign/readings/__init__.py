"""What each reading of the paper does."""
