"""What the wheel carries is what the sources make."""

import os
import subprocess

import pytest

from .npm import STATIC, WEB, installed

pytestmark = pytest.mark.skipif(not installed(), reason="npm is not here, or cannot install the page's packages")


def test_the_static_files_are_what_the_sources_make(tmp_path):
    subprocess.run(["node", "build.mjs", str(tmp_path / "static")], cwd=WEB, check=True)
    assert sorted(os.listdir(tmp_path / "static")) == sorted(os.listdir(STATIC))
    for file in STATIC.iterdir():
        assert (tmp_path / "static" / file.name).read_bytes() == file.read_bytes(), f"{file.name}: run npm run build"


def test_the_types_of_the_sources_agree():
    done = subprocess.run(["npm", "run", "--silent", "check"], cwd=WEB, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout
