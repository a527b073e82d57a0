"""The OpenAPI description: its examples work, and whatever it allows or forbids never gives a 5xx."""

from __future__ import annotations

import warnings
from typing import Any

import pytest
from hypothesis import HealthCheck, Phase, given, settings

from service_server import RunningServer
from torchrender_service.settings import read_settings
from torchrender_service.web.app import make_app

with warnings.catch_warnings():
    warnings.simplefilter("ignore")
    schemathesis = pytest.importorskip("schemathesis", reason="pip install 'torchrender[test]'")


KEYFRAMES = "application/vnd.torchrender.keyframes"


@schemathesis.serializer(
    "model/gltf-binary", "application/zip", "application/toml", "image/jpeg", "image/png", KEYFRAMES
)
def as_it_is(context: Any, value: Any) -> bytes:
    """Scenes and photos are sent as bytes or text."""
    del context
    return value if isinstance(value, bytes) else str(value).encode("utf-8", "surrogatepass")


QUICK = settings(
    max_examples=15,
    deadline=None,
    database=None,
    derandomize=True,
    phases=(Phase.explicit, Phase.generate),
    suppress_health_check=list(HealthCheck),
)
DESCRIPTION: dict[str, Any] = make_app(read_settings(None, {})).openapi()
OPERATIONS = [found.ok() for found in schemathesis.openapi.from_dict(DESCRIPTION).get_all_operations()]
ANY_BYTES = ("/v1/photos", "/v1/marks", "/v1/keyframes")
"""Their bodies are bytes and nothing else: none is outside of the description."""
MODES = (schemathesis.GenerationMode.POSITIVE, schemathesis.GenerationMode.NEGATIVE)


def test_every_route_is_described() -> None:
    wanted = {
        "/v1/scenes": {"get", "post"},
        "/v1/scenes/{scene}": {"get", "delete"},
        "/v1/scenes/{scene}/survey": {"get"},
        "/v1/render": {"post"},
        "/v1/depth-images": {"post"},
        "/v1/reproject": {"post"},
        "/v1/keyframes": {"post"},
        "/v1/style": {"post"},
        "/v1/fog": {"post"},
        "/v1/photos": {"post"},
        "/v1/photos/{photo}/regions": {"post"},
        "/v1/marks": {"post"},
        "/v1/plan": {"get"},
        "/v1/tradeoff/{name}": {"get"},
        "/v1/sessions": {"post"},
        "/health": {"get"},
        "/ready": {"get"},
        "/metrics": {"get"},
    }
    assert {path: set(methods) for path, methods in DESCRIPTION["paths"].items()} == wanted
    for path, methods in DESCRIPTION["paths"].items():
        for method, operation in methods.items():
            assert operation.get("summary") and operation.get("description"), (path, method)


def test_the_api_key_is_described() -> None:
    assert DESCRIPTION["components"]["securitySchemes"]["api-key"]["scheme"] == "bearer"
    secured = {path for path, methods in DESCRIPTION["paths"].items() if any("security" in m for m in methods.values())}
    assert secured == {path for path in DESCRIPTION["paths"] if path not in ("/health", "/ready")}


@pytest.mark.parametrize("path", ["/v1/render", "/v1/depth-images", "/v1/sessions"])
def test_the_examples_work(server: RunningServer, path: str) -> None:
    reference = DESCRIPTION["paths"][path]["post"]["requestBody"]["content"]["application/json"]["schema"]["$ref"]
    (example,) = DESCRIPTION["components"]["schemas"][reference.rpartition("/")[2]]["examples"]
    size = {"width": 64, "height": 48}  # the shared server has small limits
    answer = server.ask("POST", path, {**example, **size})
    assert answer.status in (200, 201), answer.body


@pytest.mark.parametrize("mode", MODES, ids=lambda mode: mode.name.lower())
@pytest.mark.parametrize("operation", OPERATIONS, ids=lambda operation: operation.label)
def test_nothing_that_is_allowed_or_forbidden_gives_a_5xx(server: RunningServer, operation: Any, mode: Any) -> None:
    negative = mode is schemathesis.GenerationMode.NEGATIVE
    if negative and (
        operation.path in ANY_BYTES or not (operation.body or operation.query or operation.path_parameters)
    ):
        return  # nothing to get wrong

    @QUICK
    @given(operation.as_strategy(generation_mode=mode))
    def ask(case: Any) -> None:
        response = case.call(base_url=server.url, timeout=60)
        assert response.status_code < 500, response.text
        if response.status_code >= 400:
            assert response.headers["content-type"] == ["application/problem+json"], response.text
            assert response.json()["status"] == response.status_code

    ask()
