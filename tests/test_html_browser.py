"""The report in a browser: it loads nothing, fits a phone, can be read in light, dark and print, and says the truth."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import algdiff
from algdiff._cli import main
from browser import browser

DESKTOP, PHONE = {"width": 1280, "height": 900}, {"width": 360, "height": 740}
COLOURS = """() => {
  const shown = one => one.checkVisibility({checkOpacity: true}) && one.getClientRects().length;
  const behind = one => {
    for (let each = one; each; each = each.parentElement) {
      const colour = getComputedStyle(each).backgroundColor;
      if (!/, 0\\)|transparent/.test(colour)) return colour;
    }
    return "rgb(255, 255, 255)";
  };
  const found = [];
  for (const one of document.querySelectorAll("body *")) {
    if (!shown(one)) continue;
    const style = getComputedStyle(one), svg = one instanceof SVGElement;
    const own = [...one.childNodes].some(each => each.nodeType === 3 && each.data.trim());
    if (own && !/^(title|desc)$/.test(one.tagName))
      found.push(["text", svg ? style.fill : style.color, behind(one)]);
    if (svg && /curve|mark|dots/.test(one.getAttribute("class"))) found.push(["line", style.stroke, behind(one)]);
  }
  return found;
}"""


@pytest.fixture(scope="module")
def page_path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Write a report of a recording with two columns, a gap, an outlier and a chosen window."""
    folder = tmp_path_factory.mktemp("report")
    rng = np.random.default_rng(0)
    t = np.arange(4000) * 0.002
    x = np.stack([np.sin(3 * t), np.cos(2 * t)], 1) + 0.02 * rng.standard_normal((t.size, 2))
    x[1000:1100, 0], x[2000, 0] = np.nan, 3
    rows = "\n".join(",".join(map(repr, row)) for row in np.column_stack([t, x]).tolist())
    (folder / "x.csv").write_text(f"t,angle,{'long name ' * 30}\n{rows}")
    np.save(folder / "x.npy", x)
    target = folder / "report.html"
    assert main(["report", str(folder / "x.csv"), "--time", "t", "-o", str(target)]) == 0
    return target


@pytest.fixture
def opened(browser: Any, page_path: Path) -> Iterator[Any]:
    """Return what opens the page under conditions, watching what it asks for and says."""
    contexts, asked, said = [], [], []

    def open_page(viewport: dict[str, int], **conditions: Any) -> Any:
        context = browser.new_context(viewport=viewport, **conditions)
        contexts.append(context)
        page = context.new_page()
        page.on("request", lambda request: asked.append(request.url))
        page.on("console", lambda message: said.append(message.text))
        page.on("pageerror", lambda error: said.append(str(error)))
        page.goto(page_path.as_uri())
        return page

    yield open_page
    for context in contexts:
        context.close()
    assert said == []
    assert {url for url in asked if not url.startswith("data:")} == {page_path.as_uri()}


def numbers(colour: str) -> list[float]:
    return [float(one) for one in re.findall(r"[\d.]+", colour)][:3]


def contrast(one: str, other: str) -> float:
    """Return the ratio of WCAG 2."""
    levels = []
    for colour in (one, other):
        shares = np.array(numbers(colour)) / 255
        linear = np.where(shares <= 0.04045, shares / 12.92, ((shares + 0.055) / 1.055) ** 2.4)
        levels.append(float(linear @ [0.2126, 0.7152, 0.0722]) + 0.05)
    return max(levels) / min(levels)


def test_it_says_what_python_says(opened, page_path):
    page = opened(DESKTOP)
    x = np.load(page_path.with_name("x.npy"))
    suggestion = algdiff.suggest(x, axis=0, delta=0.002)
    design = suggestion.differentiator
    shown = {name: page.locator(f'[data-name="{name}"]').all_inner_texts() for name in ("window_length", "noise_gain")}
    assert shown == {"window_length": [str(design.window_length)], "noise_gain": [f"{design.noise_gain:.6g}"]}
    least = [f"{np.nanmin(design(row)):.6g}" for row in x.T]
    assert page.locator('[data-name="least"]').all_inner_texts() == least
    assert page.locator('[data-name="missing"]').all_inner_texts() == ["100", "0"]
    assert page.locator("h1").inner_text() == "x.csv"
    assert page.title() == "x.csv - algdiff report"


def test_every_chart_is_shown_once_and_in_its_size(opened):
    for viewport, conditions in ((DESKTOP, {}), (PHONE, {"device_scale_factor": 3, "is_mobile": True})):
        page = opened(viewport, **conditions)
        charts = page.locator("svg.chart:visible")
        # Six of each of two columns, five of the design; each stands in the page in two sizes.
        assert (charts.count(), page.locator("svg.chart").count()) == (17, 34)
        sizes = page.evaluate(
            """() => [...document.querySelectorAll(".chart text")].filter(one => one.getClientRects().length).map(one =>
                 parseFloat(getComputedStyle(one).fontSize) * one.getScreenCTM().a)"""
        )
        assert min(sizes) >= 11
        assert max(sizes) <= 18
        outside = page.evaluate(
            """() => [...document.querySelectorAll("svg.chart > text")].filter(one => one.getClientRects().length)
                 .filter(one => {
                   const own = one.getBoundingClientRect(), all = one.parentElement.getBoundingClientRect();
                   return own.left < all.left - 1 || own.right > all.right + 1 || own.bottom > all.bottom + 1;
                 }).map(one => one.textContent)"""
        )
        assert outside == []


def test_a_phone_does_not_scroll_sideways(opened):
    page = opened(PHONE, device_scale_factor=3, is_mobile=True, has_touch=True)
    assert page.evaluate("[document.documentElement.scrollWidth, innerWidth]") == [360, 360]
    assert page.locator("body").bounding_box()["width"] == 360
    assert len(page.screenshot()) > 20_000


def test_light_and_dark_are_two_and_both_readable(opened):
    grounds = []
    for scheme in ("light", "dark"):
        page = opened(DESKTOP, color_scheme=scheme)
        found = page.evaluate(COLOURS)
        assert len(found) > 300
        for kind, colour, ground in found:
            assert contrast(colour, ground) >= (4.5 if kind == "text" else 3), (scheme, kind, colour, ground)
        grounds.append(page.evaluate("getComputedStyle(document.body).backgroundColor"))
        assert len(page.screenshot()) > 20_000
    light, dark = (sum(numbers(one)) for one in grounds)
    assert light > 600
    assert dark < 150


def test_print_is_light_even_from_a_dark_screen(opened):
    page = opened({"width": 688, "height": 1000}, color_scheme="dark")
    page.emulate_media(media="print")
    for kind, colour, ground in page.evaluate(COLOURS):
        assert sum(numbers(ground)) > 600
        assert contrast(colour, ground) >= (4.5 if kind == "text" else 3)
    assert page.locator("svg.chart:visible").count() == 17


@pytest.mark.parametrize("width", [360, 700, 1100, 1280])
def test_the_first_figures_break_no_word(browser: Any, tmp_path: Path, width: int) -> None:
    np.save(tmp_path / "x.npy", np.sin(0.01 * np.arange(2000)))
    target = tmp_path / "report.html"
    assert main(["report", str(tmp_path / "x.npy"), "--window", "735", "-o", str(target)]) == 0
    page = browser.new_page(viewport={"width": width, "height": 900})
    page.goto(target.as_uri())
    boxes = page.locator(".facts dd")
    assert any("cycles/sample" in one for one in boxes.all_inner_texts())
    wide = boxes.evaluate_all("all => all.filter(one => one.scrollWidth > one.clientWidth).length")
    broken = boxes.evaluate_all("all => all.filter(one => getComputedStyle(one).overflowWrap !== 'normal').length")
    page.close()
    assert (wide, broken) == (0, 0)
