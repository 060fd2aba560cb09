"""What charts look like: colours that remain distinct to the colour-blind, dashes that remain distinct in grey."""

from __future__ import annotations

LIGHT = """--c0: #0b62a8; --c1: #c2410c; --c2: #0a7d5a; --c3: #8b3fa8; --c4: #8a6100; --c5: #0e7490; --c6: #be185d;
  --c7: #828e9a; --grid: #e6eaee; --axis: #98a3ae; --ink: #17212b; --muted: #56616d;"""
DARK = """--c0: #62b2f7; --c1: #ff9a5c; --c2: #45cf9f; --c3: #d29bea; --c4: #e3b341; --c5: #5fd3e6; --c6: #ff8ab8;
  --c7: #71808f; --grid: #28313b; --axis: #5c6874; --ink: #e6ebf0; --muted: #a4b0bc;"""
DASHES = ("", "7 3", "2 2.5", "9 3 2 3", "4 3", "12 4", "1.5 4", "")
"""Of the styles c0 to c6, distinct in colour and in dashes, and of c7, thin and grey, for what is in the background."""
FONT = 'system-ui, -apple-system, "Segoe UI", Roboto, "Helvetica Neue", Arial, sans-serif'

STYLE = f"""
:root {{ {LIGHT} }}
@media (prefers-color-scheme: dark) {{ :root {{ {DARK} }} }}
@media print {{ :root {{ {LIGHT} }} }}
.chart {{ display: block; width: 100%; height: auto; font: 13px {FONT}; }}
.chart text {{ fill: var(--muted); font-variant-numeric: tabular-nums; }}
.chart .title {{ fill: var(--ink); font-weight: 600; }}
.chart .grid {{ stroke: var(--grid); fill: none; }}
.chart .axis {{ stroke: var(--axis); fill: none; }}
.chart .curve {{ fill: none; stroke-width: 2; stroke-linejoin: round; }}
.chart .mark {{ fill: none; stroke-width: 1.5; }}
.chart .dots {{ fill: none; stroke-width: 4.5; stroke-linecap: round; stroke-dasharray: none; }}
.chart .band {{ stroke: none; opacity: 0.28; }}
.chart .curve.c7 {{ stroke-width: 1.1; }}
""" + "".join(
    f".chart .c{style} {{ stroke: var(--c{style}); }} .chart .band.c{style} {{ fill: var(--c{style}); stroke: none; }}"
    + (f" .chart .curve.c{style}, .chart .mark.c{style} {{ stroke-dasharray: {dashes}; }}\n" if dashes else "\n")
    for style, dashes in enumerate(DASHES)
)
"""The style sheet of charts, light and dark."""
