"""TeX in pages, as MathML: no script, no font, no host."""

import re
from html import unescape

from latex2mathml.converter import convert

INLINE = re.compile(r'<span class="arithmatex">\\\((.*?)\\\)</span>', flags=re.DOTALL)
BLOCK = re.compile(r'<div class="arithmatex">\\\[(.*?)\\\]</div>', flags=re.DOTALL)


def with_mathematics(html: str) -> str:
    """The page with each formula as MathML.

    >>> "<mi>x</mi>" in with_mathematics(r'<span class="arithmatex">\\(x\\)</span>')
    True
    """
    html = INLINE.sub(lambda found: _mathml(found[1], "inline"), html)
    return BLOCK.sub(lambda found: f'<div class="formula">{_mathml(found[1], "block")}</div>', html)


def _mathml(tex: str, display: str) -> str:
    return convert(unescape(tex).strip(), display=display)
