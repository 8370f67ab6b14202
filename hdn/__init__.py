"""Homography Decomposition Networks: a planar object tracker."""

from .errors import InputError, RunError
from .tracker import Estimate, Tracker

__all__ = ["Estimate", "InputError", "RunError", "Tracker"]
