"""How to track and how to write, with defaults; checked where it is made. What a surface has of its own: `surface`."""

from dataclasses import dataclass, field
from pathlib import Path

from .choices import Alpha, AudioMode, Backend, Depth, Device, KeptStreams
from .errors import InputError
from .frame_range import FrameRange
from .surface import Moment, Span, check_choices, check_not_negative


@dataclass(frozen=True)
class TrackingOptions:
    """How surfaces are tracked.

    Attributes:
        end: the last frame; later ones are left out of track and output.
        time: the only part that is tracked and drawn on; the rest is copied. Unless a surface says where its quad is,
            that is in the first frame of this.
        smooth: 1 takes motion for as smooth as the clip shows; more for smoother; 0 for anything, but in gaps.
        device: what runs the networks.
        weights: another weights file than the shipped one.
        parallel: processes that track stretches of the video at the same time, cut at scene cuts and keyframes.

    Raises:
        InputError: a value that is not allowed.
    """

    end: Moment = field(default_factory=Moment)
    time: Span | None = None
    smooth: float = 1.0
    device: Device = "auto"
    weights: Path | None = None
    parallel: int = 1

    def __post_init__(self) -> None:
        check_choices(self)
        check_parallel(self.parallel)
        check_not_negative("smooth", self.smooth)
        if self.time is not None and self.end != Moment():
            raise InputError("time and end do not go together: time has an end of its own")

    @property
    def last(self) -> Moment:
        """The last frame that is tracked."""
        return self.end if self.time is None else self.time.end or Moment()


@dataclass(frozen=True)
class OutputOptions:
    """How the output is drawn and written.

    Attributes:
        audio: whose sound it has.
        streams: whether all streams of the source go along, or its first sound alone.
        location: whether the place where the source was taken goes along.
        backend: what draws.
        codec: of `media.codecs`, or an encoder by FFmpeg's name; None takes the container's usual.
        crf: quality of the encoder, lower is better; None takes the codec's usual.
        depth: bits a sample: 8, 10, 12; as many as the source has, and its chroma ("source"); or the same as far as the
            codec has them, and 4:2:0 in 8 bits ("auto").
        tonemap: whether HDR is shown in SDR; else it stays HDR where the codec has more than 8 bits.
        alpha: whether a layer's colours are as they are, or times alpha; None takes what is usual in its format.
        layer_codec: of a layer that is a video; None takes the container's usual that holds transparency.
        frames: the only ones that are written, for a farm; all tracks are there already. Pictures of other ranges stay,
            and a video of a part has no sound: see `join`.
        start_number: of the first picture of image sequences that are written; None takes the input's, or 0.
        overwrite: whether an existing output may be replaced.
        parallel: processes that render parts of the video at the same time, which are joined.

    Raises:
        InputError: a value that is not allowed.
    """

    audio: AudioMode = "source"
    streams: KeptStreams = "all"
    location: bool = True
    backend: Backend = "auto"
    codec: str | None = None
    crf: float | None = None
    depth: Depth = "auto"
    tonemap: bool = False
    alpha: Alpha | None = None
    layer_codec: str | None = None
    frames: FrameRange | None = None
    start_number: int | None = None
    overwrite: bool = False
    parallel: int = 1

    def __post_init__(self) -> None:
        check_choices(self)
        check_parallel(self.parallel)
        if self.start_number is not None and self.start_number < 0:
            raise InputError(f"start_number {self.start_number} is out of range: give 0 or more")
        if self.crf is not None and not 0 <= self.crf <= 63:
            raise InputError(f"crf {self.crf} is out of range: give 0 (best) to 51, or to 63 for VP9 and AV1")


def check_parallel(count: int) -> None:
    """Raises InputError for a number of processes that is none."""
    if count < 1:
        raise InputError(f"parallel {count} is out of range: give 1 or more")
