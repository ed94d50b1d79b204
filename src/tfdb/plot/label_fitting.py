"""Labels of pictures: names are drawn literally, and shortened to the available room."""

from __future__ import annotations

from functools import cache

from matplotlib import font_manager
from matplotlib.font_manager import FontProperties
from matplotlib.textpath import text_to_path

# matplotlib's font first, then installed fonts for letters that it lacks.
_FAMILIES = (
    "DejaVu Sans",
    "Noto Sans CJK SC",
    "Noto Sans CJK JP",
    "WenQuanYi Zen Hei",
    "Droid Sans Fallback",
    "Arial Unicode MS",
    "Noto Sans Arabic",
    "Noto Sans Hebrew",
    "Noto Sans Devanagari",
)
_ELLIPSIS = "…"


@cache
def families() -> list[str]:
    """Return the fonts of texts; the first font that has a letter draws it."""
    there = {font.name for font in font_manager.fontManager.ttflist}
    return [name for name in _FAMILIES if name in there]


@cache
def _letters() -> frozenset[int]:
    """Return all characters of the fonts."""
    found: set[int] = set()
    for name in families():
        path = font_manager.findfont(FontProperties(family=name), fallback_to_default=False)
        found |= font_manager.get_font(path).get_charmap().keys()
    return frozenset(found)


def shown(text: str) -> str:
    r"""Return a text in one line: characters that the fonts lack are escaped, such as ``\n``."""
    if text.isascii() and text.isprintable():
        return text
    letters = _letters()
    return "".join(
        letter
        if letter.isprintable() and ord(letter) in letters
        else letter.encode("unicode_escape").decode("ascii")
        for letter in text
    )


def width(text: str, size: float, weight: str = "normal") -> float:
    """Measure one line in points, with a margin: letters are wider on a screen's pixels."""
    if not text:
        return 0.0
    # `text_to_path` uses one font only: letters of other fonts count as wide as high.
    own = _letters_of_font()
    known = "".join(letter for letter in text if ord(letter) in own)
    font = FontProperties(family=families()[0], size=size, weight=weight)
    wide, _, _ = text_to_path.get_text_width_height_descent(known, font, ismath=False)
    return float(wide) * 1.09 + (len(text) - len(known)) * size * 1.09


@cache
def _letters_of_font() -> frozenset[int]:
    path = font_manager.findfont(FontProperties(family=families()[0]))
    return frozenset(font_manager.get_font(path).get_charmap().keys())


def fitted(text: str, size: float, room: float, weight: str = "normal") -> str:
    """Return `shown(text)`, without its middle if it is wider than `room` points."""
    text = shown(text)
    if width(text, size, weight) <= room:
        return text
    low, high = 0, len(text)  # number of remaining letters
    while low < high:
        middle = (low + high + 1) // 2
        if width(_without_middle(text, middle), size, weight) <= room:
            low = middle
        else:
            high = middle - 1
    return _without_middle(text, low)


def _without_middle(text: str, kept: int) -> str:
    tail = kept // 2
    return text[: kept - tail] + _ELLIPSIS + (text[-tail:] if tail else "")
