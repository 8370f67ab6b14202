from .errors import InputError, RunError
from .imaging.observation import Observation
from .imaging.regions import Region
from .tracker import Estimate, Tracker

__all__ = ["Estimate", "InputError", "Observation", "Region", "RunError", "Tracker"]
