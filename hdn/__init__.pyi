from .errors import InputError, RunError
from .imaging.observation import Observation
from .tracker import Estimate, Tracker

__all__ = ["Estimate", "InputError", "Observation", "RunError", "Tracker"]
