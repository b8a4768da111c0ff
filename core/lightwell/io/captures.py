"""Captures on disk: a folder with ``capture.json``, ``poses.csv`` and frames, or samples sorted by angle."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, ValidationError

from lightwell.conventions import Units
from lightwell.errors import FrameError, MappingError
from lightwell.io.exr import read_rgb
from lightwell.io.poses import CaptureError, Poses, read_poses
from lightwell.probe.factory import make_mapping
from lightwell.probe.mapping import Mapping
from lightwell.settings import MappingSettings, Settings

DOCUMENT, POSES, SORTED = "capture.json", "poses.csv", "samples.zarr"


class CaptureInfo(Settings):
    """``capture.json``: rig, calibration and units."""

    version: Literal[1] = 1
    name: str = Field("", description="what people call it")
    mapping: MappingSettings = Field(description="how a frame covers the sphere; axes are those of an unturned rig")
    height: int = Field(ge=1, le=16384, description="height of every frame, pixels")
    width: int = Field(ge=1, le=16384, description="width of every frame, pixels")
    gain: float = Field(1.0, gt=0, description="factor from sample to radiance")
    units: Units = Field("relative", description="unit of radiance after the gain")
    scene: dict[str, Any] | None = Field(None, description="of a simulated capture: lightwell.synthetic.scene")


@dataclass(frozen=True)
class Capture:
    """A sequence of light probes with poses."""

    directory: Path
    info: CaptureInfo
    poses: Poses
    digest: str
    """SHA-256 of ``capture.json`` and ``poses.csv``."""

    @property
    def count(self) -> int:
        """Number of probes."""
        return len(self.poses.frames)

    @cached_property
    def rotating(self) -> bool:
        """Whether the probes are turned differently; where all are turned alike, each pixel keeps its direction."""
        first = self.poses.orientations[:1]
        return bool((np.abs(self.poses.orientations @ first.T) < 1 - 1e-9).any())

    @property
    def bounds(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Lower and upper corner of the box round the probes, metres."""
        return self.poses.positions.min(axis=0), self.poses.positions.max(axis=0)

    @property
    def sorted_samples(self) -> Path | None:
        """Folder of the samples in angular order, where the capture was recorded so."""
        path = self.directory / SORTED
        return path if path.is_dir() else None

    def mapping(self) -> Mapping:
        """Return where each pixel of an unturned probe looks."""
        return make_mapping(self.info.mapping, self.info.height, self.info.width)

    def read_frame(self, index: int) -> NDArray[np.float16] | NDArray[np.float32]:
        """Return the pixels of a frame, ``(H, W, 3)``; raises `CaptureError` that names the frame."""
        frame = self.poses.frames[index]
        try:
            pixels = read_rgb(self.directory / frame).pixels
        except FrameError as error:
            raise CaptureError(f"{self.directory.name}: frame {frame}: {error.reason}") from None
        if pixels.shape[:2] != (self.info.height, self.info.width):
            raise CaptureError(
                f"{self.directory.name}: frame {frame} has {pixels.shape[1]}×{pixels.shape[0]} pixels, "
                f"but {DOCUMENT} says {self.info.width}×{self.info.height}"
            )
        return pixels


def open_capture(directory: Path) -> Capture:
    """Open a capture and check everything but the pixels.

    Raises
    ------
    CaptureError
        Naming file, line, field, value and remedy.
    """
    if not directory.is_dir():
        raise CaptureError(f"{directory}: there is no such folder")
    document = _read_bytes(directory / DOCUMENT)
    try:
        info = CaptureInfo.model_validate_json(document)
        make_mapping(info.mapping, info.height, info.width)
    except ValidationError as error:
        first = error.errors()[0]
        field = ".".join(str(part) for part in first["loc"]) or "the document"
        raise CaptureError(f"{directory / DOCUMENT}: {field}: {first['msg'].lower()}") from None
    except MappingError as error:
        raise CaptureError(f"{directory / DOCUMENT}: {error}") from None
    poses = read_poses(directory / POSES)
    if not poses.frames:
        raise CaptureError(f"{directory / POSES}: holds no poses")
    capture = Capture(
        directory, info, poses, hashlib.sha256(document + b"\0" + _read_bytes(directory / POSES)).hexdigest()
    )
    if capture.sorted_samples is None:
        _check_frames(directory, poses)
    return capture


def list_frames(folder: Path) -> list[Path]:
    """Return the EXR files of a folder by name; hidden ones, such as those that macOS adds, are none."""
    return sorted(path for path in folder.iterdir() if path.suffix.lower() == ".exr" and not path.name.startswith("."))


def _check_frames(directory: Path, poses: Poses) -> None:
    folders = sorted({Path(frame).parent for frame in poses.frames})
    present = {
        str(folder / path.name)
        for folder in folders
        if (directory / folder).is_dir()
        for path in list_frames(directory / folder)
    }
    known = {str(Path(frame)) for frame in poses.frames}
    absent, unposed = sorted(known - present), sorted(present - known)
    if absent:
        raise CaptureError(
            f"{directory}: {len(absent)} of {len(known)} frames in {POSES} are missing, the first is {absent[0]}: "
            "add the file or delete its row"
        )
    if unposed:
        raise CaptureError(
            f"{directory}: there are fewer poses than frames: {len(unposed)} of {len(present)} frames have none, the "
            f"first is {unposed[0]}: add its row to {POSES} or delete the file"
        )


def _read_bytes(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except FileNotFoundError:
        raise CaptureError(f"{path}: there is no such file; a capture has {DOCUMENT} and {POSES}") from None
    except OSError as error:
        raise CaptureError(f"{path}: cannot be read: {error.strerror}") from None
