"""Homography Decomposition Networks: a planar object tracker."""

import lazy_loader

# The names are those of `__init__.pyi`; a module is loaded when one of its names is first asked for.
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
