"""The designer's server: who is answered, what is answered, what is kept of a design, and how it ends."""

from __future__ import annotations

import csv
import http.client
import json
import os
import re
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import suppress
from html.parser import HTMLParser
from pathlib import Path
from typing import Any
from urllib.parse import urlencode, urlsplit

import numpy as np
import pytest

import algdiff
from algdiff._cli import main
from algdiff._designer import answers
from algdiff._designer import recording as recordings
from algdiff._designer.query import HIGHEST, LONGEST, STEEPEST, WORK, RefusedError
from algdiff._designer.recording import Recording, thinned
from algdiff._designer.server import FIELDS, HEADERS, TARGET, Server
from algdiff._pages import loading, of_design
from cli import process

STEP = 0.002
HOSTILE = '"><img src=x onerror=alert(1)><script>alert(1)</script>]]>&amp;'


def made() -> Recording:
    rng = np.random.default_rng(11)
    t = STEP * np.arange(3000)
    x = np.stack([np.sin(3 * t), np.cos(2 * t)]) + 0.01 * rng.standard_normal((2, t.size))
    x[1, 700:720] = np.nan
    return Recording("made", ("sine", "cosine"), x, STEP)


def started(recording: Recording) -> Server:
    server = Server(recording)
    threading.Thread(target=server.serve_forever, args=(0.01,), daemon=True).start()
    return server


@pytest.fixture(scope="module")
def server() -> Iterator[Server]:
    with started(made()) as running:
        yield running
        running.shutdown()


class Reply:
    """An answer: status, headers, content."""

    def __init__(self, response: http.client.HTTPResponse) -> None:
        self.status, self.headers, self.content = response.status, response.headers, response.read()

    @property
    def json(self) -> Any:
        """The answer, if it is JSON."""
        assert self.headers["Content-Type"] == "application/json"
        return json.loads(self.content)


def ask(server: Server, path: str, words: dict[str, Any] | None = None, **request: Any) -> Reply:
    """Ask below the token, or for a target that begins with a slash, with the right Host unless headers say another."""
    target = path if path.startswith("/") else f"/{server.token}/{path}"
    if words:
        target += f"?{urlencode(words)}"
    headers = {"Host": f"127.0.0.1:{server.server_port}", **request.pop("headers", {})}
    connection = http.client.HTTPConnection("127.0.0.1", server.server_port, timeout=20)
    connection.putrequest(request.pop("method", "GET"), target, skip_host=True)
    for name, value in headers.items():
        if value is not None:
            connection.putheader(name, value)
    connection.endheaders()
    reply = Reply(connection.getresponse())
    connection.close()
    return reply


def raw(server: Server, text: str) -> str:
    """Send bytes as they are; return the first line of the answer."""
    with socket.create_connection(("127.0.0.1", server.server_port), timeout=20) as connection:
        connection.sendall(text.encode("latin-1"))
        with connection.makefile("rb") as answer:
            return answer.readline().decode()


# --- who is answered ---------------------------------------------------------------------------------------------


def test_the_page_is_answered(server: Server) -> None:
    reply = ask(server, "")
    assert (reply.status, reply.headers["Content-Type"]) == (200, "text/html; charset=utf-8")
    assert ask(server, "", headers={"Host": f"localhost:{server.server_port}"}).status == 200
    assert server.url == f"http://127.0.0.1:{server.server_port}/{server.token}/"


@pytest.mark.parametrize("path", ["", "answer", "suggestion", "export/json", "nothing"])
@pytest.mark.parametrize(
    "host", ["evil.example:{}", "127.0.0.1", "localhost:1{}", "127.0.0.1:{}.evil.example", "", None]
)
def test_another_host_is_refused(server: Server, path: str, host: str | None) -> None:
    named = None if host is None else host.format(server.server_port)
    assert ask(server, path, headers={"Host": named}).status == 403


def test_two_hosts_are_refused(server: Server) -> None:
    own = f"Host: 127.0.0.1:{server.server_port}\r\n"
    assert raw(server, f"GET /{server.token}/ HTTP/1.1\r\n{own}\r\n").split()[1] == "200"
    assert raw(server, f"GET /{server.token}/ HTTP/1.1\r\n{own}{own}\r\n").split()[1] == "403"


@pytest.mark.parametrize("path", ["", "/answer", "/export/json", "/../../etc/passwd"])
@pytest.mark.parametrize("token", ["", "/wrong", "/{0}x", "/{1}", "/{2}", "/?token={0}"])
def test_without_the_token_nothing_is_answered(server: Server, path: str, token: str) -> None:
    reply = ask(server, (token.format(server.token, server.token[:-1], server.token[::-1]) + path) or "/")
    assert reply.status == 403
    assert "token" in reply.json["error"]
    assert server.token not in reply.content.decode()


def test_tokens_are_long_and_new() -> None:
    tokens = set()
    for _ in range(3):
        with Server(made()) as one:
            tokens.add(one.token)
    assert len(tokens) == 3
    assert all(len(token) >= 32 for token in tokens)


@pytest.mark.parametrize("origin", ["http://evil.example", "null", "https://127.0.0.1:{}", "http://127.0.0.1:1{}"])
def test_pages_of_other_sites_are_refused(server: Server, origin: str) -> None:
    assert ask(server, "answer", headers={"Origin": origin.format(server.server_port)}).status == 403
    assert ask(server, "answer", headers={"Origin": f"http://127.0.0.1:{server.server_port}"}).status == 200


@pytest.mark.parametrize(
    "path",
    [
        "nothing",
        "answer/",
        "export",
        "export/exe",
        "export/",
        "../../etc/passwd",
        "%2e%2e/%2e%2e/etc/passwd",
        "/",
        "data/",
    ],
)
def test_unknown_paths_are_not_found(server: Server, path: str) -> None:
    reply = ask(server, f"/{server.token}/{path}")
    assert (reply.status, reply.json["error"]) == (404, "there is nothing at this address")


@pytest.mark.parametrize("method", ["POST", "PUT", "DELETE", "PATCH", "OPTIONS", "HEAD", "TRACE"])
def test_other_methods_are_refused(server: Server, method: str) -> None:
    reply = ask(server, "answer", method=method)
    assert (reply.status, reply.headers["Allow"]) == (405, "GET")
    assert raw(server, f"BREW /{server.token}/ HTTP/1.1\r\n\r\n").split()[1] == "405"


def test_large_requests_are_refused(server: Server) -> None:
    assert ask(server, f"/{server.token}/answer?window={'1' * TARGET}").status == 414
    assert raw(server, f"GET /{server.token}/{'a' * 70000} HTTP/1.1\r\n\r\n").split()[1] == "414"
    assert ask(server, "answer", headers={"Content-Length": str(10**12)}).status == 413
    assert ask(server, "answer", headers={"Transfer-Encoding": "chunked"}).status == 413
    assert ask(server, "answer", {f"a{one}": 1 for one in range(FIELDS + 1)}).status == 400
    assert ask(server, f"/{server.token}/answer?window=5&window=7").status == 400
    lines = "".join(f"X-{one}: 1\r\n" for one in range(200))
    assert raw(server, f"GET /{server.token}/ HTTP/1.1\r\n{lines}\r\n").split()[1] == "431"


def test_only_this_machine_is_listened_to(server: Server) -> None:
    assert server.server_address[0] == "127.0.0.1"
    others = {"127.0.0.2"} if sys.platform == "linux" else set()
    with suppress(OSError):
        others |= {found[4][0] for found in socket.getaddrinfo(socket.gethostname(), None, socket.AF_INET)}
    for other in others - {"127.0.0.1"}:
        with pytest.raises(OSError, match="refused"):
            socket.create_connection((str(other), server.server_port), timeout=5)
    table = Path("/proc/net/tcp")
    if table.exists():
        port = f":{server.server_port:04X}"
        rows = [line.split() for line in table.read_text().splitlines()[1:]]
        listening = {row[1] for row in rows if row[1].endswith(port) and row[3] == "0A"}
        assert listening <= {f"0100007F{port}"}


def test_every_answer_is_guarded(server: Server) -> None:
    nonces = []
    for reply in (
        ask(server, ""),
        ask(server, "answer"),
        ask(server, "export/csv"),
        ask(server, "x"),
        ask(server, "/"),
    ):
        assert {name: reply.headers[name] for name in HEADERS} == HEADERS
        assert reply.headers["Content-Security-Policy"].startswith("default-src 'none'")
        assert "Python" not in reply.headers["Server"]
    for _ in range(2):
        page = ask(server, "")
        (nonce,) = re.findall(r"script-src 'nonce-([\w-]+)'", page.headers["Content-Security-Policy"])
        assert page.content.decode().count(f'<script nonce="{nonce}">') == 1
        nonces.append(nonce)
    assert nonces[0] != nonces[1]


# --- what is answered --------------------------------------------------------------------------------------------

QUESTIONS: list[tuple[dict[str, Any], dict[str, Any]]] = [
    ({}, {}),
    ({"window": 51, "deriv": 2, "fs": 500}, {"window_length": 51, "deriv": 2, "fs": 500}),
    ({"window": 40, "tau": "root", "delta": 0.002}, {"window_length": 40, "tau": "root", "delta": 0.002}),
    (
        {"window": 31, "tau": "newest", "kappa": 0, "mu": 2.5},
        {"window_length": 31, "tau": "newest", "kappa": 0, "mu": 2.5},
    ),
    ({"window": 1001, "delay": 0.31, "delta": 0.002}, {"window_length": 1001, "delay": 0.31, "delta": 0.002}),
    ({"window": 9, "deriv": 0, "degree": 4, "tau": 1.1}, {"window_length": 9, "deriv": 0, "degree": 4, "tau": 1.1}),
]


@pytest.mark.parametrize(("words", "arguments"), QUESTIONS)
def test_figures_charts_and_the_python_line_are_those_of_the_library(
    server: Server, words: dict[str, Any], arguments: dict[str, Any]
) -> None:
    design = algdiff.Differentiator(**{"window_length": 101, **arguments})
    found = ask(server, "answer", words).json
    expected = {**design.summary(), "engine": design.engine}
    sigma = algdiff.noise_level(made().samples[0])
    expected |= {
        "samples": 3000,
        "missing": 0,
        "infinite": 0,
        "noise_level": sigma,
        "std": sigma * design.noise_gain**0.5,
    }
    assert set(found["figures"]) == {*expected} - {
        "window_length",
        "deriv",
        "degree",
        "kappa",
        "mu",
        "rule",
        "trim",
    } - {"discretisation_error"}
    assert found["figures"] == {name: expected[name] for name in found["figures"]}
    assert set(found["shown"]) == set(found["figures"])
    assert {name: found["charts"][name] for name in ("weights", "step", "response", "delays")} == of_design.charts(
        design, (560, answers.HEIGHT)
    )
    assert eval(found["python"], {"algdiff": algdiff}) == design  # noqa: S307
    assert found["warnings"] == []


def test_the_data_are_drawn_as_the_library_differentiates_them(server: Server) -> None:
    words = {"window": 61, "delta": STEP, "column": 1, "from": 600, "to": 900, "width": 400}
    found = ask(server, "answer", words).json
    design, x = algdiff.Differentiator(61, delta=STEP), made().samples[1]
    estimate, std, *_ = design(x, return_std=True, nan_policy="omit")
    assert found["figures"]["missing"] == 20
    said = re.search(r"<desc>(.*?)</desc>", found["charts"]["derivative"])
    assert said
    y = estimate[600:900]
    assert f"estimate: from {y.min():.4g} to {y.max():.4g}." in said[1]
    assert f"from {(y - 2 * std[600:900]).min():.4g} to {(y + 2 * std[600:900]).max():.4g}." in said[1]
    assert 'viewBox="0 0 400 ' in found["charts"]["signal"]
    assert "cosine" in found["charts"]["signal"]


def test_the_choice_is_that_of_the_library(server: Server) -> None:
    found = ask(server, "suggestion", {"deriv": 2, "delta": STEP}).json
    suggestion = algdiff.suggest(made().samples[0], 2, delta=STEP)
    design = suggestion.differentiator
    assert found["chosen"] == {name: getattr(design, name) for name in ("window_length", "degree", "kappa", "mu")}
    assert found["explanation"] == suggestion.explain().splitlines()
    assert found["rmse"] == suggestion.rmse


def test_warnings_are_shown_with_the_answer(server: Server) -> None:
    (said,) = ask(server, "answer", {"window": 21, "degree": 12}).json["warnings"]
    with pytest.warns(algdiff.DesignWarning) as caught:
        algdiff.Differentiator(21, degree=12)
    assert said == str(caught[0].message)


@pytest.mark.parametrize(
    ("words", "control", "named"),
    [
        ({"kappa": -1}, "kappa", "kappa must"),
        ({"mu": "nan"}, "mu", "mu must"),
        ({"mu": "many"}, "mu", "mu must be a number, got 'many'"),
        ({"window": 3, "degree": 4}, "window", "window_length must"),
        ({"degree": 1, "deriv": 2}, "degree", "degree must"),
        ({"window": 2.5}, "window", "window must be a whole number"),
        ({"window": 10**9}, "window", "from 1 to 100001"),
        ({"degree": 51}, "degree", "from 0 to 50"),
        ({"kappa": 100.5}, "kappa", "kappa must be at most 100 on this page, got '100.5'"),
        ({"mu": "inf"}, "mu", "mu must be at most 100 on this page, got 'inf'"),
        (
            {"window": 100_001, "degree": 50, "deriv": 50},
            "window",
            "window must be at most 25000 at order 50 and degree",
        ),
        ({"fs": 1e308}, "step", "fs must be such that the figures of order 1 do not overflow or underflow, got 1e+308"),
        ({"delta": 1e-308}, "step", "delta must be such that the figures of order 1 do not overflow"),
        ({"fs": 1e-320}, "step", "fs must be finite and positive"),
        ({"delta": "inf"}, "step", "delta must be finite and positive"),
        ({"window": 4001}, "window", "at most the 3000 samples"),
        ({"deriv": ""}, "deriv", "got nothing"),
        ({"tau": "last"}, "delay", "tau must"),
        ({"tau": "root", "delay": 0.1}, "delay", "tau"),
        ({"fs": 0}, "step", "fs must"),
        ({"fs": 10, "delta": 1}, "step", "delta"),
        ({"column": 2}, "data", "column must"),
        ({"from": 5, "to": 5}, "from", "to must"),
        ({"file": "/etc/passwd"}, "window", "'file' is no parameter"),
    ],
)
def test_what_cannot_be_is_said_beside_its_control(
    server: Server, words: dict[str, Any], control: str, named: str
) -> None:
    reply = ask(server, "answer", words)
    assert reply.status == 400
    assert reply.json["control"] == control
    assert named in reply.json["error"]
    assert "\n" not in reply.json["error"]
    assert f'id="{control}-error"' in ask(server, "").content.decode()


def test_what_takes_long_is_neither_answered_nor_offered(server: Server) -> None:
    assert ask(server, "answer", {"kappa": STEEPEST, "mu": STEEPEST}).status == 200
    assert ask(server, "export/json", {"kappa": STEEPEST + 1}).status == 400
    text = ask(server, "").content.decode()
    for name in ("kappa", "mu"):
        assert re.search(rf'<input type="number" id="{name}"[^>]* max="{STEEPEST}"', text)
    assert WORK // HIGHEST > 20_001  # the slider's longest window has every degree


def test_missing_and_infinite_samples_are_told_apart() -> None:
    recording = made()
    recording.samples[0, 5:8], recording.samples[0, 9] = np.nan, np.inf
    recording.samples[1] = np.nan
    answering = answers.Answers(recording)
    found = answering.answer({})
    assert (found["figures"]["missing"], found["figures"]["infinite"]) == (3, 1)
    with pytest.raises(RefusedError, match="x must hold samples that are finite, got none") as refused:
        answering.answer({"column": "1"})
    assert refused.value.control == "data"


def test_an_older_question_of_a_page_is_dropped(server: Server) -> None:
    statuses: dict[int, int] = {}

    def one(number: int, page: str) -> None:
        statuses[number] = ask(server, "answer", {"window": 21, "page": page, "n": number}).status

    threads = []
    with server._turn:  # nothing is computed meanwhile
        for count, (number, page) in enumerate([(1, "a"), (2, "a"), (10, "b")], 1):
            threads.append(threading.Thread(target=one, args=(number, page)))
            threads[-1].start()
            deadline = time.monotonic() + 10
            while server.under_way < count and time.monotonic() < deadline:
                time.sleep(0.002)
    for thread in threads:
        thread.join(20)
    assert statuses == {1: 409, 2: 200, 10: 200}
    assert server.idle(1)


def test_a_fault_of_ours_is_an_answer(server: Server, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(answers, "figures", lambda _: 1 / 0)
    reply = ask(server, "answer", {"window": 23})
    assert (reply.status, reply.json["error"]) == (500, "ZeroDivisionError: division by zero")
    assert server.idle(1)


# --- what is kept ------------------------------------------------------------------------------------------------

KEPT = {"window": 41, "deriv": 2, "degree": 4, "kappa": 0.5, "mu": 1.5, "tau": "root", "fs": 300}
DESIGN = algdiff.Differentiator(41, 2, degree=4, kappa=0.5, mu=1.5, tau="root", fs=300)


def test_json_makes_the_design_again(server: Server, capsys: pytest.CaptureFixture[str]) -> None:
    reply = ask(server, "export/json", KEPT)
    assert reply.headers["Content-Disposition"] == 'attachment; filename="algdiff-design.json"'
    found = reply.json
    again = algdiff.Differentiator(**{name: found[name] for name in algdiff.Differentiator._names})
    assert again == DESIGN
    assert found["weights"] == again.weights.tolist() == DESIGN.weights.tolist()
    flags = [part for name, value in KEPT.items() for part in (f"--{name}", str(value))]
    assert main(["design", *flags, "--json"]) == 0
    assert capsys.readouterr().out == reply.content.decode()


def test_csv_holds_the_weights_to_the_bit(server: Server) -> None:
    reply = ask(server, "export/csv", KEPT)
    assert reply.headers["Content-Disposition"] == 'attachment; filename="algdiff-weights.csv"'
    header, *rows = csv.reader(reply.content.decode().splitlines())
    assert header == ["time", "weight"]
    times, weights = np.array(rows, dtype=float).T
    assert weights.tobytes() == DESIGN.weights.tobytes()
    np.testing.assert_allclose(times, np.arange(-40, 1) / 300, rtol=1e-15)


def test_the_c_header_is_that_of_the_library(server: Server) -> None:
    reply = ask(server, "export/c", KEPT)
    assert reply.headers["Content-Disposition"] == 'attachment; filename="differentiator.h"'
    assert reply.content.decode() == DESIGN.to_c()


def test_a_design_that_cannot_be_is_not_kept(server: Server) -> None:
    for kind in answers.EXPORTS:
        reply = ask(server, f"export/{kind}", {"kappa": -1})
        assert (reply.status, reply.json["control"]) == (400, "kappa")
        assert "Content-Disposition" not in reply.headers


# --- recordings --------------------------------------------------------------------------------------------------


def opened(path: Path, **words: Any) -> Recording:
    from algdiff import _formats as formats
    from algdiff._formats.base import Options

    with formats.open_source(formats.located("FILE", path), Options()) as source:
        return recordings.read(source, path.name, **words)


def test_files_are_read_by_column(tmp_path: Path) -> None:
    x = np.arange(12.0).reshape(6, 2)
    np.save(tmp_path / "x.npy", x)
    found = opened(tmp_path / "x.npy", axis=0, step=0.5)
    assert (found.name, found.columns, found.delta, found.first, found.note) == (
        "x.npy",
        ("0", "1"),
        0.5,
        0,
        "6 samples",
    )
    np.testing.assert_array_equal(found.samples, x.T)
    (tmp_path / "x.csv").write_text("a,b\n" + "".join(f"{a},{b}\n" for a, b in x.tolist()))
    found = opened(tmp_path / "x.csv")
    assert (found.columns, found.delta) == (("a", "b"), 1.0)
    np.testing.assert_array_equal(found.samples, x.T)
    np.save(tmp_path / "z.npy", x[:, 0] + 1j * x[:, 1])
    found = opened(tmp_path / "z.npy")
    assert found.columns == ("real part of Signal", "imaginary part of Signal")
    np.testing.assert_array_equal(found.samples, x.T)
    np.save(tmp_path / "none.npy", np.zeros((3, 0)))
    with pytest.raises(ValueError, match=r"none\.npy: must hold samples, got shape \(3, 0\)"):
        opened(tmp_path / "none.npy")


def test_of_a_long_file_a_stretch_in_the_middle_is_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    x = np.arange(3000.0).reshape(3, 1000)
    np.save(tmp_path / "x.npy", x)
    monkeypatch.setattr(loading, "NUMBERS", 200)
    monkeypatch.setattr(recordings, "COLUMNS", 2)
    found = opened(tmp_path / "x.npy")
    assert (found.first, found.count, found.columns) == (450, 100, ("0", "1"))
    assert found.note == "samples 450 to 549 of 1,000, the first 2 of 3 columns"
    np.testing.assert_array_equal(found.samples, x[:2, 450:550])


def test_thinning_keeps_what_stands_out() -> None:
    rng = np.random.default_rng(5)
    x = rng.standard_normal(100_003)
    x[[10, 99_999]] = 50, -60
    x[5000:9000] = np.nan
    kept = thinned(3, 100_003, x)
    assert kept[0] == 3
    assert kept[-1] == 100_002
    assert kept.size < 5 * recordings.PARTS
    assert {10, 99_999} <= set(kept.tolist())
    assert np.isnan(x[kept]).any()
    for start in range(3, 100_000, 5000):  # parts of some 166 samples lie in each
        part, inside = x[start : start + 5000], kept[(kept >= start) & (kept < start + 5000)]
        if not np.isnan(part).any():
            assert (np.max(x[inside]), np.min(x[inside])) == (part.max(), part.min())
    np.testing.assert_array_equal(thinned(5, 1000, x), np.arange(5, 1000))


class Tags(HTMLParser):
    """The elements of a page, and its texts."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.texts: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Keep an element."""
        self.tags.append((tag, dict(attrs)))

    def handle_data(self, data: str) -> None:
        """Keep a text."""
        self.texts.append(data)


def test_hostile_names_are_text() -> None:
    name = os.fsdecode(b"\xff\xfe" + HOSTILE.encode()) + ".csv"
    plain, hostile = made(), made()
    hostile.name, hostile.columns = name, (HOSTILE, HOSTILE)
    with started(plain) as one, started(hostile) as two:
        pages = [Tags(ask(server, "").content.decode()) for server in (one, two)]
        charts = ask(two, "answer").json["charts"]
        one.shutdown()
        two.shutdown()
    own, theirs = ([(tag, sorted(attributes)) for tag, attributes in page.tags] for page in pages)
    assert own == theirs
    assert name.replace("\udcff", "\ufffd").replace("\udcfe", "\ufffd") in pages[1].texts
    assert "<img" not in "".join(charts.values())
    assert "&lt;img" in charts["signal"]


def test_a_recording_too_short_to_choose_from_still_has_a_page() -> None:
    short = Recording("short", ("x",), np.arange(4.0)[np.newaxis], 1.0)
    with started(short) as server:
        assert ask(server, "").status == 200
        assert ask(server, "suggestion").json["control"] == "data"
        start = server.answers.start
        words = {"window": start["window_length"], "degree": start["degree"]}
        assert ask(server, "answer", words).json["figures"]["samples"] == 4
        server.shutdown()


def test_the_pendulum_is_shown_without_a_file() -> None:
    shipped = recordings.pendulum()
    assert (shipped.count, shipped.delta, shipped.shown) == (231757, 1e-4, 70000)


# --- the command -------------------------------------------------------------------------------------------------


def designer(*arguments: object) -> tuple[subprocess.Popen[str], str]:
    """Start the command; return it and the address that it prints."""
    running = process("designer", "--no-browser", *arguments)
    assert running.stdout
    return running, running.stdout.readline().strip()


def answered(url: str, path: str, words: dict[str, Any], *, wait: bool = True) -> Any:
    place = urlsplit(url)
    connection = http.client.HTTPConnection(place.netloc, timeout=20)
    connection.request("GET", f"{place.path}{path}?{urlencode(words)}")
    if not wait:
        return connection
    reply = Reply(connection.getresponse())
    connection.close()
    return reply


@pytest.mark.skipif(os.name == "nt", reason="Ctrl-C cannot be sent to a single process")
def test_the_command_serves_its_page_until_ctrl_c(tmp_path: Path) -> None:
    x = np.sin(0.01 * np.arange(2000)) + 0.01 * np.random.default_rng(2).standard_normal(2000)
    np.save(tmp_path / "x.npy", x)
    running, url = designer(tmp_path / "x.npy", "--fs", "100")
    assert re.fullmatch(r"http://127\.0\.0\.1:\d+/[\w-]{32}/", url)
    assert b"x.npy" in answered(url, "", {}).content
    assert answered(url, "answer", {"window": 51, "fs": 100}).json["figures"]["noise_level"] == algdiff.noise_level(x)
    started = time.monotonic()
    running.send_signal(signal.SIGINT)
    out, err = running.communicate(timeout=20)
    assert time.monotonic() - started < 2
    assert (running.returncode, out) == (130, "")
    assert err.splitlines() == ["Ctrl-C ends it.", "stopped"]


@pytest.mark.skipif(os.name == "nt", reason="Ctrl-C cannot be sent to a single process")
def test_ctrl_c_ends_the_command_while_it_computes(tmp_path: Path) -> None:
    np.save(tmp_path / "x.npy", np.random.default_rng(3).standard_normal(1 << 20))
    running, url = designer(tmp_path / "x.npy")
    words = {"window": LONGEST, "degree": WORK // LONGEST - 1, "kappa": 0.3, "mu": 0.3}
    under_way = answered(url, "answer", words, wait=False)
    time.sleep(0.5)
    started = time.monotonic()
    running.send_signal(signal.SIGINT)
    _, err = running.communicate(timeout=20)
    assert time.monotonic() - started < 2
    assert (running.returncode, err.splitlines()[-1]) == (130, "stopped")
    with pytest.raises((http.client.HTTPException, ConnectionError)):
        under_way.getresponse()


def test_the_browser_is_opened_unless_it_is_not_wanted(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    seen = threading.Event()
    opened: list[str] = []
    monkeypatch.setattr("webbrowser.open", lambda url: (opened.append(url), seen.set()))

    def stopped(*_: object, **__: object) -> None:
        seen.wait(5 if "--no-browser" not in arguments else 0)
        raise KeyboardInterrupt

    monkeypatch.setattr(Server, "serve_forever", stopped)
    arguments = ["designer"]
    assert main(arguments) == 130
    out, err = capsys.readouterr()
    assert [out.strip()] == opened
    assert err.splitlines()[-1] == "stopped"
    arguments = ["designer", "--no-browser"]
    assert main(arguments) == 130
    assert len(opened) == 1


@pytest.mark.parametrize(
    ("arguments", "code", "said"),
    [
        (["--port", "70000"], 2, "must be a port from 0 to 65535, got '70000'"),
        (["--port", "80a"], 2, "must be a port"),
        (["x.txt"], 2, "FILE: the suffix of x.txt must be"),
        (["none.npy"], 1, "none.npy"),
        (["scalar.npy"], 1, "scalar.npy: must hold samples, got a single number"),
        (["one.npy"], 1, "one.npy: must hold two samples or more, got 1"),
        (["tall.npy"], 1, "tall.npy: must hold two samples or more, got 1: along --axis 0 there are 5"),
        (["empty.npy"], 1, "empty.npy: must hold samples, got shape (100, 0)"),
        (["--fs", "0"], 2, "--fs must"),
        (["--columns", "a"], 2, "--columns is for a FILE, got none"),
        (["x.csv", "--time", "t", "--fs", "10"], 2, "give --time, --delta or --fs"),
    ],
)
def test_what_cannot_be_served_is_said(
    arguments: list[str], code: int, said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Any
) -> None:
    monkeypatch.chdir(tmp_path)
    for name, samples in {"scalar": 3.0, "one": [1.0], "tall": np.ones((5, 1)), "empty": np.ones((100, 0))}.items():
        np.save(f"{name}.npy", samples)
    assert main(["designer", "--no-browser", *arguments]) == code
    out, err = capsys.readouterr()
    assert out == ""
    assert said in err


def test_a_port_that_is_taken_is_named(server: Server, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["designer", "--no-browser", "--port", str(server.server_port)]) == 1
    out, err = capsys.readouterr()
    assert out == ""
    assert err == f"algdiff: error: --port {server.server_port}: Address already in use; use another\n"
