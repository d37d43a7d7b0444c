"""What an observer sees of a target, and when: scene, sight line, measurement, derivatives."""
