"""Job files: what is in them, and what is refused with the path of what is wrong."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ar_demo.cli.jobs import SCHEMA, load_job, schema
from ar_demo.errors import InputError
from ar_demo.surface import Moment

QUAD = "0,0 90,0 90,90 0,90"


def write(folder: Path, **content: Any) -> Path:
    job = folder / "job.json"
    job.write_text(json.dumps({"version": 1, "surfaces": [{"quad": QUAD, "ad": "a.png"}]} | content))
    return job


def test_a_whole_job(tmp_path: Path) -> None:
    region = {"region": "0,0 99,0 50,99", "exclude": [QUAD, [[1, 2], [3, 4], [5, 1]]]}
    corrected = {"frame": "1s", "corners": QUAD}
    job = load_job(
        write(
            tmp_path,
            input="in.mp4",
            output="out/o.mp4",
            save_track="t.json",
            tracking={"end": "2s", "smooth": 2, "weights": "w.safetensors"},
            rendering={"audio": "mix", "crf": 20, "overwrite": True},
            surfaces=[
                {"ad": "a.png", "quad": QUAD, "blend": "screen", "keyframes": [corrected], "snap": True, **region}
            ],
        )
    )
    assert (job.input, job.output, job.save_track) == (tmp_path / "in.mp4", tmp_path / "out/o.mp4", tmp_path / "t.json")
    assert job.tracking_options() == {"end": Moment.parse("2s"), "smooth": 2, "weights": tmp_path / "w.safetensors"}
    assert job.output_options() == {"audio": "mix", "crf": 20, "overwrite": True}
    [surface] = job.surfaces_with({"lost": "hide"})
    assert (surface.ad, surface.blend, surface.lost) == (tmp_path / "a.png", "screen", "hide")
    assert surface.keyframes[0].at == Moment.parse("1s")
    np.testing.assert_array_equal(surface.quad, [[0, 0], [90, 0], [90, 90], [0, 90]])
    assert surface.snap
    np.testing.assert_array_equal(surface.region, [[0, 0], [99, 0], [50, 99]])
    np.testing.assert_array_equal(surface.exclude[1], [[1, 2], [3, 4], [5, 1]])


def test_files_that_are_not_named_are_none(tmp_path: Path) -> None:
    job = load_job(write(tmp_path))
    assert (job.input, job.output, job.save_track) == (None, None, None)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("no json", "not JSON"),
        ("[]", r"Expected `object`, got `array`"),
        ("{}", "missing required field `version`"),
        ('{"version": 1}', "missing required field `surfaces`"),
        ('{"version": 2, "surfaces": [{}]}', r"\$.version"),
        ('{"version": 1, "surfaces": []}', r"length >= 1.*\$.surfaces"),
        ('{"version": 1, "surfaces": [{"ad": "a.png"}]}', r"neither quad, find nor track.*\$.surfaces\[0\]"),
        ('{"version": 1, "surfaces": [{"quad": "1,2 3,4", "ad": "a.png"}]}', r"four corners.*\$.surfaces\[0\]"),
        ('{"version": 1, "surfaces": [{"quad": "Q", "sparkle": 1}]}', r"unknown field `sparkle`.*\$.surfaces\[0\]"),
        ('{"version": 1, "surfaces": [{"quad": "Q", "opacity": "much"}]}', r"float.*\$.surfaces\[0\].opacity"),
        ('{"version": 1, "surfaces": [{"quad": "Q", "opacity": 2}]}', r"<= 1.*\$.surfaces\[0\].opacity"),
        ('{"version": 1, "surfaces": [{"quad": "Q"}, {"quad": "Q", "fit": "squeeze"}]}', r"\$.surfaces\[1\].fit"),
        ('{"version": 1, "surfaces": [{"quad": "Q", "keyframes": [{"frame": 3}]}]}', r"keyframes\[0\]"),
        ('{"version": 1, "surfaces": [{"quad": "Q", "start": "soon"}]}', r"soon.*\$.surfaces\[0\]"),
        ('{"version": 1, "surfaces": [{"quad": "Q", "ad": "a.png", "effect": "blur"}]}', "ad does nothing"),
        ('{"version": 1, "surfaces": [{"quad": "Q", "region": "1,2 3,4"}]}', r"three corners.*\$.surfaces\[0\]"),
        ('{"version": 1, "surfaces": [{"quad": "Q", "exclude": ["0,0 9,9 9,0 0,9"]}]}', r"crosses.*\$.surfaces\[0\]"),
        ('{"version": 1, "surfaces": [{"track": "none.json"}]}', "none.json"),
        ('{"version": 1, "surfaces": [{"quad": "Q"}], "rendering": {"crf": 99}}', r"\$.rendering.crf"),
    ],
)
def test_refuses_what_is_no_job(tmp_path: Path, content: str, message: str) -> None:
    job = tmp_path / "job.json"
    job.write_text(content.replace("Q", QUAD))
    with pytest.raises(InputError, match=message) as caught:
        load_job(job).surfaces_with({})
    assert "\n" not in str(caught.value)


def test_a_file_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="cannot read job file"):
        load_job(tmp_path / "none.json")


def test_the_schema_that_ships_is_that_of_the_code() -> None:
    assert SCHEMA.read_text(encoding="utf-8") == schema(), "run python -m ar_demo.cli.jobs"
    assert json.loads(schema())["$defs"]["JobEntry"]["required"] == ["version", "surfaces"]
