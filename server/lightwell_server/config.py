"""Configuration of the server: the only module that reads the environment.

Values come from four places; the first that has one wins:

1. flags of the command line (``--host``, ``--port``, ``--data``),
2. environment variables: ``LIGHTWELL_SERVER__PORT=9000`` sets ``port`` of ``[server]``; lists and tables are JSON,
3. the TOML file: ``--config FILE``, else ``lightwell.toml`` in the working directory where there is one,
4. the defaults below, which ``lightwell.toml`` lists one by one.

Streams and fields that the API creates or changes are kept in the data directory (`lightwell_server.store`) and win
over the file's of the same name, whole, until they are deleted through the API.
"""

from __future__ import annotations

import tomllib
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from pydantic import Field, SecretStr, ValidationError
from pydantic_core import ErrorDetails
from pydantic_settings import BaseSettings, PydanticBaseSettingsSource, SettingsConfigDict, SettingsError

from lightwell.errors import LightwellError
from lightwell.job_settings import JobsSettings
from lightwell.settings import FieldSettings, Settings, StreamName, StreamSettings, complaint
from lightwell_workers.ingest.log import LogFormat, LogLevel

DEFAULT_FILE = Path("lightwell.toml")
DEFAULT_PORT = 8400


class ConfigError(LightwellError):
    """The configuration cannot be used: names the place, the key, the value and the remedy."""


class ServerSettings(Settings):
    """Where the server listens and keeps its data."""

    host: str = Field("127.0.0.1", description="address to listen on; 0.0.0.0 serves every network")
    port: int = Field(DEFAULT_PORT, ge=0, le=65535, description="TCP port; 0 takes a free one")
    data_dir: Path = Field(Path("data"), description="folder for what must survive a restart")
    min_free_mb: int = Field(100, ge=0, description="/readyz fails below this much free disk, megabytes")
    allowed_origins: tuple[str, ...] = Field((), description="web origins allowed beside localhost and this server's")
    max_body_kb: int = Field(256, ge=1, le=65536, description="largest HTTP request body, kilobytes")


class AuthSettings(Settings):
    """Tokens by scope. admin includes publish, publish includes read."""

    read_tokens: tuple[SecretStr, ...] = Field((), description="tokens that may follow streams; none: everybody may")
    publish_tokens: tuple[SecretStr, ...] = Field((), description="tokens that may publish; none: this machine may")
    admin_tokens: tuple[SecretStr, ...] = Field(
        (), description="tokens that may change streams; none: this machine may"
    )


class HubSettings(Settings):
    """How frames are handed to subscribers."""

    heartbeat_seconds: float = Field(2.0, gt=0, le=60, description="pause after which a heartbeat is sent, seconds")
    stall_seconds: float = Field(10.0, gt=0, le=600, description="a send that takes longer is cut off, seconds")
    control_queue: int = Field(64, ge=4, le=10000, description="events a subscriber may leave untaken before it is cut")
    write_buffer_kb: int = Field(16, ge=1, le=4096, description="bytes buffered in the process per client, kilobytes")
    socket_buffer_kb: int = Field(
        64, ge=4, le=4096, description="bytes buffered in the kernel per client (before it doubles them), kilobytes"
    )
    max_message_kb: int = Field(8192, ge=64, le=65536, description="largest message from a worker, kilobytes")
    max_subscribers: int = Field(2000, ge=1, description="subscribers to all streams together")
    announce_seconds: float = Field(5.0, gt=0, le=60, description="time a worker has to announce itself, seconds")


class SupervisorSettings(Settings):
    """The ingest processes that run beside the server."""

    embedded: bool = Field(True, description="start one ingest process for each enabled stream")
    startup_seconds: float = Field(
        60.0, gt=0, description="time a new process has for its first frame (it compiles kernels), seconds"
    )
    stale_seconds: float = Field(
        5.0, gt=0, description="a stream without a frame for longer (and for three of its intervals) is stale, seconds"
    )
    watchdog_seconds: float = Field(
        15.0, gt=0, description="age of the last frame (at least three intervals) at which to restart, seconds"
    )
    backoff_first_seconds: float = Field(0.25, gt=0, description="pause before the first restart, seconds")
    backoff_longest_seconds: float = Field(30.0, gt=0, description="pauses double up to this, seconds")
    stop_seconds: float = Field(5.0, gt=0, description="time a process has to end before it is killed, seconds")


class UploadsSettings(Settings):
    """Meshes and light maps that pages and programs send."""

    max_mb: int = Field(256, ge=1, le=4096, description="largest file, megabytes")
    max_triangles: int = Field(2_000_000, ge=1, le=5_000_000, description="of all objects of a mesh file together")
    quota_mb: int = Field(4096, ge=1, description="disk that all uploads may use together, megabytes")


class LogSettings(Settings):
    """What the server and its workers say on standard error."""

    level: LogLevel = Field("info", description="debug, info, warning or error; workers too")
    format: LogFormat = Field("auto", description="text, json, or auto: text on a terminal, json elsewhere")


class Config(BaseSettings):
    """Everything the server can be told."""

    model_config = SettingsConfigDict(
        env_prefix="LIGHTWELL_",
        env_nested_delimiter="__",
        extra="forbid",
        frozen=True,
        nested_model_default_partial_update=True,
    )

    server: ServerSettings = ServerSettings()
    auth: AuthSettings = AuthSettings()
    hub: HubSettings = HubSettings()
    supervisor: SupervisorSettings = SupervisorSettings()
    jobs: JobsSettings = JobsSettings()
    uploads: UploadsSettings = UploadsSettings()
    log: LogSettings = LogSettings()
    streams: dict[StreamName, StreamSettings] = Field({}, description="streams by name")
    fields: dict[StreamName, FieldSettings] = Field({}, description="fields of several streams, by name")

    @classmethod
    def settings_customise_sources(
        cls,
        settings_cls: type[BaseSettings],
        init_settings: PydanticBaseSettingsSource,
        env_settings: PydanticBaseSettingsSource,
        dotenv_settings: PydanticBaseSettingsSource,
        file_secret_settings: PydanticBaseSettingsSource,
    ) -> tuple[PydanticBaseSettingsSource, ...]:
        """Let the environment win over the file, whose contents are given as keywords."""
        return env_settings, init_settings


def load_config(file: Path | None = None, flags: Mapping[str, Any] | None = None) -> Config:
    """Read the configuration.

    ``file`` None means ``lightwell.toml`` in the working directory, where there is one. ``flags`` maps keys of
    ``[server]`` to values that win over all else; None values are left out.

    Raises
    ------
    ConfigError
        With one line for each mistake: place, key, value, remedy.
    """
    contents = _read(file)
    where = str(file or DEFAULT_FILE)
    try:
        config = Config(**contents)
    except ValidationError as error:
        raise ConfigError("\n".join(_describe(item, where, contents) for item in error.errors())) from None
    except SettingsError as error:
        raise ConfigError(f"environment: {error}; lists and tables in LIGHTWELL_… variables are JSON") from None
    overrides = {key: value for key, value in (flags or {}).items() if value is not None}
    if not overrides:
        return config
    try:
        server = ServerSettings.model_validate(config.server.model_dump() | overrides)
    except ValidationError as error:
        raise ConfigError("\n".join(f"--{item['loc'][0]} {complaint(item)}" for item in error.errors())) from None
    return config.model_copy(update={"server": server})


def _read(file: Path | None) -> dict[str, Any]:
    """Return the contents of the TOML file; an empty one where no file is named and the default one is absent."""
    if file is None and not DEFAULT_FILE.exists():
        return {}
    path = file or DEFAULT_FILE
    try:
        return tomllib.loads(path.read_text("utf-8"))
    except FileNotFoundError:
        raise ConfigError(f"{path}: there is no such file; give another to --config, or leave it out") from None
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError(f"{path}: cannot be read: {error}") from None
    except tomllib.TOMLDecodeError as error:
        raise ConfigError(f"{path}: is not valid TOML: {error}") from None


def _describe(item: ErrorDetails, file: str, contents: Mapping[str, Any]) -> str:
    """Return one line for one mistake; the place is the environment where the file does not have the key."""
    in_file = item["type"] == "missing" or _holds(contents, item["loc"])
    key = ".".join(str(part) for part in item["loc"] if part != "[key]")
    variable = "LIGHTWELL_" + "__".join(str(part).upper() for part in item["loc"])
    return f"{file}: {key} {complaint(item)}" if in_file else f"environment: {variable} {complaint(item)}"


def _holds(contents: object, path: Iterable[int | str]) -> bool:
    """Return whether the file has a value at ``path``."""
    for key in path:
        table = dict(enumerate(contents)) if isinstance(contents, list) else contents
        if not isinstance(table, Mapping) or key not in table:
            return key == "[key]"
        contents = table[key]
    return True
