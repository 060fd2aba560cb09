"""What a long-running process may rely on: threads, Ctrl-C, forks, memory, and the interpreter left free."""

from __future__ import annotations

import threading
import time
from typing import Any

import numpy as np
import pytest

from algdiff import Differentiator
from processes import assert_ctrl_c_is_heard, printed_by

# Threads.


@pytest.mark.parametrize("fitted", [False, True])
def test_many_threads_push_one_after_the_other(fitted: bool) -> None:
    # Every block ascends by 1, so that the differences within it say whether another push came between.
    one = Differentiator(2, degree=1, tau="newest", kappa=0, mu=0)
    stream = one.stream(nan_policy="omit" if fitted else "propagate", warmup="grow" if fitted else "nan")
    failures: list[Any] = []

    def work(number: int) -> None:
        for block in range(150):
            length = [1, 7, 60, 5000][block % 4]
            start = float(1e6 * number + 1e4 * block)
            found = stream.push(start + np.arange(length))
            stream.push(-1.0)
            assert stream.count >= length + 1
            state = stream.state
            if not (found[1:] == 1).all() or len(state["samples"]) != 2 or not np.isfinite(stream.std):
                failures.append((number, block, found, state))

    threads = [threading.Thread(target=work, args=(number,)) for number in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert not failures
    assert stream.count == 8 * sum([1, 7, 60, 5000][block % 4] + 1 for block in range(150))
    assert stream.push(0.0) == 1.0  # all pushed a -1 last


@pytest.mark.parametrize("words", [{}, {"nan_policy": "omit"}])
def test_the_interpreter_is_free_during_a_block(words: dict[str, Any]) -> None:
    one, x = Differentiator(4001, engine="direct"), np.zeros(3_000_000)
    if words:  # fits take longer
        one, x = Differentiator(201), np.zeros(60_000)
        x[::100] = np.nan
    stream = one.stream(threads=1, **words)
    stream.push(x[:5000])
    done, ticks = threading.Event(), 0

    def work() -> None:
        stream.push(x)
        done.set()

    worker = threading.Thread(target=work)
    started = time.perf_counter()
    worker.start()
    while not done.is_set():
        time.sleep(0.001)
        ticks += 1
    elapsed = time.perf_counter() - started
    worker.join()
    assert elapsed > 0.05
    # Held for the whole block, the interpreter would let this thread tick a few times only.
    assert ticks > 100 * elapsed


def test_threads_wait_for_a_block() -> None:
    stream = Differentiator(4001, engine="direct").stream(threads=1)
    worker = threading.Thread(target=lambda: stream.push(np.zeros(2_000_000)))
    worker.start()
    while worker.is_alive() and stream.count == 0:
        pass  # the first call that finds the block under way comes back when it is done
    assert stream.count == 2_000_000
    stream.push(1.0)
    worker.join()
    assert stream.count == 2_000_001


def test_number_of_threads_of_a_block(monkeypatch: pytest.MonkeyPatch) -> None:
    x = np.random.default_rng(0).standard_normal((50_000, 3))
    one = Differentiator(31, engine="direct")
    wanted = one.stream(channels=3).push(x)
    for threads in (1, 2, 7):
        np.testing.assert_array_equal(one.stream(channels=3, threads=threads).push(x), wanted)
    limited = one.stream(channels=3, threads=1)
    monkeypatch.setenv("ALGDIFF_NUM_THREADS", "two")
    with pytest.raises(ValueError, match=r"^ALGDIFF_NUM_THREADS must be a positive integer, got 'two'"):
        one.stream(channels=3).push(x)
    np.testing.assert_array_equal(limited.push(x), wanted)


# Ctrl-C, and other signals.

BLOCKS = {
    "one channel": ("direct(4001).stream(threads=1)", "np.zeros(10_000_000)", "{}"),
    "two threads": ("direct(4001).stream(threads=2)", "np.zeros(10_000_000)", "{}"),
    "channels": ("direct(2001).stream(channels=200)", "np.zeros((40_000, 200))", "{}"),
    "gaps": ("direct(501).stream(nan_policy='omit')", "np.where(np.arange(4_000_000) % 90, 1.0, np.nan)", "{}"),
    "times": ("direct(501).stream()", "np.zeros(2_000_000)", "{'t': 2e3 + np.arange(2e6) ** 1.01}"),
    "std": ("direct(4001).stream()", "np.zeros(10_000_000)", "{'return_std': True}"),
}


@pytest.mark.parametrize("case", BLOCKS)
def test_ctrl_c_leaves_the_stream_as_it_was(case: str) -> None:
    stream, block, options = BLOCKS[case]
    code = f"""
        stream, x, options = {stream}, {block}, {options}
        times = {{"t": np.arange(1000) ** 1.01}} if "t" in options else {{}}
        stream.push(np.random.default_rng(0).standard_normal((1000, *x.shape[1:])), **times)
        before = stream.state
        threading.Thread(target=interrupt).start()
        try:
            stream.push(x, **options)
        except KeyboardInterrupt:
            print(time.perf_counter() - sent)
        else:
            print("finished")
        assert repr(stream.state) == repr(before)
        again = algdiff.Stream.from_state(before)
        options = {{"t": options["t"][:500]}} if "t" in options else {{}}
        a, b = (one.push(x[:500], **options) for one in (stream, again))
        assert a.tobytes() == b.tobytes()
        assert stream.count == 1500
    """
    assert_ctrl_c_is_heard(code)


@pytest.mark.parametrize("x", ["1.0", "np.zeros(10)", "[1.0, 2.0]"])
def test_ctrl_c_is_heard_while_another_thread_takes_a_block(x: str) -> None:
    assert_ctrl_c_is_heard(f"""
        stream = direct(4001).stream(threads=1)
        threading.Thread(target=stream.push, args=(np.zeros(10_000_000),), daemon=True).start()
        time.sleep(0.1)
        threading.Thread(target=interrupt).start()
        try:
            stream.push({x})
        except KeyboardInterrupt:
            print(time.perf_counter() - sent, flush=True)
        else:
            print("finished", flush=True)
        os._exit(0)
    """)


def test_a_signal_handler_cannot_use_the_stream_that_takes_a_block() -> None:
    printed = printed_by("""
        import signal
        import numpy as np
        import algdiff

        stream = algdiff.Differentiator(4001, engine="direct").stream(threads=1)
        other = algdiff.Differentiator(5).stream()

        def handler(*_):
            other.push(1.0)
            for call in (lambda: stream.push(1.0), lambda: stream.push([1.0]), lambda: stream.count, stream.reset):
                try:
                    call()
                except RuntimeError as error:
                    print("refused:", error)

        signal.signal(signal.SIGALRM, handler)
        signal.setitimer(signal.ITIMER_REAL, 0.05)
        stream.push(np.zeros(3_000_000))
        print(stream.count, other.count)
    """)
    lines = printed.splitlines()
    assert len(lines) == 5, printed
    assert all(line.startswith("refused: the stream is used by a signal handler") for line in lines[:4])
    assert lines[-1] == "3000000 1"


def test_a_forked_child_goes_on() -> None:
    printed_by("""
        import os, signal
        import numpy as np
        import algdiff

        x = np.random.default_rng(0).standard_normal(2_000_000)
        stream = algdiff.Differentiator(101, engine="direct").stream(threads=2, warmup="grow")
        stream.push(x)
        child = os.fork()
        if child:
            assert os.waitpid(child, 0)[1] == 0
        else:
            signal.alarm(60)
        same = stream.copy()
        found = stream.push(x)
        good = found[:300].tobytes() == np.array([same.push(sample) for sample in x[:300]]).tobytes()
        if not child:
            os._exit(0 if good and stream.count == 4_000_000 else 1)
        assert good
    """)


# Memory.


def test_streams_and_pushes_do_not_leak() -> None:
    printed = printed_by("""
        import gc, json, resource
        import numpy as np
        import algdiff

        one, vector = algdiff.Differentiator(11, (0, 1)), np.ones(3)
        kinds = [{}, {"channels": 3}, {"warmup": "grow"}, {"nan_policy": "omit", "channels": 3}, {"dtype": "f4"}]

        def resident():
            gc.collect()
            return int(open("/proc/self/statm").read().split()[1]) * resource.getpagesize()

        def calls(streams, pushes):
            for number in range(streams):
                stream = one.stream(**kinds[number % 5])
                stream.push(vector if stream.channels is None else [vector])
                algdiff.Stream.from_state(stream.state).copy()
                try:
                    stream.push("one")
                except TypeError:
                    pass
            lasting = [one.stream(**kind) for kind in kinds]
            clock = one.stream()
            for number in range(pushes // 5):
                for stream in lasting:
                    stream.push(np.nan if stream.channels is None else vector)
                for stream in lasting[:2]:
                    stream.push(number if stream.channels is None else [1, 2, 3], return_std=True)
                for stream in lasting[:2]:
                    stream.std, stream.time
                clock.push(1.0, t=float(number))

        calls(100, 2000)
        before = resident()
        calls(1000, 200_000)
        print(resident() - before)
    """)
    assert int(printed) < 2_000_000


def test_a_stream_needs_what_its_windows_hold() -> None:
    printed = printed_by("""
        import resource
        from algdiff import Differentiator

        def resident():
            return int(open("/proc/self/statm").read().split()[1]) * resource.getpagesize()

        one = Differentiator(10)
        streams = [one.stream() for _ in range(100)]
        before = resident()
        streams += [one.stream() for _ in range(1000)]
        for stream in streams:
            stream.push(1.0)
        print(resident() - before)
    """)
    assert int(printed) < 6_000_000  # the samples twice are 160 bytes of it
