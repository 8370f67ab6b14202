"""What a job can say: the options of `ar-replace`, taken from its parser, by the names that the job file has."""

import argparse
import os
from collections.abc import Callable, Mapping
from functools import cache
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple

from pydantic import AfterValidator, BeforeValidator, Field, Strict

from hdn.commandline import FILES, natural

from ..cli.parsers import replace_parser
from ..surface import parse_polygon

# What a batch sees to itself, or what makes no sense in one.
LEFT_OUT = {"help", "version", "print_completion", "live", "dry_run", "progress", "json", "quiet"}
OUTPUTS = ("output", "layer", "save_matte", "save_track", "report")  # options that name what is written

Number = Annotated[int, Strict()] | Annotated[float, Strict()]


def _text(value: str | float) -> str:
    """A number in a manifest is what it looks like."""
    text = str(value)
    if "\0" in text or text.encode(errors="replace").decode() != text:
        raise ValueError("there is a zero byte, or half a character, in it")
    return text


Name = Annotated[str, AfterValidator(_text)]
Text = Annotated[str | Number, AfterValidator(_text)]


def _corners(points: Any) -> str:
    """Corners as the command line takes them, so that they can be nothing else than that."""
    return " ".join(f"{x:.12g},{y:.12g}" for x, y in parse_polygon(points).tolist())


def _listed(value: Any) -> Any:
    return value if isinstance(value, list) else [value]


Corners = Annotated[str | list[tuple[float, float]], AfterValidator(_corners)]


class Option(NamedTuple):
    """An option of `ar-replace`.

    Attributes:
        name: in a manifest.
        type: that pydantic checks it by.
        action: of the parser; of one that stands for a value each, the first.
        flags: how each of its values is written, where it is a word of its own.
        help: in a sentence.
    """

    name: str
    type: Any
    action: argparse.Action
    flags: Mapping[Any, str]
    help: str

    @property
    def is_path(self) -> bool:
        """Whether it is a file's name, or an address."""
        return self.action.type is Path or self.name in FILES

    @property
    def is_output(self) -> bool:
        """Whether it names what is written."""
        return self.name in OUTPUTS

    def renamed(self, value: Any, rename: Callable[[str], str]) -> Any:
        """The value where each name of a file in it is what `rename` makes of it."""
        if self.is_path:
            return rename(value)
        if self.name == "surface":
            return [(ad if ad == "-" else rename(ad), corners) for ad, corners in value]
        if self.name == "find":
            return [_renamed_pair(text, rename) for text in value]
        return value

    def files(self, value: Any) -> list[str]:
        """The names of files in a value."""
        found: list[str] = []

        def take(name: str) -> str:
            found.append(name)
            return name

        self.renamed(value, take)
        return found

    def arguments(self, value: Any) -> list[str]:
        """How a value, as it was checked, is said on the command line."""
        if self.flags:
            return [self.flags[value]] if value in self.flags else []
        if not self.action.option_strings:
            return [str(value)]
        flag = self.action.option_strings[-1]
        if self.action.nargs == 2:
            return [word for pair in value for word in (flag, *map(str, pair))]
        return [f"{flag}={each}" for each in (value if isinstance(value, list) else [value])]


@cache
def options() -> dict[str, Option]:
    """All options by their names."""
    found: dict[str, Option] = {}
    for action in replace_parser()._actions:
        name = action.dest
        if name in LEFT_OUT:
            continue
        flags = {}
        if action.nargs == 0:
            flags = {action.const: action.option_strings[-1]}
            if name in found:
                flags = {**found[name].flags, **flags}
        help = (action.help or "").replace("%%", "%")
        found[name] = Option(name, _type(action, flags), found[name].action if name in found else action, flags, help)
    return found


def _renamed_pair(text: str, rename: Callable[[str], str]) -> str:
    """Of PICTURE, or PICTURE=AD."""
    picture, sign, ad = text.rpartition("=")
    if not sign or os.path.exists(text if os.path.isabs(text) else rename(text)):
        return rename(text)
    return f"{rename(picture)}={rename(ad)}"


def command(values: Mapping[str, Any]) -> list[str]:
    """The arguments of `ar-replace` for options by their names: those that are no options first.

    Values are words of their own, or joined to their option by =, so that none is taken for an option.
    """
    known = options()
    return [word for name in known if name in values for word in known[name].arguments(values[name])]


def _type(action: argparse.Action, flags: Mapping[Any, str]) -> Any:
    if flags:
        return bool if all(isinstance(value, bool) for value in flags) else Literal[tuple(flags)]
    metavar = action.metavar[-1] if isinstance(action.metavar, tuple) else action.metavar
    kind: Any = Corners if (metavar or "").startswith("X,Y") else Text
    if action.choices is not None:
        kind = Literal[tuple(action.choices)]
    elif action.type in (int, float):
        kind = action.type
    elif action.type is natural:
        kind = Annotated[int, Field(ge=1)]
    elif action.type is Path or action.dest in FILES:
        kind = Name
    elif action.type is not None:
        kind = Annotated[kind, AfterValidator(_accepted_by(action.type))]
    if action.nargs == 2:
        kind = tuple[Name, kind]
    return Annotated[list[kind], BeforeValidator(_listed)] if isinstance(action, argparse._AppendAction) else kind


def _accepted_by(parse: Any) -> Callable[[str], str]:
    """Checks a text by what the parser makes of it, and leaves it as it is."""

    def check(text: str) -> str:
        try:
            parse(text)
        except argparse.ArgumentTypeError as error:
            raise ValueError(str(error)) from error
        return text

    return check
