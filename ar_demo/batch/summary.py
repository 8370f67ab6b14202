"""What came of a batch: as a table, JSON, JUnit XML and HTML, the worst jobs first."""

import html
import json
import os
import re
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any
from urllib.parse import quote
from xml.etree import ElementTree

from ..media.claims import write_whole
from ..media.download import is_url
from ..words import counted
from .running import ENDINGS, Done
from .task import log_of

VERDICTS = ("fail", "check", "pass")  # worst first
WORDS = {"failed": "failed", "wrong": "wrong input", "doubtful": "to be checked", "done": "done", "kept": "done before"}
_NOT_XML = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")

_PAGE = """<!DOCTYPE html>
<html lang="en"><meta charset="utf-8"><meta name="viewport" content="width=device-width">
<title>{title}</title>
<style>
:root {{ color-scheme: light dark; }}
body {{ font: 15px/1.5 system-ui, sans-serif; margin: 2rem auto; max-width: 75rem; padding: 0 1rem; }}
table {{ border-collapse: collapse; width: 100%; }}
th, td {{ text-align: left; vertical-align: top; padding: .3rem .8rem .3rem 0; border-bottom: 1px solid #8886; }}
td.number, th.number {{ text-align: right; font-variant-numeric: tabular-nums; }}
td.name, td.said {{ overflow-wrap: anywhere; }}
.failed, .wrong, .fail {{ font-weight: 600; color: light-dark(#a40000, #ff9a8f); }}
.check, .doubtful {{ font-weight: 600; color: light-dark(#7a4b00, #ffc66b); }}
</style>
<h1>{title}</h1>
<p>{words}</p>
<table>
<thead><tr><th>output<th>ended<th>verdict<th class="number">tries<th class="number">seconds<th>frames<th>said<th>
</thead>
<tbody>
{rows}
</tbody>
</table>
</html>
"""


def worst_first(done: Sequence[Done]) -> list[Done]:
    """Failed jobs, refused ones, then those that are done by their verdicts and by how much of the track is sure."""

    def rank(one: Done) -> tuple[int, int, float, int]:
        verdict = verdict_of(one)
        ending = ENDINGS.index("done") if one.is_good else ENDINGS.index(one.ending)
        return ending, VERDICTS.index(verdict) if verdict in VERDICTS else 1, _share_tracked(one), one.job.number

    return sorted(done, key=rank)


def verdict_of(done: Done) -> str:
    """Of the job's report; '' where it has none."""
    verdict = done.result.get("verdict")
    return str(verdict.get("status", "") if isinstance(verdict, dict) else verdict or "")


def in_words(done: Sequence[Done]) -> str:
    """As in '12 jobs: 10 done, 2 failed'."""
    counts = Counter(one.ending for one in done)
    return f"{counted(len(done), 'job')}: " + ", ".join(f"{counts[e]} {WORDS[e]}" for e in ENDINGS[::-1] if counts[e])


def table(done: Sequence[Done]) -> str:
    """For a terminal."""
    rows = [("ended", "tries", "seconds", "frames", "output")]
    for one in worst_first(done):
        name = one.job.name if not one.message else f"{one.job.name}: {one.message}"
        rows.append((WORDS[one.ending], str(one.attempts), f"{one.seconds:.1f}", _states(one), name))
    widths = [max(len(row[i]) for row in rows) for i in range(4)]
    lines = [
        "  ".join([*(cell.ljust(width) for cell, width in zip(row, widths, strict=False)), row[4]]) for row in rows
    ]
    return "\n".join([*lines, in_words(done)])


def as_json(done: Sequence[Done]) -> dict[str, Any]:
    """As JSON can hold it."""
    counts = Counter(one.ending for one in done)
    return {
        "counts": {ending: counts[ending] for ending in ENDINGS},
        "jobs": [
            {
                "number": one.job.number,
                "outputs": one.job.outputs,
                "ended": one.ending,
                "attempts": one.attempts,
                "seconds": round(one.seconds, 3),
                "message": one.message,
                "log": log_of(one.job.name),
                "result": one.result,
            }
            for one in worst_first(done)
        ],
    }


def junit(done: Sequence[Done]) -> str:
    """JUnit XML, as GitLab, Jenkins and GitHub's actions read it: a test case for each job."""
    wrong = sum(one.ending == "wrong" for one in done)
    failed = sum(not one.is_good for one in done) - wrong
    totals = {
        "tests": str(len(done)),
        "failures": str(failed),
        "errors": str(wrong),
        "time": f"{sum(one.seconds for one in done):.3f}",
    }
    suites = ElementTree.Element("testsuites", totals)
    suite = ElementTree.SubElement(suites, "testsuite", {"name": "ar-batch"} | totals)
    for one in worst_first(done):
        name = {"classname": "ar-batch", "name": _xml(one.job.name), "time": f"{one.seconds:.3f}"}
        case = ElementTree.SubElement(suite, "testcase", name)
        if not one.is_good:
            kind = "error" if one.ending == "wrong" else "failure"
            told = {"message": _xml(one.message), "type": WORDS[one.ending]}
            ElementTree.SubElement(case, kind, told).text = _xml(one.message)
    ElementTree.indent(suites)
    return ElementTree.tostring(suites, "unicode", xml_declaration=True) + "\n"


def page(done: Sequence[Done], folder: Path, title: str) -> str:
    """HTML, with links to outputs, logs and reports from a folder."""
    rows = []
    for one in worst_first(done):
        verdict = verdict_of(one)
        named = (("log", log_of(one.job.name)), ("report", one.job.outputs.get("report", "")))
        links = [_link(folder, file, text) for text, file in named if is_url(file) or os.path.exists(file)]
        name = _link(folder, one.job.name, one.job.name) if one.has_output else _html(one.job.name)
        said = "; ".join([*filter(None, [one.message]), *_warnings(one)])
        rows.append(
            f'<tr><td class="name">{name}'
            f'<td class="{one.ending}">{WORDS[one.ending]}<td class="{_html(verdict)}">{_html(verdict)}'
            f'<td class="number">{one.attempts}<td class="number">{one.seconds:.1f}<td>{_html(_states(one))}'
            f'<td class="said">{_html(said)}<td>{" ".join(links)}'
        )
    return _PAGE.format(title=_html(title), words=_html(in_words(done)), rows="\n".join(rows))


def write(done: Sequence[Done], folder: Path, title: str) -> None:
    """Writes summary.json, junit.xml and summary.html to a folder.

    Raises:
        InputError, RunError: one of them cannot be written.
    """
    write_whole(folder / "summary.json", (json.dumps(as_json(done), indent=2) + "\n").encode())
    write_whole(folder / "junit.xml", junit(done).encode())
    write_whole(folder / "summary.html", page(done, folder, title).encode())


def _states(done: Done) -> str:
    states = done.result.get("states", {})
    return ", ".join(f"{count} {state}" for state, count in states.items() if count)


def _share_tracked(done: Done) -> float:
    states = done.result.get("states", {})
    return states.get("tracked", 0) / max(sum(states.values()), 1)


def _warnings(done: Done) -> list[str]:
    return [str(warning) for warning in done.result.get("warnings", [])]


def _html(text: str) -> str:
    return html.escape(text)


def _xml(text: str) -> str:
    return _NOT_XML.sub("?", text)


def _link(folder: Path, target: str, text: str) -> str:
    address = target if is_url(target) else quote(os.path.relpath(target, folder))
    return f'<a href="{html.escape(address)}">{_html(text)}</a>'
