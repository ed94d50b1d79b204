"""What a random sequence is made of: few names, few stamps, and mostly one tree."""

from __future__ import annotations

from dataclasses import dataclass

from hypothesis import strategies as st

import tfdb

NAMES = ("a", "b", "c", "d", "e", "f", "g", "h", "i")
UNKNOWN = "unknown"
# Child, parent: what most writes agree on, so that long paths come about.
TREE = (("b", "a"), ("c", "b"), ("d", "c"), ("e", "b"), ("f", "e"), ("g", "a"))

names = st.sampled_from(NAMES)
edges = st.one_of(
    st.sampled_from(TREE),
    st.sampled_from(TREE),
    st.tuples(names, names),
)
# Counted from the beginning or, where negative, back from the newest stamp.
ticks = st.one_of(st.integers(0, 50), st.integers(-30, -1))
limits = st.one_of(st.none(), st.integers(0, 30))


@dataclass(frozen=True)
class Rule:
    """A policy whose limit is counted in ticks."""

    kind: str
    limit: int | None = None

    def policy(self, tick: int) -> tfdb.Policy:
        """The policy itself."""
        limit = None if self.limit is None else self.limit * tick
        match self.kind:
            case "interpolate":
                return tfdb.Interpolate(max_gap_ns=limit)
            case "exact":
                return tfdb.Exact()
            case "previous":
                return tfdb.Previous(max_age_ns=limit)
            case "nearest":
                return tfdb.Nearest(tolerance_ns=limit)
            case _:
                return tfdb.Extrapolate(max_ns=limit)


rules = st.one_of(
    st.builds(Rule, st.sampled_from(("interpolate", "previous", "nearest")), limits),
    st.builds(Rule, st.just("extrapolate"), st.integers(0, 60)),
    st.just(Rule("interpolate")),
    st.just(Rule("exact")),
)
