"""Turns of phrase that a reader of the field stumbles over do not come back. The message says what to write instead."""

import ast
import re
from pathlib import Path
from typing import NamedTuple

import pytest

ROOT = Path(__file__).parents[2]
PAGES = [
    *(ROOT / name for name in ("README.md", "CONTRIBUTING.md", "CHANGELOG.md")),
    *sorted((ROOT / "docs").rglob("*.md")),
]
SOURCES = sorted((ROOT / "src" / "estimable").rglob("*.py"))  # messages, help and docstrings are held to the same list


class Turn(NamedTuple):
    """A regular expression (a space is any white space), what to write instead, and a sentence that has the turn."""

    pattern: str
    instead: str
    example: str


TURNS = (
    Turn(r"told|tells?|telling", "reports, shows, reveals, determines; distinguishes", "What the outputs tell of it."),
    Turn(r"besides?", "next to, together with, compared with, also", "Small beside the noise."),
    Turn(r"stands?|stood|standing", "is, represents, appears", "The sum stands for the noise."),
    Turn(r"for ever", "forever, permanently", "It is noisy for ever."),
    Turn(r"in (the|its|their|his) place", "instead (of), replaces", "A zero in the place of u."),
    Turn(r"of which (nobody|no one|none|nothing|many|only|the|no)", "whose, many of which", "Inputs of which many are lost."),
    Turn(r"nobody('s)?", "unknown, unmeasured", "Inputs that nobody measured."),
    Turn(r"whole numbers?", "integer", "The order is a whole number."),
    Turn(r"incredibl[ey]", "implausible", "The datum is incredible."),
    Turn(r"(?<!ground\s)truths?", "the true value; bool", "The truth is 0.5."),
    Turn(r"(is|are|was|were|be) kept", "is cached, stored, preserved, fixed", "What is kept, and where."),
    Turn(r"(taken|takes?|taking) apart", "flattened, split", "The record is taken apart."),
    Turn(r"written out", "lowered, unrolled", "The step can be written out."),
    Turn(r"(speaks?|spoke) (against|for)", "is (in)consistent with", "Nothing speaks against the covariances."),
    Turn(r"(know|knows|known|knew) of", "known about; depends on", "Nothing is known of the gain."),
    Turn(r"(nothing|something) of", "nothing about", "The filter learns nothing of the state."),
    Turn(r"says? nothing", "carries no information about", "A window without excitation says nothing."),
    Turn(r"in the dark", "unknown, undetermined", "Which gains are left in the dark?"),
    Turn(r"at (its|their|his|the) word", "as exact", "The model is taken at its word."),
    Turn(r"mak(es?|ing) good|made good", "compensates for", "No law makes good a lost input."),
    Turn(r"bears?|bore", "tolerates", "How much force does the loop bear?"),
    Turn(r"(gives?|gave|given) way", "is replaced by", "What is forgotten gives way to the prior."),
    Turn(r"(can|could|may) be had", "is obtained from", "Its size can be had by a fit."),
    Turn(r"fates?", "arrival; whether they arrived", "Inputs of unknown fate."),
    Turn(r"fresh", "again", "The watch starts fresh."),
    Turn(r"(works?|worked|working) out", "computes", "The weights are worked out."),
    Turn(r"as long as it is not", "unless, until", "As long as it is not seen, it grows."),
    Turn(r"opened by", "say what happens", "A gain that is opened by an input."),
    Turn(r"that what|the same that", "rewrite: one fact in a sentence", "It is the same that was measured."),
    Turn(r"unsaid", "is reported", "Nothing is taken away unsaid."),
    Turn(r"of yours|of (its|their) own(?=[.,;:)])", "your, its own (before the noun)", "Each has a noise of its own."),
    Turn(r"(goes|going|go|went) on (to|with|from)", "continues, resumes", "The run goes on from there."),
    Turn(r"(too|as) sure|sure of (itself|themselves|that)", "its covariance is too small", "The filter is too sure of itself."),
    Turn(r"in words", "with an error message", "Anything else is checked, in words."),
    Turn(r"sentence (says|stands)", "the message says", "Otherwise a sentence says so."),
    Turn(r"(do|does) alike", "give similar results", "Slow and resonant plants do alike."),
    Turn(r"climb(s|ed|ing)?", "maximises", "The likelihood is climbed by its gradient."),
    Turn(r"mend(s|ed|ing)?", "recovers from, repairs", "It mends a wrong prior."),
    Turn(r"reckon(s|ed|ing)?", "assumes, is designed for", "One loop reckons with an offset."),
    Turn(r"whatever (is|the|its|their)", "for any", "It is exact whatever the inputs."),
    Turn(r"doubt(s|ed)", "gives less weight to", "The prior is doubted."),
    Turn(r"believes (in|what|that|its)", "assumes, infers", "The filter believes in its gain."),
    Turn(r"as fresh as", "say since when", "An answer as fresh as a new filter's."),
    Turn(r"calm(er|ness)?", "smooth", "The estimate becomes calm."),
    Turn(r"so much as", "even", "It loses not so much as a digit."),
    Turn(r"laid to", "attributed to", "The jump is laid to an earlier onset."),
    Turn(r"are asked to be|is asked to be", "say the setting", "Unless it is asked to be raised."),
    Turn(r"is let (work|in|into)|are let (work|in|into)", "enters; is not opposed", "Noise that is let into u."),
    Turn(r"as it stands|as they come|as it comes", "unchanged; sample by sample", "The parameters, as they come."),
)  # fmt: skip


def compiled(turn):
    return re.compile(rf"\b(?:{turn.pattern})(?!\w)".replace(" ", r"\s+"), flags=re.IGNORECASE)


PATTERNS = [(compiled(turn), turn.instead) for turn in TURNS]


def findings(text, line=1):
    """`line: "the turn" -> what to write instead`, for each turn of a text that begins at a line."""
    found = [(match, instead) for pattern, instead in PATTERNS for match in pattern.finditer(text)]
    return [
        f'{line + text[: match.start()].count(chr(10))}: "{" ".join(match[0].split())}" -> {instead}'
        for match, instead in found
    ]


def blanked(text, *patterns):
    """The text, with each match of the patterns replaced by its line breaks, so that lines keep their numbers."""
    for pattern in patterns:
        text = re.sub(pattern, lambda match: "·" + "\n" * match[0].count("\n"), text, flags=re.MULTILINE | re.DOTALL)
    return text


def prose(page):
    """A page without code blocks, inline code and the targets of links."""
    return blanked(page, r"^ *```.*?^ *```", r"`[^`]*`", r"(?<=\])\([^)]*\)")


def literals(source):
    """(line, text) of each string literal that has words: messages, help and docstrings, without inline code and examples."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and " " in node.value:
            yield node.lineno, blanked(node.value, r"^ *(>>>|\.\.\.)[^\n]*", r"`[^`]*`")


@pytest.mark.parametrize("page", PAGES, ids=lambda path: path.name)
def test_pages_are_in_plain_english(page):
    found = findings(prose(page.read_text()))
    assert not found, f"{page.relative_to(ROOT)}:\n" + "\n".join(found)


@pytest.mark.parametrize("path", SOURCES, ids=lambda path: str(path.relative_to(ROOT)))
def test_messages_and_docstrings_are_in_plain_english(path):
    found = [finding for line, text in literals(path.read_text()) for finding in findings(text, line)]
    assert not found, f"{path.relative_to(ROOT)}:\n" + "\n".join(found)


@pytest.mark.parametrize("turn", TURNS, ids=lambda turn: turn.pattern)
def test_each_turn_is_found(turn):
    assert compiled(turn).search(turn.example)


def test_a_finding_has_its_line_and_a_better_word():
    page = "Two lines,\nfor\never.\n```\nfor ever\n```\nNot `for ever`, but incredible."
    assert findings(prose(page)) == ['2: "for ever" -> forever, permanently', '7: "incredible" -> implausible']


def test_literals_are_read_from_source():
    source = 'def f():\n    """Say it.\n\n    >>> f("for ever")\n    Not `for ever`, but for ever.\n    """\n    return "told"\n'
    assert [finding for line, text in literals(source) for finding in findings(text, line)] == [
        '5: "for ever" -> forever, permanently'
    ]
