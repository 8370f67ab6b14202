"""Homography Decomposition Networks: a planar object tracker."""

from .errors import InputError, RunError
from .observation import Observation
from .tracker import Estimate, Tracker

__all__ = ["Estimate", "InputError", "Observation", "RunError", "Tracker"]
