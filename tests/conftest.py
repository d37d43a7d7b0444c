"""Fixtures shared by the test modules."""

import pytest

from cislunar.orbits.families import observer_library


@pytest.fixture(scope="session")
def library():
    """The 302 candidate observer orbits at the default settings."""
    return observer_library()
