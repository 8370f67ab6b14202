"""A range of frames by the numbers that they have in a farm and in the names of pictures."""

import re
from collections.abc import Sequence
from dataclasses import dataclass

from .errors import InputError


@dataclass(frozen=True)
class FrameRange:
    """The frames from first to last, both included.

    They are numbered as pictures that are written are: from `--start-number` on, else from the input's first picture,
    else from 0.
    """

    first: int
    last: int

    @classmethod
    def parse(cls, text: "str | int | FrameRange") -> "FrameRange":
        """Reads '1-100', or '7' for one frame.

        Raises:
            InputError: neither.
        """
        if isinstance(text, FrameRange):
            return text
        match = re.fullmatch(r"\s*(\d+)(?:\s*-\s*(\d+))?\s*", str(text))
        if match is None or int(match[2] or match[1]) < int(match[1]):
            raise InputError(f"'{text}' is no range of frames: give the first and the last, as in 1-100, or one")
        return cls(int(match[1]), int(match[2] or match[1]))

    def indices(self, numbers: Sequence[int]) -> range:
        """The frames in it, by their places in the video. numbers: of the video's frames, ascending."""
        found = [index for index, number in enumerate(numbers) if self.first <= number <= self.last]
        return range(found[0], found[-1] + 1) if found else range(0)

    def __contains__(self, number: int) -> bool:
        return self.first <= number <= self.last

    def __str__(self) -> str:
        return f"{self.first}-{self.last}"
