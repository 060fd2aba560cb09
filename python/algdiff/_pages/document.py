"""Whole HTML documents without anything from outside: what `algdiff report` writes and `algdiff designer` serves."""

from __future__ import annotations

import base64
import hashlib

from algdiff._svg.chart import STYLE as CHARTS
from algdiff._svg.chart import text
from algdiff._svg.style import FONT

LIGHT = """--page: #f4f6f8; --card: #ffffff; --edge: #dfe4e9; --accent: #0b62a8; --on-accent: #ffffff;
  --warn: #8a4b00; --warn-card: #fff6e6; --warn-edge: #efc987; --error: #b3261e; --code: #f4f6f8;"""
DARK = """--page: #0f1419; --card: #171d24; --edge: #2a333d; --accent: #62b2f7; --on-accent: #0b1a28;
  --warn: #f2c46d; --warn-card: #2a2214; --warn-edge: #6b5423; --error: #ff8a80; --code: #0f1419;"""
COLOURS = f"""
:root {{ color-scheme: light dark; {LIGHT} }}
@media (prefers-color-scheme: dark) {{ :root {{ {DARK} }} }}
@media print {{ :root {{ color-scheme: light; {LIGHT} }} }}
"""
"""Colours of pages; those of text and curves are with the charts."""

LAYOUT = f"""
*, *::before, *::after {{ box-sizing: border-box; }}
html {{ -webkit-text-size-adjust: 100%; text-size-adjust: 100%; }}
body {{ margin: 0; background: var(--page); color: var(--ink); font: 16px/1.5 {FONT}; overflow-wrap: break-word; }}
.page {{ max-width: 1240px; margin: 0 auto; padding: 20px 20px 48px; }}
h1 {{ font-size: 1.7rem; line-height: 1.2; margin: 0.4em 0 0.2em; letter-spacing: -0.01em; }}
h2 {{ font-size: 1.25rem; line-height: 1.3; margin: 1.8em 0 0.6em; }}
h3 {{ font-size: 1rem; margin: 0 0 0.5em; }}
p {{ margin: 0.4em 0 0.8em; max-width: 75ch; }}
a {{ color: var(--accent); }}
.muted {{ color: var(--muted); }}
.small {{ font-size: 0.875rem; }}
.grid {{ display: grid; gap: 14px; grid-template-columns: repeat(auto-fit, minmax(min(100%, 350px), 1fr)); }}
.pair {{ grid-template-columns: repeat(auto-fit, minmax(min(100%, 500px), 1fr)); }}
.grid > * {{ min-width: 0; }}
.more {{ margin-top: 14px; }}
.wide {{ grid-column: 1 / -1; }}
.card {{ background: var(--card); border: 1px solid var(--edge); border-radius: 10px; padding: 14px; margin: 0; }}
.narrow-only {{ display: none; }}
.scroll {{ overflow-x: auto; max-width: 100%; }}
table {{ border-collapse: collapse; font-size: 0.9rem; width: 100%; }}
caption {{ text-align: left; font-weight: 600; padding: 0 0 6px; }}
th, td {{ text-align: left; padding: 4px 12px 4px 0; vertical-align: baseline; border-bottom: 1px solid var(--edge); }}
tr:last-child > * {{ border-bottom: 0; }}
th {{ font-weight: 400; color: var(--muted); }}
td.number {{ text-align: right; font-variant-numeric: tabular-nums; white-space: nowrap; }}
pre, code {{ font-family: ui-monospace, SFMono-Regular, Menlo, Consolas, "DejaVu Sans Mono", monospace; }}
pre {{ background: var(--code); border: 1px solid var(--edge); border-radius: 8px; padding: 10px 12px; margin: 0 0 10px;
  font-size: 0.85rem; line-height: 1.45; overflow-x: auto; white-space: pre-wrap; overflow-wrap: anywhere; }}
.warnings {{ background: var(--warn-card); border: 1px solid var(--warn-edge); border-radius: 10px;
  padding: 12px 14px; margin: 14px 0; color: var(--warn); }}
.warnings ul {{ margin: 0; padding-left: 1.2em; }}
.facts {{ display: grid; gap: 10px; margin: 14px 0;
  grid-template-columns: repeat(auto-fit, minmax(min(47%, 165px), 1fr)); }}
.facts > div {{ background: var(--card); border: 1px solid var(--edge); border-radius: 10px; padding: 10px 12px; }}
.facts dt {{ color: var(--muted); font-size: 0.82rem; }}
.unit {{ display: inline-block; }}
.facts dd {{ margin: 0; font-size: 1.1rem; overflow-wrap: normal;
  font-weight: 600; font-variant-numeric: tabular-nums; line-height: 1.3; }}
:focus-visible {{ outline: 3px solid var(--accent); outline-offset: 2px; }}
@media (max-width: 699px) {{
  .page {{ padding: 8px 8px 32px; }}
  .grid, .pair {{ grid-template-columns: minmax(0, 1fr); gap: 10px; }}
  .card {{ padding: 10px 6px; }}
  h1 {{ font-size: 1.4rem; }}
  .wide-only {{ display: none; }}
  .narrow-only {{ display: block; }}
}}
"""
PRINT = """
@page { margin: 14mm; }
@media print {
  body { background: none; font-size: 10pt; }
  .page { max-width: none; padding: 0; }
  .grid, .pair { grid-template-columns: repeat(2, minmax(0, 1fr)); gap: 8px; }
  .card, .facts > div, .warnings { break-inside: avoid; border-color: #ccc; }
  h2 { break-after: avoid; }
  .wide-only, .half.narrow-only { display: block; }
  .narrow-only, .half.wide-only, .screen-only { display: none; }
  pre { white-space: pre-wrap; }
}
"""


def page(title: str, body: str, script: str = "", nonce: str | None = None, style: str = "") -> str:
    """Return a whole HTML document that loads nothing from anywhere.

    Parameters
    ----------
    title : str
        Of the window; any text, it is escaped.
    body : str
        What the page holds, as HTML that is safe; see `algdiff._svg.chart.text`.
    script : str
        The page's only script. It may talk to where the page came from, and to nobody else.
    nonce : str, optional
        What allows the script; by default the script's own digest.
    style : str
        More of the style sheet.

    Returns
    -------
    str
        The document.

    Raises
    ------
    ValueError
        `script` or `style` would end its element before its end.

    Examples
    --------
    >>> from algdiff._pages.document import page
    >>> print(page("a < b", "<p>Less.</p>").splitlines()[4])
    <title>a &lt; b</title>
    """
    for name, words in (("script", script), ("style", style)):
        if f"</{name}" in words.lower():
            raise ValueError(f"{name} must not hold the end of its own element, got </{name}")
    policy = [
        "default-src 'none'",
        "style-src 'unsafe-inline'",
        "img-src data:",
        "base-uri 'none'",
        "form-action 'none'",
    ]
    element = ""
    if script:
        policy += [f"script-src {_allowed(script, nonce)}", "connect-src 'self'"]
        element = f"<script{f' nonce={chr(34)}{text(nonce)}{chr(34)}' if nonce else ''}>{script}</script>\n"
    return f"""<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<title>{text(title)}</title>
<meta http-equiv="Content-Security-Policy" content="{"; ".join(policy)}">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta name="color-scheme" content="light dark">
<meta name="referrer" content="no-referrer">
<link rel="icon" href="data:,">
<style>{CHARTS}{COLOURS}{LAYOUT}{PRINT}{style}</style>
</head>
<body>
{body}
{element}</body>
</html>
"""


def _allowed(script: str, nonce: str | None) -> str:
    """Return what the policy calls the script."""
    if nonce:
        return f"'nonce-{text(nonce)}'"
    return f"'sha256-{base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()}'"
