"""The end of the process for open nodes."""

from __future__ import annotations

import pytest

from tfdb.ros import clocked_node


class FailingNode(clocked_node.ClockedNode):
    """A node that does not end."""

    closed = False

    def close(self) -> None:
        self.closed = True
        raise ConnectionError("no router")


def test_all_nodes_are_closed_although_they_raise(monkeypatch: pytest.MonkeyPatch) -> None:
    nodes = {FailingNode(name, simulated=False) for name in ("a", "b")}
    monkeypatch.setattr(clocked_node, "open_nodes", nodes)
    with pytest.raises(ConnectionError):
        clocked_node._close_all()
    assert all(node.closed for node in nodes)
