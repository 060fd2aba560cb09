"""Sound files: WAV and FLAC, read by libsndfile; results are WAV of floating-point numbers."""

from __future__ import annotations

import errno
import os
import struct
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

import numpy as np
import soundfile as sf

from algdiff._formats.base import Layout, Options, Place, Samples, Source
from algdiff._formats.stage import Stage
from algdiff._formats.tables import choose

MAGIC = (b"RIFF", b"RIFX", b"RF64", b"riff", b"fLaC", b"FORM")
"""How files begin that are read, or refused by their name."""

FORMATS = ("WAV", "WAVEX", "RF64", "W64", "FLAC")
"""What libsndfile reads sample by sample, and calls so."""

SUBTYPES = {"PCM_S8": 1, "PCM_U8": 1, "PCM_16": 2, "PCM_24": 3, "PCM_32": 4, "FLOAT": 4, "DOUBLE": 8}
"""Kinds of samples without loss, and their bytes."""

PIECE = 4 << 20
"""Bytes that are read at once if some channels are left out."""

CHANNELS = 1024
"""How many libsndfile can handle."""

RATE = 2**31 - 1
"""The largest sampling rate that it can handle, in Hz."""

TOLERANCE = 1e-9
"""How far, as a share, a sampling rate may be from a whole number."""

UNKNOWN = 2**32 - 1
"""The largest number of 32 bits: a size that is not known, or stands elsewhere."""

LARGEST = UNKNOWN
"""The size from which a file is RF64."""


def open_source(path: Path, inner: str | None, options: Options) -> Source:
    """Open the samples for reading."""
    return AudioSource(path, options)


class AudioSource(Source):
    """The channels of a sound file.

    Integers are scaled to [-1, 1), 24 bits and fewer to float64, too: derivatives amplify what float32 rounds.
    Floating-point numbers are what they are, within [-1, 1] or not.
    """

    axis = 0

    def __init__(self, path: Path, options: Options) -> None:
        if options.time is not None:
            raise ValueError(f"time is for a .csv or .parquet file, got {path}")
        super().__init__(path, _opened(path))
        try:
            frames = self._frames()
            self.dtype = np.dtype(np.float32 if self.file.subtype == "FLOAT" else np.float64)
            count = self.file.channels
            chosen, _ = choose(path, options, None, count, range(count))
            self.chosen, self.all = np.array(chosen), chosen == [*range(count)]
            self.shape = (frames,) if len(chosen) == 1 else (frames, len(chosen))
            self.step = 1.0 / self.file.samplerate
        except BaseException:
            self.file.close()
            raise

    def _frames(self) -> int:
        """Return how many samples a channel has; refuse what is not whole or not without loss."""
        file, path = self.file, self.path
        if file.format not in FORMATS:
            raise ValueError(f"{path}: must be a WAV or FLAC file, got {file.format_info}")
        if file.subtype not in SUBTYPES:
            raise ValueError(f"{path}: must hold PCM or floating-point samples, got {file.subtype_info}")
        frames, size = int(file.frames), os.stat(path).st_size
        # Blocks of FLAC, of at most 65535 samples, take at least 8 bytes.
        if file.format == "FLAC" and frames > size // 8 * 65535:
            raise ValueError(f"{path}: must say how many samples it holds, got {frames} in {size} bytes")
        with open(path, "rb") as raw:
            found = _samples(raw)
        if found is not None:
            # libsndfile is content with fewer samples, and takes what follows those of W64 for some more.
            start, length = found
            if start + length > size:
                raise ValueError(f"{path}: {_ends()} (at byte {size} of {start + length})")
            frames = min(frames, length // (SUBTYPES[file.subtype] * int(file.channels)))
        if not frames:
            raise ValueError(f"{path}: must hold samples, got none")
        return frames

    def read(self, place: Place, out: Samples) -> None:
        """Fill `out`."""
        start, stop = place[0].start, place[0].stop
        if start == stop or not out.size:
            return
        columns = self.chosen[place[1]] if len(place) > 1 else self.chosen
        with _telling(self.path):
            self.file.seek(start)
            if self.all and len(columns) == len(self.chosen) and out.flags.c_contiguous:
                self._fill(out)
                return
            length = max(PIECE // (self.file.channels * self.dtype.itemsize), 1)
            piece = np.empty((min(length, stop - start), self.file.channels), self.dtype)
            for done in range(0, stop - start, len(piece)):
                part = piece[: stop - start - done]
                self._fill(part)
                out[done : done + len(part)] = part[:, columns if out.ndim == 2 else columns[0]]

    def _fill(self, out: Samples) -> None:
        if len(self.file.read(out=out)) < len(out):
            raise ValueError(f"{self.path}: {_ends()}")


def _ends() -> str:
    return "ends before its samples do: it was cut off, or is being written"


def _opened(path: Path) -> sf.SoundFile:
    with open(path, "rb") as file:  # of what cannot be opened, errors of the system say more
        start = file.read(4)
    # Of what begins otherwise the decoders of other formats would try to make sense.
    if start not in MAGIC and start[:3] != b"ID3":
        raise ValueError(f"{path}: not a whole WAV or FLAC file (it begins with {start!r})")
    with _telling(path):
        return sf.SoundFile(os.fsencode(path) if os.name == "posix" else str(path))


@contextmanager
def _telling(path: Path) -> Iterator[None]:
    """Let errors of libsndfile name the file in one line."""
    try:
        yield
    except sf.LibsndfileError as error:
        if error.code == 2:  # of the system
            raise OSError(errno.EIO, os.strerror(errno.EIO), str(path)) from None
        said = " ".join(error.error_string.split()).removeprefix("Error : ").rstrip(".") or f"error {error.code}"
        raise ValueError(f"{path}: not a whole WAV or FLAC file ({said})") from None


def _samples(file: BinaryIO) -> tuple[int, int] | None:
    """Return where the samples of a WAV file begin and how many bytes they take, if its header says it."""
    magic = file.read(4)
    if magic not in (b"RIFF", b"RIFX", b"RF64", b"riff"):
        return None
    # Chunks of RIFF begin with four bytes of name and four of size, without these eight; those of W64 with sixteen
    # and eight, and count them. They begin at even places, or those of eight.
    wide = magic == b"riff"
    name, head, own, align = (16, 24, 24, 8) if wide else (4, 8, 0, 2)
    position, large = 40 if wide else 12, None
    while len(chunk := _at(file, position, head)) == head:
        length = int.from_bytes(chunk[name:], "big" if magic == b"RIFX" else "little") - own
        position += head
        if chunk[:4] == b"ds64":
            large = int.from_bytes(_at(file, position + 8, 8), "little")
        if chunk[:4] == b"data" and (wide or length < UNKNOWN):
            return position, max(length, 0)
        if chunk[:4] == b"data":  # to the end of the file, or what RF64 said before
            return None if large is None else (position, large)
        position += max(length + -length % align, 0)
    return None


def _at(file: BinaryIO, position: int, count: int) -> bytes:
    file.seek(position)
    return file.read(count)


def check(path: Path, inner: str | None, layout: Layout) -> None:
    """Raise ValueError for FLAC, more channels than there can be, and rates that are no whole number of Hz."""
    if path.suffix.lower() == ".flac":
        raise ValueError("a .flac OUT would hold integers of at most 24 bits, not derivatives; write .wav")
    _, channels = layout.rows
    if not 1 <= channels <= CHANNELS:
        raise ValueError(f"a .wav OUT must have 1 to {CHANNELS} channels, got {channels}")
    _rate(layout)


def _rate(layout: Layout) -> int:
    if layout.step is None:
        raise ValueError("the sampling rate must be known for a .wav OUT, got none: give delta or fs")
    exact = 1.0 / layout.step
    rate = round(min(exact, 2.0**32))
    if not 1 <= rate <= RATE or abs(exact - rate) > TOLERANCE * rate:
        raise ValueError(f"a .wav OUT must have a whole sampling rate of 1 to {RATE} Hz, got {exact:.12g} Hz")
    return rate


def encode(stage: Stage, path: Path, inner: str | None, layout: Layout) -> None:
    """Write the samples as they are, which are not limited to [-1, 1]; times of the rows are left to the rate.

    Not by libsndfile, which notes the time of writing and does not tell a full disk from other errors.
    """
    rows, channels = layout.rows
    with open(path, "wb") as file:
        file.write(header(rows, channels, layout.dtype, _rate(layout)))
        for numbers, _ in stage.rows():
            file.write(np.ascontiguousarray(numbers, layout.dtype.newbyteorder("<")).data)


def header(frames: int, channels: int, dtype: np.dtype[np.floating], rate: int) -> bytes:
    """Return what stands before the samples of a WAV file: RIFF, or RF64 where its 32 bits do not hold the size."""
    frame = channels * dtype.itemsize
    size = frames * frame
    kind = (3, channels, rate, min(rate * frame, UNKNOWN), frame, 8 * dtype.itemsize, 0)  # 3: floating-point
    about = struct.pack("<4sIHHIIHHH", b"fmt ", 18, *kind) + struct.pack("<4sII", b"fact", 4, min(frames, UNKNOWN))
    rest = 4 + len(about) + 8 + size
    if rest < LARGEST:
        return struct.pack("<4sI4s", b"RIFF", rest, b"WAVE") + about + struct.pack("<4sI", b"data", size)
    large = struct.pack("<4sIQQQI", b"ds64", 28, rest + 36, size, frames, 0)
    return struct.pack("<4sI4s", b"RF64", UNKNOWN, b"WAVE") + large + about + struct.pack("<4sI", b"data", UNKNOWN)
