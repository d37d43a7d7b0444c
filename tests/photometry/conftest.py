"""Fixture of the bodies of spacecraft models."""

import pytest
from body_models import MODELS

from cislunar.photometry import spacecraft
from cislunar.photometry.bodies import build_body


@pytest.fixture(scope="session")
def bodies():
    """The three models as bodies."""
    return {name: build_body(mesh, spacecraft.SURFACES[name]) for name, mesh in MODELS.items()}
