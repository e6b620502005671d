"""tracks.parquet: the table of tracks.csv with its types, for pandas, polars, R and DuckDB."""

from __future__ import annotations

from pathlib import Path

from ndtorch.report.exports.source_tracks import SourceTracks
from ndtorch.report.exports.table import columns

FILE = "tracks.parquet"
NEEDS = ("pyarrow",)


def write(tracks: SourceTracks, path: Path) -> None:
    """Write the columns."""
    import pyarrow
    import pyarrow.parquet

    pyarrow.parquet.write_table(pyarrow.table(columns(tracks)), path)
