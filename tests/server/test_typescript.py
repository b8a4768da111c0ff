from __future__ import annotations

import re
from pathlib import Path

import msgspec.inspect
import pytest

from lightwell import wire
from lightwell_server import typescript


def test_generated_types_are_fresh() -> None:
    assert typescript.target().read_text(encoding="utf-8") == typescript.generate(), (
        "run python -m lightwell_server.typescript"
    )


def test_every_live_message_has_an_interface_with_its_tag() -> None:
    text = typescript.generate()
    for message in typescript.RECEIVED:
        tag = message.__struct_config__.tag
        assert re.search(rf'interface {message.__name__} {{\n  type: "{tag}";', text), message


def test_received_fields_are_complete_and_sent_defaults_are_optional() -> None:
    text = typescript.generate()
    frame = re.search(r"interface Frame {.*?^}", text, re.DOTALL | re.MULTILINE)
    assert frame is not None
    for field in wire.Frame.__struct_fields__:
        assert f"  {field}: " in frame[0]
    assert "  bands?: number | null;" in text[text.index("interface Subscribe ") :]


def test_check_says_whether_the_file_is_fresh(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "wire.ts"
    monkeypatch.setattr(typescript, "target", lambda: path)
    assert typescript.main(["--check"]) == 1
    assert "out of date" in capsys.readouterr().err
    assert typescript.main([]) == 0
    assert typescript.main(["--check"]) == 0


def test_an_unknown_type_is_refused() -> None:
    with pytest.raises(TypeError, match="no TypeScript type"):
        typescript._type(msgspec.inspect.DecimalType())
