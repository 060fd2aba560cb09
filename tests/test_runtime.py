"""What a long-running process may rely on: Ctrl-C, forks, threads, memory, and the interpreter left free."""

from __future__ import annotations

import multiprocessing
import signal
import threading
import time

import numpy as np
import pytest

import algdiff
from processes import assert_ctrl_c_is_heard, run_python


def direct(window_length: int) -> algdiff.Differentiator:
    """Make a design whose runs are long on any machine: its engine multiplies every tap."""
    return algdiff.Differentiator(window_length, engine="direct")


# What is prepared, and a call that takes a good part of a second, or more.
LONG_CALLS = {
    "one long row": ("d, x = direct(4001), np.zeros(40_000_000)", "d(x, threads=THREADS)"),
    "columns": ("d, x = direct(2001), np.zeros((20_000, 2_000))", "d(x, axis=0, threads=THREADS)"),
    "short rows": ("d, x = direct(999), np.zeros((60_000, 1_000))", "d(x, mode='wrap', threads=THREADS)"),
    "long windows by moments": (
        "d, x = algdiff.Differentiator(99), np.zeros(200_000_000, np.float32)",
        "d(x, threads=1)",
    ),
    "long windows by fft": (
        "d, x = algdiff.Differentiator(2001, kappa=0.5, mu=0.5), np.zeros(100_000_000, np.float32)",
        "d(x, threads=1)",
    ),
    "a huge window": ("d, x = direct(1_000_000), np.zeros(1_200_000)", "d(x, mode='valid', threads=THREADS)"),
    "an extended end": ("d, x = direct(300_001), np.zeros(400_000)", "d(x, mode='wrap', threads=THREADS)"),
    "a kernel at many points": ("x = np.linspace(0, 1, 20_000_000)", "algdiff.Kernel(1, 100)(x)"),
    "a huge design": ("", "algdiff.Differentiator(10_000_000, degree=40)"),
}


@pytest.mark.parametrize("threads", [1, 2])
@pytest.mark.parametrize("case", LONG_CALLS)
def test_ctrl_c_is_heard_within_a_quarter_of_a_second(case: str, threads: int) -> None:
    setup, call = LONG_CALLS[case]
    if threads > 1 and "THREADS" not in call:
        pytest.skip("one thread")
    code = f"""
        algdiff.differentiate(np.zeros(100), 11)
        {setup}
        threading.Thread(target=interrupt).start()
        try:
            {call.replace("THREADS", str(threads))}
        except KeyboardInterrupt:
            print(time.perf_counter() - sent)
        else:
            print("finished")
        assert algdiff.differentiate(np.arange(20.0), 5).std() < 1e-12
    """
    assert_ctrl_c_is_heard(code)


def test_an_exception_in_progress_stops_the_run() -> None:
    class StopError(Exception):
        pass

    def progress(fraction: float) -> None:
        assert 0 <= fraction <= 1
        raise StopError

    with pytest.raises(StopError):
        direct(20_001)(np.zeros(20_000_000), progress=progress)


def test_progress_rises() -> None:
    seen: list[float] = []
    direct(4001)(np.zeros(10_000_000), threads=1, progress=seen.append)
    assert len(seen) >= 3
    assert seen == sorted(seen)
    assert 0 <= seen[0] <= seen[-1] <= 1


def test_the_interpreter_is_free_during_a_run() -> None:
    x, out = np.zeros(6_000_000), np.empty(6_000_000)
    design = direct(4001)
    design(x[:5000])
    done = threading.Event()
    ticks = 0

    def work() -> None:
        design(x, out=out, threads=1)
        done.set()

    worker = threading.Thread(target=work)
    started = time.perf_counter()
    worker.start()
    while not done.is_set():
        time.sleep(0.001)
        ticks += 1
    elapsed = time.perf_counter() - started
    worker.join()
    # Held for the whole run, the interpreter would let this thread tick a few times only.
    assert ticks > 100 * elapsed


def test_many_python_threads_share_one_design() -> None:
    x = np.random.default_rng(0).standard_normal(50_000)
    design = algdiff.Differentiator(20, tau="root")  # whose aligned weights are made at the first call
    expected = algdiff.differentiate(x, 20, tau="root")
    failures: list[str] = []

    def work() -> None:
        for _ in range(20):
            if design(x).tobytes() != expected.tobytes():
                failures.append("different bits")

    threads = [threading.Thread(target=work) for _ in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert not failures


def test_a_forked_child_can_differentiate() -> None:
    result = run_python("""
        import os, signal
        import numpy as np
        import algdiff

        x = np.random.default_rng(0).standard_normal(2_000_000)
        expected = algdiff.differentiate(x, 101, threads=4)
        child = os.fork()
        if child == 0:
            signal.alarm(60)
            same = algdiff.differentiate(x, 101, threads=4).tobytes() == expected.tobytes()
            os._exit(0 if same else 1)
        assert os.waitpid(child, 0)[1] == 0
    """)
    assert result.returncode == 0, result.stderr


def _slope(x: np.ndarray) -> bytes:
    return algdiff.differentiate(x, 101, threads=2).tobytes()


@pytest.mark.parametrize("method", ["fork", "spawn", "forkserver"])
@pytest.mark.filterwarnings("ignore:This process:DeprecationWarning")
def test_pools_of_every_kind(method: str) -> None:
    rows = list(np.random.default_rng(0).standard_normal((4, 500_000)))
    expected = [_slope(row) for row in rows]
    with multiprocessing.get_context(method).Pool(2) as pool:
        assert pool.map_async(_slope, rows).get(timeout=100) == expected


def test_number_of_threads_from_the_environment() -> None:
    code = "import numpy as np, algdiff; algdiff.differentiate(np.zeros(100_000), 11)"
    assert run_python(code, ALGDIFF_NUM_THREADS="2").returncode == 0
    for wrong in ["0", "-1", "two", "1.5"]:
        result = run_python(code, ALGDIFF_NUM_THREADS=wrong)
        assert "ValueError: ALGDIFF_NUM_THREADS must be a positive integer" in result.stderr


def test_memory_that_cannot_be_had_is_an_error_and_nothing_is_lost() -> None:
    result = run_python("""
        import resource
        import numpy as np
        import algdiff

        x = np.ones(20_000_000)
        design = algdiff.Differentiator(101)
        design(x[:1000])
        used = int(open("/proc/self/statm").read().split()[0]) * resource.getpagesize()
        resource.setrlimit(resource.RLIMIT_AS, (used + 2**26, -1))
        for call in (lambda: design(x), lambda: algdiff.Differentiator(10_000_000, degree=3)):
            try:
                call()
            except MemoryError as error:
                print("MemoryError", error)
        assert not design(x[:1000]).any()
        print("alive")
    """)
    assert result.stdout.count("MemoryError") == 2, result.stdout + result.stderr
    assert result.stdout.endswith("alive\n")


def test_threads_that_cannot_be_started_are_done_without() -> None:
    result = run_python("""
        import resource
        import numpy as np
        import algdiff

        design, x = algdiff.Differentiator(10_001), np.ones(400_000)
        expected = design(x, mode="valid", threads=1)
        out = np.zeros_like(expected)
        used = int(open("/proc/self/statm").read().split()[0]) * resource.getpagesize()
        # Less than the stack of one thread: none can be started.
        resource.setrlimit(resource.RLIMIT_AS, (used + 2**20, -1))
        design(x, mode="valid", threads=10**6, out=out)
        print("alive" if np.array_equal(out, expected) else "wrong")
    """)
    assert result.stdout == "alive\n", result.stderr


def test_calls_do_not_leak() -> None:
    result = run_python("""
        import resource
        import numpy as np
        import algdiff

        x = np.random.default_rng(0).standard_normal((3, 200))

        def calls(count):
            for _ in range(count):
                algdiff.differentiate(x, 11)
                algdiff.savgol_filter(x, 12, 3, axis=-1, mode="wrap")
                algdiff.Kernel(1, 3)(x)
                try:
                    algdiff.differentiate(x, 1100)
                except ValueError:
                    pass
            return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss

        before = calls(500)
        print(calls(5000) - before)
    """)
    assert result.returncode == 0, result.stderr
    assert int(result.stdout) <= 1024  # kilobytes


def test_interrupted_results_are_not_returned() -> None:
    previous = signal.getsignal(signal.SIGALRM)

    def handler(*_: object) -> None:
        raise TimeoutError

    signal.signal(signal.SIGALRM, handler)
    signal.setitimer(signal.ITIMER_REAL, 0.1)
    try:
        with pytest.raises(TimeoutError):
            direct(20_001)(np.zeros(20_000_000))
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, previous)
