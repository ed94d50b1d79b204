"""Errors name a shared store by its name for users."""

from __future__ import annotations

import os
import signal
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

import tfdb

from . import child
from .child import Child

if TYPE_CHECKING:
    from collections.abc import Callable


def file_of(name: str) -> Path:
    return Path(f"/dev/shm/tfdb.{name}")


def control_of(name: str) -> Path:
    (control,) = file_of(name).parent.glob(f"tfdb.{name}.control-*")
    return control


def read_only(name: str) -> None:
    tfdb.Buffer.open(name)
    child.move_arm(tfdb.Buffer.open(name, mode="r"), 1)


def exists(name: str) -> None:
    tfdb.Buffer.open(name)
    tfdb.Buffer.open(name, create=True)


def cut(name: str) -> None:
    tfdb.Buffer.open(name)
    os.truncate(file_of(name), 1 << 20)
    tfdb.Buffer.open(name)


def not_a_store(name: str) -> None:
    file_of(name).write_bytes(b"something else" * 100)
    try:
        tfdb.Buffer.open(name)
    finally:
        file_of(name).unlink()


def without_control(name: str) -> None:
    tfdb.Buffer.open(name)
    control_of(name).unlink()
    tfdb.Buffer.open(name)


def control_cut(name: str) -> None:
    tfdb.Buffer.open(name)
    os.truncate(control_of(name), 100)
    tfdb.Buffer.open(name)


def control_of_another(name: str) -> None:
    tfdb.Buffer.open(name)
    control = control_of(name)
    control.write_bytes(b"x" * control.stat().st_size)
    tfdb.Buffer.open(name)


def lock_damaged(name: str) -> None:
    buffer = tfdb.Buffer.open(name)
    with control_of(name).open("r+b") as file:
        file.seek(256)
        file.write(b"\xff" * 40)
    child.move_arm(buffer, 1)


def lock_held(name: str) -> None:
    buffer = tfdb.Buffer.open(name, lock_timeout=0.01)
    child.move_arm(buffer, 1)
    with Child("hold_lock", name) as writer:
        writer.wait_until_stopped()
        child.move_arm(buffer, 2)


def removed_amid_a_wait(name: str) -> None:
    buffer = tfdb.Buffer.open(name)

    def remove(_number: int, _frame: object) -> None:
        tfdb.Buffer.unlink(name)

    before = signal.signal(signal.SIGALRM, remove)
    signal.setitimer(signal.ITIMER_REAL, 0.05)
    try:
        buffer.wait_for_commit(buffer.commit, 60)
    finally:
        signal.signal(signal.SIGALRM, before)


def no_such(name: str) -> None:
    tfdb.Buffer.open(name, mode="r")


ERRORS: dict[Callable[[str], None], type[tfdb.TfdbError]] = {
    read_only: tfdb.errors.ReadOnly,
    exists: tfdb.errors.StoreExists,
    cut: tfdb.errors.CorruptStore,
    not_a_store: tfdb.errors.CorruptStore,
    without_control: tfdb.errors.CorruptStore,
    control_cut: tfdb.errors.CorruptStore,
    control_of_another: tfdb.errors.CorruptStore,
    lock_damaged: tfdb.errors.CorruptStore,
    lock_held: tfdb.errors.LockTimeout,
    removed_amid_a_wait: tfdb.errors.NoSuchStore,
    no_such: tfdb.errors.NoSuchStore,
}


@pytest.mark.parametrize("cause", ERRORS, ids=lambda cause: cause.__name__)
def test_errors_name_the_store(name: str, cause: Callable[[str], None]) -> None:
    with pytest.raises(ERRORS[cause]) as caught:
        cause(name)
    assert f"'{name}'" in str(caught.value)
    assert "/dev/shm" not in str(caught.value)
    assert caught.value.path == str(file_of(name))  # type: ignore[attr-defined]
    for left in file_of(name).parent.glob(f"tfdb.{name}*"):
        left.unlink()


def test_a_lock_timeout_reports_the_waited_time(name: str) -> None:
    with pytest.raises(
        tfdb.errors.LockTimeout, match=r"has held the store '[^']+' for 0\.01\d* s: "
    ):
        lock_held(name)
