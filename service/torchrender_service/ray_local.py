"""The service on Ray Serve on this machine: ``python -m torchrender_service.ray_local --port 8000 num_replicas=2``.

Its cluster lasts as long as this process. A line ``replicas 1`` on standard input changes how many replicas there are.
"""

from __future__ import annotations

import argparse
import math
import signal
import sys
import threading
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import ray
from ray import serve
from ray.serve._private.common import DeploymentID

from torchrender_service.ray_app import NAME, application, options_of

CONTROLLER = ("SERVE_CONTROLLER_ACTOR", "serve")
QUIET: dict[str, Any] = {"log_to_driver": False, "logging_level": "ERROR"}


def set_replicas(count: int) -> None:
    """Change how many replicas the service of this cluster has."""
    name, namespace = CONTROLLER
    controller = ray.get_actor(name, namespace=namespace)
    ray.get(controller.update_deployment_replicas.remote(DeploymentID(name=NAME, app_name=NAME), count))


def listen(lines: Iterable[str]) -> None:
    """Do what is asked for, until nothing more comes."""
    for line in lines:
        words = line.split()
        if len(words) == 2 and words[0] == "replicas" and words[1].isdecimal() and int(words[1]) > 0:
            set_replicas(int(words[1]))
        elif words:
            sys.stderr.write(f"not understood: {line.strip()[:80]!r}; there is: replicas N\n")


def run(args: Mapping[str, Any], host: str, port: int) -> None:
    """Serve until a signal comes.

    Raises:
        OptionError: as :func:`~torchrender_service.ray_app.application`; without an API key on loopback alone.
    """
    built, options = application({"host": host, **args}), options_of(args)
    cores = math.ceil(options.cpus * max(options.num_replicas, options.max_replicas))
    ray.init(num_cpus=cores, include_dashboard=False, **QUIET)
    serve.start(http_options={"host": host, "port": port})
    logs = {"log_level": "ERROR", "enable_access_log": False}
    serve.run(built, name=NAME, logging_config=logs, external_scaler_enabled=not options.max_replicas)
    sys.stdout.write(f"torchrender serves on http://{host}:{port}/\n")
    sys.stdout.flush()
    threading.Thread(target=listen, args=(sys.stdin,), daemon=True).start()
    stopped = threading.Event()
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda *_: stopped.set())
    stopped.wait()
    serve.shutdown()
    ray.shutdown()


def main(argv: Sequence[str] | None = None) -> None:
    """The command."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--host", default="127.0.0.1")
    parser.add_argument("--port", type=int, default=8000)
    parser.add_argument("given", nargs="*", metavar="NAME=VALUE", help="settings, and options such as num_replicas")
    arguments = parser.parse_args(argv)
    run(dict(word.partition("=")[::2] for word in arguments.given), arguments.host, arguments.port)


if __name__ == "__main__":
    main()
