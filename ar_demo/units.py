"""Sizes and lengths of time as people write them."""

import re

_BYTES = {"": 1, "K": 10**3, "M": 10**6, "G": 10**9, "T": 10**12, "KI": 2**10, "MI": 2**20, "GI": 2**30, "TI": 2**40}
_SECONDS = {"": 1, "s": 1, "m": 60, "min": 60, "h": 3600}


def parse_bytes(text: str | float) -> int:
    """Reads '4GB', '500 MB', '2GiB', or a number of bytes.

    Raises:
        ValueError: it is something else, or nothing.
    """
    match = re.fullmatch(r"(\d+(?:\.\d+)?)\s*([KMGT]?I?)B?", str(text).strip().upper())
    size = round(float(match[1]) * _BYTES[match[2]]) if match and match[2] in _BYTES else 0
    if size < 1:
        raise ValueError(f"'{text}' is no size: give it as in 4GB or 500MB")
    return size


def parse_seconds(text: str | float) -> float:
    """Reads '90', '90s', '10m' or '1.5h'.

    Raises:
        ValueError: it is something else, or nothing.
    """
    match = re.fullmatch(r"(\d+(?:\.\d+)?)\s*(s|m|min|h|)", str(text).strip())
    seconds = float(match[1]) * _SECONDS[match[2]] if match else 0.0
    if seconds <= 0:
        raise ValueError(f"'{text}' is no length of time: give it as in 90s, 10m or 1.5h")
    return seconds


def in_words(size: int) -> str:
    """As in '4 GB'."""
    for name, unit in (("TB", 10**12), ("GB", 10**9), ("MB", 10**6)):
        if size >= unit:
            return f"{size / unit:.3g} {name}"
    return f"{size} bytes"
