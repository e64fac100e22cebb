"""Campaigns: many simulated runs as a list of tasks, which an engine distributes."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any, Dict, List, Optional, Tuple

from . import _native
from ._native import WhorlError
from .progress import Progress, reporting
from .recording import PathLike


class Campaign:
    """A campaign file with its folder, as `whorl campaign FILE --out FOLDER`.

    Each run is a task: independent, deterministic, and done when its row is in the folder; so a task may be interrupted and
    repeated, and the tables are the same whoever computes them. Every worker needs the files and the folder at the same
    paths (a network file system).

    file: the campaign file, e.g. `params/campaigns/link.yaml`.
    out: its folder; one that holds a part of the campaign is continued.
    params: the parameter folder; default: the file's `../`.
    seeds: number of seeds, instead of the file's.
    """

    def __init__(
        self, file: PathLike, out: PathLike, *, params: Optional[PathLike] = None, seeds: Optional[int] = None
    ) -> None:
        # Absolute: workers have other working directories.
        self._given: Tuple[str, str, Optional[str], Optional[int]] = (
            os.path.abspath(file),
            os.path.abspath(out),
            None if params is None else os.path.abspath(params),
            seeds,
        )
        self._native = _native.Campaign(*self._given)

    def __len__(self) -> int:
        """Number of runs."""
        return len(self._native)

    @property
    def folder(self) -> Path:
        """Where rows and tables are."""
        return Path(self._given[1])

    @property
    def missing(self) -> List[int]:
        """Numbers of the runs that have no row yet."""
        return self._native.missing()

    def run(self, index: int) -> int:
        """Simulates a run and stores its row, unless it has one; returns its number."""
        self._native.run(index)
        return index

    def __reduce__(self) -> Any:
        file, out, params, seeds = self._given
        return _again, (file, out, params, seeds)

    def run_with(self, client: Any, *, progress: Progress = None) -> "Tables":
        """Distributes what is missing over the workers of a Dask client, waits, and writes the tables.

        client: a `dask.distributed.Client`, of a `LocalCluster`, an address, Slurm, Kubernetes. A worker that is lost loses
        nothing but the run that it was at, which Dask gives to another. A folder that another process works on is refused.
        """
        from dask import distributed

        as_completed: Any = distributed.as_completed

        held = self._native.hold()
        try:
            missing = self.missing
            # Run once, and never taken for the result of another folder.
            futures = client.map(_task, missing, given=self._given, pure=False, batch_size=1000)
            with reporting(progress, "campaign") as show:
                for done, future in enumerate(as_completed(futures), start=1):
                    future.result()
                    if show is not None:
                        show(done / len(missing), f"{done} of {len(missing)} runs")
            return self.write_tables()
        finally:
            held.release()

    def write_tables(self) -> "Tables":
        """Writes the tables and the page of what is done."""
        csv, parquet, page, rows = self._native.write_tables()
        return Tables(Path(csv), Path(parquet), Path(page), rows)


class Tables:
    """Results of a campaign."""

    def __init__(self, csv: Path, parquet: Path, page: Path, rows: int) -> None:
        self.csv = csv
        """All rows as CSV."""
        self.parquet = parquet
        """Folder of all rows as Parquet, partitioned by experiment."""
        self.page = page
        """Percentiles over what was swept, as HTML."""
        self.rows = rows
        """Number of runs that are done."""

    def sql(self, query: str) -> Any:
        """Asks DuckDB (`pip install duckdb`); the table's name is `runs`: `SELECT law, avg(gas_used_g) FROM runs GROUP BY law`.
        Returns DuckDB's relation: `.fetchall()`, `.pl()`, `.df()`."""
        try:
            import duckdb
        except ImportError:
            raise WhorlError("SQL needs DuckDB: pip install duckdb") from None
        pattern = str(self.parquet / "**" / "*.parquet").replace("'", "''")
        connection = duckdb.connect()
        connection.execute(f"CREATE VIEW runs AS SELECT * FROM read_parquet('{pattern}', hive_partitioning = true)")
        return connection.sql(query)

    def to_polars(self) -> Any:
        """All rows as a Polars data frame."""
        import polars

        return polars.read_parquet(self.parquet, hive_partitioning=True).sort("run")

    def __repr__(self) -> str:
        return f"<whorl.campaign.Tables: {self.rows} runs, {self.parquet}>"


_opened: Dict[Tuple[str, str, Optional[str], Optional[int]], Campaign] = {}


def _again(file: str, out: str, params: Optional[str], seeds: Optional[int]) -> Campaign:
    return Campaign(file, out, params=params, seeds=seeds)


def _task(index: int, given: Tuple[str, str, Optional[str], Optional[int]]) -> int:
    """One run, in a worker; the plan is read once in each."""
    campaign = _opened.get(given)
    if campaign is None:
        campaign = _opened[given] = _again(*given)
    return campaign.run(index)
