"""Source URLs: ``scheme:target?option=value&…``."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeVar
from urllib.parse import parse_qsl

from pydantic import ValidationError

from lightwell.errors import SourceError
from lightwell.settings import Settings

Options = TypeVar("Options", bound=Settings)


@dataclass(frozen=True, slots=True)
class SourceUrl:
    """The parts of a source URL."""

    text: str
    scheme: str
    target: str
    """Taken as it stands: a ``%`` belongs to a printf pattern, not to an escape."""
    query: dict[str, str]


def parse_source_url(text: str) -> SourceUrl:
    """Split a source URL.

    The query starts at the last ``?`` that has a ``=`` behind it, so that a glob may contain ``?``.

    Raises
    ------
    SourceError
        Where there is no scheme, or an option is given twice.
    """
    scheme, colon, rest = text.partition(":")
    if not colon or not scheme:
        raise SourceError(f"source {text!r} has no scheme: write exr:…, video:… or synthetic:…")
    target, mark, query = rest.rpartition("?")
    if not mark or (query and "=" not in query):
        target, query = rest, ""
    pairs = parse_qsl(query, keep_blank_values=True)
    options = dict(pairs)
    if len(options) != len(pairs):
        raise SourceError(f"source {text!r} gives an option twice")
    return SourceUrl(text, scheme, target, options)


def parse_options(url: SourceUrl, model: type[Options]) -> Options:
    """Return the URL's options as ``model``; an option left empty takes its default.

    Raises
    ------
    SourceError
        Names the unknown option or bad value, and lists what exists.
    """
    try:
        return model.model_validate({name: value for name, value in url.query.items() if value != ""})
    except ValidationError as error:
        first = error.errors()[0]
        name = ".".join(str(part) for part in first["loc"])
        known = "; ".join(
            f"{field} ({info.description}; default {info.default})" for field, info in model.model_fields.items()
        )
        problem = (
            f"has no option {name!r}" if first["type"] == "extra_forbidden" else f"option {name!r}: {first['msg']}"
        )
        raise SourceError(f"source {url.text!r} {problem}. Options of {url.scheme}: {known or 'none'}") from None
