"""Interchangeable methods of association, by name."""

from cislunar.association.model import JOINT, MULTIPLE_FRAMES, NEAREST, AssociationModel
from cislunar.association.multiple_frames import associate_frames
from cislunar.association.nearest_neighbor import nearest_neighbor
from cislunar.association.probabilistic import joint_probabilities
from cislunar.association.window import Association, Window
from cislunar.errors import ConfigurationError


def associate(window: Window, model: AssociationModel) -> Association:
    """Associate the detections of a window by the method of a model.

    Parameters
    ----------
    window : Window
    model : AssociationModel

    Raises
    ------
    ConfigurationError
        If identities are to be known, which a window does not have.
    """
    if model.method == NEAREST:
        return nearest_neighbor(window, model.gate_probability)
    if model.method == JOINT:
        return joint_probabilities(window, model.gate_probability)
    if model.method == MULTIPLE_FRAMES:
        confirmation = model.confirmations, model.confirmation_exposures
        return associate_frames(
            window,
            model.gate_probability,
            *confirmation,
            model.hypotheses,
            model.confirmation_score,
        )
    raise ConfigurationError(f"method = {model.method!r}: detections do not state an identity")
