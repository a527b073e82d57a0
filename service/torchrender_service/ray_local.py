"""The service on Ray Serve on this machine: ``python -m torchrender_service.ray_local --port 8000 num_replicas=2``.

Its cluster lasts as long as this process, and other machines may join it. ``--replicas 1 --address HOST:PORT`` changes
how many replicas a service that runs has.
"""

from __future__ import annotations

import argparse
import math
import signal
import sys
import threading
from collections.abc import Mapping, Sequence
from typing import Any

import ray
from ray import serve
from ray.serve._private.common import DeploymentID

from torchrender_service.ray_app import NAME, application, options_of

CONTROLLER = ("SERVE_CONTROLLER_ACTOR", "serve")
QUIET: dict[str, Any] = {"log_to_driver": False, "logging_level": "ERROR"}


def set_replicas(address: str, count: int) -> None:
    """Change how many replicas the service of a cluster has."""
    ray.init(address=address, **QUIET)
    name, namespace = CONTROLLER
    controller = ray.get_actor(name, namespace=namespace)
    ray.get(controller.update_deployment_replicas.remote(DeploymentID(name=NAME, app_name=NAME), count))
    ray.shutdown()


def run(args: Mapping[str, Any], host: str, port: int) -> None:
    """Serve until a signal comes.

    Raises:
        OptionError: as :func:`~torchrender_service.ray_app.application`.
    """
    built, options = application(args), options_of(args)
    cores = math.ceil(options.cpus * max(options.num_replicas, options.max_replicas))
    found = ray.init(num_cpus=cores, include_dashboard=False, **QUIET)
    sys.stdout.write(f"Ray at {found.address_info['gcs_address']}\n")
    sys.stdout.flush()
    serve.start(http_options={"host": host, "port": port})
    logs = {"log_level": "ERROR", "enable_access_log": False}
    serve.run(built, name=NAME, logging_config=logs, external_scaler_enabled=not options.max_replicas)
    sys.stdout.write(f"torchrender serves on http://{host}:{port}/\n")
    sys.stdout.flush()
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
    parser.add_argument("--address", metavar="HOST:PORT", help="of a cluster that runs the service, with --replicas")
    parser.add_argument("--replicas", type=int, metavar="N", help="change how many there are, and return")
    parser.add_argument("given", nargs="*", metavar="NAME=VALUE", help="settings, and options such as num_replicas")
    arguments = parser.parse_args(argv)
    if (arguments.address is None) != (arguments.replicas is None):
        parser.error("--address and --replicas go together")
    if arguments.address is not None:
        set_replicas(arguments.address, arguments.replicas)
    else:
        run(dict(word.partition("=")[::2] for word in arguments.given), arguments.host, arguments.port)


if __name__ == "__main__":
    main()
