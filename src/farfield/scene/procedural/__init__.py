"""Scenes and surfaces made by rule, the same for the same seed."""
