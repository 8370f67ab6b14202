"""The track file itself, version 1."""

from .keys import Keys


def track_file(keys: Keys) -> str:
    """As `Track.save` writes it; frames are counted from 0, and lost ones have no corners."""
    return keys.track.as_json()
