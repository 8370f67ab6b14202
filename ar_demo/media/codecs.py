"""What can be written: containers, the codecs that each of them holds, and their pixel formats. The one table of these.

Each pair of codec and container that stands here is encoded and decoded by `tests/media/test_codecs.py`.
"""

from __future__ import annotations

import logging
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from dataclasses import replace as changed
from fractions import Fraction
from functools import cache
from io import BytesIO
from pathlib import Path
from typing import cast

import av

from ..errors import InputError
from .priority import priority_kept

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Container:
    """A kind of file that holds a moving picture.

    Attributes:
        muxer: FFmpeg's name.
        codec: the usual one in it, by its name in the table; deep: the usual one for more than 8 bits.
        transparent: the usual one that holds transparency; None where there is none.
        sound: whether it holds sound.
        tick: seconds in which it tells times, where it leaves no choice.
        least_ticks: that a frame lasts; one that comes sooner is left out.
        options: of the muxer.
    """

    muxer: str
    codec: str = "h264"
    deep: str = "h265"  # of which players know 10 bits, unlike of H.264
    transparent: str | None = None
    sound: bool = True
    tick: Fraction | None = None
    least_ticks: int = 0
    options: Mapping[str, str] = field(default_factory=dict)


_FAST_START = {"movflags": "+faststart"}  # plays while it loads

CONTAINERS = {
    ".mp4": Container("mp4", options=_FAST_START),
    ".m4v": Container("mp4", options=_FAST_START),
    ".mov": Container("mov", transparent="prores4444", options=_FAST_START),
    ".mkv": Container("matroska", transparent="ffv1"),
    ".webm": Container("webm", "vp9", "av1", "vp9"),
    # Players show a GIF's frame of 10 ms for 100 ms.
    ".gif": Container("gif", "gif", "gif", sound=False, tick=Fraction(1, 100), least_ticks=2),
    ".webp": Container(
        "webp", "webp", "webp", "webp", sound=False, tick=Fraction(1, 1000), least_ticks=1, options={"loop": "0"}
    ),
}


@dataclass(frozen=True)
class Codec:
    """A way to encode pictures.

    Attributes:
        name: as `--codec` takes it; title: as people write it.
        encoder: FFmpeg's name.
        containers: suffixes of the files that hold it.
        formats: pixel formats by preference.
        transparent: those with alpha, by preference.
        transparent_containers: suffixes of the files that hold it with alpha, where these are others.
        profiles: of the encoder, by pixel format.
        options: of the encoder, whatever the pixel format.
        quality: its option that `--crf` gives.
    """

    name: str
    title: str
    encoder: str
    containers: tuple[str, ...]
    formats: tuple[str, ...]
    transparent: tuple[str, ...] = ()
    transparent_containers: tuple[str, ...] = ()
    profiles: Mapping[str, str] = field(default_factory=dict)
    options: Mapping[str, str] = field(default_factory=dict)
    quality: str = "crf"

    def options_for(self, pixel_format: str) -> dict[str, str]:
        """The encoder's options for a pixel format."""
        profile = self.profiles.get(pixel_format)
        return dict(self.options) | ({"profile": profile} if profile else {})

    def holders(self, alpha: bool = False) -> tuple[str, ...]:
        """Suffixes of the files that hold it, with or without transparency."""
        return (self.transparent_containers if alpha else ()) or self.containers


def _yuv(*depths: int) -> tuple[str, ...]:
    """Planar YUV of these depths, the least chroma first."""
    return tuple(f"yuv{chroma}p{_suffix(depth)}" for depth in depths for chroma in ("420", "422", "444"))


def _suffix(depth: int) -> str:
    return "" if depth == 8 else f"{depth}le"


_MOVIE = (".mp4", ".m4v", ".mov", ".mkv")

CODECS = (
    Codec("h264", "H.264", "libx264", _MOVIE, _yuv(8, 10)),
    Codec("h265", "H.265", "libx265", _MOVIE, _yuv(8, 10, 12), options={"x265-params": "log-level=error"}),
    Codec("av1", "AV1", "libsvtav1", (".mp4", ".m4v", ".mkv", ".webm"), ("yuv420p", "yuv420p10le")),
    Codec(
        "vp9",
        "VP9",
        "libvpx-vp9",
        (".webm", ".mkv", ".mp4", ".m4v"),
        _yuv(8),
        transparent=("yuva420p",),
        transparent_containers=(".webm", ".mkv"),
        options={"cpu-used": "4", "row-mt": "1"},  # several times faster for hardly a difference
    ),
    Codec(
        "prores",
        "ProRes 422",
        "prores_ks",
        (".mov", ".mkv"),
        ("yuv422p10le",),
        profiles={"yuv422p10le": "hq"},
        options={"vendor": "apl0"},
    ),
    Codec(
        "prores4444",
        "ProRes 4444",
        "prores_ks",
        (".mov", ".mkv"),
        ("yuv444p10le",),
        transparent=("yuva444p10le",),
        profiles={"yuv444p10le": "4444", "yuva444p10le": "4444"},
        options={"vendor": "apl0", "alpha_bits": "16"},
    ),
    Codec(
        "dnxhr",
        "DNxHR",
        "dnxhd",
        (".mov",),
        ("yuv422p", "yuv422p10le", "yuv444p10le"),
        profiles={"yuv422p": "dnxhr_hq", "yuv422p10le": "dnxhr_hqx", "yuv444p10le": "dnxhr_444"},
    ),
    Codec("animation", "QuickTime Animation", "qtrle", (".mov",), ("rgb24",), transparent=("argb",)),
    Codec(
        "ffv1",
        "FFV1",
        "ffv1",
        (".mkv",),
        (*_yuv(8, 10, 12, 16), "gbrp10le", "gbrp12le", "gbrp16le"),
        transparent=("gbrap16le",),
    ),
    Codec("gif", "GIF", "gif", (".gif",), ("pal8",)),
    Codec("webp", "animated WebP", "libwebp_anim", (".webp",), ("bgra",), ("bgra",), options={"quality": "90"}),
)
# Pictures, each a file of an image sequence; by their endings.
PICTURES = {
    # A third of the time that the default level takes, for files that are 7 % larger.
    ".png": Codec(
        "png", "PNG", "png", (".png",), ("rgb24", "rgb48be"), ("rgba64be",), options={"compression_level": "3"}
    ),
    ".exr": Codec(
        "exr",
        "OpenEXR",
        "exr",
        (".exr",),
        ("gbrpf32le",),
        transparent=("gbrapf32le",),
        options={"format": "half", "compression": "zip16"},
    ),
} | dict.fromkeys(
    (".tif", ".tiff"),
    Codec(
        "tiff",
        "TIFF",
        "tiff",
        (".tif", ".tiff"),
        ("rgb24", "rgb48le"),
        transparent=("rgba64le",),
        options={"compression_algo": "deflate"},
    ),
)
_BY_NAME = {codec.name: codec for codec in CODECS}
_BY_ENCODER = {codec.encoder: codec for codec in reversed(CODECS)}  # the first one of each
# What an encoder that is not in the table may take.
_ANY_FORMATS = (*_yuv(8), "gbrp", "rgb24", *_yuv(10, 12, 14, 16), "gbrp10le", "gbrp12le", "gbrp14le", "gbrp16le")


def check_video_name(path: Path) -> None:
    """Raises InputError for a name whose ending is not that of a container that we write."""
    if path.suffix.lower() not in CONTAINERS:
        raise InputError(f"{path}: output must end in one of {', '.join(CONTAINERS)}")


def is_picture(path: Path) -> bool:
    """Whether a name is that of a picture, or of a sequence of them."""
    return path.suffix.lower() in PICTURES


def is_linear(path: Path) -> bool:
    """Whether a name is that of pictures in linear light: OpenEXR."""
    return path.suffix.lower() == ".exr"


def picture_codec(path: Path) -> Codec:
    """The codec of an image sequence of this name; raises InputError where it is none that we write."""
    if not is_picture(path):
        raise InputError(f"{path}: an image sequence must end in one of {', '.join(PICTURES)}")
    return PICTURES[path.suffix.lower()]


def holds_sound(path: Path) -> bool:
    """Whether a file of this name holds sound; one that no container has the ending of holds none."""
    container = CONTAINERS.get(path.suffix.lower())
    return container is not None and container.sound


def choose(path: Path, name: str | None, alpha: bool = False, depth: int = 8) -> Codec:
    """The codec that a video file is written with.

    Args:
        path: with the ending of a container, or of a picture.
        name: of the codec in the table, or of FFmpeg's encoder; None takes the container's usual.
        alpha: whether it has to hold transparency.
        depth: bits per sample, by which the usual codec is chosen.

    Raises:
        InputError: an unknown container or codec, or a codec that the container cannot hold.
    """
    suffix = path.suffix.lower()
    if is_picture(path):
        if name is not None:
            raise InputError(f"{suffix} has one way to be written: leave the codec {name} out")
        return PICTURES[suffix]
    check_video_name(path)
    codec = _usual(suffix, alpha, depth) if name is None else _named(name)
    if alpha and not codec.transparent:
        others = [other for other in CONTAINERS if _transparent(other)]
        advice = f"choose {any_of(_transparent(suffix))}" if _transparent(suffix) else _ending(others)
        raise InputError(f"{path}: {codec.title} holds no transparency: {advice}")
    if suffix not in codec.holders(alpha):
        with_alpha = " with transparency" if alpha else ""
        held = _transparent(suffix) if alpha else _held(suffix)
        advice = _ending(codec.holders(alpha)) + (f", or choose {any_of(held)}" if held else "")
        raise InputError(f"{path}: {suffix} cannot hold {codec.title}{with_alpha}: {advice}")
    return codec


def pixel_format(
    codec: Codec,
    suffix: str,
    width: int,
    height: int,
    depth: int = 8,
    like: str | None = None,
    alpha: bool = False,
) -> str:
    """The pixel format to encode in: of as many bits, or of the next more that the codec has.

    Odd sizes, which 4:2:0 and 4:2:2 cannot hold, become 4:4:4 or RGB.

    Args:
        suffix: of the file, by which other codecs are proposed.
        depth: bits per sample.
        like: one that is preferred among those of its depth, as the source's; None takes 4:2:0 before others.
        alpha: whether it has to hold transparency.

    Raises:
        InputError: there is none; the message says which codecs have one.
    """
    chosen = _fitting(codec, width, height, depth, like, alpha)
    if chosen is None:
        others = [c.name for c in CODECS if suffix in c.containers and _fitting(c, width, height, depth, None, alpha)]
        bits = f" with {depth} bits per sample" if depth > 8 else ""
        other = "fewer bits or another container" if depth > 8 else "another container, or an even size"
        advice = f"use {any_of(others) or other}"
        raise InputError(f"codec {codec.name} cannot write {width}x{height}{bits}: {advice}")
    return chosen


def most_bits(codec: Codec, wanted: int, width: int, height: int) -> int:
    """Bits per sample that a codec has for a size: as many as are wanted, or else the most."""
    depths = [depth for depth in (8, 10, 12, 14, 16) if depth <= wanted and _fitting(codec, width, height, depth, None)]
    return max(depths, default=8)


def depth_of(pixel_format: str) -> int:
    """Bits per sample of a pixel format."""
    return max(component.bits for component in av.VideoFormat(pixel_format).components)


def any_of(names: Iterable[str]) -> str:
    """As in 'a, b or c'."""
    *others, last = list(names) or [""]
    return f"{', '.join(others)} or {last}" if others else last


def _ending(suffixes: Iterable[str]) -> str:
    return f"let the name end in {any_of(suffixes) or 'another way'}"


def _named(name: str) -> Codec:
    return _BY_NAME.get(name) or _BY_ENCODER.get(name) or _on_hardware(name) or _foreign(name)


def _usual(suffix: str, alpha: bool, depth: int) -> Codec:
    container = CONTAINERS[suffix]
    usual = container.codec if depth <= 8 else container.deep
    return _BY_NAME[(container.transparent if alpha else None) or usual]


def _held(suffix: str) -> list[str]:
    return [codec.name for codec in CODECS if suffix in codec.containers]


def _transparent(suffix: str) -> list[str]:
    return [codec.name for codec in CODECS if codec.transparent and suffix in codec.holders(True)]


def _fitting(codec: Codec, width: int, height: int, depth: int, like: str | None, alpha: bool = False) -> str | None:
    odd = bool(width % 2 or height % 2)
    usable = [
        name
        for name in (codec.transparent if alpha else codec.formats)
        if name in offered(codec.encoder) and depth_of(name) >= depth and not (odd and _is_subsampled(name))
    ]
    return min(usable, key=lambda name: (depth_of(name), name != like), default=None)


def _is_subsampled(pixel_format: str) -> bool:
    return av.VideoFormat(pixel_format).chroma_width(2) == 1


@cache
def offered(encoder: str) -> frozenset[str]:
    """Names of the pixel formats that an encoder takes; none where there is no such encoder."""
    try:
        return frozenset(pixel_format.name for pixel_format in av.Codec(encoder, "w").video_formats or [])
    except ValueError:
        return frozenset()


# Encoders of graphics cards and processors: FFmpeg's names begin with the kind and end with the maker's interface.
_HARDWARE_KINDS = {"h264": "h264", "hevc": "h265", "av1": "av1"}
_HARDWARE = ("nvenc", "qsv", "videotoolbox", "vaapi", "amf")


def _on_hardware(encoder: str) -> Codec | None:
    """A hardware encoder by FFmpeg's name, or software in its place where it does not work; None for another name."""
    kind, _, interface = encoder.partition("_")
    if kind not in _HARDWARE_KINDS or interface not in _HARDWARE:
        return None
    software = _BY_NAME[_HARDWARE_KINDS[kind]]
    if not _works(encoder):
        _say_in_place_of(encoder, software.encoder)
        return software
    if interface != "nvenc":
        return _foreign(encoder)
    # A constant quality, as x264's: without these it keeps to a rate of 2 Mbit/s.
    options = {"rc": "vbr", "b": "0"}
    return changed(_foreign(encoder), title=f"{software.title} (NVENC)", options=options, quality="cq")


@cache
def _say_in_place_of(encoder: str, software: str) -> None:
    """Says it once."""
    log.warning("%s does not work on this machine: %s encodes in its place", encoder, software)


@cache
def _works(encoder: str) -> bool:
    """Whether an encoder can be opened here, takes frames in memory, and makes a packet of one."""
    try:
        context = cast(av.VideoCodecContext, av.CodecContext.create(encoder, "w"))
        formats = offered(encoder)
    except ValueError:  # FFmpeg was built without it
        return False
    if "yuv420p" not in formats:
        return False
    context.width, context.height, context.pix_fmt = _TRIAL_SIZE[0], _TRIAL_SIZE[1], "yuv420p"
    context.time_base = Fraction(1, 25)
    try:
        with priority_kept():
            context.open()
            frame = av.VideoFrame(context.width, context.height, context.pix_fmt)
            frame.pts, frame.time_base = 0, context.time_base
            return bool([*context.encode(frame), *context.encode(None)])  # some fail at the first frame alone
    except (av.FFmpegError, OSError):
        return False


_TRIAL_SIZE = 640, 360  # px: no encoder finds it too small or too large


def _foreign(encoder: str) -> Codec:
    """One that is not in the table, by FFmpeg's name.

    Raises:
        InputError: there is no such encoder.
    """
    try:
        av.Codec(encoder, "w")
    except ValueError as error:
        names = any_of(codec.name for codec in CODECS)
        raise InputError(f'video codec "{encoder}" is unknown: try {names}') from error
    containers = tuple(suffix for suffix, kind in CONTAINERS.items() if encoder in _supported(kind.muxer))
    return Codec(encoder, encoder, encoder, containers, _ANY_FORMATS)


@cache
def _supported(muxer: str) -> frozenset[str]:
    with av.open(BytesIO(), "w", format=muxer) as container:
        return frozenset(container.supported_codecs)
