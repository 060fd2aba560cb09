"""The designer's page in a browser: every control moves the figures to what the library says."""

from __future__ import annotations

import json
import math
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import algdiff
from algdiff._designer.page import CHARTS, NAMES
from algdiff._designer.recording import Recording
from algdiff._designer.server import Server
from browser import browser

__all__ = ["browser"]  # a fixture

STEP = 0.01
NAME = "<b>made</b>"
FIGURES = (
    *("delay", "delay_samples", "noise_gain", "cutoff", "half_power", "exactness", "duration", "tau", "moment_delay"),
    *("norm1", "bias_order", "bias_constant", "bias_bound", "nyquist_attenuation", "roll_off", "delta", "fs"),
    *("weight_count", "engine"),
)


def made() -> Recording:
    rng = np.random.default_rng(4)
    t = STEP * np.arange(2000)
    x = np.stack([np.sin(2 * t), np.cos(t)]) + 0.02 * rng.standard_normal((2, t.size))
    return Recording(NAME, ('"><img src=x onerror=alert(1)>', "second"), x, STEP)


class Page:
    """The page, driven as a person would."""

    def __init__(self, context: Any, url: str) -> None:
        self.page = context.new_page()
        self.page.set_default_timeout(60_000)
        self.said: list[str] = []
        self.hosts: set[str] = set()
        self.page.on("console", lambda message: self.said.append(message.text) if message.type == "error" else None)
        self.page.on("pageerror", lambda error: self.said.append(str(error)))
        self.page.on("request", lambda request: self.hosts.add(request.url.split("/")[2]))
        self.page.goto(url)
        self.settle()

    def settle(self) -> None:
        """Wait until nothing is asked for."""
        # Questions leave with the next frame: two later, they have.
        self.page.evaluate("() => new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)))")
        self.page.wait_for_selector('#shown[aria-busy="false"]', state="attached")

    def number(self, name: str, value: float) -> None:
        """Type a number, and Enter."""
        self.page.fill(f"#{name}", str(value))
        self.page.press(f"#{name}", "Enter")
        self.settle()

    def key(self, name: str, key: str, times: int = 1) -> None:
        """Press a key on a control."""
        self.page.focus(f"#{name}")
        for _ in range(times):
            self.page.keyboard.press(key)
        self.settle()

    def select(self, name: str, value: str) -> None:
        """Take one of a list."""
        self.page.select_option(f"#{name}", value)
        self.settle()

    def value(self, name: str) -> float:
        """Return what a control says."""
        return float(self.page.input_value(f"#{name}"))

    def figure(self, name: str) -> Any:
        """Return a figure, with all its digits."""
        return json.loads(self.page.get_attribute(f"#figure-{name}", "data-value"))

    def design(self) -> algdiff.Differentiator:
        """Return the design whose Python line the page shows."""
        design = eval(self.page.inner_text("#python"), {"algdiff": algdiff})  # noqa: S307
        assert isinstance(design, algdiff.Differentiator)
        return design

    def agrees(self, **words: Any) -> None:
        """Check the figures against a design of the library, and that its charts are there."""
        expected = algdiff.Differentiator(**words)
        assert self.design() == expected
        figures = self.page.eval_on_selector_all(
            "[data-figure]", "all => all.map(one => [one.dataset.figure, one.dataset.value, one.textContent])"
        )
        found = {name: json.loads(value) for name, value, _ in figures}
        summary = {**expected.summary(), "weight_count": expected.weights.size, "engine": expected.engine}
        assert {name: found[name] for name in FIGURES} == {name: summary[name] for name in FIGURES}
        assert all(said not in ("", "…") for _, _, said in figures)
        assert not self.page.eval_on_selector("#shown", "one => one.classList.contains('stale')")


@pytest.fixture(scope="module")
def server() -> Iterator[Server]:
    with Server(made()) as running:
        threading.Thread(target=running.serve_forever, args=(0.01,), daemon=True).start()
        yield running
        running.shutdown()


@pytest.fixture(scope="module")
def desktop(browser: Any, server: Server) -> Iterator[Page]:
    context = browser.new_context(viewport={"width": 1280, "height": 900}, accept_downloads=True)
    context.grant_permissions(["clipboard-read", "clipboard-write"])
    page = Page(context, server.url)
    yield page
    errors = [said for said in page.said if "status of 400" not in said]  # those that tests have provoked
    assert errors == []
    assert page.hosts == {f"127.0.0.1:{server.server_port}"}


@pytest.fixture
def page(desktop: Page, server: Server) -> Page:
    """Return the page, at one design."""
    server.answers.__dict__["start"] = {"deriv": 1, "window_length": 51, "degree": 3, "kappa": 1.0, "mu": 1.0}
    desktop.page.reload()
    desktop.settle()
    return desktop


BASE = {"window_length": 51, "degree": 3, "fs": 100}


def test_it_starts_with_the_choice_from_the_data(desktop: Page) -> None:
    chosen = algdiff.suggest(made().samples[0], 1, delta=STEP).differentiator
    desktop.agrees(window_length=chosen.window_length, degree=chosen.degree, fs=100)
    for name in CHARTS:
        assert desktop.page.locator(f"#chart-{name} > svg.chart path.curve").count() >= 1
    sigma = algdiff.noise_level(made().samples[0])
    assert desktop.figure("noise_level") == sigma
    assert desktop.figure("std") == sigma * math.sqrt(chosen.noise_gain)
    assert desktop.page.locator("[data-figure]").count() == len(FIGURES) + 5
    assert {one.get_attribute("data-figure") for one in desktop.page.locator("[data-figure]").all()} <= set(NAMES)


def test_names_are_text(desktop: Page) -> None:
    assert desktop.page.inner_text("h1") == NAME
    assert desktop.page.title() == f"{NAME} - algdiff designer"
    assert desktop.page.locator("img, h1 b").count() == 0
    assert "onerror" in desktop.page.inner_text("#column option:first-child")


def test_sliders_move_by_keys(page: Page) -> None:
    page.key("deriv-slider", "ArrowRight")
    page.agrees(**{**BASE, "deriv": 2})
    page.key("degree-slider", "ArrowRight", 2)
    page.agrees(**{**BASE, "deriv": 2, "degree": 5})
    page.key("window-slider", "ArrowRight")
    assert page.value("window") == 53
    page.key("window-slider", "ArrowLeft", 6)
    assert page.value("window") < 51
    window = int(page.value("window"))
    page.key("kappa-slider", "ArrowRight", 3)
    page.key("mu-slider", "ArrowLeft", 4)
    page.agrees(window_length=window, deriv=2, degree=5, kappa=1.3, mu=0.6, fs=100)
    page.key("delay-slider", "Home")
    assert (page.value("delay"), page.page.input_value("#point")) == (0, "samples")
    page.key("delay-slider", "ArrowRight", 7)
    page.agrees(window_length=window, deriv=2, degree=5, kappa=1.3, mu=0.6, delay=0.07, fs=100)


def test_sliders_move_to_values(page: Page) -> None:
    page.page.fill("#deriv-slider", "0")
    page.page.fill("#degree-slider", "6")
    page.page.fill("#kappa-slider", "2.5")
    page.page.fill("#mu-slider", "-0.5")
    page.page.fill("#window-slider", "80")
    page.page.fill("#delay-slider", "11")
    page.settle()
    window = int(page.value("window"))
    assert window != 51
    page.agrees(window_length=window, deriv=0, degree=6, kappa=2.5, mu=-0.5, delay=0.11, fs=100)


def test_numbers_are_typed(page: Page) -> None:
    for name, value in {"deriv": 3, "degree": 7, "window": 88, "kappa": 0.25, "mu": 3.125, "step": 250}.items():
        page.number(name, value)
    words = {"window_length": 88, "deriv": 3, "degree": 7, "kappa": 0.25, "mu": 3.125}
    page.agrees(**words, fs=250)
    page.select("step-unit", "delta")
    assert page.value("step") == 0.004
    page.number("step", 0.5)
    page.agrees(**words, delta=0.5)
    page.number("delay", 20)
    page.agrees(**words, delta=0.5, delay=10.0)
    page.select("point", "time")
    assert page.value("delay") == 10
    page.number("delay", 3.3)
    page.agrees(**words, delta=0.5, delay=3.3)


def test_the_point_is_chosen_by_name(page: Page) -> None:
    for tau in ("root", "newest", "center"):
        page.select("point", tau)
        page.agrees(**BASE, tau=tau)
        assert page.value("delay") == pytest.approx(algdiff.Differentiator(**BASE, tau=tau).delay_samples, abs=1e-4)


def test_what_cannot_be_gives_way(page: Page) -> None:
    page.number("deriv", 4)
    assert page.value("degree") == 4
    page.number("window", 2)
    assert page.value("window") == 5
    page.number("degree", 9)
    assert page.value("window") == 10
    assert "degree 9 exceeds" in page.page.inner_text("#warnings")
    page.number("degree", 1)
    page.agrees(window_length=10, deriv=4, degree=4, fs=100)
    assert not page.page.is_visible("#warnings")


def test_an_error_is_shown_beside_its_control_and_recovered_from(page: Page) -> None:
    before = page.page.inner_html("#chart-weights")
    page.number("kappa", -1)
    said = page.page.inner_text("#kappa-error")
    with pytest.raises(ValueError, match="kappa must") as refused:
        algdiff.Differentiator(51, degree=3, kappa=-1)
    assert said == str(refused.value)
    assert page.page.get_attribute("#kappa", "aria-invalid") == "true"
    assert page.page.locator(".stale #chart-weights > svg").count() == 1
    assert page.page.inner_html("#chart-weights") == before
    page.page.wait_for_function("() => getComputedStyle(document.querySelector('#chart-weights')).opacity < 0.5")
    page.number("kappa", 1.5)
    page.agrees(**BASE, kappa=1.5)
    assert page.page.inner_text("#kappa-error") == ""
    assert page.page.inner_html("#chart-weights") != before


def test_the_newest_question_wins(page: Page) -> None:
    page.page.focus("#window-slider")
    for _ in range(40):
        page.page.keyboard.press("ArrowRight")
    page.settle()
    page.agrees(**{**BASE, "window_length": int(page.value("window"))})
    assert page.value("window") > 90


def test_the_stretch_and_the_column_are_chosen(page: Page) -> None:
    whole = page.page.inner_html("#chart-derivative")
    page.number("from", 4)
    page.number("to", 6.5)
    x = made().samples[0]
    estimate = algdiff.Differentiator(**BASE)(x)[400:650]
    described = f"estimate: from {estimate.min():.4g} to {estimate.max():.4g}."
    assert described in page.page.inner_html("#chart-derivative desc")
    page.key("from-slider", "ArrowRight", 2)
    assert page.value("from") > 4
    page.key("to-slider", "Home")
    assert page.value("to") == pytest.approx(page.value("from") + 8 * STEP, abs=1.1 * STEP) or page.value("from") == 0
    page.page.click("#whole")
    page.settle()
    assert (page.value("from"), page.value("to")) == (0, 20)
    assert page.page.inner_html("#chart-derivative") == whole
    page.select("column", "1")
    assert page.figure("noise_level") == algdiff.noise_level(made().samples[1])
    page.number("deriv", 2)
    page.page.click("#choose")
    page.page.wait_for_selector("#explanation:not(:empty)")
    page.settle()
    suggestion = algdiff.suggest(made().samples[1], 2, delta=STEP)
    chosen = suggestion.differentiator
    page.agrees(window_length=chosen.window_length, deriv=2, degree=chosen.degree, fs=100)
    assert page.page.inner_text("#explanation") == " ".join(suggestion.explain().splitlines()[:2])
    page.select("column", "0")


def test_a_design_is_kept(page: Page, tmp_path: Path) -> None:
    design = page.design()
    for kind, name in {"json": "algdiff-design.json", "csv": "algdiff-weights.csv", "c": "differentiator.h"}.items():
        with page.page.expect_download() as waiting:
            page.page.click(f"#export-{kind}")
        assert waiting.value.suggested_filename == name
        waiting.value.save_as(tmp_path / name)
    found = json.loads((tmp_path / "algdiff-design.json").read_text())
    assert algdiff.Differentiator(**{name: found[name] for name in design._names}) == design
    weights = np.loadtxt(tmp_path / "algdiff-weights.csv", delimiter=",", skiprows=1)[:, 1]
    assert weights.tobytes() == design.weights.tobytes()
    assert (tmp_path / "differentiator.h").read_text() == design.to_c()
    page.page.click("#copy")
    page.page.wait_for_selector("#copied:not(:empty)")
    assert page.page.evaluate("() => navigator.clipboard.readText()") == page.page.inner_text("#python")


def test_the_keyboard_is_enough(page: Page) -> None:
    page.page.evaluate("() => document.activeElement.blur()")
    page.page.focus("#column")
    visited = []
    for _ in range(40):
        visited.append(page.page.evaluate("() => document.activeElement.id"))
        width = page.page.evaluate("() => parseFloat(getComputedStyle(document.activeElement).outlineWidth)")
        assert width >= 2, visited[-1]
        if visited[-1] == "export-c":
            break
        page.page.keyboard.press("Tab")
    controls = ["deriv", "window", "degree", "delay", "kappa", "mu", "from", "to"]
    wanted = [one for name in controls for one in (name, f"{name}-slider")]
    assert {*wanted, "choose", "point", "step", "step-unit", "whole", "copy", "export-json"} <= set(visited)
    page.page.focus("#deriv")
    page.page.keyboard.press("Tab")
    page.page.keyboard.press("ArrowRight")
    page.page.keyboard.press("Tab")
    page.page.keyboard.press("Control+a")
    page.page.keyboard.type("77")
    page.page.keyboard.press("Enter")
    page.settle()
    page.agrees(window_length=77, deriv=2, degree=3, fs=100)


def test_what_changed_is_spoken(page: Page) -> None:
    page.number("window", 61)
    page.page.wait_for_function("() => document.getElementById('spoken').textContent.includes('Window 61 samples')")
    spoken = page.page.inner_text("#spoken")
    assert f"delay {page.page.inner_text('#figure-delay')}" in spoken
    for element in page.page.locator("input, select").all():
        label = "one => one.getAttribute('aria-label') || one.labels.length"
        assert element.evaluate(label), element.get_attribute("id")


def test_it_is_readable_on_a_phone_and_in_the_dark(browser: Any, server: Server) -> None:
    grounds = {}
    for scheme in ("light", "dark"):
        context = browser.new_context(viewport={"width": 360, "height": 740}, color_scheme=scheme, has_touch=True)
        page = Page(context, server.url)
        page.number("step", 0.00123)
        page.number("kappa", -2)  # with the longest figures and words on the page
        assert page.page.evaluate("() => document.documentElement.scrollWidth") <= 360
        small = page.page.eval_on_selector_all(
            "input, select, button, .keep a",
            "all => all.filter(one => one.offsetParent && one.getBoundingClientRect().height < 40).map(one => one.id)",
        )
        assert small == []
        grounds[scheme] = page.page.evaluate("() => getComputedStyle(document.body).backgroundColor")
        drawn = page.page.eval_on_selector("#chart-signal svg", "one => one.getBoundingClientRect().width")
        asked = float(page.page.get_attribute("#chart-signal svg", "viewBox").split()[2])
        assert drawn == pytest.approx(asked, rel=0.02)  # so that text is as large as it is meant
        context.close()
    assert grounds["light"] != grounds["dark"]


@pytest.mark.parametrize("width", [360, 1100, 1280])
def test_the_first_figures_stay_in_their_boxes(page: Page, width: int) -> None:
    page.page.set_viewport_size({"width": width, "height": 900})
    page.page.select_option("#step-unit", "delta")
    page.page.fill("#step", "1")
    page.page.press("#step", "Enter")
    page.settle()
    cutoff = page.page.locator("#figure-cutoff")
    assert cutoff.text_content() == f"{page.figure('cutoff'):.4g} cycles/sample"
    wide = page.page.locator(".facts dd").evaluate_all("all => all.filter(one => one.scrollWidth > one.clientWidth)")
    # Else words would be broken anywhere, and always fit.
    assert cutoff.evaluate("one => getComputedStyle(one).overflowWrap") == "normal"
    page.page.set_viewport_size({"width": 1280, "height": 900})
    assert wide == []
