"""Tracking of surfaces through a whole video."""
