"""The application."""

from __future__ import annotations

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

from fastapi import FastAPI

from torchrender import __version__
from torchrender_service.door.guard import Guard
from torchrender_service.problems import add_error_handlers
from torchrender_service.renderers.pool import Pool
from torchrender_service.settings import Settings
from torchrender_service.streams.directory import SessionDirectory
from torchrender_service.web import (
    routes_fog,
    routes_photos,
    routes_pictures,
    routes_scenes,
    routes_status,
    routes_stream,
    routes_style,
)
from torchrender_service.web.page import PageFiles, PageMount
from torchrender_service.web.state import MakePool, ServiceState

STATIC = Path(__file__).parent.parent / "static"


def make_app(
    settings: Settings,
    make_pool: MakePool = Pool,
    *,
    start: str = "",
    directory: SessionDirectory | None = None,
    replica: str = "",
) -> FastAPI:
    """The service with these settings; it starts its renderers when the server starts it.

    Args:
        make_pool: who renders; default: processes of this machine.
        start: scene that the page begins with.
        directory: of the sessions of all replicas; default: this is the only one.
        replica: name of this one.

    Raises:
        OptionError: the shared storage cannot be used.
    """
    state = ServiceState(settings, make_pool, directory=directory, replica=replica)

    @asynccontextmanager
    async def lifespan(app: FastAPI) -> AsyncIterator[None]:
        del app
        await state.start()
        try:
            yield
        finally:
            await state.stop()

    app = FastAPI(
        title="torchrender",
        version=__version__,
        description="Scenes, pictures and streams of depth images. Errors are problem documents (RFC 9457).",
        lifespan=lifespan,
        docs_url=None,  # its page would load scripts from elsewhere
        redoc_url=None,
        openapi_url="/v1/openapi.json",
    )
    app.state.service = state
    add_security(app)
    add_error_handlers(app)
    for module in (
        routes_scenes,
        routes_pictures,
        routes_style,
        routes_fog,
        routes_photos,
        routes_stream,
        routes_status,
    ):
        app.include_router(module.router)
    if STATIC.is_dir():
        files = PageFiles(directory=STATIC, html=True, start=start)
        app.router.routes.append(PageMount("/", files, name="client"))
    app.add_middleware(Guard, settings=settings, metrics=state.metrics, bodies=state.bodies)
    return app


def add_security(app: FastAPI) -> None:
    """Say in the description which calls take the API key, and below which path the service stands."""
    make = app.openapi

    def described() -> dict[str, Any]:
        document = make()
        schemes = document.setdefault("components", {}).setdefault("securitySchemes", {})
        schemes["api-key"] = {"type": "http", "scheme": "bearer", "description": "where the server has an API key"}
        for path, methods in document["paths"].items():
            for operation in methods.values():
                if path.startswith("/v1/") or path == "/metrics":
                    # Also without one: a server on loopback may have none.
                    operation["security"] = [{"api-key": []}, {}]
        document["servers"] = [{"url": app.state.service.settings.root_path or "/"}]
        return document

    app.openapi = described  # type: ignore[method-assign]
