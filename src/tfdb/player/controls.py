"""Words and keys that control a player."""

from __future__ import annotations

from typing import TYPE_CHECKING

from tfdb.data.errors import InvalidArgument

if TYPE_CHECKING:
    from collections.abc import Callable

    from .player import Player

# word -> (what it does, with a number behind it or without, meaning)
_PLAIN: dict[str, tuple[Callable[[Player], None], str]] = {
    "pause": (lambda player: player.pause(), "stand still, or go on"),
    "step": (lambda player: player.step(), "pause, and play the next commit"),
    "back": (lambda player: player.step_back(), "pause, and take the last commit back"),
    "reverse": (lambda player: player.reverse(), "play backwards, or no more"),
    "faster": (lambda player: player.change_speed(1.25), "play 1.25 times as fast as now"),
    "slower": (lambda player: player.change_speed(0.8), "play 0.8 times as fast as now"),
    "quit": (lambda player: player.stop(), "end"),
}
_NUMBERED: dict[str, tuple[Callable[[Player, float], None], str]] = {
    "speed": (lambda player, value: player.set_speed(value), "play X times as fast as recorded"),
    "seek": (lambda player, value: player.seek(value), "jump to X seconds after the beginning"),
    "skip": (lambda player, value: player.seek_by(value), "jump X seconds forth, or back if X < 0"),
}
KEYS: dict[str, str] = {
    " ": "pause",
    "\x1b[C": "step",
    "\x1b[D": "back",
    "\x1b[A": "faster",
    "\x1b[B": "slower",
    "]": "skip 5",
    "[": "skip -5",
    "r": "reverse",
    "q": "quit",
    **{str(digit): f"speed {digit}" for digit in range(1, 10)},
}
"""What each key stands for; arrow keys by the bytes that terminals send."""


def obey(player: Player, line: str) -> None:
    """Do what a line says.

    Raises
    ------
    InvalidArgument
        The word is unknown, or its number is missing. The text lists all controls.
    """
    word, _, rest = line.strip().partition(" ")
    if word in _PLAIN and not rest:
        _PLAIN[word][0](player)
        return
    if word in _NUMBERED:
        try:
            value = float(rest)
        except ValueError:
            value = float("nan")
        if abs(value) < float("inf"):
            _NUMBERED[word][0](player, value)
            return
        raise InvalidArgument(f"{word} needs a number, got {rest.strip()!r}", value=line)
    words = [*_PLAIN, *(f"{each} X" for each in _NUMBERED)]
    text = f"{line.strip()!r}: the word is unknown; there are {', '.join(words)}"
    raise InvalidArgument(text, value=line)


def controls() -> list[tuple[str, str]]:
    """Return each control and what it does."""
    plain = [(word, meaning) for word, (_, meaning) in _PLAIN.items()]
    return plain + [(f"{word} X", meaning) for word, (_, meaning) in _NUMBERED.items()]
