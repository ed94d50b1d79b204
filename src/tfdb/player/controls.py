"""Words and keys that control a player."""

from __future__ import annotations

from typing import TYPE_CHECKING

from tfdb.data.errors import InvalidArgument

if TYPE_CHECKING:
    from collections.abc import Callable

    from .player import Player

_PLAIN: dict[str, Callable[[Player], None]] = {
    "pause": lambda player: player.pause(),
    "step": lambda player: player.step(),
    "back": lambda player: player.step_back(),
    "reverse": lambda player: player.reverse(),
    "faster": lambda player: player.change_speed(1.25),
    "slower": lambda player: player.change_speed(0.8),
    "quit": lambda player: player.stop(),
}
_NUMBERED: dict[str, Callable[[Player, float], None]] = {
    "speed": lambda player, value: player.set_speed(value),
    "seek": lambda player, value: player.seek(value),
    "skip": lambda player, value: player.seek_by(value),
}
CONTROLS: list[str] = [*_PLAIN, *(f"{each} X" for each in _NUMBERED)]
"""All controls; X stands for a number. docs/howto/play.md describes them."""
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
"""The control of each key; arrow keys are the bytes that terminals send."""


def obey(player: Player, line: str) -> None:
    """Execute a line of controls.

    Raises
    ------
    InvalidArgument
        The word is unknown, or its number is missing. The text lists all controls.
    """
    word, _, rest = line.strip().partition(" ")
    if word in _PLAIN and not rest:
        _PLAIN[word](player)
        return
    if word in _NUMBERED:
        try:
            value = float(rest)
        except ValueError:
            value = float("nan")
        if abs(value) < float("inf"):
            _NUMBERED[word](player, value)
            return
        raise InvalidArgument(f"{word} needs a number, got {rest.strip()!r}", value=line)
    text = f"{line.strip()!r}: not a control; the controls are {', '.join(CONTROLS)}"
    raise InvalidArgument(text, value=line)
