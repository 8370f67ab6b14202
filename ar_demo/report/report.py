"""The report on tracks, and on what was rendered with them."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from html import escape
from pathlib import Path

from ..errors import InputError, RunError
from ..markup import items
from ..media.claims import Claim, write_whole
from ..media.reader import IndexDropped, VideoReader
from ..media.sequences import ImageSequence
from ..progress import Listener, silent
from ..session import check_belongs_to
from ..stopping import StopSignal
from ..tracks import Track
from ..verdict import LIMITS, Limits, Verdict, judge
from ..words import counted
from .facts import Facts, versions
from .looking import Look, Still, look, pairs
from .page import before_and_after, facts, heading, of_track, page


def check_page(path: Path | str) -> Path:
    """The name of a report as a path; raises InputError where it has another ending than a page's."""
    if Path(path).suffix.lower() not in (".html", ".htm"):
        raise InputError(f"{path}: a report must end in .html")
    return Path(path)


@dataclass(frozen=True)
class Report:
    """What there is to say of tracks; in a notebook it shows itself.

    Attributes:
        tracks: one or several, of one video.
        verdict: whether they can be believed unseen.
        names: of the surfaces, as their ads are called.
        looks: what was seen of each in the video; none where that was not at hand.
        pairs: stills before and after; none where nothing was rendered.
        settings, timings: what was asked for, and how long it took, by name.
        warnings: what else there is to say, a sentence each.

    Example:
        report = Report.of(track, "street.mp4")
        print(report.verdict)
        report.save("report.html")
    """

    tracks: list[Track]
    verdict: Verdict
    names: list[str | None] = field(default_factory=list)
    looks: list[Look] = field(default_factory=list)
    pairs: list[tuple[Still, Still]] = field(default_factory=list)
    settings: Facts = field(default_factory=dict)
    timings: Facts = field(default_factory=dict)
    warnings: list[str] = field(default_factory=list)

    @classmethod
    def of(
        cls,
        tracks: Track | Sequence[Track],
        video: Path | str | ImageSequence | None = None,
        composite: Path | str | None = None,
        limits: Limits = LIMITS,
        names: Sequence[str | None] = (),
        settings: Facts | None = None,
        timings: Facts | None = None,
        warnings: Sequence[str] | None = None,
        listen: Listener = silent,
        stop: StopSignal | None = None,
    ) -> "Report":
        """Judges tracks, and looks at their video where it is given.

        Args:
            tracks: of one video.
            video: that they were made of; None leaves out all pictures, light and blur.
            composite: what was rendered with them, frame by frame as the video is; where it cannot be looked at, a
                warning says why.
            limits: what they may be and pass.
            names: of the surfaces, as their ads are called.
            settings, timings: what was asked for, and how long it took, by name.
            warnings: what else there is to say; None takes the tracks' own.
            listen: called after each frame.
            stop: ends it, as a session's own does.

        Raises:
            InputError: there is no track, or one of another video; a video that cannot be read.
            Stopped: somebody asked to.
        """
        tracks = [tracks] if isinstance(tracks, Track) else list(tracks)
        verdict = judge(tracks, limits)
        if warnings is None:
            warnings = [warning for track in tracks for warning in track.warnings]
        looks: list[Look] = []
        stills: list[tuple[Still, Still]] = []
        told = list(dict.fromkeys(warnings))
        if video is not None:
            with VideoReader(video) as reader:
                for track in tracks:
                    check_belongs_to(track, reader)
                try:
                    looks = look(reader, tracks, listen, stop)
                except IndexDropped:
                    looks = look(reader, tracks, listen, stop)  # by decoding alone
                try:
                    stills = pairs(reader, composite, tracks) if composite is not None else []
                except (InputError, RunError) as error:
                    told.append(f"there are no stills of what was made: {error}")
        return cls(tracks, verdict, list(names), looks, stills, dict(settings or {}), dict(timings or {}), told)

    def html(self) -> str:
        """The page: it loads nothing, and can be opened anywhere."""
        source = self.tracks[0].source
        title = Path(source.path).name
        about = f"{source.width}x{source.height}, {float(source.fps):.6g} frames/s, {counted(source.frames, 'frame')}"
        parts = [heading(title, [about], self.verdict)]
        for number, track in enumerate(self.tracks, 1):
            seen = self.looks[number - 1] if self.looks else None
            parts.append(of_track(track, self._name(number), number, len(self.tracks), self.verdict.limits, seen))
        parts.append(before_and_after(self.pairs))
        if self.warnings:
            parts.append(f"<section><h2>Warnings</h2>{items(self.warnings)}</section>")
        parts += [facts("Settings", self.settings), facts("Timings", self.timings), facts("Versions", versions())]
        return page(f"{title}: {self.verdict.status}", filter(None, parts))

    def save(self, path: Path | str | Claim) -> None:
        """Writes the page, whole or not at all.

        Raises:
            InputError: there can be no file of this name.
            RunError: the file cannot be written.
        """
        write_whole(path, self.html().encode())

    def _name(self, number: int) -> str:
        name = self.names[number - 1] if self.names else None
        surface = "The surface" if len(self.tracks) == 1 else f"Surface {number}"
        return surface if name is None else f"{surface}: {Path(name).name}"

    def _repr_html_(self) -> str:
        return f"<iframe sandbox='allow-scripts' width='100%' height='800' srcdoc='{escape(self.html())}'></iframe>"
