"""What can be chosen, each list declared once; imports nothing, so that `--help` is quick."""

from typing import Literal, get_args

Fit = Literal["stretch", "contain", "cover"]
Playback = Literal["loop", "hold", "once"]
Blend = Literal["normal", "multiply", "screen", "overlay", "soft-light", "add"]
Grain = Literal["auto", "off"]
Softness = Literal["auto", "off"]
FirstLight = Literal["auto", "even"]
SurfaceKind = Literal["print", "screen", "cloth"]
Lost = Literal["hold", "fade", "hide"]
Effect = Literal["replace", "mosaic", "blur", "outline"]
AudioMode = Literal["source", "ad", "mix", "none"]
KeptStreams = Literal["all", "first"]
Backend = Literal["auto", "egl", "osmesa", "opencv"]
Depth = Literal["auto", "8", "10", "12", "source"]
Alpha = Literal["straight", "premultiplied"]
Device = Literal["auto", "cpu", "cuda"]
LostKeys = Literal["hold", "omit"]
# Other packages can add to the formats: see `export.formats`.
Format = Literal[
    "nuke",
    "nuke-tracker",
    "nuke-stabilize",
    "ae",
    "ae-power-pin",
    "ae-script",
    "fusion",
    "blender",
    "csv",
    "json",
    "otio",
]
ProgressKind = Literal["bar", "plain", "json", "openjd"]

CHOICES: dict[str, tuple[str, ...]] = {
    "fit": get_args(Fit),
    "playback": get_args(Playback),
    "blend": get_args(Blend),
    "grain": get_args(Grain),
    "softness": get_args(Softness),
    "first_light": get_args(FirstLight),
    "surface_kind": get_args(SurfaceKind),
    "lost": get_args(Lost),
    "effect": get_args(Effect),
    "audio": get_args(AudioMode),
    "streams": get_args(KeptStreams),
    "backend": get_args(Backend),
    "depth": get_args(Depth),
    "alpha": get_args(Alpha),
    "device": get_args(Device),
    "lost_keys": get_args(LostKeys),
    "format": get_args(Format),
    "progress": get_args(ProgressKind),
}
