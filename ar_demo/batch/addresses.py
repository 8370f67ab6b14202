"""Files at addresses (s3://, gs://, https:// and what else fsspec knows): what they are, read and written whole."""

import secrets
from typing import Any

import fsspec

from ..errors import InputError, RunError

# Whose writing gives a name its content when it is complete; elsewhere that takes another name first.
_WHOLE = {"s3", "s3a", "gs", "gcs", "abfs", "abfss", "az", "adl", "memory"}
_TELLING = ("ETag", "etag", "LastModified", "Last-Modified", "mtime", "md5Hash", "created")  # what changes with a file
_SILENT_SECONDS = 60.0  # of a web server, after which it counts as gone


def open_address(url: str) -> tuple[Any, str]:
    """The file system of an address, and its path there.

    Raises:
        InputError: there is no such kind, or its package is not installed.
    """
    try:
        return fsspec.url_to_fs(url, **_options(url))
    except (ImportError, ValueError) as error:
        raise InputError(f"cannot reach {url} ({' '.join(str(error).split())})") from error


def facts(url: str) -> str:
    """What changes when the file at an address is written anew; '' where there is none.

    Raises:
        RunError: its place cannot be reached.
    """
    system, path = open_address(url)
    try:
        found = system.info(path)
    except Exception as error:  # of whichever library it takes
        if _is_missing(error):
            return ""
        raise RunError(f"cannot reach {url} ({_reason(error)})") from error
    return " ".join(str(found[name]) for name in ("size", *_TELLING) if found.get(name) is not None) or "there"


def size(url: str) -> int | None:
    """Bytes of the file at an address; None where that is not told.

    Raises:
        InputError: there is none.
        RunError: its place cannot be reached.
    """
    system, path = open_address(url)
    try:
        told = system.info(path).get("size")
    except Exception as error:
        if _is_missing(error):
            raise InputError(f"there is no {url}: check the address") from error
        raise RunError(f"cannot reach {url} ({_reason(error)})") from error
    return None if told is None else int(told)


def download(url: str, to: str, limit: int) -> None:
    """Fetches the file at an address into one that there is.

    Raises:
        InputError: there is none, or it has more bytes than the limit.
        RunError: it breaks off, or cannot be written.
    """
    system, path = open_address(url)
    try:
        with system.open(path, "rb") as source, open(to, "r+b") as file:
            while block := source.read(1 << 20):
                if file.tell() + len(block) > limit:
                    raise InputError(f"{url} is larger than the cache may be: see --cache-size")
                file.write(block)
            file.truncate()
    except InputError:
        raise
    except Exception as error:
        if _is_missing(error):
            raise InputError(f"there is no {url}: check the address") from error
        raise RunError(f"fetching {url} failed ({_reason(error)})") from error


def upload(file: str, url: str) -> None:
    """Puts a file at an address, whole or not at all.

    Raises:
        RunError: it cannot be.
    """
    system, path = open_address(url)
    is_whole = bool(_WHOLE & {*([system.protocol] if isinstance(system.protocol, str) else system.protocol)})
    part = path if is_whole else f"{path}.{secrets.token_hex(4)}.part"
    try:
        parent = system._parent(path)
        if parent:
            system.makedirs(parent, exist_ok=True)
        system.put_file(file, part)
        if part != path:
            system.mv(part, path)
    except Exception as error:
        raise RunError(f"writing {url} failed ({_reason(error)})") from error


def _options(url: str) -> dict[str, Any]:
    if not url.startswith(("http://", "https://")):
        return {}
    from aiohttp import ClientTimeout

    return {"client_kwargs": {"timeout": ClientTimeout(total=None, sock_read=_SILENT_SECONDS)}}


def _is_missing(error: Exception) -> bool:
    """Whether there is no such file; fsspec says so of web servers that cannot be reached, too."""
    cause = error.__cause__
    is_unreachable = isinstance(cause, (OSError, TimeoutError)) and not isinstance(cause, FileNotFoundError)
    return isinstance(error, FileNotFoundError) and not is_unreachable


def _reason(error: Exception) -> str:
    error = (
        error.__cause__ if isinstance(error, FileNotFoundError) and isinstance(error.__cause__, Exception) else error
    )
    return " ".join(str(error).split()) or type(error).__name__
