"""The interface of the page: addresses, what they take and what they answer."""

from __future__ import annotations

import mimetypes
import re
from base64 import b64encode
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from importlib import metadata, resources
from pathlib import Path, PurePosixPath
from typing import Annotated, Any, Literal

import numpy as np
import numpy.typing as npt
from fastapi import FastAPI, Query, Request, Response
from fastapi import Path as InPath
from fastapi.exceptions import RequestValidationError
from fastapi.responses import JSONResponse
from pydantic import ValidationError
from starlette.datastructures import UploadFile
from starlette.exceptions import HTTPException
from starlette.formparsers import MultiPartException

from stereopsis.colormaps import CIVIDIS, DIVERGING, FLAG_COLOURS, VIRIDIS
from stereopsis.settings import DEFAULT_PRESET, PRESETS
from stereopsis.types import Flag
from stereopsis.view import answers, choice
from stereopsis.view.guard import Guard
from stereopsis.view.limits import Limits
from stereopsis.view.pool import BusyError, FailedError, RefusedError, ReplacedError
from stereopsis.view.session import GoneError, Opened, Session
from stereopsis.view.sources import Files, Street
from stereopsis.view.targets import Entry, Target

COLORMAPS = {"viridis": VIRIDIS, "cividis": CIVIDIS, "diverging": DIVERGING}
FOREVER = {"cache-control": "private, max-age=31536000, immutable"}
PARTS = ("left", "right", "truth", "calibration", "disparity")
TYPES = {".js": "text/javascript", ".mjs": "text/javascript", ".wasm": "application/wasm"}

STATUS: dict[type[Exception], int] = {
    GoneError: 404,
    ReplacedError: 409,
    RefusedError: 422,
    ValueError: 422,
    TypeError: 422,
    OverflowError: 422,
    RecursionError: 422,
    FailedError: 500,
    BusyError: 503,
}
PROBLEMS: dict[int | str, dict[str, Any]] = {
    status: {"model": answers.Problem} for status in (400, 403, 404, 413, 422, 500, 503)
}
Key = Annotated[str, InPath(max_length=64)]


def create_app(
    target: Target,
    *,
    limits: Limits | None = None,
    hosts: frozenset[str] = frozenset({"127.0.0.1", "localhost", "::1"}),
    token: str | None = None,
) -> FastAPI:
    """The application that serves one target.

    Parameters
    ----------
    target : Target
    limits : Limits, optional
    hosts : frozenset of str
        What a Host header may name.
    token : str, optional
        What a request has to carry.

    Returns
    -------
    FastAPI
        Its ``state.session`` is to be closed by who does not run its lifespan.
    """
    bounds = limits or Limits()
    session = Session(target, bounds)

    @asynccontextmanager
    async def lifespan(app: FastAPI) -> AsyncIterator[None]:
        session.prepare()
        try:
            yield
        finally:
            session.close()

    app = FastAPI(
        title="stereopsis view",
        version=_version(),
        lifespan=lifespan,
        docs_url=None,
        redoc_url=None,
        responses=PROBLEMS,
    )
    app.state.session = session
    _add_page(app)
    _add_target(app, session)
    _add_scenes(app, session)
    _add_results(app, session)
    _add_errors(app)
    app.add_middleware(Guard, hosts=hosts, token=token, upload=bounds.upload_bytes)
    return app


def _add_page(app: FastAPI) -> None:
    folder = Path(str(resources.files("stereopsis.view") / "static"))

    def send(name: str, request: Request) -> Response:
        # Looked up in what lies there, never joined: no name leads out of the folder.
        file = _static(folder).get(name)
        if file is None:
            raise GoneError("there is no such page")
        stat = file.stat()
        tag = f'"{stat.st_mtime_ns:x}-{stat.st_size:x}"'
        headers = {"etag": tag, "cache-control": "no-cache"}
        if request.headers.get("if-none-match") == tag:
            return Response(status_code=304, headers=headers)
        suffix = PurePosixPath(name).suffix
        kind = TYPES.get(suffix) or mimetypes.guess_type(name)[0] or "application/octet-stream"
        return Response(file.read_bytes(), media_type=kind, headers=headers)

    @app.get("/", include_in_schema=False)
    def page(request: Request) -> Response:
        return send("index.html", request)

    @app.get("/static/{name:path}", include_in_schema=False)
    def static(name: str, request: Request) -> Response:
        return send(name, request)


def _static(folder: Path) -> dict[str, Path]:
    return {
        file.relative_to(folder).as_posix(): file
        for file in folder.rglob("*")
        if file.is_file() and not file.is_symlink()
    }


def _add_target(app: FastAPI, session: Session) -> None:
    target, limits = session.target, session.limits

    @app.get("/api/info")
    async def info() -> answers.Info:
        """What is looked at, and what can be chosen."""
        return answers.Info(
            version=_version(),
            title=target.title,
            kind=target.kind,
            presets=list(PRESETS),
            costs=[answers.Cost(**cost) for cost in choice.defaults()],
            optimizers=[answers.Solver(**solver) for solver in choice.solvers()],
            colormaps={name: b64encode(table.tobytes()).decode() for name, table in COLORMAPS.items()},
            flags=[_flag(flag) for flag in Flag],
            limits=answers.Limits(
                upload_bytes=limits.upload_bytes, pixels=limits.pixels, disparities=limits.disparities
            ),
            defaults={"preset": DEFAULT_PRESET, **target.settings},
        )

    @app.get("/api/samples")
    async def samples() -> answers.Samples:
        """Everything that can be opened, in order."""
        listed = [
            answers.Sample(name=entry.name, has_truth=_has_truth(entry), values=dict(entry.values))
            for entry in target.entries
        ]
        return answers.Samples(samples=listed, columns=list(target.columns))


def _version() -> str:
    try:
        return metadata.version("stereopsis")
    except metadata.PackageNotFoundError:  # run from where it lies, without having been installed
        return "unknown"


def _flag(flag: Flag) -> answers.FlagBit:
    name = str(flag.name).lower().replace("_", " ")
    return answers.FlagBit(bit=int(flag), name=name, colour=list(FLAG_COLOURS[flag]))


def _has_truth(entry: Entry) -> bool:
    match entry.source:
        case Street():
            return True
        case Files(truth=truth):
            return truth is not None


def _add_scenes(app: FastAPI, session: Session) -> None:
    binary: dict[str, Any] = {"type": "string", "format": "binary"}
    form = {"type": "object", "properties": dict.fromkeys(PARTS, binary), "required": ["left"]}
    body = {
        "required": True,
        "content": {
            "application/json": {"schema": answers.Open.model_json_schema()},
            "multipart/form-data": {"schema": form},
        },
    }

    @app.post("/api/open", openapi_extra={"requestBody": body})
    async def open_(request: Request) -> answers.Scene:
        """Open a sample of the target, or files that are sent."""
        if request.headers.get("content-type", "").startswith("multipart/form-data"):
            opened = await _open_sent(session, request)
        else:
            asked = answers.Open.model_validate_json(await request.body())
            opened = await session.open_sample(asked.sample)
        return await _described(session, opened)

    @app.get("/api/scenes/{key}/{side}.png", response_class=Response, responses={200: _of("image/png")})
    async def picture(key: Key, side: Literal["left", "right"]) -> Response:
        """An image, in 8 bits, to be looked at."""
        return Response(await session.picture(key, side), media_type="image/png", headers=FOREVER)

    @app.get(
        "/api/scenes/{key}/{side}.bin",
        response_class=Response,
        responses={200: _of("application/octet-stream")},
    )
    async def values(key: Key, side: Literal["left", "right", "truth"]) -> Response:
        """The values of an image, or the truth: float32, NaN where unknown."""
        array = getattr(session.scene(key).scene, side)
        if array is None:
            raise GoneError(f"this scene has no {side}")
        return _raw(array)


def _of(kind: str) -> dict[str, Any]:
    return {"content": {kind: {"schema": {"type": "string", "format": "binary"}}}}


def _raw(array: npt.NDArray[Any]) -> Response:
    data = np.ascontiguousarray(array).data.cast("B")
    return Response(data, media_type="application/octet-stream", headers=FOREVER)


async def _open_sent(session: Session, request: Request) -> Opened:
    async with request.form(max_files=len(PARTS), max_fields=0) as form:
        with session.scratch() as folder:
            files: dict[str, Any] = {}
            names: dict[str, str] = {}
            for part, sent in form.multi_items():
                if part not in PARTS or not isinstance(sent, UploadFile) or part in files:
                    raise RefusedError(
                        f"the files may be called {', '.join(PARTS)}, each once, not {part[:40]!r}"
                    )
                # What the other side calls its file is shown, never used.
                files[part] = Path(folder, part)
                names[part] = _plain_name(sent.filename or part)
                with files[part].open("wb") as file:
                    while chunk := await sent.read(2**20):
                        file.write(chunk)
            if "left" not in files and "disparity" not in files:
                raise RefusedError("there is neither a left image nor a disparity map among the files")
            return await session.open_files(Files(**files), names)


def _plain_name(name: str) -> str:
    """The last part of a name, without what a terminal or a page could take amiss."""
    last = re.split(r"[/\\]", name)[-1]
    return re.sub(r"[^\w.() +-]", "_", last)[:100].lstrip("-") or "image"


async def _described(session: Session, opened: Opened) -> answers.Scene:
    scene, camera = opened.scene, opened.calibration
    height, width = scene.shape
    seen = scene.left if scene.left is not None else np.empty((0, 0), np.uint8)
    given = await session.opened_map(opened)
    return answers.Scene(
        scene=opened.key,
        name=opened.name,
        width=width,
        height=height,
        channels=1 if seen.ndim == 2 else 3,
        bits=8 * seen.dtype.itemsize,
        dtype=seen.dtype.name,
        has_left=scene.left is not None,
        has_right=scene.right is not None,
        has_truth=scene.truth is not None,
        calibration=answers.Calibration(
            focal_length=camera.focal,
            baseline=camera.baseline,
            doffs=camera.doffs,
            cx=camera.cx,
            cy=camera.cy,
            stated=scene.calibration is not None,
        ),
        disparities=list(scene.disparities),
        settings=None if opened.settings is None else dict(opened.settings),
        result=None if given is None else answers.Result(**given),
    )


def _add_results(app: FastAPI, session: Session) -> None:
    @app.post("/api/match", responses={409: {"model": answers.Problem}})
    async def match(asked: answers.Match, request: Request) -> answers.Result:
        """Match a scene. A newer request of the same client ends an older one, which answers 409."""
        found = await session.match(asked.scene, asked.client, asked.settings, request.is_disconnected)
        return answers.Result(**found)

    @app.get(
        "/api/results/{key}/{name}.bin",
        response_class=Response,
        responses={200: _of("application/octet-stream")},
    )
    async def array(key: Key, name: Literal["disparity", "confidence", "error", "flags"]) -> Response:
        """A result's array: float32, of flags uint8."""
        return _raw(session.array(key, name))

    @app.get("/api/results/{key}/cost")
    async def cost(
        key: Key, x: Annotated[int, Query(ge=0, lt=2**24)], y: Annotated[int, Query(ge=0, lt=2**24)]
    ) -> answers.Curve:
        """What every candidate costs at a pixel."""
        return answers.Curve(**await session.curve(key, x, y))

    kinds = {
        "disparity.png": "image/png",
        "disparity.pfm": "application/octet-stream",
        "preview.png": "image/png",
        "depth.png": "image/png",
        "points.ply": "application/octet-stream",
        "settings.toml": "text/plain; charset=utf-8",
    }
    content = {kind.partition(";")[0]: {"schema": {"type": "string"}} for kind in kinds.values()}

    @app.get(
        "/api/results/{key}/download/{name}",
        response_class=Response,
        responses={200: {"content": content}},
    )
    async def download(
        key: Key,
        name: Literal[
            "disparity.png", "disparity.pfm", "preview.png", "depth.png", "points.ply", "settings.toml"
        ],
    ) -> Response:
        """A result as a file."""
        data = await session.download(key, name)
        headers = {"content-disposition": f'attachment; filename="{name}"'}
        return Response(data, media_type=kinds[name], headers=headers)


def _add_errors(app: FastAPI) -> None:
    def problem(status: int, error: str, headers: Any = None) -> JSONResponse:
        return JSONResponse({"error": error}, status, headers)

    def known(request: Request, error: Exception) -> JSONResponse:
        status = next(of for kind, of in STATUS.items() if isinstance(error, kind))
        return problem(status, " ".join(str(error).split())[:1000] or "this cannot be done")

    for kind in STATUS:
        app.add_exception_handler(kind, known)

    @app.exception_handler(HTTPException)
    async def http(request: Request, error: HTTPException) -> JSONResponse:
        known = {404: "there is no such address", 405: "this address does not take that method"}
        return problem(error.status_code, known.get(error.status_code, str(error.detail)), error.headers)

    @app.exception_handler(MultiPartException)
    async def form(request: Request, error: MultiPartException) -> JSONResponse:
        return problem(400, str(error.message))

    @app.exception_handler(RequestValidationError)
    @app.exception_handler(ValidationError)
    async def invalid(request: Request, error: RequestValidationError | ValidationError) -> JSONResponse:
        first = error.errors()[0]
        where = ".".join(str(part) for part in first["loc"]) or "the request"
        return problem(422, f"{where}: {first['msg']}"[:1000])

    @app.exception_handler(Exception)
    async def fault(request: Request, error: Exception) -> JSONResponse:
        return problem(500, f"the program met a fault of its own: {type(error).__name__}")
