"""What `ar-studio` does: serves the page on this machine, until Ctrl-C."""

import logging
import socket
import webbrowser
from argparse import Namespace
from contextlib import suppress
from pathlib import Path
from threading import Timer

from ..cli.applicability import flag
from ..cli.commands import reading_limits
from ..cli.defaults import load_defaults
from ..cli.reporting import set_up_logging
from ..errors import InputError
from ..media.limits import limited

log = logging.getLogger(__name__)

MISSING = "ar-studio takes Starlette and uvicorn: pip install 'ar-replace[studio]'"
HOST = "127.0.0.1"
TO_OPEN_SECONDS = 0.3  # from the server's start to the browser's


def studio_command(given: Namespace) -> int:
    """ar-studio, by what is given on its command line."""
    set_up_logging("quiet" in given)
    video = Path(given.video) if "video" in given else None
    ad = Path(given.ad) if "ad" in given else None
    with limited(*reading_limits(given)):
        serve(video, ad, getattr(given, "root", None), getattr(given, "port", 0), "no_browser" not in given)
    return 0


def pick_command(given: Namespace) -> int:
    """ar-replace --pick, by what is given on its command line."""
    set_up_logging("quiet" in given)
    if others := sorted(vars(given).keys() - {"input", "ad", "pick", "quiet"}):
        raise InputError(
            f"{flag(others[0])} does nothing beside --pick, which lets you choose on its page: leave it out"
        )
    if "input" not in given:
        raise InputError("name the video: ar-replace VIDEO AD --pick")
    serve(Path(given.input), Path(given.ad) if "ad" in given else None, None, 0, opens_browser=True)
    return 0


def serve(video: Path | None, ad: Path | None, root: Path | None, port: int, opens_browser: bool) -> None:
    """Serves Studio until it is interrupted.

    Args:
        video: a video, or a job file, to begin with.
        root: the folder whose files may be opened; None for the current one where there is no video, else none.
        port: 0 for a free one.

    Raises:
        InputError: a file that cannot be read, a port that is taken.
    """
    try:
        import uvicorn

        from .app import application
        from .security import Admission
        from .workspace import Workspace
    except ModuleNotFoundError as error:
        if error.name not in ("starlette", "uvicorn", "anyio", "websockets"):
            raise
        raise InputError(MISSING) from error
    if root is not None and not root.is_dir():
        raise InputError(f"{root} is not a folder: name one with --root")
    if ad is not None and not ad.is_file():
        raise InputError(f"{ad} does not exist or is not a file: check the ad's file name")
    if root is None and video is None:
        root = Path.cwd()
    workspace = Workspace(root or (video or Path()).parent, root, load_defaults())
    listening = _socket(port)
    try:
        if video is not None:
            workspace.open(video, ad)
        port = listening.getsockname()[1]

        def tell() -> None:
            if admission.token is not None:
                print(f"{first} http://{HOST}:{port}/?token={admission.token}", flush=True)

        admission = Admission(tell)
        first = "Studio is at"
        tell()
        first = "in another browser:"
        if opens_browser:
            address = f"http://{HOST}:{port}/?token={admission.token}"
            Timer(TO_OPEN_SECONDS, webbrowser.open, [address]).start()
        config = uvicorn.Config(
            application(workspace, admission),
            log_config=None,
            access_log=False,
            server_header=False,
            ws_max_size=1 << 16,
        )
        with suppress(KeyboardInterrupt):  # the usual way to end it
            uvicorn.Server(config).run([listening])
    finally:
        listening.close()
        workspace.close()


def _socket(port: int) -> socket.socket:
    listening = socket.socket()
    listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listening.bind((HOST, port))
        listening.listen()  # before the address is told: who comes early waits
    except (OSError, OverflowError) as error:
        listening.close()
        raise InputError(f"port {port} cannot be had: name another with --port, or leave it out") from error
    return listening
