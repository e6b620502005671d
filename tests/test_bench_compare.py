"""What `make bench-compare` calls slower."""

from __future__ import annotations

import json
from pathlib import Path

from tests.benchmarks.compare import costs, slower
from tests.benchmarks.timing import Row


def test_only_costs_that_grew_by_a_tenth_count(tmp_path: Path) -> None:
    runs = []
    for name, factor in (("old", 1.0), ("new", 1.2)):
        rows = [
            Row("step", "9 us", "", "", 2.0 * factor),
            Row("map", "9 us", "", "", 3.0),
            Row("words", "9 us", "", ""),
        ]
        rows += [Row(f"only {name}", "", "", "", factor)]
        path = tmp_path / f"{name}.json"
        path.write_text(json.dumps({"rows": [{"table": "t", **row._asdict()} for row in rows]}))
        runs.append(costs(path))
    assert slower(*runs) == ["t: step"]
    assert slower(runs[0], runs[0]) == []
