"""Manual pages of the commands, made as the wheel is built: share/man/man1/ar-replace.1 and so on."""

import sys
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from argparse_manpage.manpage import Manpage
from hatchling.builders.hooks.plugin.interface import BuildHookInterface


def page(name: str) -> str:
    """The manual page of a command, in roff.

    Raises:
        KeyError: no such command.
    """
    from ar_demo.cli.parsers import PARSERS

    parser = PARSERS[name]()
    data = {"project_name": "ar-replace", "manual_title": "ar-replace", "description": parser.description}
    return str(Manpage(parser, data, format="single-commands-section"))


class ManualPages(BuildHookInterface[Any]):
    """Puts the pages into the wheel; an editable installation has none."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        if version == "editable":
            return
        sys.path.insert(0, self.root)
        from ar_demo.cli.parsers import PARSERS

        self._folder = TemporaryDirectory()
        for name in PARSERS:
            file = Path(self._folder.name) / f"{name}.1"
            file.write_text(page(name), encoding="utf-8")
            build_data["shared_data"][str(file)] = f"share/man/man1/{file.name}"

    def finalize(self, version: str, build_data: dict[str, Any], artifact_path: str) -> None:
        if version != "editable":
            self._folder.cleanup()
