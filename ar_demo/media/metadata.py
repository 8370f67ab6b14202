"""Titles, languages, times, places and chapters of a file, as another container takes them."""

from __future__ import annotations

import re
from collections.abc import Mapping
from fractions import Fraction
from typing import TYPE_CHECKING

from av.container import InputContainer, OutputContainer
from av.stream import Stream

if TYPE_CHECKING:  # PyAV has it for type checkers alone
    from av.container.core import Chapter

# What a file says of its own making, which is not the output's.
_TECHNICAL = {
    "major_brand", "minor_version", "compatible_brands", "encoder", "vendor_id", "duration", "alpha_mode", "bps",
    "number_of_frames", "number_of_bytes", "source_id", "variant_bitrate", "service_name", "service_provider",
}  # fmt: skip
# Tags of MP4 and MOV in their plain form; where there are others, all are written as keys with names of their own.
_PLAIN_TAGS = {
    "mp4": {
        "title", "artist", "album_artist", "composer", "album", "date", "comment", "genre", "copyright", "grouping",
        "lyrics", "description", "synopsis", "show", "episode_id", "network", "keywords", "track", "disc",
    },
    "mov": {"title", "artist", "author", "album", "date", "comment", "genre", "copyright", "make", "model", "keywords"},
}  # fmt: skip
_ELSEWHERE = {"creation_time", "timecode", "location"}  # which MP4 and MOV have their own places for
# QuickTime's languages where ISO 639-2 has two codes, or FFmpeg writes another.
_MOV_LANGUAGES = {
    "deu": "ger", "nld": "dut", "ell": "gre", "isl": "ice", "zho": "chi", "sqi": "alb", "mkd": "mac", "fre": "fra",
    "rum": "ron", "cze": "ces", "slo": "slk", "swe": "sve",
}  # fmt: skip


def carry_tags(source: InputContainer, output: OutputContainer, location: bool) -> None:
    """Gives an output that is not begun yet the source's title, times and other tags.

    Args:
        location: whether the place where it was taken goes along.
    """
    tags = _meant(source.metadata, location)
    if "location" in tags:  # the same once more, in a language
        tags = {key: value for key, value in tags.items() if not key.startswith("location-")}
    muxer = output.format.name
    output.metadata.update(tags)
    if muxer in _PLAIN_TAGS and tags.keys() - _PLAIN_TAGS[muxer] - _ELSEWHERE:
        flags = output.container_options.get("movflags", "")
        output.container_options["movflags"] = f"{flags}+use_metadata_tags"


def carry_stream_tags(source: Stream, target: Stream, location: bool) -> None:
    """Gives a stream of the output another's title, language, timecode and other tags."""
    muxer = target.container.format.name
    tags = _meant(source.metadata, location)
    if "name" in tags:  # QuickTime's word for a track's title
        tags.setdefault("title", tags.pop("name"))
    if muxer in ("matroska", "webm"):  # MP4's words
        tags.pop("handler_name", None)
    if muxer == "mov" and "language" in tags:
        tags["language"] = _MOV_LANGUAGES.get(tags["language"], tags["language"])
    target.metadata.update(tags)


def carry_chapters(source: InputContainer, output: OutputContainer, start: Fraction, end: Fraction | None) -> None:
    """Gives an output that is not begun yet the source's chapters.

    Args:
        start, end: seconds on the source's clock between which the output lies; None: to the end.
    """
    kept: list[Chapter] = []
    for chapter in source.chapters():
        base = chapter["time_base"] or Fraction(1, 1000)
        first, last = max(chapter["start"] * base, start), chapter["end"] * base
        last = last if end is None else min(last, end)
        if first < last:
            ticks = Fraction(1, 1000)
            kept.append(
                {
                    "id": chapter["id"],
                    "start": round((first - start) / ticks),
                    "end": round((last - start) / ticks),
                    "time_base": ticks,
                    "metadata": chapter["metadata"],
                }
            )
    if kept:
        output.set_chapters(kept)


def _meant(tags: Mapping[str, str], location: bool) -> dict[str, str]:
    """Tags that are meant for people, in lower case, without the location where that is not wanted."""
    return {
        key.lower(): value
        for key, value in tags.items()
        if key.lower().split("-")[0] not in _TECHNICAL
        and not key.lower().startswith("_statistics")
        and (location or not _is_location(key))
    }


def tells_place(text: bytes) -> bool:
    """Whether a line of subtitles gives coordinates, as those that drones write."""
    return re.search(rb"latitude|longitude|\bgps\b", text, re.IGNORECASE) is not None


def _is_location(key: str) -> bool:
    return any(word in key.lower() for word in ("location", "gps", "xyz", "latitude", "longitude"))
