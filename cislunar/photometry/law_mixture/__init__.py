"""Reflection laws between Cook-Torrance, Lambert-Phong and Lommel-Seeliger."""
