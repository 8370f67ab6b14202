"""Homography Decomposition Networks: a planar object tracker."""

from importlib import import_module
from typing import TYPE_CHECKING

from .errors import InputError, RunError

if TYPE_CHECKING:
    from .observation import Observation
    from .tracker import Estimate, Tracker
else:  # loaded when first asked for, since PyTorch takes seconds

    def __getattr__(name: str) -> object:
        if name not in _HOMES:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        return getattr(import_module(_HOMES[name], __name__), name)


_HOMES = {"Estimate": ".tracker", "Observation": ".observation", "Tracker": ".tracker"}

__all__ = ["Estimate", "InputError", "Observation", "RunError", "Tracker"]
