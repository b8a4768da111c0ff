"""Configuration: the shipped file, precedence, and what each mistake is answered with."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

import pytest
from pydantic import BaseModel

from lightwell.settings import StreamSettings
from lightwell_server.config import Config, ConfigError, load_config

SHIPPED = Path(__file__).parents[2] / "lightwell.toml"


def uncommented_example() -> str:
    text = SHIPPED.read_text("utf-8")
    example = text[text.index("# [streams.hall]") :]
    return re.sub(r"(?m)^# ?", "", example)


def test_the_shipped_file_equals_an_empty_one() -> None:
    assert load_config(SHIPPED) == Config()


def test_the_shipped_file_lists_every_option_of_the_server() -> None:
    contents = tomllib.loads(SHIPPED.read_text("utf-8"))
    for section, field in Config.model_fields.items():
        if section not in ("streams", "fields"):
            assert isinstance(field.annotation, type)
            assert issubclass(field.annotation, BaseModel)
            assert list(contents[section]) == list(field.annotation.model_fields)


def test_the_example_stream_lists_every_option_with_its_default() -> None:
    example = tomllib.loads(uncommented_example())["streams"]["hall"]
    settings = StreamSettings.model_validate(example)
    assert settings == StreamSettings(source=settings.source)
    for name, field in StreamSettings.model_fields.items():
        assert name in example or (field.default is None and f"{name} =" in uncommented_example())
        if isinstance(field.annotation, type) and issubclass(field.annotation, BaseModel):
            for inner, inner_field in field.annotation.model_fields.items():
                listed = inner in example[name] or (inner_field.default is None and inner in uncommented_example())
                assert listed, f"{name}.{inner}"


def test_flags_win_over_environment_over_file_over_default(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = tmp_path / "lightwell.toml"
    file.write_text('[server]\nhost = "10.0.0.1"\nport = 1\nmin_free_mb = 7\n')
    monkeypatch.setenv("LIGHTWELL_SERVER__PORT", "2")
    monkeypatch.setenv("LIGHTWELL_SERVER__HOST", "10.0.0.2")
    server = load_config(file, {"host": "10.0.0.3", "port": None}).server
    assert (server.host, server.port, server.min_free_mb, server.max_body_kb) == ("10.0.0.3", 2, 7, 256)


def test_the_file_in_the_working_directory_is_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert load_config().server.port == 8400
    Path("lightwell.toml").write_text("[server]\nport = 9\n")
    assert load_config().server.port == 9


def test_tokens_do_not_show() -> None:
    config = Config(auth={"read_tokens": ["hush-hush"]})
    assert "hush-hush" not in repr(config)


MISTAKES = [
    ("[server]\nport = 99999", "FILE: server.port = 99999: must be less than or equal to 65535"),
    ("[server]\nport = 'x'", "FILE: server.port = 'x': must be a valid integer"),
    ("[server]\nprot = 1", "FILE: server.prot is no option: check its spelling"),
    ("[hup]\nx = 1", "FILE: hup is no option: check its spelling"),
    ("server = 3", "FILE: server = 3: must be an object, a table of keys and values"),
    ("[hub]\ncontrol_queue = 3", "FILE: hub.control_queue = 3: must be greater than or equal to 4"),
    ("[hub]\nstall_seconds = 0", "FILE: hub.stall_seconds = 0: must be greater than 0"),
    ("[log]\nlevel = 'loud'", "FILE: log.level = 'loud': must be 'debug', 'info', 'warning' or 'error'"),
    ("[auth]\nread_tokens = 'secret'", "FILE: auth.read_tokens must be a list"),
    ("[streams.hall]\nbands = 3", "FILE: streams.hall.source is missing: it has no default"),
    (
        "[streams.hall]\nsource = 'exr:x'\nbands = 9",
        "FILE: streams.hall.bands = 9: must be less than or equal to 8",
    ),
    (
        "[streams.Hall]\nsource = 'exr:x'",
        "FILE: streams.Hall = 'Hall' is no stream name: use lower-case letters, digits, - and _, at most 63, "
        "a letter or digit first",
    ),
    (
        "[streams.hall]\nsource = 'exr:x'\n[streams.hall.filter]\nkind = 'median'",
        "FILE: streams.hall.filter.kind = 'median': must be 'none', 'alpha', 'tau', 'one-euro' or 'kalman'",
    ),
    (
        "[streams.hall]\nsource = 'exr:x'\n[streams.hall.gradients]\nproxy = 'sphere'",
        "FILE: streams.hall.gradients proxy = 'sphere' needs radius_m",
    ),
    ("[fields.stage]\nstreams = ['a', 'a']", "FILE: fields.stage.streams names 'a' twice: name each stream once"),
    ("[server", "FILE: is not valid TOML: "),
    ("x = \xff", "FILE: is not valid TOML: "),
]


@pytest.mark.parametrize(("text", "message"), MISTAKES)
def test_a_mistake_names_file_key_value_and_remedy(tmp_path: Path, text: str, message: str) -> None:
    file = tmp_path / "lightwell.toml"
    file.write_text(text)
    with pytest.raises(ConfigError) as caught:
        load_config(file)
    expected = message.replace("FILE", str(file))
    if expected.endswith(" "):
        assert str(caught.value).startswith(expected)
    else:
        assert str(caught.value) == expected


def test_every_mistake_has_its_line(tmp_path: Path) -> None:
    file = tmp_path / "lightwell.toml"
    file.write_text("[server]\nport = -1\nhots = 1\n")
    with pytest.raises(ConfigError) as caught:
        load_config(file)
    assert len(str(caught.value).splitlines()) == 2


def test_an_absent_file_is_an_error_only_where_it_was_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    load_config()
    with pytest.raises(ConfigError, match=r"nowhere\.toml: there is no such file; give another to --config"):
        load_config(Path("nowhere.toml"))


def test_a_mistake_in_the_environment_names_the_variable(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("LIGHTWELL_SERVER__PORT", "high")
    with pytest.raises(ConfigError, match=r"^environment: LIGHTWELL_SERVER__PORT = 'high': must be a valid integer"):
        load_config()
    monkeypatch.delenv("LIGHTWELL_SERVER__PORT")
    monkeypatch.setenv("LIGHTWELL_AUTH__READ_TOKENS", "not json")
    with pytest.raises(ConfigError, match=r"^environment: .*are JSON"):
        load_config()


def test_a_mistake_in_a_flag_names_the_flag() -> None:
    with pytest.raises(ConfigError, match="--port = 70000: must be less than or equal to 65535"):
        load_config(None, {"port": 70000})
