"""The page: what was judged, measured and seen, as one HTML file that loads nothing."""

from base64 import b64encode
from collections.abc import Iterable, Sequence
from hashlib import sha256
from html import escape
from pathlib import Path
from string import Template

from ..markup import items, table
from ..tracks import Track
from ..verdict import Limits, Verdict
from ..words import counted
from .facts import Facts
from .looking import Look, Still
from .stretches import stretches
from .timeline import timeline

HERE = Path(__file__).parent
TOLD_STRETCHES = 12  # of a track, those most worth a look
MEANING = {
    "pass": "It can be used as it is.",
    "check": "Somebody should look at it.",
    "fail": "It is of no use as it is.",
}


def page(title: str, parts: Iterable[str]) -> str:
    """The whole file. Its policy allows this very style and script, pictures that are in it, and nothing else."""
    style, script = ((HERE / name).read_text(encoding="utf-8") for name in ("style.css", "script.js"))
    return Template((HERE / "page.html").read_text(encoding="utf-8")).substitute(
        title=escape(title),
        style=style,
        style_hash=_hash(style),
        script=script,
        script_hash=_hash(script),
        body="\n".join(parts),
    )


def heading(title: str, lines: Sequence[str], verdict: Verdict) -> str:
    """What it is about, and the verdict."""
    told = "".join(f"<p class='soft'>{escape(line)}</p>" for line in lines)
    reasons = items(verdict.reasons) or f"<span>{MEANING[verdict.status]}</span>"
    return (
        f"<h1>{escape(title)}</h1>{told}<section class='verdict {verdict.status}' aria-label='Verdict'>"
        f"<strong>{verdict.status}</strong>{reasons}</section>"
    )


def of_track(track: Track, name: str, number: int, surfaces: int, limits: Limits, look: Look | None) -> str:
    """A section on one of so many surfaces."""
    parts = [f"<h2>{escape(name)}</h2>", items(summary(track, look))]
    parts += ["<h3>Over time</h3>", timeline(track, number, surfaces, limits, look)]
    if look is not None and look.strip:
        parts += [
            "<h3>The surface, standing still</h3>",
            "<p class='note'>It is rectified by the track: what still moves from picture to picture is error.</p>",
            f"<div class='strip'>{''.join(_figure(still, f'frame {still.index}') for still in look.strip)}</div>",
        ]
    if look is not None and look.worst:
        parts += [
            "<h3>The worst frames</h3>",
            "<p class='note'>The radius of a circle is twice its corner's standard deviation; the dot is the ad's top "
            "left.</p>",
            f"<div class='stills'>{''.join(_worst(track, still) for still in look.worst)}</div>",
        ]
    return f"<section>{''.join(parts)}</section>"


def summary(track: Track, look: Look | None) -> list[str]:
    """What there is to say of a track, a sentence each."""
    counts = track.counts
    told = [
        f"{counts['tracked']} of {counted(sum(counts.values()), 'frame')} are tracked, {counts['held']} held and "
        f"{counts['lost']} lost."
    ]
    found = stretches(track, None if look is None else look.blur)
    chosen = sorted(found, key=lambda stretch: -stretch.weight)[:TOLD_STRETCHES]
    for stretch in sorted(chosen, key=lambda stretch: stretch.first):
        seconds = f"{_seconds(track, stretch.first):.2f} to {_seconds(track, stretch.last):.2f} s"
        told.append(f"{stretch.frames.capitalize()} ({seconds}): {stretch.text}.")
    if len(found) > len(chosen):
        told.append(f"There are {len(found) - len(chosen)} lesser stretches beside these.")
    if track.cuts:
        told.append(f"Another shot begins at frame {_listed(track.cuts)}.")
    if track.keyframes:
        told.append(f"Corners were given by hand in frame {_listed(sorted(track.keyframes))} as well.")
    return told


def before_and_after(pairs: Sequence[tuple[Still, Still]]) -> str:
    """A section on what was made of the video."""
    rows = "".join(
        f"<div class='pairs'>{_figure(before, f'frame {before.index}, before')}"
        f"{_figure(after, f'frame {after.index}, after')}</div>"
        for before, after in pairs
    )
    return f"<section><h2>Before and after</h2>{rows}</section>" if rows else ""


def facts(title: str, rows: Facts) -> str:
    """A section of a table; nothing where there are no rows."""
    return f"<section><h2>{escape(title)}</h2>{table(rows.items())}</section>" if rows else ""


def _figure(still: Still, caption: str, drawn: str = "") -> str:
    picture = f"<div class='drawn'>{still.picture.html(caption)}{drawn}</div>"
    return f"<figure>{picture}<figcaption>{escape(caption)}</figcaption></figure>"


def _worst(track: Track, still: Still) -> str:
    return _figure(still, _caption(track, still), _drawn(track, still))


def _caption(track: Track, still: Still) -> str:
    i = still.index
    told = f"frame {i}, {_seconds(track, i):.2f} s: {track.states[i]}"
    if not track.known[i]:
        return told
    return f"{told}, deviation {track.deviation[i]:.2f} px, confidence {track.confidence[i]:.2f}"


def _drawn(track: Track, still: Still) -> str:
    """The quad on a still, as an SVG over it."""
    if not track.known[still.index]:
        return ""
    quad = still.of_frame(track.corners[still.index]) + 0.5  # SVG's pixels have their edges at integers
    points = " ".join(f"{x:.2f},{y:.2f}" for x, y in quad)
    radius = max(2 * float(track.deviation[still.index]) / still.scale, 2.0)
    circles = "".join(f"<circle cx='{x:.2f}' cy='{y:.2f}' r='{radius:.2f}'/>" for x, y in quad)
    (x, y), state = quad[0], track.states[still.index]
    return (
        f"<svg viewBox='0 0 {still.picture.width} {still.picture.height}' aria-hidden='true'>"
        f"<polygon class='halo' points='{points}'/><polygon class='{state}' points='{points}'/>{circles}"
        f"<circle class='first' cx='{x:.2f}' cy='{y:.2f}' r='3'/></svg>"
    )


def _seconds(track: Track, index: int) -> float:
    """Of a frame, from the video's first."""
    return float(track.times[index] - track.times[0])


def _listed(numbers: Sequence[int], most: int = 20) -> str:
    told = ", ".join(map(str, numbers[:most]))
    return told if len(numbers) <= most else f"{told} and {len(numbers) - most} others"


def _hash(text: str) -> str:
    """As a Content-Security-Policy names an inline style or script (CSP Level 3, section 2.3.1)."""
    return "sha256-" + b64encode(sha256(text.encode()).digest()).decode()
