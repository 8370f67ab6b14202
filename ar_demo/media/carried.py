"""What each container carries beside the picture: codecs of sound and subtitles that its common players read."""

from __future__ import annotations

import io
from typing import Any

import av
from av.stream import Stream

# PCM as QuickTime has it, and as Matroska has it.
_MOV_PCM = {f"pcm_{form}{order}" for form in ("s16", "s24", "s32", "f32", "f64") for order in ("le", "be")}
_MKV_PCM = _MOV_PCM - {"pcm_f32be", "pcm_f64be"} | {"pcm_u8"}
_MPEG = {"aac", "mp3", "ac3", "eac3", "alac"}

# FFmpeg's muxer -> sound codecs that are copied into it; all others are encoded anew. MP4 could hold PCM ("ipcm") and
# DTS, but players of the last years turn the one into noise and skip the other.
COPIED_SOUND = {
    "mp4": _MPEG | {"flac", "opus"},
    "mov": _MPEG | _MOV_PCM | {"pcm_u8", "pcm_s8", "pcm_alaw", "pcm_mulaw"},
    "matroska": _MPEG | _MKV_PCM | {"flac", "opus", "vorbis", "mp2", "dts", "truehd", "mlp", "wavpack", "tta"},
    "webm": {"opus", "vorbis"},
}
# What sound is encoded as where it cannot be copied, else AAC.
ENCODED_SOUND = {"webm": "libopus"}

# Subtitles that are copied, and what other text becomes, its colours and places being lost; pictures stay out.
COPIED_SUBTITLES = {
    "mp4": {"mov_text"},
    "mov": {"mov_text"},
    "matroska": {"subrip", "ass", "ssa", "webvtt", "text", "dvd_subtitle", "dvb_subtitle", "hdmv_pgs_subtitle"},
    "webm": {"webvtt"},
}
TEXT_SUBTITLES = {"subrip", "ass", "ssa", "webvtt", "text", "mov_text"}
ENCODED_SUBTITLES = {"mp4": "mov_text", "mov": "mov_text", "matroska": "subrip", "webm": "webvtt"}


def codec_name(stream: Stream) -> str:
    """A stream's codec by FFmpeg's name of it, not of the decoder; "unknown" where FFmpeg has no name."""
    context: Any = stream.codec_context
    if context is not None:
        return str(context.codec.canonical_name)
    return getattr(stream, "name", None) or "unknown"


def takes(muxer: str, stream: Stream) -> bool:
    """Whether a container takes a stream as it is, which is tried out: muxers promise more than they keep."""
    try:
        with av.open(io.BytesIO(), "w", format=muxer) as trial:
            trial.add_stream_from_template(stream, opaque=True)
            trial.start_encoding()
    except (av.FFmpegError, ValueError):
        return False
    return True
