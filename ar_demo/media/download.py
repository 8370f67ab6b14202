"""Videos from the web: fetched once, to a temporary file, since they are read several times and in any order."""

from __future__ import annotations

import http.client
import logging
import re
import shutil
import tempfile
import urllib.error
import urllib.request
from pathlib import Path
from typing import ClassVar, TypeGuard
from urllib.parse import unquote, urlsplit
from weakref import WeakValueDictionary

from ..errors import InputError, RunError

log = logging.getLogger(__name__)

TIMEOUT_SECONDS = 30.0  # without an answer, after which a server counts as gone
_BLOCK_BYTES = 1 << 20
_RESERVE_BYTES = 1 << 28  # that others are left on the disk
# Kinds of answers that are no video file, and what they are.
_OTHERS = {
    "text/html": "a web page: give the address of the video file itself",
    "mpegurl": "a playlist: give --live, or fetch the video with a downloader first",
    "dash+xml": "a playlist: give --live, or fetch the video with a downloader first",
    "multipart/": "a live stream: give --live, or record it to a file first",
}


def is_url(source: object) -> TypeGuard[str]:
    """Whether an input is an address and no file's name."""
    return isinstance(source, str) and re.match(r"[A-Za-z][A-Za-z0-9+.-]*://", source) is not None


def local_name(url: str) -> str:
    """The name of the file at an address, as it may be called here."""
    name = re.sub(r"[^\w. -]", "_", unquote(urlsplit(url).path).rpartition("/")[2]).strip(" .")
    return name[-100:] or "video"


class Download:
    """A file from the web, which stays as long as somebody holds this.

    Attributes:
        path: the temporary file.
    """

    _held: ClassVar[WeakValueDictionary[str, Download]] = WeakValueDictionary()

    @classmethod
    def of(cls, url: str) -> Download:
        """The file at an address, fetched now where nobody holds it.

        Raises:
            InputError: it cannot be fetched, or is no file.
            RunError: it breaks off, or there is no room for it.
        """
        held = cls._held.get(url)
        if held is None:
            held = cls._held[url] = Download(url)
        return held

    def __init__(self, url: str) -> None:
        if urlsplit(url).scheme.lower() not in ("http", "https"):
            raise InputError(f"{url} is a stream: give --live, or record it to a file first")
        self._folder = tempfile.TemporaryDirectory(prefix="ar-replace-")
        self.path = Path(self._folder.name) / local_name(url)
        try:
            self._fetch(url)
        except BaseException:
            self._folder.cleanup()
            raise

    def _fetch(self, url: str) -> None:
        request = urllib.request.Request(url, headers={"User-Agent": "ar-replace"})
        try:
            with urllib.request.urlopen(request, timeout=TIMEOUT_SECONDS) as answer:
                kind = answer.headers.get_content_type()
                for name, what in _OTHERS.items():
                    if name in kind:
                        raise InputError(f"{url} is {what}")
                expected = int(answer.headers.get("Content-Length") or 0)
                if expected > shutil.disk_usage(self._folder.name).free:
                    raise RunError(f"{url} has {expected >> 20} MB, and there is no room for it in {self._folder.name}")
                log.info("fetching %s%s", url, f", {expected / 1e6:.1f} MB" if expected else "")
                with self.path.open("wb") as file:
                    while block := answer.read(_BLOCK_BYTES):
                        file.write(block)
                        if shutil.disk_usage(self._folder.name).free < _RESERVE_BYTES:
                            raise RunError(f"{url} has no end, or there is no room for it in {self._folder.name}")
                    fetched = file.tell()
        except urllib.error.HTTPError as error:
            raise InputError(f"cannot fetch {url} ({error.code} {error.reason}): check the address") from error
        except (urllib.error.URLError, http.client.InvalidURL, ValueError) as error:
            reason = getattr(error, "reason", error)
            raise InputError(f"cannot fetch {url} ({reason}): check the address and the network") from error
        except (OSError, http.client.HTTPException) as error:
            raise RunError(f"fetching {url} failed ({str(error) or type(error).__name__}): try again") from error
        if fetched < expected:
            raise RunError(f"fetching {url} broke off after {fetched} of {expected} bytes: try again")
