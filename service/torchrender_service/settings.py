"""Settings of the service: defaults, then a TOML file, then the environment, then the command line.

Every field below is a key of the TOML file and, as ``TORCHRENDER_`` and its name in capitals, a variable of the
environment. Lists are separated by commas there.
"""

from __future__ import annotations

import contextlib
import difflib
import ipaddress
import os
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

import msgspec
from msgspec import Meta

from torchrender.errors import OptionError

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

Count = Annotated[int, Meta(ge=1, le=2**40)]
Seconds = Annotated[float, Meta(gt=0.0, le=86400.0)]
Source = Annotated[str, Meta(pattern=r"^('self'|[A-Za-z][A-Za-z0-9+.-]*://[A-Za-z0-9.:*_\[\]-]+)$")]
PREFIX = "TORCHRENDER_"
OTHER_VARIABLES = {
    PREFIX + name
    for name in (
        *("CONFIG", "CURVES", "KERNELS", "DATA", "CHROMIUM", "REQUIRE_BROWSER", "REQUIRE_DOCS", "TESTS_ON_RAY"),
        *("RENDERER_LIMIT_MB", "RENDERER_NICENESS", "RENDERER_TEXTURES_MB", "PLAIN_COMPILER"),
    )
}
"""Of the package, its tests and its renderers."""
LOOPBACK_NAMES = ("localhost", "127.0.0.1", "[::1]", "::1")
BUILT_IN = (
    *("living_room", "cornell_box", "washroom", "nest", "grass", "city", "tree"),
    *("hall", "street_lamp", "panes", "walker"),
)


class Settings(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """How the service runs."""

    host: str = "127.0.0.1"
    port: Annotated[int, Meta(ge=0, le=65535)] = 8000
    api_key: Annotated[str, Meta(min_length=16)] | None = None  # required on addresses other than loopback
    allowed_origins: tuple[str, ...] = ()  # besides the service's own
    allowed_hosts: tuple[str, ...] = ()  # names in the Host header besides loopback's; empty off loopback: all
    frame_ancestors: tuple[Source, ...] = ()  # pages that may show this one within theirs, as CSP writes them
    root_path: Annotated[str, Meta(pattern="^(/[^/?#]+)*$")] = ""  # below which a proxy shows the service
    trusted_proxies: tuple[str, ...] = ()  # their X-Forwarded-For tells whose request it is
    data_dir: str = "torchrender-data"  # uploaded scenes
    shared_storage: str = ""  # of all replicas: a folder or an address such as s3://bucket/path; empty: data_dir alone
    storage_s: Seconds = 10.0  # for each file that is read or written there
    built_in: tuple[str, ...] = BUILT_IN
    log_level: Annotated[str, Meta(pattern="^(debug|info|warning|error)$")] = "info"

    threads: Annotated[int, Meta(ge=0, le=1024)] = 0  # of each renderer; 0: as many as there are cores, at most 4
    renderers: Annotated[int, Meta(ge=0, le=256)] = 0  # processes; 0: cores divided by threads
    renderer_memory_mb: Annotated[int, Meta(ge=0, le=2**24)] = 0  # beyond a fresh process's; 0: a share of the host's
    spare_renderer: bool = True  # one more process stands ready for when a renderer dies
    waiting: Count = 64  # jobs that may wait for one renderer
    job_s: Seconds = 120.0  # a renderer that takes longer is stopped
    batch_s: Seconds = 600.0  # the same for large pictures, which give way to all others
    batch_renderer: bool = True  # a process of its own for large pictures and photos; else they wait with the others
    batch_niceness: Annotated[int, Meta(ge=2, le=19)] = 19  # 19: only what others leave over
    inspect_s: Seconds = 60.0  # the same for an upload that is looked at

    max_connections: Count = 1024
    max_connections_per_address: Count = 256
    max_requests: Count = 512  # under way at a time
    max_requests_per_address: Count = 64
    connections_per_s: Count = 250  # that one address may open; twice as many at once
    requests_per_s: Count = 250  # of one address
    max_uploads: Count = 16  # large bodies under way at a time
    max_uploads_per_address: Count = 4
    header_s: Seconds = 10.0  # for the headers of a request
    body_s: Seconds = 15.0  # for each 16 KiB of a body
    idle_s: Seconds = 15.0  # of a connection between two requests
    write_s: Seconds = 30.0  # for the peer to take 16 KiB of an answer

    max_body_bytes: Count = 2**20
    max_upload_bytes: Count = 2**27
    max_container_bytes: Count = 2**26
    max_pixels: Count = 2**23  # of a picture, supersampling included
    max_stream_pixels: Count = 2**21  # of a keyframe, overscan included
    max_views: Count = 16
    max_triangles: Count = 10_000_000
    max_texture_pixels: Count = 2**26
    max_texture_mb: Count = 512  # of a scene that is loaded, with all levels: finer ones are left out, and named
    max_scenes: Count = 256
    max_store_bytes: Count = 2**34
    max_kept_bytes: Count = 2**28  # keyframe containers kept in memory for reproject
    max_buffered_bytes: Count = 2**28  # large bodies in memory at a time

    max_sessions: Count = 64
    max_sessions_per_address: Count = 32
    ticket_s: Seconds = 60.0
    resume_s: Seconds = 60.0
    hello_s: Seconds = 10.0
    stall_s: Seconds = 30.0
    still_s: Seconds = 0.25
    shutdown_s: Annotated[float, Meta(gt=0.0, le=60.0)] = 8.0

    @property
    def loopback(self) -> bool:
        """The service is reachable from this machine only."""
        if self.host == "localhost":
            return True
        try:
            return ipaddress.ip_address(self.host.strip("[]")).is_loopback
        except ValueError:
            return False

    @property
    def memory_mb(self) -> int:
        """What each renderer may take: as set, or its share of three quarters of the memory of host or container."""
        if self.renderer_memory_mb:
            return max(512, self.renderer_memory_mb)
        return max(
            512, int(0.75 * memory_of_host_mb()) // (self.renderer_count + self.batch_renderer + self.spare_renderer)
        )

    @property
    def renderer_threads(self) -> int:
        """Threads of each renderer."""
        return self.threads or min(os.cpu_count() or 1, 4)

    @property
    def renderer_count(self) -> int:
        """Renderers that run at a time: cores divided by threads."""
        return self.renderers or max(1, (os.cpu_count() or 1) // self.renderer_threads)


_DEFAULTS = Settings()


def memory_of_host_mb() -> int:
    """Memory that this process and its children may take: of the machine, or of the container where that is less."""
    found = [8 * 2**30]
    with contextlib.suppress(AttributeError, ValueError, OSError):
        found = [os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")]
    for file in ("/sys/fs/cgroup/memory.max", "/sys/fs/cgroup/memory/memory.limit_in_bytes"):
        try:
            found.append(int(Path(file).read_text()))
        except (OSError, ValueError):  # there is none, or it is "max"
            continue
    return min(found) // 2**20


def misspelt(environment: Mapping[str, str]) -> list[str]:
    """What is said about variables of the environment that look like settings and are none."""
    known = {PREFIX + name.upper() for name in Settings.__struct_fields__} | OTHER_VARIABLES
    said = []
    for name in sorted(environment):
        if not name.startswith(PREFIX) or name in known:
            continue
        if environment[name].startswith("tcp://"):  # set by orchestrators, for services
            continue
        near = difflib.get_close_matches(name, sorted(known), n=1, cutoff=0.8)
        if near:
            said.append(f"{name} is no setting and changes nothing; did you mean {near[0]}?")
        else:
            said.append(f"{name} is no setting and changes nothing")
    return said


def _parted(name: str, value: Any) -> Any:
    """A list that is written as one text."""
    if isinstance(value, str) and isinstance(getattr(_DEFAULTS, name, None), tuple):
        return [part.strip() for part in value.split(",") if part.strip()]
    return value


def read_settings(
    file: str | Path | None = None, environment: Mapping[str, str] | None = None, **given: Any
) -> Settings:
    """Settings from a TOML file (default: the one that ``TORCHRENDER_CONFIG`` names), environment and ``given``.

    Raises:
        OptionError: an unknown key, a wrong type, a value out of range, a file that cannot be read, or an address
            other than loopback without an API key.
    """
    environment = os.environ if environment is None else environment
    values: dict[str, Any] = {}
    file = file or environment.get(PREFIX + "CONFIG")
    if file:
        try:
            values |= tomllib.loads(Path(file).read_text())
        except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
            raise OptionError(f"settings file {file} cannot be read: {error}") from error
    for name in Settings.__struct_fields__:
        text = environment.get(PREFIX + name.upper())
        if text is not None:
            values[name] = _parted(name, text)
    values |= {name: _parted(name, value) for name, value in given.items() if value is not None}
    try:
        settings = msgspec.convert(values, Settings, strict=False)
    except msgspec.ValidationError as error:
        raise OptionError(f"settings: {error}") from error
    unknown = sorted(set(settings.built_in) - set(BUILT_IN))
    if unknown:
        raise OptionError(f"built_in must be a list out of {', '.join(BUILT_IN)}, got {', '.join(unknown)}")
    if not settings.loopback and settings.api_key is None:
        raise OptionError(
            f"api_key is required (TORCHRENDER_API_KEY) to serve on {settings.host}: not a loopback address"
        )
    return settings
