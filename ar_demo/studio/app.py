"""The server's application: what the page asks for, by HTTP and over a WebSocket."""

import asyncio
import logging
import re
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import TypeVar, cast, get_args

import msgspec
from anyio.to_thread import run_sync
from starlette.applications import Starlette
from starlette.middleware import Middleware
from starlette.requests import Request
from starlette.responses import FileResponse, JSONResponse, Response
from starlette.routing import Route, WebSocketRoute
from starlette.websockets import WebSocket, WebSocketDisconnect

from ..errors import InputError, RunError
from .errors import Refusal
from .files import Kind
from .project import Project
from .security import Admission, Gate
from .state import Change, Corners
from .workspace import Workspace

log = logging.getLogger(__name__)

T = TypeVar("T")

STATIC = Path(__file__).with_name("static")
TYPES = {".js": "text/javascript", ".css": "text/css", ".svg": "image/svg+xml", ".html": "text/html; charset=utf-8"}
FOREVER = "private, max-age=31536000, immutable"
MOST_JSON_BYTES = 4 << 20
MOST_PX = 8192  # a height that is asked for


class Open(msgspec.Struct):
    """A video, or a job file, to open, by its id."""

    video: str | None = None
    job: str | None = None


class Marked(msgspec.Struct):
    """Corners in a frame."""

    frame: int
    corners: Corners


class Asked(msgspec.Struct):
    """A frame."""

    frame: int


class Pictured(msgspec.Struct):
    """A picture of a surface, by its file's id."""

    picture: str


class Wanted(msgspec.Struct):
    """A file to render, by its name, beside the job file."""

    name: str
    overwrite: bool = False


def application(workspace: Workspace, admission: Admission) -> Starlette:
    """The application that serves a workspace to whoever is admitted."""
    api = _Api(workspace)
    routes = [
        Route("/", api.index),
        Route("/static/{name}", api.static),
        Route("/api/files", api.files),
        Route("/api/files/{file}/picture", api.picture),
        Route("/api/uploads", api.upload, methods=["POST"]),
        Route("/api/projects", api.projects),
        Route("/api/projects", api.open, methods=["POST"]),
        Route("/api/projects/{project}", api.project),
        Route("/api/projects/{project}", api.change, methods=["PUT"]),
        Route("/api/projects/{project}/frames/{frame:int}", api.frame),
        Route("/api/projects/{project}/composite/{frame:int}", api.composite),
        Route("/api/projects/{project}/surfaces/{surface:int}/steady/{frame:int}", api.steady),
        Route("/api/projects/{project}/surfaces/{surface:int}/track", api.track),
        Route("/api/projects/{project}/snap", api.snap, methods=["POST"]),
        Route("/api/projects/{project}/proposals", api.proposals, methods=["POST"]),
        Route("/api/projects/{project}/find", api.begin_finding, methods=["POST"]),
        Route("/api/projects/{project}/track", api.begin_tracking, methods=["POST"]),
        Route("/api/projects/{project}/render", api.begin_rendering, methods=["POST"]),
        Route("/api/projects/{project}/stop", api.stop, methods=["POST"]),
        Route("/api/projects/{project}/outputs", api.outputs),
        Route("/api/outputs/{output}", api.output),
        WebSocketRoute("/api/projects/{project}/events", api.events),
    ]
    return Starlette(
        routes=routes,
        middleware=[Middleware(partial(Gate, admission=admission))],
        exception_handlers={Refusal: _refused, InputError: _refused, RunError: _refused, 404: _missing, 405: _missing},
    )


class _Api:
    """The answers."""

    def __init__(self, workspace: Workspace) -> None:
        self._workspace = workspace

    # ---- the page ----

    async def index(self, request: Request) -> Response:
        return await self._static("index.html")

    async def static(self, request: Request) -> Response:
        return await self._static(request.path_params["name"])

    async def _static(self, name: str) -> Response:
        file = STATIC / name
        if not re.fullmatch(r"[\w-]+(\.[\w-]+)+", name) or not file.is_file():
            raise Refusal(404, "there is no such file")
        media_type = TYPES.get(file.suffix, "application/octet-stream")
        return Response(await run_sync(file.read_bytes), media_type=media_type, headers={"cache-control": "no-cache"})

    # ---- files ----

    async def files(self, request: Request) -> Response:
        kind = request.query_params.get("kind", "video")
        if kind not in get_args(Kind):
            raise Refusal(400, f"kind is one of {', '.join(get_args(Kind))}", "kind")
        folder = request.query_params.get("folder")
        return JSONResponse(await run_sync(self._workspace.files.listing, cast(Kind, kind), folder))

    async def picture(self, request: Request) -> Response:
        data = await run_sync(self._workspace.picture, request.path_params["file"], _height(request))
        return Response(data, media_type="image/webp", headers={"cache-control": FOREVER})

    async def upload(self, request: Request) -> Response:
        length = request.headers.get("content-length", "")
        name = request.query_params.get("name", "")
        taken = await self._workspace.take(name, int(length) if length.isdecimal() else None, request.stream())
        return JSONResponse(taken, 201)

    # ---- projects ----

    async def projects(self, request: Request) -> Response:
        return JSONResponse(
            [{"id": p.id, "name": p.name, "video": p.video.name} for p in self._workspace.projects.values()]
        )

    async def open(self, request: Request) -> Response:
        asked = await _body(request, Open)
        id = asked.video or asked.job
        if id is None:
            raise Refusal(400, "name a video, or a job file")
        path = self._workspace.files.path(id)
        project = await run_sync(self._workspace.open, path)
        return JSONResponse(await run_sync(lambda: project.content), 201)

    async def project(self, request: Request) -> Response:
        project = self._project(request)
        return JSONResponse(await run_sync(lambda: project.content))

    async def change(self, request: Request) -> Response:
        project, change = self._project(request), await _body(request, Change)
        await run_sync(project.change, change)
        return JSONResponse(await run_sync(lambda: project.content))

    async def frame(self, request: Request) -> Response:
        """A frame; with `near` the nearest that is had in a moment, with `rough` one that costs little."""
        project, index = self._project(request), int(request.path_params["frame"])
        frames, height, query = project.frames, _height(request), request.query_params
        data: bytes | None
        if "rough" in query:
            shown, data = await run_sync(frames.rough, index, height)
        elif (near := query.get("near")) is not None:
            known = int(near) if near.isdecimal() else None
            shown, data = await run_sync(frames.near, index, height, known)
        else:
            shown, data = index, await run_sync(frames.picture, index, height)
        times = project.session.reader.times
        headers = {
            "cache-control": FOREVER if shown == index else "no-store",
            "x-frame": str(shown),
            "x-time": f"{float(times[shown] - times[0]):.6f}",
        }
        return Response(data, 202 if data is None else 200, media_type="image/jpeg", headers=headers)

    async def composite(self, request: Request) -> Response:
        project, index = self._project(request), int(request.path_params["frame"])
        data, revision = await run_sync(project.composite, index, _height(request))
        lasts = request.query_params.get("revision") == str(revision)
        headers = {
            "cache-control": FOREVER if lasts else "no-store",
            "x-frame": str(index),
            "x-revision": str(revision),
        }
        return Response(data, media_type="image/jpeg", headers=headers)

    async def steady(self, request: Request) -> Response:
        project, params = self._project(request), request.path_params
        data = await run_sync(project.steady, int(params["surface"]), int(params["frame"]), _height(request))
        return Response(data, media_type="image/jpeg", headers={"x-frame": str(params["frame"])})

    async def track(self, request: Request) -> Response:
        project = self._project(request)
        return JSONResponse(await run_sync(project.track_content, int(request.path_params["surface"])))

    async def snap(self, request: Request) -> Response:
        project, asked = self._project(request), await _body(request, Marked)
        return JSONResponse(await run_sync(project.snapped, asked.frame, asked.corners))

    async def proposals(self, request: Request) -> Response:
        project, asked = self._project(request), await _body(request, Asked)
        return JSONResponse(await run_sync(project.proposals, asked.frame))

    async def begin_finding(self, request: Request) -> Response:
        project, asked = self._project(request), await _body(request, Pictured)
        task = await run_sync(project.begin_finding, asked.picture)
        return JSONResponse(task.content, 202)

    async def begin_tracking(self, request: Request) -> Response:
        task = await run_sync(self._project(request).begin_tracking)
        return JSONResponse(task.content, 202)

    async def begin_rendering(self, request: Request) -> Response:
        project, wanted = self._project(request), await _body(request, Wanted)
        task = await run_sync(project.begin_rendering, wanted.name, wanted.overwrite)
        return JSONResponse(task.content, 202)

    async def stop(self, request: Request) -> Response:
        task = await run_sync(self._project(request).tasks.stop)
        return JSONResponse(task.content, 202)

    async def outputs(self, request: Request) -> Response:
        outputs = self._project(request).outputs.items()
        return JSONResponse([{"id": i, "name": p.name, "bytes": p.stat().st_size} for i, p in outputs if p.is_file()])

    async def output(self, request: Request) -> Response:
        path = self._workspace.output(request.path_params["output"])
        return FileResponse(path, filename=path.name)

    async def events(self, socket: WebSocket) -> None:
        """Sends what happens until the page goes; what it sends is not listened to."""
        try:
            project = self._workspace.project(socket.path_params["project"])
            queue = project.events.listen()
        except Refusal:
            await socket.close()
            return
        await socket.accept()
        gone = asyncio.ensure_future(_gone(socket))
        try:
            if project.tasks.last is not None:
                await socket.send_json({"type": "task", **project.tasks.last.content})
            while not gone.done():
                event = asyncio.ensure_future(queue.get())
                await asyncio.wait({event, gone}, return_when=asyncio.FIRST_COMPLETED)
                if event.done():
                    await socket.send_json(event.result())
                else:
                    event.cancel()
        except WebSocketDisconnect:
            pass
        finally:
            gone.cancel()
            project.events.leave(queue)

    def _project(self, request: Request) -> Project:
        return self._workspace.project(request.path_params["project"])


async def _gone(socket: WebSocket) -> None:
    with suppress(WebSocketDisconnect, RuntimeError):
        while True:
            await socket.receive_text()


async def _body(request: Request, kind: type[T]) -> T:
    """What a request says, as JSON.

    Raises:
        Refusal: it is too long, or not as it must be.
    """
    data = bytearray()
    async for chunk in request.stream():
        data += chunk
        if len(data) > MOST_JSON_BYTES:
            raise Refusal(413, "this is too much at once")
    try:
        return msgspec.json.decode(data, type=kind)
    except msgspec.DecodeError as error:
        message, _, where = str(error).partition(" - at `")
        field = re.sub(r"\[(\d+)\]", r".\1", where.rstrip("`").removeprefix("$").removeprefix(".")) or None
        raise Refusal(422, message[:1].lower() + message[1:], field) from error


def _height(request: Request) -> int | None:
    """The height that is asked for, px."""
    text = request.query_params.get("height")
    if text is None:
        return None
    if not text.isdecimal() or not 1 <= int(text) <= MOST_PX:
        raise Refusal(400, f"height is a whole number from 1 to {MOST_PX}", "height")
    return int(text)


async def _refused(request: Request, error: Exception) -> Response:
    if isinstance(error, Refusal):
        return JSONResponse(error.content, error.status)
    return JSONResponse({"error": str(error)}, 422 if isinstance(error, InputError) else 500)


async def _missing(request: Request, error: Exception) -> Response:
    return JSONResponse({"error": "there is no such thing here"}, getattr(error, "status_code", 404))
