"""Defaults of one's own: a file, and environment variables, for what the command line and the job file do not say.

    # ~/.config/ar-replace/config.toml, or where the system keeps such files
    crf = 20
    audio = "mix"
    progress = "plain"

`AR_REPLACE_CRF=18` counts before the file. A default that has no place in a job, as `fit` where there is no ad, is left
out without a word, since nobody asked for it there.
"""

import os
import re
import tomllib
from argparse import Namespace
from collections.abc import Container, Mapping
from dataclasses import fields
from pathlib import Path
from typing import Any, get_type_hints

import msgspec
from platformdirs import user_config_path

from ..choices import ProgressKind
from ..errors import InputError
from ..media import codecs
from ..options import OutputOptions, TrackingOptions
from ..rendering.outputs import OF_A_VIDEO, OF_SOUND
from ..surface import ADS_ALONE, Surface
from .jobs import LimitsEntry, RenderingEntry, SurfaceEntry, TrackingEntry, limits_of

WITH_QUALITY = ("h264", "h265", "av1", "vp9")  # the codecs that know a crf
PREFIX = "AR_REPLACE_"
REPORTING: dict[str, Any] = {"strict": bool, "quiet": bool, "json": bool, "progress": ProgressKind}
# What is a matter of taste, or of the machine, and not of one job.
_NAMES = {
    SurfaceEntry: ("fit", "playback", "blend", "opacity", "feather", "lost", "flat"),
    TrackingEntry: ("smooth", "device", "weights", "parallel"),
    LimitsEntry: ("max_held", "max_lost", "fail_lost", "max_deviation"),
    RenderingEntry: ("audio", "streams", "location", "backend", "codec", "crf", "depth", "overwrite"),
}
KEYS: dict[str, Any] = REPORTING | {
    name: get_type_hints(entry, include_extras=True)[name] for entry, names in _NAMES.items() for name in names
}


class Defaults:
    """What is said by the file and the environment, by the names of the options."""

    def __init__(self, values: Mapping[str, Any] | None = None) -> None:
        self._values = dict(values or {})

    @property
    def values(self) -> Mapping[str, Any]:
        """All of them."""
        return self._values

    def without(self, names: Container[str]) -> "Defaults":
        """All others than these."""
        return Defaults({name: value for name, value in self._values.items() if name not in names})

    def fitting(self, video: Path | None, codec: str | None) -> "Defaults":
        """Without what an output of this name has no use for: a codec, or sound, that it does not hold, a quality that
        its codec does not know.

        Args:
            video: None where none is written. codec: that is asked for; None leaves it to the defaults.
        """
        if video is None:
            return self.without((*OF_A_VIDEO, *OF_SOUND))
        silent = () if codecs.holds_sound(video) else OF_SOUND
        for name in (codec, None) if codec else (self._values.get("codec"), None):
            try:
                knows_quality = codecs.choose(video, name).name in WITH_QUALITY
            except InputError:
                continue
            unfit = (*(("codec",) if name is None else ()), *(() if knows_quality else ("crf",)))
            return self.without((*unfit, *silent))
        return self

    def of(self, kind: type) -> dict[str, Any]:
        """Those of a dataclass of options."""
        return {f.name: self._values[f.name] for f in fields(kind) if f.name in self._values}

    def tracking(self) -> dict[str, Any]:
        """Those of `TrackingOptions`."""
        return self.of(TrackingOptions)

    def output(self) -> dict[str, Any]:
        """Those of `OutputOptions`."""
        return self.of(OutputOptions)

    def limits(self) -> dict[str, Any]:
        """Those of `Limits`."""
        return limits_of(self._values)

    def surface(self, effect: str = "replace") -> dict[str, Any]:
        """Those of a `Surface` with this effect."""
        own = self.of(Surface)
        return {name: value for name, value in own.items() if effect == "replace" or name not in ADS_ALONE}

    def fill(self, given: Namespace) -> None:
        """Adds how is reported to what is given, where that does not say."""
        for name in REPORTING.keys() & self._values.keys() - vars(given).keys():
            if self._values[name] is not False:
                setattr(given, name, self._values[name])


def load_defaults() -> Defaults:
    """Reads file and environment.

    Raises:
        InputError: the file cannot be read, a name is unknown, or a value is none of its.
    """
    return Defaults(_of_file(config_file()) | _of_environment(os.environ))


def config_file() -> Path:
    """Where the file would be."""
    return user_config_path("ar-replace", appauthor=False) / "config.toml"


def _of_file(path: Path) -> dict[str, Any]:
    try:
        text = path.read_text(encoding="utf-8")
    except FileNotFoundError:
        return {}
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"cannot read {path}: {getattr(error, 'strerror', None) or 'it is no text'}") from error
    try:
        content = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise InputError(f"{path} is not TOML: {error}") from error
    found = {}
    for name, value in content.items():
        line = next((n for n, row in enumerate(text.splitlines(), 1) if re.match(rf'\s*\[?"?{name}\b', row)), 1)
        found[name] = _checked(name, value, f"{path}, line {line}", strict=True)
    if "weights" in found:
        found["weights"] = path.parent / Path(found["weights"]).expanduser()
    return found


def _of_environment(environment: Mapping[str, str]) -> dict[str, Any]:
    found = {}
    for variable, value in environment.items():
        if variable.startswith(PREFIX):
            name = variable.removeprefix(PREFIX).lower()
            found[name] = _checked(name, value, f"the environment's {variable}", strict=False)
    if "weights" in found:
        found["weights"] = Path(found["weights"]).expanduser()
    return found


def _checked(name: str, value: Any, where: str, strict: bool) -> Any:
    """The value, as the option takes it; not strict: from text."""
    if name not in KEYS:
        raise InputError(f"{where}: '{name}' is unknown: choose one of {', '.join(sorted(KEYS))}")
    try:
        return msgspec.convert(value, KEYS[name], strict=strict)
    except msgspec.ValidationError as error:
        raise InputError(f"{where}: {name} = {value!r} cannot be: {str(error)[:1].lower()}{str(error)[1:]}") from error
