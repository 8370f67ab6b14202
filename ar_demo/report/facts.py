"""What a report says beside what it measured: settings, versions, the machine."""

import platform
from collections.abc import Mapping
from dataclasses import MISSING, fields
from importlib.metadata import PackageNotFoundError, version
from typing import Any

import numpy as np

from hdn.benchmark.identity import machine

from ..surface import Keyframe

Facts = Mapping[str, str]
PACKAGES = ("ar-replace", "numpy", "opencv-python-headless", "openvino", "av")


def settings(first: Facts, *options: Any) -> dict[str, str]:
    """What is said first, and the fields of dataclasses of options that are not as usual, by their names.

    Where several have a field, as of several surfaces, all their values are told.
    """
    found = dict(first)
    for given in options:
        for f in fields(given):
            value = getattr(given, f.name)
            usual = f.default_factory() if f.default_factory is not MISSING else f.default
            if f.repr and value is not None and not _same(value, usual):
                found[f.name] = "; ".join(filter(None, [found.get(f.name, ""), _in_words(value)]))
    return found


def versions() -> dict[str, str]:
    """Of this program, of Python and of what does the work."""
    found = {}
    for name in PACKAGES:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            continue
    return found | {"Python": platform.python_version(), "system": platform.platform(), "machine": machine()}


def _same(value: Any, usual: Any) -> bool:
    return bool(np.array_equal(value, usual)) if isinstance(value, np.ndarray) else value == usual


def _in_words(value: Any) -> str:
    if isinstance(value, np.ndarray):
        return " ".join(f"{x:g},{y:g}" for x, y in value)
    if isinstance(value, tuple):
        return "; ".join(map(_in_words, value))
    if isinstance(value, Keyframe):
        return f"{value.at}: {_in_words(value.corners)}"
    return str(value)
