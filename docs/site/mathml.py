"""Formulas as MathML, which browsers draw by themselves: no script, no font, no network."""

from __future__ import annotations

import re
from typing import Final

from latex2mathml.converter import convert

#: What is no formula whatever it holds: fenced blocks and code in a line.
_CODE: Final = r"(?P<code>^(?P<fence>`{3,}).*?^(?P=fence)[ ]*$|(?P<ticks>`+)(?!`).+?(?<!`)(?P=ticks)(?!`))"
#: ``$$`` on lines of their own around a formula, and ``$`` around one in a line.
_FORMULA: Final = r"^\$\$\n(?P<block>.+?)\n\$\$[ ]*$|(?<![\\$\w])\$(?P<inline>[^\s$](?:[^$\n]*[^\s$])?)\$(?![\w$])"
_PARTS: Final = re.compile(f"{_CODE}|{_FORMULA}", re.DOTALL | re.MULTILINE)


def with_formulas(page: str) -> str:
    """A page with its LaTeX formulas as MathML; code is left as it is."""
    return _PARTS.sub(_drawn, page)


def _drawn(found: re.Match[str]) -> str:
    if found["code"] is not None:
        return found[0]
    if found["block"] is not None:
        return f'<div class="formula">{_mathml(found["block"], "block")}</div>'
    return _mathml(found["inline"], "inline")


def _mathml(latex: str, display: str) -> str:
    drawn = convert(" ".join(latex.split()), display=display)
    # Markdown must find no emphasis between two signs of a formula.
    return drawn.replace("*", "&#x2217;").replace("_", "&#x5f;")
