"""Whether settings can work at all: what a worker would refuse whatever its pictures are is refused before it starts.

Files are not looked at: a recording may be there tomorrow, or on another machine.
"""

from __future__ import annotations

import re
from collections.abc import Iterator

from lightwell.errors import LightwellError, SourceError
from lightwell.probe.disc import camera_rotation
from lightwell.probe.factory import make_mapping
from lightwell.settings import MappingSettings, StreamSettings
from lightwell_server.masking import mask
from lightwell_server.problems import FieldError, Problem
from lightwell_workers.ingest.sources import SCHEMES
from lightwell_workers.ingest.sources.url import parse_options, parse_source_url

ROUND = ("mirror-sphere", "mirror-ball", "angular", "fisheye")
LARGE_PICTURE = 8192
"""Side in pixels of a picture that no probe is too small in."""


def require_feasible(settings: StreamSettings, prefix: str = "") -> None:
    """Raise the 422 problem where the settings can never work; ``prefix`` comes before the names of its fields.

    The source of a stream that is not enabled may be anything: a worker of somebody else's may know it. It imports
    what the source needs, which takes a while the first time: call it on a thread.
    """
    errors = [FieldError(field=prefix + field, message=message) for field, message in _complaints(settings)]
    if errors:
        detail = "; ".join(f"{error.field}: {error.message}" for error in errors)
        raise Problem(422, "invalid-input", detail, errors=errors)


def _complaints(settings: StreamSettings) -> Iterator[tuple[str, str]]:
    """Yield the field and what is wrong with it."""
    if not _is_text(settings.source):
        yield "source", f"{settings.source!r}: must be text, without NUL and lone surrogates"
    elif settings.enabled:
        try:
            _check_source(settings.source)
        except LightwellError as error:
            yield "source", mask(str(error))
    mapping = settings.mapping
    if mapping.kind in ROUND:
        try:
            camera_rotation(mapping.forward, mapping.up)
        except LightwellError as error:
            yield "mapping.forward", _without_dashes(error)
        else:
            try:
                _check_round(mapping)
            except LightwellError as error:
                yield "mapping", _without_dashes(error)
    if settings.weights != "solid-angle" and mapping.kind != "latlong":
        yield (
            "weights",
            f"{settings.weights} is a quadrature of lat-long rows, not for {mapping.kind} pictures: use solid-angle",
        )


def _is_text(text: str) -> bool:
    return "\0" not in text and not re.search("[\ud800-\udfff]", text)


def _check_source(text: str) -> None:
    """Raise `SourceError` where no worker can open the source, whatever files there are."""
    url = parse_source_url(text)
    match url.scheme:
        case "exr":
            from lightwell_workers.ingest.sources.exr import ExrOptions

            parse_options(url, ExrOptions)
        case "video":
            from lightwell_workers.ingest.sources.video import VideoOptions

            parse_options(url, VideoOptions)
        case "synthetic":
            from lightwell_workers.ingest.sources.synthetic import read_options

            read_options(url)
        case "upload":
            from lightwell_workers.ingest.sources.upload import check_upload

            check_upload(url)
        case _:
            raise SourceError(f"source {text!r}: no scheme {url.scheme!r}. There are: {', '.join(SCHEMES)}")
    if not url.target:
        raise SourceError(f"source {text!r} names no files")


def _check_round(mapping: MappingSettings) -> None:
    """Raise `MappingError` where the measures fit no picture; the one that is tried has the disc in its middle."""
    disc = None if mapping.disc is None else (LARGE_PICTURE / 2, LARGE_PICTURE / 2, mapping.disc[2])
    measures = (mapping.fov_degrees, mapping.sphere_radius_m, mapping.sphere_distance_m)
    if mapping.kind == "fisheye" or (mapping.kind == "mirror-sphere" and None not in measures):
        disc = None  # whether it agrees with the rest depends on the picture's size
    make_mapping(mapping.model_copy(update={"disc": disc}), LARGE_PICTURE, LARGE_PICTURE)


def _without_dashes(error: LightwellError) -> str:
    """Return the message with settings named as in JSON, not as on the command line."""
    return re.sub(r"--([a-z]+(?:-[a-z]+)*)", lambda option: option[1].replace("-", "_"), str(error))
