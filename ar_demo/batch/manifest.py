"""The manifest of a batch, version 1: many jobs, as YAML, JSON, TOML, or CSV with a job in each row.

    version: 1
    defaults: {output: "out/{clip}.{ad}.mp4", crf: 20}
    jobs:
      - {input: street.mp4, ad: shop.mp4, quad: "476,128 759,122 759,480 482,476"}
      - {input: "plates/*.mp4", effect: blur, track: "plates/{clip}.track.json", output: "out/{clip}.mp4"}
    clips:                                  # each of these with each of the ads
      - {input: a.mp4, quad: "90,60 210,64 208,170 88,160"}
      - {input: b.mp4, quad: "80,60 200,64 198,170 78,160", start: 4.5s}
    ads:
      - {ad: one.png, fit: contain}
      - {ad: two.mp4}

A job says what `ar-replace` can be told, by the names of the job file (`options`). `input` and `ad` can be lists or
globs: the job stands for all of them. In names of files {clip} and {ad} are the names of these without folder and
ending, and {number} counts the jobs from 1. Names are looked for beside the manifest. `manifest.schema.json`, which
`python -m ar_demo.batch.manifest` writes, is its JSON Schema.
"""

import difflib
import json
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationError, create_model
from pydantic_core import ErrorDetails

from ..errors import InputError
from ..units import parse_bytes, parse_seconds
from .documents import Document, Keys, read
from .options import Name, Number, options

SCHEMA = Path(__file__).with_name("manifest.schema.json")
MANY = ("input", "ad")  # options that can be lists, or globs

_FORM = ConfigDict(extra="forbid")
_OWN: dict[str, Any] = {
    "retries": (Annotated[int, Field(ge=0, le=100)], "how often it is tried again after it failed while working"),
    "time_limit": (Annotated[str | Number, AfterValidator(parse_seconds)], "after which it is ended: 90s, 10m, 1.5h"),
    "memory_limit": (Annotated[str | Number, AfterValidator(parse_bytes)], "beyond which it is ended: 4GB"),
}


def _fields() -> dict[str, Any]:
    kinds = {
        name: (Annotated[option.type | list[Name], Field(min_length=1)] if name in MANY else option.type, option.help)
        for name, option in options().items()
    }
    return {
        name: (kind, Field(default=None, description=help or None)) for name, (kind, help) in (kinds | _OWN).items()
    }


Entry: Any = create_model("Entry", __config__=_FORM, __doc__="Options of a job.", **_fields())


class Manifest(BaseModel):
    """See the module."""

    model_config = _FORM

    version: Literal[1]
    defaults: Entry = Field(default_factory=Entry, description="what holds for each job that does not say otherwise")
    jobs: list[Entry] = Field(default=[], description="jobs, each with its input, and its ad where it needs one")
    clips: list[Entry] = Field(default=[], description="jobs without ads: each of them is done with each of the ads")
    ads: list[Entry] = Field(default=[], description="an ad each, with options of its own")


def load(path: Path) -> tuple[Manifest, Document]:
    """Reads a manifest.

    Raises:
        InputError: it cannot be read, or is not as described; the message has line and column of what is wrong.
    """
    document = read(path)
    try:
        return Manifest.model_validate(document.content), document
    except ValidationError as error:
        errors = error.errors(include_url=False, include_context=False)
        first = errors[0]
        more = len({_keys(document.content, each) for each in errors}) - 1
        raise document.wrong(
            _keys(document.content, first), f"{_said(first)}{f', and {more} more' * bool(more)}"
        ) from error
    except InputError as error:
        raise InputError(f"{path}: {error}") from error


def schema() -> str:
    """The JSON Schema of manifests, as it is kept beside this module."""
    return json.dumps(Manifest.model_json_schema(), indent=2) + "\n"


def _keys(content: Any, error: ErrorDetails) -> Keys:
    """Where an error is; what pydantic adds for alternatives of a type is left out."""
    keys: Keys = ()
    for key in error["loc"]:
        inside = isinstance(content, list) if isinstance(key, int) else isinstance(content, dict)
        if not inside:
            break
        keys = (*keys, key)
        try:
            content = content[key]
        except (KeyError, IndexError):
            break
    return keys


def _said(error: ErrorDetails) -> str:
    """In words."""
    name = str(error["loc"][-1]) if error["loc"] else ""
    if error["type"] == "extra_forbidden":
        known = Manifest.model_fields if len(error["loc"]) == 1 else Entry.model_fields
        near = difflib.get_close_matches(name, known, 1)
        return f"'{name}' is unknown{f': did you mean {near[0]}?' if near else ''}"
    if error["type"] == "missing":
        return f"'{name}' is missing"
    message = error["msg"].removeprefix("Value error, ")
    return message[:1].lower() + message[1:]


if __name__ == "__main__":
    SCHEMA.write_text(schema(), encoding="utf-8")
