"""Sound files: every kind of sample against libsndfile and SciPy, headers that lie, and WAV of any size."""

from __future__ import annotations

import os
import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.io import wavfile

from algdiff import _formats as formats
from algdiff._formats.base import Layout, Options
from algdiff._formats.stage import Stage

sf = pytest.importorskip("soundfile")
audio = pytest.importorskip("algdiff._formats.audio")

RATE = 8000
KINDS = [
    *[
        (form, kind)
        for form in ("WAV", "WAVEX", "RF64", "W64")
        for kind in ("PCM_U8", "PCM_16", "PCM_24", "PCM_32", "FLOAT", "DOUBLE")
    ],
    *[("FLAC", kind) for kind in ("PCM_S8", "PCM_16", "PCM_24")],
]
BITS = {"PCM_U8": 8, "PCM_S8": 8, "PCM_16": 16, "PCM_24": 24, "PCM_32": 32}


@pytest.fixture(autouse=True)
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(audio, "PIECE", 1000)


def samples(kind: str, shape: tuple[int, ...], seed: int = 1) -> np.ndarray:
    """Return numbers that a kind of samples holds exactly; floating-point ones beyond [-1, 1]."""
    rng = np.random.default_rng(seed)
    if kind in BITS:
        most = 2 ** (BITS[kind] - 1)
        return rng.integers(-most, most, shape) / most
    return (1e3 * rng.standard_normal(shape)).astype("f4" if kind == "FLOAT" else "f8")


def opened(data: Any, form: str = "WAV", kind: str = "DOUBLE", **options: Any) -> Any:
    name = "x.flac" if form == "FLAC" else "x.wav"
    # libsndfile rounds what it scales to integers: these are given, in the highest bits.
    given = (data * 2.0**31).astype(np.int64).astype(np.int32) if kind in BITS else data
    sf.write(name, given, RATE, format=form, subtype=kind)
    return source_of(name, **options)


def source_of(name: str, **options: Any) -> Any:
    return formats.open_source(formats.located("src", name), Options(**options))


def read(source: Any, start: int, stop: int, *channels: slice, order: Any = "C") -> np.ndarray:
    place = (slice(start, stop), *(channels or (slice(0, extent) for extent in source.shape[1:])))
    out = np.full([one.stop - one.start for one in place], np.nan, source.dtype, order=order)
    assert source.read(place, out) is None
    return out


def error_of(name: str, **options: Any) -> str:
    with pytest.raises(ValueError, match=r".") as info:
        source_of(name, **options)
    said = str(info.value)
    assert name in said
    assert "\n" not in said
    return said


# --- reading -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("channels", [1, 3])
@pytest.mark.parametrize(("form", "kind"), KINDS)
def test_every_kind_is_read_exactly(form, kind, channels):
    rng = np.random.default_rng(channels)
    data = samples(kind, (9000, channels)[: 1 if channels == 1 else 2])
    with opened(data, form, kind) as source:
        assert source.file.format == form
        assert (source.shape, source.axis, source.step) == (data.shape, 0, 1 / RATE)
        assert source.step_along(0) == 1 / RATE
        assert source.dtype == ("f4" if kind == "FLOAT" else "f8")
        assert (source.names, source.time, source.fortran, source.chunks) == (None, None, False, None)
        np.testing.assert_array_equal(read(source, 0, 9000), data)
        for _ in range(20):
            start, stop = sorted(rng.integers(0, 9001, 2).tolist())
            np.testing.assert_array_equal(read(source, start, stop, order=rng.choice(["C", "F"])), data[start:stop])


@pytest.mark.parametrize("form", ["WAV", "FLAC"])
def test_overlapping_blocks_and_ranges_of_channels(form):
    data = samples("PCM_16", (9000, 5))
    with opened(data, form, "PCM_16") as source:
        for channels in (slice(0, 5), slice(1, 3), slice(4, 5), slice(2, 2)):
            for start in range(0, 8900, 900):
                stop = min(start + 1000, 9000)
                np.testing.assert_array_equal(read(source, start, stop, channels), data[start:stop, channels])


@pytest.mark.parametrize(
    ("columns", "positions"),
    [(("0", "2"), [0, 2]), (("2", "0", "2"), [2, 0, 2]), (("1",), 1), (("1", "2", "0"), [1, 2, 0])],
)
def test_chosen_channels(columns, positions):
    data = samples("DOUBLE", (700, 3))
    with opened(data, columns=columns) as source:
        expected = data[:, positions]
        assert source.shape == expected.shape
        np.testing.assert_array_equal(read(source, 0, 700), expected)
        np.testing.assert_array_equal(read(source, 33, 500), expected[33:500])
        if expected.ndim == 2:
            np.testing.assert_array_equal(read(source, 33, 500, slice(1, 2)), expected[33:500, 1:2])


def test_channels_that_are_not_there():
    sf.write("x.wav", np.zeros((9, 2)), RATE)
    for column in ("2", "left", "-1"):
        assert error_of("x.wav", columns=(column,)).endswith(f"columns of x.wav (0 to 1), got {column!r}")
    assert error_of("x.wav", time="0") == "time is for a .csv or .parquet file, got x.wav"


def test_big_endian_and_names_that_are_no_text():
    data = samples("PCM_24", (100, 2))
    name = os.fsdecode(b"x\xff.wav") if os.name == "posix" else "x.wav"
    with open(name, "wb") as file:
        ints = (data * 2.0**31).astype(np.int32)
        sf.write(file, ints, RATE, format="WAV", subtype="PCM_24", endian="BIG")
    assert Path(name).read_bytes()[:4] == b"RIFX"
    with source_of(name) as source:
        np.testing.assert_array_equal(read(source, 0, 100), data)
    whole = Path(name).read_bytes()
    Path("cut.wav").write_bytes(whole[:-1])
    assert "cut off" in error_of("cut.wav")


# --- files that are not what they say ----------------------------------------------------------------------------


@pytest.mark.parametrize(
    "content", [b"", b"RIFF", b"1,2\n3,4\n", bytes(100), b"RIFF\x24\0\0\0WAVEfmt \x10\0\0\0", b"fLaC" + bytes(60)]
)
@pytest.mark.parametrize("name", ["x.wav", "x.flac"])
def test_what_is_no_sound(name, content):
    Path(name).write_bytes(content)
    assert error_of(name).startswith(f"{name}: not a whole WAV or FLAC file (")


def test_files_that_are_not_there():
    with pytest.raises(FileNotFoundError) as info:
        source_of("x.wav")
    assert info.value.filename == "x.wav"
    Path("x.wav").mkdir()
    with pytest.raises(IsADirectoryError):
        source_of("x.wav")


@pytest.mark.parametrize(("form", "kind"), [one for one in KINDS if one[0] != "FLAC"])
def test_every_cut_is_seen(form, kind):
    data = samples(kind, (20, 3))
    opened(data, form, kind).close()
    whole = Path("x.wav").read_bytes()
    with open("x.wav", "rb") as file:
        start, length = audio._samples(file)
    assert length == 60 * {"FLOAT": 32, "DOUBLE": 64, **BITS}[kind] // 8
    assert len(whole) - 8 < start + length <= len(whole)
    for cut in range(0, start + length, 1 if form == "RF64" else 7):
        Path("x.wav").write_bytes(whole[:cut])
        said = error_of("x.wav")
        assert said.startswith("x.wav: ends before its samples do" if cut > start + length // 2 else "x.wav: ")
    # What follows are no samples; libsndfile takes some of it for those of W64.
    Path("x.wav").write_bytes(whole + b"more of something that is longer than one sample of every channel")
    with source_of("x.wav") as source:
        np.testing.assert_array_equal(read(source, 0, source.shape[0]), data)


@pytest.mark.parametrize("form", ["WAV", "RF64", "W64"])
def test_chunks_before_the_samples(form):
    data = samples("DOUBLE", (20, 2))
    opened(data, form).close()
    whole = Path("x.wav").read_bytes()
    place = whole.index(b"data")
    # Of odd length, so that the next begins a few bytes later; libsndfile cannot do that in RF64.
    if form == "W64":
        more = b"junk" + whole[place + 4 : place + 16] + struct.pack("<Q", 24 + 3) + b"abc" + bytes(5)
    elif form == "RF64":
        more = b"JUNK" + struct.pack("<I", 4) + b"abcd"
    else:
        more = b"JUNK" + struct.pack("<I", 3) + b"abc" + bytes(1)
    Path("x.wav").write_bytes(whole[:place] + more + whole[place:])
    with source_of("x.wav") as source:
        np.testing.assert_array_equal(read(source, 0, 20), data)
    with open("x.wav", "r+b") as file:
        start, length = audio._samples(file)
        assert length == data.nbytes
        file.truncate(start + length - 1)
    assert "ends before its samples do" in error_of("x.wav")


def test_a_length_that_is_left_open_goes_to_the_end():
    data = samples("DOUBLE", (50, 2))
    opened(data).close()
    whole = Path("x.wav").read_bytes()
    place = whole.index(b"data") + 4
    Path("x.wav").write_bytes(whole[:4] + b"\xff" * 4 + whole[8:place] + b"\xff" * 4 + whole[place + 4 :])
    with source_of("x.wav") as source:
        np.testing.assert_array_equal(read(source, 0, 50), data)


@pytest.mark.parametrize("kind", ["PCM_16", "DOUBLE"])
def test_a_file_that_shrinks_while_it_is_read(kind):
    with opened(samples(kind, (40_000, 2)), kind=kind) as source:
        read(source, 0, 40_000)
        os.truncate("x.wav", os.path.getsize("x.wav") // 2)
        read(source, 0, 10_000)
        for channels in (slice(0, 2), slice(0, 1)):
            with pytest.raises(ValueError, match=r"^x\.wav: ends before its samples do: it was cut off"):
                read(source, 19_000, 21_000, channels)


def test_broken_flac():
    data = samples("PCM_16", (50_000, 2))
    opened(data, "FLAC", "PCM_16").close()
    whole = Path("x.flac").read_bytes()
    half = len(whole) // 2
    for broken in (whole[:half], whole[:half] + bytes(200) + whole[half + 200 :]):
        Path("x.flac").write_bytes(broken)
        with source_of("x.flac") as source:
            np.testing.assert_array_equal(read(source, 0, 10_000), data[:10_000])
            with pytest.raises(ValueError, match=r"^x\.flac: (not a whole WAV or FLAC file \(|ends before)"):
                read(source, 0, 50_000)


@pytest.mark.parametrize("count", [0, 2**36 - 1])
def test_flac_must_say_how_long_it_is(count):
    opened(samples("PCM_16", (5000,)), "FLAC", "PCM_16").close()
    content = bytearray(Path("x.flac").read_bytes())
    # The last 36 bits of eight bytes of the first block, after its 4 and the file's 4.
    (packed,) = struct.unpack(">Q", content[18:26])
    content[18:26] = struct.pack(">Q", packed >> 36 << 36 | count)
    Path("x.flac").write_bytes(content)
    assert "must say how many samples it holds" in error_of("x.flac")


def test_nothing_else_is_taken():
    sf.write("x.wav", np.zeros((0, 2)), RATE)
    assert error_of("x.wav") == "x.wav: must hold samples, got none"
    for kind in ("IMA_ADPCM", "ULAW"):
        sf.write("x.wav", np.zeros(1000), RATE, subtype=kind)
        assert "must hold PCM or floating-point samples, got " in error_of("x.wav")
    sf.write("x.wav", np.zeros(1000), RATE, format="AIFF")
    assert "must be a WAV or FLAC file, got AIFF" in error_of("x.wav")


# --- writing -----------------------------------------------------------------------------------------------------


def layout(data: np.ndarray, **more: Any) -> Layout:
    given = {"shape": data.shape, "axis": 0, "orders": (1,), "leading": False, "dtype": data.dtype, "step": 1 / RATE}
    return Layout(**{**given, **more})


def written(rows: np.ndarray, plan: Layout) -> bytes:
    place = formats.located("dst", "y.wav")
    formats.check(place, plan)
    stage = Stage(Path("y.partial"), plan, table=True)
    for start in range(0, len(rows), 70):
        part = slice(start, min(start + 70, len(rows)))
        stage.write((part,), rows[part], None if plan.time is None else np.arange(start, part.stop, dtype=float))
    formats.encode(place, stage, Path("y.encoded"), plan)
    stage.close()
    os.replace("y.encoded", "y.wav")
    return Path("y.wav").read_bytes()


@pytest.mark.parametrize("form", ["RIFF", "RF64"])
@pytest.mark.parametrize("shape", [(1,), (999,), (999, 1), (500, 7)])
@pytest.mark.parametrize("dtype", ["f4", "f8"])
def test_every_number_is_kept(dtype, shape, form, monkeypatch):
    monkeypatch.setattr("algdiff._formats.stage.BYTES", 700)
    if form == "RF64":
        monkeypatch.setattr(audio, "LARGEST", 0)
    rng = np.random.default_rng(3)
    data = (10.0 ** rng.uniform(-30, 30, shape) * rng.choice([-1, 1], shape)).astype(dtype)
    data.flat[:3] = [-0.0, np.nan, np.inf][: data.size]
    content = written(data.reshape(len(data), -1), layout(data))
    assert content[:4] == form.encode()
    with source_of("y.wav") as source:
        assert (source.file.subtype, source.file.samplerate) == ({"f4": "FLOAT", "f8": "DOUBLE"}[dtype], RATE)
        assert source.dtype == dtype
        flat = data[:, 0] if data.shape[1:] == (1,) else data
        assert read(source, 0, len(data)).tobytes() == flat.tobytes()
    rate, other = wavfile.read("y.wav")
    assert (rate, other.dtype, other.tobytes()) == (RATE, data.dtype, data.tobytes())


def test_all_bytes_are_decided_by_the_numbers():
    data = samples("DOUBLE", (100, 2))
    content = written(data, layout(data))
    assert len(content) == 58 + data.nbytes
    assert content[58:] == data.tobytes()
    assert b"PEAK" not in content
    about = struct.unpack("<4sI4s4sIHHIIHHH4sII4sI", content[:58])
    assert about[:4] == (b"RIFF", len(content) - 8, b"WAVE", b"fmt ")
    assert about[4:12] == (18, 3, 2, RATE, RATE * 16, 16, 64, 0)
    assert about[12:] == (b"fact", 4, 100, b"data", data.nbytes)


def test_orders_and_channels_side_by_side_without_their_times():
    data = samples("DOUBLE", (200, 6))
    plan = layout(data[:, :2], orders=(0, 1, 2), leading=True, time="t", time_dtype=np.dtype(float))
    written(data, plan)
    with source_of("y.wav") as source:
        np.testing.assert_array_equal(read(source, 0, 200), data)
    # Time along the last axis.
    plan = layout(data[:, :2].T, axis=1)
    written(data[:, :2], plan)
    with source_of("y.wav") as source:
        np.testing.assert_array_equal(read(source, 0, 200), data[:, :2])


@pytest.mark.parametrize(("dtype", "channels"), [("f4", 1), ("f8", 3)])
def test_rf64_from_4_gib(dtype, channels):
    frame = np.dtype(dtype).itemsize * channels
    last = (2**32 - 1 - 1 - 50) // frame  # 50 bytes of the header count
    small, large = (audio.header(frames, channels, np.dtype(dtype), RATE) for frames in (last, last + 1))
    assert (small[:4], large[:4]) == (b"RIFF", b"RF64")
    assert struct.unpack("<I", small[-4:]) == (last * frame,)
    assert struct.unpack("<I", small[4:8]) == (last * frame + 50,)
    assert struct.unpack("<QQQ", large[20:44]) == ((last + 1) * frame + len(large) - 8, (last + 1) * frame, last + 1)
    for content, frames in ((small, last), (large, last + 1), (None, 2**32 + 5)):
        content = content or audio.header(frames, channels, np.dtype(dtype), RATE)
        with open("x.wav", "wb") as file:
            file.write(content)
            file.truncate(len(content) + frames * frame)  # takes no room
            file.seek(-8, os.SEEK_END)
            file.write(b"\x40" * 8)
        with source_of("x.wav") as source:
            assert source.shape == ((frames,) if channels == 1 else (frames, channels))
            end = read(source, frames - 20, frames)
            np.testing.assert_array_equal(end.ravel()[-8 // end.itemsize :].view("u1"), 0x40)
            assert not end[0].any()
        os.truncate("x.wav", os.path.getsize("x.wav") - 1)
        assert "ends before its samples do" in error_of("x.wav")


@pytest.mark.parametrize(
    ("step", "rate"),
    [(1 / 44100, 44100), (1.0, 1), (1e-9, 10**9), (1 / (2**31 - 1), 2**31 - 1), (1e-3 * (1 + 5e-10), 1000)],
)
def test_rates(step, rate):
    data = samples("DOUBLE", (30, 2))
    written(data, layout(data, step=step))
    with source_of("y.wav") as source:
        assert source.file.samplerate == rate
        np.testing.assert_array_equal(read(source, 0, 30), data)
    assert wavfile.read("y.wav")[0] == rate


@pytest.mark.parametrize(
    ("name", "more", "said"),
    [
        ("y.wav", {"step": None}, "the sampling rate must be known for a .wav OUT, got none: give delta or fs"),
        ("y.wav", {"step": 2.0}, "a .wav OUT must have a whole sampling rate of 1 to 2147483647 Hz, got 0.5 Hz"),
        ("y.wav", {"step": 3e-3}, "a whole sampling rate of 1 to 2147483647 Hz, got 333.333333333 Hz"),
        ("y.wav", {"step": 1e-3 * (1 + 2e-9)}, "got 999.999998 Hz"),
        ("y.wav", {"step": 2.0**-31}, "got 2147483648 Hz"),
        ("y.wav", {"step": 1e-300}, "got 1e+300 Hz"),
        ("y.wav", {"step": 5e-324}, "got inf Hz"),
        ("y.wav", {"step": 1e300}, "got 1e-300 Hz"),
        ("y.wav", {"shape": (9, 1025)}, "a .wav OUT must have 1 to 1024 channels, got 1025"),
        ("y.wav", {"shape": (9, 342), "orders": (0, 1, 2), "leading": True}, "got 1026"),
        ("y.wav", {"shape": (9, 0)}, "a .wav OUT must have 1 to 1024 channels, got 0"),
        ("y.wav", {"shape": (9, 2, 2)}, "a .wav OUT must have one or two dimensions, got shape (9, 2, 2)"),
        ("y.wav", {"dtype": np.dtype("c16")}, "a .wav OUT must hold real numbers, got dtype complex128"),
        ("y.flac", {}, "a .flac OUT would hold integers of at most 24 bits, not derivatives; write .wav"),
    ],
)
def test_what_wav_cannot_hold(name, more, said):
    with pytest.raises(ValueError, match=r".") as info:
        formats.check(formats.located("dst", name), layout(np.zeros((9, 2)), **more))
    assert said in str(info.value)


def test_as_many_channels_as_there_can_be():
    data = samples("FLOAT", (5, 1024))
    written(data, layout(data))
    with source_of("y.wav") as source:
        np.testing.assert_array_equal(read(source, 1, 4), data[1:4])


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="needs /dev/full")
def test_full_disk_is_an_error_of_the_system():
    data = samples("DOUBLE", (20_000, 2))
    stage = Stage(Path("y.partial"), layout(data), table=True)
    stage.write((slice(0, len(data)),), data)
    with pytest.raises(OSError, match="No space left") as info:
        audio.encode(stage, Path("/dev/full"), None, layout(data))
    stage.close()
    assert info.value.errno is not None


@pytest.mark.parametrize("start", [b"\xff\xfb\x90\x00", b"OggS", b"MThd", b"", b"\x00"])
def test_decoders_of_other_formats_are_not_asked(start: bytes, capfd: pytest.CaptureFixture[str]) -> None:
    Path("x.wav").write_bytes(start + bytes(5000))
    assert "not a whole WAV or FLAC file (it begins with" in error_of("x.wav")
    assert capfd.readouterr().err == ""
