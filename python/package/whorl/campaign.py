"""Campaigns: many simulated runs, or one question to many recordings, as a list of tasks, which an engine distributes."""

from __future__ import annotations

import os
from concurrent.futures import CancelledError
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Dict, Iterator, List, Mapping, Optional, Tuple, Union

from . import _native
from ._native import WhorlError
from .progress import Progress, reporting
from .recording import PathLike


Place = Union[Path, str]
"""A path, or the address of what is in object storage: `s3://BUCKET/PREFIX`."""

_STORED = "s3://"


def _place(path: Any) -> Place:
    text = os.fspath(path)
    return text if text.startswith(_STORED) else Path(text)


class Campaign:
    """A campaign file with its folder, as `whorl campaign FILE --out FOLDER`.

    Each run, and each platform of a recording, is a task: independent, deterministic, and done when its row is in the folder;
    so a task may be interrupted and repeated, and the tables are the same whoever computes them. Every worker needs the files
    and the folder at the same paths (a network file system, or a folder in object storage).

    file: the campaign file, e.g. `params/campaigns/link.yaml`, or over recordings, e.g. `params/campaigns/rediagnose.yaml`.
    out: its folder, or `s3://BUCKET/PREFIX`; one that holds a part of the campaign is continued, and recordings that have been
        added are taken in.
    params: the parameter folder, of campaigns over experiments; default: the file's `../`.
    seeds: number of seeds, instead of the file's.
    """

    def __init__(
        self,
        file: PathLike,
        out: PathLike,
        *,
        params: Optional[PathLike] = None,
        seeds: Optional[int] = None,
        _grow: bool = True,
    ) -> None:
        # Absolute: workers have other working directories.
        self._given: Tuple[str, str, Optional[str], Optional[int]] = (
            os.path.abspath(file),
            out if (out := os.fspath(out)).startswith(_STORED) else os.path.abspath(out),
            None if params is None else os.path.abspath(params),
            seeds,
        )
        self._native = _native.Campaign(*self._given, _grow)

    def __len__(self) -> int:
        """Number of tasks."""
        return len(self._native)

    @property
    def folder(self) -> Place:
        """Where rows and tables are; the address of a folder in object storage."""
        return _place(self._given[1])

    @property
    def missing(self) -> List[int]:
        """Numbers of the tasks that have no row yet."""
        return self._native.missing()

    def run(self, index: int) -> int:
        """Computes a task and stores its row, unless it has one; returns its number."""
        self._native.run(index)
        return index

    def __reduce__(self) -> Any:
        file, out, params, seeds = self._given
        return _again, (file, out, params, seeds)

    def run_with(self, client: Any, *, progress: Progress = None) -> "Tables":
        """Distributes what is missing over the workers of a Dask client, waits, and writes the tables.

        client: a `dask.distributed.Client`, of a `LocalCluster`, an address, Slurm, Kubernetes. A worker that is lost loses
        nothing but the task that it was at, which Dask gives to another. A folder that another process works on is refused.
        """
        distributed = _distributed()
        as_completed: Any = distributed.as_completed

        held = self._native.hold()
        missing = self.missing
        try:
            # Run once, and never taken for the result of another folder.
            futures = client.map(_task, missing, given=self._given, pure=False, batch_size=1000)
            with reporting(progress, "campaign") as show:
                for done, future in enumerate(as_completed(futures), start=1):
                    future.result()
                    if show is not None:
                        show(done / len(missing), f"{done} of {len(missing)} {self._native.noun()}")
            return self.write_tables()
        except (CancelledError, distributed.CancelledError, distributed.comm.CommClosedError):
            left = len(self.missing)
            raise WhorlError(
                f"the Dask scheduler was lost; {len(missing) - left} of {len(missing)} {self._native.noun()} are done and kept, "
                "and the same call computes the others"
            ) from None
        finally:
            held.release()

    def write_tables(self) -> "Tables":
        """Writes the tables and the page of what is done."""
        csv, parquet, further, page, rows, said = self._native.write_tables()
        others = {os.path.basename(folder): _place(folder) for folder in further}
        return Tables(_place(csv), _place(parquet), others, None if page is None else _place(page), rows, said)


def _distributed() -> Any:
    try:
        from dask import distributed
    except ImportError:
        raise WhorlError("this needs Dask: pip install distributed") from None
    return distributed


@contextmanager
def connected(scheduler: str, *, timeout_s: float = 10.0) -> Iterator[Any]:
    """A client of the Dask scheduler at an address, e.g. `tcp://scheduler:8786`; WhorlError where it does not answer."""
    distributed = _distributed()
    try:
        client = distributed.Client(scheduler, timeout=timeout_s)
    except (OSError, ValueError) as error:
        raise WhorlError(f"no Dask scheduler answers at {scheduler}: {error}") from None
    try:
        yield client
    finally:
        # One that was lost does not answer.
        client.close(timeout=2.0)


class Tables:
    """Results of a campaign."""

    def __init__(
        self, csv: Place, parquet: Place, further: Dict[str, Place], page: Optional[Place], rows: int, said: List[str]
    ) -> None:
        self.csv = csv
        """All rows as CSV."""
        self.parquet = parquet
        """Folder of all rows as Parquet; of experiments, partitioned by these."""
        self.further = further
        """Tables with several rows to a recording, by name: `candidates` of diagnoses, `channels` of comparisons, `attitudes`."""
        self.page = page
        """Percentiles over what was swept, as HTML; None for campaigns over recordings."""
        self.rows = rows
        """Number of tasks that are done."""
        self.said = said
        """What came of them, in sentences."""

    def sql(self, query: str) -> Any:
        """Asks DuckDB (`pip install duckdb`); the table's name is `runs`, or `recordings`; further tables have their own:
        `SELECT law, avg(gas_used_g) FROM runs GROUP BY law`. Returns DuckDB's relation: `.fetchall()`, `.pl()`, `.df()`."""
        return ask(query, {"runs": self.parquet, "recordings": self.parquet, **self.further})

    def to_polars(self, table: Optional[str] = None) -> Any:
        """All rows as a Polars data frame; `table`: those of a further table."""
        import polars

        if table is not None and table not in self.further:
            raise WhorlError(f"there is no table {table}; allowed: {', '.join(self.further) or 'none'}")
        if table is not None:
            return polars.read_parquet(_below(self.further[table]), hive_partitioning=True)
        frame = polars.read_parquet(_below(self.parquet), hive_partitioning=True)
        return frame.sort("run" if self.page is not None else "number")

    def __repr__(self) -> str:
        return f"<whorl.campaign.Tables: {self.rows} rows, {self.parquet}>"


def _below(place: Place) -> Place:
    # Polars takes an address without a pattern for one file.
    return f"{place}/**/*.parquet" if isinstance(place, str) else place


def sql(query: str, **tables: PathLike) -> Any:
    """Asks DuckDB (`pip install duckdb`) over tables that Whorl wrote: Parquet files, or folders of them, by the names that the query uses.

    >>> whorl.sql("SELECT law, avg(error_deg) FROM runs GROUP BY law", runs="runs.parquet")             # doctest: +SKIP

    `whorl runs --parquet runs.parquet` writes such a table; so do campaigns, `whorl export parquet`, `whorl diagnose --parquet`,
    `whorl history --parquet`. Returns DuckDB's relation: `.fetchall()`, `.pl()`, `.df()`.
    """
    return ask(query, {name: Path(path) for name, path in tables.items()})


def ask(query: str, tables: Mapping[str, Place]) -> Any:
    """Asks DuckDB over folders of Parquet files, or such files, by name."""
    try:
        import duckdb
    except ImportError:
        raise WhorlError("SQL needs DuckDB: pip install duckdb") from None
    connection = duckdb.connect()
    for name, path in tables.items():
        if isinstance(path, str):
            raise WhorlError(f"{name}: {path} is in object storage: copy it, or ask DuckDB with its extension httpfs")
        if not path.exists():
            raise WhorlError(f"{name}: there is no table {path}")
        pattern = str(path if path.is_file() else path / "**" / "*.parquet").replace("'", "''")
        connection.execute(f"CREATE VIEW {name} AS SELECT * FROM read_parquet('{pattern}', hive_partitioning = true)")
    try:
        asked = connection.sql(query)
        if asked is None:
            raise WhorlError(f"{query}: this asks for nothing")
        return asked
    except duckdb.Error as error:
        raise WhorlError(f"{query}: {error}") from None


_opened: Dict[Tuple[str, str, Optional[str], Optional[int]], Campaign] = {}


def _again(file: str, out: str, params: Optional[str], seeds: Optional[int]) -> Campaign:
    # A worker: what there is to do stands in the folder.
    return Campaign(file, out, params=params, seeds=seeds, _grow=False)


def _task(index: int, given: Tuple[str, str, Optional[str], Optional[int]]) -> int:
    """One run, in a worker; the plan is read once in each."""
    campaign = _opened.get(given)
    if campaign is None:
        campaign = _opened[given] = _again(*given)
    return campaign.run(index)
