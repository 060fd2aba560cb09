"""A process that uses the package lives on: absurd sizes, pools, threads, Ctrl-C at any time, and many calls."""

from __future__ import annotations

import json
import multiprocessing
import signal
import threading
from typing import Any

import numpy as np
import pytest

import algdiff
from processes import printed_by
from support import soak

HUGE = 2**45
"""Samples that no machine holds: 256 TiB in double precision."""

# Each is asked for what it cannot give; x and wide are views of one number.
ABSURD = {
    "differentiate": "algdiff.differentiate(x, 101)",
    "mode valid": "algdiff.differentiate(x, 101, mode='valid')",
    "several orders": "algdiff.differentiate(x, 101, (0, 1, 2))",
    "bytes": "algdiff.differentiate(tiny, 101)",
    "columns": "algdiff.differentiate(wide, 101, axis=0)",
    "a window of choice": "algdiff.differentiate(x)",
    "missing samples": "algdiff.differentiate(x, 101, nan_policy='omit')",
    "no missing samples": "algdiff.differentiate(x, 101, nan_policy='raise')",
    "error bars": "algdiff.differentiate(x, 101, return_std=True)",
    "times": "algdiff.differentiate(x, 101, t=x)",
    "a design": "algdiff.Differentiator(101)(x)",
    "a block": "stream.push(x)",
    "a block with gaps": "algdiff.Differentiator(101).stream(nan_policy='omit').push(x)",
    "channels": "algdiff.Differentiator(101).stream(channels=HUGE)",
    "a kernel": "algdiff.Kernel(1, 3)(x)",
    "a response": "algdiff.Differentiator(101).frequency_response(x)",
    "gradient": "algdiff.gradient(x)",
    "gradient of a window": "algdiff.gradient(x, window_length=101)",
    "partial": "algdiff.partial(wide, (1, 0), window_length=101)",
    "laplacian": "algdiff.laplacian(wide, window_length=101)",
    "hessian": "algdiff.hessian(wide, window_length=101)",
    "savgol_filter": "algdiff.savgol_filter(x, 101, 3)",
    "noise_level": "algdiff.noise_level(x)",
}
WINDOWS = {
    "a window": "algdiff.Differentiator(HUGE)",
    "coefficients": "algdiff.savgol_coeffs(HUGE, 3)",
    "a duration": "algdiff.Differentiator.from_duration(float(HUGE))",
}


def test_absurd_sizes_are_errors_and_the_process_computes_on() -> None:
    printed = printed_by(f"""
        import json, signal
        import numpy as np
        import algdiff

        HUGE = {HUGE}
        x, tiny = np.broadcast_to(1.0, (HUGE,)), np.broadcast_to(np.int8(1), (HUGE,))
        wide = np.broadcast_to(1.0, (2**22, 2**23))
        samples = np.random.default_rng(0).standard_normal(1000)
        stream = algdiff.Differentiator(101).stream()
        stream.push(samples)
        before, expected, found = stream.copy(), algdiff.differentiate(samples, 101).tobytes(), {{}}
        signal.alarm(40)
        for name, call in {ABSURD | WINDOWS}.items():
            try:
                eval(call)
            except Exception as error:
                found[name] = type(error).__name__
            assert algdiff.differentiate(samples, 101).tobytes() == expected, name
        assert stream.push(1.0) == before.push(1.0)
        print(json.dumps(found))
    """)
    assert json.loads(printed) == {**dict.fromkeys(ABSURD, "MemoryError"), **dict.fromkeys(WINDOWS, "ValueError")}


def _pushed(work: tuple[algdiff.Stream, np.ndarray[Any, Any]]) -> tuple[bytes, bytes, dict[str, Any]]:
    stream, x = work
    new = algdiff.Differentiator(101, engine="direct").stream(threads=2)
    return new.push(x).tobytes(), stream.push(x).tobytes(), stream.state


@pytest.mark.parametrize("method", ["fork", "spawn", "forkserver"])
@pytest.mark.filterwarnings("ignore:This process:DeprecationWarning")
def test_streams_in_pools_of_every_kind(method: str) -> None:
    blocks = np.random.default_rng(0).standard_normal((4, 100_000))
    streams = [algdiff.Differentiator(101, engine="direct").stream(threads=2, warmup="grow") for _ in blocks]
    for stream in streams:  # threads have run before
        stream.push(blocks[0])
    with multiprocessing.get_context(method).Pool(2) as pool:
        found = pool.map_async(_pushed, list(zip(streams, blocks, strict=True))).get(timeout=100)
    expected = [_pushed(work) for work in zip(streams, blocks, strict=True)]
    assert [one[:2] for one in found] == [one[:2] for one in expected]
    assert repr([one[2] for one in found]) == repr([one[2] for one in expected])


THREADS, CALLS = 8, 200


def test_python_threads_get_the_same_bits() -> None:
    x = np.sin(np.arange(3000) / 40) + 0.1 * np.random.default_rng(0).standard_normal(3000)
    shared = algdiff.Differentiator(20, tau="root")

    def results(turn: int) -> list[bytes]:
        # Windows change from call to call, so that designs that are remembered are replaced while others use them.
        length = 11 + turn % 67
        stream = algdiff.Differentiator(length).stream(warmup="grow")
        found = [algdiff.differentiate(x, length), algdiff.savgol_filter(x, length, 3), shared(x), stream.push(x)]
        if turn % 20 == 0:
            found.append(np.array(algdiff.suggest(x).differentiator.weights))
        return [one.tobytes() for one in found]

    expected = [results(turn) for turn in range(CALLS)]
    failures: list[tuple[int, int]] = []
    begin = threading.Barrier(THREADS)

    def work(number: int) -> None:
        begin.wait()
        turns = np.random.default_rng(number).permutation(CALLS).tolist()
        failures.extend((number, turn) for turn in turns if results(turn) != expected[turn])

    threads = [threading.Thread(target=work, args=(number,)) for number in range(THREADS)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert failures == []


@pytest.mark.skipif(not hasattr(signal, "setitimer"), reason="sends SIGINT")
def test_ctrl_c_at_random_times() -> None:
    printed = printed_by(f"""
        import json, os, signal, threading, time
        import numpy as np
        import algdiff

        rng = np.random.default_rng(3)
        signal.signal(signal.SIGINT, signal.default_int_handler)
        direct = algdiff.Differentiator(4001, engine="direct")
        stream, short = direct.stream(threads=2), rng.standard_normal(9000)
        recent = stream.push(short)[4000:].tobytes()
        expected = direct(short).tobytes()
        x, out = rng.standard_normal(3_000_000), np.empty(3_000_000)
        columns, gaps = x.reshape(3000, 1000), np.where(np.arange(len(x)) % 90, x, np.nan)
        wide, image = algdiff.Differentiator(999), algdiff.Differentiator(2001, kappa=0.5, mu=0.5)
        calls = [
            lambda: direct(x, out=out, threads=1),
            lambda: algdiff.Differentiator(501, engine="direct")(columns, axis=0, out=out.reshape(columns.shape)),
            lambda: wide(x, out=out),
            lambda: image(x, out=out, threads=2),
            lambda: algdiff.Differentiator(501)(gaps, nan_policy="omit"),
            lambda: stream.push(x),
            lambda: algdiff.Kernel(1, 100)(out),
            lambda: algdiff.Differentiator(2_000_000, degree=10),
            lambda: algdiff.suggest(x[:300_000]),
        ]
        sent, latencies = [], []

        def interrupt(after):
            time.sleep(after)
            sent.append(time.perf_counter())
            os.kill(os.getpid(), signal.SIGINT)

        for turn in range({soak(20, 200)}):
            call, before = calls[turn % len(calls)], len(sent)
            sender = threading.Thread(target=interrupt, args=(rng.uniform(0, 0.1),))
            try:
                sender.start()
                # What is not heard by then is lost.
                while len(sent) == before or time.perf_counter() < sent[-1] + 4:
                    call()
            except KeyboardInterrupt:
                latencies.append(time.perf_counter() - sent[-1])
            sender.join()
            assert direct(short).tobytes() == expected
            # A block was taken whole or not at all, and the window is what was pushed last.
            assert stream.count % len(x) == (turn + 1) * len(short) % len(x)
            assert stream.push(short)[4000:].tobytes() == recent
            out[...] = 1.0
            assert not np.any(wide(out[:2000]))
        print(json.dumps(latencies))
    """)
    latencies = json.loads(printed)
    assert len(latencies) == soak(20, 200)
    # None is lost. The machine may be busy: half of the times count.
    assert np.median(latencies) <= 0.25, latencies


def test_what_progress_raises_is_raised_to_the_last() -> None:
    # One thread waits for the other, and asks once more when all is done: what it hears then counts as well.
    design, x = algdiff.Differentiator(30_001, engine="direct"), np.zeros(30_000 + 5 * 8192)
    ends: list[str] = []

    def progress(fraction: float) -> None:
        if fraction >= 1:
            ends.append("raised")
            raise ZeroDivisionError

    for _ in range(10):
        try:
            design(x, mode="valid", threads=2, progress=progress)
        except ZeroDivisionError:
            ends.append("heard")
    assert ends.count("heard") == ends.count("raised")


def test_calls_take_no_memory_that_stays() -> None:
    printed = printed_by(f"""
        import gc, resource
        import numpy as np
        import algdiff

        row = np.random.default_rng(0).standard_normal(200)
        x, gaps, huge = np.stack([row] * 3), np.where(np.arange(200) == 7, np.nan, row), np.broadcast_to(1.0, ({HUGE},))

        def refused(error, *words):
            try:
                algdiff.differentiate(*words)
            except error:
                return
            raise AssertionError

        KINDS = [
            lambda turn: algdiff.differentiate(row, 11 + turn % 50),
            lambda turn: algdiff.differentiate(gaps, 11, nan_policy="omit", return_std=True),
            lambda turn: algdiff.savgol_filter(x, 12, 3, axis=-1, mode="wrap"),
            lambda turn: algdiff.gradient(x, 0.5, axis=1, window_length=11),
            lambda turn: algdiff.Differentiator(11 + turn % 7, degree=3)(row),
            lambda turn: algdiff.Differentiator(11).stream(warmup="grow").push(row),
            lambda turn: algdiff.Kernel(1, 3)(x),
            lambda turn: algdiff.noise_level(row),
            lambda turn: refused(ValueError, row, 1100),
            lambda turn: refused(MemoryError, huge, 11),
        ]

        def resident():
            gc.collect()
            return int(open("/proc/self/statm").read().split()[1]) * resource.getpagesize()

        def calls(count):
            for turn in range(count // len(KINDS)):
                for kind in KINDS:
                    kind(turn)

        calls(2000)
        before = resident()
        calls({soak(5000, 50_000)})
        print(resident() - before)
    """)
    # Of 5000 calls, 210 bytes each; of 50,000, 21.
    assert int(printed) <= 2**20, printed
