"""The paper's claims, with a verdict on each."""
