"""Counts and ages as OpenMetrics text, which Prometheus reads."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal

from tfdb.judging.events import EVENT_KINDS

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from tfdb.judging.events import Event

OPEN_METRICS = "application/openmetrics-text"
"""The Accept value of clients that know more than Prometheus's older text format."""
OPEN_METRICS_TYPE = f"{OPEN_METRICS}; version=1.0.0; charset=utf-8"
PROMETHEUS_TYPE = "text/plain; version=0.0.4; charset=utf-8"
_ESCAPES = str.maketrans({"\\": r"\\", '"': r"\"", "\n": r"\n"})


@dataclass(frozen=True)
class Metric:
    """A metric: its values by labels. Names of counters do not end in `_total`."""

    name: str
    kind: Literal["gauge", "counter"]
    meaning: str
    samples: list[tuple[dict[str, str], float]] = field(default_factory=list)


def one(name: str, kind: Literal["gauge", "counter"], meaning: str, value: float) -> Metric:
    """Return a metric without labels."""
    return Metric(name, kind, meaning, [({}, value)])


def write_metrics(metrics: Iterable[Metric]) -> str:
    """Write metrics as text that is valid in both formats."""
    lines = []
    for metric in metrics:
        lines.append(f"# TYPE {metric.name} {metric.kind}")
        if metric.name.endswith("_seconds"):
            lines.append(f"# UNIT {metric.name} seconds")
        lines.append(f"# HELP {metric.name} {metric.meaning}")
        name = f"{metric.name}_total" if metric.kind == "counter" else metric.name
        lines += [f"{name}{_labels(labels)} {value}" for labels, value in metric.samples]
    return "\n".join([*lines, "# EOF", ""])


def _labels(labels: Mapping[str, str]) -> str:
    if not labels:
        return ""
    pairs = [f'{name}="{value.translate(_ESCAPES)}"' for name, value in labels.items()]
    return "{" + ",".join(pairs) + "}"


def expectation_metrics(active: Iterable[Event], begun: Mapping[str, int]) -> list[Metric]:
    """Return how many expectations are broken now, and how many were broken in total."""
    broken = Counter({(kind, usual): 0 for kind, (usual, _) in EVENT_KINDS.items()})
    broken.update((event.kind, event.severity) for event in active)
    return [
        Metric(
            "tfdb_expectations_broken",
            "gauge",
            "Expectations that are broken now.",
            [
                ({"kind": kind, "severity": severity}, count)
                for (kind, severity), count in broken.items()
            ],
        ),
        Metric(
            "tfdb_expectations_begun",
            "counter",
            "Events that began because an expectation was broken.",
            [({"kind": kind}, begun.get(kind, 0)) for kind in EVENT_KINDS],
        ),
    ]


def age_metric(ages: Iterable[tuple[str, str, float]]) -> Metric:
    """Return the metric for ages of edges in seconds, given with parent and child."""
    return Metric(
        "tfdb_edge_age_seconds",
        "gauge",
        "Time from the newest stamp of the edge to now.",
        [({"parent": parent, "child": child}, age) for parent, child, age in ages],
    )
